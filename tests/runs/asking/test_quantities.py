"""Words of quantity and order: a deed that was done once is no "yes" to "twice", "only", "first" or "never"."""

from __future__ import annotations

import pytest

from socialbot.runs.asking import answer
from tests.runs.asking.waldo_run import two_visitors

GREETED_T1, GREETED_T2 = "at 2.2 s I greeted person t1", "at 20.2 s I greeted person t2"
HELPED_T1 = "at 10.2 s I offered person t1 help"
BOTH = f"{GREETED_T1} and {GREETED_T2}."
NOT_HELPED = "I did not offer person t2 help because person t2 had only been here for 4.7 s"


@pytest.fixture(scope="module")
def run():
    return two_visitors()


@pytest.mark.parametrize(
    "question",
    [
        "Did you greet t1 twice?", "Did you greet t1 more than once?", "Did you greet t1 again?",
        "Did you greet t1 a second time?", "Did you greet t1 three times?", "Did you greet t1 only once?",
        "Did you greet t1 at most once?", "Did you greet t1 every time?", "How often did you greet t1?",
        "How many times did you greet t1?", "You greeted t1 twice, didn't you?", "You greeted t1 once, didn't you?",
    ],
)  # fmt: skip
def test_several_times_are_counted(run, question):
    assert answer(run, question).text == f"Once: {GREETED_T1}."


@pytest.mark.parametrize(
    ("question", "begin"),
    [
        # Several times in other languages
        ("Hast du t1 zweimal begrüßt?", "Einmal: "), ("Hast du t1 noch einmal begrüßt?", "Einmal: "),
        ("Hast du t1 wieder begrüßt?", "Einmal: "), ("As-tu salué t1 deux fois ?", "Une fois: "),
        ("As-tu salué t1 plus d'une fois ?", "Une fois: "), ("As-tu salué t1 encore une fois ?", "Une fois: "),
        ("¿Saludaste a t1 dos veces?", "Una vez: "), ("¿Saludaste a t1 otra vez?", "Una vez: "),
        # People are counted if the question asks for people
        ("How many people did you greet?", "2 people: "), ("How many visitors did you offer help to?", "One person: "),
        ("How many times did you greet people?", "2 times: "), ("Wie viele Leute hast du begrüßt?", "2 Personen: "),
        ("Combien de personnes as-tu saluées ?", "2 personnes: "), ("¿A cuántas personas saludaste?", "2 personas: "),
    ],
)  # fmt: skip
def test_several_times_and_people_are_counted(run, question, begin):
    assert answer(run, question).text.startswith(begin)


@pytest.mark.parametrize(
    "question",
    [
        "Did you greet anybody else?", "Did you greet anybody else than t1?", "Did you greet anyone besides t1?",
        "Did you only greet t1?", "Did you greet three people?", "Did you greet most of the people?",
        "Was anybody greeted twice?", "Did you greet at least two people?",
    ],
)  # fmt: skip
def test_others_are_listed(run, question):
    assert answer(run, question).text.lower() == BOTH.lower()


@pytest.mark.parametrize(
    "question",
    [
        "Did you greet nobody?", "Was nobody greeted?", "Did you never greet t2?", "Did you not greet t2?",
        "Hast du niemanden begrüßt?", "N'as-tu salué personne ?", "¿No saludaste a nadie?",
    ],
)  # fmt: skip
def test_negative_questions_are_answered_without_yes_and_no(run, question):
    found = answer(run, question)
    assert [clause.claim.kind for clause in found.clauses] == ["did"]
    assert found.text.rstrip(".").lower() == found.clauses[0].text.lower()


@pytest.mark.parametrize(
    ("question", "text"),
    [
        # Several people and the order of deeds
        ("Did you offer t1 and t2 help?", f"{HELPED_T1}; {NOT_HELPED}."),
        ("Did you greet both t1 and t2?", f"Yes: {GREETED_T1}; {GREETED_T2}."),
        ("Did you greet t1 first?", f"Yes: {GREETED_T1}."),
        ("Did you greet t2 first?", f"No: {GREETED_T1} and {GREETED_T2}."),
        ("Did you greet t1 last?", f"No: {GREETED_T2} and {GREETED_T1}."),
        ("Did you greet t1 before you offered help?", f"Yes: {GREETED_T1} and {HELPED_T1}."),
        ("Did you offer help before you greeted t1?", f"No: {HELPED_T1} and {GREETED_T1}."),
        ("Did you greet t1 and then offer help?", f"Yes: {GREETED_T1} and {HELPED_T1}."),
        ("Did you first offer help and then greet t1?", f"No: {HELPED_T1} and {GREETED_T1}."),
        # A comparison by time has both deeds in order
        ("Did you greet t1 or t2 first?", f"{GREETED_T1} and {GREETED_T2}."),
        ("Did you greet t1 or t2 last?", f"{GREETED_T1} and {GREETED_T2}."),
        ("Did you offer t1 or t2 help first?", f"{HELPED_T1}; {NOT_HELPED}."),
    ],
)
def test_several_people_and_the_order_of_deeds(run, question, text):
    assert answer(run, question).text.lower() == text.lower()


@pytest.mark.parametrize(
    "question",
    [
        "Did you greet t1 and t2 together?", "Did you greet t1 and t2 at the same time?", "Did you greet t1 too late?",
        "Did you greet t2 earlier than t1?", "Did you greet t1 instead of t2?", "Did you greet t1 because t2 left?",
        "Did you greet a woman?", "Hast du t1 und t2 gleichzeitig begrüßt?", "As-tu salué t1 trop tard ?",
        "¿Saludaste a t1 porque t2 se fue?",
    ],
)  # fmt: skip
def test_more_than_the_records_tell_gets_no_yes_and_no(run, question):
    assert not answer(run, question).text.startswith(("Yes", "No:", "Ja", "Nein", "Oui", "Non", "Sí"))


def test_alternatives_are_answered_without_yes_and_no(run):
    found = answer(run, "Was t2 greeted before or after you offered help?")
    assert found.text.startswith("At ")
    assert [clause.claim.kind for clause in found.clauses] == ["did", "did"]


@pytest.mark.parametrize(
    "question",
    [
        "What if t2 had stayed longer?", "Would you have helped t2?", "What would happen if nobody came?",
        "Was wäre passiert, wenn t2 geblieben wäre?", "Que se serait-il passé si t2 était resté ?",
        "¿Qué habrías hecho sin t1?",
    ],
)  # fmt: skip
def test_what_did_not_happen_is_not_known(run, question):
    assert not answer(run, question).known


def test_words_that_were_said_are_counted_and_not_denied(run):
    assert answer(run, "Did you say hello twice?").text.startswith("2 times: ")
