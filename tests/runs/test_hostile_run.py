"""A run folder from a stranger: its texts stay texts, on the page and in the report."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="needs playwright")

from playwright.sync_api import Browser, Page

from socialbot.runs.report import write_report
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


@contextmanager
def report(folder: Path, browser: Browser) -> Iterator[tuple[Page, list[str]]]:
    """The report of a run in a browser, and all that the console says."""
    page = browser.new_page()
    said: list[str] = []
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("console", lambda message: said.append(message.text))
    page.goto(write_report(folder).as_uri())
    page.wait_for_selector("body[data-loaded]")
    yield page, said
    page.close()


def test_report_shows_hostile_texts_as_texts(run: Path, browser: Browser) -> None:
    with report(run, browser) as (page, said):
        assert (injected(page), said) == (0, [])
        assert "&lt;img src=x" in page.content()


def test_the_policy_of_a_report_allows_all_that_it_needs(browser: Browser, tmp_path: Path) -> None:
    shutil.copytree(RUN, tmp_path / "run")
    with report(tmp_path / "run", browser) as (page, said):
        for tab in page.locator("[role=tab]:visible").all():
            tab.click()
        assert page.locator("#map svg").count() == 1
        assert page.evaluate("document.adoptedStyleSheets.length") == 1
        assert said == []


REFUSED = (
    "document.body.insertAdjacentHTML('beforeend', '<img src=data:, onerror=window.injected=1>')",
    "document.body.append(Object.assign(document.createElement('script'), {text: 'window.injected=1'}))",
    "document.body.append(Object.assign(document.createElement('script'), {src: 'data:text/javascript,injected=1'}))",
    "document.body.append(Object.assign(document.createElement('base'), {href: 'https://example.org/'}))",
    "document.body.append(Object.assign(document.createElement('iframe'), {src: 'https://example.org/'}))",
    "document.body.append(Object.assign(document.createElement('object'), {data: 'https://example.org/'}))",
    "new Image().src = 'http://127.0.0.1:9/?text'",
    "fetch('http://127.0.0.1:9/?text').catch(() => 0)",
    "navigator.sendBeacon('http://127.0.0.1:9/', 'text')",
    "document.body.append(Object.assign(document.createElement('style'), {textContent: 'body{color:red}'}))",
)


@pytest.mark.parametrize("attempt", REFUSED)
def test_the_policy_of_a_report_refuses_all_else(run: Path, browser: Browser, attempt: str) -> None:
    """As if a text had become HTML: its scripts do not run, and nothing is loaded or sent."""
    with report(run, browser) as (page, _):
        violated = page.evaluate(
            "() => new Promise(done => { document.addEventListener('securitypolicyviolation', event =>"
            f" done(event.effectiveDirective)); {attempt}; setTimeout(() => done(''), 5000); }})"
        )
        assert violated
        assert injected(page) == 0
