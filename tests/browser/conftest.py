"""A real browser before a real service: one of each for all tests."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.acceptance.conftest import Deployment
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.browser.chromium import ARGUMENTS, find_chromium
from worker.settings import QueueSettings

PATIENCE = 15_000
"""How long a test waits for what it expects, in milliseconds; mostly it is there at once."""

expect.set_options(timeout=PATIENCE)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium, without which there is nothing to test."""
    found = find_chromium()
    if found is None:
        pytest.skip("there is no Chromium here; install it, or name one in ONDELETTE_BROWSER")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=ARGUMENTS)
        yield browser
        browser.close()


@dataclass(frozen=True)
class Visitor:
    """Opens pages of a service as people do who like it light or dark, wide or narrow."""

    browser: Browser
    url: str

    @contextmanager
    def page(
        self, address: str = "", scheme: Literal["light", "dark"] = "light", width: int = 1280, **options: Any
    ) -> Iterator[Page]:
        """A page that has been opened; whatever the browser complains of fails the test."""
        context = self.browser.new_context(
            base_url=self.url, color_scheme=scheme, viewport={"width": width, "height": 900}, **options
        )
        context.set_default_timeout(PATIENCE)
        page = context.new_page()
        complaints: list[str] = []
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: _note(complaints, message.type, message.text))
        page.goto(f"/{address}")
        yield page
        context.close()
        assert not complaints


def _note(complaints: list[str], kind: str, text: str) -> None:
    # The browser calls every refusal an error; the page shows them, and tests look there.
    if kind in ("error", "warning") and "the server responded with a status of 4" not in text:
        complaints.append(text)


@pytest.fixture(scope="session")
def deployment(broker: str, tmp_path_factory: pytest.TempPathFactory) -> Deployment:
    """The processes of a service of our own."""
    return Deployment(QueueSettings(broker=broker, prefix="browser:"), tmp_path_factory.mktemp("browser"))


@pytest.fixture(scope="session")
def service(browser: Browser, deployment: Deployment) -> Iterator[httpx.Client]:
    """A client of a service that solves; there is none where there is no browser."""
    with deployment.both() as (_, client):
        yield client


@pytest.fixture(scope="session")
def visitor(browser: Browser, service: httpx.Client) -> Visitor:
    """Somebody with a browser."""
    return Visitor(browser, str(service.base_url))


@pytest.fixture(scope="session")
def submit(service: httpx.Client) -> Callable[..., str]:
    """Submit a document, by default the spacecraft's slew, and return the id of its job."""

    def post(wait: int = 60, **members: Any) -> str:
        document = {**FLEXIBLE_SPACECRAFT, **members}
        answer = service.post("/v1/jobs", json=document, headers={"Prefer": f"wait={wait}"})
        return str(answer.raise_for_status().json()["id"])

    return post


@pytest.fixture(scope="session")
def solved(submit: Callable[..., str]) -> str:
    """The id of a job that has succeeded."""
    units = {"t": "s", "theta": "rad", "T": "N m"}
    problem: dict[str, Any] = json.loads(json.dumps(FLEXIBLE_SPACECRAFT["problem"])) | {"units": units}
    problem["outputs"] = [{"name": "root_moment", "expression": "2*k*alpha", "units": "N m"}]
    return submit(name="Slew to be looked at", tags=["browser"], problem=problem)


@pytest.fixture(scope="session")
def other(submit: Callable[..., str]) -> str:
    """The id of another job that has succeeded, on a finer mesh."""
    return submit(name="The same, finer", tags=["browser"], method={"name": "swcm", "J": 5})
