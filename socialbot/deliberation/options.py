"""Options of a deliberating agent, named as in ROS2-BDI; each is declared once, with its meaning and range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Literal, get_type_hints

from socialbot.core.errors import PlanningError
from socialbot.deliberation.messages import LONGEST_S
from socialbot.planning.planners.planner import PlannerLimits

Policy = Literal["NO_PREEMPT", "PREEMPT"]


@dataclass(frozen=True, slots=True)
class OptionInfo:
    """Meaning and range of an option; without a meaning it is no parameter of nodes."""

    doc: str
    minimum: float | None = None
    maximum: float | None = LONGEST_S
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class DeliberationOptions:
    """Settings of a deliberator and its plan executor. Raises PlanningError for a value out of range."""

    planning_timeout_s: Annotated[float, OptionInfo("processor time of one planner call (s)", 0.05, 600.0)] = 5.0
    planning_memory_mb: Annotated[int, OptionInfo("memory limit of the planner (MB)", 32, None)] = 512
    reschedule_policy: Annotated[
        Policy, OptionInfo("may desires interrupt others?", maximum=None, choices=("NO_PREEMPT", "PREEMPT"))
    ] = "NO_PREEMPT"
    rtc_deadline: Annotated[float, OptionInfo("multiple of its deadline until a plan is aborted", 1.0, 1000.0)] = 2.0
    patience_s: Annotated[float, OptionInfo("wait for a start condition, or for a sensed effect (s)", 0.0)] = 2.0
    tolerance_s: Annotated[float, OptionInfo("time for which a condition may stop holding (s)", 0.0)] = 0.5
    overrun_factor: Annotated[float, OptionInfo("multiple of its duration that a step may take", 1.0, 1000.0)] = 5.0
    overrun_s: Annotated[float, OptionInfo("additional time that a step may take (s)", 0.0)] = 5.0
    stop_s: Annotated[float, OptionInfo("time that an action may take to stop (s)", 0.0)] = 5.0
    retry_s: Annotated[float, OptionInfo("minimum time between two attempts for one desire (s)", 0.0)] = 1.0
    comp_plan_tries: Annotated[int, OptionInfo("failed plannings before a desire is dropped", 1, None)] = 8
    exec_plan_tries: Annotated[int, OptionInfo("failed executions before a desire is dropped", 1, None)] = 8
    autosub_prec: Annotated[bool, OptionInfo("adopt desires for a missing precondition", maximum=None)] = False
    autosub_context: Annotated[bool, OptionInfo("adopt desires for a missing context", maximum=None)] = False
    partial_desires: Annotated[
        bool, OptionInfo("achieve the possible conditions of a desire whose others are impossible?", maximum=None)
    ] = False
    give_up_silent_s: Annotated[float, OptionInfo("sensor timeout until it is done without (s)", 0.0)] = 30.0
    report_s: Annotated[float, OptionInfo("", 0.01)] = 0.2

    def __post_init__(self) -> None:
        for name, info in option_infos().items():
            value = getattr(self, name)
            if info.minimum is not None and not value >= info.minimum:
                raise PlanningError(f"option {name!r} must be >= {info.minimum:g} (got {value:g})")
            if info.maximum is not None and not value <= info.maximum:
                raise PlanningError(f"option {name!r} must be <= {info.maximum:g} (got {value:g})")

    @property
    def limits(self) -> PlannerLimits:
        return PlannerLimits(timeout_s=self.planning_timeout_s, memory_mb=self.planning_memory_mb)


@cache
def option_infos() -> Mapping[str, OptionInfo]:
    """Return the meanings and ranges of all options by name."""
    hints = get_type_hints(DeliberationOptions, include_extras=True)
    return {option.name: hints[option.name].__metadata__[0] for option in fields(DeliberationOptions)}
