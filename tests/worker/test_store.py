import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from redis import Redis

from solvers.progress import ProgressReport
from worker.errors import JobActive, JobGone, JobNotFound
from worker.keyspace import record_told
from worker.records import FailureType, JobError, JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, Signal, compress

DOCUMENT = b'{ "name":\t"as submitted", "schema": 1 }'
ERROR = JobError(FailureType.INFEASIBLE, "Title.", "Detail.")


@pytest.fixture(params=[None, "folder", "memory://ondelette"])
def results(request: pytest.FixtureRequest, tmp_path: Path) -> str | None:
    """Everything holds wherever results are kept."""
    return f"file://{tmp_path}" if request.param == "folder" else request.param


def add(store: JobStore, name: str | None = None, tags: tuple[str, ...] = ()) -> str:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time(), name=name, tags=tags)
    store.add(record, DOCUMENT)
    return record.id


def started(store: JobStore, job_id: str) -> str:
    return store.start(job_id).owner


def lost(store: JobStore, job_id: str) -> None:
    assert store.lose(job_id, "", 3_600, ERROR)


def ended(store: JobStore, job_id: str, status: JobStatus = JobStatus.SUCCEEDED) -> None:
    assert store.finish(job_id, started(store, job_id), status, result=compress(b'{"success": true}'))


def test_a_new_job_is_queued_and_its_document_kept_letter_for_letter(store: JobStore) -> None:
    job_id = add(store, "a name", ("tag",))
    record = store.get(job_id)
    assert (record.status, record.name, record.tags) == (JobStatus.QUEUED, "a name", ("tag",))
    assert (record.attempts, record.started_at, record.finished_at, record.version) == (0, None, None, 1)
    assert store.document(job_id) == DOCUMENT
    assert store.result(job_id) is None


def test_what_nobody_knows_is_not_found(store: JobStore) -> None:
    known = add(store)
    for unknown in (new_job_id(), "", "*", known.upper(), f"{known}:document", f"{known}\n"):
        for read in (store.get, store.document, store.result, store.cancel, store.erase):
            with pytest.raises(JobNotFound):
                read(unknown)
    assert store.start(new_job_id()) is None


def test_the_way_of_a_job_that_succeeds(store: JobStore) -> None:
    job_id = add(store)
    before = time.time()
    owner = started(store, job_id)
    running = store.get(job_id)
    assert (running.status, running.attempts, running.losses) == (JobStatus.RUNNING, 1, 0)
    assert running.started_at is not None
    assert before <= running.started_at <= time.time()

    report = ProgressReport("solve", 3, 25.9, float("inf"), 0.5)
    assert store.report(job_id, owner, report) is Signal.GO
    assert store.get(job_id).progress == {
        "stage": "solve",
        "iteration": 3,
        "objective": 25.9,
        "infeasibility": None,
        "fraction": 0.5,
        "diversity": None,
    }
    assert store.finish(job_id, owner, JobStatus.SUCCEEDED, result=compress(b'{"success": true}'))
    end = store.get(job_id)
    assert (end.status, end.error, end.has_result) == (JobStatus.SUCCEEDED, None, True)
    assert end.finished_at is not None
    assert end.finished_at >= running.started_at
    assert store.result(job_id) == b'{"success": true}'


def test_the_version_changes_exactly_if_the_record_does(store: JobStore) -> None:
    job_id = add(store)
    versions = [store.get(job_id).version]

    def changed() -> bool:
        versions.append(store.get(job_id).version)
        return versions[-1] > versions[-2]

    owner = started(store, job_id)
    assert changed()
    store.report(job_id, owner, None)
    assert not changed()
    store.report(job_id, owner, ProgressReport("solve", 1))
    assert changed()
    store.cancel(job_id)
    assert changed()
    store.cancel(job_id)
    assert not changed()
    store.finish(job_id, owner, JobStatus.CANCELLED)
    assert changed()
    for late in (
        lambda: store.finish(job_id, owner, JobStatus.FAILED, ERROR),
        lambda: store.report(job_id, owner, ProgressReport("solve", 2)),
        lambda: store.fail(job_id, ERROR),
        lambda: store.hand_back(job_id),
        lambda: store.start(job_id),
        lambda: store.cancel(job_id),
    ):
        late()
        assert not changed()


