from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from socialbot.bdi import Action, Belief, Engine, Event, Goal, Plan, Record, Sensor, variables
from socialbot.core.clock import SECOND, ManualClock
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


def test_utterance_is_explained_down_to_the_frame(waldo):
    said = explain(waldo.history, waldo.wording, actions(waldo.history)[-1])
    at_s = said.chain[0].at_s
    text = re.sub(r"waldo\.py:\d+", "waldo.py:LINE", said.text())
    assert text.split("\n") == [
        f'At {at_s:.2f} s Waldo said "Hello! Nice to see you.",',
        '  because it did speak("greeting"),',
        "  by its rule 'GreetPeople()' (waldo.py:LINE),",
        "  because it wanted GreetPeople(),",
        "  by its rule '+engages(Who) / (ungreeted(Who))' (waldo.py:LINE), where ungreeted(\"t1\") held,",
        '  because it believed engages("t1") (source: percept),',
        "  because t1 does not turn away (100 % of 3 frames),",
        f"  because the frame at {at_s:.2f} s showed person t1 4.0 m away.",
    ]
    assert said.frame_s == at_s
    assert [(each.plan, each.because) for each in said.rejected] == [
        (
            'GreetPeople() / (several()) >> [speak("greeting_several"), for_each(ungreeted(Who), [+greeted(Who)])]',
            "several() does not hold",
        ),
        ("+engages(Who) / (ungreeted(Who) & hears(Who)) >> [+greeted(Who)]", 'hears("t1") does not hold'),
        ("+engages(Who) / (ungreeted(Who) & delayed(Who)) >> []", 'delayed("t1") does not hold'),
    ]
    assert "speech" in {effect.kind for effect in said.effects}


def test_links_have_ids_of_records(waldo):
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


def test_step_has_its_plan_and_the_requesting_agent():
    history = following(*HELPING)
    explained = explain(history, Wording({}, PHRASES), history[len(history) - 1]).text()
    assert explained.split("\n") == [
        "At 1.20 s ann went from hall to home, step 1 of 2 of plan 3 for be_home,",
        "  because it wanted be_home (at 1.10 s),",
        "  because bob asked ann for be_home (at 1.00 s),",
        "  because it asked ann to help, step 1 of 1 of plan 1 for help_ann,",
        "  because it wanted help_ann (at 0.00 s),",
        "  because of desires.yaml.",
    ]


def test_earlier_steps_are_summarised():
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


def test_long_chain_is_cut():
    steps = [record(float(second), "ann", "action", f"walk({second})") for second in range(3_000)]
    history = following(*steps)
    explained = explain(history, Wording(), history[len(history) - 1])
    assert (explained.is_cut, len(explained.chain)) == (True, MOST_LINKS + 2)
    assert explained.chain[-1].sentence == "of earlier causes, which are left out after 500 links"
    assert not explain(history, Wording(), history[MOST_LINKS]).is_cut


def test_effects_are_limited():
    asked = record(0.0, "ann", "command", "believe news", id="person-1")
    beliefs = [record(1.0, "ann", "belief", f"news({n})", "person-1", id=f"b{n}") for n in range(250)]
    explained = explain(History([asked, *beliefs], start=100 * SECOND), Wording(), asked)
    assert (len(explained.effects), explained.effects_left_out) == (100, 150)


@pytest.mark.parametrize(
    ("cause", "expected"),
    [
        ("gripper_desires.yaml", "of gripper_desires.yaml"),
        ("Whereabouts-101500000000", "Whereabouts reported it at 1.50 s"),
        ("add_belief", "it was published on add_belief"),
        ("health-camera", "of the health of node camera"),
        ("at first", "it was there at the start"),
        ("room1 is infected", "room1 is infected"),
        ("frame-7", "of frame-7"),
    ],
)
def test_chain_ends_with_the_external_cause(cause, expected):
    belief = record(2.0, "ann", "belief", "b", cause)
    history = History([belief], start=100 * SECOND)
    assert explain(history, Wording(), belief).chain[-1].sentence == expected


