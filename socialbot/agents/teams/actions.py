"""Actions and joint actions of the agents of a team."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

from socialbot.agents.teams.messages import AclSender, Done, Ready
from socialbot.bdi import Action, Engine
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.durative_actions import LongAction
from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Change, Event, Literal, literal, literal_from_key
from socialbot.bdi.society import Society
from socialbot.bdi.terms import Atom
from socialbot.core.clock import Clock

if TYPE_CHECKING:
    from socialbot.agents.teams.agent import TeamAgent


OF_A_MISSION = ("milestone", "trigger_", "initial_trigger_", "start", "tried")
"""Prefixes of beliefs that end with a mission."""


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
        self.begin(self.functor, args)

    def begin(self, action: str, args: Iterable[object]) -> None:
        self.action, self.arguments = action, names_of(args)
        self.node.begin(self)

    def cancel(self) -> None:
        self.node.cancel_later(self)
        self.cancelled()

    @property
    def node(self) -> TeamAgent:
        return self.engine.robot

    @property
    def key(self) -> tuple[str, tuple[str, ...]]:
        """Action and arguments."""
        return self.action, self.arguments

    def succeed(self) -> None:
        self.done()
        if not self.own:
            self._raise(as_literal(f"success_{self.action}", self.arguments))

    def fail(self, reason: str) -> None:
        self.failed(reason)
        if not self.own:
            self._raise(literal("failure", (as_literal(self.action, self.arguments), reason)))

    def _raise(self, event: Literal) -> None:
        engine = self.engine
        engine.call(lambda: engine.interpreter.raise_event(Event(Change.ADDED, event), self.id))


class again(WorldAction):
    """Repeat an action of the mission: ``again(a_open_door(spotrobot1, room1))``."""

    def start(self, *args: Any) -> None:
        (action,) = args
        self.begin(action.functor, action.args)


class by_myself(again):
    """Execute an action that is no part of the plan. Its failure is a problem for the coordinator."""

    own = True

    def fail(self, reason: str) -> None:
        self.failed(reason)
        self.node.report_problem(self.action, self.arguments, reason)


class problem(Action):
    """Report a problem to the coordinator: ``problem(Action, Reason)``."""

    def execute(self, action: Literal, reason: str) -> None:
        self.engine.robot.report_problem(action.functor, names_of(action.args), str(reason))


class end(Action):
    """Report the end of the part of this agent to the coordinator."""

    def execute(self) -> None:
        self.engine.robot.finish()


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
    """Proxy for a remote agent: forwards beliefs."""

    __slots__ = ()

    def __init__(self, name: str, clock: Clock, send_remote: Callable[[str, str], object]) -> None:
        super().__init__(name, clock)

        def take(sender: str, performative: str, content: Any) -> bool:
            if performative != "tell":
                raise Failed("action_failed", f"{name} is in another process and receives only beliefs")
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


class Rendezvous:
    """Synchronizes the joint actions of one agent.

    `Ready` announces the agent to a partner, `Done` answers a partner that announced itself before.
    """

    def __init__(self, sender: AclSender) -> None:
        self._sender = sender
        self._waiting: dict[Meeting, tuple[set[str], Callable[[], None]]] = {}
        """Missing partners, and the function to call when all have arrived."""
        self._announced: defaultdict[Meeting, set[str]] = defaultdict(set)

    def arrive(self, meeting: Meeting, partners: Iterable[str], met: Callable[[], None]) -> None:
        """Call ``met`` as soon as all partners have arrived."""
        announced = self._announced.pop(meeting, set())
        missing: set[str] = set()
        for partner in partners:
            if partner in announced:
                self._send(partner, Done, meeting)
            else:
                missing.add(partner)
                self._send(partner, Ready, meeting)
        if missing:
            self._waiting[meeting] = missing, met
        else:
            met()

    def partner_ready(self, partner: str, meeting: Meeting) -> None:
        """Process the announcement of a partner."""
        if meeting in self._waiting:
            self._send(partner, Done, meeting)
            self.partner_done(partner, meeting)
        else:
            self._announced[meeting].add(partner)

    def partner_done(self, partner: str, meeting: Meeting) -> None:
        """Process the answer of a partner."""
        if meeting not in self._waiting:
            return
        missing, met = self._waiting[meeting]
        missing.discard(partner)
        if not missing:
            del self._waiting[meeting]
            met()

    def leave(self, meeting: Meeting) -> None:
        self._waiting.pop(meeting, None)

    def forget(self, label: str) -> None:
        """Forget all joint actions except those of the plans with this label."""
        for meetings in (self._waiting, self._announced):
            for meeting in [meeting for meeting in meetings if meeting.label != label]:
                del meetings[meeting]

    def _send(self, partner: str, kind: type[Ready | Done], meeting: Meeting) -> None:
        self._sender.send(partner, "query", kind(meeting.action, meeting.args), meeting.label)
