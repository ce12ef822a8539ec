"""The attitude model against equations written anew, conserved quantities, other models, published slews."""

from __future__ import annotations

import copy
import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar, root
from scipy.spatial.transform import Rotation

from solvers.backends import NUMPY
from solvers.catalogue import load_case
from solvers.errors import DocumentError
from solvers.formulation.stated import stated_problem
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document

Vector = NDArray[np.float64]

INERTIA = np.array([[5.0, 0.4, -0.3], [0.4, 4.0, 0.2], [-0.3, 0.2, 3.0]])
COUPLING = np.array([[0.5, 0.1, -0.2], [0.3, -0.7, 0.4]])
PARAMETERS = {
    **{f"J{i + 1}{j + 1}": INERTIA[i, j] for i in range(3) for j in range(i, 3)},
    **{f"d{k + 1}{i + 1}": COUPLING[k, i] for k in range(2) for i in range(3)},
    **{"f1": 0.3, "f2": 0.5, "z1": 0, "z2": 0},
}
TORQUES = ("T1", "T2", "T3")
REST = {"w1": 0, "w2": 0, "w3": 0}


def document(modes: int = 2, actuators: str = "torque", **parameters: float) -> dict[str, Any]:
    """Least energy, from rest to rest, a turn by 1 rad about (1, 2, 2)/3 in 4 s."""
    half = math.sin(0.5) / 3
    model = {"kind": "library", "name": "attitude_flexible", "parameters": parameters}
    return {
        "problem": {
            "model": model | {"options": {"modes": modes, "actuators": actuators}},
            "final_time": 4,
            "initial_state": {"*": 0, "q4": 1},
            "final_state": dict(REST),
            "final_attitude": [half, 2 * half, 2 * half, math.cos(0.5)],
            "objective": {"running": "T1^2 + T2^2 + T3^2"},
        },
        "method": {"name": "gpm", "nodes": 24},
    }


def answer(given: dict[str, Any]) -> Any:
    """The Solution, of phases where there are some."""
    return solve(check_document(given))


def rates_of(given: dict[str, Any]) -> Any:
    problem = stated_problem(check_document(given).problem)

    def rate(t: float, x: Vector, torque: Vector) -> Vector:
        return np.array(problem.rate(x, torque, t, problem.parameters, NUMPY), np.float64)

    return rate


def test_rates_are_those_of_the_coupled_equations_solved_as_they_stand() -> None:
    damped = {**PARAMETERS, "z1": 0.02, "z2": 0.1}
    rate = rates_of(document(2, "wheels", **damped))
    rng = np.random.default_rng(3)
    q, w, eta, speed, h, torque = (rng.normal(size=size) for size in (4, 3, 2, 2, 3, 3))
    found = rate(0.0, np.concatenate([q, w, eta, speed, h]), torque)
    omega = 2 * np.pi * np.array([0.3, 0.5])
    momentum = INERTIA @ w + COUPLING.T @ speed + h
    mass = np.block([[INERTIA, COUPLING.T], [COUPLING, np.eye(2)]])
    springs = 2 * np.array([0.02, 0.1]) * omega * speed + omega**2 * eta
    wanted = np.linalg.solve(mass, np.concatenate([torque - np.cross(w, momentum), -springs]))
    turn = np.append(q[3] * w + np.cross(q[:3], w), -q[:3] @ w) / 2
    np.testing.assert_allclose(found, [*turn, *wanted[:3], *speed, *wanted[3:], *-torque], rtol=1e-12)


@pytest.mark.parametrize("actuators", ["torque", "wheels"])
def test_momentum_and_energy_of_an_independent_integration(actuators: str) -> None:
    """Wheels leave the momentum of the whole as it is; torques from outside do work T w."""
    wheels = actuators == "wheels"
    rate = rates_of(document(2, actuators, **PARAMETERS))
    start = [0, 0, 0, 1, 0.1, -0.2, 0.3, 0.05, -0.02, 0.01, 0.03, *([0.2, 0.1, -0.4] if wheels else [])]

    def torque(t: float) -> Vector:
        return np.array([np.sin(t), 0.5, np.cos(2 * t)])

    def with_work(t: float, y: Vector) -> Vector:
        x = y[:-1]
        return np.append(rate(t, x, torque(t)), torque(t) @ x[4:7])

    flight = solve_ivp(
        with_work, (0, 8), [*start, 0.0], method="DOP853", rtol=1e-12, atol=1e-13, max_step=0.5
    )
    momenta, energies = [], []
    for y in flight.y.T:
        q, w, eta, speed, h = y[:4], y[4:7], y[7:9], y[9:11], y[11:14] if wheels else np.zeros(3)
        momenta.append(Rotation.from_quat(q).apply(INERTIA @ w + COUPLING.T @ speed + h))
        omega = 2 * np.pi * np.array([0.3, 0.5])
        energies.append(
            w @ INERTIA @ w / 2 + w @ COUPLING.T @ speed + speed @ speed / 2 + omega**2 @ eta**2 / 2 - y[-1]
        )
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(energies, energies[0], atol=1e-9)
    moved = np.max(np.abs(np.array(momenta) - momenta[0]))
    assert moved < 1e-9 if wheels else moved > 1.0


