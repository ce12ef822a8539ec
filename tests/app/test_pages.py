import base64
import gzip
import hashlib
import re
from typing import Any

import httpx

from tests.problems import problem
from worker.queue import JobQueue


def test_the_page_loads_nothing_from_elsewhere(client: httpx.Client) -> None:
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    addresses = re.findall(r"(?:src|href)=\"([^\"]+)\"", page.text)
    assert {"/page/app.js", "/page/app.css", "/docs"} <= set(addresses)
    for address in [*addresses, "/page/editor.js", "/page/LICENSES.txt"]:
        assert address.startswith("/")
        assert client.get(address).status_code == 200, address
    # No script and no style in the page itself, and the policy allows none.
    assert not re.search(r"<style|<script>|\son\w+=|style=", page.text)
    policy = page.headers["content-security-policy"]
    assert "script-src 'self';" in policy
    assert "unsafe" not in policy
    assert "require-trusted-types-for 'script'" in policy
    problem(client.get("/page/__init__.py"), 404, "not-found")
    problem(client.get("/page/..%2F__init__.py"), 404, "not-found")


def test_the_first_load_is_small_and_known_the_second_time(client: httpx.Client) -> None:
    size = 0
    for address in ("/", "/page/app.js", "/page/app.css", "/page/icon.svg"):
        answer = client.get(address, headers={"Accept-Encoding": "gzip"})
        assert answer.headers["content-encoding"] == "gzip"
        size += len(gzip.compress(answer.content, mtime=0))
        plain = client.get(address, headers={"Accept-Encoding": "identity"})
        assert "content-encoding" not in plain.headers
        assert plain.content == answer.content
        again = client.get(address, headers={"If-None-Match": answer.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")
    assert size <= 100_000


def references(schema: Any) -> set[str]:
    if isinstance(schema, dict):
        mapping = schema.get("discriminator", {}).get("mapping", {})
        own = {schema["$ref"]} if isinstance(schema.get("$ref"), str) else set()
        return own | set(mapping.values()) | {ref for value in schema.values() for ref in references(value)}
    if isinstance(schema, list):
        return {ref for value in schema for ref in references(value)}
    return set()


def test_the_interface_is_described_in_openapi_3_1(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    assert document["openapi"].startswith("3.1.")
    submit = document["paths"]["/v1/jobs"]["post"]
    schema = submit["requestBody"]["content"]["application/json"]["schema"]
    assert schema == {"$ref": "#/components/schemas/JobDocument"}
    assert {"202", "409", "413", "415", "422", "503"} <= set(submit["responses"])
    schemas = document["components"]["schemas"]
    assert {"problem", "method", "options", "output"} <= set(schemas["JobDocument"]["properties"])
    assert {"Problem", "JobView"} <= set(schemas)
    used = references(document)
    assert used
    for reference in used:
        assert reference.removeprefix("#/components/schemas/") in schemas, reference


def test_every_422_is_a_problem(client: httpx.Client) -> None:
    for path in client.get("/openapi.json").json()["paths"].values():
        for operation in path.values():
            if "422" in operation["responses"]:
                assert set(operation["responses"]["422"]["content"]) == {"application/problem+json"}


def test_the_process_is_alive_and_ready_when_a_worker_is(client: httpx.Client, queue: JobQueue) -> None:
    assert client.get("/livez").json() == {"status": "ok"}
    waiting = client.get("/readyz")
    assert waiting.status_code == 503
    assert waiting.json()["type"] == "/problems/unavailable"
    assert int(waiting.headers["retry-after"]) >= 1
    queue.beat("one@host", 2, 60)
    assert client.get("/readyz").json() == {"status": "ready", "workers": {"one@host": 2}, "queued": 0}


def test_the_documentation_needs_nobody_elses_server(client: httpx.Client) -> None:
    page = client.get("/docs")
    assert not re.findall(r"(?:src|href)=\"https?:", page.text)
    policy = page.headers["content-security-policy"]
    assert "http" not in policy
    for address in re.findall(r"(?:src|href)=\"([^\"]+)\"", page.text):
        answer = client.get(address)
        assert answer.status_code == 200, address
        assert len(answer.content) > 1_000
    # The script in the page is the one that the policy allows.
    (script,) = re.findall(r"<script>(.*?)</script>", page.text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"'sha256-{digest}'" in policy
    assert "script-src 'self' 'unsafe-inline'" not in policy
    problem(client.get("/docs/consts.py"), 404, "not-found")
    problem(client.get("/docs/..%2Fconsts.py"), 404, "not-found")
