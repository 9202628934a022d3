from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from evaluation.hospital_check import violations
from evaluation.hospital_scale_runs import Run, Story
from socialbot.agents.teams.messages import ActionCommand, ActionResult

HOMES = {"nurse_disinfected1": "room1", "nurse_disinfected2": "room2"}

Record = tuple[list[ActionCommand], list[ActionResult]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Record:
    run = Run(Story(0, 0.0, rooms=2, spots=2, uvds=2, every_s=0.0), tmp_path_factory.mktemp("run"))
    result = run.play()
    assert result.fine
    return run.commands, run.results


def first(results: list[ActionResult], action: str, outcome: str = "success") -> int:
    return next(i for i, one in enumerate(results) if (one.action, one.outcome) == (action, outcome))


def found(record: Record, change: Callable[[list[ActionCommand], list[ActionResult]], object]) -> list[str]:
    commands, results = list(record[0]), list(record[1])
    change(commands, results)
    return violations(HOMES, commands, results)


def replaced(action: str, **changes) -> Callable[[list[ActionCommand], list[ActionResult]], None]:
    def change(commands: list[ActionCommand], results: list[ActionResult]) -> None:
        index = first(results, action)
        results[index] = msgspec.structs.replace(results[index], **changes)

    return change


def without(action: str, count: int = 1) -> Callable[[list[ActionCommand], list[ActionResult]], None]:
    def change(commands: list[ActionCommand], results: list[ActionResult]) -> None:
        for _ in range(count):
            del results[first(results, action)]

    return change


def twice(commands: list[ActionCommand], results: list[ActionResult]) -> None:
    results.append(results[0])


def test_a_run_of_the_real_agents_breaks_no_rule(recorded: Record):
    assert violations(HOMES, *recorded) == []
    assert len(recorded[1]) > 20


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (replaced("a_patrol_room", id="x"), "was not commanded"),
        (replaced("a_patrol_room", args=("spotrobot1", "room9")), "was not commanded"),
        (twice, "has 2 results"),
        (replaced("a_patrol_room", duration_s=100.0), "was over"),
        (without("a_authenticate_nurse"), "was done alone"),
        (replaced("a_authorize_patrol", stamp=7), "was done alone"),
        (without("a_authenticate_nurse", 2), "the nurse does not know the robot"),
        (without("a_authorize_patrol", 2), "nobody has allowed it"),
        (without("a_patrol_room"), "it was not let in"),
        (without("a_authorize_disinfect", 2), "it was not let in"),
    ],
)
def test_violated_rules_are_named(recorded: Record, change, what: str):
    assert any(what in violation for violation in found(recorded, change))


def test_an_action_that_starts_at_the_end_of_another_is_not_parallel():
    commands = [ActionCommand(stamp=0, id=id, robot="r", action="a_charge", args=("r",)) for id in "ab"]
    results = [
        ActionResult(stamp=stamp, id=id, robot="r", action="a_charge", args=("r",), outcome="success", duration_s=0.1)
        for id, stamp in (("a", 100_000_000), ("b", 200_000_000))
    ]
    assert violations({}, commands, results) == []
    early = msgspec.structs.replace(results[1], stamp=199_000_000)
    assert violations({}, commands, [results[0], early]) == ["0.199 s: r: a_charge(r) began before a_charge was over"]


def test_the_same_story_comes_to_the_same_results(recorded: Record, tmp_path: Path):
    run = Run(Story(0, 0.0, rooms=2, spots=2, uvds=2, every_s=0.0), tmp_path)
    run.play()
    assert run.results == recorded[1]
