import csv
import io
import json
import xml.etree.ElementTree
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np
import pytest
from scipy.io import loadmat

from solvers.output.bundle import unpack
from tests.problems import problem
from worker.records import JobStatus

Make = Callable[..., str]


@pytest.fixture
def result(solved: bytes) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(zlib.decompress(solved))
    return read


@pytest.fixture
def done(job: Make, solved: bytes) -> str:
    return f"/v1/jobs/{job(JobStatus.SUCCEEDED, solved, name='A <b>name</b> & more')}"


PARTS = ("/result", "/result?format=csv", "/trajectory", "/plot.svg", "/plot.png")


@pytest.mark.parametrize("status", [JobStatus.QUEUED, JobStatus.RUNNING])
@pytest.mark.parametrize("part", PARTS)
def test_the_result_of_an_active_job_is_not_ready(
    client: httpx.Client, job: Make, status: JobStatus, part: str
) -> None:
    response = client.get(f"/v1/jobs/{job(status)}{part}")
    problem(response, 409, "not-ready")
    assert int(response.headers["retry-after"]) >= 1


@pytest.mark.parametrize("part", PARTS)
def test_a_job_that_ended_without_an_iterate_has_no_result(
    client: httpx.Client, job: Make, part: str
) -> None:
    problem(client.get(f"/v1/jobs/{job(JobStatus.CANCELLED)}{part}"), 404, "no-result")


@pytest.mark.parametrize("status", [JobStatus.FAILED, JobStatus.CANCELLED])
def test_the_last_iterate_of_a_job_without_success_can_be_read(
    client: httpx.Client, job: Make, solved: bytes, result: dict[str, Any], status: JobStatus
) -> None:
    assert client.get(f"/v1/jobs/{job(status, solved)}/result").json() == result


@pytest.mark.parametrize(
    ("accept", "kind"),
    [
        (None, "application/json"),
        ("*/*", "application/json"),
        ("application/json", "application/json"),
        ("text/csv", "text/csv"),
        ("text/*", "text/csv"),
        ("application/x-npz", "application/x-npz"),
        ("application/x-matlab-data", "application/x-matlab-data"),
        ("application/json;q=0.1, text/csv;q=0.5", "text/csv"),
        ("text/html, application/xhtml+xml, */*;q=0.8", "application/json"),
        ("application/json;q=0, */*", "text/csv"),
        ("TEXT/CSV", "text/csv"),
    ],
)
def test_the_client_chooses_the_format(
    client: httpx.Client, done: str, accept: str | None, kind: str
) -> None:
    response = client.get(f"{done}/result", headers={} if accept is None else {"Accept": accept})
    assert response.status_code == 200
    assert response.headers["content-type"].partition(";")[0] == kind
    assert response.headers["vary"] == "Accept, Accept-Encoding"
    assert response.headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    "accept", ["text/html", "image/*", "application/json;q=0", "application/json;q=x", ","]
)
def test_a_format_that_there_is_not(client: httpx.Client, done: str, accept: str) -> None:
    members = problem(client.get(f"{done}/result", headers={"Accept": accept}), 406, "not-acceptable")
    assert "text/csv" in members["detail"]


def test_the_format_parameter_goes_before_accept(client: httpx.Client, done: str) -> None:
    response = client.get(f"{done}/result", params={"format": "csv"}, headers={"Accept": "application/json"})
    assert response.headers["content-type"].startswith("text/csv")
    problem(client.get(f"{done}/result", params={"format": "xlsx"}), 406, "not-acceptable")


def test_json_is_what_the_solve_returned(client: httpx.Client, done: str, result: dict[str, Any]) -> None:
    plain, packed = (
        client.get(f"{done}/result", headers={"Accept-Encoding": coding})
        for coding in ("identity", "deflate, br")
    )
    assert plain.json() == packed.json() == result
    assert "content-encoding" not in plain.headers
    assert packed.headers["content-encoding"] == "deflate"
    assert int(packed.headers["content-length"]) < int(plain.headers["content-length"]) / 2


def test_files_hold_the_sampled_trajectory(client: httpx.Client, done: str, result: dict[str, Any]) -> None:
    expected = result["trajectory"]
    header, *rows = csv.reader(io.StringIO(client.get(f"{done}/result?format=csv").text))
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))

    answer = client.get(f"{done}/result?format=npz")
    assert answer.headers["content-disposition"].endswith('.npz"')
    arrays = np.load(io.BytesIO(answer.content), allow_pickle=False)

    matlab = loadmat(io.BytesIO(client.get(f"{done}/result?format=mat").content), simplify_cells=True)
    for name, values in {"t": expected["t"], **expected["states"], **expected["controls"]}.items():
        np.testing.assert_array_equal(table[name], values)
        np.testing.assert_array_equal(arrays[name], values)
    np.testing.assert_array_equal(matlab["states"]["theta"], expected["states"]["theta"])
    np.testing.assert_array_equal(matlab["controls"]["T"], expected["controls"]["T"])


