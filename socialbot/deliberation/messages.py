"""What deliberating agents tell each other and the world: facts, desires, plans, requests.

The names of fields are those of ROS2-BDI's messages, which travel here as JSON in std_msgs/String.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from socialbot.core.messages import Structured

INSTANCE, PREDICATE, FLUENT = 1, 2, 3

Check = Literal["EX", "T", "F", "EQ", "GR", "GREQ", "LE", "LEQ"]
"""An instance exists; a predicate is true, false; a fluent is equal, greater, at least, smaller, at most."""

Priority = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
LONGEST_S = 1e6
"""The longest deadline of a desire, s; to be in no hurry at all."""

Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_S)]


class Fact(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Something believed: an instance with its type (1), a predicate (2) or the value of a fluent (3)."""

    name: str
    pddl_type: Literal[1, 2, 3] = PREDICATE
    type: str = ""
    params: tuple[str, ...] = ()
    value: float = 0.0

    @property
    def identity(self) -> tuple[int, str, tuple[str, ...]]:
        """What tells it from other facts; the value of a fluent does not."""
        return self.pddl_type, self.name, self.params

    def __str__(self) -> str:
        match self.pddl_type:
            case 1:
                return f"{self.name} - {self.type}"
            case 2:
                return f"({' '.join((self.name, *self.params))})"
            case _:
                return f"({' '.join((self.name, *self.params))}) = {self.value:g}"


class FactCondition(msgspec.Struct, frozen=True, kw_only=True):
    """One check of one fact."""

    condition_to_check: Fact
    check: Check = "T"


class FactConjunction(msgspec.Struct, frozen=True, kw_only=True):
    """Checks that all have to hold."""

    literals: tuple[FactCondition, ...] = ()


class Dnf(msgspec.Struct, frozen=True, kw_only=True):
    """Conjunctions of which one has to hold; without any it always holds."""

    clauses: tuple[FactConjunction, ...] = ()


class Desire(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A state of affairs to bring about.

    ``value`` lists what shall hold: predicates, and fluents with their value; ``conditions`` all that is not said that
    way (negated, greater than, ...). ``deadline`` counts (s) from the start of its plan, `LONGEST_S` at most.
    ``precondition`` has to hold when it is taken up, ``context`` as long as it is pursued. The rollback lists are what
    to believe, and what not to, when its plan is aborted. ``parent`` is the desire that it prepares.
    """

    name: str
    value: tuple[Fact, ...] = ()
    conditions: tuple[FactCondition, ...] = ()
    priority: Priority = 0.5
    deadline: Seconds = 60.0
    precondition: Dnf = Dnf()
    context: Dnf = Dnf()
    rollback_belief_add: tuple[Fact, ...] = ()
    rollback_belief_del: tuple[Fact, ...] = ()
    parent: str = ""

    @property
    def wanted(self) -> tuple[FactCondition, ...]:
        """All that shall hold, as checks."""
        plain = (FactCondition(condition_to_check=fact, check=_CHECK_OF[fact.pddl_type]) for fact in self.value)
        return (*plain, *self.conditions)


_CHECK_OF: dict[int, Check] = {INSTANCE: "EX", PREDICATE: "T", FLUENT: "EQ"}


class Belief(Structured, frozen=True, kw_only=True):
    """A fact to believe, or not to (topics ``add_belief``, ``del_belief``)."""

    belief: Fact


class BeliefSet(Structured, frozen=True, kw_only=True):
    """What an agent believes; on ``add_belief_set`` and ``del_belief_set``, what ``agent_id`` shall believe, or not."""

    agent_id: str
    value: tuple[Fact, ...]


class DesireItem(Structured, frozen=True, kw_only=True):
    """A desire to adopt, or to drop (topics ``add_desire``, ``del_desire``)."""

    desire: Desire


class DesireSet(Structured, frozen=True, kw_only=True):
    """What an agent desires."""

    agent_id: str
    value: tuple[Desire, ...]


ActionStatus = Literal["WAITING", "RUNNING", "SUCCESSFUL", "FAILED", "CANCELLED"]
PlanStatus = Literal["WAITING", "RUNNING", "SUCCESSFUL", "ABORT"]


class ActionExecutionInfo(msgspec.Struct, frozen=True, kw_only=True):
    """How an action of a plan fares; times are s from the start of the plan.

    ``wait_action_indexes`` are the actions that have to begin or end before this one may begin.
    """

    index: int
    name: str
    args: tuple[str, ...]
    wait_action_indexes: tuple[int, ...] = ()
    planned_start: float = 0.0
    actual_start: float | None = None
    duration: float = 0.0
    exec_time: float = 0.0
    progress: float = 0.0
    status: ActionStatus = "WAITING"
    message: str = ""


class PlanExecutionInfo(Structured, frozen=True, kw_only=True):
    """How the plan for a desire fares. ``target`` is empty while nothing is pursued.

    ``current_time``, ``planned_deadline`` (the makespan as planned) and ``estimated_deadline`` (the end as it looks
    now) are s from the start of the plan. ``plan`` counts the plans of the agent.
    """

    agent_id: str
    plan: int = 0
    target: Desire | None = None
    actions_exec_info: tuple[ActionExecutionInfo, ...] = ()
    current_time: float = 0.0
    planned_deadline: float = 0.0
    estimated_deadline: float = 0.0
    status: PlanStatus = "WAITING"
    reason: str = ""


class CurrentIntentions(Structured, frozen=True, kw_only=True):
    """What an agent is doing now, in short: what it wants to be true, and the actions that run or come next."""

    agent_id: str
    target_value: tuple[Fact, ...] = ()
    actions: tuple[ActionExecutionInfo, ...] = ()


Operation = Literal["check", "add", "del"]


class AgentRequest(Structured, frozen=True, kw_only=True):
    """What one agent asks of another; exactly one of ``belief`` and ``desire`` is given.

    ``group`` is the sender's. With ``monitor`` the receiver tells, by another reply with the same id, when a desire
    that it has adopted is fulfilled or dropped; meanwhile the sender sends the request again now and then. A request
    that comes twice (same sender and id) is answered twice and carried out once.
    """

    id: str
    sender: str
    group: str
    receiver: str
    operation: Operation
    belief: Fact | None = None
    desire: Desire | None = None
    monitor: bool = False


RequestState = Literal["done", "refused", "fulfilled", "dropped"]


class AgentReply(Structured, frozen=True, kw_only=True):
    """The answer to a request.

    ``accepted`` says whether the sender may ask for that, ``found`` whether what was checked holds, or what was deleted
    was there, ``priority`` which priority a desire has. ``state`` is ``fulfilled`` or ``dropped`` in the later reply to
    a monitored one.
    """

    id: str
    sender: str
    receiver: str
    accepted: bool
    state: RequestState = "done"
    found: bool = False
    priority: float | None = None
    reason: str = ""


class LifecycleStatus(Structured, frozen=True, kw_only=True):
    """What an agent is up to: it gets ready, chooses, executes a plan, or waits for a sensor that is silent."""

    agent_id: str
    status: Literal["BOOTING", "SCHEDULING", "PLANNING", "EXECUTING", "ABORTING", "PAUSED"]
    reason: str = ""


AGENT_MESSAGES: tuple[type[Structured], ...] = (
    Belief, BeliefSet, DesireItem, DesireSet, PlanExecutionInfo, CurrentIntentions, AgentRequest, AgentReply,
    LifecycleStatus,
)  # fmt: skip