def test_modes_that_are_not_coupled_change_nothing() -> None:
    free = {f"d{k}{i}": 0.0 for k in (1, 2) for i in (1, 2, 3)}
    inertia = {key: value for key, value in PARAMETERS.items() if key.startswith("J")}
    rigid, flexible = answer(document(0, **inertia)), answer(document(2, **inertia, **free))
    assert rigid.success
    assert flexible.success
    assert flexible.objective == pytest.approx(rigid.objective, rel=1e-9)


def test_a_turn_about_one_axis_is_that_of_the_modal_model() -> None:
    """J = 3, one mode of 0.4 Hz with coupling 0.9, from rest to rest with the mode at rest."""
    given = document(1, J33=3, f1=0.4, z1=0.01, d11=0, d12=0, d13=0.9)
    given["problem"] |= {
        "final_attitude": [0, 0, "sin(0.5)", "cos(0.5)"],
        "final_state": {**REST, "eta1": 0, "eta1_dot": 0},
    }
    attitude = answer(given)
    modal = answer(
        {
            "problem": {
                "model": {
                    "kind": "modal", "axes": ["theta"], "inertia": [[3]], "controls": ["T"], "input": [[1]],
                    "modes": [{"name": "p", "frequency_hz": 0.4, "damping": 0.01, "coupling": [0.9]}],
                    "mode_basis": "constrained",
                },
                "final_time": 4,
                "initial_state": {"*": 0},
                "final_state": {"theta": 1, "*": 0},
                "objective": {"running": "T^2"},
            },
            "method": {"name": "gpm", "nodes": 24},
        }
    )  # fmt: skip
    assert attitude.success
    assert modal.success
    assert attitude.objective == pytest.approx(modal.objective, rel=1e-8)
    tau = np.linspace(0, 1, 9)
    turned = 2 * np.arctan2(attitude.trajectory.states["q3"](tau), attitude.trajectory.states["q4"](tau))
    np.testing.assert_allclose(turned, modal.trajectory.states["theta"](tau), atol=1e-7)


@pytest.mark.parametrize(("sign", "start"), [(1, -1), (-1, 1)])
def test_either_sign_of_a_quaternion_is_the_same_attitude(sign: int, start: int) -> None:
    given = document(0)
    problem = given["problem"]
    problem["final_attitude"] = [3 * sign * value for value in problem["final_attitude"]]
    problem["initial_state"]["q4"] = start
    solution = answer(given)
    assert solution.success, solution.message
    # Unit inertia, small coupling: the least energy of a turn by 1 rad about one axis is 12/4^3.
    assert solution.objective == pytest.approx(12 / 64, rel=1e-8)
    end = solution.trajectory.states_at(np.ones(1))[:4, 0]
    assert abs(np.dot(end, check_document(document(0)).problem.final_attitude or [])) == pytest.approx(1)
    assert solution.verification.terminal_error == pytest.approx(0.0, abs=1e-8)


def test_an_attitude_on_the_way_is_the_end_of_a_phase() -> None:
    """By 0.7 rad in half of the time, at a rate w that is free, then by 0.3 rad to rest.

    The least energy of a turn by a from rate w0 to w1 in T is 12 D^2/T^3 - 12 D d/T^2 + 4 d^2/T with
    D = a - w0 T, d = w1 - w0.
    """

    def energy(angle: float, before: float, after: float) -> float:
        way, change = angle - 2 * before, after - before
        return 1.5 * way**2 - 3 * way * change + 2 * change**2

    given, part = document(0), math.sin(0.35) / 3
    given["problem"]["phases"] = [
        {
            "name": "there",
            "final_time": 2,
            "final_attitude": [-part, -2 * part, -2 * part, -math.cos(0.35)],
        },
        {"name": "on"},
    ]
    solution = answer(given)
    assert solution.success, solution.message
    best = minimize_scalar(lambda w: energy(0.7, 0, w) + energy(0.3, w, 0), (0, 1), options={"xtol": 1e-14})
    assert solution.objective == pytest.approx(best.fun, rel=1e-8)
    met = solution.trajectory.parts[0].states_at(np.ones(1))[:4, 0]
    assert np.abs(met) == pytest.approx(
        [abs(value) for value in given["problem"]["phases"][0]["final_attitude"]], abs=1e-8
    )


