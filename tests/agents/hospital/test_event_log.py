from __future__ import annotations

from typing import Any

import pytest

from socialbot.agents.teams.event_log import TeamEventLog
from socialbot.agents.teams.messages import (
    CANCELLED,
    AclMessage,
    ActionCommand,
    ActionResult,
    Belief,
    Missions,
    MissionStatus,
    MissionView,
    PlannedAction,
    Problem,
)
from socialbot.core.messages import TraceRecord
from socialbot.runs.story import story_of
from tests.agents.hospital.runs import paper_run

GO = PlannedAction(action="a_navigate_to", args=("spotrobot1", "room1"), agents=("spotrobot1",))


def told(*views: MissionView, log: TeamEventLog | None = None) -> list[TraceRecord]:
    log = log or TeamEventLog("{0} is infected", "the ward has changed")
    return [record for view in views for record in log.take(Missions(stamp=5, missions=(view,)))]


def view(status: MissionStatus = "running", label: str = "mission_1_1", **more: Any) -> MissionView:
    return MissionView(
        id=1, kind="disinfect", target="room1", priority=0, status=status, label=label, team=("spotrobot1",),
        actions=(GO,), **more,
    )  # fmt: skip


def kinds(records: list[TraceRecord]) -> list[str]:
    return [record.kind for record in records]


def test_mission_is_logged_as_desire_with_plan():
    wanted, plan = told(view())
    assert (wanted.kind, wanted.source, wanted.what) == ("desire", "coordinator", "disinfect room1")
    assert (plan.kind, plan.cause) == ("plan_start", wanted.id)
    assert plan.detail["steps"] == ["0.000: (a_navigate_to spotrobot1 room1)"]


def test_update_of_same_plan_is_no_new_plan():
    assert kinds(told(view(), view(), view())) == ["desire", "plan_start"]


@pytest.mark.parametrize(
    ("change", "outcome", "reason"),
    [
        ({"recoveries": 1, "problem": "dirty room"}, "failed", "dirty room"),
        ({"revisions": 1}, "aborted", "the ward has changed"),
    ],
)
def test_new_label_is_logged_as_new_plan(change, outcome, reason):
    *_, end, plan = told(view(), view(label="mission_1_2", **change))
    assert (end.kind, end.detail["outcome"], end.detail["reason"]) == ("plan_end", outcome, reason)
    assert (plan.kind, plan.detail["plan"]) == ("plan_start", end.detail["plan"] + 1)


def test_waiting_mission_has_no_plan():
    records = told(view(), view("waiting", problem="mission 2 is more urgent"), view(label="mission_1_2"))
    assert kinds(records) == ["desire", "plan_start", "plan_end", "plan_start"]
    assert records[2].detail["reason"] == "mission 2 is more urgent"


def test_mission_ends_as_fulfilled_or_dropped_desire():
    assert kinds(told(view(), view("finished"), view("finished")))[2:] == ["plan_end", "desire_fulfilled"]
    *_, dropped = told(view(), view("failed", problem="dirty room"))
    assert (dropped.kind, dropped.detail["reason"]) == ("desire_dropped", "dirty room")


def test_mission_that_ended_earlier_has_no_plan():
    assert kinds(told(view("finished"))) == ["desire", "desire_fulfilled"]


def test_step_belongs_to_plan_of_its_team():
    log = TeamEventLog("{0} is infected", "the ward has changed")
    command = ActionCommand(stamp=6, id="c", robot="spotrobot1", action=GO.action, args=GO.args)
    [alone] = log.take(command)
    assert "plan" not in alone.detail
    _, plan = told(view(), log=log)
    [step] = log.take(command)
    assert (step.kind, step.what, step.detail["plan"]) == ("step", "(a_navigate_to spotrobot1 room1)", 1)
    assert plan.detail["plan"] == 1
    told(view("finished"), log=log)
    [after] = log.take(command)
    assert "plan" not in after.detail


@pytest.mark.parametrize(
    ("reason", "outcome"), [("", "successful"), ("dirty room", "failed"), (CANCELLED, "cancelled")]
)
def test_results_are_logged_as_step_ends(reason, outcome):
    [end] = TeamEventLog("{0} is infected", "the ward has changed").take(
        ActionResult(
            stamp=7, id="c", robot="spotrobot1", action="a_charge", args=("spotrobot1",), reason=reason,
            outcome="failure" if reason else "success",
        )
    )  # fmt: skip
    assert (end.kind, end.cause, end.detail) == ("step_end", "c", {"outcome": outcome, "message": reason})


@pytest.mark.parametrize(
    ("content", "weight", "text"),
    [
        (Belief("trigger_a_patrol_room(s, r)"), "word", "tells uvdrobot1 to start a_patrol_room"),
        (Belief("milestone3"), "", "tells uvdrobot1: milestone3"),
        (Problem("dirty room", ("s", "r"), "a_patrol_room"), "problem", "reports dirty room: a_patrol_room(s, r)"),
    ],
)
def test_speech_acts_have_weight(content, weight, text):
    [word] = TeamEventLog("{0} is infected", "the ward has changed").take(
        AclMessage(stamp=8, id="m", sender="s", receiver="uvdrobot1", performative="inform", content=content)
    )
    assert (word.kind, word.what, word.detail["weight"]) == ("said", text, weight)


def test_records_of_a_run_form_a_story():
    run = paper_run(100.0)
    story = story_of(run.records)
    assert [(plan.outcome, plan.reason, plan.again) for plan in story.plans] == [
        ("failed", "dirty room", False),
        ("succeeded", "", True),
    ]
    assert [desire.how for desire in story.desires] == ["fulfilled"]
    assert all(step.outcome for step in story.steps)
    [failed] = [step for step in story.steps if step.outcome == "failed"]
    assert (failed.call, failed.plan) == ("(a_patrol_room spotrobot1 room1)", story.plans[0])
    said = sum(isinstance(message, AclMessage) for message in run.messages)
    assert len(story.words) == said > 50
