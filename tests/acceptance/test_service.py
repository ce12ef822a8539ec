"""A job from its document to its result, through every process of the service."""

import csv
import io
import json
import time
from itertools import pairwise
from typing import Any

import httpx
import numpy as np
import pytest
from scipy.io import loadmat

from tests.problems import problem
from worker.records import JobStatus, new_job_id

Document = dict[str, Any]

RIGID_BODY: Document = {
    "name": "Rigid body",
    "tags": ["acceptance"],
    "problem": {
        "model": {
            "kind": "first_order",
            "states": ["x", "v"],
            "controls": ["u"],
            "dynamics": {"x": "v", "v": "u"},
        },
        "final_time": [0.5, 10],
        "initial_state": {"x": 0, "v": 0},
        "final_state": {"x": 1, "v": 0},
        "bounds": {"u": [-1, 1]},
        "objective": {"terminal": "tf"},
    },
    "method": {"name": "swcm", "J": 2},
}


def solved(service: httpx.Client, document: Document) -> Document:
    response = service.post("/v1/jobs", json=document, headers={"Prefer": "wait=60"})
    assert response.status_code == 202, response.text
    assert response.headers["preference-applied"] == "wait=60"
    job: Document = response.json()
    assert job["status"] in ("succeeded", "failed", "cancelled"), job
    return job


@pytest.fixture(scope="module")
def slew(service: httpx.Client) -> Document:
    """The flexible spacecraft's slew, done."""
    from tests.bad_documents import FLEXIBLE_SPACECRAFT

    job = solved(service, FLEXIBLE_SPACECRAFT)
    assert job["status"] == "succeeded", job
    return job


def test_the_slew_of_the_flexible_spacecraft(service: httpx.Client, slew: Document) -> None:
    assert slew["attempts"] == 1
    assert slew["created_at"] <= slew["started_at"] <= slew["finished_at"]
    result = service.get(slew["links"]["result"]).json()
    assert result["job_id"] == slew["id"]
    assert result["success"] is True
    assert result["status"] == "converged"
    assert result["objective"] == pytest.approx(25.866100388, abs=1e-3)
    assert result["verification"]["passed"] is True
    assert len(result["switching"]["T"]["times"]) == 3
    assert result["switching"]["T"]["times"] == pytest.approx([11.6327, 12.9331, 14.2334], abs=0.05)


def test_the_rigid_body(service: httpx.Client) -> None:
    job = solved(service, RIGID_BODY)
    assert (job["status"], job["method"]) == ("succeeded", "swcm")
    result = service.get(job["links"]["result"]).json()
    assert result["final_time"] == pytest.approx(2.0, abs=2e-3)


def test_every_format_of_the_result(service: httpx.Client, slew: Document) -> None:
    result = service.get(slew["links"]["result"]).json()
    theta = result["trajectory"]["states"]["theta"]
    assert len(theta) >= 201

    rows = list(
        csv.DictReader(io.StringIO(service.get(slew["links"]["result"], params={"format": "csv"}).text))
    )
    assert [float(row["theta"]) for row in rows] == theta

    npz = service.get(slew["links"]["result"], headers={"Accept": "application/x-npz"})
    assert np.load(io.BytesIO(npz.content), allow_pickle=False)["theta"].tolist() == theta

    mat = service.get(slew["links"]["result"], headers={"Accept": "application/x-matlab-data"})
    assert loadmat(io.BytesIO(mat.content), simplify_cells=True)["states"]["theta"].tolist() == theta


def test_the_trajectory_at_any_times(service: httpx.Client, slew: Document) -> None:
    sampled = service.get(slew["links"]["trajectory"], params={"t": "0,0.5,1", "derivatives": 1}).json()
    assert sampled["t"] == [0, 0.5, 1]
    assert sampled["states"]["theta"][0] == pytest.approx(0, abs=1e-12)
    assert sampled["controls"]["T"] == pytest.approx([5, 5, 5], abs=1e-6)
    assert sampled["rates"]["theta"] == pytest.approx(sampled["states"]["theta_dot"], abs=1e-9)


def test_the_picture(service: httpx.Client, slew: Document) -> None:
    svg = service.get(slew["links"]["plot"])
    assert svg.headers["content-type"] == "image/svg+xml"
    assert b"</svg>" in svg.content
    png = service.get(slew["links"]["plot"].replace(".svg", ".png"))
    assert png.content.startswith(b"\x89PNG")


