"""A whole job document, written by keywords."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from typing import TYPE_CHECKING, Any

from solvers.builders.plain import plain
from solvers.errors import DocumentError, Fault

if TYPE_CHECKING:
    from solvers.spec import JobSpec

MINIMUM_TIME: Mapping[str, str] = {"terminal": "tf"}
"""The objective of getting there soonest."""

# Of a job rather than of its problem.
_JOB = (
    "name",
    "notes",
    "tags",
    "metadata",
    "method",
    "options",
    "output",
    "priority",
    "warm_start",
    "reuse",
    "deadline_seconds",
    "webhook",
)
_ENDS = "initial_state", "final_state"


@dataclass(frozen=True)
class Problem:
    """An optimal-control problem and how it is to be solved; the keys are those of the job document.

        slew = Problem(
            mechanical(mass=[[1565.0]], input=[[1.0]], coordinates=["theta"], controls=["T"]),
            final_time=(1, 100),
            initial_state={"*": 0},
            final_state={"theta": "30*deg", "theta_dot": 0},
            bounds={"T": (-5, 5)},
            objective=MINIMUM_TIME,
        )
        result = client.solve(slew)

    Values are numbers or expressions, as text or of SymPy; bounds are ``(lower, upper)`` with ``None`` or an
    infinity for none; arrays of NumPy may stand for lists. ``initial_state`` and ``final_state`` take arrays
    in the order of the model's states too. ``method`` may be a name alone. What a key means is told by the
    document's own description (``GET /openapi.json``).
    """

    model: Mapping[str, Any]
    _: KW_ONLY
    final_time: Any
    initial_state: Mapping[str, Any] | Sequence[Any]
    objective: Mapping[str, Any]
    initial_time: Any = None
    final_state: Mapping[str, Any] | Sequence[Any] | None = None
    final_attitude: Sequence[Any] | None = None
    bounds: Mapping[str, Any] | None = None
    control_rates: Mapping[str, Any] | None = None
    initial_control: Mapping[str, Any] | None = None
    final_control: Mapping[str, Any] | None = None
    path_constraints: Sequence[Mapping[str, Any]] | None = None
    boundary_constraints: Sequence[Mapping[str, Any]] | None = None
    integrals: Sequence[Mapping[str, Any]] | None = None
    design: Mapping[str, Any] | None = None
    outputs: Sequence[Mapping[str, Any]] | None = None
    data: Mapping[str, Any] | None = None
    units: Mapping[str, str] | None = None
    scenarios: Mapping[str, Any] | None = None
    guess: Mapping[str, Any] | None = None
    phases: Sequence[Mapping[str, Any]] | None = None
    links: Sequence[Mapping[str, Any]] | None = None
    name: str | None = None
    notes: str | None = None
    tags: Sequence[str] | None = None
    metadata: Mapping[str, Any] | None = None
    method: str | Mapping[str, Any] | None = None
    options: Mapping[str, Any] | None = None
    output: Mapping[str, Any] | None = None
    priority: str | None = None
    warm_start: str | None = None
    reuse: bool | None = None
    deadline_seconds: float | None = None
    webhook: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """The job document, of JSON types; what was not given is left out.

        Raises DocumentError for what has no place in a document, such as NaN.
        """
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        given = {key: value for key, value in given.items() if value is not None}
        if isinstance(self.method, str):
            given["method"] = {"name": self.method}
        job = {key: plain(given.pop(key), f"/{key}") for key in _JOB if key in given}
        problem = {key: plain(value, f"/problem/{key}") for key, value in given.items()}
        for key in _ENDS:
            if isinstance(problem.get(key), list):
                problem[key] = self._by_name(problem[key], f"/problem/{key}")
        return {"schema": 1, **job, "problem": problem}

    def _by_name(self, values: list[Any], pointer: str) -> dict[str, Any]:
        """Values in the order of the model's states, by their names."""
        from solvers.spec.scope import read_scope

        states = read_scope({"problem": {"model": plain(self.model)}}).states
        if len(states) != len(values):
            raise DocumentError(
                [Fault(pointer, f"one value for each of {len(states)} states, not {len(values)}")]
            )
        return dict(zip(states, values, strict=True))

    def check(self) -> JobSpec:
        """The document as the service checks it, here and now. Raises DocumentError with every mistake."""
        from solvers.spec import check_document

        return check_document(self.to_dict())
