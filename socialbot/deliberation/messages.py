"""Messages of deliberating agents: facts, desires, plans and requests.

Field names are those of ROS2-BDI; messages are JSON in std_msgs/String.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from socialbot.core.messages import Structured

INSTANCE, PREDICATE, FLUENT = 1, 2, 3

Check = Literal["EX", "T", "F", "EQ", "GR", "GREQ", "LE", "LEQ"]
"""Instance exists; predicate is true, false; fluent is equal, greater, at least, less, at most."""

Priority = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
LONGEST_S = 1e6
"""Maximum deadline (s), and the maximum of all time options."""

Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_S)]


class Fact(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Instance with its type (1), true predicate (2), or fluent with its value (3)."""

    name: str
    pddl_type: Literal[1, 2, 3] = PREDICATE
    type: str = ""
    params: tuple[str, ...] = ()
    value: float = 0.0

    @property
    def identity(self) -> tuple[int, str, tuple[str, ...]]:
        """Key of the fact, without the value of a fluent."""
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
    """Check of one fact."""

    ros_name: ClassVar[str] = "Condition"

    condition_to_check: Fact
    check: Check = "T"


class FactConjunction(msgspec.Struct, frozen=True, kw_only=True):
    """Conjunction of checks."""

    ros_name: ClassVar[str] = "Conjunction"

    literals: tuple[FactCondition, ...] = ()


class Dnf(msgspec.Struct, frozen=True, kw_only=True):
    """Disjunction of conjunctions; always true without any."""

    clauses: tuple[FactConjunction, ...] = ()


class Desire(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Desire: facts to achieve.

    Attributes:
        value: Wanted facts.
        conditions: Further wanted checks (negated, greater than, ...).
        deadline: Maximum duration (s) of its plan.
        precondition: Must hold at the start.
        context: Must hold at the start and during the pursuit.
        rollback_belief_add, rollback_belief_del: Changes of beliefs after an abort.
        parent: The desire that it prepares.
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
        """All wanted checks."""
        plain = (FactCondition(condition_to_check=fact, check=_CHECK_OF[fact.pddl_type]) for fact in self.value)
        return (*plain, *self.conditions)


_CHECK_OF: dict[int, Check] = {INSTANCE: "EX", PREDICATE: "T", FLUENT: "EQ"}


class Belief(Structured, frozen=True, kw_only=True):
    """Fact to add or delete (topics ``add_belief``, ``del_belief``)."""

    belief: Fact


class BeliefSet(Structured, frozen=True, kw_only=True):
    """Beliefs of an agent; on ``add_belief_set`` and ``del_belief_set``, facts to add or delete."""

    agent_id: str
    value: tuple[Fact, ...]


class DesireItem(Structured, frozen=True, kw_only=True):
    """Desire to adopt or drop (topics ``add_desire``, ``del_desire``)."""

    desire: Desire


class DesireSet(Structured, frozen=True, kw_only=True):
    """Desires of an agent."""

    agent_id: str
    value: tuple[Desire, ...]


ActionStatus = Literal["WAITING", "RUNNING", "SUCCESSFUL", "FAILED", "CANCELLED"]
PlanStatus = Literal["WAITING", "RUNNING", "SUCCESSFUL", "ABORT"]


class ActionExecutionInfo(msgspec.Struct, frozen=True, kw_only=True):
    """State of an action of a plan; times are seconds from the start of the plan.

    ``wait_action_indexes`` are the actions that must start or end before its start.
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
    """State of the plan for a desire; without a plan, ``target`` is None.

    ``current_time``, ``planned_deadline`` (planned makespan) and ``estimated_deadline`` (estimated end) are seconds
    from the start of the plan. ``plan`` counts the plans of the agent.
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
    """Summary of a plan: its wanted facts, and its running and waiting actions."""

    agent_id: str
    target_value: tuple[Fact, ...] = ()
    actions: tuple[ActionExecutionInfo, ...] = ()


Operation = Literal["check", "add", "del", "bid"]


class AgentRequest(Structured, frozen=True, kw_only=True):
    """Request of an agent of a ``group`` to another one about either a belief or a desire.

    With ``monitor`` the receiver sends a second reply with the same id at the end of the adopted desire; until then
    the sender repeats the request. Duplicates (same sender and id) are answered again, but executed once. ``bid`` asks
    for the time until a desire would be achieved, and changes nothing.
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
    """Reply to a request.

    Attributes:
        accepted: Whether the request was permitted and valid.
        found: Whether a checked item exists, or a deleted one existed.
        priority: Priority of the desire at the receiver.
        state: ``fulfilled`` or ``dropped`` in the second reply to a monitored request.
        bid: Time (s) until an offered desire would be achieved.
    """

    id: str
    sender: str
    receiver: str
    accepted: bool
    state: RequestState = "done"
    found: bool = False
    priority: float | None = None
    reason: str = ""
    bid: float | None = None


class LifecycleStatus(Structured, frozen=True, kw_only=True):
    """Status of an agent; PAUSED during a sensor timeout, BOOTING before the first percepts."""

    agent_id: str
    status: Literal["BOOTING", "SCHEDULING", "PLANNING", "EXECUTING", "ABORTING", "PAUSED"]
    reason: str = ""


AGENT_MESSAGES: tuple[type[Structured], ...] = (
    Belief, BeliefSet, DesireItem, DesireSet, PlanExecutionInfo, CurrentIntentions, AgentRequest, AgentReply,
    LifecycleStatus,
)  # fmt: skip
