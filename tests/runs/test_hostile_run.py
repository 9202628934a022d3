"""A run folder from a stranger: its texts stay texts, on the page and in the report."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="needs playwright")

from playwright.sync_api import Browser, Page

from tests.runs.browsing import Visit, served

pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.slow]

RUN = Path(__file__).parents[1] / "data" / "run_0_1"
PAYLOADS = (
    "<img src=x class=injected onerror=window.injected=1>",
    "</script><script class=injected>window.injected=1</script>",
    "\"'><svg class=injected onload=window.injected=1>",
    "<a class=injected href=javascript:window.injected=1>{{7*7}}</a>",
    "]]>--><b class=injected>",
)


def hostile(value: object, payload: str) -> object:
    """The value with ``payload`` in all texts and names below it."""
    if isinstance(value, dict):
        return {name: hostile(part, payload) for name, part in value.items()} | {payload: payload}
    if isinstance(value, list):
        return [hostile(part, payload) for part in value]
    return value + payload if isinstance(value, str) else value


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile") / "run"
    shutil.copytree(RUN, folder)
    lines = (RUN / "trace.jsonl").read_text("utf-8").splitlines()
    with (folder / "trace.jsonl").open("w", encoding="utf-8") as file:
        for number, line in enumerate(lines):
            record, payload = json.loads(line), PAYLOADS[number % len(PAYLOADS)]
            record["what"] += payload
            record["detail"] = {name: hostile(value, payload) for name, value in record["detail"].items()}
            record["detail"][payload] = payload
            if number % 7 == 0:
                record |= {"id": f"{number}{payload}", "cause": f"{record['cause']}{payload}"}
            if number % 11 == 0:
                record["source"] += payload
            file.write(json.dumps(record) + "\n")
    results = json.loads((RUN / "results.json").read_text("utf-8"))
    results["labels"] = {payload: payload for payload in PAYLOADS}
    results["parameters"] = {**results["parameters"], "head": {payload: payload for payload in PAYLOADS}}
    (folder / "results.json").write_text(json.dumps(results))
    return folder


def injected(page: Page) -> int:
    """Number of elements and scripts that came out of texts."""
    return page.evaluate("document.querySelectorAll('.injected').length + (window.injected ?? 0)")


def test_page_shows_hostile_texts_as_texts(run: Path, browser: Browser) -> None:
    with served(run) as url:
        visit = Visit(browser, url)
        for seconds in (0, 2, 4):
            visit.seek(seconds)
            for tab in visit.page.locator("[role=tab]:visible").all():
                tab.click()
                assert injected(visit.page) == 0
        assert "<img src=x class=injected" in visit.page.content() or "&lt;img src=x" in visit.page.content()
        visit.close()  # a refused script would be an error of the console


def test_report_shows_hostile_texts_as_texts(run: Path, browser: Browser) -> None:
    from socialbot.runs.report import write_report

    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(write_report(run).as_uri())
    page.wait_for_selector("body[data-loaded]")
    assert (injected(page), errors) == (0, [])
    assert "&lt;img src=x" in page.content()
    page.close()
