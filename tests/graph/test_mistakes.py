"""Mistakes in node classes: each is refused or reported with what is wrong, where, and how to fix it."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from socialbot.agents.base.agent_node import AgentNode
from socialbot.bdi import Action, Belief, Engine
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, MessageError, NodeError, ParameterError, RuleError
from socialbot.core.messages import Health, Structured, Utterance
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input, Output, Parameter
from socialbot.graph.services import ActionServer, Service

WORD = Utterance(stamp=0, id="1", text="hello")


def graph_of(kind: type[Node]) -> Graph:
    return Graph("g", (NodeConfig("n", kind),), inputs=frozenset({"/in"}))


class Deaf(Node):
    """Has an input that no method handles."""

    heard = Input(Utterance, "/in")

    def on_heard(self, message: Utterance) -> None:
        raise AssertionError


def test_an_input_without_a_handler_is_refused():
    with pytest.raises(GraphError, match="the input 'heard' has no handler") as caught:
        graph_of(Deaf)
    assert "@heard" in str(caught.value.remedy)


def test_an_input_has_one_handler():
    heard = Input(Utterance, "/in")

    class Twice:
        @heard
        def on_heard(self, message: Utterance) -> None: ...

        with pytest.raises(GraphError, match="the input on /in has two handlers: on_heard and on_again"):

            @heard
            def on_again(self, message: Utterance) -> None: ...


def test_a_subclass_replaces_the_handler_of_its_input():
    class Base(Node):
        heard = Input(Utterance, "/in")

        @heard
        def on_heard(self, message: Utterance) -> None: ...

    class Derived(Base):
        heard = Input(Utterance, "/in")

        @heard
        def on_other(self, message: Utterance) -> None: ...

    assert (Base.inputs()["heard"].handler, Derived.inputs()["heard"].handler) == ("on_heard", "on_other")


def test_a_coroutine_is_no_handler():
    heard = Input(Utterance, "/in")

    async def on_heard(self: object, message: Utterance) -> None: ...

    with pytest.raises(GraphError, match="on_heard is a coroutine") as caught:
        heard(on_heard)  # type: ignore[arg-type]
    assert "run_in_background" in str(caught.value.remedy)


class Sloppy(Node):
    """Publishes something else."""

    heard = Input(Utterance, "/in")
    said = Output(Utterance, "/out")
    what: object = 3

    @heard
    def on_heard(self, message: Utterance) -> None:
        self.said.publish(self.what)


@pytest.mark.parametrize("what", [3, None, "text", Health(stamp=0, node="n", state="ok")])
def test_an_output_publishes_messages_of_its_type_only(what: object):
    runner = InlineRunner(graph_of(Sloppy))
    runner.start()
    node = runner.nodes["n"]
    assert isinstance(node, Sloppy)
    node.what = what
    with pytest.raises(MessageError, match=f"/out: not an? Utterance: {type(what).__name__}"):
        node.on_heard(WORD)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Parameter(5, "loudness", maximum=1), "the default 5 is out of range"),
        (lambda: Parameter(-0.5, "loudness", minimum=0.0), "the default -0.5 is out of range"),
        (lambda: Parameter("x", "mode", choices=("a", "b")), "the default 'x' is none of a, b"),
        (lambda: Parameter([1, 2], "points"), r"the default \[1, 2\] is no bool, int, float or str"),  # type: ignore[type-var]
        (lambda: Parameter(None, "file"), "the default None is no bool, int, float or str"),  # type: ignore[type-var]
    ],
)
def test_the_default_of_a_parameter_is_valid(make: Callable[[], object], message: str):
    with pytest.raises(ParameterError, match=message) as caught:
        make()
    assert caught.value.remedy


class Stubborn(Node):
    """Takes no arguments."""

    def __init__(self) -> None:
        raise AssertionError


class Broken(Node):
    """Cannot be made."""

    def __init__(self, *args: object) -> None:
        super().__init__(*args)  # type: ignore[arg-type]
        raise FileNotFoundError(2, "No such file", "model.onnx")


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Stubborn, r"n: cannot start: TypeError: Stubborn\.__init__\(\) takes 1 positional argument but 4 were given"),
        (Broken, r"n: cannot start: FileNotFoundError: .*model\.onnx' \(test_mistakes\.py:\d+\)"),
    ],
)
def test_a_node_that_cannot_be_made_is_named(kind: type[Node], message: str):
    with pytest.raises(NodeError, match=message):
        InlineRunner(graph_of(kind))


class Wrong(Node):
    """Fails at each message."""

    heard = Input(Utterance, "/in")

    @heard
    def on_heard(self, message: Utterance) -> None:
        raise KeyError("x")


def test_a_failure_names_file_and_line():
    runner = InlineRunner(graph_of(Wrong))
    runner.start()
    runner.feed("/in", WORD)
    assert re.fullmatch(r"KeyError: 'x' \(test_mistakes\.py:\d+\)", runner.faults["n"].first)


class Restless(Node):
    """Sets a timer for now in each timer."""

    def start(self) -> None:
        self.call_after(0.0, self.start)


class Past(Node):
    """Sets a timer for the past in each timer."""

    def start(self) -> None:
        self.call_after(-1.0, self.start)


class Echo(Node):
    """Answers itself."""

    heard = Input(Utterance, "/in")
    said = Output(Utterance, "/in")

    @heard
    def on_heard(self, message: Utterance) -> None:
        self.said.publish(message)


class Busy(Node):
    """Calls itself again at once, as an agent does whose rules never end."""

    said = Output(Utterance, "/out")

    def start(self) -> None:
        self.said.publish(WORD)
        self.context.call_soon(self.start)


def test_calls_that_keep_the_time_still_are_an_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("socialbot.graph.inline.MOST_AT_ONCE", 1000)
    runner = InlineRunner(graph_of(Busy), start=SECOND)
    with pytest.raises(NodeError, match=r"1000 messages or calls .* at 1\.000 s.* the last on /out"):
        runner.start()


@pytest.mark.parametrize("kind", [Restless, Past])
def test_timers_that_keep_the_time_still_are_an_error(kind: type[Node], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("socialbot.graph.inline.MOST_AT_ONCE", 1000)
    runner = InlineRunner(graph_of(kind), start=SECOND)
    runner.start()
    with pytest.raises(NodeError, match=r"1000 timers .* at 1\.000 s") as caught:
        runner.advance(2 * SECOND)
    assert "call_after" in str(caught.value.remedy)


def test_messages_that_keep_the_time_still_are_an_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("socialbot.graph.inline.MOST_AT_ONCE", 1000)
    runner = InlineRunner(graph_of(Echo), start=SECOND)
    runner.start()
    with pytest.raises(NodeError, match=r"1000 messages or calls .* at 1\.000 s.* the last on /in") as caught:
        runner.feed("/in", WORD)
    assert caught.value.remedy


class Forgetful(Node):
    """Leaves out the initialisation of its base class."""

    def __init__(self, name: str, context: object, parameters: object = None) -> None:
        self.count = 0


def test_a_node_that_forgets_its_base_class_is_refused():
    with pytest.raises(GraphError, match=r"Forgetful\.__init__ does not initialise its base class") as caught:
        InlineRunner(graph_of(Forgetful))
    assert "super().__init__(name, context, parameters)" in str(caught.value.remedy)


class Hasty(Node):
    """Calls a function instead of passing it on."""

    def begin(self) -> object: ...

    def start(self) -> None:
        self.begin()

    def tell(self) -> None: ...


@pytest.mark.parametrize(
    "begin",
    [
        lambda node: node.call_after(1.0, node.tell()),
        lambda node: node.context.call_at(1, node.tell()),
        lambda node: node.context.call_soon(node.tell()),
        lambda node: node.context.run_in_background(node.tell(), print),
        lambda node: node.context.run_in_background(node.tell, node.tell()),
    ],
)
def test_the_result_of_a_function_is_no_callback(begin: Callable[[Hasty], object], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Hasty, "begin", begin)
    with pytest.raises(
        NodeError, match=r"n: cannot start: TypeError: the callback is None, no function: .*\(test_mistakes\.py:\d+\)"
    ):
        InlineRunner(graph_of(Hasty)).start()


@pytest.mark.parametrize(
    ("decorate", "call"),
    [
        (Input(Utterance, "/in"), "on_heard(self, message)"),
        (Service("std_srvs/srv/Trigger", "/go"), "on_heard(self, request, response)"),
        (ActionServer("example_interfaces/action/Fibonacci", "/go"), "on_heard(self, goal)"),
        (ActionServer("example_interfaces/action/Fibonacci", "/go").on_cancel, "on_heard(self, goal)"),
    ],
)
def test_a_handler_takes_what_its_port_passes(decorate: Callable[[object], object], call: str):
    def on_heard(self: object) -> None: ...

    with pytest.raises(GraphError, match="the handler on_heard takes other arguments: too many") as caught:
        decorate(on_heard)
    assert caught.value.remedy == f"write def {call}"


class Bow(Action):
    """Leaves out the initialisation of its base class."""

    def __init__(self, who: str) -> None:
        self.who = who

    def execute(self) -> None: ...


class Arrived(Belief): ...


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (lambda: +Arrived() >> [Arrived], r"test_mistakes\.py:\d+: n: Arrived is a class"),
        (
            lambda: +Arrived() >> [Bow("t1")],
            r"test_mistakes\.py:\d+: n: .*: Bow\.__init__ does not init",
        ),
    ],
)
def test_a_wrong_rule_of_an_agent_has_its_line(rule: Callable[[], object], message: str):
    class Polite(AgentNode):
        def build(self) -> Engine:
            engine = Engine("polite", self.clock, sink=self.record, wake=self.wake)
            engine.add_rules(rule())  # type: ignore[arg-type]
            return engine

    with pytest.raises(RuleError, match=message):
        InlineRunner(graph_of(Polite))


def test_two_messages_of_one_name_are_told_apart_by_their_modules():
    other = type("Utterance", (Utterance,), {"__module__": "elsewhere"}, frozen=True, kw_only=True)
    first, second = (type("N", (Node,), {"said": Output(kind, "/out")}) for kind in (Utterance, other))
    with pytest.raises(
        GraphError, match=r"/out is socialbot\.core\.messages\.Utterance for a but elsewhere\.Utterance for b"
    ):
        Graph("g", (NodeConfig("a", first), NodeConfig("b", second)))


class Counts(Structured, frozen=True, kw_only=True):
    """Some number."""

    number: int


class Careless(Node):
    """Publishes a text as a number."""

    heard = Input(Utterance, "/in")
    out = Output(Counts, "/out")
    rate = Parameter(1.0, "Hz", maximum=5.0)

    @heard
    def on_heard(self, message: Utterance) -> None:
        if message.text == "rate":
            self.rate = 7.0
        self.out.publish(Counts(stamp=0, number=message.text))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("one", "no valid Counts: Expected `int`, got `str` - at `$.number`"),
        ("rate", "n.rate: is a parameter and cannot be assigned"),
    ],
)
def test_a_field_of_another_type_and_an_assigned_parameter_are_reported_with_their_line(
    text: str, words: str, caplog: pytest.LogCaptureFixture
):
    runner = InlineRunner(graph_of(Careless))
    runner.start()
    runner.feed("/in", Utterance(stamp=0, id="1", text=text))
    assert runner.faults["n"].failures == 1
    assert words in caplog.text
    assert re.search(r"test_mistakes\.py:\d+\)", caplog.text)
    assert isinstance(runner.nodes["n"], Careless)
    assert runner.nodes["n"].rate == 1.0


def _named(name: str, declared: object, *bases: type) -> Callable[[], object]:
    return lambda: type("Own", bases or (Node,), {name: declared})


class Limited(Node):
    """Has a parameter and an output."""

    limit = Parameter(0.5, "limit")
    said = Output(Utterance, "/out")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_named("clock", Parameter("x", "clock")), "the parameter 'clock' replaces the attribute of that name of Node"),
        (_named("name", Parameter("x", "name")), "the parameter 'name' replaces the attribute of that name of Node"),
        (_named("inputs", Parameter(1, "x")), "the parameter 'inputs' replaces the attribute of that name of Node"),
        (_named("log", Output(Utterance, "/out")), "the output 'log' replaces the attribute of that name of Node"),
        (_named("stop", Input(Utterance, "/in")), "the input 'stop' replaces the attribute of that name of Node"),
        (_named("start", Service("std_srvs/srv/Trigger", "/start")), "the service or action 'start' replaces"),
        (_named("limit", 0.9, Limited), "'limit' replaces the parameter of that name of Limited"),
        (_named("said", None, Limited), "'said' replaces the output of that name of Limited"),
        (_named("said", Parameter(1, "x"), Limited), "the parameter 'said' replaces the output of that name"),
        (_named("use_sim_time", Parameter(True, "x")), "the parameter 'use_sim_time' replaces that of each ROS node"),
        (_named("autostart", Parameter(True, "x")), "the parameter 'autostart' replaces that of each ROS node"),
    ],
)
def test_a_port_or_parameter_replaces_only_one_of_its_kind(make: Callable[[], object], message: str):
    with pytest.raises(GraphError, match=message) as caught:
        make()
    assert caught.value.remedy


def test_an_unknown_choice_of_numbers_names_the_known_ones():
    with pytest.raises(ParameterError, match="unknown choice 3") as caught:
        Parameter(1, "mode", choices=(1, 2)).check(3, where="n.mode")  # type: ignore[arg-type]
    assert caught.value.remedy == "one of 1, 2"


@pytest.mark.parametrize("kind", [list[Utterance], Utterance | None, None, 3])
def test_a_port_has_a_message_type(kind: object):
    with pytest.raises(GraphError, match="is no message"):
        Input(kind, "/in")  # type: ignore[arg-type]
