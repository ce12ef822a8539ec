"""What is solved for a document: one command for several plants where it has scenarios, else its problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from solvers.expressions import named
from solvers.formulation.implied_ends import relaxed_ends, relaxed_like
from solvers.formulation.lifting import corners, lifted, nonsmooth, with_peak
from solvers.formulation.plant_objectives import (
    LEVEL,
    averaged,
    below_level,
    costs_of,
    same_objective,
    with_level,
)
from solvers.formulation.plants import Plant, PlantPart, together
from solvers.formulation.polar import in_polar
from solvers.formulation.stated import stated_problem
from solvers.formulation.time_knots import corner_warnings
from solvers.formulation.two_sided import sides_of
from solvers.problem import OptimalControlProblem
from solvers.spec import ProblemSpec, ScenarioSpec

NOMINAL = "nominal"


@dataclass(frozen=True)
class Formulation:
    """What is solved for a document: the problem of all plants, and the plants, the leading one first.

    ``simulated``: the same problem without slacks, for methods that fly expressions as they are.
    """

    problem: OptimalControlProblem
    simulated: OptimalControlProblem
    plants: tuple[Plant, ...]
    implied: tuple[str, ...] = ()
    """States whose ends follow from the others, and are held a little less tightly."""

    def as_simulated(self) -> Formulation:
        """For what solves the simulated problem: there every plant has the document's own controls."""
        plants = tuple(replace(plant, made=()) for plant in self.plants)
        return replace(self, problem=self.simulated, plants=plants)

    def warnings(self, solved: OptimalControlProblem) -> list[dict[str, str]]:
        """What was not held exactly, and why; where the objective has corners that no slack takes away.

        ``solved``: the problem of the two that gradients were taken of.
        """
        found = [nonsmooth(*corner) for corner in corners(solved)]
        return [*found, *corner_warnings(solved), *implied_warnings(self.implied)]


def implied_warnings(states: Sequence[str]) -> list[dict[str, str]]:
    """What is said of states whose ends follow from the others."""
    if not states:
        return []
    detail = (
        f"The ends of {', '.join(states)} follow from the other ends to first order; they are held"
        " as loosely as on a fixed mesh, and verification.states of each plant says how far off they are."
        " Where that is too far, give a case its final_state as an interval, or the document"
        " options.verification.terminal_error."
    )
    return [{"code": "implied_ends", "pointer": "/problem/scenarios", "detail": detail}]


def formulate(spec: ProblemSpec, tolerance: float = 0.0, like: Formulation | None = None) -> Formulation:
    """The problem of a checked document; without scenarios it has one plant, of no name.

    ``tolerance``: the relative error that is allowed of final states that follow from others
    (`JobSpec.implied_tolerance`). ``like``: what is solved for nearly the same document, whose ends that
    follow from others need not be looked for again.
    """
    if spec.scenarios is None:
        problem = stated_problem(spec)
        whole = with_peak(problem)
        smooth, pairs = in_polar(whole)
        solved = lifted(smooth, split=True)
        return Formulation(solved, whole, (Plant("", problem, made=(*pairs, *sides_of(solved))),))
    parts = [PlantPart.of(case.name, stated_problem(case.spec), case.parameters) for case in cases_of(spec)]
    whole = _chosen(together(parts), parts, spec.scenarios.choice)
    if like is None:
        problem, implied = relaxed_ends(whole, [part.problem.states for part in parts], tolerance)
    else:
        problem, implied = relaxed_like(whole, like.simulated, like.implied), [*like.implied]
    plants = tuple(part.plant.with_implied(implied, tolerance) for part in parts)
    return Formulation(lifted(problem), problem, plants, tuple(implied))


@dataclass(frozen=True)
class Case:
    """A case as a problem of its own, and the names of the parameters that it gives values to."""

    name: str
    spec: ProblemSpec
    parameters: frozenset[str]


def cases_of(spec: ProblemSpec) -> list[Case]:
    """The cases of a document with scenarios, the leading one first."""
    assert spec.scenarios is not None
    cases = [Case(NOMINAL, spec.changed(scenarios=None), frozenset())] if spec.scenarios.nominal else []
    return cases + [Case(case.name, _case_of(spec, case), _own(spec, case)) for case in spec.scenarios.cases]


def _own(spec: ProblemSpec, case: ScenarioSpec) -> frozenset[str]:
    """The parameters of a case, and those of the model that follow from them."""
    return frozenset({*case.parameters, *spec.model.depending_on(case.parameters)})


def _case_of(spec: ProblemSpec, case: ScenarioSpec) -> ProblemSpec:
    """The problem of one case as a document would say it."""
    model = spec.submitted_model
    return spec.changed(
        submitted_model=model.changed(parameters={**model.parameters, **case.parameters}),
        initial_state={**spec.initial_state, **case.initial_state},
        final_state={**spec.final_state, **case.final_state},
        bounds={**spec.bounds, **case.bounds},
        scenarios=None,
    )


def _chosen(whole: OptimalControlProblem, parts: Sequence[PlantPart], choice: str) -> OptimalControlProblem:
    """The problem with the objective that is chosen: ``nominal``, ``mean`` or ``worst``."""
    if choice == NOMINAL or same_objective(parts):
        return whole
    if choice == "mean":
        return averaged(whole, parts)
    whole = with_level(whole, parts)
    limits = [
        below_level(part.name, part.problem.terminal_cost, costs_of(part.name, [whole])) for part in parts
    ]
    return replace(whole, terminal_cost=named(LEVEL), boundary=(*whole.boundary, *limits))
