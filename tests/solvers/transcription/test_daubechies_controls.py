"""Optima inside a Daubechies basis, against another program's by quadrature with 1,280 cells and more."""

from __future__ import annotations

import runpy
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solvers.backends import NUMPY
from solvers.bases.daubechies import DaubechiesBasis
from solvers.catalogue import load_case
from solvers.coefficients import encode
from solvers.formulation.stated import stated_problem
from solvers.optimizers.outcome import Limits
from solvers.progress import SilentProgress
from solvers.session import Session
from solvers.solved import Solved
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.trajectory import Trajectory
from solvers.transcription.daubechies_controls import DaubechiesControls

OPTIMA = runpy.run_path(str(Path(__file__).parents[3] / "benchmarks" / "solar_array_optima.py"))["EXACT"]


def solved(document: dict[str, Any], basis: DaubechiesBasis, level: int) -> Solved:
    problem = stated_problem(check_document(document).problem)
    scaling = automatic_scaling(problem)
    limits = Limits(time.monotonic() + 60, lambda: False)
    session = Session(
        problem=problem,
        scaling=scaling,
        tolerance=1e-10,
        max_iterations=500,
        limits=limits,
        progress=SilentProgress(),
    )
    answer = session.solve_parts([DaubechiesControls(problem, scaling, problem.guess, basis, level)], "solve")
    assert answer.converged
    return answer


@pytest.mark.parametrize(("case", "levels"), OPTIMA)
def test_optimum_in_the_basis(case: str, levels: int) -> None:
    answer = solved(load_case(f"solar_array_{case}"), DaubechiesBasis(2, 5, levels), 6)
    assert answer.objective == pytest.approx(OPTIMA[case, levels], rel=1e-7)


def test_the_end_is_met_by_an_independent_integration_of_the_exact_basis() -> None:
    """From the coefficients alone, on dyadic points finer than those of the solve."""
    case = load_case("solar_array_2")
    answer = solved(case, DaubechiesBasis(2, 5), 6)
    trajectory = answer.trajectory
    coefficients = np.array(
        list(encode(trajectory.basis, trajectory.states, trajectory.controls)["controls"].values())
    )
    assert answer.objective == pytest.approx(float(np.sum(coefficients**2)), rel=1e-12)
    basis, problem = DaubechiesBasis(2, 5), stated_problem(check_document(case).problem)
    hinges = 5 * coefficients @ basis.integrals(9)
    np.testing.assert_allclose(hinges[:, -1], [np.pi / 2, np.pi, np.pi], atol=1e-9)
    middles = (hinges[:, 1:] + hinges[:, :-1]) / 2
    turns = problem.rate([0.0, *middles], list(np.diff(hinges)), 0.0, problem.parameters, NUMPY)[0]
    assert np.sum(turns) == pytest.approx(np.pi / 4, abs=1e-5)  # straight chords on 2,560 cells


def test_the_curves_come_back_from_their_coefficients() -> None:
    answer = solved(load_case("solar_array_2"), DaubechiesBasis(2, 5, 1), 4).trajectory
    coefficients = encode(answer.basis, answer.states, answer.controls)
    nodes = answer.sample(answer.time(answer.nodes))
    stored = {"coefficients": coefficients, "nodes": nodes, "trajectory": nodes}
    read = Trajectory.from_result(stored)
    tau = np.random.default_rng(3).random(100)
    np.testing.assert_array_equal(read.states_at(tau), answer.states_at(tau))
    np.testing.assert_array_equal(read.controls_at(tau), answer.controls_at(tau))
    assert {
        "wavelet": "db2",
        "boundary": "periodic",
        "scaling_functions": 5,
        "wavelet_levels": 1,
    }.items() <= (coefficients["basis"].items())


def test_bounds_hold_along_the_control_and_the_final_time_is_free(rigid_body: dict[str, Any]) -> None:
    """Minimum time with |u| <= 1: the basis cannot jump, so it takes longer than 2, less the finer it is."""
    times = []
    for levels in (0, 1, 2):
        answer = solved(rigid_body, DaubechiesBasis(2, 6, levels, periodic=False), 5)
        trajectory = answer.trajectory
        assert np.max(np.abs(trajectory.controls["u"](trajectory.nodes))) <= 1.0 + 1e-9
        flown = solve_ivp(
            lambda t, x, flown=trajectory: [x[1], float(flown.controls["u"](flown.tau(np.array([t])))[0])],
            (0, trajectory.tf),
            [0, 0],
            max_step=trajectory.tf / 200,
            rtol=1e-9,
        )
        np.testing.assert_allclose(flown.y[:, -1], [1, 0], atol=1e-4)
        times.append(trajectory.tf)
    assert 2.0 < times[2] < times[1] < times[0] < 2.6
