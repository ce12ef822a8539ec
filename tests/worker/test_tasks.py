import json
import subprocess
import sys
import time
from typing import Any

import pytest
from celery.exceptions import Reject

from solvers.progress import ProgressReport
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from worker.celery_app import make_celery
from worker.errors import WorkerStartError
from worker.memory import ROOM, require_memory
from worker.outcome import TIMED_OUT
from worker.records import FailureType, JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, connect
from worker.tasks import Limits, SolveTask, solve_job

LIMITS = Limits(2**25, grace=30.0, outage=0.0)


def add(store: JobStore, document: Any) -> str:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time())
    store.add(record, json.dumps(document).encode())
    return record.id


@pytest.fixture
def job_id(store: JobStore) -> str:
    return add(store, FLEXIBLE_SPACECRAFT)


def test_a_job_is_solved_and_its_end_written(store: JobStore, job_id: str) -> None:
    solve_job(job_id, store, LIMITS)
    record = store.get(job_id)
    assert (record.status, record.attempts) == (JobStatus.SUCCEEDED, 1)
    result = json.loads(store.result(job_id) or b"")
    assert (result["job_id"], result["success"]) == (job_id, True)


def test_a_message_that_comes_twice_changes_nothing(store: JobStore, job_id: str) -> None:
    solve_job(job_id, store, LIMITS)
    before = store.get(job_id)
    solve_job(job_id, store, LIMITS)
    assert store.get(job_id) == before


def test_a_cancelled_job_is_passed_over(store: JobStore, job_id: str) -> None:
    store.cancel(job_id)
    solve_job(job_id, store, LIMITS)
    record = store.get(job_id)
    assert (record.status, record.attempts, record.has_result) == (JobStatus.CANCELLED, 0, False)


def test_a_job_that_nobody_remembers_is_passed_over(store: JobStore) -> None:
    solve_job(new_job_id(), store, LIMITS)
    assert store.page(10) == ([], None)


def test_a_document_that_the_worker_refuses_is_an_internal_error(store: JobStore) -> None:
    job_id = add(store, {"schema": 1})
    solve_job(job_id, store, LIMITS)
    error = store.get(job_id).error
    assert error is not None
    assert error.type is FailureType.INTERNAL


def test_a_solve_that_lost_its_job_meanwhile_writes_nothing(
    store: JobStore, job_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another worker takes the job over in the middle of the solve, as if this one were lost."""
    others: list[str] = []
    solve = solve_job.__globals__["solve"]

    def slow_solve(*arguments: Any) -> Any:
        solution = solve(*arguments)
        assert store.lose(job_id, "", 3_600, TIMED_OUT)
        others.append(store.start(job_id).owner)
        return solution

    # By the function's own names: the module may stand in sys.modules more than once.
    monkeypatch.setitem(solve_job.__globals__, "solve", slow_solve)
    solve_job(job_id, store, LIMITS)
    record = store.get(job_id)
    assert (record.status, record.attempts, record.has_result) == (JobStatus.RUNNING, 2, False)
    (other,) = others
    assert store.report(job_id, other, ProgressReport("solve", 1)) == "go"


def test_a_message_goes_back_while_the_store_is_away() -> None:
    settings = QueueSettings(broker="unix:///nowhere/at/all.sock")
    task = make_celery(settings).register_task(
        SolveTask(JobStore(connect(settings, retries=0), settings), LIMITS)
    )
    with pytest.raises(Reject) as caught:
        task.run(new_job_id())
    assert caught.value.requeue


# A stack so large that there is no room for it, but enough for everything else.
WITHOUT_ROOM = """
import sys, threading
from worker.memory import address_space, limit_memory
from worker.settings import QueueSettings
from worker.store import JobStore, connect
from worker.tasks import Limits, solve_job

settings = QueueSettings(broker=sys.argv[1], prefix=sys.argv[2])
with connect(settings) as redis:
    threading.stack_size(2**29)
    limit_memory(address_space() + 64)
    solve_job(sys.argv[3], JobStore(redis, settings), Limits(2**25, grace=30.0, outage=0.0))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc and limits the address space")
def test_a_solve_without_room_for_its_thread_ends_at_once(
    store: JobStore, job_id: str, queue_settings: QueueSettings
) -> None:
    arguments = [queue_settings.broker, queue_settings.prefix, job_id]
    subprocess.run([sys.executable, "-c", WITHOUT_ROOM, *arguments], check=True, timeout=100)
    record = store.get(job_id)
    assert record.error is not None
    assert (record.status, record.error.type) == (JobStatus.FAILED, FailureType.OUT_OF_MEMORY)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_worker_needs_room_for_a_job() -> None:
    with pytest.raises(WorkerStartError, match=r"ONDELETTE_MEMORY_MIB: 256 MiB .* at least (\d+)") as refusal:
        require_memory(256)
    least = int(str(refusal.value).split()[-2])
    assert least > 256 + ROOM
    require_memory(least + 64)
