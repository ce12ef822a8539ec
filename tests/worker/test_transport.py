import contextlib
import json
import logging
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from redis import Redis

from tests.servers import DurableServer
from worker.celery_app import make_celery
from worker.queue import JobQueue
from worker.records import JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import connect
from worker.transport import PromptTransport


def publish(redis: Redis, settings: QueueSettings) -> None:
    JobQueue(redis, settings).enqueue(JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time()))


@contextlib.contextmanager
def fetching(settings: QueueSettings, transport: Any = PromptTransport) -> Iterator[Callable[[], Any]]:
    """A function that fetches the next message, as a worker does."""
    celery = make_celery(settings)
    found: list[Any] = []
    with celery.connection_for_read() as connection:
        connection.transport_cls = transport

        def fetch() -> Any:
            while not found:
                connection.drain_events(timeout=10)
            return found.pop()

        with celery.amqp.TaskConsumer(connection.default_channel, on_message=found.append):
            yield fetch


def held(redis: Any, settings: QueueSettings) -> dict[str, tuple[float, Any]]:
    """What is noted as held: for each delivery tag since when, and the message."""
    since = redis.zrange(f"{settings.prefix}unacked_index", 0, -1, withscores=True)
    texts = {
        tag.decode(): json.loads(text) for tag, text in redis.hgetall(f"{settings.prefix}unacked").items()
    }
    assert texts.keys() == {tag.decode() for tag, _ in since}
    return {tag.decode(): (moment, texts[tag.decode()]) for tag, moment in since}


def test_a_message_is_noted_as_kombu_notes_it(redis: Redis, queue_settings: QueueSettings) -> None:
    notes = []
    for transport in (PromptTransport, "redis"):
        queue = f"{queue_settings.prefix}solve.normal"
        publish(redis, queue_settings)
        message = json.loads(cast(bytes, redis.lindex(queue, 0)))
        # A socket's address is all that kombu's own transport is told here.
        with fetching(queue_settings, transport) as fetch:
            fetched = fetch()
            # Whatever is done about messages next notes it and reads the answer first; so do we.
            fetched.channel.qos.ack("another")
            ((tag, (since, (noted, *where))),) = held(redis, queue_settings).items()
            assert (tag, noted) == (fetched.delivery_tag, message)
            assert since == pytest.approx(time.time(), abs=10)
            notes.append(where)
            fetched.ack()
            assert held(redis, queue_settings) == {}
    assert notes[0] == notes[1]


def test_a_message_that_is_given_back_waits_again(redis: Redis, queue_settings: QueueSettings) -> None:
    publish(redis, queue_settings)
    with fetching(queue_settings) as fetch:
        fetch().requeue()
        assert held(redis, queue_settings) == {}
        again = fetch()
        assert again.delivery_info["redelivered"]
        again.ack()


def test_a_note_that_is_refused_is_told_of_and_the_next_one_taken(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    server = DurableServer(tmp_path)
    server.start()
    try:
        settings = QueueSettings(broker=server.address)
        with connect(settings, retries=10) as redis, fetching(settings) as fetch:
            publish(redis, settings)
            redis.config_set("maxmemory", 1)
            refused = fetch()
            with caplog.at_level(logging.WARNING):
                refused.ack()
            assert "may not have noted" in caplog.text
            redis.config_set("maxmemory", 0)
            publish(redis, settings)
            fetched = fetch()
            fetched.channel.qos.ack("another")
            assert [*held(redis, settings)] == [fetched.delivery_tag]
            fetched.ack()
    finally:
        server.kill()
