"""IPOPT (Waechter and Biegler 2006) through CasADi, watched and stopped between iterations."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from solvers.derivatives import compile_program
from solvers.optimizers.outcome import Iterate, Limits, Outcome, violation
from solvers.program import NonlinearProgram
from solvers.status import SolveStatus

Vector = NDArray[np.float64]

_REPORT_EVERY = 0.1  # seconds; a report copies all rows, which would cost more than a small iteration
# Iterations on few unknowns take less time than asking whether to stop: ask every few of them.
_LONGEST_STEP = 4
_WATCHED_UNKNOWNS = 4000

# Measured on the cases (docs/benchmarks.md): the adaptive barrier needs two thirds of the iterations of the
# monotone one, from a guess and from the answer on a coarser mesh.
_ADAPTIVE = {"ipopt.mu_strategy": "adaptive"}
# From a point that obeys the model, multipliers of bounds begin at barrier / slack, on the central path;
# IPOPT's constant 1 is far from it where a bound does not matter (a fifth of the iterations of the slew and
# its neighbours, two thirds on some adapted meshes). From a mere guess the constant keeps controls away from
# bounds that they need not meet.
_CENTRAL = {"ipopt.bound_mult_init_method": "mu-based"}
# Whether a step solves its linear equations is not looked at: the end of a solve is judged by the error of
# the optimality conditions, and from a guess the iterations stay the same on every case. Exact programs need
# exact steps, and so do those that start near an answer on a fine mesh: rounding lets inexact ones wander at
# the end (two masses on 8,193 points: 43 iterations on the mesh before it for 9, and no end on the last).
_EXACT_BELOW = 1e-9
_MANY_BOUNDS = 600
_FAST = {"ipopt.fast_step_computation": "yes"}
# Near the answer: what all bounds together may give away at the barrier that a solve starts with, in units of
# the objective, which is barrier times number of bounds. A barrier that is the same on every mesh drives fine
# ones away from the answer that they start from (the slew with k = 115 on 16,387 points, for minutes). Exact
# programs start from answers on meshes nearly as good: 8 to 19 iterations on the adapted meshes of the slew,
# where a barrier that falls from 1e-4 takes 20 to 42.
_GIVEN_AWAY, _GIVEN_AWAY_EXACTLY = 3e-2, 3e-3
_HIGHEST_BARRIER = 1e-4
# How far from its bounds a point near the answer is moved before the first iteration; where the barrier only
# falls, hardly at all.
_NEAR = {"ipopt.bound_push": 1e-3, "ipopt.bound_frac": 1e-3}
_NEARER = {"ipopt.bound_push": 1e-4, "ipopt.bound_frac": 1e-4}
_FALLING = {"ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6}
# Where other bounds will matter than at the initial point, it is moved well inside, and says nothing about
# multipliers of rows. On predictions of the piecewise cases 28 iterations are the most, not 83.
_INSIDE = {
    "ipopt.bound_push": 0.1,
    "ipopt.bound_frac": 0.1,
    "ipopt.constr_mult_init_max": 0.0,
}

# Scaled unknowns are of order one; beyond this the optimum is at infinity, and IPOPT's own limit, 1e20, is
# passed too late: steps there are too short to get to it in thousands of iterations.
_DIVERGED = 1e14

# So many operations of all places together are still unrolled: in half a second and 30 MB, to be evaluated in
# two thirds of the time.
_UNROLLED = 100_000

# So far IPOPT itself moves the bounds of fixed unknowns apart where there are more equations than free ones.
_ROOM = 1e-8

# A column is dense from this part of all rows on; the two times are dense by nature and do no harm.
_DENSE_PART = 0.05
_FEW_DENSE = 4

_STATUS = {
    "Solve_Succeeded": SolveStatus.CONVERGED,
    "Solved_To_Acceptable_Level": SolveStatus.CONVERGED,
    "Feasible_Point_Found": SolveStatus.CONVERGED,
    "Infeasible_Problem_Detected": SolveStatus.INFEASIBLE,
    "Maximum_Iterations_Exceeded": SolveStatus.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": SolveStatus.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": SolveStatus.TIME_LIMIT,
    "Invalid_Number_Detected": SolveStatus.EVALUATION_ERROR,
}


class Ipopt:
    """IPOPT on the functions of one program; serves every program of the same structure, one at a time.

    ``warm`` says that initial points are close to solutions, ``obeys`` that they obey the model. ``barrier``:
    where the barrier parameter starts and falls from; by default it adapts. ``repeated``: many programs will
    be solved; small ones are then unrolled, which takes longer once and less every time.
    """

    def __init__(
        self,
        program: NonlinearProgram,
        *,
        tolerance: float,
        max_iterations: int,
        warm: bool = False,
        obeys: bool = False,
        barrier: float | None = None,
        repeated: bool = False,
    ) -> None:
        compiled = compile_program(program)
        if repeated and program.operations <= _UNROLLED:
            compiled = compiled.unrolled()
        self._watcher = _Watcher(program)
        options: dict[str, Any] = {
            "print_time": False,
            "show_eval_warnings": False,
            "error_on_fail": False,
            "iteration_callback": self._watcher,
            "iteration_callback_step": self._watcher.step,
            "grad_f": compiled.gradient,
            "jac_g": compiled.jacobian,
            "hess_lag": compiled.hessian,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": tolerance,
            "ipopt.max_iter": max_iterations,
            # A control that rests on its bound shall not pass it, not even by a rounding of 1e-8.
            "ipopt.bound_relax_factor": 0.0,
            "ipopt.diverging_iterates_tol": _DIVERGED,
            "ipopt.mumps_pivot_order": _ordering(compiled.jacobian.sparsity_out(1)),
        }
        exact = tolerance < _EXACT_BELOW
        bounds = _bounds(program)
        if not exact and not (warm and bounds > _MANY_BOUNDS):
            options |= _FAST
        if barrier is not None:
            options |= {"ipopt.mu_init": barrier} | (_FALLING if warm else _INSIDE)
        else:
            options |= _ADAPTIVE
            if warm:
                options |= (_NEARER if exact else _NEAR) | _CENTRAL
                given_away = _GIVEN_AWAY_EXACTLY if exact else _GIVEN_AWAY
                options["ipopt.mu_init"] = min(_HIGHEST_BARRIER, given_away / max(1, bounds))
            elif obeys:
                options |= _CENTRAL
        self._solver = ca.nlpsol("solver", "ipopt", compiled.program, options)

    def minimise(
        self, program: NonlinearProgram, limits: Limits, report: Callable[[Iterate], None]
    ) -> Outcome:
        """Minimise the program from its initial point.

        Raises whatever ``report`` or ``limits.cancelled`` raised.
        """
        started = time.perf_counter()
        watcher = self._watcher
        watcher.begin(program, limits, report)
        lower, upper = _bounds_with_room(program)
        solution = self._solver(
            x0=program.initial,
            p=program.numbers,
            lbx=lower,
            ubx=upper,
            lbg=program.constraint_lower,
            ubg=program.constraint_upper,
        )
        if watcher.error is not None:
            raise watcher.error
        statistics = self._solver.stats()
        solver_status = str(statistics["return_status"])
        count = int(statistics["iter_count"])
        # Absent where the optimizer has refused the program.
        told = statistics.get("iterations", {"obj": [], "inf_pr": []})
        watched = range(0, count, watcher.step)
        # What has no value at the start leaves zeros behind, which are no values.
        known = 1.0 if told["obj"] else np.nan
        objective = known * float(solution["f"])
        last = (count, objective, known * violation(program, solution["g"].full().ravel()))
        return Outcome(
            unknowns=solution["x"].full().ravel(),
            objective=objective,
            row_multipliers=known * solution["lam_g"].full().ravel(),
            bound_multipliers=known * solution["lam_x"].full().ravel(),
            number_slopes=-known * solution["lam_p"].full().ravel(),
            status=watcher.stopped_by or _STATUS.get(solver_status, SolveStatus.DIVERGED),
            solver_status=solver_status,
            iterations=count,
            iterates=[*zip(watched, told["obj"], told["inf_pr"], strict=False), last],
            seconds=time.perf_counter() - started,
        )


def _bounds_with_room(program: NonlinearProgram) -> tuple[Vector, Vector]:
    """The bounds of the unknowns; where equations outnumber free ones, fixed ones get the room of a rounding.

    IPOPT does that by itself, by its ``bound_relax_factor``; that is 0 here, and then it crashes.
    """
    lower, upper = program.lower, program.upper
    fixed = lower == upper
    equations = np.count_nonzero(program.constraint_lower == program.constraint_upper)
    if np.count_nonzero(~fixed) >= equations:
        return lower, upper
    room = np.where(fixed, _ROOM * np.maximum(1.0, np.abs(lower)), 0.0)
    return lower - room, upper + room


def _bounds(program: NonlinearProgram) -> int:
    """How many bounds of unknowns there are, but those of fixed ones."""
    free = program.lower < program.upper
    return int(sum(np.count_nonzero(free & np.isfinite(side)) for side in (program.lower, program.upper)))


def _ordering(jacobian: ca.Sparsity) -> int:
    """MUMPS's order of pivots: approximate minimum degree; dense columns are set apart where there are some.

    Bands and small blocks are no case for the nested dissection that MUMPS takes by itself (measured up to
    8,000 intervals: up to twice as fast); with the coefficients of global functions among the unknowns, plain
    minimum degree takes up to five times as long.
    """
    columns = np.diff(jacobian.colind())
    dense = np.count_nonzero(columns > _DENSE_PART * jacobian.size1())
    return 6 if dense > _FEW_DENSE else 0


class _Watcher(ca.Callback):
    """Called by IPOPT every ``step`` iterations; a return value of 1 stops it and keeps the iterate."""

    def __init__(self, program: NonlinearProgram) -> None:
        ca.Callback.__init__(self)
        self._sizes = {"x": program.variables, "f": 1, "g": program.constraints}
        self.step = min(_LONGEST_STEP, 1 + _WATCHED_UNKNOWNS // program.variables)
        self.construct("watcher", {})

    def begin(self, program: NonlinearProgram, limits: Limits, report: Callable[[Iterate], None]) -> None:
        """Watch a new solve."""
        self._program, self._limits, self._report = program, limits, report
        self._next_report = 0.0
        self._iterations = 0
        self.stopped_by: SolveStatus | None = None
        self.error: Exception | None = None

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, index: int) -> ca.Sparsity:
        # Empty for what is not looked at: it is then not copied either.
        size = self._sizes.get(ca.nlpsol_out(index), 0)
        return ca.Sparsity.dense(size, 1) if size else ca.Sparsity(0, 0)

    def eval(self, values: Sequence[ca.DM]) -> list[int]:
        self._iterations += self.step
        try:
            return [int(self._watch(values))]
        except Exception as error:  # noqa: BLE001  CasADi swallows it: keep it, stop, raise it after the solve
            self.error = error
            return [1]

    def _watch(self, values: Sequence[ca.DM]) -> bool:
        now = time.monotonic()
        if now >= self._next_report:
            self._next_report = now + _REPORT_EVERY
            objective, infeasibility = float(values[1]), violation(self._program, values[2].full().ravel())
            self._report(Iterate(self._iterations, objective, infeasibility, values[0].full().ravel()))
        self.stopped_by = self._limits.reached
        return self.stopped_by is not None
