from __future__ import annotations

import logging

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import DeviceError, GraphError, ParameterError, suggestion
from socialbot.core.messages import HeadCommand, SpeechStatus, Utterance
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.vision.person_detector import PersonDetector


class Source(Node):
    """Source without inputs."""

    said = Output(Utterance, "/said")


class Tracker(Node):
    """Source whose messages have ids of its own."""

    people = Output(Utterance, "/people", exclusive=True)


class Echo(Node):
    """Republish each message."""

    heard = Input(Utterance, "/said", Delivery.NEWEST)
    say = Output(Utterance, "/echo")
    status = Output(SpeechStatus, "/status", Delivery.LATCHED)

    volume = Parameter(0.5, "loudness", minimum=0.0, maximum=1.0)
    times = Parameter(1, "how often", minimum=1)
    loud = Parameter(False, "whether it shouts")
    voice = Parameter("en", "the language", choices=("en", "it", "broken"))
    device = Parameter("default", "the sound device", fixed=True)

    changed: tuple[str, ...] = ()

    @heard
    def on_heard(self, message: Utterance) -> None:
        for _ in range(self.times):
            self.say.publish(message)

    def on_parameter(self, name: str) -> None:
        if getattr(self, name) == "broken":
            raise DeviceError("there is no such device")
        self.changed = (*self.changed, name)


class Louder(Echo):
    """An echo with more to it."""

    gain = Parameter(2.0, "how much louder")
    volume = Parameter(0.9, "loudness")


class Shouting(Source):
    """A source with a wrong topic."""

    loud = Output(Utterance, "/said!")


class Late(Node):
    """Wants the last message."""

    heard = Input(Utterance, "/said", Delivery.LATCHED)

    @heard
    def on_heard(self, message: Utterance) -> None: ...


class Nodder(Node):
    """Moves when spoken to."""

    heard = Input(HeadCommand, "/command")

    @heard
    def on_heard(self, message: HeadCommand) -> None: ...


def graph(*configs: NodeConfig, **more) -> Graph:
    return Graph("test", configs, **more)


def echo(**parameters) -> Echo:
    """An echo that lives in a graph."""
    runner = InlineRunner(graph(NodeConfig("echo", Echo, parameters), inputs=frozenset({"/said"})))
    node = runner.nodes["echo"]
    assert isinstance(node, Echo)
    return node


def utterance(text: str) -> Utterance:
    return Utterance(stamp=SECOND, id="1", text=text)


# Ports


def test_a_node_lists_its_ports_and_parameters_by_name():
    assert {name: port.topic for name, port in Echo.inputs().items()} == {"heard": "/said"}
    assert {name: port.topic for name, port in Echo.outputs().items()} == {"say": "/echo", "status": "/status"}
    assert list(Echo.parameters()) == ["volume", "times", "loud", "voice", "device"]
    assert Echo.inputs()["heard"].message_type is Utterance
    assert Echo.inputs()["heard"].delivery is Delivery.NEWEST
    assert Echo.outputs()["status"].delivery is Delivery.LATCHED
    assert Echo.say.delivery is Delivery.EVERY


def test_a_node_inherits_ports_and_parameters_and_may_change_them():
    assert list(Louder.inputs()) == ["heard"]
    assert list(Louder.parameters()) == ["volume", "times", "loud", "voice", "device", "gain"]
    assert Louder.parameters()["volume"].default == 0.9
    assert Echo.parameters()["volume"].default == 0.5
    assert "gain" not in Echo.parameters()


def test_a_node_with_two_base_classes_has_the_ports_of_both():
    class Blinking(Node):
        lamp = Output(Utterance, "/lamp")

    class BlinkingEcho(Blinking, Echo):
        pass

    assert list(BlinkingEcho.inputs()) == ["heard"]
    assert list(BlinkingEcho.outputs()) == ["say", "status", "lamp"]


def test_an_input_delivers_to_its_method_and_to_that_of_a_subclass():
    heard = []

    class Quiet(Echo):
        def on_heard(self, message):
            heard.append(message.text)

    runner = InlineRunner(graph(NodeConfig("quiet", Quiet), inputs=frozenset({"/said"})))
    Echo.inputs()["heard"].deliver(runner.nodes["quiet"], utterance("hello"))
    assert heard == ["hello"]


# Parameters


