"""What a checked document holds: typed attributes, values as submitted, and the numbers they stand for."""

from __future__ import annotations

import math
from typing import Any

import pytest

from solvers.errors import DocumentError, ExpressionError
from solvers.spec import (
    METHODS,
    AutoMethod,
    FirstOrderModel,
    GaussPseudospectralMethod,
    HermiteSimpsonMethod,
    LibraryReference,
    MechanicalModel,
    SplineWaveletMethod,
    bound_interval,
    check_document,
    evaluate_constant,
    final_intervals,
    initial_intervals,
    inside,
    path_intervals,
)
from tests.solvers.spec.editing import FIRST_ORDER, FLEXIBLE_SPACECRAFT, LIBRARY, edited

INF = math.inf


def test_mechanical_model() -> None:
    spec = check_document(FLEXIBLE_SPACECRAFT)
    model = spec.problem.model
    assert isinstance(model, MechanicalModel)
    assert model.states == ("theta", "alpha", "theta_dot", "alpha_dot")
    assert model.coordinates == ("theta", "alpha")
    assert model.controls == ("T",)
    assert model.mass[1] == ("2*m*(L^2 + R*L*cos(alpha))", "2*m*L^2")
    assert model.stiffness == ((0, 0), (0, "2*k"))
    assert model.damping is not None
    assert model.damping[1][1] == 0
    assert model.input == ((1,), (0,))
    assert model.force is None
    assert model.parameter_values() == {"Jb": 440.0, "R": 2.5, "m": 10.0, "L": 5.0, "k": 100.0}
    assert isinstance(spec.method, SplineWaveletMethod)
    assert (spec.method.L, spec.method.J, spec.method.points) == (8, 4, 131)
    assert spec.options.max_seconds == 60
    assert spec.output.samples == 201
    assert spec.problem.objective.terminal == "tf"
    assert spec.problem.objective.running is None
    assert spec.problem.final_time == [1, 100]


def test_first_order_model() -> None:
    model = check_document(
        edited({"/problem/model/dynamics": {"v": "u/m", "x": "v"}}, FIRST_ORDER)
    ).problem.model
    assert isinstance(model, FirstOrderModel)
    assert model.states == ("x", "v")
    assert list(model.dynamics.items()) == [("x", "v"), ("v", "u/m")]


def test_library_model_is_written_out_with_its_overrides() -> None:
    changes = {"/problem/model/parameters": {"k": "2*Jb", "Jb": 400}}
    problem = check_document(edited(changes, LIBRARY)).problem
    assert isinstance(problem.submitted_model, LibraryReference)
    written = check_document(FLEXIBLE_SPACECRAFT).problem.model
    model = problem.model
    assert isinstance(model, MechanicalModel)
    assert isinstance(written, MechanicalModel)
    assert (model.mass, model.damping, model.stiffness) == (written.mass, written.damping, written.stiffness)
    assert model.parameter_values() == {"Jb": 400.0, "R": 2.5, "m": 10.0, "L": 5.0, "k": 800.0}
    assert problem.model is model


def test_parameters_may_use_earlier_ones() -> None:
    changes = {"/problem/model/parameters": {"m": "2*pi", "n": "m^2", "o": "sqrt(n)/m", "k": -1}}
    values = check_document(edited(changes, FIRST_ORDER)).problem.model.parameter_values()
    assert values == pytest.approx({"m": 2 * math.pi, "n": 4 * math.pi**2, "o": 1, "k": -1})


@pytest.mark.parametrize(
    ("method", "wanted"),
    [
        (None, AutoMethod(name="auto")),
        ({"name": "auto"}, AutoMethod(name="auto", accuracy=1e-6)),
        ({"name": "auto", "accuracy": "10^-4"}, AutoMethod(name="auto", accuracy=1e-4)),
        ({"name": "swcm"}, SplineWaveletMethod(name="swcm", L=8, J=4)),
        ({"name": "swcm", "L": 5, "J": 0}, SplineWaveletMethod(name="swcm", L=5, J=0)),
        ({"name": "gpm"}, GaussPseudospectralMethod(name="gpm", nodes=40, segments=1)),
        ({"name": "hermite_simpson"}, HermiteSimpsonMethod(name="hermite_simpson", intervals=60)),
    ],
)
def test_methods_and_their_defaults(method: Any, wanted: Any) -> None:
    document = edited({} if method is None else {"/method": method}, FIRST_ORDER)
    assert check_document(document).method == wanted
    assert type(wanted) is METHODS[wanted.name]


