"""Flights over HTTP: how they become a job, and what is refused."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import httpx
import pytest
from click.testing import CliRunner, Result

from app.cli import main
from solvers.catalogue import load_case
from solvers.flights.run import run_flights
from solvers.output.bundle import Bundle, pack, unpack
from solvers.solve import solve
from solvers.spec import check_document
from solvers.spec.flights import check_flights
from tests.problems import problem
from tests.solvers.phases.test_phases import SLIDE_AND_ROLL
from worker.queue import JobQueue
from worker.records import JobStatus
from worker.store import JobStore, compress

ASKED = {"runs": 10, "seed": 1, "parameters": {"k": {"uniform": [90, 110]}}, "name": "soft", "tags": ["x"]}


@pytest.fixture
def source(job: Callable[..., str], solved: bytes) -> str:
    """A job that has an answer."""
    return job(JobStatus.SUCCEEDED, solved)


def test_flights_become_a_job_of_their_own(
    client: httpx.Client, store: JobStore, queue: JobQueue, source: str
) -> None:
    answer = client.post(f"/v1/jobs/{source}/flights", json=ASKED)
    assert answer.status_code == 202
    job = answer.json()
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
    assert int(answer.headers["retry-after"]) >= 1
    assert (job["method"], job["flights_of"], job["name"]) == ("flights", source, "soft")
    assert store.document(job["id"]) == client.get(job["links"]["spec"]).content
    assert client.get(job["links"]["spec"]).json() == ASKED
    assert queue.depth() == 1
    listed = client.get("/v1/jobs", params={"method": "flights"}).json()["jobs"]
    assert [item["id"] for item in listed] == [job["id"]]
    assert client.get(f"/v1/jobs/{source}").json()["links"]["flights"] == f"/v1/jobs/{source}/flights"


def test_a_key_is_of_one_answer(client: httpx.Client, job: Callable[..., str], solved: bytes) -> None:
    places = [f"/v1/jobs/{job(JobStatus.SUCCEEDED, solved)}/flights" for _ in range(2)]
    headers = {"Idempotency-Key": "once"}
    first, again = (client.post(places[0], json=ASKED, headers=headers).json() for _ in range(2))
    assert first["id"] == again["id"]
    problem(client.post(places[1], json=ASKED, headers=headers), 422, "key-reused")


def test_mistakes_are_told_by_pointer(client: httpx.Client, source: str) -> None:
    place = f"/v1/jobs/{source}/flights"
    asked = {"runs": 0, "parameters": {"K": {"uniform": [1, 2]}}, "actuator": {"T": {"lag": -1}}}
    members = problem(client.post(place, json=asked), 422, "invalid-document")
    pointers = {item["pointer"] for item in members["errors"]}
    assert pointers == {"/runs", "/parameters/K", "/actuator/T/lag"}
    problem(client.post(place, content=b"{"), 415, "unsupported-media-type")
    members = problem(
        client.post(place, content=b'{"runs": NaN}', headers={"Content-Type": "application/json"}),
        422,
        "invalid-document",
    )
    assert members["errors"][0]["pointer"] == "/runs"


def test_phases_are_flown_by_the_names_of_all_of_them(client: httpx.Client, job: Callable[..., str]) -> None:
    result = solve(check_document(SLIDE_AND_ROLL)).result()
    packed = compress(json.dumps(result).encode())
    place = f"/v1/jobs/{job(JobStatus.SUCCEEDED, packed)}/flights"
    assert client.post(place, json={"actuator": {"F": {"lag": 0.1}}}).status_code == 202
    asked = {"initial_state": {"y": {"values": [0]}}, "actuator": {"f": {"lag": 0.1}}}
    members = problem(client.post(place, json=asked), 422, "invalid-document")
    assert {item["pointer"] for item in members["errors"]} == {"/initial_state/y", "/actuator/f"}


def test_only_an_answer_can_be_flown(
    client: httpx.Client, job: Callable[..., str], diverged: bytes, store: JobStore, source: str
) -> None:
    def refused(job_id: str, status: int, name: str) -> None:
        problem(client.post(f"/v1/jobs/{job_id}/flights", json=ASKED), status, name)

    refused("nothing", 404, "not-found")
    refused(job(), 409, "not-ready")
    refused(job(JobStatus.RUNNING), 409, "not-ready")
    refused(job(JobStatus.CANCELLED), 404, "no-result")
    refused(job(JobStatus.FAILED, diverged), 404, "no-result")
    store.erase(source)
    refused(source, 410, "gone")


def test_missions_in_segments_are_unsupported(
    client: httpx.Client, job: Callable[..., str], solved: bytes
) -> None:
    result = json.loads(zlib.decompress(solved))
    result["resolved"]["document"] = load_case("pse")
    place = f"/v1/jobs/{job(JobStatus.SUCCEEDED, compress(json.dumps(result).encode()))}/flights"
    members = problem(client.post(place, json={}), 422, "unsupported")
    assert members["errors"][0]["type"] == "unsupported"


def test_a_bundle_of_flights_is_flown_again(
    client: httpx.Client, job: Callable[..., str], store: JobStore, source: str, solved: bytes, tmp_path: Path
) -> None:
    answer = json.loads(zlib.decompress(solved))
    asked = {"runs": 3, "parameters": ASKED["parameters"]}
    spec = check_flights(asked, answer["resolved"]["document"])
    flown = run_flights(spec, answer).result("flights", source)
    packed = compress(json.dumps(flown).encode())
    flights = job(
        JobStatus.SUCCEEDED, packed, method="flights", flights_of=source, document=json.dumps(asked).encode()
    )
    bundle = unpack(client.get(f"/v1/jobs/{flights}/bundle.zip").content)
    assert (bundle.result, bundle.flown) == (flown, answer)

    def replayed(bundle: Bundle) -> Result:
        file = tmp_path / "bundle.zip"
        file.write_bytes(pack(bundle.document, {}, bundle.result, [], bundle.flown))
        return CliRunner().invoke(main, ["replay", str(file)])

    again = replayed(bundle)
    assert again.exit_code == 0, again.output
    assert "every flight ends as the result says" in again.stdout
    flown["columns"]["theta_f"][1] += 1e-4
    other = replayed(replace(bundle, result=flown))
    assert (other.exit_code, other.stderr) == (1, "ondelette: not what the result says: theta_f\n")
    store.erase(source)
    alone = unpack(client.get(f"/v1/jobs/{flights}/bundle.zip").content)
    assert (alone.flown, replayed(alone).exit_code) == (None, 2)


def test_what_flights_do_not_have(
    client: httpx.Client, job: Callable[..., str], source: str, document: dict[str, object]
) -> None:
    result = {
        "kind": "flights",
        "flights_of": source,
        "columns": {"k": [90.0, 91.0], "theta_f": [0.5, None]},
    }
    packed = compress(json.dumps(result).encode())
    flights = job(JobStatus.SUCCEEDED, packed, method="flights", flights_of=source)
    here = f"/v1/jobs/{flights}"
    for part in ("trajectory", "plot.svg", "command?period=1", "report.html"):
        problem(client.get(f"{here}/{part}"), 404, "no-result")
    problem(client.post(f"{here}/flights", json=ASKED), 404, "no-result")
    for kind in ("npz", "mat"):
        problem(client.get(f"{here}/result", params={"format": kind}), 406, "not-acceptable")
    table = client.get(f"{here}/result", params={"format": "csv"})
    assert table.text == "run,k,theta_f\n0,90.0,0.5\n1,91.0,\n"
    members = problem(
        client.post("/v1/jobs", json={**document, "warm_start": flights}), 422, "invalid-document"
    )
    assert members["errors"][0]["pointer"] == "/warm_start"
