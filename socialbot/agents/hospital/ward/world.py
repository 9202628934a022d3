"""Simulated ward: executes the actions of robots and nurses, the same for the same seed and commands."""

from __future__ import annotations

import heapq
import itertools
import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from socialbot.agents.hospital.ward.messages import (
    AWAY,
    CANCELLED,
    CLOSED_DOOR,
    CORRIDOR,
    DIRTY_ROOM,
    LOW_AT,
    LOW_BATTERY,
    NURSE_ABSENT,
    PARTNER_ABSENT,
    PERSON_IN_ROOM,
    ActionResult,
    AgentState,
    RoomState,
    WardState,
)
from socialbot.agents.hospital.ward.ward import (
    AT_ONCE,
    NURSE,
    PAPER,
    ROBOTS,
    SPOT,
    UVD,
    ActionDurations,
    Position,
    Ward,
    WardFault,
    WardMember,
    drawn_problems,
    length,
)
from socialbot.core.clock import SECOND, nanoseconds

ROLES: dict[str, tuple[str, ...]] = {
    "a_navigate_to": ("agent", "room"),
    "a_open_door": ("agent", "room"),
    "a_approach_nurse": (SPOT, NURSE),
    "a_authenticate_nurse": (SPOT, NURSE),
    "a_authorize_patrol": (SPOT, NURSE),
    "a_patrol_room": (SPOT, "room"),
    "a_adapt_room": (NURSE, "room"),
    "a_authorize_disinfect": (UVD, SPOT),
    "a_disinfect_room": (UVD, "room"),
    "a_charge": ("robot",),
    "a_infected_room": (NURSE, "room"),
}
"""What the arguments of each action have to be: a kind of agent, any ``agent``, any ``robot``, a ``room``."""
JOINT = frozenset({"a_authenticate_nurse", "a_authorize_patrol", "a_authorize_disinfect"})
"""Actions of both their arguments; all others are those of the first."""
POWERED = frozenset({"a_navigate_to", "a_patrol_room", "a_disinfect_room"})
"""What a robot does not do with a low battery."""


@dataclass
class Journey:
    """A way along ``points`` from ``begin`` to ``end`` (ns)."""

    points: tuple[Position, ...]
    begin: int
    end: int

    def position(self, time: int) -> Position:
        """Where one is at ``time``."""
        if time >= self.end:
            return self.points[-1]
        return self.left(time)[0]

    def made(self, time: int) -> float:
        """How much of the way is made at ``time``, m."""
        if time >= self.end:
            return length(self.points)
        return length(self.points) * max(time - self.begin, 0) / (self.end - self.begin)

    def left(self, time: int) -> tuple[Position, ...]:
        """The rest of the way at ``time``."""
        made = self.made(time)
        for number, (here, there) in enumerate(itertools.pairwise(self.points), start=1):
            whole = math.dist(here, there)
            if made < whole:
                share = made / whole
                turned = Position(here.x + (there.x - here.x) * share, here.y + (there.y - here.y) * share)
                return (turned, *self.points[number:])
            made -= whole
        return self.points[-1:]


@dataclass
class Activity:
    """An action under way, or one that waits for a partner. ``ids`` are command and time (ns) by who was told."""

    action: str
    args: tuple[str, ...]
    ids: dict[str, tuple[str, int]]
    due: int = -1
    then: Callable[[], None] = lambda: None
    over: bool = False

    @property
    def waits(self) -> bool:
        """Whether a partner is still missing."""
        return self.action in JOINT and len(self.ids) < len(self.args)

    def __str__(self) -> str:
        return f"{self.action}({', '.join(self.args)})"


