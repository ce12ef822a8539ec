"""The program of a flight of phases: the programs of all phases side by side, and the rows that join them.

Unknowns: those of the phases one after the other, each with times of its own. Rows: those of the phases,
then the joints: t0_(k+1) = tf_k; the states with which a phase begins; design parameters that phases share;
integrals over the whole flight; boundary constraints and terminal cost of the whole flight. The program stays
partially separable (:mod:`solvers.program`), so that phases cost what they cost alone.
"""

from __future__ import annotations

import copy
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.phases.joined import side_by_side
from solvers.phases.problem import Link, PhasedProblem, meet_when_given, start_after
from solvers.phases.trajectory import PhasedTrajectory
from solvers.program import NonlinearProgram
from solvers.start.scaling import magnitude
from solvers.symbolic import CASADI
from solvers.transcription.assembly import columns
from solvers.transcription.base import Transcription
from solvers.transcription.builder import ProgramBuilder, fixed

Vector = NDArray[np.float64]


@dataclass
class PhasedBuilder:
    """The builders of the phases, and that of their joints."""

    parts: tuple[ProgramBuilder, ...]
    joints: ProgramBuilder = field(default_factory=ProgramBuilder)

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return sum(part.size for part in self.parts)

    @property
    def row_count(self) -> int:
        """The number of rows."""
        return sum(part.row_count for part in self.parts) + self.joints.row_count


