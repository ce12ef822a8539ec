"""The plant: what is really flown, seen as the simple model sees it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY, Backend
from solvers.expressions import parse
from solvers.models import LIBRARY, View
from solvers.piecewise.equations import Equations
from solvers.problem import OptimalControlProblem
from solvers.spec import LibraryReference, ProblemSpec, Value
from solvers.spec import Plant as PlantSpec

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Plant:
    """The equations that are flown, and the view of them as states of the problem."""

    problem: OptimalControlProblem
    equations: Equations
    view: View

    @classmethod
    def of(cls, spec: ProblemSpec, plant: PlantSpec | None, problem: OptimalControlProblem) -> Plant:
        """The plant of a document; without one the problem's own model."""
        model = spec.submitted_model if plant is None else plant.model
        equations = Equations.of(model)
        if plant is None:
            return cls(problem, equations, _same(problem.states, equations.states))
        view = _same(problem.states, equations.states)
        simple = spec.submitted_model
        if isinstance(model, LibraryReference) and isinstance(simple, LibraryReference):
            view = LIBRARY[model.name].views.get(simple.name, view)
        return cls(problem, equations, _spoken(plant.observe, plant.start, view))

    def begin(self, simple: Vector, t: float) -> Vector:
        """The plant's states for those of the simple model at a time; not finite where there are none."""
        values = {**dict(zip(self.problem.states, simple.tolist(), strict=True)), "t": t}
        with np.errstate(all="ignore"):
            started = self.view.start(
                {**self.problem.parameters, **self.equations.parameters, **values}, NUMPY.functions
            )
        return np.array([float(started[name]) for name in self.equations.states])

    def observe(self, states: Sequence[Any], t: Any, backend: Backend) -> list[Any]:
        """The problem's states, one value each, for the plant's at a time; angles are not unwound."""
        values = {**dict(zip(self.equations.states, states, strict=True)), "t": t}
        seen = self.view.observe({**self.equations.parameters, **values}, backend.functions)
        return [seen[name] for name in self.problem.states]

    def ordered(self, controls: Sequence[Any]) -> list[Any]:
        """The problem's controls in the order of the plant's."""
        by_name = dict(zip(self.problem.controls, controls, strict=True))
        return [by_name[name] for name in self.equations.controls]


def _same(simple: tuple[str, ...], plant: tuple[str, ...]) -> View:
    """The view of a plant whose states have the names of the simple model's."""
    return View(
        lambda values, _: {name: values[name] for name in simple if name in values},
        lambda values, _: {name: values[name] for name in plant if name in values},
        {},
    )


def _spoken(observe: Mapping[str, Value], start: Mapping[str, Value], otherwise: View) -> View:
    """The expressions of a document, and another view for what they leave out."""

    def spoken(
        table: Mapping[str, Value], rest: Callable[..., dict[str, Any]]
    ) -> Callable[..., dict[str, Any]]:
        def see(values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> dict[str, Any]:
            given = {name: parse(text).evaluate(values, functions) for name, text in table.items()}
            return rest(values, functions) | given

        return see

    periods = {name: period for name, period in otherwise.periods.items() if name not in observe}
    return View(spoken(observe, otherwise.observe), spoken(start, otherwise.start), periods)
