"""The programs, actions and joint actions of the hospital's robots and nurses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from socialbot.agents.hospital.missions import JOINT_ACTIONS
from socialbot.agents.hospital.ward.messages import AgentState
from socialbot.bdi import Action, Engine, Sensor
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.beliefs import literal_of
from socialbot.bdi.durative_actions import LongAction
from socialbot.bdi.intentions import Failed
from socialbot.bdi.library import Ready
from socialbot.bdi.literals import Change, Event, Literal, literal
from socialbot.bdi.messaging import send
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
"""How the names of beliefs begin that are of a mission, and end with it."""


def program(kind: str) -> str:
    """The AgentSpeak program of ``spot``, ``uvd`` or ``nurse``."""
    return (PROGRAMS / f"{kind}.asl").read_text("utf-8")


def names_of(args: Iterable[object]) -> tuple[str, ...]:
    """Arguments of an action as they travel."""
    return tuple(arg.name if isinstance(arg, Atom) else str(arg) for arg in args)


def as_literal(action: str, args: Iterable[str]) -> Literal:
    """An action with its arguments as a term."""
    return literal(action, tuple(map(Atom, args)))


class WorldAction(LongAction):
    """An action that the world carries out; ``args`` are those of the action itself.

    What it comes to is an event for the plans of the mission, and for those that mend: ``success_a_open_door(...)``,
    ``failure(a_open_door(...), Reason)``.
    """

    action: str
    arguments: tuple[str, ...]
    own = False
    """Whether it is the agent's own idea."""

    def start(self, *args: Any) -> None:
        self.action, self.arguments = self.functor, names_of(args)
        self.node.begin(self)

    def cancel(self) -> None:
        self.node.let_go(self)
        self.cancelled()

    @property
    def node(self) -> HospitalAgent:
        """The node of the agent that does it."""
        return self.engine.robot

    @property
    def is_joint(self) -> bool:
        """Whether others have to be there."""
        return self.action in JOINT_ACTIONS

    @property
    def key(self) -> tuple[str, tuple[str, ...]]:
        """What it is, whoever thought of it."""
        return self.action, self.arguments

    def succeed(self) -> None:
        """Says that it is done."""
        self.done()
        if not self.own:
            _happens(self.engine, literal(f"success_{self.action}", tuple(map(Atom, self.arguments))), self.id)

    def fail(self, reason: str) -> None:
        """Says that it could not be done, and why."""
        self.failed(reason)
        if not self.own:
            _happens(self.engine, literal("failure", (as_literal(self.action, self.arguments), reason)), self.id)


class again(WorldAction):  # noqa: N801 - its name in AgentSpeak
    """Does an action of the mission once more: ``again(a_open_door(spotrobot1, room1))``."""

    def start(self, *args: Any) -> None:
        (action,) = args
        self.action, self.arguments = action.functor, names_of(action.args)
        self.node.begin(self)


class by_myself(again):  # noqa: N801
    """Does an action that is no part of the mission's plan; if it fails, what it was for has failed."""

    own = True

    def fail(self, reason: str) -> None:
        """Has the coordinator know: what was to be mended cannot be mended like this."""
        self.failed(reason)
        self.node.report_problem(self.action, self.arguments, reason)


class problem(Action):  # noqa: N801
    """Tells the coordinator what the agent cannot mend: ``problem(Action, Reason)``."""

    def execute(self, action: Literal, reason: str) -> None:
        self.engine.robot.report_problem(action.functor, names_of(action.args), str(reason))


class end(Action):  # noqa: N801
    """Tells the coordinator that the agent has done all of its part."""

    def execute(self) -> None:
        self.engine.robot.finish()


def _happens(engine: Engine, event: Literal, cause: str) -> None:
    engine.call(lambda: engine.raise_event(Event(Change.ADDED, event), cause))


