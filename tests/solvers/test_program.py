"""The exact derivatives of the partially separable form, against differences of its own functions."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from solvers.bases.daubechies import DaubechiesBasis
from solvers.bases.graded import GradedKnots
from solvers.derivatives import CompiledProgram, compile_program
from solvers.formulation.stated import stated_problem
from solvers.program import NonlinearProgram
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.transcription.base import Transcription
from solvers.transcription.daubechies_controls import DaubechiesControls
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral
from solvers.transcription.hermite_simpson import HermiteSimpson
from solvers.transcription.spline_wavelet import SplineWavelet


def transcribe(name: str, document: dict[str, Any]) -> Transcription:
    problem = stated_problem(check_document(document).problem)
    common = (problem, automatic_scaling(problem), problem.guess)
    match name:
        case "swcm":
            return SplineWavelet(*common, GradedKnots.uniform(5, 1))
        case "gpm":
            return GaussPseudospectral(*common, np.array([0.0, 0.4, 1.0]), (4, 3))
        case "daubechies":
            return DaubechiesControls(*common, DaubechiesBasis(2, 3), 0)
        case _:
            return HermiteSimpson(*common, np.array([0.0, 0.3, 0.5, 1.0]))


def with_everything(document: dict[str, Any]) -> dict[str, Any]:
    """Add a running cost, path and boundary constraints and state bounds, all nonlinear where they can be."""
    problem = document["problem"]
    problem["objective"] = {"terminal": "tf^2 + cos(theta_f)*T_0", "running": "T^2*theta + sin(alpha_dot*t)"}
    problem["path_constraints"] = [{"expression": "theta*T + alpha^2", "bounds": [-9, 9]}]
    problem["boundary_constraints"] = [{"expression": "theta_0*theta_f + tf*T_f", "bounds": [None, 7]}]
    problem["bounds"] |= {"alpha_dot": [-0.5, 0.4], "theta": [-2, 3]}
    problem["initial_time"] = [0, 2]
    problem["model"]["definitions"] = {"c": "cos(alpha)", "w": "c*k*theta_dot"}
    problem["model"]["force"] = ["w*alpha", 0]
    problem["design"] = {"R": {"bounds": [1, 4]}, "L": {"bounds": [2, 6]}}
    problem["outputs"] = [{"name": "push", "expression": "alpha_ddot*T"}]
    problem["integrals"] = [
        {"name": "work", "expression": "T*theta_dot*R", "bounds": [None, 9]},
        {"name": "flow", "expression": "w + t*alpha_ddot"},
    ]
    problem["path_constraints"].append({"expression": "theta_ddot*R", "bounds": [-5, 5], "during": [0.3, 1]})
    problem["objective"]["terminal"] += " + work*flow*L + push_f"
    return document


@pytest.fixture(params=["swcm", "gpm", "hermite_simpson", "daubechies"])
def program(request: pytest.FixtureRequest, flexible_spacecraft: dict[str, Any]) -> NonlinearProgram:
    return transcribe(request.param, with_everything(flexible_spacecraft)).program()


def point(program: NonlinearProgram, seed: int = 1) -> np.ndarray:
    return program.initial + 0.1 * np.random.default_rng(seed).standard_normal(program.variables)


def parts(compiled: CompiledProgram) -> tuple[ca.Function, ca.Function]:
    """J and c apart."""
    w, p = compiled.program.mx_in()
    objective, rows = compiled.program(w, p)
    return ca.Function("cost", [w, p], [objective]), ca.Function("rows", [w, p], [rows])


def central_differences(function: ca.Function, w: np.ndarray, *rest: Any) -> np.ndarray:
    """d(first output)/dw, column by column."""
    columns = []
    for unit in np.eye(w.size) * 1e-5:
        ahead, behind = (np.asarray(function(w + s * unit, *rest)).ravel() for s in (1, -1))
        columns.append((ahead - behind) / 2e-5)
    return np.column_stack(columns)


def test_jacobian_and_gradient_match_differences(program: NonlinearProgram) -> None:
    compiled = compile_program(program)
    w, p = point(program), program.numbers
    cost, rows = parts(compiled)
    jacobian = np.asarray(compiled.jacobian(w, p)[1])
    gradient = np.asarray(compiled.gradient(w, p)[1]).ravel()
    np.testing.assert_allclose(jacobian, central_differences(rows, w, p), atol=1e-7, rtol=1e-6)
    np.testing.assert_allclose(gradient, central_differences(cost, w, p).ravel(), atol=1e-7, rtol=1e-6)


def test_hessian_matches_differences_of_the_lagrangian_gradient(program: NonlinearProgram) -> None:
    compiled = compile_program(program)
    w, p = point(program), program.numbers
    multipliers = np.random.default_rng(2).standard_normal(program.constraints)
    sigma = 0.7

    def lagrangian_gradient(at: np.ndarray) -> np.ndarray:
        slopes = sigma * np.asarray(compiled.gradient(at, p)[1]).ravel()
        return slopes + np.asarray(compiled.jacobian(at, p)[1]).T @ multipliers

    upper = np.asarray(compiled.hessian(w, p, sigma, multipliers))
    hessian = upper + np.triu(upper, 1).T
    np.testing.assert_allclose(hessian, central_differences(lagrangian_gradient, w), atol=1e-6, rtol=1e-5)
    assert np.all(np.tril(upper, -1) == 0.0)


def test_unrolled_functions_are_the_same(program: NonlinearProgram) -> None:
    compiled = compile_program(program)
    unrolled = compiled.unrolled()
    w, p, multipliers = point(program), program.numbers, np.linspace(-1.0, 1.0, program.constraints)
    arguments = dict.fromkeys(("program", "gradient", "jacobian"), (w, p))
    for name, values in (arguments | {"hessian": (w, p, 0.7, multipliers)}).items():
        plain, straight = (getattr(form, name).call(list(values)) for form in (compiled, unrolled))
        for one, other in zip(plain, straight, strict=True):
            np.testing.assert_allclose(other.full(), one.full(), rtol=1e-12, atol=1e-12)
            assert other.sparsity() == one.sparsity()


def test_numbers_are_not_baked_into_the_graph(flexible_spacecraft: dict[str, Any]) -> None:
    """The same compiled functions serve another stiffness: only the column of numbers changes."""
    soft = transcribe("swcm", flexible_spacecraft).program()
    flexible_spacecraft["problem"]["model"]["parameters"]["k"] = 150
    stiff = transcribe("swcm", flexible_spacecraft).program()
    compiled = compile_program(soft)
    _, rows = parts(compiled)
    _, own_rows = parts(compile_program(stiff))
    w = point(soft)
    np.testing.assert_allclose(
        np.asarray(rows(w, stiff.numbers)), np.asarray(own_rows(w, stiff.numbers)), rtol=1e-14
    )
    assert not np.allclose(np.asarray(rows(w, soft.numbers)), np.asarray(rows(w, stiff.numbers)))


def test_scaling_changes_units_and_nothing_else(program: NonlinearProgram) -> None:
    generator = np.random.default_rng(3)
    variables = generator.uniform(0.1, 10, program.variables)
    row_scale = generator.uniform(0.1, 10, program.constraints)
    scaled = program.scaled(variables, row_scale, 5.0)
    w = point(program)
    plain, other = compile_program(program), compile_program(scaled)
    objective, slope = plain.gradient(w, program.numbers)
    scaled_objective, scaled_slope = other.gradient(w / variables, scaled.numbers)
    (_, rows), (_, scaled_rows) = program.values(w), scaled.values(w / variables)
    np.testing.assert_allclose(float(scaled_objective), 5.0 * float(objective))
    np.testing.assert_allclose(np.asarray(scaled_slope).ravel(), 5.0 * np.asarray(slope).ravel() * variables)
    np.testing.assert_allclose(scaled_rows, rows * row_scale, atol=1e-14)
