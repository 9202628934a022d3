"""Why somebody was not greeted: out of range, in a conversation, or with a rejection that concerns this person."""

from __future__ import annotations

import pytest

from socialbot.runs.asking import answer
from socialbot.runs.history import History
from socialbot.runs.run import RunView
from tests.runs.asking.written_runs import faults, write_run
from tests.runs.expectations.traces import frame, record

ON_ENGAGES = "+engages(Who) / (ungreeted(Who)) >> [GreetPeople()]"
AFTER_TALK = "-converses(Who) / (ungreeted(Who)) >> [GreetPeople()]"
SPEAKS = 'GreetPeople() >> [speak("greeting")]'


def rejected(name: str) -> list[dict[str, str]]:
    return [{"plan": plan, "because": f'ungreeted("{name}") does not hold'} for plan in (ON_ENGAGES, AFTER_TALK)]


@pytest.fixture(scope="module")
def records():
    """Waldo greets t1. t2 and t3 talk with each other, t4 is far away, t5 engages, and t1 leaves the talk."""
    engages = record(2.0, "belief", 'engages("t1")', id="engages")
    plan = record(2.0, "plan", "+engages(Who)", cause="engages", id="plan", rule=ON_ENGAGES)
    goal = record(2.0, "goal", "GreetPeople()", cause="plan", id="goal")
    speaks = record(2.0, "plan", "GreetPeople()", cause="goal", id="speaks", rule=SPEAKS)
    action = record(2.0, "action", 'speak("greeting")', cause="speaks", id="action")
    return [
        frame(0.0, t1=3.0, t2=3.0, t3=3.0, t4=12.0, t5=3.0),
        *(record(0.0, "belief", f'present("{name}")') for name in ("t1", "t2", "t3", "t5")),
        *(record(1.0, "belief", f'converses("{name}")') for name in ("t2", "t3")),
        engages, plan, goal, speaks, action,
        record(2.0, "belief", 'greeted("t1")', cause="speaks"),
        record(3.0, "belief", 'engages("t5")'),
        record(3.0, "unhandled", '+engages("t5")', rejected=rejected("t5")),
        record(4.0, "unbelief", 'converses("t3")'),
        record(4.0, "unhandled", '-converses("t3")', rejected=rejected("t3")),
        frame(5.0, t1=3.0, t2=3.0, t3=3.0, t4=12.0, t5=3.0),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("question", "reason"),
    [
        ("Why didn't you greet t2?", "person t2 was talking with somebody"),
        ("Why didn't you greet t3?", "person t3 was talking with somebody"),
        ("Warum hast du t2 nicht begrüßt?", "Person t2 hat sich mit jemandem unterhalten"),
        ("Pourquoi n'as-tu pas salué t2 ?", "la personne t2 parlait avec quelqu'un"),
        ("¿Por qué no saludaste a t2?", "la persona t2 hablaba con alguien"),
        ("Why didn't you greet t4?", "I did not see person t4 near me"),
        ("Why didn't you greet t5?", 'ungreeted("t5") does not hold'),
    ],
)
def test_a_person_is_not_greeted_for_a_reason_of_this_person(tmp_path, records, question, reason):
    found = answer(RunView(None, History(records), None), question)
    assert reason in found.text
    assert faults(write_run(tmp_path / "run", records), found) == []
