"""Speech acts (FIPA) between the coordinator, the robots and the nurses."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Literal

import msgspec

from socialbot.core.clock import Clock
from socialbot.core.messages import Structured

TOPIC = "/hospital/messages"
COORDINATOR = "coordinator"
EVERYBODY = "all"
"""The receiver of what the coordinator asks everybody."""

Performative = Literal["query", "request", "agree", "inform", "failure", "refuse", "subscribe"]


class Content(msgspec.Struct, frozen=True, tag_field="content"):
    """What is said."""


class Register(Content, frozen=True):
    """An agent offers its services: what it is (``spot``), and what it can do. The coordinator asks with it, too."""

    kind: str = ""
    capabilities: tuple[str, ...] = ()


class Plan(Content, frozen=True):
    """Plans in AgentSpeak, which take the place of all earlier ones of the same mission.

    Their labels are ``label`` with a number behind it: ``@mission_7_2_0`` is the first of ``mission_7_2``.
    """

    label: str
    plans: tuple[str, ...]


class Belief(Content, frozen=True):
    """A literal to believe, in AgentSpeak."""

    literal: str


class Start(Content, frozen=True):
    """Begin: the constants of the context of the plans, ``start(...)``."""

    arguments: tuple[str, ...]


class Stop(Content, frozen=True):
    """Give up the mission."""

    reason: str = ""


class End(Content, frozen=True):
    """The mission is over, for good."""


class Ready(Content, frozen=True):
    """Somebody waits for the receiver to do a joint action."""

    action: str
    args: tuple[str, ...] = ()


class Done(Content, frozen=True):
    """The answer to `Ready`: both are there, the joint action begins."""

    action: str
    args: tuple[str, ...] = ()


class Report(Content, frozen=True):
    """What came of an action."""

    outcome: Literal["success", "failure"]
    action: str
    args: tuple[str, ...] = ()
    reason: str = ""


class Problem(Content, frozen=True):
    """A failed action that its agent cannot mend: why (``dirty room``), and what it was."""

    kind: str
    args: tuple[str, ...] = ()
    action: str = ""


class Finished(Content, frozen=True):
    """An agent has done all of its part."""


class InitialTrigger(Content, frozen=True):
    """Asks for a mission: ``InitialTrigger("disinfect", ("room1",))``."""

    mission_kind: str
    args: tuple[str, ...] = ()


class Refusal(Content, frozen=True):
    """Why something that was said is not taken up."""

    reason: str


AnyContent = (
    Register
    | Plan
    | Belief
    | Start
    | Stop
    | End
    | Ready
    | Done
    | Report
    | Problem
    | Finished
    | InitialTrigger
    | Refusal
)


class AclMessage(Structured, frozen=True, kw_only=True):
    """A speech act. ``mission`` is the label of the plans that it belongs to, ``in_reply_to`` the id of a message."""

    id: str
    sender: str
    receiver: str
    performative: Performative
    content: AnyContent
    in_reply_to: str = ""
    mission: str = ""


PERFORMATIVES: Mapping[type[Content], tuple[Performative, ...]] = {
    Register: ("request", "query", "agree"),
    Plan: ("inform",),
    Belief: ("inform",),
    Start: ("request",),
    Stop: ("request",),
    End: ("request",),
    Ready: ("query",),
    Done: ("query",),
    Report: ("inform",),
    Problem: ("inform",),
    Finished: ("request",),
    InitialTrigger: ("request", "agree"),
    Refusal: ("refuse",),
}
"""As what agents with a mind, and who directs them, say each thing."""


def protocol_error(message: AclMessage) -> str:
    """What is wrong with the way in which something is said; empty if nothing is."""
    content = message.content
    allowed = PERFORMATIVES[type(content)]
    if message.performative not in allowed:
        return f"{type(content).__name__} is said as {' or '.join(allowed)}, not as {message.performative}"
    if isinstance(content, Plan) and (content.label != message.mission or not content.label):
        return f"plans of {content.label or 'no mission'} in a message of {message.mission or 'no mission'}"
    return ""


ActionStatus = Literal["planned", "done", "failed"]


class PlannedAction(msgspec.Struct, frozen=True, kw_only=True):
    """An action of a mission, and what became of it."""

    action: str
    args: tuple[str, ...]
    agents: tuple[str, ...]
    status: ActionStatus = "planned"


MissionStatus = Literal["waiting", "running", "finished", "failed"]


class MissionView(msgspec.Struct, frozen=True, kw_only=True):
    """A mission as it stands.

    ``actions`` were done, failed or are planned, in order; ``tree`` is a drawing of the tasks. ``recoveries`` counts
    the new plans after a problem, ``revisions`` those before one.
    """

    id: int
    kind: str
    room: str
    priority: int
    status: MissionStatus
    team: tuple[str, ...] = ()
    label: str = ""
    actions: tuple[PlannedAction, ...] = ()
    tree: str = ""
    recoveries: int = 0
    revisions: int = 0
    problem: str = ""

    def untouched(self) -> MissionView:
        """The mission before its first plan."""
        return MissionView(id=self.id, kind=self.kind, room=self.room, priority=self.priority, status="waiting")


class Missions(Structured, frozen=True, kw_only=True):
    """All missions that are not over, and the latest that are."""

    missions: tuple[MissionView, ...]


MISSION_MESSAGES: tuple[type[Structured], ...] = (AclMessage, Missions)


class AclSender:
    """Says things as ``name``; ``publish`` sends them."""

    def __init__(self, name: str, clock: Clock, publish: Callable[[AclMessage], object]) -> None:
        self._name = name
        self._clock = clock
        self._publish = publish
        self._begun = clock.now()
        self._numbers = itertools.count(1)

    def send(
        self, receiver: str, performative: Performative, content: AnyContent, mission: str = "", in_reply_to: str = ""
    ) -> None:
        """Says ``content`` to the receiver; see `AclMessage`."""
        self._publish(
            AclMessage(
                stamp=self._clock.now(),
                id=f"{self._name}-{self.next_id()}",
                sender=self._name,
                receiver=receiver,
                performative=performative,
                content=content,
                in_reply_to=in_reply_to,
                mission=mission,
            )
        )

    def next_id(self) -> str:
        """One that this speaker, however often it begins anew, has not used before."""
        return f"{self._begun}-{next(self._numbers)}"
