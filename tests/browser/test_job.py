"""A job's page: what is plotted, read off, said, copied and saved."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable

import httpx
import pytest
from playwright.sync_api import expect

from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.browser.conftest import Visitor


def test_plots_are_read_off_and_zoomed(visitor: Visitor, solved: str, service: httpx.Client) -> None:
    result = service.get(f"/v1/jobs/{solved}/result").json()
    with visitor.page(f"#/jobs/{solved}") as page:
        plot = page.locator(".plot[data-name=T]")
        expect(page.locator(".plot-box")).to_have_count(
            8
        )  # Four states, a control, an output, two of the solve.
        expect(page.locator(".plot[data-name=root_moment]")).to_contain_text("root_moment [N m]")
        expect(plot.locator(".bound")).to_have_count(2)
        expect(plot.locator(".switch")).to_have_count(3)
        # A switching time is where all plots are read off.
        times = page.locator(".switches button")
        expect(times).to_have_count(3)
        times.nth(1).click()
        place = page.locator(".zoom-where").first
        expect(place).to_contain_text(f"{result['switching']['T']['times'][1]:.4f}"[:5])
        reading = page.locator(".plot[data-name=theta] .plot-readings")
        expect(reading).not_to_be_empty()
        # The same by keyboard.
        slider = page.get_by_role("slider", name="T [N m] over t [s]", exact=True)
        slider.press("Home")
        expect(reading).to_have_text("0")
        slider.press("End")
        assert float(reading.inner_text()) == pytest.approx(result["trajectory"]["states"]["theta"][-1], 1e-5)
        assert f"t [s] {result['final_time']:.4f}" in (slider.get_attribute("aria-valuetext") or "")
        ticks = page.locator(".plot[data-name=theta] .plot-axes g").all_inner_texts()
        slider.press("+")
        assert page.locator(".plot[data-name=theta] .plot-axes g").all_inner_texts() != ticks
        page.get_by_role("button", name="All").first.click()
        assert page.locator(".plot[data-name=theta] .plot-axes g").all_inner_texts() == ticks
        # The same by pointer: drag over a part.
        box = slider.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 100, box["y"] + 50)
        page.mouse.down()
        page.mouse.move(box["x"] + 180, box["y"] + 60, steps=3)
        expect(page.locator(".plot-selection")).to_have_count(1)
        page.mouse.up()
        assert page.locator(".plot[data-name=theta] .plot-axes g").all_inner_texts() != ticks


def test_the_wavelets_and_the_verification_are_shown(
    visitor: Visitor, solved: str, service: httpx.Client
) -> None:
    result = service.get(f"/v1/jobs/{solved}/result").json()
    with visitor.page(f"#/jobs/{solved}") as page:
        picture = page.locator(".wavelets[data-name=theta]")
        values = [abs(value) for value in result["coefficients"]["states"]["theta"]]
        sizes = [11, 8, 16, 32, 64]  # V0 and W0 to W3 for L = 8, J = 4.
        assert sum(sizes) == len(values)
        for number, (level, size) in enumerate(zip(["V0", "W0", "W1", "W2", "W3"], sizes, strict=True)):
            row = picture.locator(f"[data-level={level}]")
            expect(row.locator(".cell")).to_have_count(size)
            start = sum(sizes[:number])
            shown = [float(cell.get_attribute("fill-opacity") or 0) for cell in row.locator(".cell").all()]
            darkest = [k for k, strength in enumerate(shown) if strength == max(shown)]
            assert max(range(size), key=lambda k: values[start + k]) in darkest
        rows = page.locator(".checks tbody tr")
        expect(rows).to_have_count(len(result["verification"]["checks"]))
        expect(rows.filter(has_text="passed")).to_have_count(len(result["verification"]["checks"]))
        expect(page.get_by_role("region", name="Errors of each state").locator("tbody tr")).to_have_count(4)


def test_every_plant_and_every_reason_is_shown(visitor: Visitor, submit: Callable[..., str]) -> None:
    problem = FLEXIBLE_SPACECRAFT["problem"]
    near = {"theta": "pi/6", "alpha": [-0.01, 0.01], "theta_dot": [-0.01, 0.01], "alpha_dot": [-0.01, 0.01]}
    plants = {"cases": [{"name": "soft", "parameters": {"k": 95}}], "objective": "nominal"}
    both = submit(name="Two plants", problem={**problem, "final_state": near, "scenarios": plants})
    with visitor.page(f"#/jobs/{both}") as page:
        expect(page.locator(".legend li")).to_have_text([" nominal", " soft"])
        expect(page.locator(".plot[data-name=alpha] .curve path")).to_have_count(2)
    hasty = submit(name="Too hasty", problem={**problem, "final_time": [1, 5]})
    with visitor.page(f"#/jobs/{hasty}") as page:
        expect(page.locator(".trouble")).to_contain_text("No feasible point was found")
        expect(page.get_by_role("region", name="No feasible point found")).to_contain_text(
            "theta: violated by"
        )
        expect(page.locator(".verdict")).to_contain_text("Not verified")


def test_flights_are_told_by_limits_spread_and_worst(
    visitor: Visitor, solved: str, service: httpx.Client
) -> None:
    asked = {"runs": 40, "coast": 5, "parameters": {"k": {"uniform": [90, 110]}}}
    job = service.post(f"/v1/jobs/{solved}/flights", json=asked, headers={"Prefer": "wait=60"}).json()
    result = service.get(f"/v1/jobs/{job['id']}/result").json()
    with visitor.page(f"#/jobs/{job['id']}") as page:
        expect(page.locator(".verdict")).to_contain_text(result["message"])
        alpha = page.get_by_role("region", name="Misses of each limit").locator("tbody tr").nth(1)
        assert result["violations"][1]["pointer"] == "/problem/final_state/alpha"
        expect(alpha).to_contain_text(f"{100 * result['violations'][1]['rate']:g} %")
        expect(page.get_by_role("region", name="Residual amplitudes").locator("tbody tr")).to_have_count(5)
        expect(page.get_by_role("region", name="Worst flights").locator("tbody tr")).to_have_count(5)
        slider = page.get_by_role("slider", name="k over share of flights [%]", exact=True)
        slider.press("Home")
        least = float(page.locator(".plot[data-name=k] .plot-readings").inner_text())
        assert least == pytest.approx(min(result["columns"]["k"]), rel=1e-5)
        expect(page.locator(".files button")).to_have_text(["JSON", "CSV"])
        page.locator(".headline").get_by_role("link", name=solved).click()
        expect(page.locator(".plot[data-name=root_moment]")).to_have_count(1)


def test_two_jobs_are_laid_over_one_another(visitor: Visitor, solved: str, other: str) -> None:
    with visitor.page("#/?tag=browser") as page:
        page.locator(f"[data-job='{solved}']").get_by_role("checkbox").check()
        page.locator(f"[data-job='{other}']").get_by_role("checkbox").check()
        page.get_by_role("button", name="Compare 2 jobs").click()
        expect(page.locator(".plot[data-name=theta] .curve path")).to_have_count(2)
        expect(page.locator(".legend li")).to_have_count(2)
        expect(page.get_by_role("table").locator("tbody tr")).to_have_count(2)
    with visitor.page(f"#/jobs/{solved}") as page:
        page.get_by_label("Compare with another job").select_option(other)
        expect(page.locator(".plot[data-name=T] .curve path")).to_have_count(2)


def test_the_document_is_copied_to_run_elsewhere(
    visitor: Visitor, solved: str, service: httpx.Client
) -> None:
    submitted = service.get(f"/v1/jobs/{solved}/spec").json()
    with visitor.page(f"#/jobs/{solved}", permissions=["clipboard-read", "clipboard-write"]) as page:

        def copied(form: str) -> str:
            page.get_by_role("button", name=form, exact=True).last.click()
            page.get_by_role("button", name=f"Copy: as submitted, {form}").click()
            expect(page.locator(".copied [role=status]")).to_have_text("copied")
            return str(page.evaluate("navigator.clipboard.readText()"))

        assert json.loads(copied("JSON")) == submitted
        curl, python = copied("curl"), copied("Python")
    answer = subprocess.run(["bash", "-c", curl], capture_output=True, text=True, check=True)
    job = json.loads(answer.stdout)
    assert job["status"] == "succeeded"
    assert service.get(f"/v1/jobs/{job['id']}/spec").json() == submitted
    environment = {**os.environ, "NO_PROXY": "*"}
    answer = subprocess.run(
        [sys.executable, "-c", python], capture_output=True, text=True, check=True, env=environment
    )
    assert answer.stdout.startswith("True 25.8")


def test_files_are_saved(visitor: Visitor, solved: str) -> None:
    beginnings = {
        "JSON": b'{"',
        "CSV": b"t,",
        "NPZ": b"PK",
        "MAT": b"MATLAB",
        "SVG": b"<?xml",
        "Report": b"<!doctype html>",
        "Bundle": b"PK",
    }
    with visitor.page(f"#/jobs/{solved}") as page:
        for label, beginning in beginnings.items():
            with page.expect_download() as saved:
                page.locator(".files").get_by_role("button", name=label, exact=True).click()
            assert saved.value.suggested_filename.startswith(solved)
            content = saved.value.path().read_bytes()
            assert len(content) > 1_000
            assert content.startswith(beginning), label
