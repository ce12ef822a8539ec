"""The list of jobs: as they stand, filtered, page after page; and jobs that are stopped."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator

import httpx
import pytest
from playwright.sync_api import Browser, expect

from tests.acceptance.conftest import Deployment
from tests.browser.conftest import Visitor
from worker.records import JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, connect

KEY = "a-key-of-the-tests-that-is-long-enough"
JOBS = 120


@pytest.fixture(scope="module")
def guarded(browser: Browser, broker: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visitor]:
    """A service that asks for a key, with so many jobs that nobody works on."""
    settings = QueueSettings(broker=broker, prefix="browser-keys:")
    folder = tmp_path_factory.mktemp("browser-keys")
    (folder / "key").write_text(KEY)
    with connect(settings) as redis:
        store = JobStore(redis, settings)
        for number in range(JOBS):
            method = "gpm" if number % 3 else "swcm"
            record = JobRecord(
                new_job_id(), JobStatus.QUEUED, method, 60.0, time.time(), name=f"Number {number}"
            )
            store.add(record, b"{}")
    environment = {
        "ONDELETTE_REQUIRE_KEYS": "1",
        "ONDELETTE_BOOTSTRAP_KEY_FILE": str(folder / "key"),
        "ONDELETTE_RECONCILE_SECONDS": "3600",
    }
    with Deployment(settings, folder).api(**environment) as client:
        yield Visitor(browser, str(client.base_url))


def test_a_key_is_asked_for_and_kept_in_the_tab(guarded: Visitor) -> None:
    with guarded.page() as page:
        dialog = page.get_by_role("dialog", name="API key")
        expect(dialog).to_be_visible()
        dialog.get_by_label("Key").fill("not-this-one")
        dialog.get_by_role("button", name="Use it").click()
        expect(dialog).to_contain_text("does not take this key")
        dialog.get_by_role("button", name="Close").click()
        expect(page.get_by_role("alert")).to_contain_text("key")
        page.get_by_role("button", name="Key").click()
        dialog.get_by_label("Key").fill(KEY)
        dialog.get_by_role("button", name="Use it").click()
        expect(dialog).to_be_hidden()
        rows = page.locator("tbody tr")
        expect(rows).to_have_count(50)
        expect(rows.first).to_contain_text(f"Number {JOBS - 1}")
        # Events go with the key too, and it outlives the page, but not the tab.
        rows.first.get_by_role("link").first.click()
        expect(page.get_by_text("waits for a worker")).to_be_visible()
        page.reload()
        expect(page.get_by_text("waits for a worker")).to_be_visible()
        assert page.evaluate("[localStorage.length, document.cookie, sessionStorage.length]") == [0, "", 1]
        page.get_by_role("button", name="Cancel").click()
        expect(page.get_by_role("status").filter(has_text="cancelled")).to_be_visible()


def test_many_jobs_come_page_by_page(guarded: Visitor) -> None:
    with guarded.page() as page:
        page.get_by_role("dialog").get_by_label("Key").fill(KEY)
        page.keyboard.press("Enter")
        rows = page.locator("tbody tr")
        seen: list[str] = []
        for count in (50, 50, JOBS - 100):
            expect(rows).to_have_count(count)
            expect(rows.first).to_contain_text(f"Number {JOBS - 1 - len(seen)}")
            seen += page.locator("tbody .name a").all_inner_texts()
            if len(seen) < JOBS:
                page.get_by_role("button", name="Older").click()
        assert seen == [f"Number {number}" for number in reversed(range(JOBS))]
        expect(page.get_by_role("button", name="Older")).to_be_disabled()
        page.get_by_role("button", name="Newer").click()
        expect(rows.first).to_contain_text(f"Number {JOBS - 51}")
        # A filter starts from the newest again, and fills its page.
        page.get_by_label("Method").select_option("swcm")
        expect(rows).to_have_count(JOBS // 3)
        expect(rows.get_by_text("gpm")).to_have_count(0)
        page.get_by_label("Name").fill("Number 42")
        page.keyboard.press("Enter")
        expect(rows).to_have_count(1)
        page.get_by_label("Status").select_option("failed")
        expect(page.get_by_text("No job is like this.")).to_be_visible()


def test_the_list_shows_how_jobs_stand(visitor: Visitor, solved: str, submit: Callable[..., str]) -> None:
    with visitor.page("#/?tag=browser") as page:
        row = page.locator(f"[data-job='{solved}']")
        expect(row).to_contain_text("succeeded")
        expect(row).to_contain_text(re.compile(r"\d+ iterations"))
        slow = submit(wait=0, name="<b>bold</b>", tags=["browser"], method={"name": "swcm", "J": 11})
        row = page.locator(f"[data-job='{slow}']")
        expect(row.get_by_role("link", name="<b>bold</b>")).to_be_visible()
        expect(row).to_contain_text("running")
        row.get_by_role("link").first.click()
        # It moves by itself.
        iteration = page.locator(".strip > div", has_text="iteration").locator("dd")
        expect(iteration).to_have_text(re.compile(r"^[1-9]\d*$"))
        expect(page.locator(".plot[data-name=infeasibility] circle").first).to_be_visible()
        page.get_by_role("button", name="Cancel").click()
        expect(page.get_by_role("status").filter(has_text="cancelled")).to_be_visible()
        expect(page.get_by_text("Not verified")).to_be_visible()
        page.once("dialog", lambda dialog: dialog.accept())
        page.get_by_role("button", name="Erase").click()
        expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
        expect(page.locator(f"[data-job='{slow}']")).to_have_count(0)


def test_what_is_not_there_is_said(visitor: Visitor, service: httpx.Client) -> None:
    with visitor.page(f"#/jobs/{new_job_id()}") as page:
        expect(page.get_by_role("alert")).to_contain_text("There is no job with this id")
    with visitor.page("#/nowhere") as page:
        expect(page.get_by_role("heading", name="There is nothing here.")).to_be_visible()
