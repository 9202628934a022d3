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

from playwright.sync_api import expect

from socialbot.bridge.keys import new_key
from tests.runs.browsing import Visit, served

expect.set_options(timeout=60_000)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]

BAG = Path(__file__).parents[2] / "data/synthetic/corridor"


def socialbot(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "socialbot", *map(str, arguments)]


@pytest.mark.parametrize(
    ("system", "agent", "world"), [("warehouse", "gripper_a", "floor"), ("hospital", "coordinator", "ward")]
)
def test_page_shows_world_and_plans(browser, tmp_path, system, agent, world):
    folder = tmp_path / system
    subprocess.run(socialbot("run", system, "--runner", "inline", "--out", folder), check=True, capture_output=True)
    with served(folder) as url:
        visit = Visit(browser, url, f"agent={agent}")
        visit.seek(round(visit.number("document.querySelector('#scrubber').max") / 2, 1))
        assert visit.number("document.querySelector('#map').naturalWidth") > 100
        mind, world = visit.place("#mind"), visit.place("#world")
        assert world["y"] + world["height"] == pytest.approx(mind["y"] + mind["height"], abs=2)
        expect(visit.page.locator(".tree .done").first).to_be_visible()
        expect(visit.page.locator("#agent-list [aria-current=true]")).to_contain_text(agent)
        assert visit.page.locator("#timeline .bar.step").count() > 0
        visit.page.locator("#agent-list button").first.click()
        expect(visit.page.locator("#mind-title")).to_have_text(visit.texts("#agent-list span")[0])
        visit.close()


@contextmanager
def running(*arguments: str | Path, key: str = "") -> Iterator[str]:
    """A command that serves the page until Ctrl-C, with a key if one is named; gives the address."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", **({"SOCIALBOT_KEYS": key} if key else {})}
    process = subprocess.Popen(socialbot(*arguments), stdout=subprocess.PIPE, text=True, env=environment)
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
                process.communicate(timeout=180)


@pytest.mark.ros
def test_page_follows_a_run_and_sends_commands(browser, tmp_path):
    with running(
        "replay",
        BAG,
        "--runner",
        "ros",
        "--inspect",
        "--port",
        "0",
        "--no-pace",
        "--no-video",
        "--out",
        tmp_path / "run",
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
        expect(page.locator("#ask-belief-answer")).to_have_text("Asked: accepted.")
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


KEYED = """
name: waldo
inputs: [/humans/bodies/detections]
nodes:
  bdi_engine: {type: waldo, parameters: {vanish_s: 0.5}}
"""


@pytest.mark.ros
def test_commands_need_the_key_of_the_graph(browser, tmp_path):
    graph, keys = tmp_path / "waldo.yaml", tmp_path / "keys"
    graph.write_text(KEYED)
    new_key("robot", keys)
    new_key("desk", keys)
    attach = ("inspect", graph, "--port", "0")
    up = ("up", graph, "--out", tmp_path / "run", "--inspect", "--port", "0")
    with running(*up, key=f"{keys}:robot"):
        with running(*attach) as url:
            visit = Visit(browser, url)
            visit.page.click("#tab-ask")
            expect(visit.page.locator("#pane-ask")).to_contain_text("the graph has keys and the inspector has none")
            assert visit.page.locator("#pane-ask fieldset button:enabled").count() == 0
            visit.close()
        with running(*attach, key=f"{keys}:desk") as url:
            visit = Visit(browser, url)
            first = {"agent": "bdi_engine", "command": "believe", "text": "visitor(bob)"}  # until then nothing is heard
            assert visit.page.request.post(f"{url}api/command", data=first).json()["accepted"]
            visit.page.click("#tab-ask")
            expect(visit.page.locator("#mind-title")).to_have_text("Waldo")
            visit.page.fill("#ask-belief", "visitor(ann)")
            visit.page.click("[name=believe]")
            expect(visit.page.locator("#ask-belief-answer")).to_have_text("Asked: accepted.")
            expect(visit.page.locator("#beliefs")).to_contain_text("visitor(ann)")
            assert "No commands" not in "".join(visit.texts("#pane-ask"))
            visit.close()
    asked = (tmp_path / "run" / "trace.jsonl").read_text()
    assert "believe visitor(ann)" in asked
