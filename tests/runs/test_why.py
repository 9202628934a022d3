from __future__ import annotations

import pytest
from msgspec.structs import replace

from socialbot.core.clock import SECOND
from socialbot.core.errors import RunError
from socialbot.core.messages import TraceRecord
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.history import History
from socialbot.runs.narration import Wording, past
from socialbot.runs.why import MOST_LINKS, actions, decided_at, explain, why_not
from tests.runs.deliberating_runs import PHRASES, desire, plan, record, request, step
from tests.runs.runs import greeting


@pytest.fixture(scope="module")
def waldo(tmp_path_factory) -> RecordedRun:
    return open_run(greeting(tmp_path_factory.mktemp("run") / "waldo"))


def test_why_waldo_said_something_down_to_the_frame(waldo):
    said = explain(waldo.history, waldo.wording, actions(waldo.history)[-1])
    at_s = said.chain[0].at_s
    assert said.text().split("\n") == [
        f'At {at_s:.2f} s Waldo said "Hello! Nice to see you.",',
        '  because it did speak("greeting"),',
        "  because it wanted GreetPeople(),",
        '  because it believed personDetected("Yes"), told by its sensor,',
        f"  because the frame at {at_s:.2f} s showed person t1 4.0 m away.",
    ]
    assert said.frame_s == at_s
    assert [(each.plan, each.because) for each in said.rejected] == [
        ("GreetPeople() / (greeted()) >> []", "greeted() does not hold"),
        (
            'GreetPeople() / (people(N) & (N > 1)) >> [speak("greeting_several"), +greeted()]',
            "(N > 1) does not hold",
        ),
    ]
    assert "speech" in {effect.kind for effect in said.effects}


def test_each_link_is_a_record_to_look_up(waldo):
    said = explain(waldo.history, waldo.wording, actions(waldo.history)[-1])
    assert [waldo.history.find(reason.id) is not None for reason in said.chain] == [True] * len(said.chain)


def following(*records: TraceRecord) -> History:
    """A history in which each record led to the next."""
    linked = [records[0]]
    for each in records[1:]:
        linked.append(replace(each, cause=linked[-1].id))
    return History(linked, start=100 * SECOND)


HELPING = (
    desire(0.0, "bob", "help_ann"),
    plan(1.0, "bob", "help_ann", 1, "0.000: (ask_help bob ann) [2.000]"),
    step(1.0, "bob", "(ask_help bob ann)"),
    request(1.0, "bob", "bob asks ann to add desire be_home", "bob-77"),
    desire(1.1, "ann", "be_home"),
    plan(1.2, "ann", "be_home", 3, "0.000: (go ann hall home) [2.000]", "2.000: (go ann home hall) [2.000]"),
    step(1.2, "ann", "(go ann hall home)"),
)


def test_a_step_is_told_with_its_plan_and_who_asked_for_it():
    history = following(*HELPING)
    told = explain(history, Wording({}, PHRASES), history[len(history) - 1]).text()
    assert told.split("\n") == [
        "At 1.20 s ann went from hall to home, step 1 of 2 of plan 3 for be_home,",
        "  because it wanted be_home (at 1.10 s),",
        "  because bob asked ann to add desire be_home (at 1.00 s),",
        "  because it asked ann to help, step 1 of 1 of plan 1 for help_ann,",
        "  because it wanted help_ann (at 0.00 s),",
        "  because desires.yaml says so.",
    ]


def test_what_was_done_before_is_told_by_its_last_step():
    steps = [record(float(second), "ann", "action", f"walk({second})") for second in range(4)]
    history = following(*steps)
    assert explain(history, Wording(), history[3]).text() == (
        "At 3.00 s ann did walk(3),\n  after it did walk(2) (at 2.00 s) and 2 steps before."
    )


@pytest.mark.parametrize(("agent", "link"), [("ann", "after"), ("bob", "because")])
def test_only_an_earlier_action_of_the_same_agent_is_linked_by_after(agent, link):
    history = following(record(0.0, agent, "action", "open(door)"), record(1.0, "ann", "action", "enter(room)"))
    explanation = explain(history, Wording(), history[1])
    assert [reason.link for reason in explanation.chain[1:]] == [link]
    assert f"\n  {link} " in explanation.text()


def test_of_a_chain_without_end_so_much_is_told_and_that_there_is_more():
    steps = [record(float(second), "ann", "action", f"walk({second})") for second in range(3_000)]
    history = following(*steps)
    told = explain(history, Wording(), history[len(history) - 1])
    assert (told.is_cut, len(told.chain)) == (True, MOST_LINKS + 2)
    assert told.chain[-1].sentence == "of what came before, which is left out after 500 links"
    assert not explain(history, Wording(), history[MOST_LINKS]).is_cut


def test_of_effects_without_number_so_many_are_told_and_how_many_more_there_are():
    asked = record(0.0, "ann", "command", "believe news", id="person-1")
    beliefs = [record(1.0, "ann", "belief", f"news({n})", "person-1", id=f"b{n}") for n in range(250)]
    told = explain(History([asked, *beliefs], start=100 * SECOND), Wording(), asked)
    assert (len(told.effects), told.effects_left_out) == (100, 150)


@pytest.mark.parametrize(
    ("cause", "told"),
    [
        ("gripper_desires.yaml", "gripper_desires.yaml says so"),
        ("Whereabouts-101500000000", "Whereabouts told it at 1.50 s"),
        ("add_belief", "somebody published it on add_belief"),
        ("health-camera", "the node camera said so of its health"),
        ("at first", "it began with that"),
        ("room1 is infected", "room1 is infected"),
        ("frame-7", "of frame-7"),
    ],
)
def test_a_chain_ends_with_what_is_no_record(cause, told):
    belief = record(2.0, "ann", "belief", "b", cause)
    history = History([belief], start=100 * SECOND)
    assert explain(history, Wording(), belief).chain[-1].sentence == told


def test_what_was_decided_at_a_time(waldo):
    said = actions(waldo.history)[-1]
    assert decided_at(waldo.history, said.stamp + SECOND) == [said]
    assert decided_at(waldo.history, waldo.history.start) == []


def test_why_a_plan_was_not_chosen(waldo):
    (several,) = why_not(waldo.history, "greeting_SEVERAL")
    assert (several.chosen_s, [each.because for each in several.rejected]) == ((), ["(N > 1) does not hold"])
    assert len(why_not(waldo.history, "GreetPeople")) == 4


def test_a_plan_that_was_never_considered_is_an_error_that_names_those_that_were(waldo):
    with pytest.raises(RunError, match="no plan 'dance' was ever considered") as caught:
        why_not(waldo.history, "dance")
    assert '\n    GreetPeople() >> [speak("greeting"), +greeted()]' in str(caught.value)


def test_why_there_was_no_plan_for_a_desire():
    planning = record(1.0, "ann", "planning", "fly", verdict="impossible", message="there is no wing")
    (found,) = why_not(History([planning], start=100 * SECOND), "fly")
    assert [(each.at_s, each.because) for each in found.rejected] == [(1.0, "there is no wing")]


def test_words_of_the_past():
    told = ("goes to room1", "tidies it", "moves on", "authenticates: ann", "puts a on b", "charges", "picks up")
    assert [past(each) for each in told] == [
        "went to room1", "tidied it", "moved on", "authenticated: ann", "put a on b", "charged", "picked up",
    ]  # fmt: skip
