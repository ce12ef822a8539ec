"""The piecewise method through every process of the service: a worker's child with a predictor of its own."""

from __future__ import annotations

import time
from typing import Any

import httpx
import pytest

from solvers.catalogue import load_case
from tests.solvers.piecewise.documents import PENDULUM

Document = dict[str, Any]


def test_a_mission_is_predicted_and_tracked_inside_a_worker(service: httpx.Client) -> None:
    sizes = service.post("/v1/validate", json=PENDULUM)
    assert sizes.status_code == 200, sizes.text
    response = service.post("/v1/jobs", json=PENDULUM, headers={"Prefer": "wait=60"})
    job: Document = response.json()
    assert (job["status"], job["method"]) == ("succeeded", "piecewise"), job
    result = service.get(job["links"]["result"]).json()
    assert result["success"], result["message"]
    assert len(result["segments"]) == 4
    assert result["schedules"]["parallel"] > 0
    assert result["statistics"]["variables"] == sizes.json()["variables"]
    times = service.get(job["links"]["trajectory"], params={"samples": 7}).json()["t"]
    assert times == pytest.approx([0, 1, 2, 3, 4, 5, 6])
    assert service.get(job["links"]["plot"]).status_code == 200


def test_the_service_knows_method_models_and_cases(service: httpx.Client) -> None:
    methods = {item["name"]: item for item in service.get("/v1/methods").json()["methods"]}
    assert methods["piecewise"]["schema"]["required"] == ["name", "segments"]
    models = {item["name"] for item in service.get("/v1/models").json()["models"]}
    assert {"pse", "pse_exact", "edt", "edt_plant"} <= models
    for name in ("pse", "edt_dipole", "edt_igrf"):
        case = service.get(f"/v1/cases/{name}").json()
        assert service.post("/v1/validate", json=case).status_code == 200


def test_a_running_mission_is_cancelled_within_a_second_and_keeps_its_segments(service: httpx.Client) -> None:
    job: Document = service.post("/v1/jobs", json=load_case("pse")).json()
    address = job["links"]["self"]
    give_up = time.monotonic() + 60
    while not ((job["progress"] or {}).get("stage") or "").startswith("segment"):
        assert job["status"] in ("queued", "running"), job
        assert time.monotonic() < give_up
        time.sleep(0.05)
        job = service.get(address).json()
    asked = time.monotonic()
    assert service.post(job["links"]["cancel"]).status_code == 202
    job = service.get(address, params={"wait": 10}).json()
    assert job["status"] == "cancelled"
    assert time.monotonic() - asked < 3.0  # a second on a quiet machine
    result = service.get(job["links"]["result"]).json()
    assert result["success"] is False
    assert 1 <= len(result["segments"]) < 50
