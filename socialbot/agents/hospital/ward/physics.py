"""Ward with physics, in MuJoCo (extra ``sim``): robots, doors and litter as bodies with mass and friction.

Servos drive the robots along the ways of the simulated ward, and turn the leaves of doors. Positions and doors are
those of the bodies: a robot has arrived when its body is there, and a door is open when its leaf is. Walls, leaves,
furniture, people and litter are in the way of a robot; other robots are not.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.base.mujoco import CONTROL_NS, SURROUNDINGS, Physics, look_at, servo
from socialbot.agents.hospital.ward._world import WardActivity, WardAgent, WardWorld
from socialbot.agents.hospital.ward.messages import AWAY, WardState
from socialbot.agents.hospital.ward.ward import (
    NURSE,
    ROOM_M,
    SPOT,
    UVD,
    Journey,
    Position,
    Room,
    Ward,
    WardMember,
)
from socialbot.core.clock import SECOND

DOOR_M = 1.6
"""Width of a door; its leaf turns into the room."""
OPEN_RAD = 1.65
IS_OPEN_RAD = 1.1
"""Angle of an open leaf, and the smallest one at which a door counts as open."""
ARRIVED_M = 0.06
"""Distance from its goal at which a robot has arrived."""
PUSH_PER_KG, SWING = 60.0, 150.0
"""Largest force on an agent (N/kg) and torque on a leaf (Nm) at the pace of 1 m/s; proportional to the pace."""
LAG_M = 0.4
"""Distance of a body behind its way at which the way waits for it."""
LOOK_S = CONTROL_NS / SECOND
LANE = {SPOT: Position(-0.28, 0.28), UVD: Position(0.28, -0.28)}
"""Offset of the bodies of robots from their ways, so that two of them pass and stand side by side."""
NURSE_AT, VISITOR_AT = Position(0.0, 1.0), Position(1.2, 0.6)
"""Places of a nurse and of a visitor in a room, from its centre; y is the distance inward."""
LITTER = (Position(-0.9, 0.5), Position(0.2, 0.8), Position(0.9, 0.3), Position(-0.3, 1.1))
"""Places of the litter in an untidy room, likewise."""
LITTER_Z = 0.3
PARKED = Position(-40.0, -40.0)
"""Corner of the place, out of sight, of all that is not in the ward."""
WALL_Z = 0.45
"""Half the height of walls and doors: low, so that a camera sees into the rooms."""

_AGENTS: dict[str, str] = {
    SPOT: (
        '<geom class="robot" size="0.34 0.13 0.09" pos="0 0 0.52" rgba="0.95 0.72 0.15 1" mass="20"/>'
        '<geom class="robot" size="0.07 0.1 0.06" pos="0.40 0 0.56" rgba="0.15 0.15 0.18 1" mass="2"/>'
        + "".join(
            f'<geom class="robot" type="capsule" size="0.035" fromto="{x} {y} 0.50 {x - 0.10} {y} 0.28" mass="1"/>'
            f'<geom class="robot" type="capsule" size="0.03" fromto="{x - 0.10} {y} 0.28 {x} {y} 0.05" mass="1"/>'
            for x in (0.28, -0.24)
            for y in (-0.17, 0.17)
        )
    ),
    UVD: (
        '<geom class="robot" type="cylinder" size="0.25 0.12" pos="0 0 0.16" rgba="0.88 0.90 0.92 1" mass="25"/>'
        '<geom class="robot" type="cylinder" size="0.05 0.40" pos="0 0 0.66" rgba="0.30 0.33 0.40 1" mass="4"/>'
        + "".join(
            f'<geom name="{{name}} lamp{number}" class="robot" type="capsule" size="0.025 0.34" '
            f'pos="{0.11 * math.cos(number):.3f} {0.11 * math.sin(number):.3f} 0.68" mass="0.2"/>'
            for number in range(6)
        )
    ),
    NURSE: (
        '<geom class="robot" type="capsule" size="0.17 0.42" pos="0 0 0.65" rgba="0.35 0.68 0.66 1" mass="60"/>'
        '<geom class="robot" type="sphere" size="0.14" pos="0 0 1.38" rgba="0.91 0.76 0.65 1" mass="5"/>'
        '<geom class="robot" size="0.02 0.12 0.16" pos="0.22 0 1.0" rgba="0.15 0.15 0.18 1" mass="0.5"/>'
    ),
}
_MASS = {SPOT: 30.0, UVD: 30.2, NURSE: 65.5}
LAMP_OFF, LAMP_ON = (0.86, 0.84, 0.93, 1.0), (0.55, 0.20, 1.0, 1.0)
CLEAN, INFECTED, LIT = (0.82, 0.88, 0.84, 1.0), (0.93, 0.74, 0.70, 1.0), (0.72, 0.60, 0.98, 1.0)
"""Colours of the lamps of a robot, and of the floor of a room."""


def scene_xml(ward: Ward, visitors: int, untidy: Sequence[str], speed: float) -> str:
    """The scene of a ward, with all agents at home.

    Args:
        ward: The ward.
        visitors: Largest number of people who enter rooms.
        untidy: Rooms that may become untidy.
        speed: Speed of robots, m/s.
    """
    bodies: list[str] = []
    actuators: list[str] = []
    for room in ward.rooms:
        bodies += _room(room, is_dock=room.name in ward.docks)
        actuators.append(servo(f"{room.name} door", 9000, 12 * DOOR_M**2 / 3, limit=SWING * speed))
    for member in ward.members:
        home, name = ward.room_by_name[member.home], member.name
        at, lane = home.centre, _lane(member, home)
        bodies.append(
            f'<body name="{name}" pos="{at.x + lane.x} {at.y + lane.y} 0">'
            f'<joint name="{name} x" type="slide" axis="1 0 0"/><joint name="{name} y" type="slide" axis="0 1 0"/>'
            f'<joint name="{name} turn" type="hinge" axis="0 0 1"/>{_AGENTS[member.kind].format(name=name)}</body>'
        )
        mass = _MASS[member.kind]
        actuators += [servo(f"{name} {axis}", 4000 * mass, mass, limit=PUSH_PER_KG * speed * mass) for axis in "xy"]
        actuators.append(servo(f"{name} turn", 600, 3.0, limit=400))
    bodies += [
        f'<body name="person{number}" mocap="true" pos="{PARKED.x - number} {PARKED.y} 0">'
        '<geom class="person" type="capsule" size="0.18 0.42" pos="0 0 0.66" rgba="0.62 0.45 0.66 1"/>'
        '<geom class="person" type="sphere" size="0.14" pos="0 0 1.38" rgba="0.85 0.68 0.56 1"/></body>'
        for number in range(1, visitors + 1)
    ]
    for number, room in enumerate(untidy):
        for piece in range(len(LITTER)):
            bodies.append(
                f'<body name="{room} litter{piece}" pos="{PARKED.x - number} {PARKED.y + 2 + piece} {LITTER_Z}">'
                f'<freejoint name="{room} litter{piece}"/><geom class="litter"/></body>'
            )
    right = max(room.corner.x for room in ward.rooms) + ROOM_M[0]
    low, high = (pick(room.corner.y for room in ward.rooms) for pick in (min, max))
    x, y, size = right / 2, (low + high + ROOM_M[1]) / 2, max(right, high + ROOM_M[1] - low)
    return f"""<mujoco model="ward">
  {SURROUNDINGS}
  <statistic center="{x} {y} 0" extent="{2 * size}"/>
  <default>
    <geom type="box"/>
    <default class="wall"><geom contype="2" conaffinity="0" rgba="0.93 0.93 0.90 1" solref="0.01 1"/></default>
    <default class="mark"><geom contype="0" conaffinity="0" rgba="0.82 0.88 0.84 1"/></default>
    <default class="robot"><geom contype="1" conaffinity="14" rgba="0.15 0.15 0.18 1" friction="0.4"/></default>
    <default class="person"><geom contype="8" conaffinity="0"/></default>
    <default class="litter"><geom size="0.12 0.09 0.08" contype="4" conaffinity="7" mass="0.6"
      rgba="0.72 0.55 0.33 1"/></default>
  </default>
  <worldbody>
    <light type="directional" pos="{x} {y} 9" dir="-0.3 0.35 -1" diffuse="0.55 0.55 0.52" castshadow="true"/>
    <geom name="floor" type="plane" size="{size + 6} {size + 6} 0.1" material="floor" contype="2" conaffinity="0"/>
    <camera name="film" fovy="42" {look_at((x, y - 0.85 * size, 1.05 * size), (x, y - 0.02 * size, 0.0))}/>
    {"".join(bodies)}
  </worldbody>
  <actuator>{"".join(actuators)}</actuator>
