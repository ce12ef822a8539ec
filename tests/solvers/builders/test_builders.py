"""What the builders write, against the document written by hand and against who holds the model."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy
from numpy.typing import NDArray
from scipy.signal import StateSpace
from scipy.sparse import coo_array
from sympy.physics.mechanics import LagrangesMethod, ReferenceFrame, dynamicsymbols

from solvers.backends import NUMPY
from solvers.builders import (
    MINIMUM_TIME,
    Problem,
    first_order,
    first_order_from_casadi,
    first_order_from_sympy,
    library,
    mechanical,
    mechanical_from_sympy,
    modal,
    state_space,
    state_space_outputs,
)
from solvers.errors import DocumentError, ExpressionError
from solvers.formulation.stated import stated_problem
from solvers.problem import OptimalControlProblem
from solvers.spec import JobSpec, ProblemSpec, check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT

Vector = NDArray[np.float64]
PARAMETERS = FLEXIBLE_SPACECRAFT["problem"]["model"]["parameters"]


def slew(model: dict[str, Any], **others: Any) -> Problem:
    """A problem around a model, of which only the model matters."""
    return Problem(model, final_time=(1, 100), initial_state={"*": 0}, objective=MINIMUM_TIME, **others)


def problem_of(document: dict[str, Any]) -> OptimalControlProblem:
    return stated_problem(check_document(document).problem)


def rates(document: dict[str, Any], x: Vector, u: Vector, t: Vector) -> Vector:
    """x' of the model of a document, (n, K), for states (n, K), controls (m, K) and times (K,)."""
    problem = problem_of(document)
    found = problem.rate(x, u, t, problem.parameters, NUMPY)
    return np.array([np.broadcast_to(row, t.shape) for row in found])


def places(states: int, controls: int, count: int = 20) -> tuple[Vector, Vector, Vector]:
    numbers = np.random.default_rng(1)
    return (
        numbers.uniform(-1, 1, (states, count)),
        numbers.uniform(-5, 5, (controls, count)),
        numbers.uniform(0, 9, count),
    )


def test_a_problem_is_the_document_written_by_hand() -> None:
    by_hand = FLEXIBLE_SPACECRAFT["problem"]
    model = dict(by_hand["model"])
    assert model.pop("kind") == "mechanical"
    problem = Problem(
        mechanical(**model),
        final_time=(1, 100),
        initial_state=np.zeros(4),
        final_state={"theta": sympy.pi / 6, "alpha": 0, "theta_dot": np.float64(0), "alpha_dot": 0},
        bounds={"T": np.array([-5, 5])},
        objective=MINIMUM_TIME,
        guess={"final_time": np.int64(30)},
        name=FLEXIBLE_SPACECRAFT["name"],
        tags=("slew",),
        method="swcm",
        options={"max_seconds": 60},
    )
    written, given = problem.check().resolved().sha256, check_document(FLEXIBLE_SPACECRAFT).resolved().sha256
    assert written == given


def test_a_problem_has_every_key_of_a_document() -> None:
    keys = {field.name for field in dataclasses.fields(Problem)}
    ignored = {"schema_uri", "schema_version", "reference", "problem", "submitted_model"}
    assert keys - {"model"} == (set(JobSpec.model_fields) | set(ProblemSpec.model_fields)) - ignored


def test_infinite_bounds_are_open_and_sparse_matrices_are_entries() -> None:
    sparse = coo_array(([2.0, 3.0], ([0, 1], [0, 1])), shape=(2, 2))
    model = mechanical(
        sparse, [[1], [0]], coordinates=["a", "b"], controls=["T"], stiffness=np.array([[0, 1], [1, 0]])
    )
    document = slew(model, bounds={"T": (-np.inf, 5), "a": (None, 1)}).to_dict()
    assert document["problem"]["bounds"] == {"T": [None, 5.0], "a": [None, 1]}
    assert document["problem"]["model"]["mass"] == {"entries": [[0, 0, 2.0], [1, 1, 3.0]]}
    check_document(document)
    x, u, t = places(4, 1)
    expected = np.array([x[2], x[3], (u[0] - x[1]) / 2, -x[0] / 3])
    np.testing.assert_allclose(rates(document, x, u, t), expected, atol=1e-15)


@pytest.mark.parametrize(
    ("problem", "pointer", "told"),
    [
        (slew(library("pse"), bounds={"T1": (np.nan, 1)}), "/problem/bounds/T1/0", "NaN"),
        (slew(library("pse"), metadata={"a/b": object()}), "/metadata/a~1b", "object"),
        (slew(library("pse"), final_state=[0, 0]), "/problem/final_state", "8 states"),
    ],
)
def test_what_has_no_place_in_a_document_is_named(problem: Problem, pointer: str, told: str) -> None:
    with pytest.raises(DocumentError, match=told) as error:
        problem.to_dict()
    assert error.value.faults[0].pointer == pointer


