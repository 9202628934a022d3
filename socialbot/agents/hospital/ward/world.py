"""The ward as it really is: carries out what robots and nurses do, the same for the same seed and commands.

A robot that comes to a closed door stands before it. Whatever is done in a room is done inside: who stands before an
open door goes in first. Out one always gets, and into the dock. Joint actions begin when both partners are told to do
them. A person who walks in stops ultraviolet light at once; a nurse who is called away leaves what she does, a robot
whose battery is low what takes power. Nurses have a screen in their rooms.
"""

from __future__ import annotations

import heapq
import itertools
import math
import random
from collections.abc import Callable, Sequence

from socialbot.agents.hospital.ward.agents import JOINT, POWERED, ROLES, Agent, Journey, RoomNow, Task
from socialbot.agents.hospital.ward.faults import Fault, drawn_problems
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
from socialbot.agents.hospital.ward.ward import AT_ONCE, PAPER, ROBOTS, Pace, Point, Ward, length
from socialbot.core.clock import SECOND, nanoseconds

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
        faults: Sequence[Fault] = (),
        pace: Pace = PAPER,
        start: int = 0,
    ) -> None:
        self.ward = ward
        self.pace = pace
        self.noise = noise
        self.now = start
        self.problems = drawn_problems(ward, seed, rate)
        """What was drawn to go wrong."""
        self.rooms = {room.name: RoomNow(door_open=room.name not in ward.closed) for room in ward.rooms}
        self.agents = {
            member.name: Agent(
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
        agent.task = task = self._partners_task(robot, action, args) or Task(action, args, {})
        task.ids[robot] = (id, self.now)
        self.changes += 1
        self._begin(task)
        self.advance(self.now)

    def cancel(self, id: str) -> None:
        """Takes back the command with this ``id``; the partner of a joint action that has begun stops as well."""
        for agent in self.agents.values():
            if agent.task and id in (found for found, _ in agent.task.ids.values()):
                self._end(agent.task, CANCELLED)

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
        task = self.agents[robot].task
        return f"{robot} is busy with {task}" if task else ""

    def _plays(self, name: str, role: str) -> bool:
        if role == "room":
            return name in self.rooms
        if name not in self.agents:
            return False
        kind = self.agents[name].member.kind
        return role in ("agent", kind) or (role == "robot" and kind in ROBOTS)

    def _partners_task(self, robot: str, action: str, args: tuple[str, ...]) -> Task | None:
        """The joint action for which the partner waits, if it is this one."""
        tasks = (self.agents[name].task for name in args if name != robot and name in self.agents)
        return next(
            (task for task in tasks if task and task.waits and (task.action, task.args) == (action, args)), None
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

    def _begin(self, task: Task) -> None:
        """Begins what nothing keeps from beginning: first comes the partner, then the way, then the work."""
        agent = self.agents[task.args[0]]
        if agent.battery < LOW_AT and task.action in POWERED and agent.member.kind in ROBOTS:
            self._end(task, LOW_BATTERY)
        elif reason := self._hinders(task):
            self._end(task, reason)
        elif task.waits:
            self._later(task, PATIENCE_S, lambda: self._end(task, PARTNER_ABSENT))
        elif task.action in ("a_navigate_to", "a_charge"):
            self._set_out(task, agent)
        else:
            way_s = max((self._go_in(self.agents[name]) for name in self._inside(task)), default=0.0)
            self._later(task, way_s + self._seconds(agent, task.action), lambda: self._do(task))

    def _inside(self, task: Task) -> tuple[str, ...]:
        """Who has to be in the room for it: nobody who only opens its door or talks by radio."""
        if task.action in ("a_navigate_to", "a_open_door", "a_charge", "a_authorize_disinfect", "a_infected_room"):
            return ()
        return tuple(task.ids)

    def _hinders(self, task: Task) -> str:
        """What keeps the action from being done, at its begin or, as it may have come up since, at its end."""
        absent = [name for name in task.args if name in self.agents and self.agents[name].place == AWAY]
        if absent and task.action != "a_navigate_to":
            return NURSE_ABSENT
        if task.waits or task.action in ("a_navigate_to", "a_charge", "a_authorize_disinfect", "a_infected_room"):
            return ""
        first, last = task.args[0], task.args[-1]
        room = last if last in self.rooms else self.agents[last].place
        if room not in self.rooms or self.agents[first].place != room:
            return f"{first} is not at {room if room in self.rooms else last}"
        if not self.rooms[room].door_open and not all(self.agents[name].inside for name in self._inside(task)):
            return CLOSED_DOOR
        if task.action == "a_disinfect_room":
            return self._unfit(room)
        return ""

    def _unfit(self, room: str) -> str:
        """Why a room is not fit to be disinfected, or an empty string."""
        if not self.rooms[room].cleaned:
            return DIRTY_ROOM
        return PERSON_IN_ROOM if self.rooms[room].people else ""

    def _do(self, task: Task) -> None:
        """What the action brings about when its time has come."""
        room = self.rooms.get(task.args[-1], RoomNow())
        reason = self._hinders(task)
        if not reason:
            self._use_battery(task)
            match task.action:
                case "a_patrol_room":
                    reason = self._unfit(task.args[-1])
                case "a_open_door":
                    room.door_open = True
                case "a_adapt_room":
                    room.cleaned = True
                    room.people.clear()
                case "a_disinfect_room":
                    room.disinfected = True
                case "a_infected_room":
                    room.disinfected = False
        self._end(task, reason)

    def _set_out(self, task: Task, agent: Agent) -> None:
        """Goes to a room, or to the dock, by its entrance."""
        target = task.args[1] if task.action == "a_navigate_to" else self.ward.dock
        if agent.place == target and agent.inside:
            self._arrive(task, agent)
            return
        if agent.place == AWAY:
            agent.position = self.ward.room_by_name[agent.member.home].entrance
        room = agent.place if agent.inside else ""
        points = self.ward.way(agent.position, room, target)
        agent.place, agent.inside = CORRIDOR, False
        seconds = self._travel(agent, points)
        self._later(task, seconds, lambda: self._reach_door(task, agent, target))

    def _reach_door(self, task: Task, agent: Agent, target: str) -> None:
        self._stop(agent)
        agent.place = target
        self.changes += 1
        if self.rooms[target].door_open or target == self.ward.dock:
            seconds = self._go_in(agent)
            self._later(task, seconds, lambda: self._arrive(task, agent))
        else:
            self._end(task, "")

    def _arrive(self, task: Task, agent: Agent) -> None:
        self._stop(agent)
        if task.action == "a_charge" and agent.battery < 1.0:
            step = min(CHARGE_STEP, 1.0 - agent.battery)
            self._later(task, step * self._seconds(agent, "a_charge"), lambda: self._fill(task, agent, step))
        else:
            self._end(task, "")

    def _fill(self, task: Task, agent: Agent, step: float) -> None:
        """Adds to the battery, bit by bit: who breaks off keeps what there is."""
        agent.battery = min(round(agent.battery + step, 6), 1.0)
        self.changes += 1
        self._arrive(task, agent)

    def _go_in(self, agent: Agent) -> float:
        """Lets who stands before an open door go in; how long that takes (s)."""
        if agent.inside:
            return 0.0
        agent.inside = True
        self.changes += 1
        room = self.ward.room_by_name[agent.place]
        return self._travel(agent, (agent.position, room.door, room.centre))

    def _travel(self, agent: Agent, points: tuple[Point, ...]) -> float:
        """Sets off along ``points``; how long it takes, s."""
        seconds = length(points) / self.pace.speed * self._factor(agent) if self.pace.speed < math.inf else 0.0
        agent.journey = Journey(points, self.now, self.now + nanoseconds(seconds))
        return seconds

    def _stop(self, agent: Agent) -> None:
        """Ends a journey where it is; a robot that stops on the way uses what power the way took."""
        if agent.journey is None:
            return
        agent.position = agent.at(self.now)
        self._discharge(agent, agent.journey.made(self.now) * self.pace.battery_per_m)
        agent.journey = None
        if agent.place == CORRIDOR and (room := self.ward.room_at(agent.position)):
            agent.place, agent.inside = room, True

    def _use_battery(self, task: Task) -> None:
        for name in task.args:
            if name in self.agents:
                self._discharge(self.agents[name], self.pace.battery_of.get(task.action, 0.0))

    def _discharge(self, agent: Agent, amount: float) -> None:
        if agent.member.kind in ROBOTS:
            agent.battery = max(agent.battery - amount, 0.0)

    def _end(self, task: Task, reason: str) -> None:
        """Ends an action for all who do it; an empty ``reason`` says that it is done."""
        task.over = True
        for name, (id, begin) in task.ids.items():
            agent = self.agents[name]
            self._stop(agent)
            agent.task = None
            self._report(id, name, task.action, task.args, begin, reason)
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

    def _later(self, task: Task, seconds: float, then: Callable[[], None]) -> None:
        """Lets an action go on after ``seconds``, unless it has ended or was put off."""
        task.due, task.then = self.now + nanoseconds(seconds), then
        self._arm(task)

    def _arm(self, task: Task) -> None:
        def happen(due: int = task.due) -> None:
            if not task.over and task.due == due:
                task.due = -1
                task.then()

        self._at(task.due, happen)

    def _factor(self, agent: Agent) -> float:
        return 1.0 + agent.chance.uniform(-self.noise, self.noise)

    def _seconds(self, agent: Agent, action: str) -> float:
        return self.pace.seconds.get(action, AT_ONCE) * self._factor(agent)

    def _infect(self, room: str) -> None:
        self.rooms[room].disinfected = False
        self.changes += 1

    def _go_wrong(self, fault: Fault) -> None:
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

    def _drain(self, agent: Agent) -> None:
        agent.battery = min(agent.battery, DRAINED)
        if agent.task and agent.task.action in POWERED:
            self._end(agent.task, LOW_BATTERY)

    def _walk_in(self, room: str, seconds: float) -> None:
        person = f"person{next(self._people)}"
        people = self.rooms[room].people
        people.append(person)
        for agent in self.agents.values():
            if agent.task and agent.task.action == "a_disinfect_room" and agent.task.args[-1] == room:
                self._end(agent.task, PERSON_IN_ROOM)

        def walk_out() -> None:
            if person in people:
                people.remove(person)
                self.changes += 1

        self._after(seconds, walk_out)

    def _call_away(self, nurse: Agent, seconds: float) -> None:
        if nurse.task:
            self._end(nurse.task, NURSE_ABSENT)
        nurse.place, nurse.inside = AWAY, False

        def come_back() -> None:
            if nurse.place == AWAY:
                nurse.place, nurse.inside = nurse.member.home, True
                nurse.position = self.ward.room_by_name[nurse.member.home].centre
                self.changes += 1

        self._after(seconds, come_back)

    def _stall(self, agent: Agent, pause: int) -> None:
        """Puts off what the agent does; partners of a joint action wait."""
        task = agent.task
        if task is None or task.waits:
            return
        for name in task.ids:
            self._pause(self.agents[name], pause)
        task.due += pause
        self._arm(task)

    def _pause(self, agent: Agent, pause: int) -> None:
        """Lets an agent on its way stand for a while (ns) before it makes the rest of it."""
        journey = agent.journey
        if journey and self.now < journey.end:
            self._discharge(agent, journey.made(self.now) * self.pace.battery_per_m)
            agent.journey = Journey(journey.left(self.now), max(self.now, journey.begin) + pause, journey.end + pause)
