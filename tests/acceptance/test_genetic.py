"""The solar array by the genetic algorithm, as a client of the service sees it."""

from __future__ import annotations

import time
from typing import Any

import httpx
import numpy as np
import pytest

Document = dict[str, Any]


@pytest.fixture
def solar_array(service: httpx.Client) -> Document:
    document: Document = service.get("/v1/cases/solar_array_1").json()
    return document | {"method": {"name": "ga", "processes": 2}}


def test_a_job_of_the_genetic_algorithm(service: httpx.Client, solar_array: Document) -> None:
    size = service.post("/v1/validate", json=solar_array).json()
    assert size["variables"] > 15
    posted = service.post("/v1/jobs", json=solar_array, headers={"Prefer": "wait=60"}, timeout=90)
    assert posted.status_code == 202
    job = service.get(f"/v1/jobs/{posted.json()['id']}", params={"wait": 60}, timeout=90).json()
    assert (job["status"], job["method"]) == ("succeeded", "ga")
    result = service.get(job["links"]["result"]).json()
    assert result["energy"] == result["objective"] == pytest.approx(4.443955080, rel=1e-7)
    assert result["residual"] <= 1e-9
    assert result["penalty"] == 100
    assert result["fitness_history"]
    assert result["verification"]["passed"]
    assert [len(values) for values in result["coefficients"]["controls"].values()] == [5, 5, 5]

    sampled = service.get(f"/v1/jobs/{job['id']}/trajectory", params={"t": "0,5", "derivatives": 1}).json()
    np.testing.assert_allclose(
        [row[-1] for row in sampled["states"].values()], [0, np.pi / 2, np.pi, np.pi], atol=1e-8
    )
    assert "<svg" in service.get(job["links"]["plot"]).text


def test_a_search_tells_its_diversity_and_is_cancelled_within_a_second(
    service: httpx.Client, solar_array: Document
) -> None:
    solar_array["method"] |= {"variant": "classic", "polish": False, "generations": 1_000_000}
    solar_array["options"] = {"starts": 2}
    job_id = service.post("/v1/jobs", json=solar_array).json()["id"]
    give_up = time.monotonic() + 30
    progress = None
    while not progress and time.monotonic() < give_up:
        progress = service.get(f"/v1/jobs/{job_id}").json()["progress"]
        time.sleep(0.05)
    assert progress is not None
    assert progress["stage"] == "search"
    assert progress["diversity"] > 0
    asked = time.monotonic()
    service.post(f"/v1/jobs/{job_id}/cancel")
    job = service.get(f"/v1/jobs/{job_id}", params={"wait": 30}, timeout=60).json()
    assert job["status"] == "cancelled"
    assert time.monotonic() - asked < 3.0  # a second, on a machine that does nothing else
    result = service.get(f"/v1/jobs/{job_id}/result").json()
    assert result["verification"]["max_state_error"] is not None
    assert [start["status"] for start in result["starts"]] == ["cancelled", "cancelled"]


def test_an_answer_without_costates_is_exported(service: httpx.Client, solar_array: Document) -> None:
    solar_array["method"] |= {"polish": False, "generations": 20}
    job_id = service.post("/v1/jobs", json=solar_array).json()["id"]
    assert service.get(f"/v1/jobs/{job_id}", params={"wait": 60}, timeout=90).json()["finished_at"]
    for name in ("json", "csv", "npz", "mat"):
        assert service.get(f"/v1/jobs/{job_id}/result", params={"format": name}).status_code == 200, name