class TestLinear:
    A = np.array([[0, 1, 0, 0], [-2, -0.1, 1, 0], [0, 0, 0, 1], [1, 0, -1, -1e-17]])
    B = np.array([[0, 0], [1, 0.5], [0, 0], [0, -3]])
    C = np.array([[1, 0, -1, 0], [0, 0, 0, 0]])
    D = np.array([[0, 0.25], [0, 0]])

    @pytest.mark.parametrize("wrapped", [True, False])
    def test_a_state_space(self, wrapped: bool) -> None:
        system = StateSpace(self.A, self.B, self.C, self.D)
        model = state_space(system) if wrapped else state_space(self.A, self.B)
        outputs = state_space_outputs(system) if wrapped else state_space_outputs(self.C, self.D)
        document = slew(model, outputs=outputs).to_dict()
        x, u, t = places(4, 2)
        np.testing.assert_allclose(rates(document, x, u, t), self.A @ x + self.B @ u, rtol=1e-15, atol=1e-15)
        problem = problem_of(document)
        scope = problem.scope(x, u, t, {}, NUMPY)
        first, second = (item.expression.evaluate(scope, NUMPY.functions) for item in problem.outputs)
        np.testing.assert_allclose(first, (self.C @ x + self.D @ u)[0], atol=1e-15)
        assert second == 0

    def test_names_and_entries_in_parameters(self) -> None:
        model = state_space(
            [[0, 1], ["-k/m", 0]], [0, "1/m"], states=["q", "v"], controls=["F"], parameters={"k": 3, "m": 2}
        )
        x, u, t = places(2, 1)
        expected = [x[1], (u[0] - 3 * x[0]) / 2]
        np.testing.assert_allclose(rates(slew(model).to_dict(), x, u, t), expected, rtol=1e-14)

    def test_as_many_states_as_a_document_may_have(self) -> None:
        matrix = np.random.default_rng(2).normal(size=(64, 64))
        x, u, t = places(64, 0)
        found = rates(slew(state_space(matrix)).to_dict(), x, u, t)
        np.testing.assert_allclose(found, matrix @ x, atol=1e-12)

    def test_what_does_not_fit_is_refused(self) -> None:
        with pytest.raises(ValueError, match="discrete"):
            state_space(StateSpace([[0.5]], [[1]], [[1]], [[0]], dt=0.1))
        with pytest.raises(ValueError, match="square"):
            state_space(self.A[:3], self.B)
        with pytest.raises(ValueError, match="2 names, a, b, for 4"):
            state_space(self.A, self.B, states=["a", "b"])
        with pytest.raises(ValueError, match="its own B"):
            state_space(StateSpace(self.A, self.B, self.C, self.D), self.B)
        with pytest.raises(ValueError, match="row for each mode"):
            modal(inertia=9.0, frequencies_hz=[1, 2], participation=[1, 2, 3], basis="constrained")
        with pytest.raises(ValueError, match="input matrix"):
            modal(inertia=9.0, frequencies_hz=1, participation=1, basis="constrained", controls=["a", "b"])


def test_modal_data() -> None:
    """J theta'' + delta' eta'' = T, eta'' + 2 zeta w eta' + w^2 eta + delta theta'' = 0 for two modes."""
    frequencies, damping, delta, inertia = [0.1, 0.3], [0.005, 0.01], np.array([33.5, 8.0]), 1565.0
    model = modal(
        inertia=inertia, frequencies_hz=frequencies, damping=damping, participation=delta, basis="constrained"
    )
    x, u, t = places(6, 1)
    w = 2 * np.pi * np.array(frequencies)[:, None]
    load = -2 * np.array(damping)[:, None] * w * x[4:] - w**2 * x[1:3]
    mass = np.block([[np.array([[inertia]]), delta[None]], [delta[:, None], np.eye(2)]])
    expected = np.vstack([x[3:], np.linalg.solve(mass, np.vstack([u, load]))])
    np.testing.assert_allclose(rates(slew(model).to_dict(), x, u, t), expected, rtol=1e-11, atol=1e-13)


def test_three_axes_of_modal_data() -> None:
    participation = np.array([[10.0, 1, 0], [0, 5, 2]])
    model = modal(
        inertia=np.diag([900.0, 800, 700]),
        frequencies_hz=["f1", 0.4],
        participation=participation,
        damping=0.005,
        basis="constrained",
        axes=["roll", "pitch", "yaw"],
        controls=["Tx", "Ty", "Tz"],
        modes=["panel", "boom"],
        parameters={"f1": 0.2},
    )
    assert [mode["coupling"] for mode in model["modes"]] == participation.tolist()
    assert model["input"] == np.eye(3).tolist()
    assert problem_of(slew(model).to_dict()).states[3:5] == ("panel", "boom")


