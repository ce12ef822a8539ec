"""What the output of a document asks for besides the trajectory: its command table, and coasting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from solvers.coast import coast, flown_end
from solvers.command import MAX_ROWS, fly_command, make_command, rows
from solvers.flight import FlightError
from solvers.scenarios import formulate
from solvers.spec import CommandSpec, ProblemSpec
from solvers.trajectory import Trajectory


class TooManyRowsError(ValueError):
    """The table of a command would have more rows than allowed; says how many."""


def commanded(
    spec: ProblemSpec, command: CommandSpec, answers: Sequence[Trajectory], seconds: float | None = None
) -> dict[str, Any]:
    """The ``command`` of a result: the table, and its flight on every plant.

    ``answers``: the trajectory of each plant, the leading one first, whose flight is the ``verification``;
    those of several plants stand under ``scenarios``. A stored result has that of the leading one alone.
    Raises TooManyRowsError.
    """
    count = rows(command, answers[0].duration)
    if count > MAX_ROWS:
        raise TooManyRowsError(f"a table of {count:,} rows is asked for, at most {MAX_ROWS:,} are made")
    # The document's own controls: none is a state here.
    plants = formulate(spec.changed(control_rates={})).plants
    table = make_command(command, plants[0].problem, answers[0])
    flights = [
        fly_command(table, plant.problem, answer, seconds)
        for plant, answer in zip(plants, answers, strict=False)
    ]
    found = {**table.to_dict(), "verification": flights[0]}
    if spec.scenarios is not None and len(flights) == len(plants):
        found["scenarios"] = {plant.name: flight for plant, flight in zip(plants, flights, strict=True)}
    return found


def coasted(spec: ProblemSpec, answer: Trajectory, seconds: float) -> Mapping[str, Any]:
    """The ``coast`` of a result: the leading plant without control after its flight."""
    problem = formulate(spec).plants[0].problem
    try:
        end = flown_end(problem, answer, answer.states_at(answer.breakpoints))
    except FlightError as error:
        return {"seconds": seconds, "note": f"The flight itself was not computed: {error}."}
    plain = formulate(spec.changed(control_rates={})).plants[0].problem
    return coast(plain, answer, end[: len(plain.states)], seconds)
