"""The helpers for users' tests."""

import pytest

from socialbot import Action, Belief, Engine, Input, Node, Output, Parameter, Utterance
from socialbot.core.errors import GraphError, MessageError, NodeError
from socialbot.testing import SECOND, GraphTester, ManualClock, run_engine


class Echo(Node):
    """Repeats utterances after a pause."""

    heard = Input(Utterance, "/heard")
    said = Output(Utterance, "/said")
    pause_s = Parameter(0.5, "pause (s)")

    @heard
    def on_heard(self, message: Utterance) -> None:
        if message.text == "fail":
            raise ValueError("cannot echo")
        self.call_after(self.pause_s, lambda: self.said.publish(message))


def utterance(text: str) -> Utterance:
    return Utterance(stamp=SECOND, id="u", text=text)


def test_a_single_node_is_run_with_messages_from_the_test():
    with GraphTester(Echo, parameters={"pause_s": 1.0}) as tester:
        tester.send("/heard", utterance("hello"))
        assert tester.messages("/said") == []
        tester.run(1.5)
        assert tester.node().pause_s == 1.0
    assert tester.messages("/said") == [utterance("hello")]
    assert tester.times("/said") == [2.0]
    assert tester.seconds == 2.5


def test_a_registered_graph_is_run_by_its_name():
    with GraphTester("cleaner") as tester:
        tester.run(1.0)
        assert tester.seconds == 1.0


def test_a_node_that_raises_fails_the_test():
    with pytest.raises(NodeError, match="ValueError: cannot echo"), GraphTester(Echo) as tester:
        tester.send("/heard", utterance("fail"))


class rain(Belief): ...  # noqa: N801


def test_an_engine_is_run_through_its_timers():
    told = []

    class tell(Action):  # noqa: N801
        def execute(self):
            told.append(self.engine.clock.now() / SECOND)

    from socialbot.bdi import wait

    engine = Engine("cat", ManualClock())
    engine.add_rules(+rain() >> [wait(2), tell()])
    engine.believe(rain())
    run_engine(engine, 1.0)
    assert told == []
    run_engine(engine, 1.5)
    assert told == [2.0]
    assert engine.clock.now() == 2.5 * SECOND


def test_an_unknown_topic_is_an_error():
    with GraphTester(Echo) as tester:
        with pytest.raises(GraphError, match="no topic '/herd'") as caught:
            tester.send("/herd", utterance("x"))
        assert "'/heard'" in str(caught.value.remedy)
        for look in (tester.messages, tester.times):
            with pytest.raises(GraphError, match="no topic '/sad'"):
                look("/sad")


def test_a_message_of_another_type_is_an_error():
    with GraphTester(Echo) as tester, pytest.raises(MessageError, match="/heard takes Utterance, not str"):
        tester.send("/heard", "x")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"text": "x", "id": 3}, "Expected `str`, got `int` - at `$.id`"),
        ({"text": "x", "id": "u", "cause": object()}, "type object is unsupported"),
    ],
)
def test_a_message_with_a_field_of_another_type_is_an_error(fields, words):
    """Over ROS its receivers would reject it."""
    with GraphTester(Echo) as tester, pytest.raises(MessageError) as caught:
        tester.send("/heard", Utterance(stamp=SECOND, **fields))
    assert "/heard" in str(caught.value)
    assert words in str(caught.value)
    assert tester.messages("/heard") == []


def test_an_unknown_node_is_an_error():
    with GraphTester(Echo) as tester, pytest.raises(GraphError, match="no node 'echo'") as caught:
        tester.node("echo")
    assert "known: node" in str(caught.value.remedy)


def test_nodes_that_have_not_started_get_nothing():
    tester = GraphTester(Echo)
    with pytest.raises(GraphError, match="the nodes have not started") as caught:
        tester.send("/heard", utterance("x"))
    assert "with GraphTester" in str(caught.value.remedy)
    with pytest.raises(GraphError, match="the nodes have not started"):
        tester.run(1.0)