@pytest.mark.parametrize("name", ["swcm", "gpm", "hermite_simpson"])
def test_a_refined_answer_is_verified_to_its_own_tolerance(name: str) -> None:
    spec = check_document(edited({"/method": {"name": name, "refine": "switching"}}, FIRST_ORDER))
    assert spec.method.refinement == "switching"
    assert set(spec.verification_tolerances().values()) == {1e-6}
    plain = check_document(edited({"/method": {"name": name, "refine": None}}, FIRST_ORDER))
    assert plain.method.refinement is None
    assert set(plain.verification_tolerances().values()) == {1e-2}
    auto = check_document(edited({"/method": {"name": "auto", "accuracy": 1e-5}}, FIRST_ORDER))
    assert set(auto.verification_tolerances().values()) == {1e-5}


@pytest.mark.parametrize(
    ("value", "detail"),
    [
        ("switchng", "must be 'switching' or null, not 'switchng'; did you mean 'switching'?"),
        ("collocation", "must be 'switching' or null, not 'collocation'"),
        (True, "must be 'switching' or null, not true"),
        ({}, "must be 'switching' or null, not an object"),
    ],
)
def test_no_other_refinement_is_known(value: Any, detail: str) -> None:
    with pytest.raises(DocumentError) as caught:
        check_document(edited({"/method": {"name": "gpm", "refine": value}}, FIRST_ORDER))
    assert [(fault.pointer, fault.detail) for fault in caught.value.faults] == [("/method/refine", detail)]


def test_options_take_expressions_and_defaults() -> None:
    spec = check_document(
        edited({"/options": {"tolerance": "1e-9*m", "verification": {"path": 1e-3}}}, FIRST_ORDER)
    )
    assert spec.options.tolerance == 2e-9
    assert (spec.options.max_iterations, spec.options.max_seconds, spec.options.starts) == (3000, 60, 1)
    assert spec.verification_tolerances() == {
        "terminal_error": 1e-6,
        "state_error": 1e-6,
        "bound": 1e-6,
        "path": 1e-3,
    }


def test_a_checked_document_cannot_be_changed() -> None:
    spec = check_document(FLEXIBLE_SPACECRAFT)
    with pytest.raises(ValueError, match="frozen"):
        spec.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("value", "number"),
    [(3, 3.0), (-2.5, -2.5), ("30*deg", math.pi / 6), ("2*k", 200.0), ("max(k, m)", 100.0), ("1e-3", 0.001)],
)
def test_evaluate_constant(value: float | str, number: float) -> None:
    assert evaluate_constant(value, {"k": 100.0, "m": 10.0}) == pytest.approx(number, rel=1e-15)


@pytest.mark.parametrize(
    "value", ["1/0", "0/0", "log(-1)", "(-8)^(1/3)", "exp(1e3)", "j", "2*", INF, 10**400]
)
def test_what_is_no_constant_is_refused(value: float | str) -> None:
    with pytest.raises(ExpressionError):
        evaluate_constant(value, {"k": 100.0})


@pytest.mark.parametrize(
    ("bound", "interval"),
    [
        (None, (-INF, INF)),
        (2, (2.0, 2.0)),
        ("k", (100.0, 100.0)),
        ([None, None], (-INF, INF)),
        ([None, "k"], (-INF, 100.0)),
        (["-k/2", None], (-50.0, INF)),
        ([-1, 1.5], (-1.0, 1.5)),
    ],
)
def test_bound_interval(bound: Any, interval: tuple[float, float]) -> None:
    assert bound_interval(bound, {"k": 100.0}) == interval


