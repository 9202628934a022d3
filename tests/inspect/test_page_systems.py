"""The page of whole systems, in a browser: a warehouse, a hospital, and a Waldo that runs."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="needs playwright")

from playwright.sync_api import Browser, expect

from tests.inspect.browsing import Visit, chromium, served

expect.set_options(timeout=60_000)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]

BAG = Path(__file__).parents[2] / "data/synthetic/corridor"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


def socialbot(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "socialbot", *map(str, arguments)]


@pytest.mark.parametrize(
    ("system", "agent", "world"), [("warehouse", "gripper_a", "floor"), ("hospital", "coordinator", "ward")]
)
def test_a_run_of_agents_shows_their_world_and_their_plans(browser, tmp_path, system, agent, world):
    folder = tmp_path / system
    subprocess.run(socialbot("run", system, "--runner", "inline", "--out", folder), check=True, capture_output=True)
    with served(folder) as url:
        visit = Visit(browser, url, f"agent={agent}")
        visit.seek(round(visit.number("document.querySelector('#scrubber').max") / 2, 1))
        assert visit.number("document.querySelector('#map').naturalWidth") > 100
        expect(visit.page.locator(".tree .done").first).to_be_visible()
        expect(visit.page.locator("#agent-list [aria-current=true]")).to_contain_text(agent)
        assert visit.page.locator("#timeline .bar.step").count() > 0
        visit.page.locator("#agent-list button").first.click()
        expect(visit.page.locator("#mind-title")).to_have_text(visit.texts("#agent-list span")[0])
        visit.close()


@contextmanager
def running(*arguments: str | Path) -> Iterator[str]:
    """A command that serves the page until Ctrl-C; gives the address."""
    process = subprocess.Popen(
        socialbot(*arguments), stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if found := re.search(r"http://\S+", line):
                break
        else:
            pytest.fail("it never said where the page is")
        yield found.group()
    finally:
        while process.poll() is None:  # the first ends the run, the next the page of what was recorded
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=10)


@pytest.mark.ros
def test_the_page_follows_a_run_and_takes_what_people_ask(browser, tmp_path):
    with running(
        "replay", BAG, "--inspect", "--port", "0", "--no-pace", "--no-video", "--out", tmp_path / "run"
    ) as url:
        visit = Visit(browser, url)
        page = visit.page
        expect(page.locator("#state")).to_have_text("live")
        expect(page.locator("#mind-title")).to_have_text("Waldo")
        page.wait_for_function("() => document.querySelector('#picture').dataset.t > 1")

        page.click("#tab-ask")
        page.click("[name=pause]")
        expect(page.locator("#mind-title")).to_contain_text("paused")
        page.fill("#ask-belief", "personDetected(")
        page.click("[name=believe]")
        expect(page.locator("#ask-belief-answer")).to_contain_text("expected")
        page.fill("#ask-belief", "visitor(ann)")
        page.click("[name=believe]")
        expect(page.locator("#ask-belief-answer")).to_have_text("Done.")
        page.click("[name=resume]")
        expect(page.locator("#beliefs")).to_contain_text("visitor(ann)")

        visit.seek(1.0)
        expect(page.locator("#live")).to_be_visible()
        expect(page.locator("#beliefs")).not_to_contain_text("visitor(ann)")
        page.click("#live")
        expect(page.locator("#beliefs")).to_contain_text("visitor(ann)")

        expect(page.locator("#state")).to_have_text("recorded", timeout=120_000)
        visit.seek(1.0)
        visit.close()
