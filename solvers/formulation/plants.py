"""Several plants under one command: the problem of all of them together, and each plant's part of an answer.

Every plant has states, parameters, ends and bounds of its own, under names with ``@<plant>`` behind them,
which no document can use. Controls, their rates, times and design parameters are common. What does not depend
on the plant (a path constraint on a control, say) is there once. So the whole is a problem like any other,
and its size is linear in the number of plants.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from solvers.curves import by_nodes
from solvers.expressions import Expression, renamed
from solvers.formulation.data_table import DataTable
from solvers.formulation.dynamics import Body, Dynamics
from solvers.formulation.lifting import bounded_only, with_peak
from solvers.formulation.polar import Pair
from solvers.formulation.quantities import Constraint, Integral, NamedQuantity
from solvers.formulation.two_sided import TwoSides
from solvers.models import Formula
from solvers.phases.trajectory import AnyTrajectory
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory


@dataclass(frozen=True)
class Plant:
    """One of the plants: its ``problem`` as if it were alone, and where its states are in an answer.

    ``names``: what is called otherwise in the problem of all plants -> its name there; ``made``: controls
    that are made of others there; ``implied``: its final states that follow from others, with the relative
    error that is allowed of them.
    """

    name: str
    problem: OptimalControlProblem
    names: Mapping[str, str] = field(default_factory=dict)
    made: tuple[Pair | TwoSides, ...] = ()
    implied: Mapping[str, float] = field(default_factory=dict)

    def with_implied(self, states: Collection[str], limit: float) -> Plant:
        """The same, with those of its ``states`` of the problem of all plants that are implied."""
        own = {name: limit for name in self.problem.states if self.names.get(name) in states}
        return replace(self, implied=own)

    def trajectory(self, answer: Trajectory) -> Trajectory:
        """The part of an answer that is this plant's, under the plant's own names."""
        controls = dict(answer.controls)
        for item in self.made:
            controls |= item.components(answer.controls)
        return replace(
            answer,
            states={name: answer.states[self.names.get(name, name)] for name in self.problem.states},
            controls={name: controls[name] for name in self.problem.controls},
            design={item.name: answer.design[item.name] for item in self.problem.design},
        )

    def solved_from(self, earlier: AnyTrajectory) -> AnyTrajectory:
        """An earlier answer with the controls that are solved for in the place of those that they make."""
        if isinstance(earlier, Trajectory):
            return self._with_made(earlier)
        return replace(earlier, parts=tuple(map(self._with_made, earlier.parts)))

    def _with_made(self, earlier: Trajectory) -> Trajectory:
        points = np.union1d(earlier.nodes, earlier.breakpoints)
        controls = {name: by_nodes(curve, points) for name, curve in earlier.controls.items()}
        for item in self.made:
            if controls.keys() >= set(item.controls):
                found = item.replaced(controls)
                controls = {name: it for name, it in controls.items() if name not in item.controls} | found
        return replace(earlier, controls=controls) if self.made else earlier

    def switching(self, found: Mapping[str, Any]) -> dict[str, Any]:
        """The ``switching`` of this plant's own controls from that of an answer."""
        known = {
            **found,
            **{item.control: item.switching(found) for item in self.made if isinstance(item, TwoSides)},
        }
        return {name: known[name] for name in self.problem.controls if name in known}

    def rows(self, answer: Trajectory) -> list[int]:
        """Where the states of this plant are among those of the answer."""
        every = list(answer.states)
        return [every.index(self.names.get(name, name)) for name in self.problem.states]

    def integrals(
        self, solved: OptimalControlProblem, values: Mapping[str, float], flown: Mapping[str, float]
    ) -> dict[str, float]:
        """This plant's integrals: from ``values`` of the problem ``solved``, else as ``flown`` (NaN: not)."""
        loose = bounded_only(solved)
        names = {item.name: self.names.get(item.name, item.name) for item in self.problem.integrals}
        return {
            name: flown.get(name, math.nan) if inner in loose else values[inner]
            for name, inner in names.items()
        }


@dataclass(frozen=True)
class _RenamedFormula:
    """A formula whose names are called otherwise."""

    formula: Formula
    renaming: Mapping[str, str]

    @property
    def text(self) -> str:
        return f"{self.formula.text} {sorted(self.renaming.items())}"

    @property
    def names(self) -> frozenset[str]:
        return frozenset(self.renaming.get(name, name) for name in self.formula.names)

    def evaluate(self, values: Mapping[str, Any], functions: Any) -> Any:
        own = {name: values[self.renaming.get(name, name)] for name in self.formula.names}
        return self.formula.evaluate(own, functions)


@dataclass(frozen=True)
class PlantPart:
    """A plant with the names that it has in the problem of all; ``problem`` already speaks in these.

    ``ends``: what expressions at the ends call otherwise.
    """

    name: str
    alone: OptimalControlProblem
    problem: OptimalControlProblem
    names: Mapping[str, str]
    ends: Mapping[str, str]

    @property
    def plant(self) -> Plant:
        """The plant by itself."""
        return Plant(self.name, self.alone, self.names)

    @classmethod
    def of(cls, name: str, alone: OptimalControlProblem, parameters: Collection[str]) -> PlantPart:
        """Rename the states, the parameters of this case, and all that depends on them."""
        mine = [state for state in alone.states if state not in alone.rated]
        mine += [acceleration for body in alone.dynamics.bodies for acceleration in body.accelerations]
        mine += [parameter for parameter in alone.parameters if parameter in parameters]
        names = {item: f"{item}@{name}" for item in mine}
        definitions = {}
        for key, formula in alone.definitions.items():
            if formula.names & names.keys():
                names[key] = f"{key}@{name}"
            definitions[names.get(key, key)] = _formula(formula, names)
        along: list[NamedQuantity | Integral] = [*alone.outputs, *alone.integrals]
        names |= {item.name: f"{item.name}@{name}" for item in along if item.expression.names & names.keys()}
        ends = {
            f"{item}{end}": f"{names[item]}{end}"
            for item in [*alone.states, *(output.name for output in alone.outputs)]
            if item in names
            for end in ("_0", "_f")
        }
        ends |= names
        problem = with_peak(_renamed_problem(name, alone, names, ends, definitions), name)
        return cls(name, alone, problem, names, ends)