@pytest.fixture(scope="module")
def three_axis_slew() -> Solution:
    return answer(load_case("three_axis_slew"))


def test_three_axis_slew_is_that_of_bilimoria_and_wie(three_axis_slew: Solution) -> None:
    solution = three_axis_slew
    assert solution.success, solution.message
    assert math.floor(solution.objective * 1e4) / 1e4 == 3.2430  # as it was printed
    assert solution.objective < math.sqrt(4 * math.pi)  # about the fixed axis
    assert sum(len(item["times"]) for item in solution.switching.values()) == 5
    states = solution.trajectory.states_at(np.linspace(0, 1, 101))
    np.testing.assert_allclose(np.linalg.norm(states[:4], axis=0), 1.0, atol=1e-9)
    reference = load_case("three_axis_slew")["reference"]
    assert solution.objective == pytest.approx(reference["objective"], abs=1e-9)


def test_three_axis_slew_takes_as_long_in_two_phases() -> None:
    """By these switches or their mirror image."""
    case = load_case("three_axis_slew")
    case["problem"]["phases"] = [{"name": "first", "final_time": 1.5}, {"name": "second"}]
    solution = answer(case)
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(case["reference"]["objective"], abs=1e-9)
    assert sum(len(item["times"]) for item in solution.switching.values()) == 5


def spherical(t: float, y: Vector, torque: Vector) -> Vector:
    """A body of unit inertia: q' = q (w, 0)/2, w' = T."""
    q, w = y[:4], y[4:]
    return np.concatenate([(q[3] * w + np.cross(q[:3], w)) / 2, [-q[:3] @ w / 2], torque])


def test_three_axis_slew_by_its_six_end_conditions() -> None:
    """Five switching times and the final time, six conditions: another root of other code."""
    reference = load_case("three_axis_slew")["reference"]
    order = [(time, control) for control, times in reference["switching"].items() for time in times]

    def miss(unknowns: Vector) -> Vector:
        switches = sorted(zip(unknowns[:-1], (control for _, control in order), strict=True))
        torque, x, before = np.ones(3), np.array([0, 0, 0, 1, 0, 0, 0], np.float64), 0.0
        for end, control in [*switches, (unknowns[-1], None)]:
            flight = solve_ivp(
                spherical, (before, end), x, args=(torque,), method="DOP853", rtol=1e-12, atol=1e-13
            )
            x = flight.y[:, -1]
            before = end
            if control is not None:
                torque[TORQUES.index(control)] *= -1
        return np.array([x[0], x[1], x[3], *x[4:]])

    found = root(miss, [*(time + 0.01 for time, _ in order), reference["final_time"] + 0.02], tol=1e-13)
    assert found.success
    np.testing.assert_allclose(found.x[:-1], [time for time, _ in order], atol=1e-9)
    assert found.x[-1] == pytest.approx(reference["final_time"], abs=1e-9)


def keep_out_by_hand(intervals: int) -> float:
    """The least time of the keep-out slew by Hermite-Simpson, written in CasADi alone."""
    opti = ca.Opti()
    x, u, tf = opti.variable(7, 2 * intervals + 1), opti.variable(3, 2 * intervals + 1), opti.variable()

    def rate(k: int) -> Any:
        q, w = x[:3, k], x[4:, k]
        return ca.vertcat((x[3, k] * w + ca.cross(q, w)) / 2, -ca.dot(q, w) / 2, u[:, k])

    def sensor(k: int) -> Any:
        v, axis = x[:3, k], ca.DM([1, 0, 0])
        return axis + 2 * ca.cross(v, ca.cross(v, axis) + x[3, k] * axis)

    rates, step = [rate(k) for k in range(2 * intervals + 1)], tf / intervals
    for a in range(0, 2 * intervals, 2):
        m, b = a + 1, a + 2
        opti.subject_to(x[:, m] == (x[:, a] + x[:, b]) / 2 + step / 8 * (rates[a] - rates[b]))
        opti.subject_to(x[:, b] == x[:, a] + step / 6 * (rates[a] + 4 * rates[m] + rates[b]))
        for k in (m, b)[: 1 if b == 2 * intervals else 2]:
            opti.subject_to(sensor(k)[2] <= math.sqrt(0.5))
    start = Rotation.from_euler("ZY", [-45, -45], degrees=True).as_quat()
    opti.subject_to(x[:, 0] == [*start, 0, 0, 0])
    opti.subject_to(x[4:, -1] == 0)
    opti.subject_to(sensor(-1)[0] == 0.5)
    opti.subject_to(sensor(-1)[1] >= 0)
    opti.subject_to(sensor(-1)[2] == math.sqrt(0.5))
    opti.subject_to(opti.bounded(-1, ca.vec(u), 1))
    opti.subject_to(opti.bounded(0.5, tf, 4))
    opti.set_initial(tf, 2)
    ways = Rotation.from_euler(
        "ZY", [[a, -45] for a in np.linspace(-45, 45, 2 * intervals + 1)], degrees=True
    )
    opti.set_initial(x[:4, :], ways.as_quat().T)
    opti.minimize(tf)
    opti.solver("ipopt", {"print_time": False, "expand": True, "ipopt": {"print_level": 0, "sb": "yes"}})
    return float(opti.solve().value(tf))


