"""Messages to others when a job has ended, signed as Standard Webhooks want it (standardwebhooks.com).

Off unless the operator gives a secret. A message says that the job has ended and how; what came of it is to
be fetched with a key. It is sent until it is taken (2xx), at most as often as `PAUSES` has entries and once
more; 410 ends it at once, redirects are not followed.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import json
import logging
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import httpcore

from app.egress import AddressRefused, Network, is_allowed, post
from app.schemas import JobView
from worker.errors import JobGone, JobNotFound
from worker.hooks import HookList
from worker.records import JobRecord, timestamp
from worker.store import JobStore

logger = logging.getLogger(__name__)

PAUSES = (5.0, 300.0, 1800.0, 7200.0, 18000.0, 36000.0, 50400.0, 72000.0, 86400.0)
"""Seconds before each further try."""

LOOK = 0.5
"""Time between two looks at the list, in seconds."""

_ATTEMPT_SECONDS = 10.0
_SECRET = "whsec_"  # noqa: S105 - how a secret begins
_SHORTEST_SECRET = 24
_AT_ONCE = 8
_NOT_ARRIVED = (
    AddressRefused,
    httpcore.NetworkError,
    httpcore.TimeoutException,
    httpcore.ProtocolError,
)
_TOLD = (
    "id",
    "name",
    "tags",
    "status",
    "method",
    "created_at",
    "started_at",
    "finished_at",
    "error",
    "links",
)


def read_secrets(path: Path) -> tuple[bytes, ...]:
    """Return the secrets in a file, one a line (``whsec_`` and base64); messages are signed with each.

    Raises ValueError for a file without any, or with one that is no secret, and OSError for none.
    """
    secrets = []
    for line in path.read_text().split():
        try:
            secret = base64.b64decode(line.removeprefix(_SECRET), validate=True)
        except binascii.Error:
            secret = b""
        if not line.startswith(_SECRET) or len(secret) < _SHORTEST_SECRET:
            raise ValueError(f"{path}: a secret is {_SECRET} and at least {_SHORTEST_SECRET} bytes in base64")
        secrets.append(secret)
    if not secrets:
        raise ValueError(f"{path} holds no secret")
    return tuple(secrets)


def signature(secrets: Sequence[bytes], message_id: str, moment: int, body: bytes) -> str:
    """Return the value of ``webhook-signature``: one signature for each secret."""
    signed = f"{message_id}.{moment}.".encode() + body
    return " ".join(
        f"v1,{base64.b64encode(hmac.digest(secret, signed, hashlib.sha256)).decode()}" for secret in secrets
    )


class Webhooks:
    """Sends what is due; any number of processes may."""

    def __init__(
        self,
        store: JobStore,
        hooks: HookList,
        secrets: Sequence[bytes],
        networks: Sequence[Network],
        pauses: Sequence[float] = PAUSES,
    ) -> None:
        self._store = store
        self._hooks = hooks
        self._secrets = secrets
        self._networks = networks
        self._pauses = pauses

    @property
    def enabled(self) -> bool:
        """Whether the operator allows them."""
        return bool(self._secrets)

    def refusal(self, url: str) -> str | None:
        """Return why nothing would ever be sent to an address, None if it may be."""
        if not self.enabled:
            return "unsupported: the operator of this service has not enabled webhooks"
        parts = urlsplit(url)
        try:
            inside = is_allowed(parts.hostname or "", self._networks)
        except ValueError:  # A name: who that is will be seen when something is sent.
            inside = parts.scheme == "https"
        else:
            public = is_allowed(parts.hostname or "")
            inside = inside and (parts.scheme == "https" or not public)
        return None if inside else "must be a public address, by https"

    def send_due(self) -> None:
        """Look at jobs that are due, and send what is to be sent."""
        ended = [record for job_id in self._due() if (record := self._ended(job_id)) is not None]
        if ended:
            # One that does not answer is not to hold up the others.
            with ThreadPoolExecutor(_AT_ONCE) as pool:
                list(pool.map(self._send, ended))

    def _due(self) -> list[str]:
        return self._hooks.take() if self.enabled else []

    def _ended(self, job_id: str) -> JobRecord | None:
        """The record of a job that has ended, None for one that is to be looked at later, or never more."""
        try:
            record = self._store.get(job_id)
        except (JobNotFound, JobGone):
            self._hooks.done(job_id)
            return None
        if record.status.final:
            return record
        # The longer it has run, the longer it is likely to run on.
        self._hooks.again(job_id, min(10.0, max(LOOK, 0.1 * (time.time() - record.created_at))))
        return None

    def _send(self, record: JobRecord) -> None:
        url, body = record.webhook or "", message(record)
        moment = int(time.time())
        message_id = f"msg_{record.id}"
        headers = [
            ("host", urlsplit(url).netloc),
            ("content-type", "application/json"),
            ("user-agent", "ondelette"),
            ("webhook-id", message_id),
            ("webhook-timestamp", str(moment)),
            ("webhook-signature", signature(self._secrets, message_id, moment, body)),
        ]
        try:
            status = post(url, body, headers, self._networks, _ATTEMPT_SECONDS)
            outcome = f"status {status}"
        except _NOT_ARRIVED as error:
            status, outcome = 0, f"{type(error).__name__}: {error}"
        if 200 <= status < 300:
            self._hooks.done(record.id)
            return
        tries = self._hooks.tried(record.id)
        if status == 410 or tries > len(self._pauses):
            logger.warning("job %s: its webhook is given up after %d tries (%s)", record.id, tries, outcome)
            self._hooks.done(record.id)
        else:
            pause = self._pauses[tries - 1]
            logger.info("job %s: its webhook did not arrive (%s); again in %g s", record.id, outcome, pause)
            self._hooks.again(record.id, pause)


def message(record: JobRecord) -> bytes:
    """Return the body of the message about a job that has ended."""
    job = JobView.of(record).model_dump(mode="json")
    content = {
        "type": f"job.{record.status}",
        "timestamp": timestamp(record.finished_at or time.time()),
        "data": {key: job[key] for key in _TOLD},
    }
    return json.dumps(content, separators=(",", ":")).encode()
