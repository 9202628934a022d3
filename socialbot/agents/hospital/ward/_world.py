"""Simulated ward: executes the actions of robots and nurses, the same for the same seed and commands."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from socialbot.agents.base._simulation import SimulatedWorld, WorldFault
from socialbot.agents.hospital.ward.messages import (
    AWAY,
    CLOSED_DOOR,
    CORRIDOR,
    DIRTY_ROOM,
    LOW_AT,
    LOW_BATTERY,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
    AgentState,
    RoomState,
    WardState,
)
from socialbot.agents.hospital.ward.ward import (
    ANYWHERE,
    EFFECTS,
    JOINT_ACTIONS,
    PAPER,
    POWERED,
    ROBOTS,
    ROLES,
    ActionDurations,
    Journey,
    Position,
    Room,
    Ward,
    WardMember,
    drawn_problems,
    length,
)
from socialbot.agents.teams.messages import CANCELLED, PARTNER_ABSENT, ActionResult
from socialbot.agents.teams.world import Activity
from socialbot.core.clock import nanoseconds

PATIENCE_S = 10.0
"""Longest wait of a joint action for the other partner."""
DRAINED = 0.1
"""Charge of a drained battery."""
CHARGE_STEP = 0.1
"""Step of a charge."""


@dataclass
class WardActivity(Activity):
    """An action in progress, or one that waits for a partner; ``then`` continues it when it is due."""

    then: Callable[[], None] = lambda: None

    @property
    def waits(self) -> bool:
        return self.action in JOINT_ACTIONS and len(self.ids) < len(self.args)


@dataclass
class WardAgent:
    """State of a robot or a nurse."""

    member: WardMember
    place: str
    position: Position
    chance: random.Random
    inside: bool = True
    battery: float = 1.0
    activity: WardActivity | None = None
    journey: Journey | None = None
    outdated: set[str] = field(default_factory=set, repr=False)
    """Names of agents whose shown state has changed; shared by all agents of a ward."""

    def __setattr__(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)
        if name != "outdated":
            self.__dict__.get("outdated", set()).add(self.member.name)

    def goal(self, time: int) -> Position:
        """Where its way leads it at ``time``."""
        return self.journey.left(time)[0] if self.journey else self.position

    def at(self, time: int) -> Position:
        """Where it is at ``time``."""
        return self.goal(time)

    def state(self, time: int) -> AgentState:
        """Value of its sensor."""
        position = self.at(time)
        return AgentState(
            name=self.member.name,
            kind=self.member.kind,
            home=self.member.home,
            place=self.place,
            inside=self.inside,
            x=round(position.x, 3),
            y=round(position.y, 3),
            battery=round(self.battery, 4),
            busy=str(self.activity or ""),
        )


class WardWorld(SimulatedWorld):
    """Simulated ward. Commands take effect at the time that `advance` reached.

    A robot stops before a closed door, and leaves a room through any. An action in a room takes place inside: an agent
    before an open door enters first. Docks are always open. A joint action begins with the command to the second
    partner. A person who enters stops ultraviolet light, a nurse who leaves the ward stops her action, and a robot with
    a low battery stops an action that needs power. Nurses use a screen in their rooms.

    ``rate`` is the percentage of infections with a problem, ``noise`` the largest relative deviation of durations, and
    ``start`` the time in ns. ``faults`` are added to the problems.
    """

    def __init__(
        self,
        ward: Ward,
        *,
        seed: int = 0,
        rate: float = 0.0,
        noise: float = 0.0,
        faults: Sequence[WorldFault] = (),
        durations: ActionDurations = PAPER,
        start: int = 0,
    ) -> None:
        super().__init__(start)
        self.ward = ward
        self.durations = durations
        self.noise = noise
        self.problems = drawn_problems(ward, seed, rate)
        self._prepare((*self.problems, *faults))
        self.rooms = {
            room.name: RoomState(name=room.name, door_open=room.name not in ward.closed, cleaned=True, disinfected=True)
            for room in ward.rooms
        }
        self.agents: dict[str, WardAgent] = {}
        self._outdated: set[str] = set()
        for member in ward.members:
            home, chance = ward.room_by_name[member.home], random.Random(f"ward {seed} {member.name}")
            self.agents[member.name] = self._new_agent(member, home, chance)
        self._shown = {name: agent.state(start) for name, agent in self.agents.items()}
        """Latest values of the sensors of agents."""
        self.changes = 0
        """Number of changes of rooms and agents, without movements."""
        self._results: list[ActionResult] = []
        self._people = itertools.count(1)
        self._faulty: dict[tuple[str, str], int] = {}
        for time_s, room in ward.infections:
            self.after(time_s, lambda room=room: self.change_room(room, disinfected=False))
        for fault in (*self.problems, *faults):
            self.after(fault.time_s, lambda fault=fault: self._apply_fault(fault))
        self.advance(start)

    def _prepare(self, faults: Sequence[WorldFault]) -> None:
        """Called before the agents are made, with all faults of the run."""

    def _new_agent(self, member: WardMember, home: Room, chance: random.Random) -> WardAgent:
        return WardAgent(member, home.name, home.centre, chance, outdated=self._outdated)

    # Commands

    def command(self, id: str, robot: str, action: str, args: tuple[str, ...]) -> None:
        """Start an action of a robot or nurse; `take_results` returns its result, now or later."""
        if refusal := self._refusal(robot, action, args):
            self._results += Activity(action, args, {robot: (id, self.now)}).results(self.now, refusal)
            return
        activities = (self.agents[name].activity for name in args if name in self.agents)
        waiting = (each for each in activities if each and each.waits and (each.action, each.args) == (action, args))
        activity = self.agents[robot].activity = next(waiting, None) or WardActivity(action, args)
        activity.ids[robot] = (id, self.now)
        self.changes += 1
        self._begin(activity)
        self.advance(self.now)

    def cancel(self, id: str) -> None:
        """Cancel the command with this id. The partner of a joint action in progress stops as well."""
        for agent in self.agents.values():
            if agent.activity and id in (found for found, _ in agent.activity.ids.values()):
                self._end(agent.activity, CANCELLED)

    def take_results(self) -> tuple[ActionResult, ...]:
        """The results since the last call."""
        taken, self._results = tuple(self._results), []
        return taken

    def _refusal(self, robot: str, action: str, args: tuple[str, ...]) -> str:
        roles = ROLES.get(action)
        if robot not in self.agents:
            return f"there is no {robot!r}"
        if roles is None:
            return f"there is no action {action!r}"
        if len(args) != len(roles) or not all(map(self._plays, args, roles)):
            return f"{action} takes {', '.join(roles)}, not {', '.join(args) or 'nothing'}"
        if robot not in (args if action in JOINT_ACTIONS else args[:1]):
            return f"{robot} cannot execute an action of {args[0]}"
        activity = self.agents[robot].activity
        return f"{robot} is busy with {activity}" if activity else ""

    def _plays(self, name: str, role: str) -> bool:
        if role == "room":
            return name in self.rooms
        if name not in self.agents:
            return False
        kind = self.agents[name].member.kind
        return role in ("agent", kind) or (role == "robot" and kind in ROBOTS)

    # State

    def is_faulty(self, fault: Literal["silent", "slow"], sensor: str) -> bool:
        """Whether the sensor of a room, robot or nurse, or `STATE_SENSOR`, has this fault."""
        return self.now < self._faulty.get((fault, sensor), self.now)

    @property
    def has_faulty_sensors(self) -> bool:
        """Whether a sensor is silent or slow now."""
        return any(self.now < until for until in self._faulty.values())

    def state(self) -> WardState:
        """True state of the ward, independent of its sensors."""
        for name in tuple(self._outdated):
            agent = self.agents[name]
            self._shown[name] = agent.state(self.now)
            if agent.journey is None:
                self._outdated.discard(name)
        return WardState(stamp=self.now, rooms=tuple(self.rooms.values()), agents=tuple(self._shown.values()))

    def change_room(self, room: str, **changes: Any) -> None:
        """Change the state of a room."""
        self.rooms[room] = msgspec.structs.replace(self.rooms[room], **changes)
        self.changes += 1

    # Actions

    def _begin(self, activity: WardActivity) -> None:
        """Start an activity if its conditions hold: with the wait for a partner, then the path, then the work."""
        agent = self.agents[activity.args[0]]
        if agent.battery < LOW_AT and activity.action in POWERED and agent.member.kind in ROBOTS:
            self._end(activity, LOW_BATTERY)
        elif reason := self._obstacle(activity):
            self._end(activity, reason)
        elif activity.waits:
            self._later(activity, PATIENCE_S, lambda: self._end(activity, PARTNER_ABSENT))
        elif activity.action in ("a_navigate_to", "a_charge"):
            self._depart(activity, agent)
        else:
            way_s = max((self._go_in(self.agents[name]) for name in self._inside(activity)), default=0.0)
            self._later(activity, way_s + self._seconds(agent, activity.action), lambda: self._do(activity))

    def _inside(self, activity: WardActivity) -> tuple[str, ...]:
        """The agents that have to be inside the room: none for a door or a radio message."""
        return () if activity.action == "a_open_door" or activity.action in ANYWHERE else tuple(activity.ids)

    def _obstacle(self, activity: WardActivity) -> str:
        """The reason why the action cannot be executed; checked at its start and at its end."""
        absent = [name for name in activity.args if name in self.agents and self.agents[name].place == AWAY]
        if absent and activity.action != "a_navigate_to":
            return NURSE_ABSENT
        if activity.waits or activity.action in ANYWHERE:
            return ""
        first, last = activity.args[0], activity.args[-1]
        room = last if last in self.rooms else self.agents[last].place
        if room not in self.rooms or self.agents[first].place != room:
            return f"{first} is not at {room if room in self.rooms else last}"
        if not self.rooms[room].door_open and not all(self.agents[name].inside for name in self._inside(activity)):
            return CLOSED_DOOR
        if activity.action == "a_disinfect_room":
            return self._unfit(room)
        return ""

    def _unfit(self, room: str) -> str:
        """The reason why a room cannot be disinfected, or an empty string."""
        if not self.rooms[room].cleaned:
            return DIRTY_ROOM
        return PERSON_IN_ROOM if self.rooms[room].people else ""

    def _do(self, activity: WardActivity) -> None:
        """Complete an action with its effects."""
        room, reason = activity.args[-1], self._obstacle(activity)
        if not reason:
            for name in activity.args:
                if name in self.agents:
                    self._discharge(self.agents[name], self.durations.battery_of.get(activity.action, 0.0))
            if activity.action == "a_patrol_room":
                reason = self._unfit(room)
            elif activity.action in EFFECTS:
                self.change_room(room, **EFFECTS[activity.action])
        self._end(activity, reason)

    def _depart(self, activity: WardActivity, agent: WardAgent) -> None:
        """Move to the entrance of a room, or of the nearest dock."""
        is_charge = activity.action == "a_charge"
        if agent.inside and (agent.place in self.ward.docks if is_charge else agent.place == activity.args[1]):
            self._arrive(activity, agent)
            return
        if agent.place == AWAY:
            agent.position = self.ward.room_by_name[agent.member.home].entrance
        room = agent.place if agent.inside else ""
        if is_charge:
            target, points = self.ward.way_to_dock(agent.position, room)
        else:
            target = activity.args[1]
            points = self.ward.way(agent.position, room, target)
        agent.place, agent.inside = CORRIDOR, False
        seconds = self._travel(agent, points)
        self._later(activity, seconds, lambda: self._reach_door(activity, agent, target))

    def _reach_door(self, activity: WardActivity, agent: WardAgent, target: str) -> None:
        self._stop(agent)
        agent.place = target
        self.changes += 1
        if self.rooms[target].door_open or target in self.ward.docks:
            seconds = self._go_in(agent)
            self._later(activity, seconds, lambda: self._arrive(activity, agent))
        else:
            self._end(activity, "")

    def _arrive(self, activity: WardActivity, agent: WardAgent) -> None:
        self._stop(agent)
        if activity.action == "a_charge" and agent.battery < 1.0:
            step = min(CHARGE_STEP, 1.0 - agent.battery)
            self._later(activity, step * self._seconds(agent, "a_charge"), lambda: self._fill(activity, agent, step))
        else:
            self._end(activity, "")

    def _fill(self, activity: WardActivity, agent: WardAgent, step: float) -> None:
        """Charge the battery by a step; a cancelled charge keeps its steps."""
        agent.battery = min(round(agent.battery + step, 6), 1.0)
        self.changes += 1
        self._arrive(activity, agent)

    def _go_in(self, agent: WardAgent) -> float:
        """Move an agent inside from the entrance; returns the duration (s)."""
        if agent.inside:
            return 0.0
        agent.inside = True
        self.changes += 1
        room = self.ward.room_by_name[agent.place]
        return self._travel(agent, (agent.position, room.door, room.centre))

    def _travel(self, agent: WardAgent, points: tuple[Position, ...]) -> float:
        """Start a movement along ``points``; returns its duration (s)."""
        seconds = (
            length(points) / self.durations.speed * self._factor(agent) if self.durations.speed < math.inf else 0.0
        )
        agent.journey = Journey(points, self.now, self.now + nanoseconds(seconds))
        return seconds

    def _stop(self, agent: WardAgent) -> None:
        """End a movement at the present position, and discharge the battery for the distance covered."""
        if agent.journey is None:
            return
        agent.position = agent.at(self.now)
        self._discharge(agent, agent.journey.made(self.now) * self.durations.battery_per_m)
        agent.journey = None
        if agent.place == CORRIDOR and (room := self.ward.room_at(agent.position)):
            agent.place, agent.inside = room, True

    def _discharge(self, agent: WardAgent, amount: float) -> None:
        if agent.member.kind in ROBOTS:
            agent.battery = max(agent.battery - amount, 0.0)

    def _end(self, activity: WardActivity, reason: str) -> None:
        """End an activity for all its agents; an empty reason means success."""
        activity.over = True
        for name in activity.ids:
            agent = self.agents[name]
            self._stop(agent)
            agent.activity = None
        self._results += activity.results(self.now, reason)
        self.changes += 1

    # Events

    def _later(self, activity: WardActivity, seconds: float, then: Callable[[], None]) -> None:
        """Continue an activity after ``seconds``, unless it has ended or was postponed."""
        activity.due, activity.then = self.now + nanoseconds(seconds), then
        self._arm(activity)

    def _arm(self, activity: WardActivity) -> None:
        def happen(due: int = activity.due) -> None:
            if not activity.over and activity.due == due:
                activity.due = -1
                activity.then()

        self.at(activity.due, happen)

    def _factor(self, agent: WardAgent) -> float:
        return 1.0 + agent.chance.uniform(-self.noise, self.noise)

    def _seconds(self, agent: WardAgent, action: str) -> float:
        return self.durations.seconds.get(action, 0.0) * self._factor(agent)

    def _apply_fault(self, fault: WorldFault) -> None:
        self.changes += 1
        seconds = fault.duration_s or 0.0
        match fault.kind:
            case "dirty":
                self.change_room(fault.target, cleaned=False)
            case "closes":
                self.change_room(fault.target, door_open=False)
            case "drains":
                self._drain(self.agents[fault.target])
            case "enters":
                self._person_enters(fault.target, seconds)
            case "leaves":
                self._nurse_leaves(self.agents[fault.target], seconds)
            case "stalls":
                self._stall(self.agents[fault.target], nanoseconds(seconds))
            case "silent" | "slow":
                until, key = self.now + nanoseconds(seconds), (fault.kind, fault.target)
                self._faulty[key] = max(until, self._faulty.get(key, 0))
                self.at(until, self._changed)

    def _changed(self) -> None:
        self.changes += 1

    def _drain(self, agent: WardAgent) -> None:
        agent.battery = min(agent.battery, DRAINED)
        if agent.activity and agent.activity.action in POWERED:
            self._end(agent.activity, LOW_BATTERY)

    def _person_enters(self, room: str, seconds: float) -> None:
        person = f"person{next(self._people)}"
        self.change_room(room, people=tuple(sorted((*self.rooms[room].people, person))))
        for agent in self.agents.values():
            if agent.activity and agent.activity.action == "a_disinfect_room" and agent.activity.args[-1] == room:
                self._end(agent.activity, PERSON_IN_ROOM)

        def walk_out() -> None:
            people = self.rooms[room].people
            if person in people:
                self.change_room(room, people=tuple(name for name in people if name != person))

        self.after(seconds, walk_out)

    def _nurse_leaves(self, nurse: WardAgent, seconds: float) -> None:
        if nurse.activity:
            self._end(nurse.activity, NURSE_ABSENT)
        nurse.place, nurse.inside = AWAY, False

        def come_back() -> None:
            if nurse.place == AWAY:
                nurse.place, nurse.inside = nurse.member.home, True
                nurse.position = self.ward.room_by_name[nurse.member.home].centre
                self.changes += 1

        self.after(seconds, come_back)

    def _stall(self, agent: WardAgent, pause: int) -> None:
        """Postpone the activity of an agent and its partners."""
        activity = agent.activity
        if activity is None or activity.waits:
            return
        for name in activity.ids:
            agent, journey = self.agents[name], self.agents[name].journey
            if journey and self.now < journey.end:
                self._discharge(agent, journey.made(self.now) * self.durations.battery_per_m)
                begin = max(self.now, journey.begin) + pause
                agent.journey = Journey(journey.left(self.now), begin, journey.end + pause)
        activity.due += pause
        self._arm(activity)
