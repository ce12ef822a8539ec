"""The command of a job over HTTP: any period and rule, as JSON, CSV and MAT."""

from __future__ import annotations

import io
import json
from collections.abc import Callable

import httpx
import numpy as np
import pytest
from scipy.io import loadmat

from solvers.solve import solve
from solvers.spec import check_document
from tests.problems import problem
from tests.solvers.phases.test_phases import BOUNCE
from worker.records import JobStatus
from worker.store import compress


@pytest.fixture
def command(job: Callable[..., str], solved: bytes) -> str:
    return f"/v1/jobs/{job(JobStatus.SUCCEEDED, solved)}/command"


def test_a_table_with_its_flight(client: httpx.Client, command: str) -> None:
    answer = client.get(command, params={"period": 0.1}).json()
    assert answer["rule"] == "average"
    assert len(answer["controls"]["T"]) == 259
    assert abs(answer["verification"]["states"]["alpha"]["error"]) < 1e-3
    sampled = client.get(command, params={"period": 0.1, "rule": "sample"}).json()
    assert sampled["controls"]["T"] != answer["controls"]["T"]


def test_one_table_over_all_phases(client: httpx.Client, job: Callable[..., str]) -> None:
    document = check_document({**BOUNCE, "method": {"name": "gpm", "nodes": 8}})
    packed = compress(json.dumps(solve(document).result()).encode())
    place = f"/v1/jobs/{job(JobStatus.SUCCEEDED, packed)}/command"
    table = client.get(place, params={"period": 0.3}).json()
    assert table["verification"]["phases"][1]["final_time"] == pytest.approx(2.1)
    text = client.get(place, params={"period": 0.3, "format": "csv"}).text
    assert text.splitlines()[0] == "t,u"
    assert [float(line.split(",")[1]) for line in text.splitlines()[1:]] == table["controls"]["u"]


def test_other_formats(client: httpx.Client, command: str) -> None:
    table = client.get(command, params={"period": 1, "format": "csv"})
    assert table.headers["content-type"].startswith("text/csv")
    assert table.text.splitlines()[0] == "t,T"
    assert len(table.text.splitlines()) == 27
    file = client.get(command, params={"period": 1}, headers={"accept": "application/x-matlab-data"})
    signals = loadmat(io.BytesIO(file.content))["command"][0, 0]["signals"][0, 0]
    assert np.shape(signals["values"]) == (26, 1)


def test_wrong_parameters_are_named(client: httpx.Client, command: str) -> None:
    for params, name in (
        ({}, "period"),
        ({"period": "0"}, "period"),
        ({"period": "1e-6"}, "period"),
        ({"period": "1", "rule": "mean"}, "rule"),
    ):
        members = problem(client.get(command, params=params), 422, "invalid-request")
        assert members["errors"][0]["parameter"] == name
    problem(client.get(command, params={"period": 1, "format": "xls"}), 406, "not-acceptable")


def test_states_of_a_job_without_a_result(
    client: httpx.Client, job: Callable[..., str], diverged: bytes
) -> None:
    problem(client.get(f"/v1/jobs/{job(JobStatus.RUNNING)}/command?period=1"), 409, "not-ready")
    problem(client.get("/v1/jobs/nothing/command?period=1"), 404, "not-found")
    place = f"/v1/jobs/{job(JobStatus.FAILED, diverged)}/command?period=1"
    problem(client.get(place), 404, "no-result")
