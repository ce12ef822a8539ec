"""Draws the pictures of docs/page.md: solves some jobs on a service of its own, looks at them in Chromium."""

from __future__ import annotations

import io
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from app.client import Client
from app.embedded.service import EmbeddedService, ServiceOptions
from tests.browser.chromium import ARGUMENTS, find_chromium

IMAGES = ROOT / "docs" / "images"
COLOURS = 256
"""Of a picture: enough for a page of one accent colour, and a third of the bytes."""


@dataclass(frozen=True)
class Shot:
    """A picture to be taken: its name, the view, and what is there when that is complete."""

    name: str
    view: str
    sign: str
    scheme: Literal["light", "dark"]
    width: int = 1280
    height: int = 900


def solve_some(client: Client) -> dict[str, str]:
    """Submit what the pictures show; returns ids by name."""
    slew = client.case("flexible_spacecraft")
    slew["problem"]["units"] = {"t": "s", "theta": "rad", "alpha": "rad", "T": "N m"}
    slew["problem"]["units"] |= {"theta_dot": "rad/s", "alpha_dot": "rad/s"}
    slew["problem"]["outputs"] = [{"name": "root_moment", "expression": "2*k*alpha", "units": "N m"}]
    exact = {**slew, "name": "The same, switching times exact", "method": {"name": "auto"}}
    coarse = {**slew, "name": "The same, two iterations", "options": {"max_iterations": 2}}
    method = {"name": "swcm", "refine": "switching"}
    grid = {"/problem/model/parameters/k": {"from": 40, "to": 200, "count": 25}}
    swept = client.sweep({**slew, "name": "Slew over the stiffness of the panels", "method": method}, grid)
    ids = {}
    for name in ("goddard", "two_mass_spring", "min_time_orbit_transfer", "hypersensitive"):
        ids[name] = client.submit(client.case(name))["id"]
    for name, document in (("coarse", coarse), ("exact", exact), ("slew", slew)):
        ids[name] = client.submit(document)["id"]
    for job in ids.values():
        client.wait(job)
    slow = {**slew, "name": "Slew on 65,539 points", "method": {"name": "swcm", "J": 13}}
    return ids | {"sweep": swept["id"], "slow": client.submit(slow)["id"]}


def shots(ids: dict[str, str]) -> list[Shot]:
    """All pictures; what is solved meanwhile first."""
    curve = ".plot[data-name=infeasibility] circle >> nth=3"
    return [
        Shot("page-running", f"#/jobs/{ids['slow']}", curve, "light", height=520),
        Shot("page-jobs", "", "tbody tr", "light", height=560),
        Shot("page-job", f"#/jobs/{ids['slew']}", ".wavelets", "light", height=1400),
        Shot(
            "page-job-dark",
            f"#/jobs/{ids['exact']}",
            ".plot[data-name=infeasibility] path",
            "dark",
            height=1000,
        ),
        Shot("page-job-narrow", f"#/jobs/{ids['slew']}", ".wavelets", "dark", width=390, height=1100),
        Shot("page-failed", f"#/jobs/{ids['coarse']}", ".verdict", "light", height=700),
        Shot("page-compare", f"#/compare?jobs={ids['slew']},{ids['exact']}", ".legend", "light", height=720),
        Shot("page-new", "#/new", ".findings .good", "light", height=820),
        Shot("page-new-narrow", "#/new", ".findings .good", "dark", width=390, height=900),
        Shot("page-sweep", f"#/sweeps/{ids['sweep']}", ".plot circle", "dark", height=900),
    ]


def take(browser: Browser, url: str, shot: Shot) -> None:
    """Take a picture, into docs/images."""
    size = {"width": shot.width, "height": shot.height}
    context = browser.new_context(base_url=url, color_scheme=shot.scheme, viewport=size, locale="en-GB")
    page = context.new_page()
    page.goto(f"/{shot.view}")
    page.locator(shot.sign).first.wait_for(timeout=120_000)
    if shot.name == "page-new":
        page.locator(".cm-line", has_text='"initial_time"').click()
        page.keyboard.press("End")
        page.keyboard.type(' "contr')
        page.locator(".cm-tooltip-autocomplete").wait_for()
        page.locator(".findings .bad").wait_for()
    elif shot.name == "page-new-narrow":
        page.locator(".cm-line", has_text='"controls"').click()
        page.keyboard.press("End")
        page.keyboard.type(' "flexible": ["beta"],')
        page.locator(".findings .bad").wait_for()
    elif page.locator(".switches button").count():
        page.locator(".switches button").nth(1).click()
    page.wait_for_timeout(300)
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        IMAGES / f"{shot.name}.png", optimize=True
    )
    context.close()


def main() -> None:
    """Draw them all."""
    with (
        tempfile.TemporaryDirectory() as folder,
        EmbeddedService(ServiceOptions(Path(folder), port=0, workers=1), print) as service,
        Client(service.url) as client,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=ARGUMENTS)
        IMAGES.mkdir(exist_ok=True)
        for shot in shots(solve_some(client)):
            take(browser, service.url, shot)
        browser.close()


if __name__ == "__main__":
    main()
