"""How an agent deliberates: the settings of ROS2-BDI, by the same names, and a few more."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from socialbot.planning.planner import Limits

Policy = Literal["NO_PREEMPT", "PREEMPT"]


@dataclass(frozen=True)
class Options:
    """The settings of a deliberator.

    ``rtc_deadline`` times the deadline of a desire is how long it may be pursued before its plan is aborted. A
    desire is dropped after ``comp_plan_tries`` fruitless plannings or ``exec_plan_tries`` aborted executions; between
    two tries ``retry_s`` pass. ``autosub_prec`` and ``autosub_context`` have the agent desire what the precondition or
    context of a desire lacks. ``limits`` are those of the planner. An agent whose sensor stays silent longer than
    ``give_up_silent_s`` aborts what it does.
    """

    reschedule_policy: Policy = "NO_PREEMPT"
    rtc_deadline: float = 2.0
    comp_plan_tries: int = 8
    exec_plan_tries: int = 8
    autosub_prec: bool = False
    autosub_context: bool = False
    retry_s: float = 1.0
    give_up_silent_s: float = 30.0
    limits: Limits = field(default_factory=Limits)
