"""Diagnostics: seals, statistics and process costs."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.bridge.keys import new_key
from socialbot.core.clock import SECOND
from socialbot.core.messages import Health, Utterance
from tests.bridge.hosting import spinning_nodes
from tests.bridge.test_process import HOLD
from tests.system.running import eventually, next_line

pytestmark = pytest.mark.ros


def status(name: str = "camera", **values: str) -> Any:
    from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

    values = {"machine": "robot", "state": "active", **values}
    return DiagnosticStatus(name=name, values=[KeyValue(key=key, value=value) for key, value in values.items()])


def keep(told: list[tuple[str, dict[str, str]]]) -> Any:
    return lambda name, values: told.append((name, values))


def test_statuses_arrive_with_and_without_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.diagnostics import DiagnosticsPublisher, DiagnosticsSubscriber

    new_key("robot", tmp_path / "keys")
    with spinning_nodes("publisher", "subscriber") as (publisher, subscriber):
        curious: list[Any] = []
        DiagnosticsSubscriber(subscriber, keep(curious))
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        friend: list[Any] = []
        receiver, sender = DiagnosticsSubscriber(subscriber, keep(friend)), DiagnosticsPublisher(publisher)
        assert eventually(lambda: sender.publish([status("camera"), status("head", pid="7")]) or bool(friend))
        assert eventually(lambda: len(curious) >= 2 and len(friend) >= 2)
        assert friend[:2] == [
            ("camera", {"machine": "robot", "state": "active"}),
            ("head", {"machine": "robot", "state": "active", "pid": "7"}),
        ]
        assert friend[:2] == curious[-2:]
        assert receiver.refused == 0


def test_statuses_of_programs_without_keys_are_no_silence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.diagnostics import DiagnosticsSubscriber

    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    with spinning_nodes("subscriber") as (ros,):
        opener = DiagnosticsSubscriber(ros, print)._opener
        assert opener is not None
        assert opener.watch.fault(publishers=3) == ""


def test_a_node_that_only_subscribes_checks_its_subscription(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.stream_watch import BEACON_S
    from socialbot.bridge.transport import open_transport

    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    with spinning_nodes("subscriber") as (ros,):
        transport = open_transport()
        transport.subscribe(ros, "/said", Utterance, print)
        assert min(timer.timer_period_ns for timer in ros.timers) <= BEACON_S * SECOND


def test_refuses_forged_altered_and_replayed_statuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.diagnostics import SEAL, DiagnosticsPublisher, DiagnosticsSubscriber

    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    with spinning_nodes("publisher", "subscriber") as (publisher, subscriber):
        told: list[tuple[str, dict[str, str]]] = []
        receiver, sender = DiagnosticsSubscriber(subscriber, keep(told)), DiagnosticsPublisher(publisher)

        def say(one: Any) -> None:
            receiver._receive(SimpleNamespace(status=[one]))

        say(status())
        assert (receiver.refused, told) == (1, [])
        say(status(**{SEAL: "nonsense"}))
        assert (receiver.refused, told) == (2, [])
        rightly = status()
        sender._seal(rightly)
        # Values beside the seal are for other tools.
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


@pytest.mark.parametrize("with_keys", [True, False])
def test_a_huge_message_of_a_stranger_costs_little_time(
    with_keys: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Reading 16 MB of empty statuses takes seconds, and holds Python's lock meanwhile."""
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.serialization import serialize_message

    from socialbot.bridge.diagnostics import DIAGNOSTICS_TOPIC, DiagnosticsPublisher, DiagnosticsSubscriber

    if with_keys:
        new_key("robot", tmp_path / "keys")
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    empty = bytes(4) + 3 * b"\1\0\0\0\0\0\0\0" + bytes(4)
    count = 2**24 // len(empty)
    huge = serialize_message(DiagnosticArray())[:-4] + count.to_bytes(4, "little") + count * empty
    with spinning_nodes("publisher", "subscriber") as (publisher, subscriber):
        told: list[tuple[str, dict[str, str]]] = []
        receiver, sender = DiagnosticsSubscriber(subscriber, keep(told)), DiagnosticsPublisher(publisher)
        stranger = publisher.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, 10)
        assert eventually(lambda: sender.publish([status()]) or bool(told))
        assert eventually(lambda: stranger.get_subscription_count() > 0)
        begun_s = time.process_time()
        stranger.publish(huge)
        assert eventually(lambda: receiver.refused == 1)
        assert time.process_time() - begun_s < 1.0
        told.clear()
        assert eventually(lambda: sender.publish([status()]) or bool(told))


