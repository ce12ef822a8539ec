"""The interface against its own description: whatever fits it, or does not, is answered as it says.

Schemathesis makes the requests, with all of its checks: no server error, statuses, media types, headers and
bodies as described, what does not fit refused, unknown methods refused, links that lead somewhere.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from app.client import Client
from tests.acceptance.conftest import Document

CONFIGURATION = Path(__file__).with_name("schemathesis.toml")


def examine(service: httpx.Client, configuration: Path, *options: str) -> str:
    """Run Schemathesis on a service; returns what it printed if nothing was wrong."""
    command = [
        sys.executable,
        "-m",
        "schemathesis.cli",
        f"--config-file={configuration}",
        "run",
        f"{service.base_url}/openapi.json",
        "--checks=all",
        "--continue-on-failure",
        "--no-color",
        "--request-timeout=20",
        "--generation-deterministic",
        *options,
    ]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=110)
    assert run.returncode == 0, run.stdout[-8000:] + run.stderr
    return run.stdout


def test_what_is_described_is_what_is_answered(service: httpx.Client) -> None:
    output = examine(service, CONFIGURATION, "--phases=examples,fuzzing,stateful", "--max-examples=4")
    cases = re.search(r"(\d+) generated, (\d+) passed", output)
    assert cases is not None
    assert int(cases[1]) == int(cases[2]) > 80


def test_what_is_described_of_a_job_is_what_is_answered(
    service: httpx.Client, spacecraft: Document, tmp_path: Path
) -> None:
    with Client(str(service.base_url)) as client:
        job_id = client.solve(spacecraft)["job_id"]
        grid = {"/problem/model/parameters/k": [99, 101]}
        sweep_id = client.sweep(spacecraft, grid)["id"]
    configuration = tmp_path / "schemathesis.toml"
    given = f'"path.job_id" = "{job_id}"\n"path.sweep_id" = "{sweep_id}"\n'
    configuration.write_text(f"[parameters]\n{given}\n{CONFIGURATION.read_text()}")
    options = (
        "--phases=fuzzing",
        "--max-examples=10",
        "--include-path-regex=_id}",
        "--exclude-method=DELETE",
    )
    output = examine(service, configuration, *options)
    assert "404 Not Found" not in output
    assert service.get(f"/v1/jobs/{job_id}").status_code == 200


def test_every_operation_is_described(service: httpx.Client) -> None:
    described = service.get("/openapi.json").json()
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            assert operation["summary"], (method, path)
            if path.startswith("/v1"):
                assert {"401", "403", "429"} <= set(operation["responses"]), (method, path)
    links = described["paths"]["/v1/jobs"]["post"]["responses"]["202"]["links"]
    assert {link["operationId"] for link in links.values()} > {"job_v1_jobs__job_id__get"}


@pytest.mark.parametrize("method", ["PUT", "PATCH", "TRACE"])
def test_methods_that_are_not_there(service: httpx.Client, method: str) -> None:
    answer = service.request(method, "/v1/jobs")
    assert answer.status_code == 405
    assert answer.headers["allow"] == "GET, HEAD, POST"
