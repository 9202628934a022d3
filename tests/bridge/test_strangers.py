"""Attacks of an intruder in the same ROS domain on nodes with keys."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from socialbot.agents.waldo.nodes import Listener
from socialbot.bridge import security, stream_watch
from socialbot.bridge import transport as wires
from socialbot.bridge.detached_seals import seal_topic
from socialbot.bridge.diagnostics import DIAGNOSTICS_TOPIC, DiagnosticsSubscriber
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.graph_observer import observe_graph
from socialbot.bridge.keys import Keys, load_keys, new_key
from socialbot.bridge.qos import QUEUE_DEPTH, subscription_qos
from socialbot.bridge.security import BEACON, SCHEMA, Freshness, Stream
from socialbot.bridge.topics import list_topics, observer_node, publish_once
from socialbot.bridge.wait_sets import OneThreadExecutor
from socialbot.core.clock import SECOND
from socialbot.core.messages import HeadCommand, Structured, Utterance
from socialbot.graph.files import load_graph
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Context, Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output
from tests.bridge.hosting import node_hosts
from tests.system.running import eventually

pytestmark = pytest.mark.ros

TOPIC = "/speech/say"
BATCH = 50
"""Fewer than what waits for a node at most, so that no message is lost before it can be refused."""


class Mouth(Node):
    """Record the received utterances."""

    say = Input(Utterance, TOPIC)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self.said: list[str] = []

    @say
    def on_say(self, message: Utterance) -> None:
        self.said.append(message.text)


class Teller(Node):
    """Has a latched state."""

    state = Output(HeadCommand, "/state", Delivery.LATCHED)

    def start(self) -> None:
        self.tell(0.0)

    def tell(self, pan_rad: float) -> None:
        self.state.publish(HeadCommand(stamp=1, mode="look", pan_rad=pan_rad))


class Follower(Node):
    """Record the received states."""

    state = Input(HeadCommand, "/state", Delivery.LATCHED)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self.seen: list[float] = []

    @state
    def on_state(self, message: HeadCommand) -> None:
        self.seen.append(message.pan_rad)


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Keys:
    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv(wires.KEYS_VARIABLE, str(tmp_path / "keys"))
    return load_keys(tmp_path / "keys")


@contextmanager
def hosted(*kinds: type[Node], whole: tuple[type[Node], ...] = ()) -> Iterator[list[Any]]:
    """Hosts of nodes of these ``kinds``, in a graph of these or of the ``whole``."""
    inputs = frozenset(port.topic for kind in kinds for port in kind.inputs().values())
    graph = Graph("g", tuple(NodeConfig(kind.__name__.lower(), kind) for kind in whole or kinds), inputs=inputs)
    with node_hosts(graph) as host:
        yield [host(kind.__name__.lower()) for kind in kinds]


def utterance(text: str) -> str:
    return msgspec.json.encode(Utterance(stamp=1, id="u", text=text)).decode()


class Stranger:
    """Publish forged messages on the topic and record those of others."""

    def __init__(self, ros: Any, topic: str = TOPIC, delivery: Delivery = Delivery.EVERY) -> None:
        from std_msgs.msg import String

        from socialbot.bridge.qos import publisher_qos

        self._string = String
        self.heard: list[str] = []
        self.publisher = ros.create_publisher(String, topic, publisher_qos(delivery))
        ros.create_subscription(String, topic, lambda message: self.heard.append(message.data), publisher_qos(delivery))

    def say(self, text: str) -> None:
        self.publisher.publish(self._string(data=text))


def words(stranger: Stranger) -> list[str]:
    """Sealed messages that a stranger has recorded, without beacons."""
    return [text for text in stranger.heard if BEACON not in text]


def attacks(genuine: list[str], keys: Keys) -> dict[str, Callable[[int], str]]:
    """Return forged messages by the expected reason of their refusal."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    realm = f"ROS domain {int(wires.os.environ['ROS_DOMAIN_ID'])}"
    own = Keys("robot", Ed25519PrivateKey.generate(), {})
    nobody = Keys("nobody", own.private, {})
    an_hour_ago = Stream(keys, realm, TOPIC, now=lambda: time.time_ns() - 3600 * 10**9)
    an_hour_ahead = Stream(keys, realm, TOPIC, now=lambda: time.time_ns() + 3600 * 10**9)
    elsewhere, other_realm = Stream(keys, realm, "/speech/other"), Stream(keys, "ROS domain 99", TOPIC)
    pretended, unknown = Stream(own, realm, TOPIC), Stream(nobody, realm, TOPIC)
    some = [msgspec.json.decode(text) for text in genuine]

    def altered(number: int) -> str:
        parts = dict(some[number % len(some)])
        if number % 2:
            parts["payload"] = utterance("altered")
        else:
            parts["number"], parts["time"] = parts["number"] + number + 1, time.time_ns()
        return msgspec.json.encode(parts).decode()

    return {
        "unsealed": lambda number: utterance("unsealed") if number % 2 else f"plain {number}",
        "unreadable": lambda number: f'{{"schema":"{SCHEMA}","sender":{number}}}',
        "unknown sender": lambda number: unknown.seal(utterance("nobody")),
        "forged": lambda number: (
            altered(number),
            pretended.seal(utterance("forged")),
            other_realm.seal(utterance("other")),
        )[number % 3],
        "moved": lambda number: elsewhere.seal(utterance("moved")),
        "late": lambda number: an_hour_ago.seal(utterance("late")),
        "early": lambda number: an_hour_ahead.seal(utterance("early")),
        "replayed": lambda number: genuine[number % len(genuine)],
    }