def test_a_damaged_message_is_refused():
    from socialbot.bridge.diagnostics import DIAGNOSTICS_TOPIC, DiagnosticsSubscriber

    with spinning_nodes("publisher", "subscriber") as (publisher, subscriber):
        from diagnostic_msgs.msg import DiagnosticArray

        receiver = DiagnosticsSubscriber(subscriber, print)
        stranger = publisher.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, 10)
        assert eventually(lambda: stranger.publish(b"\0\1\0\0damaged") or receiver.refused)


def test_unsealed_statuses_cannot_block_a_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.diagnostics import DiagnosticsPublisher
    from socialbot.bridge.graph_observer import expect_free_names
    from socialbot.bridge.run_announcer import run_lock
    from socialbot.core.errors import NodeError
    from socialbot.graph.node import Graph, Node, NodeConfig

    graph = Graph("g", (NodeConfig("publisher", Node),))
    new_key("robot", tmp_path / "keys")
    with spinning_nodes("publisher", "subscriber") as (publisher, subscriber):
        sender = DiagnosticsPublisher(publisher)
        timer = publisher.create_timer(0.1, lambda: sender.publish([status("publisher")]))
        with pytest.raises(NodeError, match="running already: publisher\n"), run_lock("here"):
            expect_free_names(subscriber, graph)
        with subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
            assert next_line(holder) == "\n"
            with pytest.raises(NodeError, match=f"running already: publisher; `up` runs here: process {holder.pid}\n"):
                expect_free_names(subscriber, graph)
            holder.kill()
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        expect_free_names(subscriber, graph)
        sender = DiagnosticsPublisher(publisher)
        with pytest.raises(NodeError, match="running already: publisher"):
            expect_free_names(subscriber, graph)
        publisher.destroy_timer(timer)


def test_mean_and_percentiles_of_durations():
    from socialbot.bridge.diagnostics import duration_stats

    assert duration_stats([]) == (0.0, 0.0, 0.0)
    assert duration_stats([0.001 * number for number in range(1, 101)]) == pytest.approx((0.0505, 0.051, 0.1))


def test_rates_are_increases_per_second():
    from socialbot.bridge.diagnostics import rates

    assert rates({"calls": 30, "cpu_s": 1.0}, {"calls": 50, "cpu_s": 1.5}, 2.0) == {"calls": 10.0, "cpu_s": 0.2}


def test_measures_the_memory_of_the_process():
    from socialbot.bridge.diagnostics import process_costs

    costs = process_costs()
    assert 1.0 < costs["rss_mb"] <= costs["peak_rss_mb"] + 1.0


def test_health_is_read_from_a_status_of_a_node_that_has_one():
    from socialbot.bridge.diagnostics import health_in

    values = {"health": "degraded", "health_reason": "no message on /a, /b", "health_silent": "/a, /b"}
    assert health_in("camera", values, 7, ("/image",)) == Health(
        stamp=7,
        node="camera",
        state="degraded",
        reason="no message on /a, /b",
        silent=("/a", "/b"),
        outputs=("/image",),
    )
    well = health_in("camera", {"health": "ok", "health_reason": "", "health_silent": ""}, 7, ())
    assert well == Health(stamp=7, node="camera", state="ok")
    for none in ({}, {"health": ""}, {"health": "splendid"}):
        assert health_in("driver", none, 7, ()) is None
