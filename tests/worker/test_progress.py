import logging
import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest

from solvers.progress import ProgressReport
from worker.outcome import TIMED_OUT
from worker.progress import MOST_ITERATES, StoreProgress
from worker.records import FIRST, JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, connect


@pytest.fixture
def job_id(store: JobStore) -> str:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time())
    store.add(record, b"{}")
    return record.id


@pytest.fixture
def owner(store: JobStore, job_id: str) -> str:
    return store.start(job_id).owner


def within(seconds: float, condition: Callable[[], bool]) -> bool:
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        if condition():
            return True
        time.sleep(0.01)
    return condition()


def test_the_last_report_is_written_and_not_every_one(store: JobStore, job_id: str, owner: str) -> None:
    version = store.get(job_id).version
    with StoreProgress(store, job_id, owner, period=0.05) as progress:
        for iteration in range(1_001):
            progress.report(ProgressReport("solve", iteration))
        assert within(5, lambda: (store.get(job_id).progress or {}).get("iteration") == 1_000)
        time.sleep(0.2)  # Several periods without news.
    assert store.get(job_id).version - version <= 2
    assert not progress.cancelled()


def test_of_many_iterates_some_are_told_and_the_last_one_always(
    store: JobStore, job_id: str, owner: str
) -> None:
    with StoreProgress(store, job_id, owner, period=0.05) as progress:
        for iteration in range(1_001):
            progress.report(ProgressReport("solve", iteration, 2.0 * iteration, math.inf))
    assert store.finish(job_id, owner, JobStatus.CANCELLED, last=progress.untold())
    told = [event.data for event in store.events(job_id, FIRST) if event.kind == "progress"]
    iterates = [iterate for data in told for iterate in data["iterates"]]
    assert iterates[-1] == ["solve", 1_000, 2_000.0, None]
    assert 1 < len(iterates) <= MOST_ITERATES * len(told)
    assert [iterate[1] for iterate in iterates] == sorted({iterate[1] for iterate in iterates})
    assert "iterates" not in (store.get(job_id).progress or {})


def test_a_cancelled_job_is_heard_of(store: JobStore, job_id: str, owner: str) -> None:
    with StoreProgress(store, job_id, owner, period=0.02) as progress:
        assert not progress.cancelled()
        store.cancel(job_id)
        assert within(1, progress.cancelled)
    assert store.get(job_id).status is JobStatus.RUNNING


def test_a_solve_stops_when_its_job_is_not_its_own_any_more(store: JobStore, job_id: str, owner: str) -> None:
    with StoreProgress(store, job_id, owner, period=0.02) as progress:
        assert store.lose(job_id, "", 3_600, TIMED_OUT)
        assert store.start(job_id) is not None
        assert within(1, progress.cancelled)


def test_a_solve_goes_on_while_the_server_is_away(caplog: pytest.LogCaptureFixture) -> None:
    settings = QueueSettings(broker="redis://127.0.0.1:1/0")
    store = JobStore(connect(settings, retries=0), settings)
    with caplog.at_level(logging.WARNING), StoreProgress(store, new_job_id(), "me", period=0.02) as progress:
        began = time.monotonic()
        for iteration in range(10_000):
            progress.report(ProgressReport("solve", iteration))
            assert not progress.cancelled()
        assert time.monotonic() - began < 1
        assert within(5, lambda: "the store does not answer" in caplog.text)


def test_a_solve_that_has_heard_has_time_to_return_its_iterate(
    store: JobStore, job_id: str, owner: str
) -> None:
    with StoreProgress(store, job_id, owner, period=0.02, patience=1.0) as progress:
        store.cancel(job_id)
        time.sleep(0.7)  # An iteration,
        assert progress.cancelled()
        time.sleep(0.7)  # and the verification after it: together longer than the patience.
    assert store.get(job_id).status is JobStatus.RUNNING


SOLVE_THAT_DOES_NOT_STOP = """
import sys, time
from worker.progress import StoreProgress
from worker.settings import QueueSettings
from worker.store import JobStore, connect

broker, prefix, job_id, owner, listens = sys.argv[1:]
settings = QueueSettings(broker=broker, prefix=prefix)
with StoreProgress(JobStore(connect(settings), settings), job_id, owner, 0.05, 0.3) as progress:
    while listens == "listens" and not progress.cancelled():
        time.sleep(0.01)
    time.sleep(60)
"""


@pytest.mark.parametrize("listens", ["listens", "does not listen"])
def test_a_solve_that_does_not_stop_is_ended_with_its_process(
    store: JobStore, queue_settings: QueueSettings, job_id: str, owner: str, listens: str
) -> None:
    arguments = [queue_settings.broker, queue_settings.prefix, job_id, owner, listens]
    child = subprocess.Popen([sys.executable, "-c", SOLVE_THAT_DOES_NOT_STOP, *arguments])
    store.cancel(job_id)
    assert child.wait(20) == -signal.SIGKILL
    record = store.get(job_id)
    assert (record.status, record.has_result) == (JobStatus.CANCELLED, False)


def test_a_trajectory_is_told_once_and_not_kept_in_the_record(
    store: JobStore, job_id: str, owner: str
) -> None:
    """Also if a report without one comes before it is written."""
    sketch = {"t": [0.0, 1.0], "states": {"x": [0.0, 1.0]}, "controls": {"u": [1.0, 1.0]}}
    with StoreProgress(store, job_id, owner, period=0.1) as progress:
        progress.report(ProgressReport("solve", 1, trajectory=sketch))
        progress.report(ProgressReport("solve", 2))
        assert within(5, lambda: store.get(job_id).progress is not None)
        progress.report(ProgressReport("solve", 3))
        assert within(5, lambda: (store.get(job_id).progress or {})["iteration"] == 3)
    told = [event.data for event in store.events(job_id) if event.kind == "progress"]
    assert [(data["iteration"], data.get("trajectory")) for data in told] == [(2, sketch), (3, None)]
    assert "trajectory" not in (store.get(job_id).progress or {})
