"""How a client follows the events of a job: it reads their stream, and takes it up again where it was cut."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal
from urllib.parse import quote

import httpx

from app.client_answers import ServerUnreachable
from app.client_calls import FINAL
from app.client_steps import RETRIES, Call, Patience

# The service is never silent for longer than a third of this, in seconds.
SILENCE = 45.0
_PAUSE = 1.0


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to a job.

    ``data`` of a ``status`` holds ``job_id``, ``status``, ``attempts``, ``cancel_requested``, ``error`` and
    ``at``; of ``progress`` the report of the solve, with the ``iterates`` since the last one (stage,
    iteration, objective, infeasibility) and now and then a coarse ``trajectory``; of ``result`` the address
    of the result, ``href``.
    """

    id: str
    type: Literal["status", "progress", "result"]
    data: dict[str, Any]


@dataclass(slots=True)
class Following:
    """The state of one following: where it stands, what it bears. No input or output."""

    job_id: str
    last: str | None = None
    ended: bool = False
    _cuts: int = 0
    _patience: Patience = field(default_factory=Patience)
    _fields: dict[str, str] = field(default_factory=dict)

    @property
    def path(self) -> str:
        """Where the events are."""
        return f"/v1/jobs/{quote(self.job_id, safe='')}/events"

    @property
    def headers(self) -> Mapping[str, str]:
        """The headers of the next request."""
        resume = {} if self.last is None else {"Last-Event-ID": self.last}
        return {"Accept": "text/event-stream", **resume}

    def begin(self, response: httpx.Response) -> float | None:
        """Look at an answer before its body is read as a stream; the body of a refusal must be read already.

        Returns the seconds after which to ask again, None to go on. Raises RequestRefused.
        """
        self._fields = {}
        self.ended = response.status_code == httpx.codes.NO_CONTENT
        if response.is_success:
            return None
        pause = self._patience.pause_after(response)
        if pause is None:
            refused: Call[None] = Call("GET", self.path, lambda _: None)
            refused.finish(response)
        return pause

    def read(self, line: str) -> Event | None:
        """Take in one line; return the event that it completes."""
        if line:
            name, _, value = line.partition(":")
            self._fields[name] = value.removeprefix(" ")
            return None
        fields, self._fields = self._fields, {}
        if "data" not in fields:
            return None
        event = Event(fields["id"], fields["event"], json.loads(fields["data"]))  # type: ignore[arg-type]
        self.last = event.id
        self.ended = event.type == "status" and event.data["status"] in FINAL
        self._cuts = 0
        self._patience = Patience()
        return event

    def cut(self, error: httpx.TransportError | None) -> float:
        """Note that the stream ended too early; return after how many seconds to take it up again.

        Raises ServerUnreachable if that has become a habit.
        """
        self._cuts += 1
        if self._cuts > RETRIES:
            reason = "the stream ends at once" if error is None else str(error) or type(error).__name__
            raise ServerUnreachable(f"no events of job {self.job_id}: {reason}") from error
        return _PAUSE
