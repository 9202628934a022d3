"""Programs, actions and joint actions of the robots and nurses of a hospital."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from socialbot.agents.hospital.missions import JOINT_ACTIONS
from socialbot.agents.hospital.ward.messages import AgentState
from socialbot.bdi import Action, Engine, Sensor
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.durative_actions import LongAction
from socialbot.bdi.intentions import Failed
from socialbot.bdi.library import CompiledPlan
from socialbot.bdi.literals import Change, Event, Literal, literal, literal_from_key
from socialbot.bdi.plans import Plan
from socialbot.bdi.society import Society
from socialbot.bdi.terms import Atom, Variable
from socialbot.core.clock import Clock

if TYPE_CHECKING:
    from socialbot.agents.hospital.robot_node import HospitalAgent


PROGRAMS = Path(__file__).parent
ACTIONS = (
    "a_navigate_to", "a_open_door", "a_approach_nurse", "a_authenticate_nurse", "a_authorize_patrol", "a_patrol_room",
    "a_adapt_room", "a_authorize_disinfect", "a_disinfect_room", "a_charge",
)  # fmt: skip
OF_A_MISSION = ("milestone", "trigger_", "initial_trigger_", "start", "tried")
"""Prefixes of beliefs that end with a mission."""


def program(kind: str) -> str:
    """The AgentSpeak program of ``spot``, ``uvd`` or ``nurse``."""
    return (PROGRAMS / f"{kind}.asl").read_text("utf-8")


def names_of(args: Iterable[object]) -> tuple[str, ...]:
    """Arguments of an action as names."""
    return tuple(arg.name if isinstance(arg, Atom) else str(arg) for arg in args)


def as_literal(action: str, args: Iterable[str]) -> Literal:
    """An action with its arguments as a term."""
    return literal(action, tuple(map(Atom, args)))


class WorldAction(LongAction):
    """An action that the world executes.

    Its result is an event for the plans of the mission and for recovery plans: ``success_a_open_door(...)`` or
    ``failure(a_open_door(...), Reason)``.
    """

    action: str
    arguments: tuple[str, ...]
    own = False
    """Whether the action is no part of the plan of the mission."""

    def start(self, *args: Any) -> None:
        self.action, self.arguments = self.functor, names_of(args)
        self.node.begin(self)

    def cancel(self) -> None:
        self.node.cancel_later(self)
        self.cancelled()

    @property
    def node(self) -> HospitalAgent:
        return self.engine.robot

    @property
    def is_joint(self) -> bool:
        return self.action in JOINT_ACTIONS

    @property
    def key(self) -> tuple[str, tuple[str, ...]]:
        """Action and arguments."""
        return self.action, self.arguments

    def succeed(self) -> None:
        self.done()
        if not self.own:
            _happens(self.engine, literal(f"success_{self.action}", tuple(map(Atom, self.arguments))), self.id)

    def fail(self, reason: str) -> None:
        self.failed(reason)
        if not self.own:
            _happens(self.engine, literal("failure", (as_literal(self.action, self.arguments), reason)), self.id)


class again(WorldAction):  # noqa: N801 - its name in AgentSpeak
    """Repeat an action of the mission: ``again(a_open_door(spotrobot1, room1))``."""

    def start(self, *args: Any) -> None:
        (action,) = args
        self.action, self.arguments = action.functor, names_of(action.args)
        self.node.begin(self)


class by_myself(again):  # noqa: N801
    """Execute an action that is no part of the plan. Its failure is a problem for the coordinator."""

    own = True

    def fail(self, reason: str) -> None:
        self.failed(reason)
        self.node.report_problem(self.action, self.arguments, reason)


class problem(Action):  # noqa: N801
    """Report a problem to the coordinator: ``problem(Action, Reason)``."""

    def execute(self, action: Literal, reason: str) -> None:
        self.engine.robot.report_problem(action.functor, names_of(action.args), str(reason))


class end(Action):  # noqa: N801
    """Report the end of the part of this agent to the coordinator."""

    def execute(self) -> None:
        self.engine.robot.finish()


def _happens(engine: Engine, event: Literal, cause: str) -> None:
    engine.call(lambda: engine.interpreter.raise_event(Event(Change.ADDED, event), cause))


class Senses(Sensor):
    """Sensor for the place and the battery of the agent: ``at(room1)``, ``battery_low``."""

    def __init__(self) -> None:
        super().__init__()
        self._before: tuple[str, bool] | None = None

    def is_news(self, percept: AgentState) -> bool:
        """Whether the value changed since the last call."""
        before, self._before = self._before, (percept.place, percept.low_battery)
        return before != self._before

    def sense(self, percept: AgentState) -> Any:
        low = literal("battery_low")
        place = literal("at", (Atom(percept.place),))
        return [-literal("at", (Variable("_"),)), +place, +low if percept.low_battery else -low]


def install(engine: Engine, plans: Iterable[Plan]) -> list[CompiledPlan]:
    """Add plans of a mission, and return their uncompiled library entries."""
    new = list(plans)
    for plan in new:
        engine.add_rules(plan)
    return [ready for ready in all_plans(engine) if ready.plan in new]


def all_plans(engine: Engine) -> Iterator[CompiledPlan]:
    """The plans in the library of an agent."""
    for trigger in list(engine.library.triggers.values()):
        yield from trigger.plans


def mission_beliefs(engine: Engine) -> Iterator[Literal]:
    """Beliefs that belong to a mission."""
    for held in list(engine.beliefs):
        if held.belief.functor.startswith(OF_A_MISSION):
            yield held.belief


class RemoteSociety(Society):
    """A society with one local agent; beliefs for other agents go to ``tell_far`` (receiver, belief)."""

    def __init__(self, clock: Clock, send_remote: Callable[[str, str], object]) -> None:
        super().__init__(clock)
        self._send_remote = send_remote

    def find(self, receiver: Any) -> Engine:
        name = receiver.name if isinstance(receiver, Atom) else str(receiver)
        if name not in self.agents:
            self.agents[name] = _RemoteAgent(name, self.clock, self._send_remote)
        return self.agents[name]

    def tell(self, sender: Engine, receiver: Any, key: str, args: tuple[Any, ...], cause: Any) -> None:
        sender.messaging.send(receiver, "tell", literal_from_key(key, args), cause)


class _RemoteAgent(Engine):
    """Proxy for a remote agent: forwards the beliefs that it is told."""

    __slots__ = ()

    def __init__(self, name: str, clock: Clock, send_remote: Callable[[str, str], object]) -> None:
        super().__init__(name, clock)

        def take(sender: str, performative: str, content: Any) -> bool:
            if performative != "tell":
                raise Failed("action_failed", f"{name} is far away, and can only be told beliefs")
            send_remote(name, agentspeak(content))
            return False

        self.messaging.accepts = take

    def call(self, function: Callable[[], object]) -> None:
        function()


class Meeting(NamedTuple):
    """Key of a joint action: label of the plans, action and arguments."""

    label: str
    action: str
    args: tuple[str, ...]


@dataclass
class _Waiting:
    missing: set[str]
    met: Callable[[], None]


@dataclass
class Rendezvous:
    """Synchronizes the joint actions of one agent.

    ``ready`` announces the agent to a partner, ``done`` answers a partner that announced itself before.
    """

    ready: Callable[[str, Meeting], object]
    done: Callable[[str, Meeting], object]
    _waiting: dict[Meeting, _Waiting] = field(default_factory=dict)
    _there: dict[Meeting, set[str]] = field(default_factory=dict)

    def arrive(self, meeting: Meeting, partners: Iterable[str], met: Callable[[], None]) -> None:
        """Call ``met`` as soon as all partners have arrived."""
        there = self._there.pop(meeting, set())
        missing: set[str] = set()
        for partner in partners:
            if partner in there:
                self.done(partner, meeting)
            else:
                missing.add(partner)
                self.ready(partner, meeting)
        if missing:
            self._waiting[meeting] = _Waiting(missing, met)
        else:
            met()

    def partner_ready(self, partner: str, meeting: Meeting) -> None:
        """Process the announcement of a partner."""
        if meeting in self._waiting:
            self.done(partner, meeting)
            self._come(partner, meeting)
        else:
            self._there.setdefault(meeting, set()).add(partner)

    def partner_done(self, partner: str, meeting: Meeting) -> None:
        self._come(partner, meeting)

    def leave(self, meeting: Meeting) -> None:
        self._waiting.pop(meeting, None)

    def forget(self, label: str) -> None:
        """Forget all joint actions except those of the plans with this label."""
        self._waiting = {meeting: found for meeting, found in self._waiting.items() if meeting.label == label}
        self._there = {meeting: found for meeting, found in self._there.items() if meeting.label == label}

    def _come(self, partner: str, meeting: Meeting) -> None:
        waiting = self._waiting.get(meeting)
        if waiting is None:
            return
        waiting.missing.discard(partner)
        if not waiting.missing:
            del self._waiting[meeting]
            waiting.met()
