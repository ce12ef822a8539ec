"""Newton's method on programs that leave nothing to choose, against closed forms and IPOPT."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from solvers.catalogue import load_case
from solvers.curves import LinearCurve
from solvers.formulation.stated import stated_problem
from solvers.optimizers.ipopt import Ipopt
from solvers.optimizers.newton import Newton
from solvers.optimizers.outcome import Limits, Outcome
from solvers.progress import SilentProgress
from solvers.refine.arcs import Arcs
from solvers.refine.structure import Structure
from solvers.session import Part, Session
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.transcription.multi_arc import MultiArc

LIMITS = Limits(math.inf, lambda: False)


def arcs(document: dict[str, Any], edges: list[float], levels: list[float], tf: float) -> MultiArc:
    """The multi-arc problem of a document, from straight lines between its ends."""
    problem = stated_problem(check_document(document).problem)
    part = Part(problem, automatic_scaling(problem))
    tau, (control,) = np.array([0.0, 1.0]), problem.controls
    states = {
        name: LinearCurve(tau, np.array([begin[0], end[0]]))
        for name, begin, end in zip(problem.states, problem.initial_state, problem.final_state, strict=True)
    }
    start = Trajectory(0.0, tf, states, {control: LinearCurve(tau, 0 * tau)}, "linear", {}, tau, tau)
    structure = Structure(np.array(edges), {control: np.array(levels)})
    return Arcs.first(part, structure, start).program(part)


def by_newton(transcription: MultiArc, limits: Limits = LIMITS) -> Outcome:
    program = transcription.program()
    return Newton(program, tolerance=1e-12).minimise(program, limits, lambda iterate: None)


def test_a_body_at_rest_is_moved_in_the_time_of_the_closed_form(rigid_body: dict[str, Any]) -> None:
    transcription = arcs(rigid_body, [0, 0.4, 1], [1, -1], 3.0)
    outcome = by_newton(transcription)
    trajectory = transcription.trajectory(outcome.unknowns)
    assert outcome.status is SolveStatus.CONVERGED
    assert trajectory.tf == pytest.approx(2.0, abs=1e-13)
    assert transcription.edges_of(trajectory)[1] == pytest.approx(0.5, abs=1e-13)
    # With H = 1 + lambda_x v + lambda_v u = 0 and lambda_v = 0 at the switch, where v = 1.
    costates = transcription.costates(trajectory, outcome.row_multipliers)
    times = trajectory.time(trajectory.nodes)
    np.testing.assert_allclose(costates, [-np.ones_like(times), times - 1.0], atol=1e-12)


def test_multipliers_are_those_of_ipopt() -> None:
    document = load_case("two_mass_spring")
    transcription = arcs(document, [0, 0.25, 0.5, 0.75, 1], [1, -1, 1, -1], 4.0)
    program = transcription.program()
    newton = by_newton(transcription)
    ipopt = Ipopt(program, tolerance=1e-12, max_iterations=200, warm=True, barrier=1e-13).minimise(
        program, LIMITS, lambda iterate: None
    )
    assert ipopt.status is newton.status is SolveStatus.CONVERGED
    assert newton.objective == pytest.approx(ipopt.objective, abs=1e-11)
    assert newton.objective * transcription.objective_scale == pytest.approx(4.217866510, abs=1e-9)
    for name in ("unknowns", "row_multipliers", "bound_multipliers", "number_slopes"):
        mine, theirs = getattr(newton, name), getattr(ipopt, name)
        np.testing.assert_allclose(mine, theirs, atol=1e-9 * max(1.0, np.abs(theirs).max()), err_msg=name)


def test_what_violates_an_inequality_is_no_answer_and_is_left_to_ipopt(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"]["bounds"]["x_dot"] = [None, 0.5]
    transcription = arcs(rigid_body, [0, 0.4, 1], [1, -1], 3.0)
    assert by_newton(transcription).status is SolveStatus.DIVERGED
    problem, scaling = transcription.problem, transcription.scaling
    session = Session(
        problem=problem,
        scaling=scaling,
        tolerance=1e-12,
        max_iterations=100,
        limits=LIMITS,
        progress=SilentProgress(),
    )
    outcome = session.optimise(transcription, "arcs", warm=True, decided=True)
    assert outcome.solver == "ipopt"
    assert outcome.status is not SolveStatus.CONVERGED


def test_where_something_is_left_to_choose_it_says_so(rigid_body: dict[str, Any]) -> None:
    for levels in ([1, np.nan], [1, -1, 1]):
        edges = np.linspace(0.0, 1.0, len(levels) + 1).tolist()
        assert by_newton(arcs(rigid_body, edges, levels, 2.0)).status is SolveStatus.DIVERGED


@pytest.mark.parametrize(
    ("limits", "status"),
    [
        (Limits(math.inf, lambda: True), SolveStatus.CANCELLED),
        (Limits(-math.inf, lambda: False), SolveStatus.TIME_LIMIT),
    ],
)
def test_it_stops_when_it_is_asked_to(
    rigid_body: dict[str, Any], limits: Limits, status: SolveStatus
) -> None:
    assert by_newton(arcs(rigid_body, [0, 0.4, 1], [1, -1], 3.0), limits).status is status
