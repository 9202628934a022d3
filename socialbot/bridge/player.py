"""Play a bag into a running ROS graph: the recorded messages, and /clock.

A paced replay stops the clock after each image until the graph has answered it, so a slow machine only makes it
longer. `WorldPlayer` replays bags to graphs without image inputs.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from socialbot.bags.cameras import depth_first
from socialbot.bags.codec import ROS_TYPES, STRING, decode, message_type_of, raw_stamp, with_stamp
from socialbot.bags.playback import STEP_S, PlaybackResult, WorldScript, play
from socialbot.bags.reader import IMAGE_TYPES, MEASURED, SENSOR_TYPES, Bag, RosbagsTypes
from socialbot.bags.sound import AUDIO_TYPES
from socialbot.bridge.diagnostics import Connection, sender_connections, subscription_connection
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.graph_observer import await_graph, not_connected
from socialbot.bridge.sim_clock import CLOCK_TOPIC, SimClock
from socialbot.bridge.transport import (
    Sender,
    Subscription,
    message_class,
    open_transport,
)
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import BagError, InstallationError, MessageError
from socialbot.core.messages import AudioData, CameraInfo, Health, Message, Structured, Transforms, VoiceActivity
from socialbot.core.process import Ending
from socialbot.graph.health import HEALTH_TOPIC, ended
from socialbot.graph.node import Graph
from socialbot.graph.ports import TOPIC_NAME, Delivery

log = logging.getLogger("socialbot.player")

TICK_S = 0.02  # period of /clock between messages
MAX_CATCH_UP = 3.0  # maximum speed of a delayed replay; timers would fire late at a higher one
ANSWER_TIMEOUT_S = 2.0
FIRST_ANSWER_TIMEOUT_S = 10.0
POLL_S = 0.2  # between two looks for a stop
SLOWER = 4.0  # An answer may take so many times as long as the slowest one before,
LONGEST_TIMEOUT_S = 60.0  # but no longer than this.
SOUND_TIMEOUT_S = 15.0
SHORT_ANSWER_TIMEOUT_S = 0.2  # timeout after three unanswered images in a row
GRAPH_TIMEOUT_S = 30.0


@dataclass(frozen=True)
class PlaybackOptions:
    """Options of a playback.

    Attributes:
        rate: The speed; 1.0 is real time.
        tail_s: The time for which /clock continues after the last image.
        await_graph: The graph to wait for before the start.
        paced: Whether to wait for the answer to each image.
    """

    rate: float = 1.0
    tail_s: float = 3.0
    await_graph: Graph | None = None
    paced: bool = False

    @property
    def paced_by(self) -> str:
        """Topic of the answers to images in a paced playback."""
        return self.await_graph.paced_by if self.paced and self.await_graph is not None else ""


class Answers:
    """Progress of the graph with the played messages, as a growing number: a stamp, or a count.

    The limit of time grows with the slowest answer, also with one that came too late: a slow machine shall not change
    what the graph does.
    """

    def __init__(self, timeout_s: float, ending: Ending) -> None:
        self.reached = 0
        self._ending = ending
        self._changed = threading.Condition()
        self._timeout_s = timeout_s
        self._missed = 0
        self._asked: deque[tuple[int, float]] = deque(maxlen=100)
        """Messages without an answer, and when they were played (s)."""

    def note(self, reached: int) -> None:
        with self._changed:
            self.reached = max(self.reached, reached)
            if answered := [each for each in self._asked if each[0] <= reached]:
                took_s = time.monotonic() - answered[-1][1]  # the graph has skipped those before
                self._timeout_s = max(self._timeout_s, min(SLOWER * took_s, LONGEST_TIMEOUT_S))
                self._asked = deque((each for each in self._asked if each[0] > reached), self._asked.maxlen)
                self._missed = 0
            self._changed.notify()

    def wait(self, until: int) -> bool:
        """Wait until the graph has answered as far as ``until``, or for a stop; return whether it has in time."""
        with self._changed:
            asked_s = time.monotonic()
            if self.reached < until:
                self._asked.append((until, asked_s))
            while self.reached < until and not self._ending.asked:
                if (rest_s := asked_s + self._limit_s() - time.monotonic()) <= 0:
                    break
                self._changed.wait(min(rest_s, POLL_S))
            self._missed = 0 if self.reached >= until else self._missed + 1
            return self.reached >= until

    def _limit_s(self) -> float:
        if self._missed >= 3:
            return SHORT_ANSWER_TIMEOUT_S
        return self._timeout_s if self.reached or self._missed else max(self._timeout_s, FIRST_ANSWER_TIMEOUT_S)


class BagPlayer:
    """Player of ``topics`` (bag topic to graph topic) of ``bag`` through the rclpy node ``ros``."""

    def __init__(self, ros: Any, bag: Bag, topics: Mapping[str, str], playing: PlaybackOptions, ending: Ending) -> None:
        from rosgraph_msgs.msg import Clock

        self._bag = bag
        self._playing = playing
        self._ending = ending
        graph = playing.await_graph
        self._transport = open_transport(form="json" if graph is None else graph.wire)
        self._clock_type = Clock
        self._clock = open_transport().advertise_class(ros, CLOCK_TOPIC, Clock, standard=True)
        self._senders: dict[str, Sender] = {}
        self._encoded: set[str] = set()
        kinds = {} if graph is None else graph.topics()
        self._topics = topics = _playable(bag, topics, graph)
        sensors = (
            {} if graph is None else {name: topic for name, topic in topics.items() if _is(bag, name, SENSOR_TYPES)}
        )
        self._stamps = {topic: bag.stamps(name) for name, topic in sensors.items()}
        self._depth = {topic for topic in topics.values() if kinds.get(topic) in MEASURED}
        self._images = {topic for name, topic in topics.items() if _is(bag, name, IMAGE_TYPES)} - self._depth
        self._types = RosbagsTypes()
        for name, topic in topics.items():
            recorded = bag.topic(name).type
            wanted = self._transport.message_class(kinds[topic]) if topic in kinds else message_class(recorded)
            structured = wanted is message_class(STRING) and issubclass(kinds.get(topic, Structured), Structured)
            latched = graph is None and bag.is_latched(name)
            delivery = Delivery.LATCHED if latched else _delivery(topic, recorded)
            self._senders[topic] = self._transport.advertise_class(
                ros, topic, wanted, delivery, standard=not structured
            )
            if wanted is not message_class(recorded) or (self._transport.sealed and structured):
                self._encoded.add(topic)
        self._health = self._transport.advertise(ros, HEALTH_TOPIC, Health)
        self._answers = Answers(ANSWER_TIMEOUT_S, ending)
        self._subscriptions: dict[str, Subscription[Any]] = {}
        if topic := playing.paced_by:
            self._subscriptions[topic] = self._transport.subscribe(
                ros, topic, kinds[topic], lambda answer: self._answers.note(answer.stamp)
            )
        self._sounds = {topic for topic in topics.values() if kinds.get(topic) is AudioData}
        self._hearing = Answers(SOUND_TIMEOUT_S, ending)
        self._sounds_played = 0
        activity = next((topic for topic, kind in kinds.items() if kind is VoiceActivity), "")
        self._awaits_hearing = bool(playing.paced and self._sounds and activity)
        if self._awaits_hearing:
            self._subscriptions[activity] = self._transport.subscribe(
                ros, activity, VoiceActivity, lambda _: self._hearing.note(self._hearing.reached + 1)
            )
        self._now = bag.start
        self._begun = 0.0

    def connections(self, graph: Graph) -> list[Connection]:
        return _connections(graph, self._senders, self._subscriptions)

    def play(self) -> PlaybackResult:
        """Play until the end of the tail, or a stop request."""
        played = PlaybackResult(skipped=self._bag.skipped)
        self._begun = time.monotonic()
        for topic, at, ros_type, cdr in self._synchronised():
            if topic not in self._depth:
                self._pass_time(at)
            if self._ending.asked:
                return played
            image = topic in self._images
            self._publish(topic, ros_type, cdr, at)
            played.sent += image or not self._images
            if image and self._playing.paced_by and not self._answers.wait(raw_stamp(cdr) or at):
                played.unanswered += 1
            if topic in self._sounds and self._awaits_hearing and not self._is_heard():
                played.unanswered += 1
        self._health.publish(ended("bag_player", tuple(self._topics.values()), self._now))
        self._pass_time(self._now + nanoseconds(self._playing.tail_s if self._images else 0.0))
        return played

    def _is_heard(self) -> bool:
        """Wait for the answer to one more sound; recognition of speech takes a while."""
        self._sounds_played += 1
        heard = self._hearing.wait(self._sounds_played)
        if not heard:
            self._sounds_played = self._hearing.reached
        return heard

    def _synchronised(self) -> Iterator[tuple[str, int, str, bytes]]:
        """The messages with the stamps and in the order that `Bag.messages` gives them, for equal input in all runners.

        Depth comes before the picture of its stamp.
        """

        def stamped() -> Iterator[tuple[str, int, str, bytes]]:
            for topic, at, ros_type, cdr in self._bag.raw_messages(self._topics):
                if topic in self._stamps:
                    stamp = self._stamps[topic].next(raw_stamp(cdr), at)
                    cdr = cdr if stamp == raw_stamp(cdr) else with_stamp(cdr, stamp)
                yield topic, at, ros_type, cdr

        def topic_and_stamp(item: tuple[str, int, str, bytes]) -> tuple[str, int]:
            topic, at, _, cdr = item
            return topic, raw_stamp(cdr) if topic in self._stamps else at

        if not self._depth:
            return stamped()
        return depth_first(stamped(), topic_and_stamp, self._depth, self._images)

    def _publish(self, topic: str, name: str, cdr: bytes, at: int) -> None:
        """Publish the recorded bytes. Encode messages again that need a seal or another form."""
        if topic not in self._encoded:
            self._senders[topic].publish_encoded(bytes(cdr))
        elif self._transport.sealed and name == STRING:
            from rclpy.serialization import deserialize_message

            self._senders[topic].forward(deserialize_message(cdr, message_class(STRING)))
        else:
            try:
                message = decode(message_type_of(name), self._deserialize(cdr, name), stamp=at)
            except MessageError as error:
                log.warning("%s: message skipped: %s", topic, error)
                return
            self._senders[topic].publish(message)

    def _deserialize(self, cdr: bytes, name: str) -> Any:
        if name not in AUDIO_TYPES:
            return self._types.deserialize(cdr, name)
        from rclpy.serialization import deserialize_message

        return deserialize_message(cdr, message_class(name))

    def _pass_time(self, until: int) -> None:
        """Publish /clock up to ``until`` in real time, or faster after a delay."""
        while not self._ending.asked:
            step = min(until - self._now, nanoseconds(TICK_S * self._playing.rate))
            self._now += step
            due = self._begun + (self._now - self._bag.start) / SECOND / self._playing.rate
            least = step / SECOND / self._playing.rate / MAX_CATCH_UP
            time.sleep(max(0.0, least, due - time.monotonic()))
            message = self._clock_type()
            message.clock.sec, message.clock.nanosec = divmod(self._now, SECOND)
            self._clock.publish_encoded(message)
            if self._now >= until:
                return


class WorldPlayer:
    """Player of the world side of ``bag`` for ``graph``. ``topics`` maps bag topics to graph topics."""

    def __init__(
        self, ros: Any, bag: Bag, topics: Mapping[str, str], graph: Graph, rate: float, ending: Ending
    ) -> None:
        self._rate, self._ending = rate, ending
        self._script = WorldScript(bag, topics, graph)
        self._skipped = bag.skipped
        own = open_transport(form=graph.wire)
        self._senders = {topic: own.advertise(ros, topic, graph.topics()[topic]) for topic in topics.values()}
        self._subscriptions = {
            topic: own.subscribe(ros, topic, kind, functools.partial(self._script.give_command, topic))
            for topic, kind in self._script.commands.items()
        }
        names = [config.name for config in graph.nodes]
        self._clock = SimClock(
            ros, names, start=bag.start, senders=self._senders.values(), subscriptions=self._subscriptions.values()
        )
        self._start, self._begun = bag.start, 0.0

    def connections(self, graph: Graph) -> list[Connection]:
        return _connections(graph, self._senders, self._subscriptions)

    def play(self) -> PlaybackResult:
        """Play until the last message, or a stop request."""
        self._begun = time.monotonic()
        play(self._script, self, self._ending)
        return PlaybackResult(self._script.sent, self._script.unanswered, self._skipped)

    @property
    def now(self) -> int:
        """Time of the graph (ns)."""
        return self._clock.now

    def advance(self, until: int) -> None:
        """Advance the clock at the given rate at most."""
        self._clock.advance(0.0)
        while self._clock.now < until and not self._ending.asked:
            self._clock.advance(min(nanoseconds(STEP_S), until - self._clock.now) / SECOND)
        time.sleep(max(0.0, self._begun + (self._clock.now - self._start) / SECOND / self._rate - time.monotonic()))

    def send(self, topic: str, message: Message) -> None:
        """Publish a message to the agents."""
        self._senders[topic].publish(message)


def play_bag(
    bag: Bag, topics: Mapping[str, str], playing: PlaybackOptions, *, parent: int | None = None
) -> PlaybackResult:
    """Play ``bag`` in this process. Raises NodeError when the awaited graph is incomplete at the timeout."""
    with Ending(parent).on_signals() as ending, spinning_node("bag_player") as ros:
        graph = playing.await_graph
        images = any(bag.topic(name).type in IMAGE_TYPES for name in topics)
        if graph is None or images or not playing.paced:
            player = BagPlayer(ros, bag, topics, playing, ending)
        else:
            player = WorldPlayer(ros, bag, topics, graph, playing.rate, ending)
        if graph is not None:
            own = player.connections(graph)
            missing = await_graph(ros, graph, own, timeout_s=GRAPH_TIMEOUT_S, ended=lambda: ending.asked)
            if missing and not ending.asked:
                raise not_connected(missing, GRAPH_TIMEOUT_S)
        return player.play()


def _connections(
    graph: Graph, senders: Mapping[str, Sender], subscriptions: Mapping[str, Subscription[Any]]
) -> list[Connection]:
    return [
        *(each for topic, one in senders.items() for each in sender_connections(graph, topic, one)),
        *(subscription_connection(graph, topic, one.endpoint) for topic, one in subscriptions.items()),
    ]


def _delivery(topic: str, ros_type: str) -> Delivery:
    if ros_type == ROS_TYPES[CameraInfo] or topic == "/tf_static":
        return Delivery.LATCHED
    return Delivery.NEWEST if ros_type in SENSOR_TYPES else Delivery.EVERY


def _is(bag: Bag, name: str, types: tuple[str, ...]) -> bool:
    return bag.topic(name).type in types


def _playable(bag: Bag, topics: Mapping[str, str], graph: Graph | None) -> Mapping[str, str]:
    """Leave out topics that ROS cannot have here, with a warning each; with a graph only transforms.

    Their package is not among the ROS wheels of socialbot, and graphs do without them. Raises BagError if no topic is
    left.
    """
    left: dict[str, str] = {}
    for name, topic in topics.items():
        if graph is None and not TOPIC_NAME.fullmatch(f"/{topic.lstrip('/')}"):
            log.warning("%s is not played: it is no name of a topic of ROS", name)
            continue
        try:
            if graph is None or _is(bag, name, (ROS_TYPES[Transforms],)):
                message_class(bag.topic(name).type)
            left[name] = topic
        except InstallationError as error:
            log.log(logging.WARNING if graph is None else logging.INFO, "%s is not played: %s", name, error.what)
    if topics and not left:
        remedy = "install the ROS types of its topics, or record others"
        raise BagError("no topic can be played", where=str(bag.path), remedy=remedy)
    return left
