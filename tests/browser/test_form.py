"""Starting jobs: from a case to its curves, with mistakes on the way."""

from __future__ import annotations

import json
import re
from collections.abc import Callable

import httpx
from playwright.sync_api import Locator, Page, expect

from tests.browser.conftest import Visitor


def editor(page: Page) -> Locator:
    return page.get_by_role("textbox", name="Job document")


def write(page: Page, document: object) -> None:
    editor(page).press("Control+a")
    page.keyboard.press("Delete")
    page.keyboard.insert_text(document if isinstance(document, str) else json.dumps(document))


def test_a_case_is_run_and_its_curve_is_the_answer(visitor: Visitor, service: httpx.Client) -> None:
    with visitor.page("#/new") as page:
        expect(editor(page)).to_contain_text("Flexible spacecraft")
        page.get_by_label("Case").select_option("brachistochrone")
        expect(editor(page)).to_contain_text("Brachistochrone")
        expect(page.get_by_text("✓ valid")).to_be_visible()
        page.get_by_label("Method").select_option("hermite_simpson")
        expect(editor(page)).to_contain_text('"hermite_simpson"')
        page.get_by_role("button", name="Run", exact=True).click()
        expect(page.get_by_role("status").filter(has_text="succeeded")).to_be_visible()
        job = page.url.rpartition("/")[2]
        result = service.get(f"/v1/jobs/{job}/result").json()
        assert result["method"]["name"] == "hermite_simpson"
        # What is drawn is what was answered: a corner of the path for each sample, at the right places.
        for group in ("states", "controls"):
            for name, values in result["trajectory"][group].items():
                path = page.locator(f".plot[data-name='{name}'] [data-curve] path")
                corners = re.findall(r"[ML]([-\d.]+),([-\d.]+)", path.get_attribute("d") or "")
                assert len(corners) == len(values)
                xs, ys = zip(*[(float(x), float(y)) for x, y in corners], strict=True)
                follow(xs, result["trajectory"]["t"])
                follow(ys, values)
        expect(page.get_by_text("Verified. Flown with the original model")).to_be_visible()


def follow(drawn: tuple[float, ...], values: list[float]) -> None:
    """The places on the screen are the values, shifted and scaled."""
    low, high = values.index(min(values)), values.index(max(values))
    scale = (drawn[high] - drawn[low]) / (values[high] - values[low])
    assert abs(scale) > 0
    for place, value in zip(drawn, values, strict=True):
        assert abs(drawn[low] + scale * (value - values[low]) - place) < 0.01


def test_mistakes_are_told_where_they_are(visitor: Visitor) -> None:
    with visitor.page("#/new?case=rigid_body") as page:
        expect(page.get_by_text("✓ valid")).to_be_visible()
        document = json.loads(page.evaluate("fetch('/v1/cases/rigid_body').then(answer => answer.text())"))
        document["problem"]["final_time"] = "1 + nonsense"
        document["problem"]["bounds"] = {"nobody": [-1, 1]}
        write(page, document)
        findings = page.locator(".findings")
        expect(findings).to_contain_text("2 mistakes")
        expect(findings).to_contain_text("nonsense")
        expect(page.get_by_role("button", name="Run", exact=True)).to_be_disabled()
        expect(page.locator(".cm-lintRange-error")).to_have_text(
            ['"1 + nonsense"', "[-1, 1]"], use_inner_text=True
        )
        findings.get_by_role("button", name="/problem/final_time").click()
        selected = page.evaluate("document.querySelector('.editor').shadowRoot.getSelection().toString()")
        assert selected == '"1 + nonsense"'
        write(page, '{"problem": ')
        expect(findings).to_contain_text("JSON")


def test_the_editor_knows_the_schema(visitor: Visitor) -> None:
    with visitor.page("#/new?case=rigid_body") as page:
        expect(page.get_by_text("✓ valid")).to_be_visible()

        def offered(text: str) -> Locator:
            write(page, text)
            editor(page).press("Control+End")
            editor(page).press("Control+Space")
            return page.locator(".cm-tooltip-autocomplete li")

        names = offered('{"method": {"name": "gpm", ')
        expect(names.filter(has_text=re.compile("^nodes"))).to_be_visible()
        expect(names.filter(has_text=re.compile("^intervals"))).to_have_count(0)
        page.keyboard.press("Escape")
        kinds = offered('{"problem": {"model": {"kind": ')
        expect(kinds).to_have_text(['"first_order"', '"library"', '"mechanical"', '"modal"'])
        kinds.filter(has_text="modal").click()
        expect(editor(page)).to_contain_text('"kind": "modal"')


def test_a_job_is_run_again_with_changes(
    visitor: Visitor, solved: str, service: httpx.Client, submit: Callable[..., str]
) -> None:
    with visitor.page(f"#/jobs/{solved}") as page:
        page.get_by_role("link", name="Run again with changes").click()
        expect(page.get_by_text("✓ valid")).to_be_visible()
        page.get_by_label("start from its answer").check()
        expect(editor(page)).to_contain_text(solved)
        expect(page.get_by_text("✓ valid")).to_be_visible()
        page.get_by_role("button", name="Run", exact=True).click()
        expect(page.get_by_role("status").filter(has_text="succeeded")).to_be_visible()
        again = page.url.rpartition("/")[2]
        assert again != solved
        assert service.get(f"/v1/jobs/{again}/spec").json()["warm_start"] == solved


def test_a_sweep_is_run_and_drawn(visitor: Visitor, service: httpx.Client) -> None:
    with visitor.page("#/new?case=rigid_body") as page:
        expect(page.get_by_text("✓ valid")).to_be_visible()
        page.get_by_text("Sweep over a number").click()
        pointers = page.locator("select[name=pointer] option").all_inner_texts()
        pointer = next(text for text in pointers if text.startswith("/problem/model/parameters/"))
        page.locator("select[name=pointer]").select_option(pointer)
        page.get_by_label("Points").fill("3")
        page.get_by_role("button", name="Run the sweep").click()
        expect(page.get_by_role("status").filter(has_text="succeeded")).to_be_visible()
        sweep = service.get(f"/v1/sweeps/{page.url.rpartition('/')[2]}").json()
        assert [row["status"] for row in sweep["table"]] == 3 * ["succeeded"]
        expect(page.locator(".plot[data-name=objective] circle")).to_have_count(3)
        expect(page.get_by_role("table").get_by_role("row")).to_have_count(4)
        heights = [
            float(dot.get_attribute("cy") or "nan")
            for dot in page.locator(".plot[data-name=objective] circle").all()
        ]
        follow(tuple(heights), [row["objective"] for row in sweep["table"]])