class PhasedTranscription:
    """Phases on meshes, to be solved together."""

    def __init__(self, problem: PhasedProblem, parts: Sequence[Transcription]) -> None:
        self.problem, self.parts = problem, tuple(parts)
        self._joints = ProgramBuilder()

    @property
    def builder(self) -> PhasedBuilder:
        """What keeps the matrices; one of the same structure may take its place."""
        return PhasedBuilder(tuple(part.builder for part in self.parts), self._joints)

    @builder.setter
    def builder(self, known: PhasedBuilder) -> None:
        self._joints = known.joints
        for part, builder in zip(self.parts, known.parts, strict=True):
            part.builder = builder

    @property
    def key(self) -> Hashable:
        """See :attr:`~solvers.transcription.base.Transcription.key`."""
        problem = self.problem
        intervals = [item.interval for item in problem.boundary] + [item.interval for item in problem.totals]
        sizes = tuple(map(magnitude, intervals))
        return "phases", tuple(part.key for part in self.parts), self.problem.structure, self._given, sizes

    @property
    def objective_scale(self) -> float:
        """What the objective of the program is multiplied by to give that of the document."""
        return self.parts[0].objective_scale

    def of(self, problem: PhasedProblem) -> Self:
        """The same transcription, with its builder, of a problem that differs in numbers only."""
        twin = copy.copy(self)
        twin.problem = problem
        pairs = zip(self.parts, problem.phases, strict=True)
        twin.parts = tuple(part.of(phase.problem) for part, phase in pairs)
        return twin

    def program(self, initial: Vector | None = None) -> NonlinearProgram:
        """The scaled program, to be solved from the start, or from the scaled unknowns ``initial``."""
        starts = [None] * len(self.parts) if initial is None else self.shares(initial)
        programs = [part.program(start) for part, start in zip(self.parts, starts, strict=True)]
        if not self._joints.size:
            self._join()
        return side_by_side(programs, self._joints.program(self, self.objective_scale))

    def trajectory(self, scaled: Vector) -> PhasedTrajectory:
        """The trajectory of a (scaled) solution of the program."""
        pairs = zip(self.parts, self.shares(scaled), strict=True)
        return PhasedTrajectory(
            tuple(part.trajectory(own) for part, own in pairs),
            tuple(phase.name for phase in self.problem.phases),
        )

    def sketch(self, scaled: Vector, samples: int) -> dict[str, Any]:
        """The trajectory of (scaled) unknowns on a grid of so many samples."""
        trajectory = self.trajectory(scaled)
        return trajectory.sample(np.linspace(trajectory.t0, trajectory.tf, samples))

    def shares(self, unknowns: Vector) -> list[Vector]:
        """The unknowns (or what belongs to each of them) phase by phase."""
        return np.split(unknowns, self._unknowns[1:-1])

    def row_shares(self, rows: Vector) -> list[Vector]:
        """What belongs to the rows of each phase."""
        return np.split(rows, list(accumulate(part.builder.row_count for part in self.parts)))[:-1]

    @property
    def _unknowns(self) -> list[int]:
        """Where the unknowns of each phase begin, and where the last ones end."""
        return [0, *accumulate(part.builder.size for part in self.parts)]

    @property
    def _given(self) -> tuple[bool, ...]:
        """For each meeting of two phases whether its time is given, so that no row is needed."""
        return tuple(meet_when_given(before.problem, after.problem) for before, after in pairwise(self.parts))

    def _join(self) -> None:
        builder, problem = self._joints, self.problem
        builder.unknowns(
            "phases",
            (self.builder.size, 1),
            scale=np.concatenate([part.builder.scale for part in self.parts]),
            initial=lambda _: 0.0,
            bounds=fixed(-np.inf, np.inf),
        )
        for index, (before, after) in enumerate(pairwise(self.parts)):
            end, start = self._scalars(index, "times")[1], self._scalars(index + 1, "times")[0]
            if not self._given[index]:
                builder.constrain(fixed(0.0, 0.0), scale=after.scaling.time, linear=_sum(start, -end))
            self._link(problem.links[index], index, before, after)
        self._share_design()
        for number, item in enumerate(problem.totals):
            rows = self._total_rows(number)
            builder.constrain(_total_bounds(number), scale=magnitude(item.interval), linear=_sum(*rows))
        self._add_ends()

    def _link(self, link: Link, index: int, before: Transcription, after: Transcription) -> None:
        """Let a phase begin as the link says."""
        if not link.starts:
            return
        ends = [_Symbols(before), _Symbols(after)]
        p = ca.SX.sym("p", len(before.problem.parameters))
        parameters = dict(zip(before.problem.parameters, ca.vertsplit(p), strict=True)) | ends[0].design
        values = start_after(link, before.problem, ends[0].at("tf"), parameters, CASADI)
        begins = dict(zip(after.problem.states, ends[1].x, strict=True))
        gaps = ca.vertcat(*[begins[name] - value for name, value in values.items()])
        z = ca.vertcat(ends[0].z, ends[1].z)
        places = self._joints.apply(
            ca.Function("link", [z, p], [gaps]),
            [*self._ends(index, -1), *self._ends(index + 1, 0)],
            lambda this: this.parts[index].parameter_columns(1),
        )
        scales = dict(zip(after.problem.states, after.scaling.states, strict=True))
        self._joints.constrain(fixed(0.0, 0.0), scale=[scales[name] for name in values], places=places)

    def _share_design(self) -> None:
        """Let a design parameter be the same in every phase that has it."""
        for name in self.problem.design:
            rows = [
                (self._scalars(k, "design")[index], part.scaling.design[index])
                for k, part in enumerate(self.parts)
                for index, item in enumerate(part.problem.design)
                if item.name == name
            ]
            for (first, _), (second, scale) in pairwise(rows):
                self._joints.constrain(fixed(0.0, 0.0), scale=scale, linear=_sum(second, -first))

    def _add_ends(self) -> None:
        """Add the boundary constraints and the terminal cost of the whole flight."""
        problem, last = self.problem, len(self.parts) - 1
        expressions = problem.at_the_ends
        if not expressions:
            return
        first, final = _Symbols(self.parts[0]), _Symbols(self.parts[-1])
        totals = ca.SX.sym("totals", len(problem.totals))
        own = self.parts[-1].problem.parameters
        p = ca.SX.sym("p", len(problem.parameters) + len(own))
        numbers = ca.vertsplit(p)
        count = len(problem.parameters)
        parameters = (
            {**final.design, **first.design, **dict(zip(problem.parameters, numbers[:count], strict=True))},
            {**final.design, **dict(zip(own, numbers[count:], strict=True))},
        )
        scope = problem.ends_scope(first.at("t0"), final.at("tf"), parameters, CASADI, ca.vertsplit(totals))
        values = [ca.SX(item.evaluate(scope, CASADI.functions)) for item in expressions]
        z = ca.vertcat(first.z, final.z, totals)
        rows = [_sum(*self._total_rows(number)) for number in range(len(problem.totals))]
        places = self._joints.apply(
            ca.Function("flight", [z, p], [ca.vertcat(*values)]),
            [*self._ends(0, 0), *self._ends(last, -1), *rows],
            _flight_numbers,
        )
        count = len(problem.boundary)
        if count:
            self._joints.constrain(
                _boundary_bounds,
                scale=[magnitude(item.interval) for item in problem.boundary],
                places=places,
                scatter=sparse.csr_array(sparse.eye_array(count, places.values, format="csr")),
            )
        if problem.terminal_cost is not None:
            self._joints.cost(places, np.eye(places.values)[-1])

    def _ends(self, index: int, side: int) -> list[sparse.csr_array]:
        """Rows of what :class:`_Symbols` names at the begin (0) or the end (-1) of a phase."""
        nodes = self.parts[index].nodes()
        own = [rows[[side]] for rows in (*nodes.states, *nodes.controls)]
        return [
            *(self._spread(index, rows) for rows in own),
            *self._scalars(index, "design"),
            *self._scalars(index, "times"),
        ]

    def _scalars(self, index: int, name: str) -> list[sparse.csr_array]:
        return [self._spread(index, rows) for rows in self.parts[index].scalar_rows(name, 1)]

    def _total_rows(self, number: int) -> list[sparse.csr_array]:
        """Rows of what adds up over the whole flight, in every phase that has it."""
        name = self.problem.totals[number].name
        return [
            self._scalars(k, kind)[index]
            for k, part in enumerate(self.parts)
            for kind, names in (
                ("integrals", [item.name for item in part.problem.integrals]),
                ("design", [item.name for item in part.problem.design]),
            )
            for index, own in enumerate(names)
            if own == name
        ]

    def _spread(self, index: int, rows: sparse.csr_array) -> sparse.csr_array:
        """Rows of a phase over the unknowns of all."""
        own = sparse.csr_array(rows)
        indices = own.indices + self._unknowns[index]
        return sparse.csr_array((own.data, indices, own.indptr), shape=(own.shape[0], self._unknowns[-1]))


