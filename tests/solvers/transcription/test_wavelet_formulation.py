"""The paper optimises wavelet coefficients, we optimise B-spline coefficients: the same optimum."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from solvers.bases.graded import GradedKnots
from solvers.bases.spline_wavelet import SplineWaveletBasis
from solvers.formulation.stated import stated_problem
from solvers.optimizers.ipopt import Ipopt
from solvers.optimizers.outcome import Limits, Outcome
from solvers.program import NonlinearProgram
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.transcription.spline_wavelet import SplineWavelet


def minimise(program: NonlinearProgram) -> Outcome:
    optimizer = Ipopt(program, tolerance=1e-11, max_iterations=500)
    return optimizer.minimise(program, Limits(time.monotonic() + 600, lambda: False), lambda iterate: None)


def in_other_unknowns(
    program: NonlinearProgram, matrix: sparse.csr_array, mixed: np.ndarray
) -> NonlinearProgram:
    """The program in v with w = matrix v; bounds of the ``mixed`` w, which are not single v, become rows."""
    bounded = mixed & (np.isfinite(program.lower) | np.isfinite(program.upper))
    return NonlinearProgram(
        initial=sparse.linalg.spsolve(matrix.tocsc(), program.initial),
        lower=np.where(mixed, -np.inf, program.lower),
        upper=np.where(mixed, np.inf, program.upper),
        linear=sparse.csr_array(sparse.vstack([program.linear @ matrix, matrix[bounded]], format="csr")),
        linear_cost=program.linear_cost @ matrix,
        constraint_lower=np.concatenate([program.constraint_lower, program.lower[bounded]]),
        constraint_upper=np.concatenate([program.constraint_upper, program.upper[bounded]]),
        groups=tuple(
            replace(
                group,
                gather=sparse.csr_array(group.gather @ matrix),
                scatter=sparse.csc_array(
                    sparse.vstack([group.scatter, sparse.csc_array((bounded.sum(), group.scatter.shape[1]))])
                ),
            )
            for group in program.groups
        ),
    )


@pytest.mark.parametrize("J", [1, 2])
def test_both_formulations_have_the_same_optimum(flexible_spacecraft: dict[str, Any], J: int) -> None:
    problem = stated_problem(check_document(flexible_spacecraft).problem)
    transcription = SplineWavelet(
        problem, automatic_scaling(problem), problem.guess, GradedKnots.uniform(8, J)
    )
    program = transcription.program()
    synthesis = SplineWaveletBasis(8, J).synthesis
    rest = sparse.eye_array(program.variables - 2 * synthesis.shape[0])
    matrix = sparse.csr_array(sparse.block_diag([synthesis, synthesis, rest], format="csr"))
    banded = minimise(program)
    mixed = np.arange(program.variables) < 2 * synthesis.shape[0]
    wavelet = minimise(in_other_unknowns(program, matrix, mixed))
    assert wavelet.solver_status == banded.solver_status == "Solve_Succeeded"
    assert abs(wavelet.objective - banded.objective) <= 1e-9
    np.testing.assert_allclose(matrix @ wavelet.unknowns, banded.unknowns, atol=1e-5)
