"""Play a bag to a graph: map its topics to inputs, and replay recorded messages in response to commands."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import msgspec

from socialbot.bags.codec import carries, decodable_types
from socialbot.bags.reader import MEASURED, Bag, Skipped
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import GraphError
from socialbot.core.messages import CameraInfo, CompressedImage, Image, Message, TraceRecord
from socialbot.core.process import Ending
from socialbot.graph.health import health_topics
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph
from socialbot.graph.ports import Delivery

log = logging.getLogger("socialbot.player")

COMMAND_TIMEOUT_S = 2.0
"""Simulated time (s) to wait for a command."""

STEP_S = 1 / 30
"""Clock step (s) while waiting."""

SLACK_S = 0.2
"""Time (s) after a command that may contain its cause: the clocks of processes differ by a step."""


def feeding(bag: Bag, graph: Graph, image_topic: str | None) -> dict[str, str]:
    """Map input topics of ``graph`` (without its sources) from ``bag``: bag topic to graph topic.

    The image topic and its CameraInfo map to the image inputs, depth and point clouds to the inputs that take them.
    Other inputs need the same topic name and type.

    Raises:
        BagError: The image topic is missing or ambiguous.
        GraphError: No topic fits.
    """
    inputs = _inputs(graph)
    feeds: dict[str, str] = {}
    if takes_images(graph):
        feeds = _image_feeds(bag, graph, inputs, image_topic)
        chosen, *others = feeds
        feeds |= _depth_feeds(bag, chosen, inputs)
        for image in others:
            feeds |= {name: name for name, kind in bag.depth_sensors_for(image).items() if inputs.get(name) is kind}
        info = bag.camera_info_topic_for(chosen)
        infos = [topic for topic, kind in inputs.items() if kind is CameraInfo]
        if info is not None and infos:
            feeds[info.name] = info.name if info.name in infos else infos[0]
    for topic in bag.topics:
        kind = inputs.get(topic.name)
        if kind is None or kind in (*MEASURED, Image, CompressedImage):
            continue
        if topic.name not in feeds.values() and carries(topic.type, kind):
            feeds[topic.name] = topic.name
    if not feeds:
        raise GraphError(
            f"no topic of {bag.path} fits its inputs",
            where=graph.name,
            remedy=f"the inputs are {', '.join(sorted(inputs)) or 'empty'}; "
            f"the bag has {', '.join(topic.name for topic in bag.topics)}",
        )
    return feeds


def _image_feeds(
    bag: Bag, graph: Graph, inputs: Mapping[str, type[Message]], image_topic: str | None
) -> dict[str, str]:
    """Map the chosen image topic to an input, then those of other cameras to inputs of their names.

    A node gets the images of one topic: a bag often has them both raw and compressed.

    Raises:
        BagError: The image topic is missing or ambiguous.
        GraphError: No input takes its type.
    """
    types = decodable_types()
    chosen = bag.choose_image_topic(image_topic)
    fitting = [topic for topic, kind in inputs.items() if kind is types[chosen.type]]
    if not fitting:
        remedy = "add an image_converter to the graph"
        raise GraphError(f"no input takes {chosen.type}", where=graph.name, remedy=remedy)
    feeds = {chosen.name: chosen.name if chosen.name in fitting else fitting[0]}
    graph.check_alternatives(feeds[chosen.name])
    readers = {
        topic: {config.name for config in graph.nodes if topic in (each for each, _ in config.subscriptions)}
        for topic in inputs
    }
    recorded = {topic.name: types[topic.type] for topic in bag.image_topics}
    for name in (*bag.preferred_image_topics, *recorded):
        if inputs.get(name) is recorded[name] and not any(readers[name] & readers[taken] for taken in feeds.values()):
            feeds[name] = name
    return feeds


def _depth_feeds(bag: Bag, image_topic: str, inputs: Mapping[str, type[Message]]) -> dict[str, str]:
    """Map depth images, point clouds and transforms to the inputs that take them."""
    feeds: dict[str, str] = {}
    sensors = bag.depth_sensors_for(image_topic) if set(inputs.values()) & set(MEASURED) else {}
    sensors |= bag.transforms_for(image_topic)
    for name, kind in sensors.items():
        takers = [topic for topic, each in inputs.items() if each is kind]
        # The two topics of transforms have inputs of their own; the recorded ones may be in the namespace of a robot.
        target = next((topic for topic in takers if name.endswith(topic)), next(iter(takers), None))
        if target is not None:
            feeds[name] = target
    measuring = [name for name in feeds if sensors[name] in MEASURED]
    if measuring:
        log.info("%s: distances are measured on %s", bag.path, " and ".join(measuring))
    return feeds


def takes_images(graph: Graph) -> bool:
    """Whether ``graph`` (without its sources) has image inputs."""
    return any(kind in (Image, CompressedImage) for kind in _inputs(graph).values())


def _inputs(graph: Graph) -> dict[str, type[Message]]:
    """Unpublished topics of the graph, with their types."""
    published = {topic for config in graph.nodes for topic, _ in config.publications}
    published.update(topic for config in graph.nodes for topic in health_topics(graph, config.name))
    return {topic: kind for topic, kind in graph.topics().items() if topic not in published}


def recorded_commands(bag: Bag, graph: Graph) -> dict[str, type[Message]]:
    """Command topics of ``graph`` in ``bag``: published by a node, and without subscribers.

    Latched topics and traces report states, so they are no commands.
    """
    subscribed = {topic for config in graph.nodes for topic, _ in config.subscriptions}
    names = {topic.name for topic in bag.topics if topic.count}
    return {
        topic: port.message_type
        for config in graph.nodes
        for topic, port in config.publications
        if topic in names and topic not in subscribed
        if port.message_type is not TraceRecord and port.delivery is not Delivery.LATCHED
    }


@dataclass
class CommandMatcher:
    """Matcher of recorded commands with current ones, which differ in times and ids."""

    _given: dict[Any, deque[str]] = field(default_factory=dict)
    _ids: dict[str, str] = field(default_factory=dict)

    def give(self, topic: str, message: Message) -> None:
        self._given.setdefault(self._content(topic, message), deque()).append(getattr(message, "id", ""))

    def take(self, topic: str, recorded: Message) -> bool:
        """Match a recorded command with a current one; each matches once."""
        given = self._given.get(self._content(topic, self.as_current(recorded)))
        if not given:
            return False
        self._ids[getattr(recorded, "id", "")] = given.popleft()
        return True

    def knows(self, recorded: Message) -> bool:
        """Whether a recorded message has the id of a matched command."""
        return bool(self._ids.get(getattr(recorded, "id", "")))

    def as_current(self, recorded: Message, late: int = 0) -> Message:
        """Shift the stamp of a recorded message by ``late`` (ns), and insert the current id of its command."""
        id = self._ids.get(getattr(recorded, "id", ""))
        changes = {"stamp": recorded.stamp + late, **({"id": id} if id else {})}
        return msgspec.structs.replace(recorded, **changes)

    def _content(self, topic: str, message: Message) -> Any:
        """Content to match: all fields but id and stamp, or the id if there are no others (a cancellation)."""
        fields = msgspec.structs.asdict(message)
        id = fields.pop("id", "")
        del fields["stamp"]
        return topic, str(fields or id)


class WorldScript:
    """Recorded messages of ``bag`` for a ``graph`` without a simulator, in order. Times are in ns.

    Messages keep their order and time differences. A recorded command blocks later messages until an agent sends it.
    ``feeds`` maps bag topics to graph topics.

    Attributes:
        commands: The command topics and their types.
        sent: The number of messages sent.
        unanswered: The number of recorded commands without a match at the timeout.
    """

    def __init__(self, bag: Bag, feeds: Mapping[str, str], graph: Graph) -> None:
        self.commands = recorded_commands(bag, graph)
        self.sent = 0
        self.unanswered = 0
        topics = dict(zip(self.commands, self.commands, strict=True))
        self._messages = bag.messages({**feeds, **topics}, graph.topics())
        self._ahead: deque[tuple[str, Message]] = deque()
        self._held: dict[str, list[tuple[str, Message]]] = {}
        ids = (getattr(message, "id", "") for _, message in bag.messages(topics, graph.topics()))
        self._to_come = set(filter(None, ids))
        self._matcher = CommandMatcher()
        self._late = 0
        self._read()

    @property
    def due(self) -> int | None:
        """Time of the next message or command; None at the end."""
        return self._ahead[0][1].stamp + self._late if self._ahead else None

    def give_command(self, topic: str, message: Message) -> None:
        self._matcher.give(topic, message)

    def due_messages(self, now: int) -> Iterator[tuple[str, Message]]:
        """Yield the messages due at ``now``, up to the next unmatched command."""
        while self._ahead:
            topic, message = self._ahead[0]
            id = getattr(message, "id", "")
            if topic in self.commands:
                if not self._matcher.take(topic, message):
                    return
                yield from self._past(now)
            elif message.stamp + self._late > now:
                return
            else:
                self._next()
                if id in self._to_come:  # its command has a later stamp: the clocks of processes differ by a step
                    self._held.setdefault(id, []).append((topic, message))
                else:
                    yield self._sent(topic, message)

    def overdue_messages(self, now: int) -> Iterator[tuple[str, Message]]:
        """Yield messages while a command is overdue.

        Its cause may follow it in the bag. After `COMMAND_TIMEOUT_S` the replay skips the command.
        """
        topic, command = self._ahead[0]
        if topic not in self.commands:  # it has been given meanwhile
            return
        if now - command.stamp - self._late >= nanoseconds(COMMAND_TIMEOUT_S):
            log.warning("%s: a recorded command was not given: %s", topic, command)
            self.unanswered += 1
            yield from self._past(now)
            return
        while self._ahead[-1][1].stamp <= command.stamp + nanoseconds(SLACK_S) and self._read():
            pass
        for each in list(self._ahead):
            if each[0] not in self.commands and self._matcher.knows(each[1]):
                self._ahead.remove(each)
                yield self._sent(*each)
                return

    def _past(self, now: int) -> Iterator[tuple[str, Message]]:
        """Skip a command, and yield the messages blocked by it."""
        command = self._ahead[0][1]
        self._late = max(self._late, now - command.stamp)
        self._next()
        id = getattr(command, "id", "")
        self._to_come.discard(id)
        for each in self._held.pop(id, ()):
            yield self._sent(*each)

    def _sent(self, topic: str, message: Message) -> tuple[str, Message]:
        self.sent += 1
        return topic, self._matcher.as_current(message, self._late)

    def _next(self) -> None:
        self._ahead.popleft()
        if not self._ahead:
            self._read()

    def _read(self) -> bool:
        """Read one more message of the bag; return False at its end."""
        found = next(self._messages, None)
        if found is not None:
            self._ahead.append(found)
        return found is not None


class ReplayStage(Protocol):
    """Runner of a replay."""

    @property
    def now(self) -> int:
        """Time (ns)."""
        ...

    def advance(self, until: int) -> None:
        """Deliver the messages, and advance the time."""
        ...

    def send(self, topic: str, message: Message) -> None: ...


def play(script: WorldScript, stage: ReplayStage, ending: Ending) -> None:
    """Play ``script`` to its end, or until a stop request."""
    while (due := script.due) is not None and not ending.asked:
        stage.advance(max(due, stage.now))
        for topic, message in script.due_messages(stage.now):
            stage.send(topic, message)
        stage.advance(stage.now)
        if script.due is not None and script.due <= stage.now:  # a command is not given yet
            stage.advance(stage.now + nanoseconds(STEP_S))
            for topic, message in script.overdue_messages(stage.now):
                stage.send(topic, message)


class InlineStage:
    """Replay stage for an inline runner. Call `begin` before its nodes start, then `play`."""

    def __init__(self, runner: InlineRunner, script: WorldScript) -> None:
        self._runner = runner
        self._script = script
        for topic in script.commands:
            runner.tap(topic, self._on_command)

    def begin(self) -> None:
        """Send the messages that are due, such as the recorded reaction to a command."""
        for topic, message in self._script.due_messages(self.now):
            self.send(topic, message)

    @property
    def now(self) -> int:
        """Time of the run (ns)."""
        return self._runner.clock.now()

    def advance(self, until: int) -> None:
        self._runner.advance(until)

    def send(self, topic: str, message: Message) -> None:
        self._runner.enqueue(topic, message)

    def _on_command(self, topic: str, message: Message) -> None:
        self._script.give_command(topic, message)
        self.begin()


class PlaybackResult(msgspec.Struct):
    """Result of a playback: messages sent, missing answers, and damaged messages by topic.

    With images, only images are counted. Otherwise missing commands count as missing answers.
    """

    sent: int = 0
    unanswered: int = 0
    skipped: dict[str, Skipped] = {}
