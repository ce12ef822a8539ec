"""The problem as a document states it: expressions read, numbers worked out, rates in place of controls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from solvers.expressions import parse
from solvers.formulation.attitude import attitude_constraints, guessed_attitude
from solvers.formulation.data_table import covered_times
from solvers.formulation.dynamics import Dynamics
from solvers.formulation.quantities import FREE, WHOLE_SPAN, Interval
from solvers.formulation.reading import constraints, control_ends, design_parameter, integrals, outputs
from solvers.problem import OptimalControlProblem
from solvers.spec import ProblemSpec, bound_interval, definitions_of, final_intervals, initial_intervals
from solvers.start.guess import make_guess


def stated_problem(spec: ProblemSpec) -> OptimalControlProblem:
    """The problem of a checked document."""
    model = spec.model
    values = model.parameter_values()
    designed = {name: parse(model.parameters[name]) for name in model.depending_on(spec.design)}
    parameters = {
        name: value for name, value in values.items() if name not in designed.keys() | spec.design.keys()
    }
    design = tuple(design_parameter(name, item, values) for name, item in spec.design.items())
    bounds = {name: bound_interval(bound, parameters) for name, bound in spec.bounds.items()}
    initial, final = initial_intervals(spec), final_intervals(spec)
    initial_time = bound_interval(spec.initial_time, parameters)
    final_time = bound_interval(spec.final_time, parameters)
    initial_state = tuple(initial[name] for name in model.states)
    final_state = tuple(final[name] for name in model.states)
    state_bounds = tuple(bounds.get(name, FREE) for name in model.states)
    control_bounds = tuple(bounds.get(name, FREE) for name in model.controls)
    problem = OptimalControlProblem(
        states=model.states,
        controls=model.controls,
        parameters=parameters,
        dynamics=Dynamics.from_model(model),
        # Tables first, for definitions may call them. What follows from a design parameter is worth what
        # that is worth at the end.
        definitions={
            **spec.tables(),
            **designed,
            **definitions_of(spec.submitted_model, model),
        },
        initial_time=initial_time,
        final_time=final_time,
        initial_state=initial_state,
        final_state=final_state,
        state_bounds=state_bounds,
        control_bounds=control_bounds,
        path=constraints(spec, "path_constraints", parameters),
        boundary=(
            *constraints(spec, "boundary_constraints", parameters),
            *attitude_constraints(spec, parameters),
        ),
        terminal_cost=None if spec.objective.terminal is None else parse(spec.objective.terminal),
        running_cost=None if spec.objective.running is None else parse(spec.objective.running),
        outputs=outputs(spec),
        integrals=integrals(spec, parameters),
        design=design,
        peak_cost=None if spec.objective.maximum is None else parse(spec.objective.maximum),
        initial_control=control_ends(spec.initial_control, model.controls, parameters),
        final_control=control_ends(spec.final_control, model.controls, parameters),
        guess=make_guess(
            spec.guess,
            model.states,
            model.controls,
            parameters,
            times=(initial_time, final_time),
            ends=(initial_state, guessed_attitude(spec, parameters, initial_state, final_state)),
            bounds=(state_bounds, control_bounds),
            design={item.name: item.guess for item in design},
        ),
    )
    rates = {name: bound_interval(bound, parameters) for name, bound in spec.control_rates.items()}
    return _with_rates(within_tables(problem), rates)


def within_tables(problem: OptimalControlProblem) -> OptimalControlProblem:
    """The problem whose times are within the tables over time that end in an error.

    As it was where no time is left: what is asked for outside of a table is then an error of its own.
    """
    whole = [item.expression for item in problem.path if item.during == WHOLE_SPAN]
    costs = [item for item in (problem.running_cost, problem.peak_cost) if item is not None]
    along = [*problem.dynamics.expressions, *whole, *(item.expression for item in problem.integrals), *costs]
    first, last = covered_times(along, problem.definitions)
    times = [
        (max(lower, first), min(upper, last)) for lower, upper in (problem.initial_time, problem.final_time)
    ]
    if times == [problem.initial_time, problem.final_time] or any(lower > upper for lower, upper in times):
        return problem
    guess = replace(
        problem.guess,
        t0=float(np.clip(problem.guess.t0, *times[0])),
        tf=float(np.clip(problem.guess.tf, *times[1])),
    )
    return replace(problem, initial_time=times[0], final_time=times[1], guess=guess)


def _with_rates(problem: OptimalControlProblem, rates: Mapping[str, Interval]) -> OptimalControlProblem:
    """The problem in which these controls are states, and their rates, within bounds, are controls."""
    if not rates:
        return problem
    index = [problem.controls.index(name) for name in rates]

    def swapped(old: tuple[Any, ...], new: Callable[[str], Any]) -> tuple[Any, ...]:
        return tuple(
            new(name) if name in rates else item for name, item in zip(problem.controls, old, strict=True)
        )

    def moved(items: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(items[j] for j in index)

    rate_names = {name: f"{name}_dot" for name in rates}
    integrators = {name: parse(rate) for name, rate in rate_names.items()}
    dynamics = problem.dynamics
    return replace(
        problem,
        states=(*problem.states, *rates),
        controls=swapped(problem.controls, rate_names.__getitem__),
        dynamics=replace(dynamics, first_order={**dynamics.first_order, **integrators}),
        initial_state=(*problem.initial_state, *moved(problem.initial_control)),
        final_state=(*problem.final_state, *moved(problem.final_control)),
        state_bounds=(*problem.state_bounds, *moved(problem.control_bounds)),
        control_bounds=swapped(problem.control_bounds, rates.__getitem__),
        initial_control=swapped(problem.initial_control, lambda _: FREE),
        final_control=swapped(problem.final_control, lambda _: FREE),
        guess=problem.guess.with_rates(index),
        rated=tuple(rates),
    )
