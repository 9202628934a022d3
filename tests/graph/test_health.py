from __future__ import annotations

import itertools

import pytest

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Health, Message, Utterance
from socialbot.graph.health import (
    BEAT_S,
    COMMON_BEATS,
    FIRST_S,
    HEALTH_TOPIC,
    LINK,
    SILENT_S,
    HealthReports,
    ended,
    own_health_topic,
)
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input, Output, Parameter


class Eye(Node):
    """Republish each message."""

    seen = Input(Utterance, "/seen", deadline_s=SILENT_S)
    heard = Input(Utterance, "/heard", deadline_s=SILENT_S, alternative_to=seen)
    out = Output(Utterance, "/out")
    patient = Parameter(False, "whether it waits for ever")
    wanted = Parameter("", "what alone counts")

    def __init__(self, *args, **kwargs) -> None:
        super().__init__(*args, **kwargs)
        self.story: list[tuple[float, str]] = []

    def note(self, what: str) -> None:
        self.story.append((round(self.clock.now() / SECOND, 3), what))

    @seen
    def on_seen(self, message: Utterance) -> None:
        self.note(message.text)

    @heard
    def on_heard(self, message: Utterance) -> None:
        self.note(message.text)

    def deadline_s(self, port) -> float:
        return 0.0 if self.patient else port.deadline_s

    def counts(self, port, message) -> bool:
        return not self.wanted or getattr(message, "text", "") == self.wanted

    def on_silence(self, port, since) -> None:
        self.note(f"{port.name} silent since {'ever' if since is None else since / SECOND}")

    def on_return(self, port) -> None:
        self.note(f"{port.name} back")


class Stage:
    """An eye in the inline runner, and what it says of how it is, at each change."""

    def __init__(self, *, hears: bool = True, **parameters: object) -> None:
        graph = Graph("g", (NodeConfig("eye", Eye, parameters),), inputs=frozenset({"/seen", "/heard"}))
        self.runner = InlineRunner(graph)
        self.said: list[Health] = []
        self.said_on_own_topic: list[Message] = []
        if hears:
            self.runner.tap(HEALTH_TOPIC, self._note)
            self.runner.tap(own_health_topic("eye"), lambda _, message: self.said_on_own_topic.append(message))
        self.runner.start()
        node = self.runner.nodes["eye"]
        assert isinstance(node, Eye)
        self.node = node

    def _note(self, topic: str, message: Message) -> None:
        assert isinstance(message, Health)
        self.said.append(message)

    def see(self, *seconds: float, topic: str = "/seen", text: str = "x") -> None:
        for at in seconds:
            self.runner.feed(topic, Utterance(stamp=nanoseconds(at), id="", text=text))

    def stream(self, begin: float, end: float, period: float = 0.1, **how: str) -> None:
        self.see(*(begin + period * number for number in range(round((end - begin) / period))), **how)

    def until(self, seconds: float) -> None:
        self.runner.advance(nanoseconds(seconds))

    @property
    def gaps(self) -> list[tuple[float, str]]:
        return [(at, what) for at, what in self.node.story if what != "x"]

    @property
    def states(self) -> list[tuple[float, str, str]]:
        found: list[tuple[float, str, str]] = []
        for one in self.said:
            if not found or found[-1][1:] != (one.state, one.reason):
                found.append((round(one.stamp / SECOND, 3), one.state, one.reason))
        return found


def test_a_stream_that_stops_is_silent_at_its_deadline_once_and_back_with_the_next_message():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.until(9.0)
    stage.stream(10.0, 11.0)
    assert stage.gaps == [(3.25, "seen silent since 2.9"), (10.0, "seen back")]
    assert stage.node.story[-11][1] == "seen back"


def test_an_input_that_never_had_a_message_is_silent_since_ever():
    stage = Stage()
    stage.until(5.0)
    assert stage.gaps == [(FIRST_S, "seen silent since ever")]
    assert stage.states[-1] == (FIRST_S, "waiting", "no message on /seen yet")


