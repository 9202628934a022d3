"""The page of a run that goes on, in a browser: its server goes and comes back; many agents are at work."""

from __future__ import annotations

import re
import threading
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytest.importorskip("playwright", reason="needs playwright")

from playwright.sync_api import expect

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import load_graph, parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.runs import run as live_run
from socialbot.runs.folder import open_run
from socialbot.runs.narration import last_log_lines
from socialbot.runs.run import LiveRun
from socialbot.runs.serving import Address, serving
from socialbot.runtime.run import observed_topics
from tests.runs.browsing import Visit
from tests.runs.runs import START, InlineCommands, greeting, waldo_at_work

expect.set_options(timeout=60_000)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]

ANY = Address(port=0)
SOMEBODY = 'personDetected("Yes")'


def same(url: str) -> Address:
    """The address of a server that was there before."""
    return Address(port=urlsplit(url).port or 0)


def test_live_page_reconnects_to_its_server(browser, tmp_path):
    live = LiveRun(load_graph("waldo"))
    runner = waldo_at_work(tmp_path / "run", live, range(10))
    with serving(live, ANY) as served:
        visit = Visit(browser, served.url)
        expect(visit.page.locator("#beliefs")).to_contain_text(SOMEBODY)
        visit.wait(0.9)
    notice = visit.page.locator("#notice")
    expect(notice).to_have_text("The connection is lost; trying again …")
    assert SOMEBODY in "".join(visit.texts("#beliefs .what"))
    visit.page.locator("#beliefs button").first.click()
    expect(visit.page.locator("#pane-why")).to_contain_text("The server does not answer")
    waldo_at_work(tmp_path / "run", live, range(10, 20), runner)
    with serving(live, same(served.url)):
        expect(notice).to_be_hidden()
        visit.page.keyboard.press("End")
        visit.wait(1.9)
        waldo_at_work(tmp_path / "run", live, range(20, 25), runner)
        visit.wait(2.4)
        expect(visit.page.locator("#state")).to_have_text("live")
        visit.close(lost=True)
    runner.close()


def test_live_plans_are_current(browser, tmp_path):
    live = LiveRun(load_graph("waldo"))
    with serving(live, ANY) as served:
        visit = Visit(browser, served.url)
        expect(visit.page.locator("#mind-title")).to_have_text("Waldo")
        visit.page.locator("#tab-plans").click()
        plans = visit.page.locator("#pane-plans")
        expect(plans).to_contain_text("No plan was considered yet.")
        waldo_at_work(tmp_path / "run", live, range(20)).close()
        visit.wait(1.9)
        visit.page.locator("#tab-log").click()
        visit.page.locator("#tab-plans").click()
        expect(plans).to_contain_text("chosen 1")
        visit.close()


def test_page_shows_a_restarted_run(browser, tmp_path):
    first, second = (LiveRun(load_graph("waldo")) for _ in range(2))
    waldo_at_work(tmp_path / "first", first, range(20)).close()
    waldo_at_work(tmp_path / "second", second, range(4)).close()
    with serving(first, ANY) as served:
        visit = Visit(browser, served.url)
        visit.wait(1.9)
    expect(visit.page.locator("#notice")).to_contain_text("lost")
    with serving(second, same(served.url)):
        visit.wait(0.3)
        expect(visit.page.locator("#clock")).to_have_text("0.30 s")
        expect(visit.page.locator("#beliefs")).not_to_contain_text(SOMEBODY)
        expect(visit.page.locator("#log")).not_to_contain_text("Hello")
        visit.close(lost=True)


def test_beginning_of_a_long_log_is_loaded_on_demand(browser):
    live = LiveRun(load_graph("waldo"))
    for number in range(6000):
        stamp, id = START + number * SECOND // 100, f"b{number}"
        what = f"seen({number})"
        live.observe("/waldo/trace", TraceRecord(stamp=stamp, id=id, source="bdi_engine", kind="belief", what=what))
    with serving(live, ANY) as served:
        visit = Visit(browser, served.url)
        visit.wait(59.99)
        asked = "performance.getEntriesByType('resource').filter(each => each.name.includes('/api/log')).length"
        assert visit.number(asked) == 5, "2000 lines, of which each request after the first gives one that is known"
        visit.seek(1.0)
        expect(visit.page.locator("#log .now")).to_contain_text("seen(100)")
        visit.close()


