"""Everyday problems as engineers write them, without a method, against answers that come from elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, fsolve, minimize

from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document

Vector = NDArray[np.float64]


def solved(problem: dict[str, Any]) -> Solution:
    solution = solve(check_document({"problem": problem}))
    assert isinstance(solution, Solution)
    assert solution.success, solution.message
    return solution


def first_order(states: dict[str, str], controls: list[str], **parameters: float) -> dict[str, Any]:
    return {
        "kind": "first_order",
        "states": list(states),
        "controls": controls,
        "parameters": parameters,
        "dynamics": states,
    }


def test_a_crane_that_saturates_along_its_speed_limit() -> None:
    """The trolley runs at its limit until that takes all of the force, which from there stays at its bound.

    Reference: the half of the flight up to its middle, where x = 10 m and the load hangs straight; the other
    half is the same in reverse. Integrated with events; two instants are unknown.
    """
    trolley, load, rope, g, force, speed = 2000.0, 5000.0, 10.0, 9.81, 4000.0, 3.0

    def pulled(u: float, y: Vector) -> list[float]:
        _, angle, v, rate = y
        s, c = np.sin(angle), np.cos(angle)
        a = (u + load * s * (rope * rate**2 + g * c)) / (trolley + load * s**2)
        return [v, rate, a, -(a * c + g * s) / rope]

    def needed(y: Vector) -> float:  # for no acceleration of the trolley
        return float(-load * np.sin(y[1]) * (rope * y[3] ** 2 + g * np.cos(y[1])))

    def until(rates: Any, y: Vector, span: float, event: Any = None) -> tuple[float, Vector]:
        if event is not None:
            event.terminal = True
        flown = solve_ivp(rates, (0.0, span), y, method="DOP853", rtol=1e-12, atol=1e-13, events=event)
        return flown.t[-1], flown.y[:, -1]

    first, at_limit = until(lambda _, y: pulled(force, y), np.zeros(4), 20.0, lambda _, y: y[2] - speed)
    along = lambda _, y: [speed, y[3], 0.0, -g * np.sin(y[1]) / rope]  # noqa: E731
    second, saturated = until(along, at_limit, 20.0, lambda _, y: needed(y) - force)

    def middle(durations: Vector) -> list[float]:
        _, slowed = until(lambda _, y: pulled(force, y), saturated, durations[0])
        _, end = until(lambda _, y: pulled(-force, y), slowed, durations[1])
        return [end[0] - 10.0, end[1]]

    rest = fsolve(middle, [0.86, 0.56], xtol=1e-12)
    model = {
        "kind": "mechanical",
        "coordinates": ["x", "th"],
        "controls": ["F"],
        "parameters": {"M": trolley, "m": load, "l": rope, "g": g},
        "mass": [["M+m", "m*l*cos(th)"], ["m*l*cos(th)", "m*l^2"]],
        "force": ["m*l*sin(th)*th_dot^2", "-m*g*l*sin(th)"],
        "input": [[1], [0]],
    }
    solution = solved(
        {
            "model": model,
            "final_time": [1, 100],
            "initial_state": {"*": 0},
            "final_state": {"x": 20, "th": 0, "x_dot": 0, "th_dot": 0},
            "bounds": {"F": [-force, force], "x_dot": [-speed, speed], "th": ["-8*deg", "8*deg"]},
            "objective": {"terminal": "tf"},
        }
    )
    half = first + second + rest.sum()
    assert solution.objective == pytest.approx(2.0 * half, abs=1e-8)
    assert solution.switching["F"]["times"][:4] == pytest.approx(
        [first, first + second, first + second + rest[0], half], abs=1e-6
    )


def test_a_drone_that_turns_along_singular_arcs() -> None:
    """Full thrust turned at most at 10 rad/s, 6 m sideways: the bilinear tangent law between fast turns.

    Reference: about the middle of the flight s = 0 everything is odd or even, and along singular arcs
    tan(theta) = -k s (Hehn, Ritz, D'Andrea, Autonomous Robots 33, 2012), so that k and t_f are unknown.
    """

    def angle(s: float, k: float, tf: float) -> float:
        law = np.arctan(-k * s)
        first, fast = 10.0 * (s + 0.5 * tf), -10.0 * s
        return float(min(first, law if abs(law) <= abs(fast) else fast))

    def misses(unknown: Vector) -> list[float]:
        k, tf = unknown
        kinks = [
            brentq(lambda s: np.arctan(-k * s) - 10.0 * (s + 0.5 * tf), -0.5 * tf, -0.2),
            brentq(lambda s: np.arctan(-k * s) + 10.0 * s, -0.2, -1e-3),
        ]
        arcs = list(zip([-0.5 * tf, *kinks], [*kinks, 0.0], strict=True))
        up = sum(quad(lambda s: np.cos(angle(s, k, tf)), *arc, epsabs=1e-13)[0] for arc in arcs)
        # x at the middle is half of the way: the integral of (time left) times acceleration.
        across = sum(quad(lambda s: -s * np.sin(angle(s, k, tf)), *arc, epsabs=1e-13)[0] for arc in arcs)
        return [20.0 * up - 0.5 * 9.81 * tf, 20.0 * across - 3.0]

    _, tf = fsolve(misses, [12.0, 1.23], xtol=1e-13)
    states = {"x": "vx", "z": "vz", "vx": "T*sin(th)", "vz": "T*cos(th) - 9.81", "th": "w"}
    solution = solved(
        {
            "model": first_order(states, ["T", "w"]),
            "final_time": [0.2, 20],
            "initial_state": {"*": 0},
            "final_state": {"x": 6, "z": 0, "vx": 0, "vz": 0, "th": 0},
            "bounds": {"T": [1, 20], "w": [-10, 10]},
            "objective": {"terminal": "tf"},
        }
    )
    assert solution.objective == pytest.approx(tf, abs=1e-8)
    assert solution.switching["w"]["arcs"] == ["upper", "interior", "lower", "interior", "upper"]


def test_an_orbit_in_metres_is_judged_like_one_in_units_of_its_own() -> None:
    """The largest circular orbit after 193 days of low thrust: 1.525 times the first one.

    Moyer and Pinkham 1964; Bryson and Ho 1975, section 2.5. The condition r v^2 / mu = 1 is a small
    difference of large numbers, and nothing but zeros is said of the radial velocity and of the angle.
    """
    mu, r0 = 1.327124e20, 1.495979e11
    acceleration, speed = mu / r0**2, np.sqrt(mu / r0)
    duration, mass = 3.32 * r0 / speed, 4536.0
    states = {
        "r": "vr",
        "vr": "vt^2/r - mu/r^2 + F*sin(a)/m",
        "vt": "-vr*vt/r + F*cos(a)/m",
        "m": "-rate",
    }
    thrust, rate = 0.1405 * mass * acceleration, 0.0749 * mass * speed / r0
    solution = solved(
        {
            "model": first_order(states, ["a"], mu=mu, F=thrust, rate=rate),
            "final_time": duration,
            "initial_state": {"r": r0, "vr": 0, "vt": speed, "m": mass},
            "final_state": {"vr": 0},
            "boundary_constraints": [{"name": "circular", "expression": "r_f*vt_f^2/mu - 1", "bounds": 0}],
            "objective": {"terminal": f"-r_f/{r0}"},
        }
    )
    assert solution.objective == pytest.approx(-1.525, abs=1e-3)


def test_a_landing_by_a_thrust_vector_that_burns_by_its_length() -> None:
    """Nothing, then full thrust by the linear tangent law: the least fuel to the ground at rest.

    Reference: over the instants and the law by SciPy, integrated by itself (Lawden, Optimal Trajectories for
    Space Navigation, 1963, chapter 5).
    """
    g, c, most, start = 1.62, 3000.0, 6000.0, np.array([-5000.0, 3000.0, 100.0, -20.0, 1500.0])

    def end(unknown: Vector) -> Vector:
        coast, burn, turn, right, up = unknown * [30.0, 40.0, 2.0, 0.01, 0.01]
        fallen = start + np.array([start[2], start[3] - 0.5 * g * coast, 0.0, -g, 0.0]) * coast
        law = np.array([np.cos(turn), np.sin(turn)]), np.array([right, up])

        def rates(t: float, y: Vector) -> list[float]:
            pushed = law[0] + law[1] * t
            pushed *= most / np.linalg.norm(pushed)
            return [y[2], y[3], pushed[0] / y[4], pushed[1] / y[4] - g, -most / c]

        flown = solve_ivp(rates, (0.0, burn), fallen, method="DOP853", rtol=1e-9, atol=1e-6)
        return np.asarray(flown.y[:, -1])

    best = minimize(
        lambda unknown: unknown[1],
        [1.0, 1.0, 1.2, 0.5, 0.5],
        constraints={"type": "eq", "fun": lambda unknown: end(unknown)[:4] / [1e3, 1e3, 10.0, 10.0]},
        method="SLSQP",
        options={"ftol": 1e-13, "maxiter": 200},
    )
    assert best.success, best.message
    rates = {"x": "vx", "y": "vy", "vx": "Tx/m", "vy": "Ty/m - g", "m": "-sqrt(Tx^2 + Ty^2 + 1e-9)/c"}
    solution = solved(
        {
            "model": first_order(rates, ["Tx", "Ty"], g=g, c=c),
            "final_time": [10, 400],
            "initial_state": dict(zip(rates, start.tolist(), strict=True)),
            "final_state": {"x": 0, "y": 0, "vx": 0, "vy": 0},
            "bounds": {"y": [0, None], "m": [500, 1500]},
            "path_constraints": [{"name": "thrust", "expression": "Tx^2 + Ty^2", "bounds": [None, "6000^2"]}],
            "objective": {"terminal": "-m_f"},
        }
    )
    assert solution.objective == pytest.approx(-1500.0 + 40.0 * best.x[1] * most / c, abs=1e-5)


def test_a_heading_that_is_any_number_of_turns() -> None:
    """An airliner through a jet stream, by Zermelo's law shot at its destination (Bryson and Ho, 2.7)."""
    speed, strong, middle, wide, way = 230.0, 45.0, 150e3, 80e3, 1500e3

    def wind(y: float) -> float:
        return float(-strong * np.exp(-(((y - middle) / wide) ** 2)))

    def flown(unknown: Vector) -> Vector:
        def rates(_: float, y: Vector) -> list[float]:
            slope = -2.0 * (y[1] - middle) / wide**2 * wind(y[1])
            return [
                speed * np.cos(y[2]) + wind(y[1]),
                speed * np.sin(y[2]),
                -(np.cos(y[2]) ** 2) * slope,
            ]

        begin = [0.0, 100e3, unknown[0]]
        span = 0.0, 7000.0 * unknown[1]
        flight = solve_ivp(rates, span, begin, method="DOP853", rtol=1e-12, atol=1e-9)
        return np.array([flight.y[0, -1] - way, flight.y[1, -1] - 100e3]) / 1e5

    _, late = fsolve(flown, [-0.48, 0.97], xtol=1e-12)
    states = {"x": "V*cos(psi) - U*exp(-((y - y0)/w)^2)", "y": "V*sin(psi)"}
    solution = solved(
        {
            "model": first_order(states, ["psi"], V=speed, U=strong, y0=middle, w=wide),
            "final_time": [1000, 20000],
            "initial_state": {"x": 0, "y": 100e3},
            "final_state": {"x": way, "y": 100e3},
            "objective": {"terminal": "tf"},
        }
    )
    assert solution.objective == pytest.approx(7000.0 * late, rel=1e-9)


@pytest.mark.parametrize(
    ("cost", "limits"),
    [
        ("abs(ux) + abs(uy)", {"bounds": {"ux": [-0.005, 0.005], "uy": [-0.005, 0.005]}}),
        (
            "sqrt(ux^2 + uy^2)",
            {
                "path_constraints": [
                    {"name": "thrust", "expression": "sqrt(ux^2 + uy^2)", "bounds": [None, 0.005]}
                ]
            },
        ),
    ],
)
def test_a_rendezvous_that_has_many_cheapest_ways(cost: str, limits: dict[str, Any]) -> None:
    """Clohessy-Wiltshire: vy + 2 n x changes by uy alone, from -0.63 m/s to 0, and no flight costs less.

    So all thrust along the track is as good wherever it is, and a control that thrusts is singular.
    """
    rates = {"x": "vx", "y": "vy", "vx": "3*n^2*x + 2*n*vy + ux", "vy": "-2*n*vx + uy"}
    solution = solved(
        {
            "model": first_order(rates, ["ux", "uy"], n=0.00113),
            "final_time": 4000,
            "initial_state": {"x": -500, "y": -2000, "vx": 0, "vy": 0.5},
            "final_state": {"*": 0},
            "objective": {"running": cost},
            **limits,
        }
    )
    assert solution.objective == pytest.approx(0.63, abs=1e-7)


def test_a_thrust_vector_of_three_components_starts_off_its_kink() -> None:
    """|u| has no slope at 0, where every guess begins; 7 m in 1 s at rest costs 12 |d|^2 / T^3 with |u|^2.

    The path constraint on the length does not matter: u = (6 - 12 t) d.
    """
    names = ["x", "y", "z"]
    rates = {**{name: f"v{name}" for name in names}, **{f"v{name}": f"u{name}" for name in names}}
    solution = solved(
        {
            "model": first_order(rates, ["ux", "uy", "uz"]),
            "final_time": 1,
            "initial_state": {"*": 0},
            "final_state": {"x": 2, "y": 3, "z": 6, "vx": 0, "vy": 0, "vz": 0},
            "path_constraints": [
                {"name": "thrust", "expression": "sqrt(ux^2 + uy^2 + uz^2)", "bounds": [None, 100]}
            ],
            "objective": {"running": "ux^2 + uy^2 + uz^2"},
        }
    )
    assert solution.objective == pytest.approx(12.0 * 49.0, rel=1e-8)