def test_of_two_inputs_the_one_with_the_shorter_deadline_is_silent_first():
    noticed: list[tuple[float, str]] = []

    class TwoEyes(Node):
        slow = Input(Utterance, "/slow", deadline_s=5.0)
        quick = Input(Utterance, "/quick", deadline_s=SILENT_S)

        @slow
        @quick
        def on_either(self, message: Utterance) -> None: ...

        def on_silence(self, port, since) -> None:
            noticed.append((self.clock.now() / SECOND, port.name))

    runner = InlineRunner(Graph("g", (NodeConfig("eyes", TwoEyes),), inputs=frozenset({"/slow", "/quick"})))
    runner.start()
    runner.advance(nanoseconds(9.0))
    assert noticed == [(FIRST_S, "quick"), (5.0, "slow")]


def test_a_slow_stream_is_not_silent_between_its_messages_and_its_end_is_noticed_in_proportion():
    stage = Stage()
    stage.stream(0.0, 6.0, 0.3)
    stage.until(20.0)
    assert stage.gaps == [(6.45, "seen silent since 5.7")]


def test_a_stream_slower_than_the_first_patience_is_known_after_a_few_messages():
    stage = Stage()
    stage.stream(0.0, 30.0, 3.0)
    assert [at for at, what in stage.gaps if "silent" in what] == [2.0, 5.0, 8.0]


def test_an_outage_does_not_make_it_slower_to_notice_the_next_one():
    stage = Stage()
    for begin in (0.0, 40.0, 80.0):
        stage.stream(begin, begin + 3.0)
    stage.until(120.0)
    assert [at for at, what in stage.gaps if "silent" in what] == [3.25, 43.25, 83.25]


def test_a_stream_that_returns_slowly_is_not_silent_between_its_first_messages():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.see(8.0, 9.2, 9.9)
    stage.stream(10.0, 12.0)
    stage.until(20.0)
    assert [at for at, what in stage.gaps if "silent" in what] == [3.25, 12.25]


def test_the_patience_with_a_returned_stream_lasts_for_its_first_three_messages():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.see(8.0, 8.1, 8.2, 9.2, 9.3)
    stage.until(20.0)
    assert [at for at, what in stage.gaps if "silent" in what] == [3.25, 9.65]


def test_a_stream_that_returns_for_a_moment_is_silent_again():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.see(8.0)
    stage.until(20.0)
    assert [at for at, what in stage.gaps if "silent" in what] == [3.25, 8.0 + FIRST_S]


def test_a_substitute_counts_for_its_input():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.stream(3.0, 6.0, topic="/heard")
    stage.until(9.0)
    assert stage.gaps == [(6.25, "heard silent since 5.9")]
    assert stage.said[-1].silent == ("/heard",)


def test_only_counted_messages_end_a_silence():
    stage = Stage(wanted="y")
    stage.stream(0.0, 3.0, text="y")
    stage.stream(3.0, 6.0)
    assert [what for _, what in stage.node.story if "silent" in what] == ["seen silent since 2.9"]


def test_removing_the_deadline_ends_a_silence():
    patient = Stage(patient=True)
    patient.until(9.0)
    assert patient.gaps == []
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.until(5.0)
    stage.node.set_parameter("patient", True)
    stage.see(6.0)
    assert [what for _, what in stage.gaps] == ["seen silent since 2.9", "seen back"]


def test_a_node_publishes_its_health_at_changes_and_periodically():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.until(10.0)
    assert stage.states == [(0.0, "ok", ""), (3.25, "degraded", "no message on /seen since 00:00:02.9")]
    stamps = [one.stamp for one in stage.said]
    gaps = [after - before for before, after in itertools.pairwise(stamps)]
    assert max(gaps) == nanoseconds(COMMON_BEATS * BEAT_S)
    assert {one.outputs for one in stage.said} == {("/out",)}