@pytest.mark.parametrize(
    ("interval", "value"),
    [
        ((1.0, 3.0), 2.0),
        ((-1e308, 1e308), 0.0),
        ((1e308, 1.7e308), 1.35e308),
        ((2.0, INF), 2.0),
        ((-3.0, INF), 0.0),
        ((-INF, -3.0), -3.0),
        ((-INF, 3.0), 0.0),
        ((-INF, INF), 0.0),
    ],
)
def test_representative_of_an_interval(interval: tuple[float, float], value: float) -> None:
    assert inside(interval) == pytest.approx(value, rel=1e-15)


def test_ends_and_bounds_as_intervals() -> None:
    changes = {
        "/problem/initial_state": {"*": 0, "alpha": None, "theta": [None, "1/Jb"]},
        "/problem/final_state": {"theta": "30*deg", "alpha_dot": [-1, 1]},
        "/problem/bounds": {"T": ["-R", "R"], "theta": None},
    }
    problem = check_document(edited(changes)).problem
    assert initial_intervals(problem) == {
        "theta": (-INF, 1 / 440),
        "alpha": (-INF, INF),
        "theta_dot": (0.0, 0.0),
        "alpha_dot": (0.0, 0.0),
    }
    assert final_intervals(problem) == {
        "theta": (pytest.approx(math.pi / 6), pytest.approx(math.pi / 6)),
        "alpha": (-INF, INF),
        "theta_dot": (-INF, INF),
        "alpha_dot": (-1.0, 1.0),
    }
    assert path_intervals(problem)["T"] == (-2.5, 2.5)
    assert path_intervals(problem)["theta"] == (-INF, INF)


def test_guess_histories() -> None:
    changes = {
        "/problem/guess": {
            "final_time": "3*R",
            "times": [0, "R", 10],
            "states": {"theta": [0, "10*deg", 1], "alpha": {"times": [0, 4], "values": ["k", 2]}},
        }
    }
    problem = check_document(edited(changes)).problem
    values = problem.model.parameter_values()
    assert problem.guess.history("theta", values) == (
        [0.0, 2.5, 10.0],
        [0.0, pytest.approx(math.pi / 18), 1.0],
    )
    assert problem.guess.history("alpha", values) == ([0.0, 4.0], [100.0, 2.0])
    assert problem.guess.history("T", values) is None
    equal = check_document(edited({"/problem/guess": {"controls": {"T": [1, 2, 3]}}})).problem.guess
    assert equal.history("T", values) == (None, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    "changes",
    [
        {"/problem/initial_state": {"*": None}},
        {"/problem/initial_state": {"theta": [-1, 1], "*": 0}},
        {"/problem/final_state": {}},
        {"/problem/final_state": {"*": 0, "theta": "pi/6"}},
        {"/problem/bounds": {"T": [None, None], "alpha": [None, 1], "alpha_dot": 0}},
        {"/problem/final_time": [None, None], "/problem/guess": {}},
        {"/problem/initial_time": [-1, 0], "/problem/final_time": 10},
        {"/problem/model/force": ["-theta_dot^3 + sin(t)", "R*0"]},
        {"/problem/boundary_constraints": [{"expression": "T_0 - T_f + alpha_dot_f/tf + t0*k", "bounds": 0}]},
        {"/problem/path_constraints": [{"name": "", "expression": "alpha^2*t", "bounds": [None, "R"]}]},
        {"/problem/objective": {"terminal": "tf", "running": "T^2 + max(alpha, t)"}},
        {"/problem/units": {"theta": "rad", "T": "N m", "Jb": "kg m^2", "t": "s"}},
        {"/$schema": "https://example.org/x.json", "/reference": {"objective": 1}, "/metadata": {"a": [{}]}},
        {"/problem/guess": {}, "/notes": "é ☃ 漢", "/tags": []},
        {"/problem/initial_state/alpha": None, "/problem/model/mass/1/1": "sin(alpha)", "/problem/guess": {}}
        | {"/problem/final_state/alpha": 1},
        {"/problem/initial_state/alpha": None, "/problem/model/mass/1/1": "40 + alpha"}
        | {"/problem/guess": {"states": {"alpha": [1, 0]}}},
    ],
)
def test_what_the_shape_allows(changes: dict[str, Any]) -> None:
    assert check_document(edited(changes)).problem.model.states[0] == "theta"
