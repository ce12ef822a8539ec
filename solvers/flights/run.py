"""Flights of the answer in a result, and what they say: percentiles, violations, the worst of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.expressions import parse
from solvers.flights.block import RTOL
from solvers.flights.draws import Draws, draw
from solvers.flights.flown import Flown
from solvers.flights.fly import fly
from solvers.phases.trajectory import trajectory_of
from solvers.progress import Progress, SilentProgress
from solvers.solution import finite, provenance
from solvers.spec import JobSpec, ProblemSpec, check_document
from solvers.spec.flights import FlightsSpec
from solvers.spec.phases import PhaseSpec
from solvers.verification.flight import INTEGRATOR, FlightError
from solvers.verification.legs import rate_costs, rates_of

Vector = NDArray[np.float64]

PERCENTILES = (1, 5, 25, 50, 75, 95, 99)


def run_flights(
    spec: FlightsSpec,
    answered: Mapping[str, Any],
    progress: Progress | None = None,
    seconds: float = np.inf,
) -> Flights:
    """Fly the answer in a stored result as often as ``spec`` says, in ``seconds`` or its ``max_seconds``.

    Raises FlightsStopped where that is not enough or somebody asks to stop, FlightError where not even the
    undisturbed flight comes to its end, and what ``progress`` raises.
    """
    began, deadline = time.perf_counter(), time.monotonic() + min(seconds, spec.max_seconds)
    job = check_document(answered["resolved"]["document"])
    draws = draw(spec)
    blocks = fly(spec, job, trajectory_of(answered), draws, progress or SilentProgress(), deadline)
    if blocks[0].lost[0]:
        raise FlightError("the undisturbed flight does not come to its end")
    return Flights(spec, job, draws, blocks, time.perf_counter() - began)


@dataclass(frozen=True)
class Quantity:
    """A number of the undisturbed flight, and of all runs (P,), NaN for those that were lost."""

    nominal: float
    runs: Vector

    def told(self) -> dict[str, Any]:
        """What a result says of it."""
        values = self.runs[np.isfinite(self.runs)]
        if not values.size:
            return {"nominal": self.nominal, "mean": None, "percentiles": {}}
        found = np.percentile(values, PERCENTILES)
        return {
            "nominal": self.nominal,
            "mean": float(values.mean()),
            "deviation": float(values.std()),
            "min": float(values.min()),
            "max": float(values.max()),
            "percentiles": {str(part): float(value) for part, value in zip(PERCENTILES, found, strict=True)},
        }


@dataclass(frozen=True)
class Limit:
    """A limit of the document: by how much the flights miss it, of which ``tolerance`` counts for nothing."""

    pointer: str
    name: str
    tolerance: float
    missed: Quantity

    @property
    def rate(self) -> float | None:
        """The part of the flights that violate it; None where none was flown to its end."""
        flown = self.missed.runs[np.isfinite(self.missed.runs)]
        return float(np.mean(flown > self.tolerance)) if flown.size else None


@dataclass(frozen=True)
class Flights:
    """All flights of an answer, block after block, and what was drawn for them."""

    spec: FlightsSpec
    job: JobSpec
    draws: Draws
    blocks: Sequence[Flown]
    seconds: float

    def result(self, job_id: str | None = None, source: str | None = None) -> dict[str, Any]:
        """The result: JSON types only; None for what is not known, as of flights that were lost.

        ``source``: the job whose answer was flown.
        """
        plain = {
            "job_id": job_id,
            "kind": "flights",
            "flights_of": source,
            "success": True,
            "status": "converged",
            "message": self._message(),
            "runs": self.spec.runs,
            "lost": int(self._lost.sum()),
            "final_time": self.blocks[0].end,
            "objective": self._objective.told(),
            "final": {name: quantity.told() for name, quantity in self._final.items()},
            "outputs": {
                name: {
                    "final": final.told(),
                    "min": self._lowest[name].told(),
                    "max": self._highest[name].told(),
                }
                for name, final in self._outputs.items()
            },
            "residual": {name: quantity.told() for name, quantity in self._residual.items()},
            "violations": [self._violation(limit) for limit in self._limits],
            "worst": [self._flight(int(run)) for run in self._order[: self.spec.worst]],
            "columns": {name: values.tolist() for name, values in self._columns().items()},
            "warnings": self._warnings(),
            "statistics": {
                "integrator": INTEGRATOR,
                "rtol": RTOL,
                "steps": sum(block.steps for block in self.blocks),
                "seconds": {"total": self.seconds},
            },
            "resolved": {"flights": self.spec.resolved()},
            "provenance": {**provenance(), "seed": self.spec.seed},
        }
        return {key: finite(value) for key, value in plain.items()}

    @cached_property
    def _lost(self) -> NDArray[np.bool_]:
        return np.concatenate([block.lost[1:] for block in self.blocks])

    def _quantity(self, rows: Sequence[Vector]) -> Quantity:
        """A quantity from its values in the blocks, each with the undisturbed flight first."""
        values = np.concatenate([row[1:] for row in rows])
        return Quantity(float(rows[0][0]), np.where(self._lost, np.nan, values))

    def _table(self, pick: Callable[[Flown], Mapping[str, Vector]]) -> dict[str, Quantity]:
        tables = [pick(block) for block in self.blocks]
        return {name: self._quantity([table[name] for table in tables]) for name in tables[0]}

    @cached_property
    def _final(self) -> dict[str, Quantity]:
        return self._table(lambda block: block.final)

    @cached_property
    def _outputs(self) -> dict[str, Quantity]:
        return self._table(lambda block: block.outputs)

    @cached_property
    def _lowest(self) -> dict[str, Quantity]:
        return self._table(lambda block: block.extremes.low)

    @cached_property
    def _highest(self) -> dict[str, Quantity]:
        return self._table(lambda block: block.extremes.high)

    @cached_property
    def _residual(self) -> dict[str, Quantity]:
        return self._table(lambda block: block.swings)

    @cached_property
    def _objective(self) -> Quantity:
        objective = self._quantity([block.objective for block in self.blocks])
        if any(self._rate_costs):
            return Quantity(np.nan, np.full(self.spec.runs, np.nan))
        return objective

    @property
    def _rate_costs(self) -> Iterator[str]:
        """Yield the places of costs that name rates of controls, which no command has."""
        problem = self.job.problem
        for place, part in _parts(problem):
            costs = rate_costs(part.objective, rates_of(problem)) if part.objective is not None else []
            yield from (f"{place}/objective/{key}" for key in costs)

    @cached_property
    def _limits(self) -> list[Limit]:
        return [
            Limit(
                missed.pointer,
                missed.name,
                self.spec.tolerance * missed.scale,
                self._quantity([block.missed[index].excess for block in self.blocks]),
            )
            for index, missed in enumerate(self.blocks[0].missed)
        ]

    @cached_property
    def _badness(self) -> dict[str, Vector]:
        """By how many of its tolerances each run (P,) misses each limit, by pointer.

        Where a document has no limits: how far each state ends from the undisturbed one, as a part of the
        farthest.
        """
        if self._limits:
            return {limit.pointer: limit.missed.runs / limit.tolerance for limit in self._limits}
        off = {name: np.abs(end.runs - end.nominal) for name, end in self._final.items()}
        return {
            name: row / (np.max(row, where=np.isfinite(row), initial=0.0) or 1.0) for name, row in off.items()
        }

    @cached_property
    def _order(self) -> NDArray[np.intp]:
        """The runs, those that were lost and then the worst first."""
        worst = np.max(np.array(list(self._badness.values())), axis=0)
        return np.argsort(-np.where(self._lost, np.inf, worst), kind="stable")

    def _flight(self, run: int) -> dict[str, Any]:
        """What is told of one run: enough to fly it again."""
        lost = bool(self._lost[run])
        worst = max(self._badness, key=lambda name: self._badness[name][run])
        return {
            "run": run,
            "lost": lost,
            "limit": None if lost else worst,
            "tolerances": None if lost else float(self._badness[worst][run]),
            **self.draws.of(run),
            "final": {name: float(quantity.runs[run]) for name, quantity in self._final.items()},
            "residual": {name: float(quantity.runs[run]) for name, quantity in self._residual.items()},
        }

    def _violation(self, limit: Limit) -> dict[str, Any]:
        return {
            "pointer": limit.pointer,
            "name": limit.name,
            "tolerance": limit.tolerance,
            "rate": limit.rate,
            **limit.missed.told(),
        }

    def _columns(self) -> dict[str, Vector]:
        """One value for each run (P,), by column."""
        found: dict[str, Vector] = dict(self.draws.parameters)
        found |= {f"{name}_0": values for name, values in self.draws.initial_state.items()}
        groups = (
            (self._final, "_f"),
            (self._outputs, "_f"),
            (self._lowest, "_min"),
            (self._highest, "_max"),
            ({"objective": self._objective}, ""),
            (self._residual, "_residual"),
        )
        found |= {f"{name}{end}": item.runs for group, end in groups for name, item in group.items()}
        return found | {limit.pointer: limit.missed.runs for limit in self._limits}

    def _message(self) -> str:
        lost = int(self._lost.sum())
        parts = [f"{self.spec.runs:,} flights"]
        if lost:
            parts.append(f"{lost:,} could not be followed to their end")
        parts += [
            f"{100.0 * limit.rate:.3g} % violate {limit.pointer}" for limit in self._limits if limit.rate
        ]
        return "; ".join(parts) + "."

    def _warnings(self) -> list[dict[str, str]]:
        problem, rates = self.job.problem, rates_of(self.job.problem)
        detail = "It names the rate of a control, which no command has: it was not looked at."
        places = [
            f"{place}/{key}/{index}"
            for place, part in _parts(problem)
            for key in ("path_constraints", "outputs")
            for index, item in enumerate(getattr(part, key))
            if not parse(item.expression).names.isdisjoint(rates)
        ]
        return [
            {"code": "not_flown", "pointer": place, "detail": detail}
            for place in [*places, *self._rate_costs]
        ]


def _parts(problem: ProblemSpec) -> list[tuple[str, ProblemSpec | PhaseSpec]]:
    """The problem and its phases, each with its place in the document."""
    phases = [(f"/problem/phases/{index}", phase) for index, phase in enumerate(problem.phases)]
    return [("/problem", problem), *phases]
