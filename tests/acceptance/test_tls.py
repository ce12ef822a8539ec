"""A broker that is reached by TLS: every connection of API and worker, and whom they trust."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from kombu.exceptions import OperationalError
from redis.exceptions import RedisError

from tests.acceptance.conftest import Deployment, Document
from tests.servers import CERTIFICATE, TlsFront
from worker.celery_app import make_celery
from worker.settings import QueueSettings
from worker.store import connect


@pytest.fixture
def address(broker: str) -> Iterator[str]:
    """The broker's address by TLS, without a word about whom to trust."""
    with TlsFront(broker.removeprefix("unix://")).running() as port:
        yield f"rediss://localhost:{port}/0"


def test_a_job_goes_its_whole_way_by_tls(address: str, tmp_path: Path, spacecraft: Document) -> None:
    trusted = f"{address}?ssl_cert_reqs=required&ssl_ca_certs={CERTIFICATE}"
    deployment = Deployment(QueueSettings(broker=trusted, prefix="tls:"), tmp_path)
    with deployment.both(slots=1) as (worker, client):
        assert client.get("/readyz").status_code == 200
        path = client.post("/v1/jobs", json=spacecraft).headers["location"]
        # Until the job ends, each event told by a pub/sub message.
        with client.stream("GET", f"{path}/events") as stream:
            kinds = [line for line in stream.iter_lines() if line.startswith("event: ")]
        assert kinds[-2:] == ["event: result", "event: status"]
        assert client.get(path).json()["status"] == "succeeded"
        logs = [worker.log, tmp_path / "api.log"]
    for log in logs:
        # On a busy machine a connection may take too long, which is said as well, and tried again.
        text = log.read_text().replace(trusted, "").lower()
        assert "ssl" not in text, text
        assert "certificate" not in text, text


def test_a_certificate_that_nobody_vouches_for_is_refused(address: str) -> None:
    settings = QueueSettings(broker=address)
    with connect(settings, retries=0) as redis, pytest.raises(RedisError, match="CERTIFICATE_VERIFY_FAILED"):
        redis.ping()
    refused = pytest.raises(OperationalError, match="CERTIFICATE_VERIFY_FAILED")
    with make_celery(settings) as celery, celery.connection_for_write() as connection, refused:
        connection.default_channel.client.ping()
