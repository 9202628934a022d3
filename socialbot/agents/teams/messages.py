"""Messages of teams: speech acts (FIPA) with the coordinator, missions, and commands to the world."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import msgspec

from socialbot.bdi.literals import OWN_SOURCES
from socialbot.core.clock import Clock
from socialbot.core.messages import Structured

MESSAGES = "/team/messages"
PRIVATE_MESSAGES = "/{receiver}/team_messages"
"""Topic of what the coordinator sends to one member; `OWN_MESSAGES` is the same for the member."""
OWN_MESSAGES = "~/team_messages"
MISSIONS = "/team/missions"
COMMANDS = "/team/commands"
CANCELS = "/team/cancels"
RESULTS = "/team/results"
STATE = "/team/state"
CANCELLED = "cancelled"
"""Reason of the failure of a cancelled action."""
PARTNER_ABSENT = "partner absent"
"""Reason of the failure of a joint action."""
COORDINATOR = "coordinator"
EVERYBODY = "all"
"""Receiver of messages for all agents."""

Performative = Literal["query", "request", "agree", "inform", "failure", "refuse", "subscribe"]


class Content(msgspec.Struct, frozen=True, tag_field="content"):
    """Content of a speech act."""


class Register(Content, frozen=True):
    """Registration of an agent: its kind (``courier``) and its actions; from the coordinator, the request for it."""

    kind: str = ""
    capabilities: tuple[str, ...] = ()


class Plan(Content, frozen=True):
    """AgentSpeak plans, which replace all earlier plans of their mission.

    Their labels are ``label`` and a number: ``@mission_7_2_0`` is the first plan of ``mission_7_2``.
    """

    label: str
    plans: tuple[str, ...]


class Belief(Content, frozen=True):
    """Belief for the receiver, an AgentSpeak literal."""

    literal: str


class Start(Content, frozen=True):
    """Start of a mission, with the arguments of the belief ``start(...)`` in the context of its plans."""

    arguments: tuple[str, ...]


class Stop(Content, frozen=True):
    """Abort of the mission."""

    reason: str = ""


class End(Content, frozen=True):
    """End of the mission."""


class Ready(Content, frozen=True):
    """Announcement of the sender, which waits for the receiver to do a joint action."""

    action: str
    args: tuple[str, ...] = ()


class Done(Content, frozen=True):
    """Answer to `Ready`: the joint action starts."""

    action: str
    args: tuple[str, ...] = ()


class Report(Content, frozen=True):
    """Result of an action."""

    outcome: Literal["success", "failure"]
    action: str
    args: tuple[str, ...] = ()
    reason: str = ""


class Problem(Content, frozen=True):
    """A failed action without a recovery plan, and its reason (``dirty room``)."""

    kind: str
    args: tuple[str, ...] = ()
    action: str = ""


class Finished(Content, frozen=True):
    """End of the part of the sender."""


class InitialTrigger(Content, frozen=True):
    """Request for a mission: ``InitialTrigger("disinfect", ("room1",))``."""

    mission_kind: str
    args: tuple[str, ...] = ()


class Refusal(Content, frozen=True):
    """Reason for the refusal of a message."""

    reason: str


AnyContent = (
    Register | Plan | Belief | Start | Stop | End | Ready | Done | Report | Problem | Finished
    | InitialTrigger | Refusal
)  # fmt: skip


class AclMessage(Structured, frozen=True, kw_only=True):
    """Speech act. ``mission`` is the label of its plans, ``in_reply_to`` the id of the message that it answers."""

    id: str
    sender: str
    receiver: str
    performative: Performative
    content: AnyContent
    in_reply_to: str = ""
    mission: str = ""


PERFORMATIVES: Mapping[type[Content], tuple[Performative, ...]] = {
    **dict.fromkeys((Plan, Belief, Report, Problem), ("inform",)),
    **dict.fromkeys((Start, Stop, End, Finished), ("request",)),
    **dict.fromkeys((Ready, Done), ("query",)),
    Register: ("request", "query", "agree"),
    InitialTrigger: ("request", "agree"),
    Refusal: ("refuse",),
}
"""Valid performatives, by content."""


def protocol_error(message: AclMessage) -> str:
    """The violation of the protocol by a message; an empty string for a valid one."""
    if message.sender in OWN_SOURCES:
        return f"no agent can be named {message.sender}"
    content = message.content
    allowed = PERFORMATIVES[type(content)]
    if message.performative not in allowed:
        return f"{type(content).__name__} must be sent as {' or '.join(allowed)}, not as {message.performative}"
    if isinstance(content, Plan) and (content.label != message.mission or not content.label):
        return f"plans of {content.label or 'no mission'} in a message of {message.mission or 'no mission'}"
    return ""


ActionStatus = Literal["planned", "done", "failed"]


class PlannedAction(msgspec.Struct, frozen=True):
    """An action of a mission with its status."""

    action: str
    args: tuple[str, ...]
    agents: tuple[str, ...]
    status: ActionStatus = "planned"


MissionStatus = Literal["waiting", "running", "finished", "failed"]


class MissionView(msgspec.Struct, frozen=True, kw_only=True):
    """State of a mission. Messages call its target ``room``.

    ``actions`` are done, failed or planned, in order; ``tree`` is the task tree as text. ``recoveries`` counts the new
    plans after a problem, ``revisions`` those before one.
    """

    id: int
    kind: str
    target: str = msgspec.field(name="room")
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
        return MissionView(id=self.id, kind=self.kind, target=self.target, priority=self.priority, status="waiting")


class Missions(Structured, frozen=True, kw_only=True):
    """All open missions, and the latest ended ones."""

    missions: tuple[MissionView, ...]


Seconds = Annotated[float, msgspec.Meta(ge=0.0)]


class ActionCommand(Structured, frozen=True, kw_only=True):
    """Command for an action of an agent. ``args`` are all arguments of the action, with the robot.

    A joint action starts when both partners have a command.
    """

    id: str
    robot: str
    action: str
    args: tuple[str, ...] = ()


class ActionCancel(Structured, frozen=True, kw_only=True):
    """Cancels the command with this ``id``, unless it is finished."""

    id: str


class ActionResult(Structured, frozen=True, kw_only=True):
    """Result of a command, ``duration_s`` after it. Each command has one result."""

    id: str
    robot: str
    action: str
    args: tuple[str, ...] = ()
    outcome: Literal["success", "failure"]
    reason: str = ""
    duration_s: Seconds = 0.0


MISSION_MESSAGES: tuple[type[Structured], ...] = (AclMessage, Missions)
WORLD_MESSAGES: tuple[type[Structured], ...] = (ActionCommand, ActionCancel, ActionResult)


class AclSender:
    """Sends speech acts of the agent ``name``."""

    def __init__(self, name: str, clock: Clock, publish: Callable[[AclMessage], object]) -> None:
        self._name = name
        self._clock = clock
        self._publish = publish
        self._begun = clock.now()
        self._numbers = itertools.count(1)

    def send(
        self, receiver: str, performative: Performative, content: AnyContent, mission: str = "", in_reply_to: str = ""
    ) -> None:
        """Send a speech act; see `AclMessage`."""
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
        """An id that is unique over restarts of this sender."""
        return f"{self._begun}-{next(self._numbers)}"
