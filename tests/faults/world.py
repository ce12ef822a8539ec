"""A service of real processes to which everything happens, and what must hold all the same.

Nothing that was accepted is lost; every job comes to exactly one end; no solve's answer is written twice; no
status goes backwards; a job that was cancelled while it waited never starts; a submission that is repeated
under its key until it is answered makes one job. What was solved is counted in the worker's own process, not
read from what the service says of it.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import socket
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
from redis import Redis
from redis.exceptions import RedisError

from tests.faults.processes import API, WORKER, Process, listener
from tests.servers import DurableServer
from worker.records import TRANSITIONS, JobStatus

Document = dict[str, Any]

_FINAL = {status.value for status in JobStatus if status.final}
# A running job is told anew when it is asked to stop, or when another worker has taken it over.
_ALLOWED = {
    ("running", "running"),
    *((old.value, new.value) for old in JobStatus for new in TRANSITIONS[old]),
}
_FIRST_FAILURES = {503, 409}
# Of a client, in seconds: the API may be stopped, and whoever asks it is to go on with the next fault.
_PATIENCE = 1.5


@dataclass
class Submission:
    """A document that somebody wants to have solved, under a key of its own, and what is known of its job."""

    document: Document
    job_id: str | None = None
    cancelled: bool = False
    seen: str = "queued"
    final: Document | None = None

    @property
    def name(self) -> str:
        """Its name, which is its key as well."""
        return str(self.document["name"])


@dataclass
class World:
    """Starts everything in ``directory``; ``settings`` are the environment of all processes."""

    directory: Path
    settings: Mapping[str, str]
    workers: int = 2
    submissions: list[Submission] = field(default_factory=list)
    faults: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self.broker = DurableServer(self.directory)
        self.broker.start()
        self._socket = listener()
        self._notes = self.directory / "notes"
        self._notes.touch()
        environment = {
            **os.environ,
            "ONDELETTE_BROKER": self.broker.address,
            "OMP_NUM_THREADS": "1",
            **self.settings,
        }
        descriptor = self._socket.fileno()
        self.api = Process(API, [str(descriptor)], environment, self.directory / "api.log", descriptor)
        self.crew = [
            Process(
                WORKER,
                [f"worker{number}", str(self._notes)],
                environment,
                self.directory / f"worker{number}.log",
            )
            for number in range(self.workers)
        ]
        address = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        self.client = httpx.Client(base_url=address, timeout=_PATIENCE, trust_env=False)
        give_up = time.monotonic() + 90
        while self._ask("GET", "/livez") is None:
            assert time.monotonic() < give_up, f"no API; see {self.directory}"
            time.sleep(0.05)
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._number = 0

    # What users do.

    def submit(self, document: Document) -> Submission:
        """Submit a document once; what is not accepted then is submitted again later."""
        self._number += 1
        submission = Submission({**document, "name": f"job {os.getpid()} {self._number}"})
        self.submissions.append(submission)
        self._post(submission)
        return submission

    def cancel(self, submission: Submission) -> None:
        """Ask that a job be cancelled."""
        if submission.job_id is not None:
            answer = self._ask("POST", f"/v1/jobs/{submission.job_id}/cancel")
            submission.cancelled = True
            if answer is not None and answer.status_code == 202:
                self._note(submission, answer.json())

    @property
    def active(self) -> list[Submission]:
        """What has not ended yet, as far as anybody was told."""
        return [submission for submission in self.submissions if submission.final is None]

    def look(self) -> None:
        """Submit again what was not accepted, and see how the jobs stand; resume what is to go on by now."""
        now = time.monotonic()
        for due, resume in [entry for entry in self._later if entry[0] <= now]:
            self._later.remove((due, resume))
            resume()
        for submission in self.active:
            if submission.job_id is None:
                self._post(submission)
        for submission in self.active:
            if submission.job_id is not None:
                answer = self._ask("GET", f"/v1/jobs/{submission.job_id}")
                if answer is None or answer.status_code == 503:
                    return
                assert answer.status_code == 200, (submission, answer.text)
                self._note(submission, answer.json())

    def _post(self, submission: Submission) -> None:
        headers = {"Idempotency-Key": submission.name}
        answer = self._ask("POST", "/v1/jobs", json=submission.document, headers=headers)
        if answer is not None and answer.status_code not in _FIRST_FAILURES:
            assert answer.status_code == 202, answer.text
            submission.job_id = answer.json()["id"]

    def _ask(self, method: str, path: str, **request: Any) -> httpx.Response | None:
        try:
            return self.client.request(method, path, **request)
        except httpx.TransportError:
            return None

    def _note(self, submission: Submission, job: Document) -> None:
        status = job["status"]
        if submission.final is not None:
            assert job == submission.final
        # Between two looks a job may have gone more than one step, but not back from an end.
        assert submission.seen not in _FINAL or status == submission.seen, (submission, job)
        submission.seen = status
        if status in _FINAL:
            submission.final = job

    # What befalls the service.

    def inject(self, fault: str, choice: random.Random) -> None:
        """Let a fault happen; ``choice`` says to whom and for how long."""
        self.faults[fault] += 1
        getattr(self, f"_{fault}")(choice)

    def _kill_child(self, choice: random.Random) -> None:
        for child in choice.choice(self.crew).children():
            _send(child, signal.SIGKILL)

    def _stop_child(self, choice: random.Random) -> None:
        stopped = choice.choice(self.crew).children()
        for child in stopped:
            _send(child, signal.SIGSTOP)
        self._in(choice, lambda: [_send(child, signal.SIGCONT) for child in stopped])

    def _kill_worker(self, choice: random.Random) -> None:
        choice.choice(self.crew).kill()

    def _end_worker(self, choice: random.Random) -> None:
        worker = choice.choice(self.crew)
        worker.end()
        worker.start()

    def _stop_worker(self, choice: random.Random) -> None:
        self._stop(choice.choice(self.crew), choice)

    def _stop_api(self, choice: random.Random) -> None:
        self._stop(self.api, choice, 0.7)

    def _kill_api(self, choice: random.Random) -> None:
        self.api.kill()

    def _kill_broker(self, choice: random.Random) -> None:
        self.broker.kill()
        time.sleep(choice.uniform(0.0, 0.5))
        self.broker.start()

    def _stop_broker(self, choice: random.Random) -> None:
        self.broker.signal(signal.SIGSTOP)
        self._in(choice, lambda: self.broker.signal(signal.SIGCONT), 0.3)

    def _fill_broker(self, choice: random.Random) -> None:
        self._tell_broker(lambda redis: redis.config_set("maxmemory", 1))
        self._in(choice, lambda: self._tell_broker(lambda redis: redis.config_set("maxmemory", 0)), 0.3)

    def _cut_connections(self, choice: random.Random) -> None:
        kind = choice.choice(["normal", "pubsub"])
        self._tell_broker(lambda redis: redis.client_kill_filter(_type=kind))

    def _slow_connections(self, choice: random.Random) -> None:
        self._tell_broker(lambda redis: redis.client_pause(choice.randrange(50, 800)))

    def _cut_request(self, choice: random.Random) -> None:
        with socket.create_connection(self._socket.getsockname(), timeout=5) as caller:
            caller.sendall(
                b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
                b'Content-Length: 1000\r\n\r\n{"problem":'
            )

    def _stop(self, process: Process, choice: random.Random, longest: float = 1.5) -> None:
        process.signal(signal.SIGSTOP, all_of_it=True)
        self._in(choice, lambda: process.signal(signal.SIGCONT, all_of_it=True), longest)

    def _in(self, choice: random.Random, resume: Callable[[], object], longest: float = 1.5) -> None:
        """Resume within ``longest`` visibility timeouts; after one a worker is taken for lost."""
        seconds = choice.uniform(0.0, longest) * float(self.settings["ONDELETTE_VISIBILITY_SECONDS"])
        self._later.append((time.monotonic() + seconds, lambda: (resume(), None)[1]))

    def _tell_broker(self, tell: Callable[[Redis], object]) -> None:
        with Redis(unix_socket_path=self.broker.address.removeprefix("unix://"), socket_timeout=2) as redis:
            try:
                tell(redis)
            except RedisError:
                # It is being killed or stopped as well: tell it later.
                self._later.append((time.monotonic() + 0.5, lambda: self._tell_broker(tell)))

    # What must hold.

    def settle(self, seconds: float) -> Counter[str]:
        """Let everything go on, wait until every job has ended, and check what must hold.

        Returns how many jobs ended how, and forgets them.
        """
        give_up = time.monotonic() + seconds
        while self._later or self.active:
            for due, resume in sorted(self._later, key=lambda entry: entry[0]):
                self._later.remove((due, resume))
                resume()
            self.look()
            endless = [(each.name, each.job_id, each.seen) for each in self.active]
            assert time.monotonic() < give_up, f"no end of {endless}; see {self.directory}"
            time.sleep(0.1)
        self.client.timeout = 30
        assert self.api.alive
        assert all(worker.alive for worker in self.crew), "a worker has ended by itself"
        notes = [line.split(" ") for line in self._notes.read_text().splitlines()]
        starts = Counter(" ".join(words[1:-1]) for words in notes if words[0] == "start")
        for submission in self.submissions:
            self._check(submission, starts[submission.name])
        listed = Counter(job["name"] for job in self._all_jobs())
        assert {submission.name for submission in self.submissions} <= listed.keys()
        assert set(listed.values()) <= {1}, listed
        ends = Counter(_end(submission) for submission in self.submissions)
        self.submissions.clear()
        self.client.timeout = _PATIENCE
        return ends

    def _check(self, submission: Submission, starts: int) -> None:
        job = submission.final
        assert job is not None
        here = f"/v1/jobs/{job['id']}"
        assert self.client.get(here).json() == job, "a final job has changed"
        told = self._told(here)
        statuses = [event for event in told if event not in ("progress", "result")]
        assert statuses[0] == "queued"
        assert all(step in _ALLOWED for step in pairwise(statuses)), statuses
        assert [status for status in statuses if status in _FINAL] == [job["status"]], statuses
        assert job["attempts"] == 0 or "running" in statuses
        # A child may be killed between the word that it starts and the start itself.
        assert starts <= job["attempts"], (job, starts)
        assert told.count("result") <= 1
        assert (self.client.get(f"{here}/result").status_code == 200) == (told.count("result") == 1)
        self._check_end(submission, job, starts)

    def _check_end(self, submission: Submission, job: Document, starts: int) -> None:
        if job["status"] == "succeeded":
            result = self.client.get(f"/v1/jobs/{job['id']}/result").json()
            assert (result["success"], result["job_id"]) == (True, job["id"])
            assert starts >= 1
        elif job["status"] == "cancelled":
            assert submission.cancelled
        else:
            limited = submission.document["options"].get("max_seconds") is not None
            allowed = {"worker_lost"} | ({"time_limit"} if limited else set())
            assert job["error"]["type"] in allowed, job
            if job["error"]["type"] == "worker_lost":
                assert job["attempts"] >= 2

    def _told(self, here: str) -> list[str]:
        told = []
        with self.client.stream("GET", f"{here}/events") as stream:
            kind = ""
            for line in stream.iter_lines():
                name, _, value = line.partition(": ")
                if name == "event":
                    kind = value
                elif name == "data":
                    told.append(json.loads(value)["status"] if kind == "status" else kind)
        return told

    def _all_jobs(self) -> list[Document]:
        jobs: list[Document] = []
        path: str | None = "/v1/jobs?limit=100"
        while path is not None:
            page = self.client.get(path)
            jobs += page.json()["jobs"]
            path = page.links["next"]["url"] if "next" in page.links else None
        return jobs

    def close(self) -> None:
        """End everything."""
        for process in (*self.crew, self.api):
            process.end()
        self.client.close()
        self._socket.close()
        self.broker.kill()


FAULTS = (
    "kill_child",
    "stop_child",
    "kill_worker",
    "end_worker",
    "stop_worker",
    "kill_api",
    "stop_api",
    "kill_broker",
    "stop_broker",
    "fill_broker",
    "cut_connections",
    "slow_connections",
    "cut_request",
)


def _end(submission: Submission) -> str:
    assert submission.final is not None
    error = submission.final["error"]
    return str(submission.final["status"] if error is None else error["type"])


def _send(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)