def test_a_late_cause_takes_its_place_in_the_log(browser):
    live = LiveRun(load_graph("waldo"))

    def observe(id: str, source: str, kind: str, what: str, cause: str = "") -> None:
        live.observe("/trace", TraceRecord(stamp=START, id=id, source=source, kind=kind, what=what, cause=cause))

    observe("b", "bdi_engine", "belief", "here")
    with serving(live, ANY) as served:
        visit = Visit(browser, served.url)
        visit.page.locator("#log-all").check()
        observe("say-a", "/speech/say", "utterance", "Hello", "a")
        lines = visit.page.locator("#log li span")
        expect(lines).to_have_text(["Waldo believed here", 'said "Hello"'])
        observe("g", "bdi_engine", "goal", "greet()", "b")
        observe("a", "bdi_engine", "action", "speak()", "g")
        told = ["Waldo believed here", "Waldo wanted greet()", "Waldo did speak()", 'Waldo said "Hello"']
        expect(lines).to_have_text(told)
        visit.close()


def test_the_person_behind_the_scenes_has_keys_and_is_told_what_came_of_it(browser, tmp_path):
    live = LiveRun(load_graph("waldo"))
    runner = waldo_at_work(tmp_path / "run", live, range(3))
    with serving(live, ANY, InlineCommands(runner)) as served:
        visit = Visit(browser, served.url)
        visit.page.locator("#tab-ask").click()
        expect(visit.page.locator(".wizard button")).to_have_count(5)
        visit.page.keyboard.press("b")
        expect(visit.page.locator("#wizard-answer")).to_have_text("say goodbye: accepted.")
        waldo_at_work(tmp_path / "run", live, range(3, 5), runner)
        expect(visit.page.locator("#speech")).to_have_text("“Goodbye!”")
        goal = visit.page.locator("#ask-desire")
        goal.fill("stayIdle")
        goal.press("b")
        expect(goal).to_have_value("stayIdleb")
        goal.fill("GreetPeople()")
        goal.press("Enter")
        expect(visit.page.locator("#ask-desire-answer")).to_have_text("It ended: achieved.")
        visit.close()
    runner.close()
    said = [line.text for line in last_log_lines(live, live.history.start, live.end, 500)]
    assert 'a person had the robot say "Goodbye!"' in said
    assert "Waldo was asked by a person: achieve GreetPeople()" in said


NOTHING_TO_DO = """
from socialbot import AgentNode, Engine
from socialbot.bdi import Belief, Goal


class greeted(Belief):
    pass


class greet(Goal):
    pass


class Mind(AgentNode):
    def build(self) -> Engine:
        engine = Engine(self.name, self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_rules(greet() / greeted() >> [], greet() >> [+greeted()])
        return engine
"""


def test_an_asked_goal_that_needed_no_action_says_so(browser, tmp_path, monkeypatch):
    (tmp_path / "nothing_to_do.py").write_text(NOTHING_TO_DO)
    monkeypatch.syspath_prepend(str(tmp_path))
    graph = parse_graph('name: g\nnodes: {mind: {type: "nothing_to_do:Mind"}}', where="g")
    live = LiveRun(graph)
    runner = InlineRunner(graph, start=START)
    for topic in observed_topics(graph):
        runner.tap(topic, live.observe)
    runner.start()
    with serving(live, ANY, InlineCommands(runner)) as served:
        visit = Visit(browser, served.url)
        visit.page.locator("#tab-ask").click()
        for _ in range(2):
            visit.page.locator("#ask-desire").fill("greet")
            visit.page.locator("#ask-desire").press("Enter")
            answer = visit.page.locator("#ask-desire-answer")
            expect(answer).to_contain_text("Achieved without any action")
        visit.close()
    runner.close()


