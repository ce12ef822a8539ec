"""Predictions: the open-loop optimum of a segment, seen with what comes after it.

``lookahead`` starts each prediction from the simulated tracker: the simple model follows the present
segment's reference from its true start, which is known by then. What no control moves is expected to be off
by as much as over the last segment. ``chapter`` starts from the predicted end plus half of the error before.

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solvers.optimizers.ipopt import Ipopt
from solvers.optimizers.outcome import Iterate, Limits, Outcome
from solvers.piecewise.flow import RunawayError
from solvers.piecewise.horizon import Horizon
from solvers.piecewise.mesh import Mesh
from solvers.piecewise.plan import Plan
from solvers.piecewise.reference import Reference
from solvers.piecewise.rehearsal import Rehearsal
from solvers.piecewise.setup import Setup
from solvers.piecewise.simple import SimpleModel
from solvers.piecewise.track import Tracker
from solvers.piecewise.wanted import Wanted
from solvers.status import SolveStatus

Vector = NDArray[np.float64]

CHAPTER_SHARE = 0.5
"""How much of the last error the published scheme adds to its start."""
# A segment of unknown length takes at least this part of the guess, so that nothing divides by zero.
_SHORTEST = 1e-3
# Other bounds will matter than in the prediction before: start far enough from all of them. One segment
# alone, as published, has many optima, some of which tumble: there the nearest one is wanted.
_BARRIER, _BARRIER_NEAR = 0.1, 1e-2


class Predictor:
    """Predicts segment after segment; keeps the last solution as the next guess.

    ``share`` of the last error is what the scheme ``chapter`` adds to its start.
    """

    def __init__(self, setup: Setup, share: float = CHAPTER_SHARE) -> None:
        self._setup = setup
        self._share = share
        self._model: SimpleModel = setup.model
        self._plan: Plan = setup.plan
        self._tracker: Tracker = setup.tracker
        self._rehearsal = Rehearsal(self._model)
        self._horizons: dict[Mesh, Horizon] = {}
        self._optimizers: dict[tuple[Mesh, bool], Ipopt] = {}
        self._solution: tuple[Vector, Vector, Vector] | None = None  # times, states, controls of the last one
        self._ends: list[Vector] = []  # where each segment was expected to end when it began

    def first(self, limits: Limits) -> Reference:
        """The prediction of the first segment, from the document's own start."""
        problem = self._model.problem
        start = np.array([interval[0] for interval in problem.initial_state])
        return self.predict(0, start, problem.initial_time[0], limits)

    def following(self, reference: Reference, true_start: Vector, limits: Limits) -> Reference:
        """The prediction of the segment after ``reference``, which is tracked from ``true_start`` (n,)."""
        started = time.perf_counter()
        if self._setup.scheme == "chapter":
            start = reference.end.copy()
            if self._ends:
                start += self._share * (true_start - self._ends[-1])
            self._ends.append(reference.end)
        else:
            start = self._expected_end(reference, true_start)
        found = self.predict(reference.index + 1, start, float(reference.times[-1]), limits)
        return replace(found, seconds=time.perf_counter() - started)

    def _expected_end(self, reference: Reference, true_start: Vector) -> Vector:
        """Where the simulated tracker ends, and by how much it was wrong of what no control moves."""
        outside = list(self._model.exogenous)
        try:
            self._rehearsal.begin(true_start, reference.times)
            gains = self._tracker.gains(reference)
            end: Vector = self._tracker.follow(reference, gains, self._rehearsal, true_start).states[-1]
        except RunawayError:
            end = reference.end
        start: Vector = end.copy()
        if self._ends:
            start[outside] += true_start[outside] - self._ends[-1][outside]
        self._ends.append(end)
        return start

    def predict(self, index: int, start: Vector, at: float, limits: Limits) -> Reference:
        """The prediction of segment ``index`` from all states at a time.

        Where the bounds cannot be held from this start they are made soft over the whole horizon.
        """
        started = time.perf_counter()
        mesh = self._plan.mesh(index)
        horizon, wanted, outcome = self._solve(index, start, at, limits, mesh)
        if outcome.status is SolveStatus.INFEASIBLE and mesh != mesh.softened():
            horizon, wanted, outcome = self._solve(index, start, at, limits, mesh.softened())
        states, controls, lengths = horizon.read(outcome.unknowns)
        times = at + mesh.times(lengths)
        self._solution = (times, states, controls)
        segment = slice(0, mesh.boundary + 1)
        driven, outside = list(self._model.driven), list(self._model.exogenous)
        whole = np.empty((start.size, mesh.boundary + 1))
        whole[driven], whole[outside] = states[:, segment], wanted.numbers[: len(outside), segment]
        variables, constraints = horizon.size
        return Reference(
            index=index,
            times=times[segment],
            states=whole,
            controls=controls[:, segment],
            numbers=wanted.numbers[:, segment] if self._model.known_times else times[None, segment],
            objective=outcome.objective * self._setup.scales.objective,
            status=outcome.status,
            solver_status=outcome.solver_status,
            iterations=outcome.iterations,
            variables=variables,
            constraints=constraints,
            seconds=time.perf_counter() - started,
        )

    def _solve(
        self, index: int, start: Vector, at: float, limits: Limits, mesh: Mesh
    ) -> tuple[Horizon, Wanted, Outcome]:
        setup = self._setup
        near = setup.scheme == "chapter" and self._solution is not None
        horizon = self._horizons.get(mesh) or Horizon(self._model, mesh, setup.scales, setup.smoothing)
        self._horizons[mesh] = horizon
        wanted = self._wanted(mesh, index, start, at)
        program = horizon.program(wanted)
        optimizer = self._optimizers.get((mesh, near)) or Ipopt(
            program,
            tolerance=setup.tolerance,
            max_iterations=setup.max_iterations,
            warm=near,
            barrier=_BARRIER_NEAR if near else _BARRIER,
            repeated=True,
        )
        self._optimizers[mesh, near] = optimizer
        return horizon, wanted, optimizer.minimise(program, limits, _unheard)

    def _wanted(self, mesh: Mesh, index: int, start: Vector, at: float) -> Wanted:
        setup, plan, model = self._setup, self._plan, self._model
        instants, part = mesh.places
        guess = self._guess(mesh, index, at)
        if model.known_times:
            numbers = model.beforehand(start, at + mesh.times(guess[2]))[:, instants]
            lengths = np.repeat(guess[2][:, None], 2, axis=1)
        else:
            numbers = np.vstack([np.full(part.size, at), mesh.local])
            # Without a rest its length is guessed, and fixed, as zero.
            lengths = np.column_stack([_SHORTEST * guess[2], [np.inf, np.inf if mesh.rest else 0.0]])
        driven = list(model.driven)
        ends = self._ends_of(index)
        problem = model.problem
        closed = np.array([item.interval for item in problem.boundary], np.float64).reshape(-1, 2)
        return Wanted(
            start=start[driven],
            initial=start.tolist(),
            time=at,
            numbers=numbers,
            lower=setup.lower,
            upper=setup.upper,
            segment_end=ends[0],
            horizon_end=ends[1],
            lengths=lengths,
            boundary=closed if plan.sees_the_end(index) else np.tile([-np.inf, np.inf], (closed.shape[0], 1)),
            guess=guess,
        )

    def _ends_of(self, index: int) -> tuple[Vector, Vector]:
        """What the driven states must be where the segment and the horizon end."""
        plan, model = self._plan, self._model
        free = np.tile([-np.inf, np.inf], (len(model.driven), 1))
        segment, horizon = free.copy(), free.copy()
        if plan.sees_the_end(index):
            horizon[:] = [model.problem.final_state[place] for place in model.driven]
        if plan.state is not None:
            place = model.driven.index(plan.state)
            segment[place] = plan.edges[index + 1]
            horizon[place] = plan.edges[plan.last_seen(index) + 1]
        return segment, horizon

    def _guess(self, mesh: Mesh, index: int, at: float) -> tuple[Vector, Vector, Vector]:
        """The last solution from here on, its end held; the document's guess at the beginning."""
        plan, problem = self._plan, self._model.problem
        lengths = self._lengths(index, at)
        times = mesh.times(lengths)
        driven = list(self._model.driven)
        if self._solution is None:
            start, end = problem.guess.t0, problem.guess.tf
            if plan.state is None:
                tau = np.clip((at + times - start) / (end - start), 0.0, 1.0)
            else:
                tau = times / max(times[-1], 1e-300)
                tau *= (plan.last_seen(index) + 1) / plan.count
            return problem.guess.states_at(tau)[driven], problem.guess.controls_at(tau), lengths
        old, states, controls = self._solution
        guessed = [
            np.array([np.interp(at + times, old, row) for row in rows]).reshape(-1, times.size)
            for rows in (states, controls)
        ]
        return guessed[0], guessed[1], lengths

    def _lengths(self, index: int, at: float) -> Vector:
        """Lengths of the segment and of what its prediction sees after it: known, or as guessed."""
        plan, problem = self._plan, self._model.problem
        last = plan.last_seen(index)
        if plan.state is None:
            edges = plan.edges
            return np.array([edges[index + 1] - at, edges[last + 1] - edges[index + 1]])
        if self._solution is None:
            whole = problem.guess.tf - problem.guess.t0
            return np.array([1, last - index]) * whole / plan.count
        times, states, _ = self._solution
        way = states[self._model.driven.index(plan.state)]
        order = np.argsort(way)
        instants = np.interp(plan.edges[[index + 1, last + 1]], way[order], times[order])
        usual = (
            (times[-1] - times[0]) / max(1e-300, abs(way[-1] - way[0])) * abs(plan.edges[1] - plan.edges[0])
        )
        first = max(instants[0] - at, _SHORTEST * usual)
        ahead = max(instants[1] - at - first, 0.5 * usual) if last > index else 0.0
        return np.array([first, ahead])


def _unheard(_: Iterate) -> None:
    """Nobody watches the iterations of a prediction."""