@pytest.mark.parametrize("status", [status for status in JobStatus if status.final])
def test_a_final_status_never_changes(store: JobStore, status: JobStatus) -> None:
    job_id = add(store)
    owner = started(store, job_id)
    assert store.finish(job_id, owner, status, result=compress(b"1"))
    before = store.get(job_id)
    assert store.start(job_id) is None
    assert not store.finish(job_id, owner, JobStatus.FAILED, ERROR, compress(b"2"))
    assert not store.fail(job_id, ERROR)
    assert not store.hand_back(job_id)
    assert store.cancel(job_id) == before
    assert store.report(job_id, owner, ProgressReport("solve", 1)) is Signal.LOST
    assert store.get(job_id) == before
    assert store.result(job_id) == b"1"


def test_only_final_statuses_end_a_job(store: JobStore) -> None:
    job_id = add(store)
    with pytest.raises(ValueError, match="not a final status"):
        store.finish(job_id, started(store, job_id), JobStatus.QUEUED)


def test_of_many_solves_of_one_job_exactly_one_writes_its_end(store: JobStore) -> None:
    job_id = add(store)
    owner = started(store, job_id)
    with ThreadPoolExecutor(8) as threads:
        written = list(
            threads.map(
                lambda number: store.finish(
                    job_id, owner, JobStatus.SUCCEEDED, result=compress(json.dumps(number).encode())
                ),
                range(40),
            )
        )
    assert written.count(True) == 1
    assert store.result(job_id) == json.dumps(written.index(True)).encode()


def test_a_solve_given_up_for_lost_writes_nothing_any_more(store: JobStore) -> None:
    job_id = add(store)
    silent = started(store, job_id)
    lost(store, job_id)
    owner = started(store, job_id)
    assert store.get(job_id).attempts == 2
    assert store.report(job_id, silent, ProgressReport("solve", 99)) is Signal.LOST
    assert not store.finish(job_id, silent, JobStatus.FAILED, ERROR)
    assert store.get(job_id).progress is None
    assert store.finish(job_id, owner, JobStatus.SUCCEEDED)


def test_a_job_that_loses_its_worker_twice_is_given_up(store: JobStore) -> None:
    job_id = add(store)
    for _ in range(2):
        started(store, job_id)
        lost(store, job_id)
    assert store.start(job_id) is None
    record = store.get(job_id)
    assert (record.status, record.attempts, record.losses) == (JobStatus.FAILED, 2, 2)
    assert record.error is not None
    assert record.error.type is FailureType.WORKER_LOST


def test_a_job_may_be_handed_back_any_number_of_times(store: JobStore) -> None:
    job_id = add(store)
    for attempt in range(1, 5):
        started(store, job_id)
        assert store.get(job_id).attempts == attempt
        assert store.hand_back(job_id)
        record = store.get(job_id)
        assert (record.status, record.started_at, record.losses) == (JobStatus.QUEUED, None, 0)


def test_a_queued_job_that_is_cancelled_never_starts(store: JobStore) -> None:
    job_id = add(store)
    record = store.cancel(job_id)
    assert record.status is JobStatus.CANCELLED
    assert record.finished_at is not None
    assert store.start(job_id) is None
    assert store.get(job_id).attempts == 0


def test_a_running_job_hears_that_it_is_cancelled(store: JobStore) -> None:
    job_id = add(store)
    owner = started(store, job_id)
    record = store.cancel(job_id)
    assert (record.status, record.cancel_requested) == (JobStatus.RUNNING, True)
    assert store.report(job_id, owner, None) is Signal.CANCEL
    assert store.finish(job_id, owner, JobStatus.CANCELLED, result=compress(b"{}"))
    assert store.result(job_id) == b"{}"


