"""Independent check of a ward's commands and results.

Each command has one result, and no agent acts in parallel. Partners do joint actions together. A room may be
disinfected only in this order: its nurse, who has confirmed the robot, permits a patrol; the patrol finds the room fit;
the patrolling robot admits the other one.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from socialbot.agents.hospital.ward.ward import JOINT_ACTIONS
from socialbot.agents.teams.messages import ActionCommand, ActionResult
from socialbot.core.clock import SECOND, nanoseconds

ROUNDED_NS = 1000
"""Rounding of durations, which are reported in s."""


def violations(
    homes: Mapping[str, str], commands: Iterable[ActionCommand], results: Sequence[ActionResult]
) -> list[str]:
    """Return the violations of a run; ``homes`` are the rooms of the nurses."""
    done = [result for result in results if result.outcome == "success"]
    return [*_unasked(commands, results), *_at_once(results), *_alone(done), *_out_of_order(homes, done)]


def _text(result: ActionResult) -> str:
    return f"{result.stamp / SECOND:.3f} s: {result.robot}: {result.action}({', '.join(result.args)})"


def _unasked(commands: Iterable[ActionCommand], results: Sequence[ActionResult]) -> Iterator[str]:
    """Yield results without a command, and repeated results."""
    told = {command.id: (command.robot, command.action, command.args) for command in commands}
    times = Counter(result.id for result in results)
    for result in results:
        if told.get(result.id) != (result.robot, result.action, result.args):
            yield f"{_text(result)} was not commanded"
        elif times[result.id] > 1:
            yield f"{_text(result)} has {times[result.id]} results"


def _at_once(results: Iterable[ActionResult]) -> Iterator[str]:
    """Yield actions that overlap with others of the same agent; immediately refused ones do not count."""
    by_robot: dict[str, list[tuple[int, ActionResult]]] = defaultdict(list)
    for result in results:
        if result.outcome == "success" or result.duration_s > 0.0:
            by_robot[result.robot].append((result.stamp - nanoseconds(result.duration_s), result))
    for some in by_robot.values():
        some.sort(key=lambda each: (each[0], each[1].stamp))
        for (_, before), (begin, result) in pairwise(some):
            if begin < before.stamp - ROUNDED_NS:
                yield f"{_text(result)} began before {before.action} was over"


def _alone(done: Iterable[ActionResult]) -> Iterator[str]:
    """Yield joint actions that the partners did at different times."""
    for (_, _, args), some in _joint(done).items():
        if {result.robot for result in some} != set(args):
            yield f"{_text(some[0])} was done alone"


def _joint(done: Iterable[ActionResult]) -> dict[tuple[int, str, tuple[str, ...]], list[ActionResult]]:
    found: dict[tuple[int, str, tuple[str, ...]], list[ActionResult]] = defaultdict(list)
    for result in done:
        if result.action in JOINT_ACTIONS:
            found[result.stamp, result.action, result.args].append(result)
    return found


@dataclass
class _Permissions:
    known: dict[str, str] = field(default_factory=dict)
    allowed: dict[str, str] = field(default_factory=dict)
    patrolled: dict[str, str] = field(default_factory=dict)
    let_in: dict[str, str] = field(default_factory=dict)


def _out_of_order(homes: Mapping[str, str], done: Iterable[ActionResult]) -> Iterator[str]:
    may = _Permissions()
    for result in done:
        match result.action, result.args:
            case "a_authenticate_nurse", (spot, nurse):
                may.known[spot] = nurse
            case "a_authorize_patrol", (spot, nurse) if result.robot == spot:
                if may.known.pop(spot, "") != nurse:
                    yield f"{_text(result)}: the nurse does not know the robot"
                may.allowed[spot] = homes[nurse]
            case "a_patrol_room", (spot, room):
                if may.allowed.pop(spot, "") != room:
                    yield f"{_text(result)}: nobody has allowed it"
                may.patrolled[spot] = room
            case "a_authorize_disinfect", (uvd, spot):
                may.let_in[uvd] = may.patrolled.get(spot, "")
            case "a_disinfect_room", (uvd, room):
                if may.let_in.pop(uvd, "") != room:
                    yield f"{_text(result)}: it was not let in"
            case _:
                pass
