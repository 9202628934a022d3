"""Activation order of nodes, and restart backoff of processes."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from socialbot.core.registry import graph_names
from socialbot.graph.files import load_graph
from socialbot.runtime._processes import RestartBackoff, RestartPolicy
from socialbot.runtime.launch import ACTIVE_S, CONFIGURED_S, BringUp, sinks_first


def test_subscribers_precede_publishers() -> None:
    order = sinks_first(load_graph("waldo"))
    assert order[-1] == "camera"
    for sink, source in [("speech", "listener"), ("head", "listener"), ("listener", "bdi_engine")]:
        assert order.index(sink) < order.index(source)
    for sink, source in [("bdi_engine", "person_detector"), ("person_detector", "image_converter")]:
        assert order.index(sink) < order.index(source)


def test_cycles_of_subscriptions_leave_no_node_out() -> None:
    for name in graph_names():
        graph = load_graph(name)
        assert sorted(sinks_first(graph)) == sorted(config.name for config in graph.nodes)


def test_each_node_waits_for_the_previous_one() -> None:
    asked: list[str] = []
    bring_up = BringUp(["head", "listener", "camera"], asked.append, 0.0)
    bring_up.look(["head", "camera"], [], 1.0)
    assert asked == []
    bring_up.look(["head", "listener", "camera"], [], 1.1)
    assert asked == ["head"]
    bring_up.look(["head", "listener", "camera"], [], 1.2)
    assert asked == ["head"]
    bring_up.look(["listener", "camera"], [], 1.3)
    assert asked == ["head", "listener"]
    assert not bring_up.done
    bring_up.look(["camera"], [], 1.4)
    assert asked == ["head", "listener", "camera"]
    assert bring_up.done


def test_a_slow_node_delays_the_next_one_for_a_limited_time() -> None:
    asked: list[str] = []
    bring_up = BringUp(["head", "camera"], asked.append, 0.0)
    bring_up.look(["head", "camera"], [], 1.0)
    bring_up.look(["head", "camera"], [], 1.0 + ACTIVE_S)
    assert asked == ["head", "camera"]


def test_skips_dead_nodes_and_waits_for_a_limited_time() -> None:
    asked: list[str] = []
    bring_up = BringUp(["head", "listener", "camera"], asked.append, 0.0)
    bring_up.look(["head", "camera"], ["listener"], 1.0)
    bring_up.look(["camera"], ["listener"], 1.1)
    assert asked == ["head", "camera"]
    late = BringUp(["head", "camera"], asked.append, 0.0)
    late.look(["camera"], [], CONFIGURED_S)
    assert asked[2:] == ["head", "camera"]


def test_no_node_is_active_before_the_recorder_hears_it() -> None:
    asked: list[str] = []
    heard: set[str] = set()
    bring_up = BringUp(["head", "listener", "camera"], asked.append, 0.0, lambda nodes: heard.issuperset(nodes))
    bring_up.look(["head", "camera"], ["listener"], 1.0)
    heard.add("head")
    bring_up.look(["head", "camera"], ["listener"], 1.1)
    assert asked == []
    heard.add("camera")
    bring_up.look(["head", "camera"], ["listener"], 1.2)
    assert asked == ["head"]
    deaf = BringUp(["head"], asked.append, 0.0, lambda nodes: False)
    deaf.look(["head"], [], CONFIGURED_S - 0.1)
    assert asked == ["head"]
    deaf.look(["head"], [], CONFIGURED_S)
    assert asked == ["head", "head"]


POLICY = RestartPolicy(times=3, within_s=60.0, first_s=0.2, longest_s=0.5)


def test_the_delay_doubles_until_the_process_is_given_up():
    backoff = RestartBackoff(POLICY)
    pauses = []
    for now in (0.0, 1.0, 2.0, 3.0):
        backoff.started(now)
        pauses.append(backoff.crashed(now + 0.1))
    assert pauses == [0.2, 0.4, 0.5, None]


def test_a_long_lived_process_restarts_at_once():
    backoff = RestartBackoff(POLICY)
    backoff.started(0.0)
    assert backoff.crashed(0.1) == 0.2
    backoff.started(0.3)
    assert backoff.crashed(2.0) == 0.0
    backoff.started(2.0)
    assert backoff.crashed(2.1) == 0.2


def test_old_crashes_are_not_counted():
    backoff = RestartBackoff(POLICY)
    for now in (0.0, 25.0, 50.0, 75.0, 100.0, 125.0):
        backoff.started(now)
        assert backoff.crashed(now + 20.0) == 0.0


@given(st.lists(st.floats(0.0, 100.0), min_size=1, max_size=30))
def test_delays_are_within_the_limits_of_the_policy(uptimes):
    backoff, now = RestartBackoff(POLICY), 0.0
    for uptime in uptimes:
        backoff.started(now)
        now += uptime
        pause = backoff.crashed(now)
        if pause is None:
            return
        assert POLICY.first_s <= pause <= POLICY.longest_s or (pause == 0.0 and uptime > 0.4)
        now += pause