def test_parameters_have_given_values_or_defaults():
    assert echo().volume == 0.5
    node = echo(volume=1, times=3, loud=True, voice="it", device="usb")
    assert (node.volume, node.times, node.loud, node.voice, node.device) == (1.0, 3, True, "it", "usb")
    assert type(node.volume) is float


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"volume": "loud"}, ["'loud' is not of type float", "give a number: loudness"]),
        ({"volume": True}, ["True is not of type float"]),
        ({"times": 2.0}, ["2.0 is not of type int"]),
        ({"times": True}, ["True is not of type int"]),
        ({"loud": 1}, ["1 is not of type bool", "give true or false"]),
        ({"voice": None}, ["None is not of type str"]),
        ({"volume": 1.1}, ["1.1 is out of range", "from 0.0 to 1.0"]),
        ({"volume": -1}, ["-1.0 is out of range"]),
        ({"times": 0}, ["0 is out of range", "from 1 to inf"]),
        ({"volume": float("nan")}, ["nan is out of range"]),
        ({"voice": "fr"}, ["unknown choice 'fr'", "one of en, it, broken"]),
    ],
)
def test_a_value_that_does_not_fit_is_refused_with_its_place(given, words):
    with pytest.raises(ParameterError) as caught:
        echo(**given)
    assert caught.value.where is not None
    assert caught.value.where.endswith(f"echo.{next(iter(given))}")
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize("value", [0.0, 1.0, 0, 1])
def test_the_bounds_belong_to_the_range(value):
    assert echo(volume=value).volume == value


def test_an_unknown_parameter_comes_with_a_suggestion():
    with pytest.raises(ParameterError, match="did you mean 'volume'"):
        echo(volumes=1.0)


def test_a_parameter_can_change_while_running():
    node = echo()
    node.set_parameter("volume", 1)
    assert (node.volume, node.changed) == (1.0, ("volume",))


@pytest.mark.parametrize(("name", "value"), [("volume", 7.0), ("voice", "fr"), ("nothing", 1), ("device", "usb")])
def test_a_refused_change_has_no_effect(name, value):
    node = echo()
    with pytest.raises(ParameterError) as caught:
        node.set_parameter(name, value)
    assert caught.value.where in ("echo", f"echo.{name}")
    assert (node.volume, node.voice, node.device, node.changed) == (0.5, "en", "default", ())


def test_a_change_that_the_node_objects_to_is_taken_back():
    node = echo(voice="it")
    with pytest.raises(DeviceError):
        node.set_parameter("voice", "broken")
    assert node.voice == "it"


def test_two_nodes_of_a_type_have_parameters_of_their_own():
    one, two = echo(), echo()
    one.set_parameter("volume", 1.0)
    assert two.volume == 0.5


def test_a_node_logs_under_its_name():
    assert echo().log is logging.getLogger("socialbot.echo")


# Graphs


@pytest.mark.parametrize(
    ("configs", "more", "words"),
    [
        ([NodeConfig("a", Source), NodeConfig("a", Source)], {}, ["two nodes are called 'a'"]),
        ([NodeConfig("a", Source, {}, {"sayd": "/x"})], {}, ["no input or output 'sayd'", "did you mean 'said'?"]),
        ([NodeConfig("a", Source), NodeConfig("b", Echo, {"volume": 2.0})], {}, ["out of range", "test: b.volume"]),
        ([NodeConfig("a", Source), NodeConfig("b", Echo, {"size": 1})], {}, ["no parameter 'size'", "test: b"]),
        ([NodeConfig("b", Echo)], {}, ["nobody publishes /said", "test: b.heard", "inputs"]),
        ([NodeConfig("a", Source, {}, {"said": "/sad"}), NodeConfig("b", Echo)], {}, ["did you mean '/sad'?"]),
        (
            [NodeConfig("a", Source), NodeConfig("b", Nodder, {}, {"heard": "/said"})],
            {},
            ["/said is Utterance for a but HeadCommand for b", "remap"],
        ),
        ([NodeConfig("b", Echo, {}, {"status": "/said"}), NodeConfig("a", Source)], {}, ["/said is", "SpeechStatus"]),
        *(
            ([NodeConfig("a", Source, {}, {"said": topic})], {}, ["no valid topic: '/", "test: a.said"])
            for topic in ("", "/", "/a b", "/bad-topic", "/a//b", "/a/", "/1a", "~a", "/\u00e4", "/{who}")
        ),
        (
            [NodeConfig("a", Source), NodeConfig("b", Late)],
            {},
            ["test: b.heard: /said is latched for b but not for a", "give both ports Delivery.LATCHED"],
        ),
        (
            [NodeConfig("a", Tracker), NodeConfig("b", Tracker)],
            {},
            ["a and b both publish /people, so", "remap: {people: /b/people}"],
        ),
        ([NodeConfig("a", Shouting)], {}, ["no valid topic: '/said!'", "test: a.loud"]),
        ([NodeConfig("a", Source)], {"inputs": frozenset({"/my camera"})}, ["no valid topic: '/my camera'"]),
        ([NodeConfig("a", Source)], {"services": frozenset({"add"})}, ["no valid topic: 'add'"]),
        ([NodeConfig("a", Source)], {"paced_by": "/sayd"}, ["paced_by names /sayd", "did you mean '/said'?"]),
        ([NodeConfig("b", Echo)], {"inputs": frozenset({"/said"}), "paced_by": "/said"}, ["which no node publishes"]),
    ],
)  # fmt: skip
def test_a_graph_that_does_not_fit_together_is_refused(configs, more, words):
    with pytest.raises((GraphError, ParameterError)) as caught:
        graph(*configs, **more)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert (caught.value.where or "").startswith("test")
    assert caught.value.remedy


