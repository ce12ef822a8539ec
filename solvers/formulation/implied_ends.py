"""End conditions of several plants that follow from the others, and must not be asked for twice.

Plants that differ in stiffness alone turn alike as a whole: what brings one of them to rest takes the angular
momentum of all to zero. Asked for exactly in every plant, such conditions are dependent but for terms of
second order, and a discretisation contradicts itself; what can be done at second order takes another command
and far longer. So those that follow to first order are held and judged as loosely as on a fixed mesh, however
exact all else is to be, unless the document says by itself what its verification allows; what is not
controllable to first order gains nothing from that. An end that must be closer is said as an interval, which
is held as it is.

What can be reached is the span of B, A B, A^2 B, ... of the linearisation at the end (Kalman), found by
Arnoldi's process in scaled states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.problem import OptimalControlProblem
from solvers.start.scaling import automatic_scaling, end_scales

Vector = NDArray[np.float64]

_DEPENDENT = 1e-6
_STEP = 1e-6
# From rest to rest the fastest moment is twice as fast as the mean.
_FASTEST = 2.0
# The part of what the verification allows that is used.
_SHARE = 0.1


def relaxed_ends(
    problem: OptimalControlProblem, plants: Sequence[Sequence[str]], tolerance: float
) -> tuple[OptimalControlProblem, list[str]]:
    """Widen the final values that follow from the others; ``plants``: the states of each, the leading first.

    ``tolerance``: the relative error of such a final state that is allowed. Returns the problem and
    the names of the states whose ends were widened.
    """
    if any(lower < upper for lower, upper in problem.initial_state):
        return problem, []
    scale = end_scales(problem, automatic_scaling(problem), _FASTEST)
    reachable = _reachable(problem, scale)
    basis, implied = np.zeros((0, reachable.shape[1])), list[int]()
    for number, states in enumerate(plants):
        # Rated controls are states of every plant, and judged with the first.
        own = [name for name in states if number == 0 or name not in plants[0]]
        held = [problem.states.index(name) for name in own]
        held = [index for index in held if problem.final_state[index][0] == problem.final_state[index][1]]
        while held:
            # The most independent one next: what remains is what the others say already.
            rests = [_without(reachable[index], basis) for index in held]
            shares = [_share(rest, reachable[index]) for rest, index in zip(rests, held, strict=True)]
            best = int(np.argmax(shares))
            if shares[best] <= _DEPENDENT:
                implied += held if number else []
                break
            basis = np.vstack([basis, rests[best] / np.linalg.norm(rests[best])])
            del held[best]
    ends = list(problem.final_state)
    for index in implied:
        room = _SHARE * tolerance * scale[index]
        ends[index] = ends[index][0] - room, ends[index][1] + room
    return replace(problem, final_state=tuple(ends)), [problem.states[index] for index in implied]


def relaxed_like(
    problem: OptimalControlProblem, known: OptimalControlProblem, implied: Sequence[str]
) -> OptimalControlProblem:
    """The problem with the ends of these states as much wider as in a ``known`` one with other numbers."""
    ends = list(problem.final_state)
    for index in map(problem.states.index, implied):
        lower, upper = known.final_state[index]
        room = (upper - lower) / 2.0
        ends[index] = ends[index][0] - room, ends[index][1] + room
    return replace(problem, final_state=tuple(ends))


def _without(row: Vector, basis: Vector) -> Vector:
    """The part of a row outside of the span of an orthonormal basis, twice for the sake of rounding."""
    rest = row - basis.T @ (basis @ row)
    return np.asarray(rest - basis.T @ (basis @ rest), np.float64)


def _share(rest: Vector, row: Vector) -> float:
    size = float(np.linalg.norm(row))
    return float(np.linalg.norm(rest)) / size if size > _DEPENDENT else 0.0


def _reachable(problem: OptimalControlProblem, scale: Vector) -> Vector:
    """An orthonormal basis (n, r) of what the controls reach, in scaled states, at the end of the guess."""
    guess, tau = problem.guess, np.ones(1)
    x, u = guess.states_at(tau)[:, 0], guess.controls_at(tau)[:, 0]
    n, m = x.size, u.size
    steps = _STEP * np.concatenate([scale, automatic_scaling(problem).controls])
    offsets = np.hstack([np.diag(steps), -np.diag(steps)])
    inputs = np.concatenate([x, u])[:, None] + offsets
    times = np.full(2 * (n + m), guess.tf)
    parameters = {**problem.parameters, **guess.design}
    with np.errstate(all="ignore"):
        rates = problem.rate(inputs[:n], inputs[n:], times, parameters, NUMPY)
    moved = np.array(np.broadcast_arrays(*rates, times)[:-1], np.float64)
    slopes = (moved[:, : n + m] - moved[:, n + m :]) / (2.0 * _STEP) * (guess.tf - guess.t0)
    slopes = np.nan_to_num(slopes / scale[:, None], posinf=0.0, neginf=0.0)
    a, latest = slopes[:, :n], slopes[:, n:]
    basis = np.zeros((n, 0))
    while latest.shape[1]:
        new = latest - basis @ (basis.T @ latest)
        new = new - basis @ (basis.T @ new)
        left, sizes, _ = np.linalg.svd(new, full_matrices=False)
        latest = left[:, sizes > _DEPENDENT * max(float(np.linalg.norm(latest)), np.finfo(float).tiny)]
        basis = np.hstack([basis, latest])
        latest = a @ latest
    return basis