def test_decisions_at_a_time(waldo):
    said = actions(waldo.history)[-1]
    assert decided_at(waldo.history, said.stamp + SECOND // 4) == [said]
    assert decided_at(waldo.history, said.stamp + SECOND) == decided_at(waldo.history, waldo.history.start) == []


def test_rejected_plan_has_its_reasons(waldo):
    several, leading = why_not(waldo.history, "greeting_SEVERAL")
    assert (several.chosen_s, [each.because for each in several.rejected]) == ((), ["several() does not hold"])
    assert (leading.plan.partition(" ")[0], leading.leads_to, leading.rejected) == ("+engages(Who)", several.plan, ())
    assert len(why_not(waldo.history, "GreetPeople")) == 3


class near(Belief):  # noqa: N801
    pass


class greeted(Belief):  # noqa: N801
    pass


class greet(Goal):  # noqa: N801
    pass


class speak(Action):  # noqa: N801
    def execute(self, text: str) -> None:
        pass


def mind(*rules: Plan) -> tuple[Engine, ManualClock, Callable[[], History]]:
    """An agent with these rules, its clock, and its history so far."""
    records: list[TraceRecord] = []

    def keep(each: Record) -> None:
        detail = {name: value for name, value in each.detail.items() if value is not None}
        made = {"stamp": each.time, "id": each.id, "kind": each.kind, "what": each.what, "cause": each.cause}
        records.append(TraceRecord(source="ann", detail=detail, **made))

    clock = ManualClock(100 * SECOND)
    engine = Engine("ann", clock, sink=keep)
    engine.add_rules(*rules)
    return engine, clock, lambda: History(records, start=100 * SECOND)


def tell(engine: Engine, clock: ManualClock, at_s: float, belief: Belief) -> None:
    clock.set(round((100 + at_s) * SECOND))
    engine.believe(belief)
    engine.run_until_idle()


def test_plan_behind_the_chosen_one_was_not_considered():
    Who = variables("Who")  # noqa: N806
    engine, clock, history = mind(
        +near(Who) >> [greet()],
        greet() / greeted() >> [],
        greet() >> [speak("greeting"), +greeted()],
    )
    tell(engine, clock, 6.4, near("bob"))
    tell(engine, clock, 23.1, near("eve"))
    greeting_plan, leading = why_not(history(), 'speak("greeting")')
    assert greeting_plan.chosen_s == (6.4,)
    (no,) = greeting_plan.rejected
    assert (no.at_s, re.sub(r":\d+", ":LINE", no.because)) == (
        23.1,
        "not considered: the rule 'greet() / (greeted())' (test_why.py:LINE) was chosen, "
        "where greeted() held since 6.40 s",
    )
    assert (leading.plan, leading.chosen_s) == ("+near(Who) >> [greet()]", (6.4, 23.1))
    assert greeting_plan.near(23.3).rejected == (no,)
    assert greeting_plan.near(6.4).rejected == greeting_plan.near(15.0).rejected == ()


def test_event_without_an_applicable_plan_says_why():
    Who = variables("Who")  # noqa: N806
    engine, clock, history = mind(+near(Who) / ~greeted() >> [greet()], greet() >> [+greeted()])
    tell(engine, clock, 1.0, near("bob"))
    tell(engine, clock, 2.0, near("eve"))
    (_, leading) = why_not(history(), "greet() >>")
    (no,) = leading.rejected
    assert (no.at_s, no.event, no.because) == (2.0, '+near("eve")', "~greeted() does not hold")


def test_sensor_gives_the_reason_of_a_belief():
    class Eye(Sensor):
        def sense(self, percept: float) -> Event:
            return (+near("bob")).because(f"bob is {percept} m away")

    engine, _, history = mind(+near(variables("Who")) >> [speak("hello")])
    eye = Eye()
    engine.add_sensor(eye)
    for distance_m in (1.5, 1.4):
        eye.push(distance_m)
        engine.run_until_idle()
    percepts = [each.what for each in history() if each.kind == "percept"]
    assert percepts == ["bob is 1.5 m away"]
    done = explain(history(), Wording(), actions(history())[-1])
    assert "because ann believed" in done.text().replace("it believed", "ann believed")
    assert done.chain[-1].sentence == "bob is 1.5 m away"


def test_unknown_plan_is_an_error_with_the_known_ones(waldo):
    with pytest.raises(RunError, match="no plan 'dance' was ever considered") as caught:
        why_not(waldo.history, "dance")
    assert '\n    GreetPeople() >> [speak("greeting"), for_each(ungreeted(Who), [+greeted(Who)])]' in str(caught.value)


def test_missing_plan_of_a_desire_has_its_reason():
    planning = record(1.0, "ann", "planning", "fly", verdict="impossible", message="there is no wing")
    (found,) = why_not(History([planning], start=100 * SECOND), "fly")
    assert [(each.at_s, each.because) for each in found.rejected] == [(1.0, "there is no wing")]


def test_past_tense():
    explained = ("goes to room1", "tidies it", "moves on", "authenticates: ann", "puts a on b", "charges", "picks up")
    assert [past(each) for each in explained] == [
        "went to room1", "tidied it", "moved on", "authenticated: ann", "put a on b", "charged", "picked up",
    ]  # fmt: skip
