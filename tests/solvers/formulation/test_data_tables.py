"""Data tables: numbers and derivatives on every backend, and problems with tables against closed forms."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.interpolate import CubicSpline, interp1d

from solvers.arrays.graph import Graph, GraphBackend
from solvers.arrays.kernel import Kernels
from solvers.formulation.data_table import DataTable
from solvers.formulation.scenarios import formulate
from solvers.mesh_points import gauss_mesh, interval_mesh
from solvers.sizes import problem_size
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document
from solvers.symbolic import CASADI
from tests.solvers.output.test_outputs import each_method

Vector = NDArray[np.float64]
KNOTS = (0.0, 0.3, 0.55, 1.0)
VALUES = (0.5, -1.0, 2.0, 0.3)
KINDS = ("cubic", "linear", "previous")
POINTS = np.array([-0.5, 0.0, 0.1, 0.3, 0.4, 0.55, 0.9, 1.0, 1.5])


def expected(kind: str, points: Vector) -> Vector:
    """SciPy's own curves, held beyond the ends."""
    inside = np.clip(points, KNOTS[0], KNOTS[-1])
    curve = CubicSpline(KNOTS, VALUES) if kind == "cubic" else interp1d(KNOTS, VALUES, kind=kind)
    return np.asarray(curve(inside), np.float64)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_at_inside_and_outside_of_the_ends_on_every_backend(kind: Any) -> None:
    table = DataTable(KNOTS, VALUES, kind, "hold")
    np.testing.assert_allclose(table(POINTS), expected(kind, POINTS), atol=1e-14)
    x = ca.SX.sym("x")
    symbolic = ca.Function("f", [x], [table.evaluate({}, CASADI.functions)(x)])
    np.testing.assert_array_equal(np.array(symbolic(POINTS[None])).ravel(), table(POINTS))
    graph = Graph()
    value = table.evaluate({}, GraphBackend(graph).functions)(graph.input("x"))
    kernel = Kernels([value, value * value], ["x"]).at(POINTS.size)
    kernel.inputs[:] = POINTS
    kernel.run()
    np.testing.assert_array_equal(kernel.outputs[0], table(POINTS))


def test_derivatives_are_exact() -> None:
    x = ca.SX.sym("x")
    value = DataTable(KNOTS, VALUES, "cubic", "hold").evaluate({}, CASADI.functions)(x)
    slopes = ca.Function("f", [x], [ca.gradient(value, x), ca.hessian(value, x)[0]])
    inside = np.array([0.1, 0.4, 0.9])
    curve = CubicSpline(KNOTS, VALUES)
    for order, found in enumerate(slopes(inside[None]), 1):
        np.testing.assert_allclose(np.array(found).ravel(), curve(inside, order), rtol=1e-12)
    assert float(slopes(2.0)[0]) == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_outside_is_no_number_and_the_ends_belong_to_the_table(kind: Any) -> None:
    table = DataTable(KNOTS, VALUES, kind, "error")
    x = ca.SX.sym("x")
    symbolic = ca.Function("f", [x], [table.evaluate({}, CASADI.functions)(x)])
    points = np.array([-1e-6, -1e-12, 0.5, 1.0, 1.0 + 1e-12, 1.0 + 1e-6])
    wanted = [np.nan, VALUES[0], expected(kind, np.array([0.5]))[0], VALUES[-1], VALUES[-1], np.nan]
    np.testing.assert_allclose(table(points), wanted, atol=1e-14)
    np.testing.assert_array_equal(np.array(symbolic(points[None])).ravel(), table(points))


def test_a_table_of_a_cubic_is_that_cubic_and_two_points_are_a_line() -> None:
    x = np.array([-2.0, -1.0, 0.5, 1.0, 3.0])
    table = DataTable(tuple(x), tuple(x**3 - x), "cubic", "hold")
    dense = np.linspace(-2, 3, 101)
    np.testing.assert_allclose(table(dense), dense**3 - dense, atol=1e-12)
    assert DataTable((0.0, 2.0), (1.0, 5.0), "cubic", "hold")(np.array([0.5])) == pytest.approx([2.0])


