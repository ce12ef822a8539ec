"""Newton's method for programs whose equations leave nothing to choose.

Where controls rest on their bounds along arcs, and the instants between arcs are as many as the conditions on
them, a program has as many equations as free unknowns. What solves these is the optimum, for it has no
neighbours, and its multipliers follow from the same matrix, J' lambda = -dJ/dw: neither a barrier nor second
derivatives are needed.

Factors are kept once the equations are nearly solved: Deuflhard, Newton Methods for Nonlinear Problems,
Springer 2004, 2.1 (simplified Newton).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from solvers.derivatives import compile_program
from solvers.optimizers.outcome import Iterate, Limits, Outcome, violation
from solvers.program import NonlinearProgram
from solvers.status import SolveStatus

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A step that does not bring the equations down by this factor leads nowhere.
_CONTRACTS = 0.5
# From here on the last factors serve, for the unknowns and, with refinement, for the multipliers.
_NEARLY_SOLVED = 1e-6
_REFINEMENTS = 4


class Newton:
    """Newton's method on the functions of one program; serves every program of the same structure.

    Inequalities are not looked at on the way. An end that violates one counts as diverged, and so do a way
    that leads nowhere and equations that are more or fewer than the free unknowns.
    """

    def __init__(self, program: NonlinearProgram, *, tolerance: float) -> None:
        compiled = compile_program(program)
        w, p = ca.MX.sym("w", program.variables), ca.MX.sym("p", program.numbers.size)
        multipliers = ca.MX.sym("lambda", program.constraints)
        objective, rows = compiled.program(w, p)
        slopes = compiled.jacobian(w, p)[1]
        lagrangian = objective + ca.dot(multipliers, rows)
        self._tolerance = tolerance
        self._values = _Evaluation([w, p], [objective, rows])
        self._gradient = _Evaluation([w, p], [compiled.gradient(w, p)[1]])
        self._entries = _Evaluation([w, p], [slopes.nz[:]])
        self._number_slopes = _Evaluation([w, p, multipliers], [ca.gradient(lagrangian, p)])
        pattern = slopes.sparsity()
        # In place of each entry of the Jacobian its number, counted from 1.
        self._numbers = sparse.csc_array(
            (np.arange(1, pattern.nnz() + 1), pattern.row(), pattern.colind()), pattern.shape
        )

    def minimise(
        self, program: NonlinearProgram, limits: Limits, report: Callable[[Iterate], None]
    ) -> Outcome:
        """See :class:`Optimizer`."""
        started = time.perf_counter()
        equations, free = _equations(program), _free(program)
        unknowns, factors, before = np.clip(program.initial, program.lower, program.upper), None, np.inf
        square = self._numbers[equations][:, free]
        told, status = list[tuple[int, float, float]](), None
        while status is None:
            value, rows = self._values(unknowns, program.numbers)
            misses = (rows - program.constraint_lower)[equations]
            size = float(np.abs(misses).max(initial=0.0))
            told.append((len(told), float(value[0]), size))
            report(Iterate(*told[-1], unknowns))
            if factors is None or size > _NEARLY_SOLVED:
                (entries,) = self._entries(unknowns, program.numbers)
                factors = _factors(_with(square, entries[square.data - 1]))
            if factors is not None and size <= self._tolerance:
                inside = max(_outside(program, unknowns), violation(program, rows)) <= self._tolerance
                status = SolveStatus.CONVERGED if inside else SolveStatus.DIVERGED
            elif factors is None or not size <= _CONTRACTS * before:
                status = SolveStatus.DIVERGED
            else:
                status = limits.reached
                unknowns, before = unknowns.copy(), size
                unknowns[free] -= factors.solve(misses)
        multipliers = np.zeros(program.constraints), np.zeros(program.variables)
        if status is SolveStatus.CONVERGED and factors is not None:
            multipliers = self._multipliers(program, unknowns, factors)
        (number_slopes,) = self._number_slopes(unknowns, program.numbers, multipliers[0])
        return Outcome(
            unknowns,
            told[-1][1],
            *multipliers,
            number_slopes=number_slopes,
            status=status,
            solver_status="Solve_Succeeded" if status is SolveStatus.CONVERGED else status.value,
            iterations=len(told) - 1,
            iterates=told,
            seconds=time.perf_counter() - started,
            solver="newton",
        )

    def _multipliers(
        self, program: NonlinearProgram, unknowns: Vector, factors: SuperLU
    ) -> tuple[Vector, Vector]:
        """Those of the rows and of the bounds, from factors of a matrix nearby."""
        equations, free = _equations(program), _free(program)
        (entries,), (gradient,) = (
            call(unknowns, program.numbers) for call in (self._entries, self._gradient)
        )
        slopes, of_rows = _with(self._numbers, entries).T, np.zeros(equations.size)
        rest = gradient
        for _ in range(_REFINEMENTS):
            of_rows[equations] -= factors.solve(rest[free], trans="T")  # type: ignore[call-overload]  # missing in the stubs
            rest = gradient + slopes @ of_rows
        return of_rows, np.where(free, 0.0, -rest)


class _Evaluation:
    """A CasADi function of vectors whose values come as vectors, without the matrices of CasADi between."""

    def __init__(self, arguments: Sequence[ca.MX], values: Sequence[ca.MX]) -> None:
        self._function = ca.Function("values", arguments, [ca.densify(value) for value in values])
        self._buffer, self._run = self._function.buffer()

    def __call__(self, *arguments: Vector) -> list[Vector]:
        given = [np.ascontiguousarray(argument, np.float64) for argument in arguments]
        found = [np.empty(self._function.numel_out(index)) for index in range(self._function.n_out())]
        for index, vector in enumerate(given):
            self._buffer.set_arg(index, vector.data)  # type: ignore[call-arg]  # the stubs know pointers
        for index, vector in enumerate(found):
            self._buffer.set_res(index, vector.data)  # type: ignore[call-arg]
        self._run()
        return found


def _free(program: NonlinearProgram) -> Flags:
    return np.asarray(program.lower < program.upper, np.bool_)


def _equations(program: NonlinearProgram) -> Flags:
    return np.asarray(program.constraint_lower == program.constraint_upper, np.bool_)


def _with(matrix: sparse.csc_array, entries: Vector) -> sparse.csc_array:
    """A matrix of the same pattern with these entries."""
    return sparse.csc_array((entries, matrix.indices, matrix.indptr), matrix.shape)


def _factors(matrix: sparse.csc_array) -> SuperLU | None:
    """The factors of a matrix; None if it is not square, singular, or not finite."""
    try:
        return splu(matrix)
    except (RuntimeError, ValueError):
        return None


def _outside(program: NonlinearProgram, unknowns: Vector) -> float:
    """How far an unknown is out of its bounds at most."""
    return float(np.max(np.abs(unknowns - np.clip(unknowns, program.lower, program.upper)), initial=0.0))