def _renamed_problem(
    case: str,
    alone: OptimalControlProblem,
    names: Mapping[str, str],
    at_ends: Mapping[str, str],
    definitions: Mapping[str, Formula],
) -> OptimalControlProblem:
    def quantity(item: NamedQuantity | Integral) -> Any:
        expression = renamed(item.expression, names)
        return replace(item, name=names.get(item.name, item.name), expression=expression)

    def held(items: Sequence[Constraint], how: Mapping[str, str]) -> tuple[Constraint, ...]:
        found = []
        for item in items:
            expression = renamed(item.expression, how)
            own = "" if expression is item.expression else f"@{case}"
            found.append(replace(item, pointer=item.pointer + own, expression=expression))
        return tuple(found)

    terminal, running = alone.terminal_cost, alone.running_cost
    return replace(
        alone,
        states=tuple(names.get(name, name) for name in alone.states),
        parameters={names.get(name, name): value for name, value in alone.parameters.items()},
        dynamics=Dynamics(
            tuple(_renamed_body(body, names) for body in alone.dynamics.bodies),
            {
                names.get(name, name): renamed(rate, names)
                for name, rate in alone.dynamics.first_order.items()
            },
        ),
        definitions=definitions,
        path=held(alone.path, names),
        boundary=held(alone.boundary, at_ends),
        terminal_cost=None if terminal is None else renamed(terminal, at_ends),
        running_cost=None if running is None else renamed(running, names),
        peak_cost=None if alone.peak_cost is None else renamed(alone.peak_cost, names),
        outputs=tuple(map(quantity, alone.outputs)),
        integrals=tuple(map(quantity, alone.integrals)),
    )


def _formula(formula: Formula, names: Mapping[str, str]) -> Formula:
    if isinstance(formula, DataTable):
        return formula  # its numbers are those of the case already
    if isinstance(formula, Expression):
        return renamed(formula, names)
    return _RenamedFormula(formula, dict(names)) if formula.names & names.keys() else formula


def _renamed_body(body: Body, names: Mapping[str, str]) -> Body:
    def words(given: Sequence[str]) -> tuple[str, ...]:
        return tuple(names.get(name, name) for name in given)

    def matrix(rows: Any) -> Any:
        return None if rows is None else tuple(tuple(renamed(item, names) for item in row) for row in rows)

    return Body(
        words(body.coordinates),
        words(body.velocities),
        words(body.accelerations),
        body.controls,
        matrix(body.mass),
        matrix(body.input),
        matrix(body.damping),
        matrix(body.stiffness),
        None if body.force is None else tuple(renamed(item, names) for item in body.force),
    )


def together(parts: Sequence[PlantPart]) -> OptimalControlProblem:
    """The problem of all plants, with the objective of the first."""
    problems = [part.problem for part in parts]
    first = problems[0]
    dynamics = Dynamics(
        tuple(body for problem in problems for body in problem.dynamics.bodies),
        # Rated controls, which are common, come last.
        {
            **{name: rate for problem in problems for name, rate in _own_rates(problem)},
            **{name: first.dynamics.first_order[name] for name in first.rated},
        },
    )
    states = dynamics.states

    def for_states(key: str) -> tuple[Any, ...]:
        table = {
            name: item
            for problem in reversed(problems)
            for name, item in zip(problem.states, getattr(problem, key), strict=True)
        }
        return tuple(table[name] for name in states)

    starts = {
        name: piece
        for problem in reversed(problems)
        for name, piece in zip(problem.states, problem.guess.states, strict=True)
    }
    return replace(
        first,
        states=states,
        parameters={name: value for problem in problems for name, value in problem.parameters.items()},
        dynamics=dynamics,
        definitions={name: item for problem in problems for name, item in problem.definitions.items()},
        initial_state=for_states("initial_state"),
        final_state=for_states("final_state"),
        state_bounds=for_states("state_bounds"),
        path=tuple(_distinct(item for problem in problems for item in problem.path)),
        boundary=tuple(_distinct(item for problem in problems for item in problem.boundary)),
        outputs=tuple({item.name: item for problem in problems for item in problem.outputs}.values()),
        integrals=tuple({item.name: item for problem in problems for item in problem.integrals}.values()),
        design=tuple({item.name: item for problem in problems for item in problem.design}.values()),
        guess=replace(first.guess, states=tuple(starts[name] for name in states)),
    )


def _own_rates(problem: OptimalControlProblem) -> Iterator[tuple[str, Expression]]:
    for name, rate in problem.dynamics.first_order.items():
        if name not in problem.rated:
            yield name, rate


def _distinct(constraints: Iterator[Constraint]) -> Iterator[Constraint]:
    """The constraints without those that say the same again, as what depends on no case does."""
    seen = set()
    for item in constraints:
        key = item.expression.text, item.interval, item.during
        if key not in seen:
            seen.add(key)
            yield item
