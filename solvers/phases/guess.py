"""Where the phases of a flight start: what each says, else straight lines over all of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from solvers.formulation.quantities import Interval
from solvers.problem import OptimalControlProblem
from solvers.spec import ProblemSpec, evaluate_constant, fields_of, inside, written_out
from solvers.start.guess import WHOLE, Guess, default_final_time

_GROUPS = "states", "controls"

Begin = Callable[[int, Any], Mapping[str, float]]
"""States with which a phase begins, from its index and the end (x, u, t) of the phase before."""


def phase_times(
    spec: ProblemSpec, fields: Sequence[Mapping[str, Any]], interval: Callable[[Any, Any], Interval]
) -> list[Interval]:
    """Begin and end of every phase in the guess: as given, else fixed, else as in an earlier result.

    Else evenly between those known.
    """
    stops = [interval(item["final_time"], item["model"]) for item in fields]
    start = inside(interval(spec.initial_time, spec.submitted_model))
    known = [start, *(_known_end(item, stop) for item, stop in zip(fields, stops, strict=True))]
    parameters = spec.model.parameter_values()
    last = known[-1]
    if last is None:
        given = spec.guess.final_time
        if given is None and spec.guess.from_result is not None:
            given = spec.guess.from_result["t"][-1]
        # The last phase begins when the one before may have ended.
        earlier = [*known[:-1], *(lower for lower, _ in stops[:-1])]
        begin = max(value for value in earlier if value is not None)
        known[-1] = last = (
            default_final_time((max(stops[-1][0], begin), stops[-1][1]), begin)
            if given is None
            else evaluate_constant(given, parameters)
        )
    parts = nodes_by_phase(spec, len(stops))
    edges = [nodes["t"][0] for nodes in parts] + [parts[-1]["t"][-1]] if parts else []
    for index, time in enumerate(_stretched(edges, (start, last), parameters)):
        if known[index] is None:
            known[index] = float(np.clip(time, *stops[index - 1]))
    fixed = {index: value for index, value in enumerate(known) if value is not None}
    ends = np.interp(np.arange(len(known)), [*fixed], [*fixed.values()])
    for index, stop in enumerate(stops, 1):
        if index not in fixed:
            ends[index] = float(np.clip(ends[index], *stop))
    return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))


def nodes_by_phase(spec: ProblemSpec, count: int) -> list[dict[str, Any]]:
    """The nodes of a result phase by phase, with what each has; none unless it had so many phases."""
    nodes = spec.guess.from_result
    if nodes is None:
        return []
    times = [evaluate_constant(time, spec.model.parameter_values()) for time in nodes["t"]]
    edges = [0, *(i for i in range(1, len(times)) if times[i] == times[i - 1]), len(times)]
    if len(edges) != count + 1:
        return []
    return [
        {
            "t": nodes["t"][begin:end],
            **{
                group: {
                    name: values[begin:end]
                    for name, values in nodes.get(group, {}).items()
                    if values and values[begin] is not None
                }
                for group in _GROUPS
            },
        }
        for begin, end in pairwise(edges)
    ]


def histories(spec: ProblemSpec, span: Interval, count: int) -> dict[str, dict[str, Any]]:
    """What the document guesses of the whole flight, between these times, with times for each history.

    Without the nodes of a result that had as many phases (``count``): each of these begins from its own.
    """
    guess, parameters = spec.guess, spec.model.parameter_values()
    nodes = {} if nodes_by_phase(spec, count) else guess.from_result or {}
    times = _stretched(nodes.get("t", []), span, parameters)
    found: dict[str, dict[str, Any]] = {}
    for group in _GROUPS:
        found[group] = {
            name: {
                "times": [times[i] for i in having],
                "values": [values[i] for i in having],
            }
            for name, values in nodes.get(group, {}).items()
            if (having := [i for i, value in enumerate(values) if value is not None])
        }
        for name in getattr(guess, group):
            own, values = guess.history(name, parameters) or (None, [])
            evenly = np.linspace(*span, len(values)).tolist()
            found[group][name] = {"times": evenly if own is None else own, "values": values}
    return found


def _stretched(times: Sequence[Any], span: Interval, parameters: dict[str, float]) -> list[float]:
    own = np.array([evaluate_constant(time, parameters) for time in times])
    return list(np.interp(own, own[[0, -1]], span)) if times else []


def _known_end(fields: Mapping[str, Any], stop: Interval) -> float | None:
    given = fields_of(fields["guess"]).get("final_time")
    if given is not None:
        return evaluate_constant(given, written_out(fields["model"]).parameter_values())
    return stop[0] if stop[0] == stop[1] else None


def chained_guesses(
    problems: Sequence[OptimalControlProblem], said: Sequence[Collection[str]], begin: Begin
) -> list[Guess]:
    """The guesses of the phases, each beginning where the one before ends.

    ``said``: the states of which the document says how they go in a phase. Others go by straight lines to the
    next end of a phase where a state of that name is known.
    """
    guesses: list[Guess] = []
    for index, problem in enumerate(problems):
        guess = problem.guess
        pieces = list(guess.states)
        started = begin(index, _end(guesses[-1])) if index else {}
        for i, name in enumerate(problem.states):
            if name in said[index]:
                continue
            first = float(pieces[i][1][0])
            if not _is_known(problem.initial_state[i]) and name in started:
                first = started[name]
            if not index and not _is_known(problem.initial_state[i]):
                ahead = next(_known_ahead(problems, index, name), None)
                first = first if ahead is None else ahead[1]
            last = _target(problems, index, name, first)
            pieces[i] = WHOLE, np.clip([first, last], *problem.state_bounds[i])
        guesses.append(replace(guess, states=tuple(pieces)))
    return guesses


def _target(problems: Sequence[OptimalControlProblem], index: int, name: str, first: float) -> float:
    """The value of a state at the end of a phase, on the line to where it is known next."""
    ahead = next(_known_ahead(problems, index, name), None)
    if ahead is None:
        return first
    start, stop = problems[index].guess.t0, problems[index].guess.tf
    time, value = ahead
    share = (stop - start) / (time - start) if time > start else 1.0
    return first + share * (value - first)


def _known_ahead(
    problems: Sequence[OptimalControlProblem], index: int, name: str
) -> Iterator[tuple[float, float]]:
    """Times and values at which a state is known from the end of a phase on, next ones first."""
    for later, problem in enumerate(problems[index:], index):
        if name not in problem.states:
            return
        at = problem.states.index(name)
        if later > index and _is_known(problem.initial_state[at]):
            yield problem.guess.t0, inside(problem.initial_state[at])
        if _is_known(problem.final_state[at]):
            yield problem.guess.tf, inside(problem.final_state[at])


def _is_known(interval: Interval) -> bool:
    return bool(np.isfinite(interval).any())


def _end(guess: Guess) -> tuple[Any, Any, float]:
    at = np.ones(1)
    return guess.states_at(at)[:, 0], guess.controls_at(at)[:, 0], guess.tf
