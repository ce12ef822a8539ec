"""What becomes of an answer: verified within the time that it deserves, and judged."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from solvers.errors import Fault
from solvers.formulation.plants import Plant
from solvers.problem import OptimalControlProblem
from solvers.progress import ProgressReport
from solvers.session import Account
from solvers.slope_fault import find_slope_fault
from solvers.solution import PlantAnswer
from solvers.spec import AutoMethod, JobSpec, ProblemSpec
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.verification.evaluation_fault import Where, find_evaluation_fault
from solvers.verification.verdict import Tolerances, Verification
from solvers.verification.verify import verify

_SECONDS = {SolveStatus.CONVERGED: 60.0, SolveStatus.CANCELLED: 0.5}
_SECONDS_UNCONVERGED = 2.0
# What may have ended so for an expression without a finite value, and where to look for it.
_FAULTY: Mapping[SolveStatus, Where] = {
    SolveStatus.EVALUATION_ERROR: "nodes",
    SolveStatus.DIVERGED: "nodes",
    SolveStatus.ITERATION_LIMIT: "tables",
    SolveStatus.TIME_LIMIT: "tables",
}
# What may be tried for exactness has been tried where the choice was left to the solver.
_AUTOMATIC = {
    SolveStatus.UNVERIFIED: (
        "This is the best answer found, but re-integrated it is outside the accuracy that was asked of auto."
    )
}


def verified(
    account: Account, spec: JobSpec, trajectory: Trajectory, status: SolveStatus, plant: Plant
) -> Verification:
    """Fly an answer that ended with ``status`` on a plant."""
    return flown_in_time(
        account,
        spec,
        status,
        lambda limits, end: verify(plant.problem, trajectory, limits, end, implied=plant.implied),
    )


def flown_in_time(
    account: Account, spec: JobSpec, status: SolveStatus, fly: Callable[[Tolerances, float], Verification]
) -> Verification:
    """Fly an answer that ended with ``status``, within the tolerances and the time that it deserves."""
    started = time.perf_counter()
    objective = account.convergence[-1]["objective"]
    account.progress.report(ProgressReport("verify", account.iterations, objective, fraction=1.0))
    deadline = time.monotonic() + _SECONDS.get(status, _SECONDS_UNCONVERGED)
    verification = fly(Tolerances(**spec.verification_tolerances()), deadline)
    account.seconds["verify"] = account.seconds.get("verify", 0.0) + time.perf_counter() - started
    return verification


def note_errors(account: Account, flights: Sequence[Verification]) -> None:
    """Take note of what the flights of all plants showed of the last mesh; None where one is not known."""
    errors = [flight.max_state_error for flight in flights]
    known = [error for error in errors if error is not None]
    account.convergence[-1]["max_state_error"] = max(known) if len(known) == len(errors) else None


def sentences_of(spec: JobSpec) -> Mapping[SolveStatus, str] | None:
    """What the method says of a status in words of its own."""
    return _AUTOMATIC if isinstance(spec.method, AutoMethod) else None


def judge(
    spec: JobSpec,
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    status: SolveStatus,
    verification: Verification,
    sentences: Mapping[SolveStatus, str] | None = None,
    others: Sequence[PlantAnswer] = (),
) -> tuple[SolveStatus, str]:
    """The status of the result, and a message with what decided and what to try.

    ``sentences`` stand for those of the status where a method has its own; ``others``: what further plants
    under the same command did.
    """
    if sentences is None:
        sentences = sentences_of(spec)
    flights = [("", verification), *((f"{other.plant.name}: ", other.verification) for other in others)]
    return judged(
        status,
        flights,
        lambda where: fault_along(spec.problem, problem, trajectory, where),
        sentences,
    )


def fault_along(
    spec: ProblemSpec, problem: OptimalControlProblem, trajectory: Trajectory, where: Where
) -> Fault | None:
    """The first expression that is at fault on this trajectory, or None."""
    if where == "slopes":
        return find_slope_fault(spec, problem, trajectory)
    return find_evaluation_fault(spec, problem, trajectory, where)


def judged(
    status: SolveStatus,
    flights: Sequence[tuple[str, Verification]],
    find_fault: Callable[[Where], Fault | None],
    sentences: Mapping[SolveStatus, str] | None = None,
) -> tuple[SolveStatus, str]:
    """See :func:`judge`; ``flights`` with what stands before them in a message.

    ``find_fault``: see :func:`fault_along`.
    """
    near = None
    if status in _FAULTY:
        where = _FAULTY[status]
        fault = find_fault(where)
        if fault is None and status is SolveStatus.EVALUATION_ERROR:
            fault = find_fault("slopes")
        if fault is not None:
            status = SolveStatus.EVALUATION_ERROR
            return status, f"{status.sentence} {fault.pointer}: {fault.detail}"
        near = find_fault("ends") if where == "tables" else None
    if status is SolveStatus.CONVERGED and not all(flight.passed for _, flight in flights):
        status = SolveStatus.UNVERIFIED
    details = [(sentences or {}).get(status, status.sentence)]
    if near is not None:
        details.append(f"{near.pointer}: {near.detail}.")
    for label, flight in flights:
        if status is SolveStatus.UNVERIFIED:
            details += [f"{label}{check.sentence}" for check in flight.checks if not check.passed]
        if flight.note:
            details.append(f"{label}{flight.note}")
    return status, " ".join(details)