def test_a_job_that_does_not_change_is_not_sent_again(service: httpx.Client, slew: Document) -> None:
    first = service.get(slew["links"]["self"])
    assert first.json() == slew
    again = service.get(slew["links"]["self"], headers={"If-None-Match": first.headers["etag"]})
    assert again.status_code == 304


def test_an_impossible_slew_fails_and_its_last_iterate_can_be_read(
    service: httpx.Client, spacecraft: Document
) -> None:
    spacecraft["problem"]["final_time"] = 5
    job = solved(service, spacecraft)
    assert job["status"] == "failed"
    assert job["error"]["type"] == "infeasible"
    assert job["error"]["title"].endswith(".")
    result = service.get(job["links"]["result"]).json()
    assert (result["success"], result["status"]) == (False, "infeasible")
    assert result["diagnosis"][0]["pointer"] == "/problem/final_state/theta"
    assert "/problem/final_state/theta" in job["error"]["detail"]
    assert result["verification"]["passed"] is False
    assert service.get(job["links"]["plot"]).status_code == 200


def test_a_limit_of_time_or_iterations_ends_the_solve(service: httpx.Client, long_job: Document) -> None:
    long_job["options"]["max_seconds"] = 0.5
    job = solved(service, long_job)
    assert (job["status"], job["error"]["type"]) == ("failed", "time_limit")
    long_job["options"] = {"max_iterations": 2}
    long_job["method"] = {"name": "hermite_simpson"}
    job = solved(service, long_job)
    assert (job["status"], job["error"]["type"]) == ("failed", "iteration_limit")


def test_a_model_without_a_value_is_an_evaluation_error(service: httpx.Client, spacecraft: Document) -> None:
    spacecraft["problem"]["objective"]["running"] = "sqrt(-1 - theta^2)"
    job = solved(service, spacecraft)
    assert (job["status"], job["error"]["type"]) == ("failed", "evaluation_error")
    assert "/problem/objective/running" in job["error"]["detail"]


def started(service: httpx.Client, job_id: str) -> Document:
    give_up = time.monotonic() + 20
    while time.monotonic() < give_up:
        job: Document = service.get(f"/v1/jobs/{job_id}").json()
        if job["status"] != "queued" and job["progress"] is not None:
            return job
        time.sleep(0.02)
    pytest.fail(f"not started: {job}")


def test_a_running_job_tells_its_progress_and_is_cancelled(service: httpx.Client, long_job: Document) -> None:
    job_id = service.post("/v1/jobs", json=long_job).json()["id"]
    running = started(service, job_id)
    assert running["status"] == "running"
    assert set(running["progress"]) == {"stage", "iteration", "objective", "infeasibility", "fraction"}
    problem(service.get(f"/v1/jobs/{job_id}/result"), 409, "not-ready")
    problem(service.delete(f"/v1/jobs/{job_id}"), 409, "conflict")

    asked = time.monotonic()
    for _ in range(2):
        answer = service.post(f"/v1/jobs/{job_id}/cancel")
        assert (answer.status_code, answer.json()["cancel_requested"]) == (202, True)
    job = service.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
    assert job["status"] == "cancelled"
    assert job["error"] is None
    assert time.monotonic() - asked < 4.5
    result = service.get(f"/v1/jobs/{job_id}/result").json()
    assert (result["success"], result["status"]) == (False, "cancelled")


def test_a_queued_job_that_is_cancelled_never_starts(service: httpx.Client, long_job: Document) -> None:
    # Two jobs keep both slots of the worker busy while a third one waits.
    busy = [service.post("/v1/jobs", json=long_job).json()["id"] for _ in range(2)]
    for job_id in busy:
        started(service, job_id)
    waiting = service.post("/v1/jobs", json=RIGID_BODY).json()["id"]
    cancelled = service.post(f"/v1/jobs/{waiting}/cancel").json()
    assert (cancelled["status"], cancelled["attempts"]) == ("cancelled", 0)
    for job_id in busy:
        service.post(f"/v1/jobs/{job_id}/cancel")
    for job_id in busy:
        assert service.get(f"/v1/jobs/{job_id}?wait=30").json()["status"] == "cancelled"
    # The worker has passed over the cancelled job once it has done a later one.
    assert solved(service, RIGID_BODY)["status"] == "succeeded"
    assert service.get(f"/v1/jobs/{waiting}").json() == cancelled
    problem(service.get(f"/v1/jobs/{waiting}/result"), 404, "no-result")