def disturbed(kind: str, **method: Any) -> dict[str, Any]:
    """x'' = u + Td(t) from rest at 0 to rest at 1 with the least integral of u^2."""
    return {
        "problem": {
            "model": {
                "kind": "mechanical", "coordinates": ["x"], "controls": ["u"],
                "mass": [[1]], "force": ["Td(t)"], "input": [[1]],
            },
            "data": {"Td": {"x": list(KNOTS), "values": list(VALUES), "interpolation": kind}},
            "final_time": 1,
            "initial_state": {"*": 0},
            "final_state": {"x": 1, "x_dot": 0},
            "objective": {"running": "u^2"},
        },
        "method": method,
    }  # fmt: skip


def least_energy(kind: str) -> float:
    """u = a + b (1 - t), where a and b follow from the two integrals that the ends ask for."""
    curve = CubicSpline(KNOTS, VALUES) if kind == "cubic" else interp1d(KNOTS, VALUES, kind=kind)
    pieces = [(left, right * (1 - 1e-14)) for left, right in pairwise(KNOTS)]
    speed = sum(quad(curve, *piece, epsabs=1e-13)[0] for piece in pieces)
    way = sum(quad(lambda s: (1 - s) * curve(s), *piece, epsabs=1e-13)[0] for piece in pieces)
    a, b = np.linalg.solve([[1, 1 / 2], [1 / 2, 1 / 3]], [-speed, 1 - way])
    return float(a * a + a * b + b * b / 3)


def answer(document: dict[str, Any]) -> Solution:
    return solve(check_document(document))


@pytest.mark.parametrize(
    ("kind", "method", "limit"),
    [
        ("cubic", {"name": "gpm", "nodes": 20}, 1e-6),
        ("linear", {"name": "gpm", "nodes": 20}, 1e-9),
        ("previous", {"name": "gpm", "nodes": 20}, 1e-9),
        ("linear", {"name": "hermite_simpson", "intervals": 10}, 1e-9),
        ("previous", {"name": "hermite_simpson", "intervals": 10}, 2e-8),
        ("linear", {"name": "swcm", "J": 4}, 1e-8),
        ("previous", {"name": "swcm", "J": 4}, 1e-3),
    ],
)
def test_a_disturbance_over_time_against_the_closed_form(
    kind: str, method: dict[str, Any], limit: float
) -> None:
    solution = answer(disturbed(kind, **method))
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(least_energy(kind), abs=limit)
    assert solution.verification.objective == pytest.approx(least_energy(kind), abs=limit)
    assert solution.verification.terminal_error is not None
    assert solution.verification.terminal_error < 10 * limit
    assert not solution.warnings


@pytest.mark.parametrize("kind", ["linear", "previous"])
def test_corners_keep_the_order_of_convergence(kind: str) -> None:
    """x' = -x^2 + Td(t) has an answer that is smooth between the corners; Hermite-Simpson is of order 4."""
    model = {"kind": "first_order", "states": ["x"], "controls": ["u"], "dynamics": {"x": "u - x^2 + Td(t)"}}
    document = disturbed(kind)
    document["problem"] |= {"model": model, "initial_state": {"x": 1}, "final_state": {}}
    document["problem"]["objective"] = {"running": "u^2 + x^2"}

    def objective(**method: Any) -> float:
        return answer({**document, "method": method}).objective

    exact = objective(name="gpm", nodes=60)
    errors = [abs(objective(name="hermite_simpson", intervals=count) - exact) for count in (6, 12)]
    assert np.log2(errors[0] / errors[1]) > 3.0
    assert errors[1] < 1e-5


@pytest.mark.parametrize("method", [{"name": "gpm", "nodes": 8}, {"name": "hermite_simpson", "intervals": 8}])
def test_adapted_meshes_keep_the_corners(method: dict[str, Any]) -> None:
    solution = answer(disturbed("previous", **method, adaptive={"tolerance": 1e-7}))
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(least_energy("previous"), abs=1e-6)
    breaks = solution.trajectory.basis.get("breaks", solution.trajectory.basis.get("knots"))
    for corner in KNOTS[1:3]:
        assert np.min(np.abs(np.array(breaks) - corner)) < 2e-9