@dataclass
class Jam:
    """Takes nothing to agents, and while it is not ``free`` holds up who asks whether it does: the whole server."""

    free: threading.Event = field(default_factory=threading.Event)

    @property
    def shut(self) -> str:
        self.free.wait()
        return "nobody is there"

    async def ask(self, agent: str, command: str, text: str) -> None:
        return None

    async def say(self, text: str) -> str:
        return self.shut


def test_silent_server_counts_as_lost(browser, tmp_path):
    live, jam = LiveRun(load_graph("waldo")), Jam()
    jam.free.set()
    runner = waldo_at_work(tmp_path / "run", live, range(10))
    with serving(live, ANY, jam) as served:
        visit = Visit(browser, served.url)
        visit.wait(0.9)
        jam.free.clear()
        try:
            expect(visit.page.locator("#notice")).to_contain_text("The connection is lost")
        finally:
            jam.free.set()
        expect(visit.page.locator("#notice")).to_be_hidden()
        waldo_at_work(tmp_path / "run", live, range(10, 15), runner)
        visit.wait(1.4)
        visit.close()
    runner.close()


def test_recorded_page_reconnects_at_the_chosen_time(browser, tmp_path: Path):
    run = open_run(greeting(tmp_path / "run"))
    with serving(run, ANY) as served:
        visit = Visit(browser, served.url)
    visit.page.locator("#scrubber").fill("1.5")
    notice = visit.page.locator("#notice")
    expect(notice).to_have_text("The server does not answer; trying again …")
    with serving(run, same(served.url)):
        visit.wait(1.5)
        expect(notice).to_be_hidden()
        expect(visit.page.locator("#beliefs")).to_contain_text(SOMEBODY)
        visit.close(lost=True)


def test_long_open_page_drops_old_data(browser, tmp_path, monkeypatch):
    monkeypatch.setattr(live_run, "MOST_RECORDS", 600)
    live = LiveRun(load_graph("waldo"))
    runner = waldo_at_work(tmp_path / "run", live, range(20))
    with serving(live, ANY) as served:
        visit = Visit(browser, served.url)
        visit.wait(1.9)
        for begin in range(20, 1000, 100):
            waldo_at_work(tmp_path / "run", live, range(begin, begin + 100), runner)
            visit.wait((begin + 99) / 10)
        visit.page.keyboard.press("Home")
        since = live.history.seconds(live.history.since)
        assert since > 30.0
        visit.wait(since)
        slider = visit.page.locator("#scrubber")
        expect(slider).to_have_attribute("min", str(since))
        assert slider.evaluate("slider => slider.valueAsNumber") == since
        visit.page.locator("#beliefs button").first.click()
        expect(visit.page.locator("#pane-why")).to_contain_text("because")
        visit.page.keyboard.press("End")
        visit.wait(101.9)
        runner.close()
        served.show(open_run(tmp_path / "run"))
        expect(visit.page.locator("#state")).to_have_text("recorded")
        visit.page.locator("#tab-log").click()
        visit.page.keyboard.press("Home")
        visit.wait(0.0)
        expect(slider).to_have_attribute("min", "0")
        expect(visit.page.locator("#log li button").first).to_have_text(re.compile(r"^0\.\d\d s"))
        visit.close()


def test_page_opened_before_the_run_shows_the_time_of_day(browser, tmp_path):
    live = LiveRun(load_graph("waldo"))
    with serving(live, ANY) as served:
        visit = Visit(browser, served.url)
        expect(visit.page.locator("#mind-title")).to_have_text("Waldo")
        expect(visit.page.locator("#day")).to_be_hidden()
        waldo_at_work(tmp_path / "run", live, range(20)).close()
        visit.wait(1.9)
        expect(visit.page.locator("#day")).to_have_attribute("datetime", re.compile("^2023-11-14T22:13:2"))
        visit.close()
