"""From the genes that were found to a trajectory, and from there by gradients to a better one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solvers.coefficients.codec import with_middles
from solvers.coefficients.daubechies import describe
from solvers.curves import DaubechiesCurve, HermiteCurve
from solvers.genetic.fitness import Fitness
from solvers.genetic.model import ArrayModel
from solvers.genetic.penalties import with_penalised_end
from solvers.genetic.residual import scale_of
from solvers.genetic.runge_kutta import RungeKuttaSimulator
from solvers.genetic.search import Found
from solvers.session import Session
from solvers.solved import Solved
from solvers.spec import GeneticMethod
from solvers.start.guess import Start
from solvers.trajectory import Trajectory
from solvers.transcription.daubechies_controls import DaubechiesControls

Vector = NDArray[np.float64]

# A search that has met its end to this part of the scale of the states is near its optimum.
_NEAR = 0.05


@dataclass(frozen=True)
class Simulation:
    """An individual as it flies: its trajectory, its objective without penalties, its integrals by name."""

    trajectory: Trajectory
    objective: float
    integrals: Mapping[str, float]


def fly(model: ArrayModel, found: Found) -> Simulation:
    """Simulate what was found on the points of its answer, the controls cut off at their bounds."""
    problem, basis = model.problem, found.genome.basis
    level = basis.answer_level
    simulator = RungeKuttaSimulator(model, found.genome, level, clipped=True)
    individuals = found.genome.read(found.genes[None, :])
    with np.errstate(all="ignore"):
        paths, simulated = simulator.fly(individuals)
        evaluation = Fitness(model, found.genome, simulator, 0.0).judge(individuals, simulated)
    states, integrals = paths[:, 0], simulated.integrals[:, 0]
    # Where the model has no value, a flight stays at its start: there the diagnosis looks for the reason.
    states = np.where(np.isfinite(states), states, individuals.initial)
    t0, tf = float(individuals.t0[0]), float(individuals.tf[0])
    knots = basis.points(level)
    controls = {
        name: DaubechiesCurve(basis, level, coefficients)
        for name, coefficients in zip(problem.controls, individuals.coefficients[0], strict=True)
    }
    design = dict(zip(model.design, map(float, individuals.design[:, 0]), strict=True))
    flat = np.zeros_like(knots)
    trajectory = Trajectory(
        t0,
        tf,
        {name: HermiteCurve(knots, row, flat) for name, row in zip(problem.states, states, strict=True)},
        controls,
        interpolation="quadratic",
        basis=describe(basis, level),
        breakpoints=knots,
        nodes=with_middles(knots),
        design=design,
    )
    slopes = (tf - t0) * problem.rates_at(trajectory, knots)
    slopes[~np.isfinite(slopes)] = 0.0
    curves = {
        name: HermiteCurve(knots, row, slope)
        for name, row, slope in zip(problem.states, states, slopes, strict=True)
    }
    names = [item.name for item in problem.integrals]
    return Simulation(
        replace(trajectory, states=curves),
        float(evaluation.objective[0]),
        dict(zip(names, map(float, integrals), strict=True)),
    )


def polish(
    session: Session,
    method: GeneticMethod,
    found: Found,
    start: Trajectory,
    residual: float,
    share: tuple[float, float],
) -> Solved:
    """Minimise in the same basis by gradients, from the trajectory of what was found.

    With the end conditions as equations, or, where the method says so, with their squares in the cost. A
    search that ended far from where its end shall be is no warm start, and may lead nowhere: then from the
    guess of the document.
    ``share``: the part of all work that it is, from and to. Raises what the session's progress raises.
    """
    problem, basis = session.problem, found.genome.basis
    if method.polish == "penalty":
        problem = with_penalised_end(problem, method.penalty)
    near = method.polish == "penalty" or residual <= _NEAR * scale_of(start)

    def solved_from(begin: Start, *, warm: bool) -> Solved:
        transcription = DaubechiesControls(problem, session.scaling, begin, basis, basis.answer_level)
        return session.solve_parts([transcription], "polish", share, warm=warm)

    solved = solved_from(start, warm=near)
    if solved.converged or solved.stopped:
        return solved
    return solved_from(problem.guess, warm=False)
