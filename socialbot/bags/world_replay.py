"""Replay the world side of a bag to agents, inline or over ROS."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import msgspec

from socialbot.bags.reader import Bag, Skipped
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Message, TraceRecord
from socialbot.core.process import Ending
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Delivery, Graph

log = logging.getLogger("socialbot.player")

PATIENCE_S = 2.0
"""How long (s, simulated) the world waits for a command."""

STEP_S = 1 / 30
"""How far the clock goes at once while it waits."""

SLACK_S = 0.2
"""So much later than a command an answer may bear its time that had it given: clocks of processes differ by a step."""


def commands(bag: Bag, graph: Graph) -> dict[str, type[Message]]:
    """The topics of ``bag`` by which nodes of ``graph`` tell the world what to do: those that no node listens to.

    What is latched tells how something is, as traces tell what was done.
    """
    heard = {topic for placement in graph.placements for topic, _ in placement.subscriptions}
    names = {topic.name for topic in bag.topics if topic.count}
    return {
        topic: port.message_type
        for placement in graph.placements
        for topic, port in placement.publications
        if topic in names and topic not in heard
        if port.message_type is not TraceRecord and port.delivery is not Delivery.LATCHED
    }


@dataclass
class Commands:
    """The commands that were recorded beside those that are given: the same but for their times and ids."""

    _given: dict[Any, deque[str]] = field(default_factory=dict)
    _ids: dict[str, str] = field(default_factory=dict)

    def give(self, topic: str, message: Message) -> None:
        """Takes a command that is given."""
        self._given.setdefault(self._content(topic, message), deque()).append(getattr(message, "id", ""))

    def take(self, topic: str, recorded: Message) -> bool:
        """Whether a recorded command has been given; each one counts once."""
        given = self._given.get(self._content(topic, self.as_now(recorded)))
        if not given:
            return False
        self._ids[getattr(recorded, "id", "")] = given.popleft()
        return True

    def knows(self, recorded: Message) -> bool:
        """Whether a recorded message has the id of a command that has been given."""
        return bool(self._ids.get(getattr(recorded, "id", "")))

    def as_now(self, recorded: Message, late: int = 0) -> Message:
        """A recorded message as it is now: so much later (ns), with the id of its command as that is called now."""
        id = self._ids.get(getattr(recorded, "id", ""))
        changes = {"stamp": recorded.stamp + late, **({"id": id} if id else {})}
        return msgspec.structs.replace(recorded, **changes)

    def _content(self, topic: str, message: Message) -> Any:
        """What a command says: of one that begins something all but its id, of one that takes it back the id."""
        fields = msgspec.structs.asdict(message)
        id = fields.pop("id", "")
        del fields["stamp"]
        return topic, str(fields or id)


class WorldScript:
    """What the world of ``bag`` has to say to ``graph``, which has none of its own.

    ``feeds`` are the topics (bag topic to graph topic) of what it says. All is said in the order and at the distances
    in which it was recorded, as long as the commands in between are given. Times are ns.
    """

    def __init__(self, bag: Bag, feeds: Mapping[str, str], graph: Graph) -> None:
        self.told = commands(bag, graph)
        """The topics by which it is told what to do."""
        self.sent = 0
        self.unanswered = 0
        """Recorded commands that were not given in time."""
        topics = dict(zip(self.told, self.told, strict=True))
        self._messages = bag.messages({**feeds, **topics}, graph.topics())
        self._ahead: deque[tuple[str, Message]] = deque()
        self._held: dict[str, list[tuple[str, Message]]] = {}
        ids = (getattr(message, "id", "") for _, message in bag.messages(topics, graph.topics()))
        self._to_come = set(filter(None, ids))
        """Ids of recorded commands that were not taken yet."""
        self._commands = Commands()
        self._late = 0
        self._read()

    @property
    def due(self) -> int | None:
        """When the next is to be said, or its command to be given; None when all is said."""
        return self._ahead[0][1].stamp + self._late if self._ahead else None

    def hear(self, topic: str, message: Message) -> None:
        """Takes a command that is given."""
        self._commands.give(topic, message)

    def say(self, now: int) -> Iterator[tuple[str, Message]]:
        """What is due at ``now``, up to the next command that is not given yet."""
        while self._ahead:
            topic, message = self._ahead[0]
            id = getattr(message, "id", "")
            if topic in self.told:
                if not self._commands.take(topic, message):
                    return
                yield from self._past(now)
            elif message.stamp + self._late > now:
                return
            else:
                self._next()
                if id in self._to_come:  # its command bears a later time: the clocks of processes differ by a step
                    self._held.setdefault(id, []).append((topic, message))
                else:
                    yield self._said(topic, message)

    def wait(self, now: int) -> Iterator[tuple[str, Message]]:
        """What to say while a command is due, and does not come.

        It may follow from an answer that was recorded after it. After `PATIENCE_S` all goes on without it.
        """
        topic, command = self._ahead[0]
        if topic not in self.told:  # it has been given at last
            return
        if now - command.stamp - self._late >= nanoseconds(PATIENCE_S):
            log.warning("%s: a command is not given: %s", topic, command)
            self.unanswered += 1
            yield from self._past(now)
            return
        while self._ahead[-1][1].stamp <= command.stamp + nanoseconds(SLACK_S) and self._read():
            pass
        for each in list(self._ahead):
            if each[0] not in self.told and self._commands.knows(each[1]):
                self._ahead.remove(each)
                yield self._said(*each)
                return

    def _past(self, now: int) -> Iterator[tuple[str, Message]]:
        """Leaves a command behind, and says what was held back for it."""
        command = self._ahead[0][1]
        self._late = max(self._late, now - command.stamp)
        self._next()
        id = getattr(command, "id", "")
        self._to_come.discard(id)
        for each in self._held.pop(id, ()):
            yield self._said(*each)

    def _said(self, topic: str, message: Message) -> tuple[str, Message]:
        self.sent += 1
        return topic, self._commands.as_now(message, self._late)

    def _next(self) -> None:
        self._ahead.popleft()
        if not self._ahead:
            self._read()

    def _read(self) -> bool:
        """Reads one more message of the bag, if there is one."""
        found = next(self._messages, None)
        if found is not None:
            self._ahead.append(found)
        return found is not None


class ReplayStage(Protocol):
    """Where a script is played."""

    @property
    def now(self) -> int:
        """The time there, ns."""
        ...

    def advance(self, until: int) -> None:
        """Lets what was said arrive, and time pass."""
        ...

    def say(self, topic: str, message: Message) -> None:
        """Says something to the agents."""
        ...


def play(script: WorldScript, stage: ReplayStage, ending: Ending) -> None:
    """Plays a script until all is said, or it is asked to end."""
    while (due := script.due) is not None and not ending.asked:
        stage.advance(max(due, stage.now))
        for topic, message in script.say(stage.now):
            stage.say(topic, message)
        stage.advance(stage.now)
        if script.due is not None and script.due <= stage.now:  # a command is not given yet
            stage.advance(stage.now + nanoseconds(STEP_S))
            for topic, message in script.wait(stage.now):
                stage.say(topic, message)


class InlineStage:
    """An inline run as the stage of a script. Call `begin` before its nodes start, then `play`."""

    def __init__(self, runner: InlineRunner, script: WorldScript) -> None:
        self._runner = runner
        self._script = script
        for topic in script.told:
            runner.tap(topic, self._hear)

    def begin(self) -> None:
        """Says what was said at the start."""
        self._go_on()

    @property
    def now(self) -> int:
        """The time of the run, ns."""
        return self._runner.clock.now()

    def advance(self, until: int) -> None:
        """Lets time pass, after all that was said has arrived."""
        self._runner.advance(until)

    def say(self, topic: str, message: Message) -> None:
        """Puts a message in line."""
        self._runner.enqueue(topic, message)

    def _hear(self, topic: str, message: Message) -> None:
        self._script.hear(topic, message)
        self._go_on()

    def _go_on(self) -> None:
        """Says at once what was said because of a command, as the world did."""
        for topic, message in self._script.say(self.now):
            self.say(topic, message)


class PlaybackResult(msgspec.Struct):
    """How it went: messages sent, what the graph did not answer in time, and the damaged messages of each topic.

    Where the graph takes pictures, only they count; else it is commands to the world that count as answers.
    """

    sent: int = 0
    unanswered: int = 0
    skipped: dict[str, Skipped] = {}
