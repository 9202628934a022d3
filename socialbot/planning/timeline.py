"""The timeline of a plan: what begins and ends at which moment."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from socialbot.planning.plan import Plan
from socialbot.planning.semantics import GroundAction

EPSILON_S = 0.0005
"""What happens nearer than this is simultaneous, s."""

Edge = Literal["start", "end"]


class Happening(NamedTuple):
    """The start or the end of a step, which is given by its index; all there is of an instantaneous one is a start."""

    step: int
    edge: Edge


@dataclass(frozen=True, slots=True)
class Moment:
    """What happens at once, in the order of the steps, ends first."""

    time_s: float
    happenings: tuple[Happening, ...]


def moments(plan: Plan, actions: Sequence[GroundAction], running: Collection[int] = ()) -> list[Moment]:
    """All moments of ``plan``, whose steps do ``actions``.

    The steps ``running`` have started before; they end first of all, one after the other in the order of their ends.
    """
    ends = sorted(running, key=lambda index: (plan.steps[index].end_s, index))
    found = [Moment(0.0, (Happening(index, "end"),)) for index in ends]
    times: list[tuple[float, Happening]] = []
    for index, (step, action) in enumerate(zip(plan.steps, actions, strict=True)):
        if index in running:
            continue
        times.append((step.start_s, Happening(index, "start")))
        if action.duration is not None:
            times.append((step.end_s, Happening(index, "end")))
    times.sort(key=lambda timed: timed[0])
    together: list[Happening] = []
    begin = 0.0
    for time_s, happening in times:
        if together and time_s - begin >= EPSILON_S:
            found.append(Moment(begin, _in_order(together)))
            together = []
        if not together:
            begin = time_s
        together.append(happening)
    return [*found, Moment(begin, _in_order(together))] if together else found


def _in_order(together: list[Happening]) -> tuple[Happening, ...]:
    return tuple(sorted(together, key=lambda one: (one.edge == "start", one.step)))
