"""A sweep on the whole service: every worker takes part, every point is what a job of its own gives."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator

import httpx
import numpy as np
import pytest

from app.client import Client, SweepTimeout
from tests.acceptance.conftest import Document

K = "/problem/model/parameters/k"


@pytest.fixture
def client(service: httpx.Client) -> Iterator[Client]:
    with Client(str(service.base_url)) as client:
        yield client


def test_a_sweep_gives_what_single_jobs_give(client: Client, spacecraft: Document) -> None:
    spacecraft["method"]["J"] = 5
    swept = client.sweep(spacecraft, {K: {"from": 90, "to": 110, "count": 9}}, timeout=60)
    assert sum(swept["counts"].values()) == 9
    assert swept["counts"]["succeeded"] >= 5
    for index in (0, 4, 8):
        row = swept["table"][index]
        spacecraft["problem"]["model"]["parameters"]["k"] = row["point"][K]
        alone = client.solve(spacecraft)
        assert row["objective"] == pytest.approx(alone["objective"], rel=1e-7)
        assert row["verification"]["passed"] == alone["verification"]["passed"]
        assert client.job(row["job"])["attempts"] == 1
    with np.load(io.BytesIO(client.export_sweep(swept["id"], "npz", nodes=True))) as arrays:
        assert arrays["nodes.theta"].shape == (9, 257)
        assert arrays["objective"].tolist() == [row["objective"] for row in swept["table"]]


def test_a_point_without_an_answer_holds_up_no_other(client: Client, spacecraft: Document) -> None:
    spacecraft["options"]["max_iterations"] = 200
    swept = client.sweep(spacecraft, {"/problem/final_time": [[1, 100], [1, 5], [1, 99]]}, timeout=60)
    assert [row["status"] for row in swept["table"]] == ["succeeded", "failed", "succeeded"]
    assert swept["status"] == "failed"
    assert swept["table"][1]["error"] is not None


def test_all_points_are_cancelled(client: Client, long_job: Document) -> None:
    queued = client.submit_sweep(long_job, {K: {"from": 90, "to": 110, "count": 20}})
    with pytest.raises(SweepTimeout):
        client.wait_for_sweep(queued["id"], timeout=0.5)
    began = time.monotonic()
    client.cancel_sweep(queued["id"])
    ended = client.wait_for_sweep(queued["id"], timeout=20)
    assert ended["counts"]["queued"] == ended["counts"]["running"] == 0
    assert ended["counts"]["cancelled"] >= 17
    assert time.monotonic() - began < 15
