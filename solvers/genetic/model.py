"""A problem as computation graphs: what is evaluated along a trajectory, and at its ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from solvers.arrays.graph import Graph, GraphBackend, Symbol
from solvers.expressions import named, parse
from solvers.formulation.quantities import WHOLE_SPAN, Interval
from solvers.genetic.penalties import end_residuals, excess
from solvers.problem import OptimalControlProblem


@dataclass(frozen=True)
class ArrayModel:
    """The graphs of a problem, with its parameters folded in.

    Along the trajectory the inputs are states, controls, design parameters, ``t`` and ``tau``; at the ends
    ``<state>_0``, ``<state>_f``, likewise of controls, design parameters, integrals, ``t0`` and ``tf``.
    """

    problem: OptimalControlProblem

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the values along the trajectory."""
        return (*self.problem.states, *self.problem.controls, *self.design, "t", "tau")

    @property
    def design(self) -> tuple[str, ...]:
        """The names of the design parameters."""
        return tuple(item.name for item in self.problem.design)

    @property
    def end_inputs(self) -> tuple[str, ...]:
        """The names of the values at the ends."""
        names = (*self.problem.states, *self.problem.controls)
        integrals = [item.name for item in self.problem.integrals]
        both = [f"{name}{suffix}" for suffix in ("_0", "_f") for name in names]
        return (*both, *self.design, *integrals, "t0", "tf")

    @cached_property
    def rates(self) -> list[Symbol]:
        """The rates of the states."""
        return [self._graph.symbol(rate) for rate in self.problem.dynamics.rate(self._scope, self._backend)]

    @cached_property
    def running_cost(self) -> Symbol:
        """The running cost, 0 where there is none."""
        cost = self.problem.running_cost
        return self._graph.symbol(0.0 if cost is None else cost.evaluate(self._scope, self._functions))

    @cached_property
    def integrands(self) -> list[Symbol]:
        """The integrands of the integrals."""
        return [
            self._graph.symbol(item.expression.evaluate(self._scope, self._functions))
            for item in self.problem.integrals
        ]

    @cached_property
    def violation(self) -> Symbol:
        """The sum of the squares of how far bounds and path constraints are not kept."""
        problem = self.problem
        names = (*problem.states, *problem.controls)
        bounds = zip(names, (*problem.state_bounds, *problem.control_bounds), strict=True)
        held = [(named(name), interval, WHOLE_SPAN) for name, interval in bounds]
        held += [(item.expression, item.interval, item.during) for item in problem.path]
        total = self._graph.constant(0.0)
        for expression, interval, during in held:
            for beyond in excess(expression, interval):
                value = self._graph.symbol(beyond.evaluate(self._scope, self._functions))
                total = total + value * value * self._within(during)
        return total

    @cached_property
    def ends(self) -> list[Symbol]:
        """The terminal cost, 0 where there is none, and the residuals of the end conditions."""
        problem, graph = self.problem, Graph()
        backend = GraphBackend(graph)

        def inputs(names: Sequence[str], suffix: str = "") -> list[Symbol]:
            return [graph.input(f"{name}{suffix}") for name in names]

        scope = problem.ends_scope(
            (inputs(problem.states, "_0"), inputs(problem.controls, "_0"), graph.input("t0")),
            (inputs(problem.states, "_f"), inputs(problem.controls, "_f"), graph.input("tf")),
            self._parameters(graph),
            backend,
            inputs([item.name for item in problem.integrals]),
        )
        cost = problem.terminal_cost
        expressions = [*([parse(0)] if cost is None else [cost]), *end_residuals(problem)]
        return [graph.symbol(item.evaluate(scope, backend.functions)) for item in expressions]

    @cached_property
    def _graph(self) -> Graph:
        return Graph()

    @cached_property
    def _backend(self) -> GraphBackend:
        return GraphBackend(self._graph)

    @property
    def _functions(self) -> Mapping[str, Callable[..., Any]]:
        return self._backend.functions

    @cached_property
    def _scope(self) -> dict[str, Any]:
        problem, graph = self.problem, self._graph
        states, controls = (
            [graph.input(name) for name in names] for names in (problem.states, problem.controls)
        )
        parameters = self._parameters(graph)
        return problem.scope(states, controls, graph.input("t"), parameters, self._backend)

    def _parameters(self, graph: Graph) -> dict[str, Any]:
        """Numbers, and inputs for design parameters."""
        return {**self.problem.parameters, **{name: graph.input(name) for name in self.design}}

    def _within(self, during: Interval) -> Symbol:
        """1 inside of a part of normalised time, 0 outside."""
        one = self._graph.constant(1.0)
        if during == WHOLE_SPAN:
            return one
        tau, (start, stop) = self._graph.input("tau"), during
        begun, ended = ((one + self._graph.apply("sign", gap)) / 2.0 for gap in (tau - start, stop - tau))
        return begun * ended
