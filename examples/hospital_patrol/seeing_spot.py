"""A Spot that looks: a room in which the person detector sees somebody does not pass its patrol."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from room_camera import PATROL, frame_of

from socialbot import SECOND, Atom, Context, Input, Literal, Parameter, PersonDetections, TraceRecord, nanoseconds
from socialbot.agents.hospital import PERSON_IN_ROOM, ActionCancel, ActionResult, Spot, WorldAction, names_of
from socialbot.bdi import Action, Engine, Sensor
from socialbot.bdi.literals import literal

PROGRAM = Path(__file__).with_name("seeing_spot.asl")
NOT_SEEN = "room not seen"
"""Why a patrol fails that had too few pictures: not to see anybody is not to see that nobody is there."""


class Sight(Sensor):
    """Whether somebody is in a room: ``somebody(room1)``. It is shown the room, and whether there is."""

    def sense(self, percept: tuple[str, bool]) -> Any:
        room, anybody = percept
        somebody = literal("somebody", (Atom(room),))
        return +somebody if anybody else -somebody


class break_off(Action):
    """Stops an action under way, which has failed: ``break_off(Action, Reason)``."""

    def execute(self, action: Literal, reason: str) -> None:
        self.engine.robot.break_off(action.functor, names_of(action.args), reason)


@dataclass
class Look:
    """What was seen of a room since a patrol began; times in ns.

    Who is seen for less than ``sure`` may be a coat on a stand: that it never moves no single picture tells.
    """

    room: str
    since: int
    last: int
    sure: int
    longest_gap: int = 0
    pictures: int = 0
    seen_since: int | None = None
    """Since when there was somebody in every picture."""
    met_somebody: bool = False
    """Whether somebody was in the room at any time."""

    @property
    def somebody(self) -> bool:
        """Whether somebody is in the room now."""
        return self.seen_since is not None and self.last - self.seen_since >= self.sure

    def take(self, time: int, *, persons: bool) -> None:
        """Takes a picture, with or without persons."""
        self.longest_gap = max(self.longest_gap, time - self.last)
        self.last = time
        self.pictures += 1
        if not persons:
            self.seen_since = None
        elif self.seen_since is None:
            self.seen_since = time
        self.met_somebody = self.met_somebody or self.somebody

    def objection(self, now: int, blind: int) -> str:
        """Why the room does not pass when the patrol ends at ``now``, which may have seen nothing for ``blind``."""
        if self.met_somebody or self.seen_since is not None:
            return PERSON_IN_ROOM
        gap = max(self.longest_gap, now - self.last)
        return NOT_SEEN if not self.pictures or gap > blind else ""


class SeeingSpot(Spot):
    """A robot that patrols, and sees what the camera of the room shows."""

    seen = Input(PersonDetections, "/humans/bodies/detections")

    sure_s = Parameter(0.5, "s that somebody is seen before it is believed", minimum=0.0, maximum=10.0)
    blind_s = Parameter(
        2.0, "s without a picture after which a patrol has not seen the room", minimum=0.1, maximum=60.0
    )

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        self._look: Look | None = None
        self._sight = Sight()
        super().__init__(name, context, parameters)

    def build(self) -> Engine:
        engine = super().build()
        engine.add_action(break_off)
        engine.add_sensor(self._sight)
        engine.add_text(PROGRAM.read_text("utf-8"), PROGRAM.name)
        return engine

    def begin(self, world_action: WorldAction) -> None:
        if world_action.action == PATROL:
            now = self.clock.now()
            self._look = Look(world_action.arguments[1], since=now, last=now, sure=nanoseconds(self.sure_s))
        super().begin(world_action)

    @seen
    def on_seen(self, message: PersonDetections) -> None:
        """Takes what the detector finds in a picture of the room that is patrolled."""
        look = self._look
        if look is None or message.frame_id != frame_of(look.room) or message.stamp < look.since:
            return
        before = look.somebody
        look.take(message.stamp, persons=bool(message.persons))
        if look.somebody != before:
            self._believe(look, message)

    def _believe(self, look: Look, message: PersonDetections) -> None:
        """Believes what it sees now, and puts it on record."""
        best = max(message.persons, key=lambda person: person.score, default=None)
        found = {} if best is None else {"score": round(best.score, 2), "distance_m": _rounded(best.distance_m)}
        cause = self._record_sight(look, message.id, persons=len(message.persons), **found)
        self.engine.perceive(self._sight, (look.room, look.somebody), cause=cause)

    def break_off(self, action: str, args: tuple[str, ...], reason: str) -> None:
        """Stops an action that is under way, which has failed for that reason."""
        now = self.clock.now()
        for id, world_action in list(self._in_progress.items()):
            if world_action.key == (action, args):
                self.cancels.publish(ActionCancel(stamp=now, id=id))
                failure = ActionResult(
                    stamp=now, id=id, robot=self.name, action=action, args=args, outcome="failure", reason=reason
                )
                self.on_result(failure)

    def on_result(self, message: ActionResult) -> None:
        """Takes what became of an action; a patrol is done only if the room was seen, and seen to be empty."""
        look = self._look
        if look is not None and message.action == PATROL and message.id in self._in_progress:
            self._look = None
            now = self.clock.now()
            objection = (
                look.objection(now, nanoseconds(self.blind_s)) if message.outcome == "success" else message.reason
            )
            if objection:
                message = msgspec.structs.replace(message, outcome="failure", reason=objection)
            else:
                self._record_sight(look, message.id, pictures=look.pictures, seconds=(now - look.since) / SECOND)
            self.engine.perceive(self._sight, (look.room, False), cause=message.id)
        super().on_result(message)

    def _record_sight(self, look: Look, cause: str, **detail: object) -> str:
        """Puts what it sees on record; returns the id of the record."""
        now = self.clock.now()
        record = TraceRecord(
            stamp=now,
            id=f"{self.name}-sees-{now}",
            source=self.name,
            kind="sees",
            what=f"{'somebody' if look.somebody else 'nobody'} in {look.room}",
            cause=cause,
            detail=detail,
        )
        self.trace.publish(record)
        return record.id


def _rounded(metres: float | None) -> float | None:
    return None if metres is None else round(metres, 1)