@pytest.mark.parametrize("count", [400, pytest.param(10_000, marks=pytest.mark.slow)])
def test_refuses_and_counts_all_messages_without_a_valid_seal(count, keys):
    with (
        hosted(Mouth) as (mouth,),
        observe_graph({}, lambda *_: None, lambda *_: None) as watch,
        observer_node() as sender,
    ):
        stranger = Stranger(watch.ros)
        for number in range(3):
            word = Utterance(stamp=1, id="u", text=f"genuine {number}")
            publish_once(sender, TOPIC, word, timeout_s=5.0)
        assert eventually(lambda: len(stranger.heard) == 3 and len(mouth.node.said) == 3)
        kinds = attacks(list(stranger.heard), keys)
        assert eventually(lambda: stranger.publisher.get_subscription_count() == 2)
        refusals = mouth.statistics.refusals
        reasons = list(kinds)
        for begin in range(0, count, BATCH):
            for number in range(begin, begin + BATCH):
                reason = reasons[number % len(reasons)]
                stranger.say(kinds[reason](number // len(reasons)))
            assert eventually(lambda sofar=begin + BATCH: refusals.total() == sofar), refusals
        assert mouth.node.said == [f"genuine {number}" for number in range(3)]
        assert refusals == Counter(dict.fromkeys(reasons, count // len(reasons)))


def test_a_restarted_node_refuses_replayed_commands(keys):
    with observer_node() as sender, observe_graph({}, lambda *_: None, lambda *_: None) as watch:
        stranger = Stranger(watch.ros)
        with hosted(Mouth) as (mouth,):
            publish_once(sender, TOPIC, Utterance(stamp=1, id="u", text="once"), timeout_s=5.0)
            assert eventually(lambda: mouth.node.said == ["once"] and len(stranger.heard) == 1)
        with hosted(Mouth) as (mouth,):
            assert eventually(lambda: stranger.publisher.get_subscription_count() == 2)
            stranger.say(stranger.heard[0])
            assert eventually(lambda: mouth.statistics.refusals == {"late": 1})
            assert mouth.node.said == []


def test_a_restarted_node_refuses_replayed_commands_after_its_clock_was_set_back(
    keys: Keys, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock of the machine reaches the time of a command once more: a computer without a battery for it."""
    monkeypatch.setenv(wires.WINDOW_VARIABLE, "1.0")
    with observer_node() as sender, observe_graph({}, lambda *_: None, lambda *_: None) as watch:
        stranger = Stranger(watch.ros)
        with hosted(Mouth) as (mouth,):
            publish_once(sender, TOPIC, Utterance(stamp=1, id="u", text="once"), timeout_s=5.0)
            time.sleep(3.0)
            publish_once(sender, TOPIC, Utterance(stamp=1, id="v", text="later"), timeout_s=5.0)
            assert eventually(lambda: mouth.node.said == ["once", "later"] and len(words(stranger)) == 2)
        first = msgspec.json.decode(words(stranger)[0])["time"]
        back = time.time_ns() - first + SECOND
        for each in (Freshness, Stream):
            monkeypatch.setattr(security, each.__name__, partial(each, now=lambda: time.time_ns() - back))
        with hosted(Mouth) as (mouth,):
            assert eventually(lambda: stranger.publisher.get_subscription_count() == 2)
            stranger.say(words(stranger)[0])
            time.sleep(0.5)
            publish_once(sender, TOPIC, Utterance(stamp=1, id="w", text="new"), timeout_s=5.0)
            assert eventually(lambda: bool(mouth.node.said))
            assert mouth.node.said == ["new"]


def test_a_late_subscriber_receives_the_last_latched_message_once(keys, monkeypatch):
    monkeypatch.setenv(wires.WINDOW_VARIABLE, "0.4")
    with hosted(Teller) as (teller,), observe_graph({}, lambda *_: None, lambda *_: None) as watch:
        stranger = Stranger(watch.ros, "/state", Delivery.LATCHED)
        assert eventually(lambda: len(stranger.heard) >= 1)
        old = stranger.heard[0]
        teller.node.context.call_soon(lambda: teller.node.tell(1.0))
        sent = len(stranger.heard)
        assert eventually(lambda: len(stranger.heard) >= sent + 6)  # longer than the window: only renewals are valid
        with hosted(Follower, whole=(Teller, Follower)) as (follower,):
            assert eventually(lambda: follower.node.seen == [1.0])
            heard = len(stranger.heard)
            assert eventually(lambda: len(stranger.heard) >= heard + 3)
            stranger.say(old)
            assert eventually(lambda: follower.statistics.refusals.total() == 1)
            assert follower.node.seen == [1.0]


def test_keys_disable_parameter_services(keys):
    with hosted(Listener) as (host,):
        names = [name for name, _ in host.ros_node.get_service_names_and_types_by_node(host.name, "/")]
        assert [name for name in names if "parameter" in name] == []


def test_a_graph_with_keys_has_no_other_endpoints(
    keys: Keys, monkeypatch: pytest.MonkeyPatch, other_domain: int
) -> None:
    """Each topic of a running graph is sealed, or one of those that docs/security.md calls harmless."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(other_domain))  # in that of other tests are their endpoints
    graph = load_graph("waldo")
    unread = {"/rosout", "/parameter_events", *(f"/{config.name}/transition_event" for config in graph.nodes)}
    with node_hosts(graph, sim_time=True) as host, observer_node() as ros:
        hosts = [host(config.name) for config in graph.nodes]
        names = {host.name for host in hosts}
        assert eventually(lambda: names <= set(ros.get_node_names()))
        assert eventually(lambda: all(host.ros_node.get_name() and host.active_thread for host in hosts))
        structured = {topic for topic, kind in graph.topics().items() if issubclass(kind, Structured)}
        structured |= {"/clock_kept", "/clock_round", HEALTH_TOPIC}
        standard = set(graph.topics()) - structured | {"/clock"}
        expected = structured | standard | {seal_topic(topic) for topic in standard} | unread | {DIAGNOSTICS_TOPIC}

        def topics() -> set[str]:
            return {topic.name for topic in list_topics(ros)}

        assert eventually(lambda: topics() <= expected), sorted(topics() - expected)
        assert [topic.name for topic in list_topics(ros) if topic.name in unread and topic.subscribers] == []

        def unsealed() -> set[str]:
            found = topics()
            return {topic for topic in found & standard if seal_topic(topic) not in found}

        assert eventually(lambda: not unsealed()), unsealed()  # the topic of its seals is found later
        assert eventually(
            lambda: all(name.endswith("/get_type_description") for name, _ in ros.get_service_names_and_types())
        )


@pytest.mark.parametrize("delivery", [Delivery.EVERY, Delivery.NEWEST])
def test_invalid_messages_push_no_other_out_of_the_queue(delivery: Delivery, keys: Keys) -> None:
    """A process that does not get to take messages for a moment finds the valid one among hundreds of others."""
    heard: list[str] = []
    with spinning_node("sender") as outside, observer_node() as ros:
        transport = wires.open_transport()
        sender = transport.advertise(outside, TOPIC, Utterance, delivery=delivery)
        stranger = Stranger(outside, delivery=delivery)
        kept = transport.subscribe(
            ros, TOPIC, Utterance, lambda one: heard.append(one.text), qos=subscription_qos(delivery)
        )
        publishers = (sender.publisher, stranger.publisher)
        assert eventually(lambda: all(each.get_subscription_count() >= 2 for each in publishers))
        sender.publish(Utterance(stamp=1, id="1", text="valid"))
        for number in range(500):
            stranger.say(f"invalid {number}")
            time.sleep(0.0005)
        executor = OneThreadExecutor(context=ros.context)
        executor.add_node(ros)

        def all_arrived() -> bool:
            for _ in range(100):
                executor.spin_once(timeout_sec=0.0)
            return heard == ["valid"] and kept.refused > 2 * QUEUE_DEPTH[Delivery.EVERY]  # the stranger may lose some

        try:
            assert eventually(all_arrived, 10.0), (heard, kept.refused)
        finally:
            executor.shutdown()


@pytest.mark.slow
def test_an_unsealed_publisher_that_stays_is_seldom_a_reason_to_subscribe_again(
    keys: Keys, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does it cost a message of others."""
    monkeypatch.setenv(wires.WINDOW_VARIABLE, "1.0")
    for name, seconds in (("SILENT_S", 1.5), ("MAX_PAUSE_S", 1.5), ("FOREIGN_PAUSE_S", 6.0)):
        monkeypatch.setattr(stream_watch, name, seconds)
    with hosted(Mouth) as (mouth,), spinning_node("outside") as ros:
        sender = wires.open_transport().advertise(ros, TOPIC, Utterance)
        ros.create_publisher(wires.message_class(wires.STRING), TOPIC, 10)
        said: list[str] = []
        times: list[float] = []

        def heard() -> bool:
            said.append(str(len(said)))
            sender.publish(Utterance(stamp=time.time_ns(), id=said[-1], text=said[-1]))
            times.extend([time.monotonic()] * (mouth.statistics.resubscribed[TOPIC] - len(times)))
            return len(times) == 4

        assert eventually(heard)
        pauses = [later - before for before, later in itertools.pairwise(times)]
        assert [pause >= least for pause, least in zip(pauses, (2.5, 5.5, 5.5), strict=True)] == 3 * [True], pauses
        assert eventually(lambda: mouth.node.said[-1:] == said[-1:])
        assert mouth.node.said == said[said.index(mouth.node.said[0]) :]


@pytest.mark.slow
def test_a_node_that_misses_messages_subscribes_again_and_says_so(keys: Keys, monkeypatch: pytest.MonkeyPatch) -> None:
    """A publisher without beacons looks like one whose messages do not arrive. Others are heard as before."""
    monkeypatch.setenv(wires.WINDOW_VARIABLE, "1.0")
    for name in ("SILENT_S", "MAX_PAUSE_S"):
        monkeypatch.setattr(stream_watch, name, 1.5)
    statuses: list[dict[str, str]] = []

    def note(name: str, values: dict[str, str]) -> None:
        if name == "mouth" and values["resubscribed"]:
            statuses.append(values)

    with hosted(Mouth) as (mouth,), spinning_node("outside") as ros:
        DiagnosticsSubscriber(ros, note)
        sender = wires.open_transport().advertise(ros, TOPIC, Utterance)
        silent = ros.create_publisher(wires.message_class(wires.STRING), TOPIC, 10)
        said: list[str] = []

        def heard() -> bool:
            said.append(str(len(said)))
            sender.publish(Utterance(stamp=time.time_ns(), id=said[-1], text=said[-1]))
            return len(statuses) > 0 and mouth.statistics.resubscribed[TOPIC] > 1

        assert eventually(heard)
        assert eventually(lambda: mouth.node.said[-1:] == said[-1:])
        assert len(mouth.node.said) == len(set(mouth.node.said))
        first = said.index(mouth.node.said[0])  # DDS had not connected both before
        assert mouth.node.said == said[first:]
        assert statuses[0]["resubscribed"].endswith(TOPIC)
        assert mouth.statistics.refused == 0
        ros.destroy_publisher(silent)
        timers = len(list(mouth.ros_node.timers))
        mouth.clean_up()
        mouth.configure()
        assert len(list(mouth.ros_node.timers)) == timers