def test_a_job_starts_from_an_earlier_one(service: httpx.Client, slew: Document) -> None:
    from tests.bad_documents import FLEXIBLE_SPACECRAFT

    finer = {**FLEXIBLE_SPACECRAFT, "method": {"name": "swcm", "J": 5}}
    cold, warm = solved(service, finer), solved(service, {**finer, "warm_start": slew["id"]})
    results = [service.get(job["links"]["result"]).json() for job in (cold, warm)]
    assert results[1]["objective"] == pytest.approx(results[0]["objective"], abs=1e-5)
    assert results[1]["statistics"]["iterations"] < results[0]["statistics"]["iterations"]


def test_a_start_from_nowhere_is_refused(service: httpx.Client) -> None:
    response = service.post("/v1/jobs", json={**RIGID_BODY, "warm_start": new_job_id()})
    assert response.status_code == 422
    assert [fault["pointer"] for fault in response.json()["errors"]] == ["/warm_start"]


def test_whoever_waits_is_told_at_once(service: httpx.Client) -> None:
    job = service.post("/v1/jobs", json=RIGID_BODY).json()
    final = service.get(job["links"]["self"], params={"wait": 60}).json()
    answered = time.time()
    assert final["status"] == "succeeded"
    finished = (
        np.datetime64(final["finished_at"].removesuffix("Z")).astype("datetime64[ms]").astype(int) / 1000
    )
    # Far below the two seconds after which a waiting request looks by itself.
    assert answered - finished < 0.5


def test_jobs_are_listed_newest_first_page_by_page(service: httpx.Client) -> None:
    document = {**RIGID_BODY, "tags": [new_job_id()]}
    made = [solved(service, document)["id"] for _ in range(3)]
    response = service.get("/v1/jobs", params={"tag": document["tags"][0], "limit": 2, "status": "succeeded"})
    pages = [response]
    while "next" in pages[-1].links:
        pages.append(service.get(pages[-1].links["next"]["url"]))
    listed = [job["id"] for page in pages for job in page.json()["jobs"]]
    assert listed == made[::-1]
    assert len(pages) == 2
    everything = [job["created_at"] for job in service.get("/v1/jobs?limit=100").json()["jobs"]]
    assert all(later >= earlier for later, earlier in pairwise(everything))


def test_an_erased_job_is_gone(service: httpx.Client) -> None:
    job = solved(service, RIGID_BODY)
    assert service.delete(job["links"]["self"]).status_code == 204
    for name, address in job["links"].items():
        method = "POST" if name in ("cancel", "flights", "pin") else "GET"
        body = {"runs": 1} if name == "flights" else None
        problem(service.request(method, address, json=body), 410, "gone")
    problem(service.delete(job["links"]["self"]), 410, "gone")


def test_the_document_comes_back_as_submitted(service: httpx.Client) -> None:
    body = json.dumps(RIGID_BODY, indent=1).encode()
    job = service.post("/v1/jobs", content=body, headers={"Content-Type": "application/json"}).json()
    assert service.get(job["links"]["spec"]).content == body


def test_the_same_key_makes_one_job(service: httpx.Client) -> None:
    key = {"Idempotency-Key": new_job_id()}
    jobs = [service.post("/v1/jobs", json=RIGID_BODY, headers=key).json() for _ in range(3)]
    assert len({job["id"] for job in jobs}) == 1
    final = service.get(jobs[0]["links"]["self"], params={"wait": 30}).json()
    assert (final["status"], final["attempts"]) == (JobStatus.SUCCEEDED, 1)


@pytest.mark.parametrize("name", ["flexible_spacecraft", "rigid_body"])
def test_a_case_on_board_is_solved_as_it_is(service: httpx.Client, name: str) -> None:
    case = service.get(f"/v1/cases/{name}").json()
    job = solved(service, case)
    assert job["status"] == "succeeded", job
    objective = service.get(job["links"]["result"]).json()["objective"]
    assert objective == pytest.approx(case["reference"]["objective"], rel=1e-3)
