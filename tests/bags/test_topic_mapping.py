from __future__ import annotations

from pathlib import Path

import pytest

from socialbot.agents.warehouse.messages import GripperStatus
from socialbot.bags.reader import open_bag
from socialbot.bags.topic_mapping import feeding, takes_images
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, GraphError
from socialbot.core.messages import Structured, Utterance
from socialbot.deliberation.messages import Belief, Fact
from socialbot.graph.files import load_graph
from socialbot.graph.node import Delivery, Graph, Input, Node, NodeConfig, Output


class Heat(Structured, frozen=True, kw_only=True):
    """A message that does not come with socialbot."""

    celsius: float


class Stove(Node):
    """Hears of its heat, and of what people wish."""

    heat = Input(Heat, "/heat")
    wish = Input(Utterance, "/wish", Delivery.EVERY, optional=True)
    told = Output(Utterance, "/told")

    @heat
    def on_heat(self, message: Heat) -> None:
        """Nothing."""

    @wish
    def on_wish(self, message: Utterance) -> None:
        """Nothing."""


GRAPH = Graph("kitchen", (NodeConfig("stove", Stove),), inputs=frozenset({"/heat"}))


def recorded(path: Path, **messages: Structured) -> Path:
    with BagWriter(path, compressed=True) as bag:
        for topic, message in messages.items():
            bag.write(f"/{topic}", message, message.stamp)
    return path


def utterance(text: str) -> Utterance:
    return Utterance(stamp=SECOND, id=text, text=text)


def test_inputs_are_fed_by_what_bears_their_name_and_type(tmp_path):
    heat = Heat(stamp=SECOND, celsius=80.0)
    with open_bag(recorded(tmp_path / "bag", heat=heat, wish=utterance("tea"), told=utterance("no"))) as bag:
        assert feeding(bag, GRAPH, None) == {"/heat": "/heat", "/wish": "/wish"}


def test_a_message_of_ones_own_is_read_as_what_the_graph_takes(tmp_path):
    heat = Heat(stamp=SECOND, celsius=80.0)
    with open_bag(recorded(tmp_path / "bag", heat=heat)) as bag:
        feeds = feeding(bag, GRAPH, None)
        assert list(bag.messages(feeds, GRAPH.topics())) == [("/heat", heat)]
        assert list(bag.messages(feeds)) == []
        assert bag.skipped["/heat"].count == 1


def test_a_bag_with_nothing_for_a_graph_is_an_error_that_names_both(tmp_path):
    belief = Belief(stamp=SECOND, belief=Fact(name="p"))
    with open_bag(recorded(tmp_path / "bag", belief=belief)) as bag, pytest.raises(GraphError) as caught:
        feeding(bag, GRAPH, None)
    assert "/heat" in str(caught.value)
    assert "/belief" in str(caught.value)


def test_a_graph_that_takes_pictures_wants_some(tmp_path):
    waldo = load_graph("waldo").without_sources()
    assert takes_images(waldo)
    assert not takes_images(GRAPH)
    with (
        open_bag(recorded(tmp_path / "bag", wish=utterance("hello"))) as bag,
        pytest.raises(BagError, match="no images"),
    ):
        feeding(bag, waldo, None)


def test_the_agents_of_the_warehouse_are_fed_with_its_sensors(tmp_path):
    warehouse = load_graph("warehouse")
    status = GripperStatus(stamp=SECOND, status="open")
    names = {"gripper_a/gripper_status": status, "gripper_a/cmd_gripper_status": status}
    with open_bag(recorded(tmp_path / "bag", **names)) as bag:
        assert feeding(bag, warehouse.without_sources(), None) == {
            "/gripper_a/gripper_status": "/gripper_a/gripper_status"
        }


def test_text_is_written_much_smaller_when_compressed(tmp_path):
    sizes = {}
    for compressed in (False, True):
        path = tmp_path / f"bag{compressed}"
        with BagWriter(path, compressed=compressed) as bag:
            for number in range(500):
                bag.write("/wish", utterance(f"tea for number {number % 7}"), number * SECOND)
        sizes[compressed] = sum(file.stat().st_size for file in path.glob("*.mcap"))
        with open_bag(path) as opened:
            assert len(list(opened.messages({"/wish": "/wish"}))) == 500
    assert sizes[True] < sizes[False] / 3


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_messages_of_one_moment_keep_their_order(tmp_path, storage):
    said = [(topic, utterance(f"{topic}{number}")) for number in range(20) for topic in ("/b", "/a", "/c")]
    with BagWriter(tmp_path / "bag", storage=storage, compressed=True) as bag:
        for topic, message in said:
            bag.write(topic, message, message.stamp + int(message.text[2:]))
    with open_bag(tmp_path / "bag") as opened:
        messages = opened.messages({"/a": "/a", "/b": "/b", "/c": "/c"})
        found = [message.text for _, message in messages if isinstance(message, Utterance)]
    assert found == [message.text for _, message in said]