class Senses(Sensor):
    """Where the agent is, and its battery: ``at(room1)``, ``battery_low``."""

    def __init__(self) -> None:
        super().__init__()
        self._before: tuple[str, bool] | None = None

    def is_news(self, percept: AgentState) -> bool:
        """Whether there is something to be sensed that was not so when this was last asked."""
        before, self._before = self._before, (percept.place, percept.low_battery)
        return before != self._before

    def sense(self, percept: AgentState) -> Any:
        low = literal("battery_low")
        place = literal("at", (Atom(percept.place),))
        return [-literal("at", (Variable("_"),)), +place, +low if percept.low_battery else -low]


def install(engine: Engine, plans: Iterable[Plan]) -> list[Ready]:
    """Adds plans of a mission, and returns them as they are in the library, to be compiled before they are needed."""
    new = list(plans)
    for plan in new:
        engine.add_plan(plan)
    return [ready for ready in all_plans(engine) if ready.plan in new]


def all_plans(engine: Engine) -> Iterator[Ready]:
    """The plans in the library of an agent."""
    for trigger in list(engine.library.triggers.values()):
        yield from trigger.plans


def mission_beliefs(engine: Engine) -> Iterator[Literal]:
    """What is believed because of a mission."""
    for held in list(engine.beliefs):
        if held.belief.functor.startswith(OF_A_MISSION):
            yield held.belief


class RemoteSociety(Society):
    """A society of one agent that is here; what it tells others goes to ``tell_far``: the receiver, and the belief."""

    def __init__(self, clock: Clock, tell_far: Callable[[str, str], object]) -> None:
        super().__init__(clock)
        self._tell_far = tell_far

    def find(self, receiver: Any) -> Engine:
        name = receiver.name if isinstance(receiver, Atom) else str(receiver)
        if name not in self.agents:
            self.agents[name] = _RemoteAgent(name, self.clock, self._tell_far)
        return self.agents[name]

    def tell(self, sender: Engine, receiver: Any, key: str, args: tuple[Any, ...], cause: Any) -> None:
        send(sender, receiver, "tell", literal_of(key, args), cause)


class _RemoteAgent(Engine):
    """Stands for an agent that is somewhere else: takes what is said to it, and sends it on."""

    __slots__ = ()

    def __init__(self, name: str, clock: Clock, tell_far: Callable[[str, str], object]) -> None:
        super().__init__(name, clock)

        def take(sender: str, performative: str, content: Any) -> bool:
            if performative != "tell":
                raise Failed("action_failed", f"{name} is far away, and can only be told beliefs")
            tell_far(name, agentspeak(content))
            return False

        self.accepts = take

    def call(self, function: Callable[[], object]) -> None:
        function()


class Meeting(NamedTuple):
    """What is done together, in which mission: the label of its plans, the action, its arguments."""

    label: str
    action: str
    args: tuple[str, ...]


@dataclass
class _Waiting:
    missing: set[str]
    met: Callable[[], None]


@dataclass
class Rendezvous:
    """The meetings of one agent.

    ``ready`` tells a partner that the agent is there, ``done`` answers a partner who had been there before.
    """

    ready: Callable[[str, Meeting], object]
    done: Callable[[str, Meeting], object]
    _waiting: dict[Meeting, _Waiting] = field(default_factory=dict)
    _there: dict[Meeting, set[str]] = field(default_factory=dict)

    def arrive(self, meeting: Meeting, partners: Iterable[str], met: Callable[[], None]) -> None:
        """Calls ``met`` as soon as all partners are there, at once if they are."""
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
        """Takes the word of a partner who is there."""
        if meeting in self._waiting:
            self.done(partner, meeting)
            self._come(partner, meeting)
        else:
            self._there.setdefault(meeting, set()).add(partner)

    def partner_done(self, partner: str, meeting: Meeting) -> None:
        """Takes the answer of a partner."""
        self._come(partner, meeting)

    def leave(self, meeting: Meeting) -> None:
        """Waits no longer."""
        self._waiting.pop(meeting, None)

    def forget(self, label: str) -> None:
        """Forgets all meetings but those of the plans with this label."""
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
