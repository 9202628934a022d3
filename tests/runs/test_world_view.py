"""The world view of an agent package: its record, its drawing on the page and its key figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from socialbot.core import registry
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, Structured, Utterance
from socialbot.core.registry import AgentPackage, Film
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Output
from socialbot.runs.folder import RecordedRun
from socialbot.runs.report import PAGE, report_html, write_report
from socialbot.runtime.run import observed_topics
from socialbot.runtime.simulated_source import simulation_topics
from socialbot.testing import GraphTester
from tests.runs.browsing import Visit, chromium
from tests.runs.pages import unfrozen


class GuestCount(Structured, frozen=True, kw_only=True):
    count: int


class Noise(Structured, frozen=True, kw_only=True):
    level: int


class Door(Node):
    """Count a guest each second; it is no simulator."""

    guests = Output(GuestCount, "/guests")
    noise = Output(Noise, "/noise")
    say = Output(Utterance, "/speech/say")

    def start(self) -> None:
        self.count = 0
        self.announce("The door is open.")
        self.call_after(1.0, self.open)

    def announce(self, text: str) -> None:
        self.say.publish(Utterance(stamp=self.clock.now(), id=f"say-{self.count}", text=text))

    def open(self) -> None:
        self.count += 1
        now = self.clock.now()
        self.guests.publish(GuestCount(stamp=now, count=self.count))
        self.noise.publish(Noise(stamp=now, level=self.count))
        self.announce("A guest!")
        self.call_after(1.0, self.open)


class Hall:
    file = "hall.svg"
    kinds = (GuestCount,)

    def __init__(self) -> None:
        self.counts: list[tuple[int, int]] = []

    def take(self, message: Message) -> None:
        assert isinstance(message, GuestCount)
        self.counts.append((message.stamp, message.count))

    def forget(self, stamp: int) -> None: ...

    def __bool__(self) -> bool:
        return bool(self.counts)

    def picture(self, stamp: int, title: str = "") -> str:
        count = max((count for when, count in self.counts if when <= stamp), default=0)
        groups = f'<g data-name="guests"><text>{count}</text></g><g data-name="tray"/><g data-name="cup"/>'
        return f'<svg xmlns="http://www.w3.org/2000/svg">{groups}</svg>'

    def film(self, start: int) -> Film:
        contents = [((stamp - start) / SECOND, index) for index, (stamp, _) in enumerate(self.counts)]
        return Film(
            self.picture(start),
            moves={
                "tray": [(0.0, 0.0, 0.0, 1.0), (2.0, 20.0, 4.0, 1.0)],
                "cup": [(0.0, 5.0, 5.0, 2.0), (3.0, 5.0, 5.0, 0.5)],
            },
            contents={"guests": contents},
            drawings=[f"<text>{count}</text>" for _, count in self.counts],
            classes={"tray": {"full": [(0.0, 0), (2.5, 1)]}},
        )

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        return [(str(len(self.counts)), "guests at the door")]

    def results(self, start: int, end: int) -> dict[str, Any]:
        return {}

    def summary(self, start: int, end: int) -> list[str]:
        return []


def hall(graph: Graph) -> Hall:
    return Hall()


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    """The graph of a node that is no simulator, whose package has a world view."""
    package = AgentPackage(
        "door", __name__.rpartition(".")[0], {"door": f"{__name__}:Door"}, world_view=f"{__name__}:hall"
    )
    monkeypatch.setattr(registry, "agent_packages", lambda: (package,))
    return Graph("door", (NodeConfig("door", Door),))


@pytest.fixture
def run(tmp_path: Path, graph: Graph) -> RecordedRun:
    """The record of that graph."""
    with GraphTester(graph) as tester:
        tester.run(3)
    return tester.recorded(tmp_path / "run")


@pytest.mark.parametrize("topics", [observed_topics, simulation_topics])
def test_each_kind_of_run_observes_what_the_world_view_takes(
    graph: Graph, topics: Callable[[Graph], Mapping[str, type[Message]]]
) -> None:
    assert topics(graph).get("/guests") is GuestCount
    assert "/noise" not in topics(graph)


def test_the_record_keeps_what_the_world_view_takes(run: RecordedRun) -> None:
    assert isinstance(run.world_view, Hall)
    assert [count for _, count in run.world_view.counts] == [1, 2, 3]
    assert "/noise" not in (run.folder / "seen.jsonl").read_text("utf-8")


def test_the_page_of_an_agent_without_desires_has_its_figures_and_its_film(run: RecordedRun) -> None:
    page = report_html(run, world=run.world_view)
    assert "guests at the door" in page
    film = unfrozen(page)["film"]
    assert film["contents"] == {"guests": [[1.0, 0], [2.0, 1], [3.0, 2]]}
    assert film["drawings"] == ["<text>1</text>", "<text>2</text>", "<text>3</text>"]
    assert film["classes"] == {"tray": {"full": [[0.0, 0], [2.5, 1]]}}


@pytest.mark.slow
def test_the_page_moves_fills_marks_and_stacks_the_groups(run: RecordedRun) -> None:
    write_report(run.folder)

    def shown(visit: Visit) -> tuple[str, str, str, list[str]]:
        """Number of guests, place and class of the tray, and the order of tray and cup."""
        tray = visit.page.locator("#map [data-name=tray]")
        names = [str(each.get_attribute("data-name")) for each in visit.page.locator("#map [data-name]").all()]
        place, kind = tray.get_attribute("transform"), tray.get_attribute("class")
        return visit.texts("#map [data-name=guests]")[0], place or "", kind or "", names[1:]

    with chromium() as browser:
        visit = Visit(browser, (run.folder / PAGE).as_uri(), "t=1")
        visit.seek(1.0)
        assert shown(visit) == ("1", "translate(10 2)", "", ["tray", "cup"])
        visit.seek(3.0)
        assert shown(visit) == ("3", "translate(20 4)", "full", ["cup", "tray"])
        visit.close()
