"""The message that makes a worker look at a job, as Celery and kombu write it.

Composed here rather than by Celery's producer, so that it can be pushed by the very script that records its
job, and because that is most of what a submission costs. The task is in Celery's protocol 2
(docs.celeryq.dev, internals/protocol), the envelope that of kombu's Redis transport; a test compares both
with what `celery.Celery.send_task` pushes.
"""

from __future__ import annotations

import base64
import time
import uuid
from collections.abc import Mapping
from typing import Any

import orjson

from worker.logs import request_id
from worker.traces import carried

PUBLISHED = "published"
REQUEST_HEADER = "request_id"
SOLVE_TASK = "ondelette.solve"

_NOTHING_FOLLOWS = {"callbacks": None, "errbacks": None, "chain": None, "chord": None}
_PLAIN: Mapping[str, Any] = {
    "lang": "py",
    "task": SOLVE_TASK,
    **dict.fromkeys(("shadow", "eta", "expires", "group", "group_index", "parent_id", "stamped_headers")),
    "stamps": {},
    "retries": 0,
    "replaced_task_nesting": 0,
    "ignore_result": None,
    "kwargsrepr": "{}",
}


def message_of(job_id: str, queue: str, time_limit: int) -> bytes:
    """Return the message of a job that waits in ``queue``; its child is killed after ``time_limit`` seconds.

    It carries the id of the request that is being answered, and the context of its trace.
    """
    body = orjson.dumps([[job_id], {}, _NOTHING_FOLLOWS])
    headers = {
        **_PLAIN,
        "id": job_id,
        "root_id": job_id,
        "timelimit": [time_limit, None],
        "argsrepr": repr([job_id]),
        PUBLISHED: time.time(),
        **_about(),
    }
    properties = {
        "correlation_id": job_id,
        "delivery_mode": 2,
        "delivery_info": {"exchange": "", "routing_key": queue},
        "priority": 0,
        "body_encoding": "base64",
        # By it the message is acknowledged; one that is published twice is two messages.
        "delivery_tag": str(uuid.uuid4()),
    }
    envelope = {
        "body": base64.b64encode(body).decode(),
        "content-encoding": "utf-8",
        "content-type": "application/json",
        "headers": headers,
        "properties": properties,
    }
    return orjson.dumps(envelope)


def _about() -> dict[str, str]:
    """What a message carries of the request that it comes from: its id, and the context of its trace."""
    request = request_id.get()
    return carried() if request is None else {REQUEST_HEADER: request, **carried()}