class _Symbols:
    """SX symbols of all that is known at an end of a phase, as the model wants it."""

    def __init__(self, part: Transcription) -> None:
        problem = part.problem
        n, m = len(problem.states), len(problem.controls)
        self.z = ca.SX.sym("z", n + m + len(problem.design) + 2)
        parts = ca.vertsplit(self.z)
        self.times = dict(zip(("t0", "tf"), parts[-2:], strict=True))
        duration = self.times["tf"] - self.times["t0"]
        self.x = [item / duration if i in part.per_tau else item for i, item in enumerate(parts[:n])]
        self.u = parts[n : n + m]
        self.design = dict(zip([item.name for item in problem.design], parts[n + m : -2], strict=True))

    def at(self, time: str) -> tuple[list[ca.SX], list[ca.SX], ca.SX]:
        """States, controls and time, which is ``t0`` or ``tf``."""
        return self.x, self.u, self.times[time]


def _sum(*rows: sparse.csr_array) -> sparse.csr_array:
    whole = rows[0]
    for row in rows[1:]:
        whole = whole + row
    return sparse.csr_array(whole)


def _total_bounds(number: int) -> Any:
    return lambda this: this.problem.totals[number].interval


def _boundary_bounds(this: PhasedTranscription) -> tuple[Vector, Vector]:
    lower, upper = columns([item.interval for item in this.problem.boundary])
    return lower.ravel(), upper.ravel()


def _flight_numbers(this: PhasedTranscription) -> Vector:
    """Parameters of the flight, then those of its last phase, as a column."""
    own = this.parts[-1].problem.parameters
    return np.array([*this.problem.parameters.values(), *own.values()], np.float64)[:, None]