def test_corners_are_points_of_the_mesh_and_the_size_is_known_beforehand() -> None:
    document = disturbed("previous", name="hermite_simpson", intervals=9)
    problem = formulate(check_document(document).problem).problem
    knots = interval_mesh(problem, 9)
    for corner in KNOTS[1:3]:
        assert np.sum(np.abs(knots - corner) < 2e-9) == 2  # one for each side of a jump
    breaks, counts = gauss_mesh(problem, 20, 1)
    np.testing.assert_allclose(breaks, KNOTS)
    assert counts == (6, 6, 9)
    for method in (document["method"], {"name": "gpm", "nodes": 20}, {"name": "swcm"}):
        spec = check_document({**document, "method": method})
        statistics, size = solve(spec).statistics, problem_size(spec)
        assert (statistics.variables, statistics.constraints) == (size.variables, size.constraints)


def test_drag_from_a_table_is_the_drag_of_the_formula() -> None:
    """A table of v^3 and v^3 itself: the same minimum energy, to the tolerance of the program."""
    v = np.linspace(-1, 4, 6)
    problem = {
        "model": {
            "kind": "first_order", "states": ["x", "v"], "controls": ["u"],
            "dynamics": {"x": "v", "v": "u - 0.3*v^3"},
        },
        "final_time": 2,
        "initial_state": {"*": 0},
        "final_state": {"x": 2, "v": 0},
        "objective": {"running": "u^2"},
    }  # fmt: skip
    formula = answer({"problem": problem, "method": {"name": "gpm", "nodes": 30}})
    problem["model"]["dynamics"]["v"] = "u - drag(v)"  # type: ignore[index]
    problem["data"] = {"drag": {"x": v.tolist(), "values": (0.3 * v**3).tolist(), "outside": "error"}}
    table = answer({"problem": problem, "method": {"name": "gpm", "nodes": 30}})
    assert table.success
    assert table.objective == pytest.approx(formula.objective, rel=1e-9)
    assert not table.warnings


def test_tables_in_constraints_costs_definitions_and_cases() -> None:
    """A moving wall x <= wall(t), a weight over time, and a table whose numbers depend on the case."""
    document = disturbed("linear", name="gpm", nodes=20)
    problem = document["problem"]
    problem["model"] |= {"parameters": {"p": 1}, "definitions": {"d": "p*Td(t)"}, "force": ["d"]}
    problem["data"]["wall"] = {"x": [0, 1], "values": [0.3, 1.1], "interpolation": "linear"}
    problem["data"]["Td"]["values"] = ["p/2", "-p", "2*p", 0.3]
    problem["path_constraints"] = [{"expression": "x - wall(t)", "bounds": [None, 0]}]
    problem["scenarios"] = {
        "cases": [{"name": "calm", "parameters": {"p": 0.9}, "final_state": {"x": None, "x_dot": None}}]
    }
    solution = answer(document)
    assert solution.success, solution.message
    calm = solution.plants[1]
    forces = [plant.plant.problem.definitions["Td"] for plant in solution.plants]
    assert [table.values[1] for table in forces] == [-1.0, -0.9]  # type: ignore[attr-defined]
    assert calm.verification.passed
    t = np.linspace(0, 1, 201)
    for plant in solution.plants:
        assert np.all(plant.trajectory.states["x"](t) <= 0.3 + 0.8 * t + 1e-3)


def test_warnings_where_corners_cannot_be_points_of_a_mesh() -> None:
    document = disturbed("previous", name="gpm")
    document["problem"] |= {"final_time": [0.5, 2], "objective": {"terminal": "tf"}, "bounds": {"u": [-9, 9]}}
    formulation = formulate(check_document(document).problem)
    assert [(item["code"], item["pointer"]) for item in formulation.warnings(formulation.problem)] == [
        ("table_corners_off_mesh", "/problem/data/Td")
    ]
    document["problem"]["model"]["force"] = ["Td(x)"]
    formulation = formulate(check_document(document).problem)
    assert [item["code"] for item in formulation.warnings(formulation.problem)] == ["nonsmooth"]
    document["problem"]["data"]["Td"]["interpolation"] = "cubic"
    formulation = formulate(check_document(document).problem)
    assert not formulation.warnings(formulation.problem)