def test_keep_out_slew_against_a_program_written_by_hand_and_the_published_figure() -> None:
    case = load_case("keep_out_slew")
    solution = answer(case)
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(case["reference"]["objective"], abs=1e-8)
    assert solution.objective == pytest.approx(keep_out_by_hand(40), abs=2e-4)
    # By a pseudospectral method that holds bounds at its nodes: a little less.
    assert solution.objective == pytest.approx(1.9258, rel=1e-3)
    tau = np.linspace(0, 1, 401)
    height = solution.problem.outputs_at(solution.trajectory, tau)["sensor_z"]
    assert height.max() <= math.sqrt(0.5) + 1e-7


def test_mistakes_of_an_attitude_on_the_way() -> None:
    given = document()
    given["problem"]["phases"] = [
        {"name": "there", "final_attitude": [0, 0, 0, 0]},
        {"name": "back", "final_state": {"q1": 0}},
    ]
    assert refused(given, "/problem/phases/0/final_attitude", "not 0")
    given["problem"]["phases"][0]["final_attitude"] = [0, 0, 0, 1]
    assert refused(given, "/problem/phases/1/final_state/q1", "twice")
    model = {"kind": "first_order", "states": ["y"], "controls": ["u"], "dynamics": {"y": "u"}}
    given["problem"]["phases"][1] = {"name": "other", "model": model, "initial_state": {"y": 0}}
    assert refused(given, "/problem/final_attitude", "a model of its own")


MISTAKES: list[tuple[dict[str, Any], str, str]] = [
    ({"final_attitude": [0, 0, 1]}, "/problem/final_attitude", "4 values"),
    ({"final_attitude": [0, 0, 0, 0]}, "/problem/final_attitude", "not 0"),
    ({"final_attitude": [0, 0, "x", 1]}, "/problem/final_attitude/2", "unknown name"),
    ({"final_state": {"*": 0}}, "/problem/final_state/*", "twice"),
    ({"final_state": {"q1": 0}}, "/problem/final_state/q1", "twice"),
    ({"initial_state": {"*": 0, "q4": 2}}, "/problem/initial_state", "unit quaternion"),
]


@pytest.mark.parametrize(("changes", "pointer", "word"), MISTAKES)
def test_mistake(changes: dict[str, Any], pointer: str, word: str) -> None:
    given = document()
    given["problem"] |= copy.deepcopy(changes)
    assert refused(given, pointer, word)


@pytest.mark.parametrize(
    ("model", "pointer", "word"),
    [
        ({"options": {"modes": 9}}, "/problem/model/options/modes", "one of 0, 1"),
        ({"options": {"modes": True}}, "/problem/model/options/modes", "one of 0, 1"),
        ({"options": {"mods": 1}}, "/problem/model/options/mods", "did you mean 'modes'"),
        ({"parameters": {"d11": 2}}, "/problem/model/parameters", "positive definite"),
        ({"name": "rigid_body", "options": {"modes": 1}}, "/problem/model/options/modes", "unknown option"),
    ],
)
def test_mistake_of_the_model(model: dict[str, Any], pointer: str, word: str) -> None:
    given = document()
    given["problem"]["model"] |= model
    assert refused(given, pointer, word)


def test_a_model_without_attitude_has_no_final_one(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"]["final_attitude"] = [0, 0, 0, 1]
    assert refused(rigid_body, "/problem/final_attitude", "no states q1, q2, q3, q4")


def refused(given: dict[str, Any], pointer: str, word: str) -> bool:
    with pytest.raises(DocumentError) as refusal:
        check_document(given)
    return any(fault.pointer == pointer and word in fault.detail for fault in refusal.value.faults)
