"""A program in the same ROS domain that announces nodes, topics and types with odd names."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from socialbot.bags.writer import BagWriter
from socialbot.bridge import discovery, recorder
from socialbot.bridge.environment import KEYS_VARIABLE, spinning_node
from socialbot.bridge.graph_observer import expect_free_names
from socialbot.bridge.keys import new_key
from socialbot.bridge.recorder import record
from socialbot.bridge.topics import list_topics, merged_messages, observer_node
from socialbot.bridge.transport import open_transport
from socialbot.core.errors import NodeError
from socialbot.core.messages import Utterance
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Output
from tests.bridge.forged_names import NODES, PUBLISHERS
from tests.bridge.hosting import foreign_process, node_hosts
from tests.system.running import PATIENCE_S, eventually

pytestmark = [pytest.mark.ros, pytest.mark.slow]

TOPIC = "/speech/say"
UNREADABLE = ("node", "topic", "type")
KINDS = (*NODES, *PUBLISHERS)


class Head(Node):
    """Publishes sentences."""

    say = Output(Utterance, TOPIC)


GRAPH = Graph("g", (NodeConfig("head", Head),))


@pytest.fixture(autouse=True)
def apart(monkeypatch: pytest.MonkeyPatch, other_domain: int) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(other_domain))


@pytest.fixture(params=[False, True], ids=["open", "keys"])
def has_keys(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> bool:
    if request.param:
        new_key("robot", tmp_path / "keys")
        monkeypatch.setenv(KEYS_VARIABLE, str(tmp_path / "keys"))
    return request.param


def has_arrived(ros: Any, kind: str) -> bool:
    """Whether the odd names of a program are discovered."""
    nodes = discovery.readable(ros.get_node_names)
    topics = discovery.readable(ros.get_topic_names_and_types)
    known = discovery.readable(lambda: ros.get_publishers_info_by_topic(TOPIC))
    return {
        "node": nodes is None and known is not None,
        "topic": topics is None,
        "type": topics is None and known is None,
        "many": nodes is not None and len(nodes) > 1000,
        "controls": nodes is not None and any("\x1b" in name for name in nodes),
        "topic_controls": topics is not None and "/\x1b[2J" in dict(topics),
        "other_type": topics is not None and "std_msgs/msg/Bool" in dict(topics).get(TOPIC, ()),
        "module": topics is not None and "forged_module/msg/String" in dict(topics).get(TOPIC, ()),
    }[kind]


@contextmanager
def announced(ros: Any, kind: str) -> Iterator[None]:
    """Announce names of a ``kind``, which ``ros`` has discovered."""
    with foreign_process("tests.bridge.forged_names", TOPIC, kind):
        assert eventually(lambda: has_arrived(ros, kind))
        yield


@contextmanager
def sending() -> Iterator[list[str]]:
    """Publish sentences; the list has their ids."""
    sent: list[str] = []
    ended = threading.Event()
    with spinning_node("sender") as ros:
        sender = open_transport().advertise(ros, TOPIC, Utterance)

        def send() -> None:
            while not ended.wait(0.05):
                sent.append(str(len(sent)))
                sender.publish(Utterance(stamp=time.time_ns(), id=sent[-1], text="word"))

        thread = threading.Thread(target=send)
        thread.start()
        try:
            yield sent
        finally:
            ended.set()
            thread.join()


@pytest.mark.parametrize("kind", KINDS)
def test_up_starts(kind: str, has_keys: bool) -> None:
    with spinning_node("observer") as ros, announced(ros, kind):
        expect_free_names(ros, GRAPH)


@pytest.mark.parametrize("kind", UNREADABLE)
def test_up_finds_its_own_nodes_that_run(kind: str, has_keys: bool) -> None:
    with node_hosts(GRAPH) as host, spinning_node("observer") as ros, announced(ros, kind):
        host("head")
        with pytest.raises(NodeError, match="running already: head"):
            expect_free_names(ros, GRAPH)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("has_keys", [True], indirect=True, ids=["keys"])
def test_messages_arrive_at_observers(kind: str, has_keys: bool) -> None:
    """Such as pages, which fit the quality of service of the publishers."""
    with sending(), spinning_node("witness") as witness, announced(witness, kind), observer_node() as ros:
        end = time.monotonic() + PATIENCE_S
        found = merged_messages(ros, {TOPIC: Utterance}, ended=lambda: time.monotonic() > end)
        assert next(filter(None, found))[0] == TOPIC


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("topics", [(), (TOPIC,)], ids=["all", "one"])
@pytest.mark.parametrize("has_keys", [True], indirect=True, ids=["keys"])
def test_a_recording_holds_the_messages(
    kind: str, topics: tuple[str, ...], has_keys: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bags: list[BagWriter] = []
    monkeypatch.setattr(
        recorder, "BagWriter", lambda *place, **options: bags.append(BagWriter(*place, **options)) or bags[0]
    )
    with sending(), spinning_node("witness") as ros, announced(ros, kind):
        end = time.monotonic() + PATIENCE_S
        record(
            tmp_path / "bag", topics=topics, stopped=lambda: bags[0].counts.get(TOPIC, 0) > 20 or time.monotonic() > end
        )
    assert bags[0].counts.get(TOPIC, 0) > 20


@pytest.mark.parametrize("kind", KINDS)
def test_topics_are_listed(kind: str) -> None:
    with sending(), spinning_node("witness") as ros, announced(ros, kind):
        assert eventually(lambda: TOPIC in [topic.name for topic in list_topics(ros)])
