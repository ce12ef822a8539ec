"""The solar array against momentum from positions, its closed structure, and its exact optima."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import root

from solvers.backends import NUMPY
from solvers.catalogue import load_case
from solvers.formulation.stated import stated_problem
from solvers.problem import OptimalControlProblem
from solvers.solve import solve
from solvers.spec import check_document

Vector = NDArray[np.float64]

OPTIMA = {"1": 4.4433674699728, "2": 9.359836283076, "2neg": 8.124095534911}
# The multiplier of phi1 and the controls at the start, of a shooting solve by another program.
EXTREMALS = {
    "1": (0.3477993085, [0.3426321813, 0.6078545061, 0.6338687417]),
    "2": (-7.4828188647, [-1.1095956720, 0.7736038639, 0.2056739240]),
    "2neg": (5.7001043602, [1.0709716797, -0.1930017530, 0.6637688540]),
}


@pytest.fixture(scope="module")
def problem() -> OptimalControlProblem:
    return stated_problem(check_document(load_case("solar_array_1")).problem)


def turning(problem: OptimalControlProblem, hinges: Vector) -> Vector:
    """b(th), with phi1' = b . u, for hinge angles (K, 3): (K, 3)."""
    angles, rates = np.repeat(hinges, 3, axis=0).T, np.tile(np.eye(3), (len(hinges), 1)).T
    x = [np.zeros(angles.shape[1]), *angles]
    return np.reshape(problem.rate(x, list(rates), 0.0, problem.parameters, NUMPY)[0], hinges.shape)


@pytest.mark.parametrize(
    ("hinges", "expected"),
    [
        ((0, 0, 0), (0.052128735, -0.043237212, 0.020223857)),
        ((np.pi / 2, np.pi, np.pi), (0.544084650, -0.377640726, 0.109123457)),
        ((0.3, 0.5, 0.7), (0.189024073, -0.138108223, 0.056960970)),
        ((1, 2, 2.5), (0.498482085, -0.359023562, 0.112332854)),
    ],
)
def test_rate_of_the_attitude(
    problem: OptimalControlProblem, hinges: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(turning(problem, np.array([hinges]))[0], expected, atol=5e-10)


def test_angular_momentum_from_positions_stays_zero(problem: OptimalControlProblem) -> None:
    """Centres of mass as points in the plane, their velocities by the chain rule: r x m r' + J psi' = 0."""
    masses, own = np.array([200.0, 5, 10, 10]), np.array([32.2, 5 * 0.5**2 / 12, 10 / 12, 10 / 12])
    arms = np.array([[0, 0, 0, 0], [0.5, 0.25, 0, 0], [0.5, 0.5, 0.5, 0], [0.5, 0.5, 1, 0.5]])
    random = np.random.default_rng(7)
    for _ in range(50):
        th, u, phi = random.uniform(-3, 3, 3), random.normal(size=3), random.uniform(-3, 3)
        turn = turning(problem, th[None])[0] @ u
        psi = phi + np.array(
            [0, np.pi / 2 - th[0], -np.pi / 2 - th[0] + th[1], np.pi / 2 - th[0] + th[1] - th[2]]
        )
        spin = turn + np.array([0, -u[0], -u[0] + u[1], -u[0] + u[1] - u[2]])
        r = arms @ np.column_stack([np.cos(psi), np.sin(psi)])
        v = arms @ (np.column_stack([-np.sin(psi), np.cos(psi)]) * spin[:, None])
        r, v = r - masses @ r / masses.sum(), v - masses @ v / masses.sum()
        momentum = own @ spin + masses @ (r[:, 0] * v[:, 1] - r[:, 1] * v[:, 0])
        assert abs(momentum) <= 1e-12 * (own @ np.abs(spin) + 1)


def test_a_mass_that_is_overridden_enters_the_couplings() -> None:
    document = load_case("solar_array_1")
    document["problem"]["model"]["parameters"] = {"m1": 1e9}
    heavy = stated_problem(check_document(document).problem)
    assert heavy.parameters["G44"] == pytest.approx(10 / 4, rel=1e-6)  # no recoil of the spacecraft


@pytest.mark.parametrize("name", OPTIMA)
def test_reference_is_an_extremal(problem: OptimalControlProblem, name: str) -> None:
    """Shoot 2 u' = p (Jb' - Jb) u, |u| constant, from the table's start: the target is met, J = 5 |u|^2."""
    case = load_case(f"solar_array_{name}")
    target = stated_problem(check_document(case).problem)

    def rate(t: float, y: Vector, p: float) -> Vector:
        th, u = y[1:4], y[4:]
        step = 1e-5 * np.eye(3)
        around = turning(problem, np.vstack([th + step, th - step, th]))
        slopes = (around[:3] - around[3:6]).T / 2e-5
        return np.concatenate([[around[6] @ u], u, p / 2 * (slopes.T - slopes) @ u])

    def miss(unknowns: Vector) -> Vector:
        start = np.concatenate([np.zeros(4), unknowns[1:]])
        end = solve_ivp(rate, (0, 5), start, args=(unknowns[0],), rtol=1e-8, atol=1e-10).y[:4, -1]
        return end - np.array(target.final_state)[:, 0]

    p, u = EXTREMALS[name]
    found = root(miss, [p, *u], tol=1e-8)
    assert found.success
    assert case["reference"]["objective"] == pytest.approx(5 * found.x[1:] @ found.x[1:], rel=1e-7)
    assert case["reference"]["objective"] == OPTIMA[name]


@pytest.mark.parametrize("name", OPTIMA)
@pytest.mark.parametrize(
    "method", [{"name": "gpm", "nodes": 30}, {"name": "hermite_simpson", "intervals": 160}], ids=str
)
def test_exact_optimum(name: str, method: dict[str, Any]) -> None:
    document = load_case(f"solar_array_{name}") | {"method": method, "options": {"tolerance": 1e-10}}
    solution = solve(check_document(document))
    assert solution.success
    assert solution.objective == pytest.approx(OPTIMA[name], rel=1e-8)
    errors = [report.terminal_error for report in solution.verification.states.values()]
    assert max(error if error is not None else math.inf for error in errors) <= 1e-9


@pytest.mark.parametrize("name", OPTIMA)
def test_exact_optimum_by_wavelets(name: str) -> None:
    document = load_case(f"solar_array_{name}") | {"method": {"name": "swcm", "J": 5}}
    solution = solve(check_document(document))
    assert solution.success
    assert solution.objective == pytest.approx(OPTIMA[name], rel=1e-7)