def test_every_heartbeat_is_on_the_own_topic_of_a_node():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.until(10.0)
    own = stage.said_on_own_topic
    gaps = [after.stamp - before.stamp for before, after in itertools.pairwise(own)]
    assert max(gaps) == nanoseconds(BEAT_S)
    assert all(health in own for health in stage.said)
    assert len(own) > 1.8 * len(stage.said)


def test_own_status_and_silent_inputs_combine_to_the_worse():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.node.report_health("failed", "no glasses")
    stage.until(5.0)
    assert (stage.said[-1].state, stage.said[-1].reason) == (
        "failed",
        "no glasses; no message on /seen since 00:00:02.9",
    )
    stage.node.report_health("ok")
    stage.until(5.0)
    assert stage.said[-1].state == "degraded"


def test_silence_is_noticed_without_subscribers_to_health():
    stage = Stage(hears=False)
    stage.stream(0.0, 3.0)
    stage.until(5.0)
    assert len(stage.gaps) == 1


def test_a_killed_node_publishes_no_health():
    stage = Stage()
    stage.stream(0.0, 3.0)
    stage.runner.kill("eye")
    stage.until(9.0)
    assert stage.said[-1].stamp < 3 * SECOND
    assert stage.gaps == []
    stage.runner.restart("eye")
    stage.until(9.5)
    assert stage.said[-1].state == "ok"


def test_the_end_of_a_recording_is_reported():
    stage = Stage()
    stage.runner.run([("/seen", Utterance(stamp=SECOND, id="", text="x"))], tail_s=0.1)
    over = [one for one in stage.said if one.node == "bag"]
    assert [(one.state, one.outputs) for one in over] == [("ended", ("/seen",))]


# Where a silence begins


def health(node: str, output: str, *silent: str) -> Health:
    return Health(stamp=0, node=node, state="degraded" if silent else "ok", silent=silent, outputs=(output,))


class Chain:
    """The healths of camera, converter and detector; what each has heard of the one before."""

    def __init__(self) -> None:
        self.healths = HealthReports()
        self.say(0.0, camera=(), converter=(), detector=())

    def say(self, at: float, **silent: tuple[str, ...]) -> None:
        for node, topics in silent.items():
            self.healths.note(health(node, f"/{node}/out", *topics), nanoseconds(at))

    def blame(self, at: float) -> tuple[str, str]:
        found = self.healths.blame("/detector/out", nanoseconds(at), source="me")
        return found.who, found.source


@pytest.mark.parametrize(
    ("silent", "expected"),
    [
        ({}, ("detector", "me")),
        ({"detector": ("/converter/out",)}, ("converter", "detector")),
        ({"detector": ("/converter/out",), "converter": ("/camera/out",)}, ("camera", "converter")),
        ({"detector": ("/elsewhere",)}, ("/elsewhere", "detector")),
        ({"detector": ("/converter/out",), "converter": ("/detector/out",)}, ("detector", "converter")),
    ],
)
def test_a_silence_is_followed_to_where_it_begins(silent, expected):
    chain = Chain()
    chain.say(0.3, **{"camera": (), "converter": (), "detector": ()} | silent)
    assert chain.blame(0.4) == expected


def test_a_node_that_vanishes_alone_is_to_blame_itself():
    chain = Chain()
    chain.say(5.0, camera=(), detector=("/converter/out",))
    assert chain.blame(5.1) == ("converter", "detector")


def test_nodes_that_vanish_together_were_beyond_a_link():
    chain = Chain()
    chain.say(5.0, detector=("/converter/out",))
    assert chain.blame(5.1) == (LINK, "detector")


def test_a_topic_without_publishers_is_the_fault_source():
    assert HealthReports().blame("/seen", 0, source="me")[:2] == ("/seen", "me")


def test_a_recording_is_over_until_pictures_come_again_for_a_while():
    healths = HealthReports()
    healths.note(ended("bag", ("/seen",), 0), 0)
    healths.goes_on(SECOND)
    assert healths.over
    healths.goes_on(3 * SECOND)
    assert not healths.over
