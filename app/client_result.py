"""A result as a client holds it: what the service tells, with arrays, and a trajectory to be evaluated.

SciPy and matplotlib are imported where they are first needed, so that a client that only submits starts at
once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.client_answers import ClientError

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

    from solvers.phases.trajectory import AnyTrajectory
    from solvers.problem import OptimalControlProblem

Array = NDArray[np.float64]


class MissingExtraError(ClientError):
    """A library is not installed that only this needs."""

    def __init__(self, what: str, library: str) -> None:
        super().__init__(f"{what} needs {library}, which is not installed: pip install {library}")


class NotFiniteError(ClientError):
    """The last iterate of a solve that diverged has no finite numbers, so that it cannot be evaluated."""


@dataclass(frozen=True, slots=True)
class Samples:
    """A trajectory at given times: an array for each name, of the shape of ``t``.

    In the units of the document. ``rates`` are the time derivatives of the states, where they were asked for.
    """

    t: Array
    states: Mapping[str, Array]
    controls: Mapping[str, Array]
    outputs: Mapping[str, Array]
    rates: Mapping[str, Array]

    @classmethod
    def of(cls, sampled: Mapping[str, Any], shape: tuple[int, ...] | None = None) -> Samples:
        """The ``trajectory`` of a result as arrays; null becomes NaN. ``shape``: that of the times."""

        def array(values: Any) -> Array:
            flat = np.array(values, np.float64)
            # Of one instant the number itself.
            return flat if shape is None else flat.reshape(shape)[()]

        groups = (sampled.get(group, {}) for group in ("states", "controls", "outputs", "rates"))
        return cls(
            array(sampled["t"]), *({name: array(row) for name, row in group.items()} for group in groups)
        )


class Result(dict[str, Any]):
    """The result JSON of a job, a dictionary as the service tells it, and what can be done with it.

    result = client.solve(document)
    result["verification"]["passed"]      everything, by its key
    result.t, result.states["theta"]      the samples, as NumPy arrays
    result.at(12.5).states["theta"]       anything in between, exactly
    """

    @property
    def success(self) -> bool:
        """Whether the program converged and the re-integration confirmed its answer."""
        return bool(self["success"])

    @property
    def objective(self) -> float | None:
        """The objective, None where it is not finite."""
        value: float | None = self["objective"]
        return value

    @property
    def final_time(self) -> float | None:
        """The final time, None where it is not finite."""
        value: float | None = self["final_time"]
        return value

    @cached_property
    def samples(self) -> Samples:
        """The samples: equidistant times, and each switching time twice, for its left and right value."""
        return Samples.of(self["trajectory"])

    @property
    def t(self) -> Array:
        """The times of the samples, (K,)."""
        return self.samples.t

    @property
    def states(self) -> Mapping[str, Array]:
        """State -> samples, (K,)."""
        return self.samples.states

    @property
    def controls(self) -> Mapping[str, Array]:
        """Control -> samples, (K,)."""
        return self.samples.controls

    @property
    def outputs(self) -> Mapping[str, Array]:
        """Output -> samples, (K,)."""
        return self.samples.outputs

    def at(self, times: ArrayLike, *, derivatives: bool = False) -> Samples:
        """Evaluate the trajectory at one or many times, from its coefficients, without asking the service.

        Gives the same numbers as `Client.trajectory`; of several plants under one command those of the first.
        Where a control jumps or two phases meet, a time gives the right value, and one that stands twice in a
        row both values; what a phase does not have is NaN there.
        Raises ValueError for times outside the trajectory, `NotFiniteError` for an iterate that diverged.
        """
        from solvers.output.sampling import sample_any

        problems, trajectory = self._answer
        instants = np.asarray(times, np.float64)
        if not trajectory.covers(instants):
            raise ValueError(f"times must lie within the trajectory, [{trajectory.t0!r}, {trajectory.tf!r}]")
        if not trajectory.finite:
            raise NotFiniteError("the last iterate is not finite, so that it cannot be evaluated")
        sampled = sample_any(problems, trajectory, instants.ravel(), derivatives=derivatives)
        return Samples.of(sampled, instants.shape)

    @cached_property
    def _answer(self) -> tuple[list[OptimalControlProblem], AnyTrajectory]:
        """The problem of each phase, for its outputs, and the curves."""
        from solvers.output.sampling import problems_of
        from solvers.phases.trajectory import trajectory_of

        return problems_of(self), trajectory_of(self)

    def to_xarray(self) -> xarray.Dataset:
        """The samples as a dataset over ``t``, with units where the document tells them.

        At a switching time it has the right value only, so that ``t`` is an index. Every variable says in
        ``attrs`` what it is (``kind``: state, control, output). Raises `MissingExtraError` without xarray
        (the extra ``xarray``).
        """
        try:
            import xarray
        except ImportError as error:
            raise MissingExtraError("to_xarray()", "xarray") from error
        from solvers.output.plot import units_of

        units = units_of(self)
        last = np.append(np.diff(self.t) > 0, True)  # of equal times

        def attributes(name: str, **others: str) -> dict[str, str]:
            return {**others, **({"units": units[name]} if name in units else {})}

        groups = {"state": self.states, "control": self.controls, "output": self.outputs}
        # A rated control is listed with the states too: it is the control of the document.
        variables = {
            name: ("t", values[last], attributes(name, kind=kind))
            for kind, group in groups.items()
            for name, values in group.items()
        }
        facts = ("job_id", "success", "status", "objective", "final_time")
        return xarray.Dataset(
            variables,
            coords={"t": ("t", self.t[last], attributes("t"))},
            # Attributes of NetCDF files are texts and numbers.
            attrs={
                key: int(self[key]) if isinstance(self[key], bool) else self[key]
                for key in facts
                if self[key] is not None
            },
        )

    def plot(self, title: str = "") -> Figure:
        """The picture of the result as a matplotlib figure, of no global state: ``.savefig("slew.pdf")``."""
        from solvers.output.plot import draw

        return draw(self, title)
