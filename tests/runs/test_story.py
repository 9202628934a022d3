from __future__ import annotations

import pytest

from socialbot.runs.story import story_of
from tests.runs.deliberating_runs import DETOUR, PHRASES, desire, plan, plan_end, record


def test_plans_have_their_ends_and_reasons():
    plans = story_of(DETOUR, PHRASES).plans
    assert [(p.agent, p.number, p.outcome, p.again) for p in plans] == [
        ("ann", 1, "failed", False),
        ("ann", 2, "succeeded", True),
        ("bob", 1, "succeeded", False),
    ]
    assert "locked" in plans[0].reason


def test_steps_have_times_and_results():
    story = story_of(DETOUR, PHRASES)
    first, failed, *_ = story.steps
    assert (first.text, first.began, first.ended) == (
        "goes from hall to yard",
        story.start,
        story.start + 2_500_000_000,
    )
    assert failed.began is None
    assert (failed.outcome, failed.message) == ("failed", "the door is locked")


def test_requests_have_their_last_answer():
    (request,) = story_of(DETOUR, PHRASES).requests
    assert (request.sender, request.receiver, request.about_desire, request.state) == ("ann", "bob", True, "fulfilled")
    assert request.ended == request.asked + 3_500_000_000


def test_desires_have_origin_and_result():
    home, door = story_of(DETOUR, PHRASES).desires
    assert (home.origin, home.how, home.why) == ("own", "fulfilled", "desires.yaml")
    assert (door.origin, door.how, door.why) == ("request", "fulfilled", "ann asks for it")


def test_planned_and_actual_duration():
    story = story_of(DETOUR, PHRASES)
    assert story.first is not None
    assert story.makespans_s(story.first) == (5.0, 7.0)
    assert story.duration_s == 7.0


def test_unfinished_items_stay_open():
    story = story_of(DETOUR[:3])
    assert story.first is not None
    assert (story.first.how, story.plans[0].outcome, story.steps[0].outcome) == ("", "", "")
    assert story.makespans_s(story.first) == (5.0, None)


def test_restarted_agent_loses_its_plan():
    lost = story_of((*DETOUR[:3], plan(4.0, "ann", "be_home", 1)))
    assert [p.outcome for p in lost.plans] == ["lost", ""]
    assert lost.steps[0].outcome == "lost"


def test_refused_desire_has_ended():
    (refused,) = story_of([record(0, "a", "desire_refused", "x", reason="no box")]).desires
    assert (refused.how, refused.reason, refused.priority) == ("refused", "no box", None)


def test_story_of_an_empty_run():
    story = story_of([])
    assert (story.first, story.duration_s, story.agents) == (None, 0.0, [])


@pytest.mark.parametrize("until", range(len(DETOUR)))
def test_story_of_an_unfinished_run(until):
    story = story_of(DETOUR[:until], PHRASES)
    assert len(story.desires) == sum(each.kind == "desire" for each in DETOUR[:until])


def test_desires_with_the_same_name_are_separate():
    first, second = desire(0, "a", "x"), desire(5, "a", "x")
    end = record(3, "a", "desire_dropped", "x", reason="deleted")
    assert [each.how for each in story_of((first, end, second)).desires] == ["dropped", ""]


def test_desires_of_rules_are_the_aims_without_other_desires():
    rule = record(0, "a", "rule", "dry", id="a-1", effect="ADD desire water")
    by_rule, own = desire(0, "a", "water", "a-1"), desire(0, "a", "rest")
    asked = record(0, "a", "asked", "b asks a to add desire help", "b-1")
    assert [each.name for each in story_of((asked, desire(0, "a", "help", "b-1"))).aims] == []
    assert [each.name for each in story_of((rule, by_rule)).aims] == ["water"]
    assert [each.name for each in story_of((rule, by_rule, own)).aims] == ["rest"]


def test_needless_desire_is_not_dropped():
    whole = desire(0, "a", "x")
    end = record(1, "a", "desire_fulfilled", "x", whole.id, reason="")
    gone = record(1, "a", "desire_dropped", "y", end.id, reason="x has ended")
    assert [each.how for each in story_of((whole, desire(0, "a", "y", whole.id), end, gone)).desires] == [
        "fulfilled",
        "needless",
    ]


GIVEN_UP = (desire(0, "ann", "x"), plan(0, "ann", "x", 1), plan_end(1, "ann", "x", 1, "failed", "no way"))


@pytest.mark.parametrize(
    ("records", "again"),
    [
        ((*GIVEN_UP, plan(2, "ann", "x", 2)), True),
        ((*GIVEN_UP, plan(2, "bob", "x", 2)), False),
        ((*GIVEN_UP, plan(2, "ann", "y", 2)), False),
        ((*GIVEN_UP[:2], plan_end(1, "ann", "x", 1, "succeeded"), plan(2, "ann", "x", 2)), False),
        (
            (
                *GIVEN_UP,
                record(2, "ann", "desire_dropped", "x", reason="deleted"),
                desire(3, "ann", "x"),
                plan(4, "ann", "x", 2),
            ),
            False,
        ),
    ],
    ids=["after a failed plan", "other agent", "other desire", "after a successful plan", "desire adopted anew"],
)
def test_plan_is_again_only_after_a_failed_plan_for_the_same_desire(records, again):
    assert story_of(records).plans[-1].again is again