def test_a_cancelled_job_whose_worker_is_lost_is_not_started_again(store: JobStore) -> None:
    job_id = add(store)
    started(store, job_id)
    lost(store, job_id)
    store.cancel(job_id)
    assert store.start(job_id) is None
    assert store.get(job_id).status is JobStatus.CANCELLED

    job_id = add(store)
    started(store, job_id)
    store.cancel(job_id)
    assert store.hand_back(job_id)
    assert store.get(job_id).status is JobStatus.CANCELLED


def test_the_main_process_ends_a_job_whose_child_was_killed(store: JobStore) -> None:
    job_id = add(store)
    assert not store.fail(job_id, ERROR)
    started(store, job_id)
    assert store.fail(job_id, ERROR)
    assert store.get(job_id).error == ERROR


def test_an_erased_job_is_gone(store: JobStore) -> None:
    job_id = add(store)
    with pytest.raises(JobActive):
        store.erase(job_id)
    started(store, job_id)
    with pytest.raises(JobActive):
        store.erase(job_id)
    assert store.fail(job_id, ERROR)
    store.erase(job_id)
    for read in (store.get, store.document, store.result, store.cancel, store.erase):
        with pytest.raises(JobGone):
            read(job_id)
    assert store.start(job_id) is None
    assert store.page(10) == ([], None)


def test_a_finished_job_is_kept_for_its_time_and_remembered_afterwards(
    redis: Redis, queue_settings: QueueSettings
) -> None:
    store = JobStore(redis, queue_settings.model_copy(update={"retention_days": 1 / 86_400}))
    job_id, active = add(store), add(store)
    ended(store, job_id)
    assert store.get(job_id).status is JobStatus.SUCCEEDED
    give_up = time.monotonic() + 5
    while [record.id for record in store.page(10)[0]] != [active]:
        assert time.monotonic() < give_up
        time.sleep(0.05)
    with pytest.raises(JobGone):
        store.get(job_id)
    with pytest.raises(JobGone):
        store.result(job_id)
    remembered = redis.ttl(f"{store.prefix}gone:{job_id}")
    assert 29 * 86_400 < remembered <= 30 * 86_400 + 1


def test_a_page_is_newest_first_and_the_next_one_goes_on_behind_it(store: JobStore) -> None:
    ids = [add(store) for _ in range(7)]
    seen: list[str] = []
    after: str | None = None
    sizes = []
    while True:
        records, after = store.page(3, after)
        seen += [record.id for record in records]
        sizes.append(len(records))
        add(store)  # Newer jobs do not disturb the pages behind.
        if after is None:
            break
    assert seen == ids[::-1]
    assert sizes == [3, 3, 1]


def test_a_full_last_page_says_that_it_is_the_last(store: JobStore) -> None:
    for _ in range(4):
        add(store)
    assert store.page(4)[1] is None


def test_a_filter_looks_beyond_the_first_hundred_jobs(store: JobStore) -> None:
    wanted = add(store, "needle")
    for _ in range(230):
        add(store)
    records, after = store.page(5, None, lambda record: record.name == "needle")
    assert [record.id for record in records] == [wanted]
    assert after is None


def test_one_call_looks_at_a_bounded_number_of_jobs(store: JobStore) -> None:
    wanted = add(store, "needle")
    with store.redis.pipeline() as pipe:  # Members of the index are enough; they count as expired jobs.
        pipe.zadd(store._index, {new_job_id(): 0 for _ in range(2_500)})
        pipe.execute()
    records, after = store.page(5, None, lambda record: record.name == "needle")
    assert records == []
    assert after is not None
    records, after = store.page(5, after, lambda record: record.name == "needle")
    assert [record.id for record in records] == [wanted]
    assert after is None