def test_a_parameter_that_a_table_names_has_no_sensitivity() -> None:
    document = disturbed("linear", name="gpm", nodes=10)
    document["problem"]["model"]["parameters"] = {"p": 1, "m": 1}
    document["problem"]["model"]["mass"] = [["m"]]
    document["problem"]["data"]["Td"]["values"][0] = "p/2"
    slopes = answer(document).sensitivity
    assert slopes is not None
    assert slopes["/problem/model/parameters/p"] is None
    assert slopes["/problem/model/parameters/m"] is not None


def test_leaving_a_table_that_ends_is_an_error_of_the_expression() -> None:
    document = disturbed("linear", name="gpm", nodes=10)
    document["problem"]["data"]["Td"] |= {"outside": "error", "x": [0, 0.3, 0.55, 0.8]}
    solution = answer(document)
    assert solution.status.value == "evaluation_error"
    assert "/problem/model/force/0" in solution.message
    assert "'Td(t)'" in solution.message
    # Nothing had a value: what there is of the answer is where the search would have begun.
    result = solution.result()
    (start,), (*_, mesh) = result["starts"], result["convergence"]
    assert result["objective"] is start["objective"] is mesh["objective"] is mesh["iterates"][0][1] is None
    assert result["verification"]["hamiltonian_drift"] is None
    assert set(result["nodes"]["costates"]["x"]) == {None}
    assert None not in result["nodes"]["states"]["x"]


@pytest.mark.parametrize("iterations", [40, 80])
def test_a_search_that_comes_to_the_end_of_a_table_says_so(iterations: int) -> None:
    """As fast as possible, which is faster than the table of the drag says anything of."""
    document = {
        "problem": {
            "model": {
                "kind": "first_order",
                "states": ["x", "v"],
                "controls": ["u"],
                "dynamics": {"x": "v", "v": "u - drag(v)"},
            },
            "data": {"drag": {"x": [-1, 0, 1, 2], "values": [-0.1, 0, 0.1, 0.3], "outside": "error"}},
            "final_time": [1, 30],
            "initial_state": {"*": 0},
            "final_state": {"x": 10, "v": 0},
            "bounds": {"u": [-1, 1]},
            "objective": {"terminal": "tf"},
        },
        "method": {"name": "hermite_simpson", "intervals": 16},
        "options": {"max_iterations": iterations},
    }
    solution = answer(document)
    # Whether the last iterate is beyond it or only near to it, where the search did not get on.
    assert solution.status.value in ("evaluation_error", "iteration_limit")
    assert "/problem/model/dynamics/v" in solution.message
    assert "the table 'drag' goes from -1 to 2" in solution.message


@each_method
def test_a_flight_ends_where_its_table_does(method: dict[str, Any]) -> None:
    """12/T^3 + T/100 falls until T = 7.75, but the table says nothing after 3; as a definition, too."""
    document = disturbed("linear", **method)
    problem = document["problem"]
    problem["data"]["Td"] |= {"outside": "error", "x": [-1, 2, 3], "values": [0, 0, 0]}
    problem["model"] |= {"definitions": {"push": "Td(t)"}, "force": ["push"]}
    problem |= {"final_time": [0.5, None], "objective": {"running": "u^2 + 0.01"}}
    solution = answer(document)
    assert solution.success, solution.message
    assert solution.trajectory.tf == pytest.approx(3, abs=1e-7)
    assert solution.objective == pytest.approx(12 / 27 + 0.03, abs=1e-6)
    assert [(item["code"], item["pointer"]) for item in solution.warnings] == [
        ("table_ends_flight", "/problem/data/Td")
    ]
    problem["bounds"] = {"u": [-0.1, 0.1]}
    short = answer(document)
    assert short.status.value == "infeasible"
    assert "the table 'Td' has no values beyond it" in short.message


def test_a_search_by_genes_flies_tables_too() -> None:
    method = {"name": "ga", "generations": 5, "polish": False, "penalty": 1000}
    solution = answer(disturbed("linear", **method))
    assert solution.verification.max_state_error is not None
    assert solution.verification.max_state_error < 1e-6
