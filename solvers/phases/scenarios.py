"""One command for several plants over all phases: the flights of all of them together, and each alone.

In every phase the plants are one problem (:mod:`solvers.formulation.plants`); links, and what counts over the
whole flight, stand once for every plant that has a say in them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from solvers.expressions import Expression, named, renamed
from solvers.formulation.implied_ends import relaxed_ends
from solvers.formulation.lifting import lifted
from solvers.formulation.plant_objectives import (
    LEVEL,
    averaged,
    below_level,
    costs_of,
    mean,
    same_objective,
    with_ends,
    with_level,
)
from solvers.formulation.plants import Plant, PlantPart, together
from solvers.formulation.quantities import Constraint, Total
from solvers.formulation.scenarios import NOMINAL, Case, cases_of, implied_warnings
from solvers.phases.peak import below_flight_peak, flight_peak, peaks_of, plus_peak, with_flight_peak
from solvers.phases.problem import Link, Phase, PhasedProblem
from solvers.phases.reading import flight_of
from solvers.phases.trajectory import PhasedTrajectory
from solvers.problem import OptimalControlProblem
from solvers.spec import ProblemSpec


@dataclass(frozen=True)
class FlightPlant:
    """One of the plants: its flight as if it were alone, and, phase by phase, where it is in an answer."""

    name: str
    problem: PhasedProblem
    parts: tuple[Plant, ...]

    def trajectory(self, answer: PhasedTrajectory) -> PhasedTrajectory:
        """The part of an answer that is this plant's, under the plant's own names."""
        pairs = zip(self.parts, answer.parts, strict=True)
        return replace(answer, parts=tuple(plant.trajectory(part) for plant, part in pairs))


@dataclass(frozen=True)
class PhasedFormulation:
    """What is solved for a document with phases: the flight of all plants, and these, the leading first."""

    problem: PhasedProblem
    plants: tuple[FlightPlant, ...]
    implied: tuple[str, ...] = ()
    """States whose ends follow from the others, and are held a little less tightly."""

    @property
    def warnings(self) -> list[dict[str, str]]:
        """What was not held exactly, and why; where corners stay."""
        return [*self.problem.warnings, *implied_warnings(self.implied)]


def formulate_phases(spec: ProblemSpec, tolerance: float = 0.0) -> PhasedFormulation:
    """The flight of a checked document; see :func:`solvers.formulation.scenarios.formulate`."""
    if spec.scenarios is None:
        alone = flight_of(spec)
        return PhasedFormulation(
            with_flight_peak(alone), (FlightPlant("", alone, tuple(phase.plant for phase in alone.phases)),)
        )
    crew = [_member(case, flight_of(case.spec)) for case in cases_of(spec)]
    whole, implied = _implied(_together(crew, spec.scenarios.choice), crew, tolerance)
    plants = tuple(
        FlightPlant(
            own.name, own.flight, tuple(part.plant.with_implied(implied, tolerance) for part in own.parts)
        )
        for own in crew
    )
    return PhasedFormulation(whole, plants, implied)


def _member(case: Case, flight: PhasedProblem) -> _Member:
    """A plant whose peak over the whole flight, if it costs, is below an unknown of its own."""
    parts = [PlantPart.of(case.name, own.plant.problem, case.parameters) for own in flight.phases]
    if flight.peak_cost is not None:
        peaks = [
            peak and renamed(peak, part.names) for part, peak in zip(parts, peaks_of(flight), strict=True)
        ]
        problems = below_flight_peak([part.problem for part in parts], peaks, flight_peak(case.name))
        pairs = zip(parts, problems, strict=True)
        parts = [replace(part, problem=problem) for part, problem in pairs]
    return _Member(case.name, flight, parts)


@dataclass(frozen=True)
class _Member:
    """A plant with its flight and its parts in the problems of the phases."""

    name: str
    flight: PhasedProblem
    parts: Sequence[PlantPart]

    @property
    def names(self) -> dict[str, str]:
        """What is called otherwise along any phase."""
        return {name: new for part in self.parts for name, new in part.names.items()}

    @property
    def ends(self) -> dict[str, str]:
        """What expressions over the whole flight call otherwise."""
        begin = {name: new for name, new in self.parts[0].ends.items() if name.endswith("_0")}
        return {**self.names, **self.parts[-1].ends, **begin}

    @property
    def terminal_cost(self) -> Expression | None:
        """What it costs at the ends of the whole flight, in the names of all plants, and its peak there."""
        cost = self.flight.terminal_cost and renamed(self.flight.terminal_cost, self.ends)
        return cost if self.flight.peak_cost is None else plus_peak(cost, flight_peak(self.name))

    def links(self) -> Iterator[Link]:
        """Its links, in the names of all plants."""
        for link, before, after in zip(self.flight.links, self.parts, self.parts[1:], strict=False):
            yield Link(
                {
                    after.names.get(name, name): renamed(start, before.ends)
                    for name, start in link.starts.items()
                }
            )


def _together(crew: Sequence[_Member], choice: str) -> PhasedProblem:
    """The flight of all plants with the objective that is chosen."""
    first = crew[0].flight
    phases = [list(parts) for parts in zip(*(own.parts for own in crew), strict=True)]
    wholes = [together(parts) for parts in phases]
    ends = [own.terminal_cost for own in crew]
    terminal, totals, limits = ends[0], list(_totals(crew)), list[Constraint]()
    design = first.design
    if first.peak_cost is not None:
        design = (*design, *(flight_peak(own.name) for own in crew))
    same = all(map(same_objective, phases)) and len({cost and cost.text for cost in ends}) == 1
    if choice == "mean" and not same:
        wholes = [averaged(*pair) for pair in zip(wholes, phases, strict=True)]
        terminal = mean(ends)
    elif choice != NOMINAL and not same:
        wholes = [
            with_ends(with_level(whole, parts), parts) for whole, parts in zip(wholes, phases, strict=True)
        ]
        for own, cost in zip(crew, ends, strict=True):
            added_up = costs_of(own.name, wholes)
            totals += [Total(name, "/problem/objective") for name in added_up]
            limits.append(below_level(own.name, cost, added_up))
        terminal, design = named(LEVEL), (*design, LEVEL)
    found = PhasedProblem(
        first.phases,
        tuple(
            Link({name: start for link in links for name, start in link.starts.items()})
            for links in zip(*(own.links() for own in crew), strict=True)
        ),
        {own.names.get(name, name): value for own in crew for name, value in own.flight.parameters.items()},
        design,
        tuple(totals),
        (*_boundary(crew), *limits),
        terminal,
    )
    exact = found.exact_integrals
    phases_of_all = (_phase(own, whole, exact) for own, whole in zip(first.phases, wholes, strict=True))
    return replace(found, phases=tuple(phases_of_all))


def _phase(alone: Phase, whole: OptimalControlProblem, exact: Collection[str]) -> Phase:
    """The phase in which all plants fly."""
    return replace(alone, problem=lifted(whole, exact=exact), plant=Plant(alone.name, whole))


def _totals(crew: Sequence[_Member]) -> Iterator[Total]:
    """The integrals over the whole flight, of every plant where they differ."""
    found: dict[str, Total] = {}
    for own in crew:
        for item in own.flight.totals:
            name = own.names.get(item.name, item.name)
            found.setdefault(name, replace(item, name=name))
    yield from found.values()


def _boundary(crew: Sequence[_Member]) -> Iterator[Constraint]:
    """The constraints on both ends of the flight, of every plant where they differ."""
    seen = set()
    for own in crew:
        for item in own.flight.boundary:
            expression = renamed(item.expression, own.ends)
            key = expression.text, item.interval
            if key not in seen:
                seen.add(key)
                mark = "" if expression is item.expression else f"@{own.name}"
                yield replace(item, pointer=item.pointer + mark, expression=expression)


def _implied(
    flight: PhasedProblem, crew: Sequence[_Member], tolerance: float
) -> tuple[PhasedProblem, tuple[str, ...]]:
    """The flight whose final values are held less tightly where they follow from the others.

    Asked of the last phase where every state is given at the begin of the flight and goes on from phase to
    phase.
    """
    *earlier, last = flight.phases
    given = all(lower == upper for lower, upper in flight.phases[0].problem.initial_state)
    goes_on = all(
        len(link.starts) == len(phase.problem.states)
        for link, phase in zip(flight.links, flight.phases[1:], strict=True)
    )
    if not (given and goes_on):
        return flight, ()
    whole = last.plant.problem
    begin = whole.guess.states_at(whole.guess.states[0][0][:1])[:, 0].tolist()
    pinned = replace(whole, initial_state=tuple(zip(begin, begin, strict=True)))
    relaxed, implied = relaxed_ends(pinned, [own.parts[-1].problem.states for own in crew], tolerance)
    final = _phase(last, replace(whole, final_state=relaxed.final_state), flight.exact_integrals)
    return replace(flight, phases=(*earlier, final)), tuple(implied)
