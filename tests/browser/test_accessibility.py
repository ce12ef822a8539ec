"""Every view, light and dark, wide and narrow, without anything that axe complains of."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import httpx
import pytest
from playwright.sync_api import Page, expect

from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.browser.conftest import Visitor

AXE = (Path(__file__).parent / "data" / "axe.min.js").read_text()

GROUNDS: dict[Literal["light", "dark"], str] = {"light": "rgb(255, 255, 255)", "dark": "rgb(18, 22, 28)"}


@pytest.fixture(scope="module")
def views(service: httpx.Client, solved: str, other: str) -> dict[str, str]:
    """Every view: its address, and what is there when it is complete."""
    failing = {**FLEXIBLE_SPACECRAFT, "options": {"max_iterations": 2}}
    headers = {"Prefer": "wait=60"}
    failed = service.post("/v1/jobs", json=failing, headers=headers).json()
    assert failed["status"] == "failed"
    grid = {"/problem/model/parameters/k": [95, 100]}
    sweep = service.post(
        "/v1/sweeps", json={"document": FLEXIBLE_SPACECRAFT, "grid": grid}, headers=headers
    ).json()
    return {
        "": "tbody tr",
        "#/new": ".findings .good",
        f"#/jobs/{solved}": ".plot[data-name=infeasibility] path",
        f"#/jobs/{failed['id']}": ".verdict",
        f"#/compare?jobs={solved},{other}": ".legend",
        f"#/sweeps/{sweep['id']}": ".plot circle",
        f"#/jobs/{'0' * 8}": "[role=alert]",
    }


def violations(page: Page) -> list[str]:
    page.evaluate(AXE)
    found = page.evaluate("axe.run({resultTypes: ['violations']})")["violations"]
    return [
        f"{one['id']}: {node['html'][:200]} {node['failureSummary']}"
        for one in found
        for node in one["nodes"]
    ]


def test_axe_has_no_complaints(visitor: Visitor, views: dict[str, str]) -> None:
    with visitor.page(bypass_csp=True) as page:
        for address, sign in views.items():
            page.goto(f"/{address}")
            expect(page.locator(sign).first).to_be_visible()
            for (scheme, background), width in zip(GROUNDS.items(), (1280, 390), strict=True):
                page.emulate_media(color_scheme=scheme)
                page.set_viewport_size({"width": width, "height": 900})
                ground = page.evaluate("getComputedStyle(document.documentElement).backgroundColor")
                assert ground == background
                assert violations(page) == [], f"{address} {scheme}"
                # Nothing but tables, which scroll by themselves, is wider than the screen.
                assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), address
        page.get_by_role("button", name="Key").click()
        assert violations(page) == []


def test_the_keyboard_reaches_everything(visitor: Visitor, solved: str) -> None:
    with visitor.page("#/?tag=browser") as page:
        expect(page.locator(f"[data-job='{solved}']")).to_be_visible()
        page.keyboard.press("Tab")
        expect(page.get_by_text("Skip to the content")).to_be_focused()
        page.keyboard.press("Enter")
        expect(page.get_by_role("heading", name="Jobs")).to_be_focused()
        reached: set[str] = set()
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.add(
                page.evaluate("(document.activeElement.name || document.activeElement.textContent).trim()")
            )
        assert {"Key", "New job", "status", "method", "tag", "name", "Slew to be looked at"} <= reached
        page.locator(f"[data-job='{solved}'] .name a").first.press("Enter")
        # Who does not see the page is taken to the new heading.
        expect(page.get_by_role("heading", name="Slew to be looked at")).to_be_focused()
