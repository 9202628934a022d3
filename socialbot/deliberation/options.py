"""Options of a deliberating agent, named as in ROS2-BDI."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Literal

from socialbot.core.errors import PlanningError
from socialbot.planning.planners.planner import PlannerLimits

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
    limits: PlannerLimits = field(default_factory=PlannerLimits)


_LEAST = {"overrun_factor": 1.0, "rtc_deadline": 1.0, "report_s": 0.01}


@dataclass(frozen=True)
class DirectorOptions:
    """What a director puts up with; all in s but the factors. Raises PlanningError for what is too small.

    ``patience_s``: a condition that shall hold at the start, an effect that sensors shall see. ``tolerance_s``: a
    condition that stops holding, as sensors flicker. ``overrun_factor`` and ``overrun_s``: a step may last so many
    times its planned duration and so much longer. ``rtc_deadline``: so many times its deadline a desire may be
    pursued. ``stop_s``: an action that was asked to stop. ``report_s``: how often to report while a plan runs.
    """

    patience_s: float = 2.0
    tolerance_s: float = 0.5
    overrun_factor: float = 5.0
    overrun_s: float = 5.0
    rtc_deadline: float = 2.0
    stop_s: float = 5.0
    report_s: float = 0.2

    def __post_init__(self) -> None:
        for option in fields(self):
            value, least = getattr(self, option.name), _LEAST.get(option.name, 0.0)
            if not value >= least:
                raise PlanningError(f"{option.name} is {value}", remedy=f"give at least {least:g}")
