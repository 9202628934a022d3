"""Questions about a conversation: who said what, how often, in reply to what, and why the robot said something."""

from __future__ import annotations

import pytest

from socialbot.runs.asking import Answer, answer
from tests.runs.asking.waldo_run import person, run_of

OFFER = "Can I help you with anything?"
ASKED, THANKED = "Yes, please, where is the library?", "Thank you very much."


@pytest.fixture(scope="module")
def talk():
    """A visitor is greeted at 1.2 s and offered help at 9.2 s, replies at 14 s and thanks at 24 s."""
    return run_of(
        lambda at_s: [person("t1", 2.0)] if 1.0 <= at_s < 30.0 else [], 34.0, heard={14.0: ASKED, 24.0: THANKED}
    )


def told(found: Answer) -> list[str]:
    """Return the words of each quoted sentence in an answer, in order."""
    return [clause.claim.what[0] for clause in found.clauses if clause.claim.kind in ("heard", "said", "did")]


@pytest.mark.parametrize(
    "question",
    [
        "Why did you say you are welcome?", 'Warum hast du "You are welcome" gesagt?',
        "Pourquoi as-tu dit « You are welcome » ?", "¿Por qué dijiste «You are welcome»?",
    ],
)  # fmt: skip
def test_a_reply_is_explained_by_what_the_person_said(talk, question):
    found = answer(talk, question)
    assert [clause.claim.kind for clause in found.clauses][1:] == ["heard"], found.text
    assert THANKED in found.text
    assert "recognized with" not in found.text


def test_the_answer_within_a_turn_is_explained_by_its_request(talk):
    found = answer(talk, "Why did you say 'How can I help you?'")
    assert told(found)[1:] == [ASKED], found.text


@pytest.mark.parametrize(
    ("question", "language"),
    [
        ('Wann hast du "You are welcome" gesagt?', "de"),
        ("Quand as-tu dit « You are welcome » ?", "fr"),
        ("¿Cuándo dijiste «You are welcome»?", "es"),
    ],
)
def test_words_that_were_said_are_told_in_the_language_of_the_question(talk, question, language):
    found = answer(talk, question)
    assert (found.language, len(found.clauses)) == (language, 1), found.text


@pytest.mark.parametrize(
    "question",
    [
        "What was the last thing I said?", "What was the last thing t1 said?",
        "Was war das Letzte, was ich gesagt habe?",
        "Quelle est la dernière chose que j'ai dite ?", "¿Qué fue lo último que dije?",
    ],
)  # fmt: skip
def test_the_last_words_of_a_person_are_those_of_the_person(talk, question):
    assert told(answer(talk, question))[:1] == [THANKED]


@pytest.mark.parametrize(
    "question",
    [
        "How often did I speak?", "Wie oft habe ich gesprochen?", "Combien de fois ai-je parlé ?",
        "¿Cuántas veces hablé?", "¿Cuántas veces te han hablado?",
    ],
)  # fmt: skip
def test_utterances_of_people_are_counted(talk, question):
    found = answer(talk, question)
    assert (found.clauses[0].claim.kind, found.clauses[0].claim.value) == ("count_heard", 2.0), found.text
    assert told(found) == [ASKED, THANKED]


def test_the_robot_counts_its_own_utterances(talk):
    assert answer(talk, "How often did you speak?").clauses[0].claim.value == 5.0


@pytest.mark.parametrize(
    "question",
    ["What did I reply to your offer?", "What did t1 reply to your offer?", "What did I say when you offered help?"],
)
def test_the_reply_of_a_person_is_told_to_a_deed(talk, question):
    assert told(answer(talk, question))[:1] == [ASKED]


@pytest.mark.parametrize(
    "question",
    [
        "What did you say after you greeted me?", "Was hast du gesagt, nachdem du mich begrüßt hast?",
        "Qu'as-tu dit après m'avoir salué ?", "¿Qué dijiste después de saludarme?",
    ],
)  # fmt: skip
def test_what_was_said_after_a_deed_begins_with_the_next_words(talk, question):
    assert told(answer(talk, question))[:1] == [OFFER], answer(talk, question).text


def test_right_after_a_deed_only_the_next_words_count(talk):
    assert told(answer(talk, "What did you say right after you greeted me?")) == [OFFER]


def test_a_person_who_was_told_something_has_not_said_it(talk):
    found = answer(talk, "What was the first visitor told?")
    assert all(clause.claim.kind in ("said", "did") for clause in found.clauses), found.text
