"""Questions back: which readings are offered, and which one a reply chooses."""

from __future__ import annotations

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.runs.asking import _answers, answer, asking_back, chosen_option, is_asked
from tests.runs.asking.waldo_run import two_visitors

UNCLEAR = "What about the first visitor?"
OPTIONS = ("what I did at 2.2 s", "what I said at 2.2 s")


@pytest.fixture(scope="module")
def run():
    return two_visitors()


def test_the_closest_readings_are_offered_with_their_answers(run):
    found = answer(run, UNCLEAR)
    assert not found.known
    assert not found.clauses
    assert found.text == f"Do you ask {OPTIONS[0]}, or {OPTIONS[1]}?"
    assert tuple(each.question for each in found.options) == OPTIONS
    assert [each.text for each in found.options] == [
        "At 2.2 s I greeted person t1.",
        'At 2.2 s I said "Hello! Nice to see you.".',
    ]
    for each in found.options:
        assert each.known
        assert each.clauses
        assert all(run.history.find(record) is not None for clause in each.clauses for record in clause.records)


def test_times_are_asked_aloud_as_people_say_them(run):
    found = answer(run, UNCLEAR, spoken=True)
    assert found.text == "Do you ask what I did 28 seconds ago, or what I said 28 seconds ago?"
    assert chosen_option([each.question for each in found.options], "what you said") == 2


@pytest.mark.parametrize(
    "text", ["Why did you greet t1?", "Why did you greet t9?", "purple elephants", "When was the room 7 empty?", ""]
)
def test_nothing_is_offered_for_questions_that_are_clear_hopeless_or_about_unknown_names(run, text):
    assert answer(run, text).options == ()


def test_a_shared_deed_is_named_once():
    assert asking_back(["why I greeted you"]) == "Do you ask why I greeted you?"
    assert asking_back(["why I greeted you", "when I greeted you"]) == "Do you ask why I greeted you, or when?"


@pytest.mark.parametrize(
    ("reply", "chosen"),
    [
        ("the first", 1), ("The second one, please.", 2), ("why", 1), ("When.", 2), ("yes", 1), ("Yes, why.", 1),
        ("I mean when you greeted me", 2), ("when I greeted you", 2), ("no", 0), ("No, when!", 2), ("", 0),
        ("Where is the library?", 0), ("Why did you offer help?", 0), ("why or when", 0),
        ("the first and the second", 0),
    ],
)  # fmt: skip
def test_a_reply_chooses_a_reading(reply, chosen):
    assert chosen_option(["why I greeted you", "when I greeted you"], reply) == chosen


def test_there_is_no_second_reading_to_choose():
    assert chosen_option(["who was here"], "yes") == 1
    assert chosen_option(["who was here"], "the second") == 0


@pytest.mark.parametrize(
    ("text", "is_question"),
    [
        ("Why did you greet me?", True), ("Please tell me who was here", True), ("Did you greet me", True),
        ("Didn't you greet me?", True), ("Do not call Anna, call Thomas.", False), ("All people were here.", False),
        ("I wonder when t1 left", True), ("", False),
    ],
)  # fmt: skip
def test_the_form_of_a_question(text, is_question):
    assert is_asked(text, "en") == is_question


def test_facts_are_kept_until_the_next_record():
    live = two_visitors()
    facts = _answers.facts_of(live)
    assert _answers.facts_of(live) is facts
    assert answer(live, "How many people were here?").text == "2 people were here."
    later = PersonDetection(x=100, y=50, w=80, h=200, score=0.9, track_id="t3", distance_m=4.0, facing_rad=0.2)
    stamp = live.end + SECOND
    frame = PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=(later,))
    live.observe("/humans/bodies/detections", frame)
    assert _answers.facts_of(live) is not facts
    assert answer(live, "How many people were here?").text == "3 people were here."