class TestSymPy:
    def test_lagrange_s_equations_are_those_of_the_case(self) -> None:
        """The flexible spacecraft: a hub with two rigid appendages of tip masses on springs."""
        theta, alpha, torque = dynamicsymbols("theta alpha T")
        Jb, R, m, L, k = sympy.symbols("Jb R m L k")
        t = dynamicsymbols._t
        # One appendage: its tip at R along the hub's arm, then L along the appendage, turned by alpha.
        tip = sympy.Matrix(
            [
                R * sympy.cos(theta) + L * sympy.cos(theta + alpha),
                R * sympy.sin(theta) + L * sympy.sin(theta + alpha),
            ]
        )
        velocity = tip.diff(t)
        kinetic = Jb * theta.diff(t) ** 2 / 2 + 2 * m * velocity.dot(velocity) / 2
        lagrangian = sympy.trigsimp(sympy.expand(kinetic)) - 2 * k * alpha**2 / 2
        frame = ReferenceFrame("N")
        hub = ReferenceFrame("B")
        hub.set_ang_vel(frame, theta.diff(t) * frame.z)
        equations = LagrangesMethod(
            lagrangian, [theta, alpha], forcelist=[(hub, torque * frame.z)], frame=frame
        )
        equations.form_lagranges_equations()
        model = mechanical_from_sympy(
            equations.mass_matrix,
            equations.forcing,
            coordinates=[theta, alpha],
            controls=[torque],
            parameters=PARAMETERS,
            flexible=[alpha],
        )
        assert model["input"] == [["1"], ["0"]]
        x, u, t_ = places(4, 1)
        by_hand = rates(FLEXIBLE_SPACECRAFT, x, u, t_)
        np.testing.assert_allclose(rates(slew(model).to_dict(), x, u, t_), by_hand, rtol=1e-10, atol=1e-12)

    def test_every_word_of_first_order_equations(self) -> None:
        x, y, u, a = sympy.symbols("x y u a")
        t = sympy.Symbol("t")
        dynamics = {
            x: sympy.Rational(1, 3) * y**2 / sympy.sqrt(3) - a * sympy.exp(-(x**2)) + sympy.E + 0.1 * t,
            y: sympy.Max(x, y, u)
            + sympy.Min(x, 2)
            + sympy.Abs(x) ** sympy.Rational(3, 2)
            + sympy.atan2(y, x),
            "z": sympy.sign(x) * sympy.asin(x / 2)
            + sympy.tanh(y) * sympy.cosh(u)
            + sympy.sin(x) * sympy.sin(y),
            "w": 1 / sympy.sin(sympy.Float("0.1234567890123456789")) + sympy.log(2 + x) - sympy.pi,
        }
        model = first_order_from_sympy(dynamics, controls=[u], parameters={a: 0.7})
        states, controls, times = places(4, 1)
        expected = sympy.lambdify([x, y, u, t], [rate.subs(a, 0.7) for rate in dynamics.values()], "numpy")
        wanted = expected(states[0], states[1], controls[0], times)
        found = rates(slew(model).to_dict(), states, controls, times)
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, np.broadcast_to(other, times.shape), rtol=1e-14, atol=1e-14)

    def test_what_is_common_is_written_once_and_under_a_free_name(self) -> None:
        x, u, taken = sympy.symbols("x u common0")
        common = sympy.sin(x + taken) ** 2
        dynamics = {x: common + sympy.exp(common), taken: u * common}
        model = first_order_from_sympy(dynamics, controls=[u])
        assert model["states"] == ["x", "common0"]
        assert "common0" not in model["definitions"]
        assert (
            sum(text.count("sin") for text in [*model["definitions"].values(), *model["dynamics"].values()])
            == 1
        )

    def test_symbols_anywhere_in_a_problem(self) -> None:
        x, x_f, u = sympy.symbols("x x_f u")
        problem = Problem(
            first_order({x: u}, controls=[u]),
            final_time=1,
            initial_state={x: 0},
            objective={"running": u**2 + sympy.Function("drag")(x), "terminal": (x_f - 1) ** 2},
            data={"drag": {"x": np.array([-1, 0, 1]), "values": (1, 0, 1)}},
            path_constraints=[{"expression": x - u, "bounds": (None, 3)}],
        )
        written = problem.to_dict()["problem"]
        assert written["objective"] == {"running": "u**2 + drag(x)", "terminal": "(x_f - 1)**2"}
        problem.check()

    def test_what_the_language_does_not_have_is_named(self) -> None:
        x, u = sympy.symbols("x u")
        with pytest.raises(ExpressionError, match="besselj"):
            first_order_from_sympy({x: sympy.besselj(0, x)}, controls=[u])
        with pytest.raises(ExpressionError, match="affine"):
            mechanical_from_sympy([[1]], [u**2], coordinates=[x], controls=[u])


