"""What the output of a document asks for besides the trajectory: its command table, and coasting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from solvers.output.coast import coast
from solvers.output.command import MAX_ROWS, fly_command, make_command, rows
from solvers.phases.trajectory import AnyTrajectory
from solvers.spec import CommandSpec, JobSpec, ProblemSpec
from solvers.verification.flight import FlightError
from solvers.verification.legs import fly_legs, routes, without_rates


class NoTableError(ValueError):
    """There is no table of a command: why."""


class TooManyRowsError(NoTableError):
    """It would have more rows than allowed; says how many."""


def asked_for(spec: JobSpec, answers: Sequence[AnyTrajectory]) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """The ``command`` and the ``coast`` of a result where its document asks for them, and warnings.

    ``answers``: that of each plant, the leading one first.
    """
    output, found, warnings = spec.output, dict[str, Any](), list[dict[str, str]]()
    if output.command is not None:
        try:
            found["command"] = commanded(spec.problem, output.command, answers, output.coast)
        except NoTableError as error:
            found["command"] = None
            pointer = "/output/command" + ("/period" if isinstance(error, TooManyRowsError) else "")
            warnings.append({"code": "no_command", "pointer": pointer, "detail": str(error)})
    if output.coast is not None:
        found["coast"] = coasted(spec.problem, answers[0], output.coast)
    return found, warnings


def commanded(
    spec: ProblemSpec, command: CommandSpec, answers: Sequence[AnyTrajectory], seconds: float | None = None
) -> dict[str, Any]:
    """The ``command`` of a result: the table, and its flight on every plant.

    ``answers``: the trajectory of each plant, the leading one first, whose flight is the ``verification``;
    those of several plants stand under ``scenarios``. A stored result has that of the leading one alone.
    Raises NoTableError, also where an iterate is no flight, for a phase of it does not end after its begin.
    """
    if not all(part.duration > 0.0 for answer in answers for part in answer.parts):
        raise NoTableError("a phase of the last iterate does not end after its begin")
    count = rows(command, answers[0].tf - answers[0].t0)
    if count > MAX_ROWS:
        raise TooManyRowsError(f"a table of {count:,} rows is asked for, at most {MAX_ROWS:,} are made")
    plants = list(routes(without_rates(spec), answers))
    table = make_command(command, plants[0].legs)
    flights = {plant.name: fly_command(table, plant.legs, seconds) for plant in plants}
    found = {**table.to_dict(), "verification": flights[plants[0].name]}
    if spec.scenarios is not None and len(plants) == spec.scenarios.count:
        found["scenarios"] = flights
    return found


def coasted(spec: ProblemSpec, answer: AnyTrajectory, seconds: float) -> Mapping[str, Any]:
    """The ``coast`` of a result: the leading plant without control after its flight."""
    (plant,) = routes(spec, [answer])
    promised = [leg.answer.states_at(leg.answer.breakpoints) for leg in plant.legs]
    try:
        *_, end = fly_legs(plant.legs, answer.parts, promised)
    except FlightError as error:
        return {"seconds": seconds, "note": f"The flight itself was not computed: {error}."}
    (plain,) = routes(without_rates(spec), [answer])
    last = plain.legs[-1]
    return coast(last.problem, last.answer, end[: len(last.problem.states)], seconds)