def test_what_happens_is_published_to_whom_it_concerns(store: JobStore, redis: Redis) -> None:
    """Ends to everybody, with the record; that anything happened to those who follow the job."""
    followed, other = add(store), add(store)
    with redis.pubsub(ignore_subscribe_messages=True) as listener:
        listener.subscribe(store.channel, store.channel_of(followed))
        heard: list[tuple[str, str]] = []
        for job_id in (followed, other):
            ended(store, job_id)
        while len(heard) < 3:
            message = listener.get_message(timeout=5)
            if message is not None:
                heard.append((message["channel"].decode(), message["data"].decode()))
    assert heard[0] == (store.channel_of(followed), "")
    for (channel, text), job_id in zip(heard[1:], (followed, other), strict=True):
        named, record = text.split(" ", 1)
        assert (channel, named, record_told(record)) == (store.channel, job_id, store.get(job_id))


def test_a_project_is_answered_by_jobs_of_its_own(store: JobStore) -> None:
    """Whatever another project's jobs have answered since."""
    jobs = {}
    for project in ("slews", "rockets"):
        record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time(), project=project)
        store.add(record, DOCUMENT)
        store.finish(record.id, started(store, record.id), JobStatus.SUCCEEDED, digest="asked")
        jobs[project] = record.id
    for project, job_id in jobs.items():
        assert store.answered(project, "asked") == job_id
    assert store.answered("slews", "another") is None


def told(store: JobStore, job_id: str) -> list[object]:
    """The events of a job: the status of those that tell one, the kind of others."""
    return [event.data["status"] if event.kind == "status" else event.kind for event in store.events(job_id)]


def test_everything_that_happens_to_a_job_is_an_event(store: JobStore) -> None:
    job_id = add(store)
    owner = started(store, job_id)
    assert store.hand_back(job_id)
    owner = started(store, job_id)
    store.report(job_id, owner, ProgressReport("solve", 3))
    store.report(job_id, owner, None)
    store.cancel(job_id)
    assert store.finish(job_id, owner, JobStatus.FAILED, ERROR, result=compress(b"{}"))
    events = store.events(job_id)
    assert told(store, job_id) == [
        "queued",
        "running",
        "queued",
        "running",
        "progress",
        "running",
        "result",
        "failed",
    ]
    assert [event.last for event in events] == [False] * 7 + [True]
    assert events[4].data["iteration"] == 3
    assert [event.data["cancel_requested"] for event in (events[3], events[5])] == [False, True]
    assert events[-1].data["error"]["type"] == "infeasible"
    assert events[-1].data["attempts"] == 2
    assert store.events(job_id, events[4].number) == events[5:]
    assert store.events(job_id, events[-1].number) == []


def test_what_changes_nothing_is_no_event(store: JobStore) -> None:
    job_id = add(store)
    ended(store, job_id)
    assert told(store, job_id) == ["queued", "running", "result", "succeeded"]
    store.cancel(job_id)
    store.start(job_id)
    store.hand_back(job_id)
    assert len(store.events(job_id)) == 4


def test_events_are_kept_as_long_as_their_job_and_not_all_of_them(
    store: JobStore, redis: Redis, queue_settings: QueueSettings
) -> None:
    job_id = add(store)
    stream = f"{queue_settings.prefix}job:{job_id}:events"
    owner = started(store, job_id)
    for iteration in range(1_500):
        store.report(job_id, owner, ProgressReport("solve", iteration))
    assert 1_000 <= len(store.events(job_id)) < 1_300
    assert redis.ttl(stream) == -1
    assert store.finish(job_id, owner, JobStatus.SUCCEEDED)
    assert redis.ttl(stream) == redis.ttl(f"{queue_settings.prefix}job:{job_id}") > 0
    store.erase(job_id)
    assert not redis.exists(stream)