class TestCasadi:
    def test_the_flexible_spacecraft(self) -> None:
        q, v, u = ca.SX.sym("q", 2), ca.SX.sym("v", 2), ca.SX.sym("u")
        p = ca.SX.sym("p", 5)
        Jb, R, m, L, k = ca.vertsplit(p)
        cross = m * R * L * ca.sin(q[1])
        M = ca.blockcat(
            [
                [
                    Jb + 2 * m * (R**2 + L**2 + 2 * R * L * ca.cos(q[1])),
                    2 * m * (L**2 + R * L * ca.cos(q[1])),
                ],
                [2 * m * (L**2 + R * L * ca.cos(q[1])), 2 * m * L**2],
            ]
        )
        C = 2 * cross * ca.blockcat([[-v[1], -(v[0] + v[1])], [v[0], 0]])
        load = ca.vertcat(u, 0) - C @ v - ca.vertcat(0, 2 * k * q[1])
        function = ca.Function("f", [ca.vertcat(q, v), u, p], [ca.vertcat(v, ca.solve(M, load))])
        names = FLEXIBLE_SPACECRAFT["problem"]["final_state"]
        model = first_order_from_casadi(function, states=list(names), controls=["T"], parameters=PARAMETERS)
        x, controls, t = places(4, 1)
        document = slew(model).to_dict()
        by_hand = rates(FLEXIBLE_SPACECRAFT, x, controls, t)
        np.testing.assert_allclose(rates(document, x, controls, t), by_hand, rtol=1e-11, atol=1e-13)
        assert all(len(text) < 400 for text in model["definitions"].values())

    def test_every_operation(self) -> None:
        x, u, t = ca.MX.sym("x", 4), ca.MX.sym("u", 2), ca.MX.sym("t")
        a, b = u[0], u[1]
        sparse = ca.vertcat(ca.sparsify(ca.DM([0, 0])), x[0] - 3e-5, 0)
        result = ca.vertcat(
            ca.sin(x[0]) * ca.cos(x[1]) + ca.tan(x[0] / 9) - ca.asin(x[0]) + ca.acos(x[1]) * ca.atan(a),
            ca.sinh(x[0]) - ca.cosh(x[1]) / ca.tanh(3 + x[0]) + ca.exp(-a) + ca.log(7 + a) + ca.sqrt(9 + b),
            ca.fabs(x[0]) ** 1.5
            + ca.fmin(x[1], a)
            - ca.fmax(x[2], b)
            + ca.atan2(x[0], x[1])
            + ca.sign(b) * t,
            ca.log1p(x[0] ** 2) + ca.expm1(x[1]) + ca.hypot(a, b) + t / (3 + x[2]) - 2 * x[3] - (-x[0]) ** 2,
        )
        function = ca.Function("f", [x, u, t], [result + sparse])
        model = first_order_from_casadi(
            function, states=list("pqrs"), controls=["a", "w1"], arguments=("states", "controls", "time")
        )
        states, controls, times = places(4, 2)
        found = rates(slew(model).to_dict(), states, controls, times)
        expected = function.map(times.size)(states, controls, times[None]).full()
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-14)

    def test_a_deep_graph_meets_no_limit(self) -> None:
        x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        y = x
        for _ in range(8):  # eight steps of Runge and Kutta's first method
            y = y + 0.1 * ca.vertcat(y[1], -ca.sin(y[0]) + u)
        function = ca.Function("f", [x, u], [y])
        model = first_order_from_casadi(function, states=["x", "v"], controls=["u"])
        states, controls, times = places(2, 1)
        found = rates(slew(model).to_dict(), states, controls, times)
        np.testing.assert_allclose(found, function.map(times.size)(states, controls).full(), rtol=1e-13)

    def test_what_does_not_fit_is_refused(self) -> None:
        x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        function = ca.Function("f", [x, u], [ca.vertcat(x[1], ca.if_else(x[0] > 0, u, 0))])
        with pytest.raises(ExpressionError, match="no word for CasADi's"):
            first_order_from_casadi(function, states=["a", "b"], controls=["u"])
        with pytest.raises(ValueError, match=r"\[2, 1\] elements, and there are 3 states, 1 controls"):
            first_order_from_casadi(function, states=["a", "b", "c"], controls=["u"])
        short = ca.Function("f", [x, u], [u])
        with pytest.raises(ValueError, match="has 1 elements, not 2"):
            first_order_from_casadi(short, states=["a", "b"], controls=["u"])


def test_neither_sympy_nor_casadi_is_needed_to_start() -> None:
    code = "import sys, solvers.builders; print({'sympy', 'casadi', 'scipy'} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "set()"
