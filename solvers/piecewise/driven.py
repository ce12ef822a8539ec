"""Which states of a problem the controls reach."""

from __future__ import annotations

from solvers.problem import OptimalControlProblem


def driven_states(problem: OptimalControlProblem) -> tuple[int, ...]:
    """Indices of the states that a control moves, directly or through others, by the names in their rates.

    Coordinates and velocities of a body always count as driven.
    """
    uses: dict[str, frozenset[str]] = {}
    for name, formula in problem.definitions.items():
        uses[name] = formula.names.union(*(uses[other] for other in formula.names if other in uses))
    reached = set(problem.controls)
    for body in problem.dynamics.bodies:
        reached.update(body.coordinates, body.velocities)
    first_order = {
        name: rate.names.union(*(uses[other] for other in rate.names if other in uses))
        for name, rate in problem.dynamics.first_order.items()
    }
    while True:
        more = {name for name, names in first_order.items() if name not in reached and names & reached}
        if not more:
            break
        reached |= more
    return tuple(index for index, name in enumerate(problem.states) if name in reached)
