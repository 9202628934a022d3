"""The inspector beside a graph that is up: what it shows, and what agents do that people ask for."""

from __future__ import annotations

import json
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from socialbot.bridge.keys import new_key
from tests.runs.runs import greeting
from tests.system.running import eventually, running, socialbot

pytestmark = [pytest.mark.ros, pytest.mark.slow]

GRAPH = """
name: waldo
inputs: [/humans/bodies/detections]
nodes:
  bdi_engine: {type: waldo, parameters: {vanish_s: 0.5}}
"""


@contextmanager
def keyed(name: str, keys: Path | None, *arguments: object) -> Iterator[Any]:
    """``socialbot`` with a key of that name, if there are ``keys``."""
    with pytest.MonkeyPatch.context() as environment:
        if keys is not None:
            environment.setenv("SOCIALBOT_KEYS", f"{keys}:{name}")
        with running(*arguments) as started:
            yield started


@contextmanager
def page(*arguments: object, keys: Path | None = None) -> Iterator[httpx.Client]:
    """A client of the inspector that a command serves."""
    with keyed("desk", keys, *arguments, "--port", 0) as process:
        assert eventually(lambda: re.search(r"Inspector: \S+\n", process.output()) or process.poll() is not None)
        found = re.search(r"Inspector: (\S+)", process.output())
        assert found
        with httpx.Client(base_url=found[1], timeout=20) as client:
            yield client


def ask(client: httpx.Client, command: str, text: str = "") -> dict[str, Any]:
    answer = client.post("/api/command", json={"agent": "bdi_engine", "command": command, "text": text})
    return answer.json()


def beliefs(client: httpx.Client) -> list[str]:
    agents = client.get("/api/moment").json()["agents"]
    return [belief["text"] for agent in agents for belief in agent["beliefs"]]


def says_that_it_is_paused(client: httpx.Client) -> bool:
    return any("paused by a person" in node["reason"] for node in client.get("/api/nodes").json())


def does_what_it_is_asked_for(client: httpx.Client) -> None:
    assert eventually(lambda: ask(client, "believe", "present(1)").get("accepted") is True, 60)
    assert eventually(lambda: "present(1)" in beliefs(client), 20)
    assert ask(client, "pause") == {"accepted": True, "reason": ""}
    assert eventually(lambda: client.get("/api/moment").json()["agents"][0]["paused"], 20)
    assert eventually(lambda: says_that_it_is_paused(client), 20)
    assert ask(client, "step")["accepted"] is True
    assert ask(client, "resume")["accepted"] is True
    assert "is not paused" in ask(client, "step")["reason"]


def test_up_shows_a_page_and_takes_commands(tmp_path: Path) -> None:
    (tmp_path / "waldo.yaml").write_text(GRAPH)
    with page("up", tmp_path / "waldo.yaml", "--out", tmp_path / "run", "--inspect") as client:
        assert client.get("/api/run").json()["live"] is True
        does_what_it_is_asked_for(client)
        assert "person: believe present(1)" in str(client.get("/api/log").json())
        assert ask(client, "pause")["accepted"] is True
        assert eventually(lambda: says_that_it_is_paused(client), 20)
        told = socialbot("status", tmp_path / "waldo.yaml", "--json")
        (mind,) = json.loads(told.stdout)["nodes"]
        assert (told.returncode, mind["condition"], mind["well"]) == (0, "paused", True)


def test_attaches_to_a_running_graph_with_its_own_key(tmp_path: Path) -> None:
    (tmp_path / "waldo.yaml").write_text(GRAPH)
    keys = tmp_path / "keys"
    new_key("robot", keys)
    new_key("desk", keys)
    with (
        keyed("robot", keys, "up", tmp_path / "waldo.yaml", "--out", tmp_path / "run"),
        page("inspect", tmp_path / "waldo.yaml", keys=keys) as client,
    ):
        does_what_it_is_asked_for(client)


def test_the_token_of_an_opened_page_is_not_among_the_arguments_of_the_browser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("needs chromium")
    arguments, page = tmp_path / "arguments", tmp_path / "page"
    browser = tmp_path / "browser"
    browser.write_text(f"""#!/bin/sh
{chromium} --headless --no-sandbox --disable-gpu --user-data-dir={tmp_path}/data --virtual-time-budget=10000 \\
    --dump-dom "$1" >{page}.part && echo "$1" >{arguments} && mv {page}.part {page}
""")
    browser.chmod(0o700)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    monkeypatch.setenv("SOCIALBOT_TOKEN", "secret-token")
    with running("inspect", greeting(tmp_path / "evening"), "--open", "--port", 0) as process:
        assert eventually(lambda: page.exists() or process.poll() is not None), process.output()
        (file,) = tmp_path.glob("socialbot-*.html")
        assert arguments.read_text().strip() == file.as_uri()
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert "<title>Waldo: evening" in page.read_text()
    assert not file.exists()


PATIENCE_MS = 60_000


@pytest.mark.xdist_group("browser")
def test_any_of_a_hundred_agents_is_found_and_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("playwright", reason="needs playwright")
    from playwright.sync_api import expect

    from evaluation import inspect
    from tests.runs.browsing import Visit, chromium

    monkeypatch.setattr(inspect, "BEGINS_WITHIN_S", 600.0)  # on a busy machine
    with chromium() as browser, inspect.crowd(tmp_path, inspect.AGENTS, inspected=True) as (_, _, address):
        visit = Visit(browser, address)
        agents = visit.page.locator("#agent-list li")
        expect(agents).to_have_count(inspect.AGENTS, timeout=PATIENCE_MS)
        visit.page.locator("#agent-filter").fill("agent77")
        expect(agents).to_have_count(1, timeout=PATIENCE_MS)
        agents.locator("button").click()
        expect(visit.page.locator("#mind-title")).to_have_text("agent77", timeout=PATIENCE_MS)
        places = visit.page.locator("#beliefs li", has_text="at(").locator(".what")
        for _ in range(3):
            before = places.last.inner_text()
            expect(places).to_have_count(1, timeout=PATIENCE_MS)
            expect(places.last).not_to_have_text(before, timeout=PATIENCE_MS)
        visit.close()