def test_two_cameras_give_people_different_ids():
    """Records, agents and questions know people by their ids alone."""
    rear = {name: f"/rear/{name}" for name in ("image", "camera_info", "detections", "annotations")}
    inputs = frozenset({"/camera/image_color", "/camera/camera_info", "/rear/image", "/rear/camera_info"})
    front = NodeConfig("front", PersonDetector)

    def prefix(**given: str) -> object:
        made = graph(front, NodeConfig("rear", PersonDetector, given, rear), inputs=inputs)
        assert "id_prefix" not in made.node("front").parameters
        return made.node("rear").parameters["id_prefix"]

    assert (prefix(), prefix(id_prefix="back_")) == ("rear_", "back_")
    with pytest.raises(GraphError, match="front and rear give people the same ids") as caught:
        prefix(id_prefix="")
    assert caught.value.remedy == "set rear.id_prefix: rear_"


def test_a_topic_without_a_slash_is_that_of_ros():
    whole = graph(
        NodeConfig("a", Source, {}, {"said": "room/said"}), NodeConfig("b", Echo, {}, {"heard": "/room/said"})
    )
    assert whole.topics()["/room/said"] is Utterance


def test_a_graph_lists_its_topics_and_their_types():
    whole = graph(NodeConfig("a", Source), NodeConfig("b", Echo, {}, {"say": "/again"}))
    assert whole.topics() == {"/said": Utterance, "/again": Utterance, "/status": SpeechStatus}


def test_a_node_is_found_by_name():
    whole = graph(NodeConfig("source", Source))
    assert whole.node("source").type is Source
    with pytest.raises(GraphError, match="did you mean 'source'"):
        whole.node("sauce")


def test_without_sources_the_world_takes_their_place():
    whole = graph(NodeConfig("a", Source), NodeConfig("b", Echo), inputs=frozenset({"/more"}), paced_by="/echo")
    rest = whole.without_sources()
    assert [config.name for config in rest.nodes] == ["b"]
    assert rest.inputs == {"/more", "/said"}
    assert rest.paced_by == "/echo"
    assert rest.without_sources() == rest


def test_without_sources_removes_simulators_too():
    class Hall(Echo):
        is_simulator = True

    whole = graph(
        NodeConfig("a", Source),
        NodeConfig("hall", Hall),
        NodeConfig("b", Echo, {}, {"heard": "/echo", "say": "/again"}),
    )
    rest = whole.without_sources()
    assert [config.name for config in rest.nodes] == ["b"]
    assert rest.inputs == {"/said", "/echo", "/status"}


def test_with_parameters_changes_those_given_and_no_others():
    whole = graph(NodeConfig("a", Source), NodeConfig("b", Echo, {"times": 2, "volume": 0.1}))
    changed = whole.with_parameters({"b": {"volume": 0.2}})
    assert dict(changed.node("b").parameters) == {"times": 2, "volume": 0.2}
    assert dict(whole.node("b").parameters) == {"times": 2, "volume": 0.1}
    assert changed.node("a") == whole.node("a")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"c": {}}, "no node 'c'"),
        ({"b": {"volume": 9.0}}, "out of range"),
        ({"b": {"pitch": 9}}, "no parameter 'pitch'"),
    ],
)
def test_with_parameters_refuses_invalid_values(changes, words):
    with pytest.raises((GraphError, ParameterError), match=words):
        graph(NodeConfig("a", Source), NodeConfig("b", Echo)).with_parameters(changes)


def test_a_suggestion_names_the_nearest_and_all():
    assert suggestion("spek", ["wait", "speak"]) == "did you mean 'speak'? known: speak, wait"
    assert suggestion("zzz", ["wait"]) == "known: wait"
    assert suggestion("zzz", []) == "known: none"


class Open(Node):
    heard = Input(Utterance, "/from_anybody", optional=True)

    @heard
    def on_heard(self, message: Utterance) -> None: ...


def test_an_optional_input_may_stay_unconnected():
    assert set(Graph("open", (NodeConfig("a", Open),)).topics()) == {"/from_anybody"}
