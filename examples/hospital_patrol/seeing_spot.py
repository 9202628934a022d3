"""Patrol robot with a person detector: a patrol fails if a person is detected in the room."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from room_camera import PATROL, frame_of

from socialbot import SECOND, Atom, Context, Input, Literal, Parameter, PersonDetections, TraceRecord, nanoseconds
from socialbot.agents.hospital import PERSON_IN_ROOM, ActionCancel, ActionResult, Spot, WorldAction, names_of
from socialbot.bdi import Action, Engine, Sensor, literal

PROGRAM = Path(__file__).with_name("seeing_spot.asl")
NOT_SEEN = "room not seen"
"""Reason of a patrol that fails for lack of images: no image is no evidence of an empty room."""


class Sight(Sensor):
    """Sensor of ``somebody(room1)``; a percept is the room, and whether a person is there."""

    def sense(self, percept: tuple[str, bool]) -> Any:
        room, anybody = percept
        somebody = literal("somebody", (Atom(room),))
        return +somebody if anybody else -somebody


class break_off(Action):
    """Stop a running action as failed: ``break_off(Action, Reason)``."""

    def execute(self, action: Literal, reason: str) -> None:
        self.engine.robot.break_off(action.functor, names_of(action.args), reason)


@dataclass
class Look:
    """Detections in a room since a patrol began; times in ns.

    A detection shorter than ``sure`` may be a coat on a stand: no single image shows that it never moves.
    """

    room: str
    since: int
    last: int
    sure: int
    longest_gap: int = 0
    pictures: int = 0
    seen_since: int | None = None
    """Start of the time in which every image shows a person."""
    met_somebody: bool = False
    """Whether a person was in the room at any time."""

    @property
    def somebody(self) -> bool:
        """Whether a person is in the room now."""
        return self.seen_since is not None and self.last - self.seen_since >= self.sure

    def take(self, time: int, *, persons: bool) -> None:
        """Add an image with or without persons."""
        self.longest_gap = max(self.longest_gap, time - self.last)
        self.last = time
        self.pictures += 1
        if not persons:
            self.seen_since = None
        elif self.seen_since is None:
            self.seen_since = time
        self.met_somebody = self.met_somebody or self.somebody

    def objection(self, now: int, blind: int) -> str:
        """Return why a patrol that ends at ``now`` fails, or an empty string; gaps up to ``blind`` are allowed."""
        if self.met_somebody or self.seen_since is not None:
            return PERSON_IN_ROOM
        gap = max(self.longest_gap, now - self.last)
        return NOT_SEEN if not self.pictures or gap > blind else ""


class SeeingSpot(Spot):
    """Patrol robot that uses the detections of the room camera."""

    seen = Input(PersonDetections, "/humans/bodies/detections")

    sure_s = Parameter(0.5, "seconds of detections before the robot believes them", minimum=0.0, maximum=10.0)
    blind_s = Parameter(2.0, "seconds without an image after which a patrol fails", minimum=0.1, maximum=60.0)

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
        """Use the detections in an image of the patrolled room."""
        look = self._look
        if look is None or message.frame_id != frame_of(look.room) or message.stamp < look.since:
            return
        before = look.somebody
        look.take(message.stamp, persons=bool(message.persons))
        if look.somebody != before:
            self._believe(look, message)

    def _believe(self, look: Look, message: PersonDetections) -> None:
        """Update the belief and the trace."""
        best = max(message.persons, key=lambda person: person.score, default=None)
        found = {} if best is None else {"score": round(best.score, 2), "distance_m": _rounded(best.distance_m)}
        cause = self._record_sight(look, message.id, persons=len(message.persons), **found)
        self.engine.perceive(self._sight, (look.room, look.somebody), cause=cause)

    def break_off(self, action: str, args: tuple[str, ...], reason: str) -> None:
        """Stop a running action, which fails with the reason."""
        now = self.clock.now()
        for id, world_action in list(self._in_progress.items()):
            if world_action.key == (action, args):
                self.cancels.publish(ActionCancel(stamp=now, id=id))
                failure = ActionResult(
                    stamp=now, id=id, robot=self.name, action=action, args=args, outcome="failure", reason=reason
                )
                self.on_result(failure)

    def on_result(self, message: ActionResult) -> None:
        """Handle the result of an action; a patrol succeeds only if images show an empty room."""
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
        """Add the sighting to the trace; returns the id of the record."""
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