</mujoco>"""


def _inward(room: Room) -> int:
    """Sign of the y from the door of a room to its inside."""
    return -1 if room.is_above else 1


def _within(room: Room, place: Position) -> Position:
    return Position(room.centre.x + place.x, room.centre.y + _inward(room) * place.y)


def _lane(member: WardMember, home: Room) -> Position:
    """Offset of the body of an agent from its way."""
    return LANE.get(member.kind) or Position(NURSE_AT.x, _inward(home) * NURSE_AT.y)


def _room(room: Room, *, is_dock: bool) -> list[str]:
    """Walls, floor, furniture and door of a room."""
    (width, depth), centre, door = ROOM_M, room.centre, room.door
    inward = _inward(room)
    back = room.corner.y + (0.0 if room.is_above else depth)
    side = (width - DOOR_M) / 4
    walls = [
        (centre.x, back, width / 2, 0.05),
        *((centre.x + sign * width / 2, centre.y, 0.05, depth / 2) for sign in (-1, 1)),
        *((door.x + sign * (DOOR_M / 2 + side), door.y, side, 0.05) for sign in (-1, 1)),
    ]
    furniture = (
        f'<geom class="mark" size="1.0 0.8 0.003" pos="{centre.x} {centre.y} 0.006" rgba="0.35 0.55 0.80 1"/>'
        if is_dock
        else f'<geom class="wall" size="0.95 0.45 0.25" pos="{room.corner.x + 1.1} {back - inward * 0.55} 0.25" '
        'rgba="0.95 0.97 1 1"/>'
        f'<geom class="wall" size="0.2 0.35 0.06" pos="{room.corner.x + 0.4} {back - inward * 0.55} 0.55" '
        'rgba="0.70 0.80 0.92 1"/>'
    )
    return [
        *(f'<geom class="wall" size="{sx} {sy} {WALL_Z}" pos="{x} {y} {WALL_Z}"/>' for x, y, sx, sy in walls),
        f'<geom name="{room.name} floor" class="mark" size="{width / 2} {depth / 2} 0.002" '
        f'pos="{centre.x} {centre.y} 0.002"/>',
        furniture,
        f'<body name="{room.name} leaf" pos="{door.x - DOOR_M / 2} {door.y} {WALL_Z}">'
        f'<joint name="{room.name} door" type="hinge" axis="0 0 {inward}"/>'
        f'<geom class="wall" size="{DOOR_M / 2 - 0.02} 0.03 {WALL_Z - 0.03}" pos="{DOOR_M / 2} 0 0" '
        'rgba="0.62 0.46 0.32 1" mass="12"/></body>',
    ]


@dataclass
class _PhysicalAgent(WardAgent):
    """An agent whose position is that of its body."""

    physics: Physics | None = field(default=None, repr=False)
    lane: Position = LANE[SPOT]

    def at(self, time: int) -> Position:
        assert self.physics is not None
        x, y, _ = self.physics.position(self.member.name)
        return Position(x - self.lane.x, y - self.lane.y)


class PhysicalWard(WardWorld):
    """Ward whose agents, doors and litter obey physics. Commands, states and faults are those of `WardWorld`.

    Raises InstallationError without MuJoCo.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        for room, is_open in self._swung.items():
            self.physics.put(f"{room} door", OPEN_RAD if is_open else 0.0)
        self.physics.mujoco.mj_forward(self.physics.model, self.physics.data)
        self._arrange()

    def _prepare(self, faults: Sequence[WorldFault]) -> None:
        untidy = tuple(dict.fromkeys(fault.target for fault in faults if fault.kind == "dirty"))
        visitors = sum(fault.kind == "enters" for fault in faults)
        self.physics = Physics(scene_xml(self.ward, visitors, untidy, self.durations.speed), self.now)
        self._untidy = dict.fromkeys(untidy, False)
        """Whether the litter of a room lies in it."""
        self._inside_people: dict[str, str] = {}
        """Room of each visitor."""
        self._absent: set[str] = set()
        self._facing: dict[str, float] = {}
        self._swung = {room.name: room.name not in self.ward.closed for room in self.ward.rooms}
        """Whether a door is to be open."""

    def _new_agent(self, member: WardMember, home: Room, chance: random.Random) -> WardAgent:
        return _PhysicalAgent(
            member,
            home.name,
            home.centre,
            chance,
            outdated=self._outdated,
            physics=self.physics,
            lane=_lane(member, home),
        )

    def state(self) -> WardState:
        self._outdated.update(self.agents)
        return super().state()

    def advance(self, time: int) -> None:
        """Run events and physics until ``time``."""
        while self.now < time:
            super().advance(min(self.now + CONTROL_NS, time))
            self._arrange()
            self.physics.advance(self.now)
            self._note_doors()
        super().advance(time)

    def change_room(self, room: str, **changes: Any) -> None:
        """Change the state of a room; its door counts as open or closed when the leaf has turned."""
        if "door_open" in changes:
            self._swung[room] = changes.pop("door_open")
        if changes:
            super().change_room(room, **changes)

    def _note_doors(self) -> None:
        for name, room in self.rooms.items():
            is_open = float(self.physics.data.joint(f"{name} door").qpos[0]) > IS_OPEN_RAD
            if is_open != room.door_open:
                super().change_room(name, door_open=is_open)

    # Actions end when the bodies are there

    def _is_underway(self, agent: WardAgent) -> bool:
        if agent.place == AWAY:
            return False
        drives = agent.journey is not None and self.now < agent.journey.end
        return drives or math.dist(agent.goal(self.now), agent.at(self.now)) > ARRIVED_M

    def _reach_door(self, activity: WardActivity, agent: WardAgent, target: str) -> None:
        if self._is_underway(agent):
            self._later(activity, LOOK_S, lambda: self._reach_door(activity, agent, target))
        else:
            super()._reach_door(activity, agent, target)

    def _arrive(self, activity: WardActivity, agent: WardAgent) -> None:
        if self._is_underway(agent):
            self._later(activity, LOOK_S, lambda: self._arrive(activity, agent))
        else:
            super()._arrive(activity, agent)

    def _do(self, activity: WardActivity) -> None:
        room = activity.args[-1]
        waits = any(self._is_underway(self.agents[name]) for name in self._inside(activity))
        if activity.action == "a_open_door" and not self._obstacle(activity):
            self._swung[room] = True
            waits = not self.rooms[room].door_open
        if waits:
            self._later(activity, LOOK_S, lambda: self._do(activity))
        else:
            super()._do(activity)

    # Bodies

    def _arrange(self) -> None:
        """Set the targets of servos, and the places of people, of litter and of agents outside the ward."""
        for room, is_open in self._swung.items():
            self.physics.aim(f"{room} door", OPEN_RAD if is_open else 0.0)
        lit = {
            agent.activity.args[-1]
            for agent in self.agents.values()
            if agent.activity is not None and agent.activity.action == "a_disinfect_room" and agent.inside
        }
        for name, agent in self.agents.items():
            self._drive(name, agent)
        for name, room in self.rooms.items():
            colour = LIT if name in lit else CLEAN if room.disinfected else INFECTED
            self.physics.model.geom(f"{name} floor").rgba = colour
            if name in self._untidy and self._untidy[name] == room.cleaned:
                self._untidy[name] = not room.cleaned
                self._move_litter(name, parked=room.cleaned)
        self._move_people()

    def _drive(self, name: str, agent: WardAgent) -> None:
        home, journey = self.ward.room_by_name[agent.member.home].centre, agent.journey
        if journey is not None and math.dist(agent.goal(self.now), agent.at(self.now)) > LAG_M:
            agent.journey = Journey(journey.points, journey.begin + CONTROL_NS, journey.end + CONTROL_NS)
        goal = agent.goal(self.now)
        if agent.place == AWAY:
            goal = Position(PARKED.x, PARKED.y - 3)
        if (agent.place == AWAY) != (name in self._absent):
            self._absent ^= {name}
            self.physics.put(f"{name} x", goal.x - home.x)
            self.physics.put(f"{name} y", goal.y - home.y)
        self.physics.aim(f"{name} x", goal.x - home.x)
        self.physics.aim(f"{name} y", goal.y - home.y)
        if agent.journey is not None and (heading := _heading(agent.journey.left(self.now))) is not None:
            before = self._facing.get(name, 0.0)
            # The shorter way round.
            self._facing[name] = before + math.remainder(heading - before, math.tau)
        self.physics.aim(f"{name} turn", self._facing.get(name, 0.0))
        if agent.member.kind == UVD:
            on = agent.activity is not None and agent.activity.action == "a_disinfect_room"
            for number in range(6):
                self.physics.model.geom(f"{name} lamp{number}").rgba = LAMP_ON if on and agent.inside else LAMP_OFF

    def _move_litter(self, room: str, *, parked: bool) -> None:
        number = list(self._untidy).index(room)
        for piece, place in enumerate(LITTER):
            x, y = _within(self.ward.room_by_name[room], place)
            if parked:
                x, y = PARKED.x - number, PARKED.y + 2 + piece
            self.physics.put(f"{room} litter{piece}", x, y, LITTER_Z)

    def _move_people(self) -> None:
        present = {person: name for name, room in self.rooms.items() for person in room.people}
        if present == self._inside_people:
            return
        for person in {*present, *self._inside_people}:
            at = _within(self.ward.room_by_name[present[person]], VISITOR_AT) if person in present else PARKED
            body = self.physics.model.body(person)
            self.physics.data.mocap_pos[body.mocapid[0]] = (at.x, at.y, 0.0)
        self._inside_people = present


def _heading(points: tuple[Position, ...]) -> float | None:
    """Direction of the next part of a way, rad; None at its end."""
    here = next(((a, b) for a, b in pairwise(points) if math.dist(a, b) > 1e-6), None)
    return None if here is None else math.atan2(here[1].y - here[0].y, here[1].x - here[0].x)
