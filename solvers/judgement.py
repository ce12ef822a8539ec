"""What becomes of an answer: verified within the time that it deserves, and judged."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from solvers.evaluation_fault import find_evaluation_fault
from solvers.problem import OptimalControlProblem
from solvers.progress import ProgressReport
from solvers.session import Session
from solvers.solution import PlantAnswer
from solvers.spec import JobSpec
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.verify import Tolerances, Verification, verify

_SECONDS = {SolveStatus.CONVERGED: 60.0, SolveStatus.CANCELLED: 0.5}
_SECONDS_UNCONVERGED = 2.0


def verified(
    session: Session,
    spec: JobSpec,
    trajectory: Trajectory,
    status: SolveStatus,
    problem: OptimalControlProblem | None = None,
) -> Verification:
    """Fly an answer that ended with ``status``; as an answer to ``problem``, by default the document's."""
    started = time.perf_counter()
    session.progress.report(ProgressReport("verify", session.iterations, fraction=1.0))
    deadline = time.monotonic() + _SECONDS.get(status, _SECONDS_UNCONVERGED)
    tolerances = Tolerances(**spec.verification_tolerances())
    verification = verify(problem or session.problem, trajectory, tolerances, deadline)
    # Of several plants the worst counts; none is known where one is not.
    account, error = session.convergence[-1], verification.max_state_error
    first = "verify" not in session.seconds
    known = error if first else account["max_state_error"]
    account["max_state_error"] = None if error is None or known is None else max(error, known)
    session.seconds["verify"] = session.seconds.get("verify", 0.0) + time.perf_counter() - started
    return verification


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
    if status in (SolveStatus.EVALUATION_ERROR, SolveStatus.DIVERGED):
        fault = find_evaluation_fault(spec.problem, problem, trajectory)
        if fault is not None:
            status = SolveStatus.EVALUATION_ERROR
            return status, f"{status.sentence} {fault.pointer}: {fault.detail}"
    flights = [("", verification), *((f"{other.plant.name}: ", other.verification) for other in others)]
    if status is SolveStatus.CONVERGED and not all(flight.passed for _, flight in flights):
        status = SolveStatus.UNVERIFIED
    details = [(sentences or {}).get(status, status.sentence)]
    for label, flight in flights:
        if status is SolveStatus.UNVERIFIED:
            failed = [check for check in flight.checks if not check.passed]
            details += [f"{label}{check.name} is {check.value}, the limit {check.limit}." for check in failed]
        if flight.note:
            details.append(f"{label}{flight.note}")
    return status, " ".join(details)