class TestTrajectory:
    def test_at_given_times(self, client: httpx.Client, done: str, result: dict[str, Any]) -> None:
        nodes = result["nodes"]
        times = nodes["t"][3:6]
        sampled = client.get(f"{done}/trajectory", params={"t": ",".join(map(repr, times))}).json()
        assert sampled["t"] == times
        assert set(sampled["states"]) == {"theta", "alpha", "theta_dot", "alpha_dot"}
        np.testing.assert_allclose(sampled["states"]["theta"], nodes["states"]["theta"][3:6], atol=1e-12)
        np.testing.assert_allclose(sampled["controls"]["T"], nodes["controls"]["T"][3:6], atol=1e-9)
        assert "rates" not in sampled

    def test_by_number(self, client: httpx.Client, done: str, result: dict[str, Any]) -> None:
        sampled = client.get(f"{done}/trajectory", params={"samples": 5}).json()
        np.testing.assert_allclose(sampled["t"], np.linspace(0, result["final_time"], 5))
        assert len(client.get(f"{done}/trajectory").json()["t"]) == 201
        assert len(client.get(f"{done}/trajectory", params={"samples": 20_001}).json()["t"]) == 20_001

    def test_by_step(self, client: httpx.Client, done: str, result: dict[str, Any]) -> None:
        final = result["final_time"]
        sampled = client.get(f"{done}/trajectory", params={"dt": 0.5}).json()
        np.testing.assert_allclose(sampled["t"], np.arange(0, final, 0.5))
        # The last of equal steps that end at the final time counts, however they are rounded.
        for steps in (3, 7, 10, 49, 20_000):
            sampled = client.get(f"{done}/trajectory", params={"dt": final / steps}).json()
            assert len(sampled["t"]) == steps + 1
            assert sampled["t"][-1] == pytest.approx(final, abs=1e-9)
        assert client.get(f"{done}/trajectory", params={"dt": 1e6}).json()["t"] == [0.0]

    def test_with_rates(self, client: httpx.Client, done: str) -> None:
        sampled = client.get(f"{done}/trajectory", params={"samples": 50, "derivatives": 1}).json()
        np.testing.assert_allclose(sampled["rates"]["theta"], sampled["states"]["theta_dot"], atol=1e-9)

    def test_with_outputs(self, client: httpx.Client, done: str) -> None:
        sampled = client.get(f"{done}/trajectory", params={"samples": 50}).json()
        np.testing.assert_allclose(
            sampled["outputs"]["root_moment"], 200.0 * np.array(sampled["states"]["alpha"])
        )

    @pytest.mark.parametrize(
        ("params", "name"),
        [
            ({"samples": "1"}, "samples"),
            ({"samples": "20002"}, "samples"),
            ({"samples": "many"}, "samples"),
            ({"dt": "0"}, "dt"),
            ({"dt": "-1"}, "dt"),
            ({"dt": "nan"}, "dt"),
            ({"dt": "inf"}, "dt"),
            ({"dt": "1e-300"}, "dt"),
            ({"dt": "0.001"}, "dt"),
            ({"t": ""}, "t"),
            ({"t": "0,,1"}, "t"),
            ({"t": "0,one"}, "t"),
            ({"t": "nan"}, "t"),
            ({"t": "-0.1"}, "t"),
            ({"t": "0,1e3"}, "t"),
            ({"t": "1", "dt": "1"}, "samples"),
            ({"derivatives": "perhaps"}, "derivatives"),
        ],
    )
    def test_wrong_parameters_are_named(
        self, client: httpx.Client, done: str, params: dict[str, str], name: str
    ) -> None:
        members = problem(client.get(f"{done}/trajectory", params=params), 422, "invalid-request")
        assert members["errors"][0]["parameter"] == name

    def test_too_many_times(self, client: httpx.Client, done: str) -> None:
        response = client.get(f"{done}/trajectory?t={','.join('0' * 20_002)}")
        assert "20,001" in problem(response, 422, "invalid-request")["detail"]
        assert client.get(f"{done}/trajectory?t={','.join('0' * 20_001)}").status_code == 200

    def test_an_iterate_that_is_not_finite_cannot_be_resampled(
        self, client: httpx.Client, job: Make, diverged: bytes
    ) -> None:
        here = f"/v1/jobs/{job(JobStatus.FAILED, diverged)}"
        problem(client.get(f"{here}/trajectory"), 404, "no-result")
        assert client.get(f"{here}/result").status_code == 200
        assert client.get(f"{here}/result?format=csv").status_code == 200


class TestPlot:
    def test_svg(self, client: httpx.Client, done: str) -> None:
        response = client.get(f"{done}/plot.svg")
        assert response.status_code == 200
        assert response.headers["content-type"] == "image/svg+xml"
        assert "script-src" not in response.headers["content-security-policy"]
        root = xml.etree.ElementTree.fromstring(response.text)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert "<b>" not in response.text

    def test_png(self, client: httpx.Client, done: str) -> None:
        response = client.get(f"{done}/plot.png")
        assert response.headers["content-type"] == "image/png"
        assert response.content.startswith(b"\x89PNG\r\n")


def test_a_bundle(client: httpx.Client, job: Callable[..., str], solved: bytes) -> None:
    done = job(JobStatus.SUCCEEDED, solved)
    response = client.get(f"/v1/jobs/{done}/bundle.zip")
    assert response.headers["content-type"] == "application/zip"
    bundle = unpack(response.content)
    assert bundle.document == client.get(f"/v1/jobs/{done}/spec").content
    assert bundle.result == client.get(f"/v1/jobs/{done}/result").json()
    with zipfile.ZipFile(io.BytesIO(response.content)) as archive:
        assert json.loads(archive.read("job.json")) == client.get(f"/v1/jobs/{done}").json()
        assert '"succeeded"' in archive.read("log.txt").decode().splitlines()[-1]
    assert unpack(client.get(f"/v1/jobs/{job(JobStatus.FAILED)}/bundle.zip").content).result is None
    problem(client.get(f"/v1/jobs/{job()}/bundle.zip"), 409, "not-ready")
    problem(client.get("/v1/jobs/x/bundle.zip"), 404, "not-found")
