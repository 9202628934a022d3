"""Who is activated when."""

from __future__ import annotations

from socialbot.core.registry import graph_names
from socialbot.graph.files import load_graph
from socialbot.runtime._supervisor import ACTIVE_S, CONFIGURED_S, BringUp, sinks_first


def test_who_listens_comes_before_who_speaks() -> None:
    order = sinks_first(load_graph("waldo"))
    assert order[-1] == "camera"
    for sink, source in [("speech", "listener"), ("head", "listener"), ("listener", "bdi_engine")]:
        assert order.index(sink) < order.index(source)
    for sink, source in [("bdi_engine", "person_detector"), ("person_detector", "image_converter")]:
        assert order.index(sink) < order.index(source)


def test_nobody_is_left_out_where_nodes_listen_to_each_other() -> None:
    for name in graph_names():
        graph = load_graph(name)
        assert sorted(sinks_first(graph)) == sorted(placement.name for placement in graph.placements)


def test_each_waits_for_the_one_before() -> None:
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


def test_one_that_takes_its_time_holds_the_others_up_for_a_while_only() -> None:
    asked: list[str] = []
    bring_up = BringUp(["head", "camera"], asked.append, 0.0)
    bring_up.look(["head", "camera"], [], 1.0)
    bring_up.look(["head", "camera"], [], 1.0 + ACTIVE_S)
    assert asked == ["head", "camera"]


def test_nobody_waits_for_the_dead_or_for_ever() -> None:
    asked: list[str] = []
    bring_up = BringUp(["head", "listener", "camera"], asked.append, 0.0)
    bring_up.look(["head", "camera"], ["listener"], 1.0)
    bring_up.look(["camera"], ["listener"], 1.1)
    assert asked == ["head", "camera"]
    late = BringUp(["head", "camera"], asked.append, 0.0)
    late.look(["camera"], [], CONFIGURED_S)
    assert asked[2:] == ["head", "camera"]
