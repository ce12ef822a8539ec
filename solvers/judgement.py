"""What becomes of an answer: verified within the time that it deserves, and judged."""

from __future__ import annotations

import time
from collections.abc import Mapping

from solvers.diagnosis import find_evaluation_fault
from solvers.problem import OptimalControlProblem
from solvers.progress import ProgressReport
from solvers.session import Session
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
    session.convergence[-1]["max_state_error"] = verification.max_state_error
    session.seconds["verify"] = time.perf_counter() - started
    return verification


def judge(
    spec: JobSpec,
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    status: SolveStatus,
    verification: Verification,
    sentences: Mapping[SolveStatus, str] | None = None,
) -> tuple[SolveStatus, str]:
    """The status of the result, and a message with what decided and what to try.

    ``sentences`` stand for those of the status where a method has its own.
    """
    if status in (SolveStatus.EVALUATION_ERROR, SolveStatus.DIVERGED):
        fault = find_evaluation_fault(spec.problem, problem, trajectory)
        if fault is not None:
            status = SolveStatus.EVALUATION_ERROR
            return status, f"{status.sentence} {fault.pointer}: {fault.detail}"
    if status is SolveStatus.CONVERGED and not verification.passed:
        status = SolveStatus.UNVERIFIED
    details = [(sentences or {}).get(status, status.sentence)]
    if status is SolveStatus.UNVERIFIED:
        failed = [check for check in verification.checks if not check.passed]
        details += [f"{check.name} is {check.value}, the limit {check.limit}." for check in failed]
    if verification.note:
        details.append(verification.note)
    return status, " ".join(details)