@dataclass
class WardAgent:
    """A robot or a nurse as it is now."""

    member: WardMember
    place: str
    position: Position
    chance: random.Random
    inside: bool = True
    battery: float = 1.0
    activity: Activity | None = None
    journey: Journey | None = None
    _shown: tuple[tuple[object, ...], AgentState] | None = None
    """What its sensor said last, and because of what."""

    def at(self, time: int) -> Position:
        """Where it is."""
        return self.journey.position(time) if self.journey else self.position

    def state(self, time: int) -> AgentState:
        """What its sensor says; the very same as before if that has not changed, as it mostly has not."""
        position = self.at(time)
        because = (self.place, self.inside, position, self.battery, self.activity)
        if self._shown is None or self._shown[0] != because:
            state = AgentState(
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
            self._shown = because, state
        return self._shown[1]


@dataclass
class RoomModel:
    """A room as it is now."""

    door_open: bool = True
    cleaned: bool = True
    disinfected: bool = True
    people: list[str] = field(default_factory=list)
    _shown: tuple[tuple[object, ...], RoomState] | None = None
    """What its sensor said last, and because of what."""

    def state(self, name: str) -> RoomState:
        """What the sensor of the room called ``name`` says; the very same as before if that has not changed."""
        because = (name, self.door_open, self.cleaned, self.disinfected, *self.people)
        if self._shown is None or self._shown[0] != because:
            state = RoomState(
                name=name,
                door_open=self.door_open,
                cleaned=self.cleaned,
                disinfected=self.disinfected,
                people=tuple(sorted(self.people)),
            )
            self._shown = because, state
        return self._shown[1]


PATIENCE_S = 10.0
"""So long a joint action waits for the other partner."""
DRAINED = 0.1
"""What is left in a battery that drains."""
CHARGE_STEP = 0.1
"""A battery fills by so much at a time."""


class WardWorld:
    """The world with its clock: `advance` lets time pass, commands act at the time reached.

    ``rate`` is the percentage of infections that meet a problem. ``noise`` is by how much durations differ from those
    of ``pace``, at most (0.1 is 10 %). Times are ns; the world begins at ``start``.
    """

    def __init__(
        self,
        ward: Ward,
        *,
        seed: int = 0,
        rate: float = 0.0,
        noise: float = 0.0,
        faults: Sequence[WardFault] = (),
        pace: ActionDurations = PAPER,
        start: int = 0,
    ) -> None:
        self.ward = ward
        self.pace = pace
        self.noise = noise
        self.now = start
        self.problems = drawn_problems(ward, seed, rate)
        """What was drawn to go wrong."""
        self.rooms = {room.name: RoomModel(door_open=room.name not in ward.closed) for room in ward.rooms}
        self.agents = {
            member.name: WardAgent(
                member,
                member.home,
                ward.room_by_name[member.home].centre,
                random.Random(f"ward {seed} {member.name}"),
            )
            for member in ward.members
        }
        self.changes = 0
        """Counts changes of rooms and agents; moving along is none."""
        self._results: list[ActionResult] = []
        self._people = itertools.count(1)
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._sequence = itertools.count()
        self._faulty: dict[tuple[str, str], int] = {}
        for time_s, room in ward.infections:
            self._after(time_s, lambda room=room: self._infect(room))
        for fault in (*self.problems, *faults):
            self._after(fault.time_s, lambda fault=fault: self._go_wrong(fault))
        self.advance(start)

    def advance(self, time: int) -> None:
        """Lets time pass until ``time`` (ns); nothing happens when that is past."""
        while self._events and self._events[0][0] <= time:
            due, _, happen = heapq.heappop(self._events)
            self.now = max(self.now, due)
            happen()
        self.now = max(self.now, time)

    @property
    def next_event(self) -> int | None:
        """When something may happen next, ns, if nobody commands anything."""
        return self._events[0][0] if self._events else None

    # Commands

    def command(self, id: str, robot: str, action: str, args: tuple[str, ...]) -> None:
        """Tells a robot or nurse what to do; `take_results` tells what became of it, now or later."""
        if refusal := self._refusal(robot, action, args):
            self._report(id, robot, action, args, self.now, refusal)
            return
        agent = self.agents[robot]
        agent.activity = activity = self._partners_task(robot, action, args) or Activity(action, args, {})
        activity.ids[robot] = (id, self.now)
        self.changes += 1
        self._begin(activity)
        self.advance(self.now)

    def cancel(self, id: str) -> None:
        """Takes back the command with this ``id``; the partner of a joint action that has begun stops as well."""
        for agent in self.agents.values():
            if agent.activity and id in (found for found, _ in agent.activity.ids.values()):
                self._end(agent.activity, CANCELLED)

    def take_results(self) -> tuple[ActionResult, ...]:
        """What became of commands since this was last asked."""
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
        if robot not in (args if action in JOINT else args[:1]):
            return f"{robot} cannot do what {args[0]} does"
        activity = self.agents[robot].activity
        return f"{robot} is busy with {activity}" if activity else ""

    def _plays(self, name: str, role: str) -> bool:
        if role == "room":
            return name in self.rooms
        if name not in self.agents:
            return False
        kind = self.agents[name].member.kind
        return role in ("agent", kind) or (role == "robot" and kind in ROBOTS)

    def _partners_task(self, robot: str, action: str, args: tuple[str, ...]) -> Activity | None:
        """The joint action for which the partner waits, if it is this one."""
        tasks = (self.agents[name].activity for name in args if name != robot and name in self.agents)
        return next(
            (
                activity
                for activity in tasks
                if activity and activity.waits and (activity.action, activity.args) == (action, args)
            ),
            None,
        )

    # Questions

    def is_silent(self, sensor: str) -> bool:
        """Whether the sensor of a room, robot or nurse, or `faults.STATE_SENSOR`, says nothing now."""
        return self.now < self._faulty.get(("silent", sensor), self.now)

    def is_slow(self, sensor: str) -> bool:
        """Whether such a sensor looks seldom now."""
        return self.now < self._faulty.get(("slow", sensor), self.now)

    def state(self) -> WardState:
        """The whole ward as it is now, whatever its sensors tell of it."""
        return WardState(
            stamp=self.now,
            rooms=tuple(self.room_state(name) for name in self.rooms),
            agents=tuple(self.agent_state(name) for name in self.agents),
        )

    def room_state(self, name: str) -> RoomState:
        """One room as it is now. Raises KeyError for one that is not there."""
        return self.rooms[name].state(name)

    def agent_state(self, name: str) -> AgentState:
        """One robot or nurse as it is now. Raises KeyError for one that is not there."""
        return self.agents[name].state(self.now)

    # Actions

    def _begin(self, activity: Activity) -> None:
        """Begins what nothing keeps from beginning: first comes the partner, then the way, then the work."""
        agent = self.agents[activity.args[0]]
        if agent.battery < LOW_AT and activity.action in POWERED and agent.member.kind in ROBOTS:
            self._end(activity, LOW_BATTERY)
        elif reason := self._hinders(activity):
            self._end(activity, reason)
        elif activity.waits:
            self._later(activity, PATIENCE_S, lambda: self._end(activity, PARTNER_ABSENT))
        elif activity.action in ("a_navigate_to", "a_charge"):
            self._set_out(activity, agent)
        else:
            way_s = max((self._go_in(self.agents[name]) for name in self._inside(activity)), default=0.0)
            self._later(activity, way_s + self._seconds(agent, activity.action), lambda: self._do(activity))

    def _inside(self, activity: Activity) -> tuple[str, ...]:
        """Who has to be in the room for it: nobody who only opens its door or talks by radio."""
        if activity.action in ("a_navigate_to", "a_open_door", "a_charge", "a_authorize_disinfect", "a_infected_room"):
            return ()
        return tuple(activity.ids)

    def _hinders(self, activity: Activity) -> str:
        """What keeps the action from being done, at its begin or, as it may have come up since, at its end."""
        absent = [name for name in activity.args if name in self.agents and self.agents[name].place == AWAY]
        if absent and activity.action != "a_navigate_to":
            return NURSE_ABSENT
        if activity.waits or activity.action in (
            "a_navigate_to",
            "a_charge",
            "a_authorize_disinfect",
            "a_infected_room",
        ):
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
        """Why a room is not fit to be disinfected, or an empty string."""
        if not self.rooms[room].cleaned:
            return DIRTY_ROOM
        return PERSON_IN_ROOM if self.rooms[room].people else ""

    def _do(self, activity: Activity) -> None:
        """What the action brings about when its time has come."""
        room = self.rooms.get(activity.args[-1], RoomModel())
        reason = self._hinders(activity)
        if not reason:
            self._use_battery(activity)
            match activity.action:
                case "a_patrol_room":
                    reason = self._unfit(activity.args[-1])
                case "a_open_door":
                    room.door_open = True
                case "a_adapt_room":
                    room.cleaned = True
                    room.people.clear()
                case "a_disinfect_room":
                    room.disinfected = True
                case "a_infected_room":
                    room.disinfected = False
        self._end(activity, reason)

    def _set_out(self, activity: Activity, agent: WardAgent) -> None:
        """Goes to a room, or to the dock, by its entrance."""
        target = activity.args[1] if activity.action == "a_navigate_to" else self.ward.dock
        if agent.place == target and agent.inside:
            self._arrive(activity, agent)
            return
        if agent.place == AWAY:
            agent.position = self.ward.room_by_name[agent.member.home].entrance
        room = agent.place if agent.inside else ""
        points = self.ward.way(agent.position, room, target)
        agent.place, agent.inside = CORRIDOR, False
        seconds = self._travel(agent, points)
        self._later(activity, seconds, lambda: self._reach_door(activity, agent, target))

    def _reach_door(self, activity: Activity, agent: WardAgent, target: str) -> None:
        self._stop(agent)
        agent.place = target
        self.changes += 1
        if self.rooms[target].door_open or target == self.ward.dock:
            seconds = self._go_in(agent)
            self._later(activity, seconds, lambda: self._arrive(activity, agent))
        else:
            self._end(activity, "")

    def _arrive(self, activity: Activity, agent: WardAgent) -> None:
        self._stop(agent)
        if activity.action == "a_charge" and agent.battery < 1.0:
            step = min(CHARGE_STEP, 1.0 - agent.battery)
            self._later(activity, step * self._seconds(agent, "a_charge"), lambda: self._fill(activity, agent, step))
        else:
            self._end(activity, "")

    def _fill(self, activity: Activity, agent: WardAgent, step: float) -> None:
        """Adds to the battery, bit by bit: who breaks off keeps what there is."""
        agent.battery = min(round(agent.battery + step, 6), 1.0)
        self.changes += 1
        self._arrive(activity, agent)

    def _go_in(self, agent: WardAgent) -> float:
        """Lets who stands before an open door go in; how long that takes (s)."""
        if agent.inside:
            return 0.0
        agent.inside = True
        self.changes += 1
        room = self.ward.room_by_name[agent.place]
        return self._travel(agent, (agent.position, room.door, room.centre))

    def _travel(self, agent: WardAgent, points: tuple[Position, ...]) -> float:
        """Sets off along ``points``; how long it takes, s."""
        seconds = length(points) / self.pace.speed * self._factor(agent) if self.pace.speed < math.inf else 0.0
        agent.journey = Journey(points, self.now, self.now + nanoseconds(seconds))
        return seconds

    def _stop(self, agent: WardAgent) -> None:
        """Ends a journey where it is; a robot that stops on the way uses what power the way took."""
        if agent.journey is None:
            return
        agent.position = agent.at(self.now)
        self._discharge(agent, agent.journey.made(self.now) * self.pace.battery_per_m)
        agent.journey = None
        if agent.place == CORRIDOR and (room := self.ward.room_at(agent.position)):
            agent.place, agent.inside = room, True

    def _use_battery(self, activity: Activity) -> None:
        for name in activity.args:
            if name in self.agents:
                self._discharge(self.agents[name], self.pace.battery_of.get(activity.action, 0.0))

    def _discharge(self, agent: WardAgent, amount: float) -> None:
        if agent.member.kind in ROBOTS:
            agent.battery = max(agent.battery - amount, 0.0)

    def _end(self, activity: Activity, reason: str) -> None:
        """Ends an action for all who do it; an empty ``reason`` says that it is done."""
        activity.over = True
        for name, (id, begin) in activity.ids.items():
            agent = self.agents[name]
            self._stop(agent)
            agent.activity = None
            self._report(id, name, activity.action, activity.args, begin, reason)
        self.changes += 1

    def _report(self, id: str, robot: str, action: str, args: tuple[str, ...], begin: int, reason: str) -> None:
        self._results.append(
            ActionResult(
                stamp=self.now,
                id=id,
                robot=robot,
                action=action,
                args=args,
                outcome="failure" if reason else "success",
                reason=reason,
                duration_s=(self.now - begin) / SECOND,
            )
        )

    # What happens

    def _at(self, time: int, happen: Callable[[], None]) -> None:
        heapq.heappush(self._events, (time, next(self._sequence), happen))

    def _after(self, seconds: float, happen: Callable[[], None]) -> None:
        self._at(self.now + nanoseconds(seconds), happen)

    def _later(self, activity: Activity, seconds: float, then: Callable[[], None]) -> None:
        """Lets an action go on after ``seconds``, unless it has ended or was put off."""
        activity.due, activity.then = self.now + nanoseconds(seconds), then
        self._arm(activity)

    def _arm(self, activity: Activity) -> None:
        def happen(due: int = activity.due) -> None:
            if not activity.over and activity.due == due:
                activity.due = -1
                activity.then()

        self._at(activity.due, happen)

    def _factor(self, agent: WardAgent) -> float:
        return 1.0 + agent.chance.uniform(-self.noise, self.noise)

    def _seconds(self, agent: WardAgent, action: str) -> float:
        return self.pace.seconds.get(action, AT_ONCE) * self._factor(agent)

    def _infect(self, room: str) -> None:
        self.rooms[room].disinfected = False
        self.changes += 1

    def _go_wrong(self, fault: WardFault) -> None:
        self.changes += 1
        match fault.kind:
            case "dirty":
                self.rooms[fault.who].cleaned = False
            case "closes":
                self.rooms[fault.who].door_open = False
            case "drains":
                self._drain(self.agents[fault.who])
            case "enters":
                self._walk_in(fault.who, fault.duration_s)
            case "leaves":
                self._call_away(self.agents[fault.who], fault.duration_s)
            case "stalls":
                self._stall(self.agents[fault.who], nanoseconds(fault.duration_s))
            case "silent" | "slow":
                until, key = self.now + nanoseconds(fault.duration_s), (fault.kind, fault.who)
                self._faulty[key] = max(until, self._faulty.get(key, 0))
                self._at(until, self._changed)

    def _changed(self) -> None:
        self.changes += 1

    def _drain(self, agent: WardAgent) -> None:
        agent.battery = min(agent.battery, DRAINED)
        if agent.activity and agent.activity.action in POWERED:
            self._end(agent.activity, LOW_BATTERY)

    def _walk_in(self, room: str, seconds: float) -> None:
        person = f"person{next(self._people)}"
        people = self.rooms[room].people
        people.append(person)
        for agent in self.agents.values():
            if agent.activity and agent.activity.action == "a_disinfect_room" and agent.activity.args[-1] == room:
                self._end(agent.activity, PERSON_IN_ROOM)

        def walk_out() -> None:
            if person in people:
                people.remove(person)
                self.changes += 1

        self._after(seconds, walk_out)

    def _call_away(self, nurse: WardAgent, seconds: float) -> None:
        if nurse.activity:
            self._end(nurse.activity, NURSE_ABSENT)
        nurse.place, nurse.inside = AWAY, False

        def come_back() -> None:
            if nurse.place == AWAY:
                nurse.place, nurse.inside = nurse.member.home, True
                nurse.position = self.ward.room_by_name[nurse.member.home].centre
                self.changes += 1

        self._after(seconds, come_back)

    def _stall(self, agent: WardAgent, pause: int) -> None:
        """Puts off what the agent does; partners of a joint action wait."""
        activity = agent.activity
        if activity is None or activity.waits:
            return
        for name in activity.ids:
            self._pause(self.agents[name], pause)
        activity.due += pause
        self._arm(activity)

    def _pause(self, agent: WardAgent, pause: int) -> None:
        """Lets an agent on its way stand for a while (ns) before it makes the rest of it."""
        journey = agent.journey
        if journey and self.now < journey.end:
            self._discharge(agent, journey.made(self.now) * self.pace.battery_per_m)
            agent.journey = Journey(journey.left(self.now), max(self.now, journey.begin) + pause, journey.end + pause)
