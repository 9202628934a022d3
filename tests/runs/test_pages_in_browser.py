"""The pages as browsers show them: light, dark, and on a phone."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser

from evaluation.report import Report
from socialbot.runs.difference import difference
from socialbot.runs.evaluation_page import page as evaluation_page
from socialbot.runs.folder import open_run
from socialbot.runs.record import SCORED
from socialbot.runs.report import difference_page, write_report
from socialbot.vision.metrics.frames import bag_source
from tests.runs.browsing import Visit, waldo_with_pictures
from tests.runs.runs import greeting
from tests.runs.test_report import scored
from tests.vision.metrics.scenes import drawn_bag, evaluated

pytestmark = pytest.mark.slow

SERIOUS = ("serious", "critical")


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("pages")
    evaluation = evaluated([bag_source(drawn_bag(folder, scene="scene1", frames=6))])
    run, later = waldo_with_pictures(folder), greeting(folder / "later", comes=15, tenths=40)
    (run / SCORED).write_bytes(msgspec.json.Encoder().encode_lines(map(scored, range(40))))
    report = Report("Some figures", quick=True)
    report.add("late", "longest delay (ms)", 12.5, 10.0)
    report.tables["by rate"] = {f"{rate} %": {"seconds": rate / 7} for rate in (0, 10, 50)}
    first, second = open_run(run), open_run(later)
    return [
        write_report(run),
        difference_page(first, second, difference(first, second)).write(folder / "difference.html"),
        report.page().write(folder / "figures.html"),
        evaluation_page(evaluation).write(folder / "evaluation.html"),
    ]


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (390, "light")])
def test_pages_are_readable(browser, pages, width, scheme):
    for path in pages:
        _look(browser, path, width, scheme)


def _look(browser: Browser, path: Path, width: int, scheme: Literal["light", "dark"]) -> None:
    page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(path.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.emulate_media(media="print")
    page.emulate_media(media="screen")
    faults = [each for each in Axe().run(page).response["violations"] if each["impact"] in SERIOUS]
    assert (faults, said) == ([], [])
    page.close()


def test_report_shows_any_moment_and_its_causes(browser, pages):
    visit = Visit(browser, pages[0].as_uri(), "t=0.5")
    assert 'personDetected("Yes")' not in visit.texts("#beliefs .what")
    visit.seek(2.0)
    assert 'personDetected("Yes")' in visit.texts("#beliefs .what")
    assert visit.texts("#boxes .box") == ["t1 · 4.0 m"]
    visit.page.locator("#log button", has_text="Waldo said").first.click()
    visit.page.wait_for_selector("#pane-why .chain")
    assert any("the frame at" in text for text in visit.texts("#pane-why .chain li"))
    visit.close()
