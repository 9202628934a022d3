"""The settings of a director."""

from __future__ import annotations

from dataclasses import dataclass, fields

from socialbot.errors import PlanningError

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
