"""Diagnostics: seals, statistics and process costs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.bridge.security import new_key
from tests.system.running import eventually

pytestmark = pytest.mark.ros


@contextmanager
def two_nodes() -> Iterator[tuple[Any, Any]]:
    from socialbot.bridge.environment import spinning_node

    with ExitStack() as stack:
        yield stack.enter_context(spinning_node("speaker")), stack.enter_context(spinning_node("hearer"))


def status(name: str = "camera", **values: str) -> Any:
    from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

    values = {"machine": "robot", "state": "active", **values}
    return DiagnosticStatus(name=name, values=[KeyValue(key=key, value=value) for key, value in values.items()])


def keep(told: list[tuple[str, dict[str, str]]]) -> Any:
    return lambda name, values: told.append((name, values))


def test_what_is_told_is_heard_with_and_without_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.diagnostics import DiagnosticsPublisher, DiagnosticsSubscriber

    new_key("robot", tmp_path / "keys")
    with two_nodes() as (speaker, hearer):
        curious: list[Any] = []
        DiagnosticsSubscriber(hearer, keep(curious))
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        friend: list[Any] = []
        receiver, sender = DiagnosticsSubscriber(hearer, keep(friend)), DiagnosticsPublisher(speaker)
        assert eventually(lambda: sender.publish([status("camera"), status("head", pid="7")]) or bool(friend))
        assert eventually(lambda: len(curious) >= 2)
        assert friend[:2] == [
            ("camera", {"machine": "robot", "state": "active"}),
            ("head", {"machine": "robot", "state": "active", "pid": "7"}),
        ]
        assert friend[:2] == curious[-2:]
        assert receiver.refused == 0


def test_with_keys_what_is_forged_altered_or_said_again_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from socialbot.bridge.diagnostics import SEAL, DiagnosticsPublisher, DiagnosticsSubscriber

    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    with two_nodes() as (speaker, hearer):
        told: list[tuple[str, dict[str, str]]] = []
        receiver, sender = DiagnosticsSubscriber(hearer, keep(told)), DiagnosticsPublisher(speaker)

        def say(one: Any) -> None:
            receiver._receive(SimpleNamespace(status=[one]))

        say(status())
        assert (receiver.refused, told) == (1, [])
        say(status(**{SEAL: "nonsense"}))
        assert (receiver.refused, told) == (2, [])
        rightly = status()
        sender._seal(rightly)
        # What stands beside the seal is for other tools to read; who has keys does not look at it.
        next(pair for pair in rightly.values if pair.key == "state").value = "given up"
        rightly.name = "head"
        say(rightly)
        assert (receiver.refused, told) == (2, [("camera", {"machine": "robot", "state": "active"})])
        say(rightly)
        assert (receiver.refused, len(told)) == (3, 1)
        battery = status("battery")
        battery.values = battery.values[:0]
        say(battery)
        assert (receiver.refused, len(told)) == (3, 1)


def test_nobody_without_a_key_keeps_a_graph_from_starting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.diagnostics import DiagnosticsPublisher
    from socialbot.bridge.graph_observer import expect_free_names
    from socialbot.core.errors import NodeError
    from socialbot.graph.node import Graph, Node, NodeConfig

    graph = Graph("g", (NodeConfig("speaker", Node),))
    new_key("robot", tmp_path / "keys")
    with two_nodes() as (speaker, hearer):
        sender = DiagnosticsPublisher(speaker)
        timer = speaker.create_timer(0.1, lambda: sender.publish([status("speaker")]))
        with pytest.raises(NodeError, match="running already: speaker"):
            expect_free_names(hearer, graph)
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        expect_free_names(hearer, graph)
        sender = DiagnosticsPublisher(speaker)
        with pytest.raises(NodeError, match="running already: speaker"):
            expect_free_names(hearer, graph)
        speaker.destroy_timer(timer)


def test_mean_and_percentiles_of_durations():
    from socialbot.bridge.diagnostics import DurationStats

    assert DurationStats.of([]) == DurationStats(0.0, 0.0, 0.0)
    stats = DurationStats.of([0.001 * number for number in range(1, 101)])
    assert stats.mean == pytest.approx(0.0505)
    assert (stats.p50, stats.p99) == pytest.approx((0.051, 0.1))


def test_rates_are_of_the_time_in_between():
    from socialbot.bridge.diagnostics import ResourceUsage

    rates = ResourceUsage(12.0, calls=50, published=7, cpu_s=1.5).rates_since(
        ResourceUsage(10.0, calls=30, published=3, cpu_s=1.0)
    )
    assert rates == {"call_hz": 10.0, "publish_hz": 2.0, "cpu_percent": 25.0}


def test_the_process_knows_its_memory():
    from socialbot.bridge.diagnostics import process_costs

    costs = process_costs()
    assert 1.0 < costs["rss_mb"] <= costs["peak_rss_mb"] + 1.0
