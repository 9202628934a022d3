"""Deeds of people: that the robot greeted t1 does not tell that t1 greeted the robot."""

from __future__ import annotations

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.core.vocabulary import Vocabulary
from socialbot.runs.asking import answer
from socialbot.runs.asking._facts import Facts
from socialbot.runs.asking._sentences import Speech
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.history import History
from socialbot.runs.narration import Wording
from socialbot.runs.run import RunView
from tests.runs.asking.waldo_run import person, run_of, two_visitors


@pytest.fixture(scope="module")
def run():
    return two_visitors()


@pytest.fixture(scope="module")
def talk():
    return run_of(
        lambda at_s: [person("t1", 2.0)] if 1.0 <= at_s < 20.0 else [],
        22.0,
        heard={6.0: "Hello.", 12.0: "Thank you very much."},
    )


@pytest.mark.parametrize(
    "question",
    [
        "Did t1 greet you?", "Why did t1 greet you?", "When did t1 greet you?", "How often did t1 greet you?",
        "Did the first visitor greet you?", "Did anybody greet you?", "Who greeted you?", "Did t1 greet t2?",
        "Did t2 offer you help?", "Did t2 offer help to you?", "Has anyone offered you help?", "Did I greet you?",
        "Did t1 say hello to you?", "What did you do after t1 greeted you?",
        "Were you greeted by t1?", "Were you offered help by t1?", "Was t2 greeted by t1?", "Were you greeted?",
        "Did you get greeted by t1?", "Did you get help from t1?", "Have you been greeted?",
        "Hat t1 dich begrüßt?", "Wann hat t1 dich begrüßt?", "Wer hat dich begrüßt?", "Hat dir t1 Hilfe angeboten?",
        "Hat der erste Besucher dich begrüßt?", "Hat t1 t2 begrüßt?", "Wurdest du von t1 begrüßt?",
        "Bist du von t1 begrüßt worden?", "Wurdest du begrüßt?",
        "T'a-t-il salué ?", "t1 t'a-t-il salué ?", "Est-ce que t1 t'a salué ?", "Qui t'a salué ?",
        "t1 vous a-t-il salué ?", "t1 a-t-il salué t2 ?", "As-tu été salué par t1 ?", "t1 t'a proposé son aide ?",
        "¿Te saludó t1?", "¿Por qué te saludó t1?", "¿Quién te saludó?", "¿Te ha saludado t1?",
        "¿Te ofreció t1 ayuda?", "¿Saludó t1 a t2?", "¿Fuiste saludado por t1?", "¿Has sido saludado por t1?",
    ],
)  # fmt: skip
def test_what_people_did_is_not_told_from_deeds_of_the_robot(run, question):
    found = answer(run, question)
    assert not found.known
    assert not any(each.clauses[0].claim.kind in ("did", "said") for each in found.options)


@pytest.mark.parametrize(
    "question",
    [
        "Did you greet t1?", "Was t1 greeted by you?", "Was t1 greeted?", "Did t1 get a greeting?",
        "Did t1 receive a greeting from you?", "What made you greet t1?", "You greeted t1, didn't you?",
        "Hast du t1 begrüßt?", "Wurde t1 begrüßt?", "Hat t1 eine Begrüßung bekommen?",
        "Was hat dich dazu gebracht, t1 zu begrüßen?",
        "As-tu salué t1 ?", "T'as salué t1 ?", "Avez-vous salué t1 ?", "t1 a-t-il été salué ?",
        "¿Saludaste a t1?", "¿Has saludado a t1?", "¿Fue saludado t1?", "¿Por qué saludaste a t1?",
    ],
)  # fmt: skip
def test_deeds_of_the_robot_are_told_in_active_and_passive_voice(run, question):
    claims = [clause.claim for clause in answer(run, question).clauses]
    assert claims
    assert (claims[0].kind, claims[0].persons, claims[0].at_s) == ("did", ("t1",), 2.2)


def test_anybody_may_be_the_robot(run):
    assert answer(run, "Did anybody offer help to t1?").text == "Yes: at 10.2 s I offered person t1 help."


@pytest.mark.parametrize("question", ["Who greeted you?", "Were you greeted by t1?", "When did t1 greet you?"])
def test_what_people_said_is_told_as_what_they_did(talk, question):
    claims = [clause.claim for clause in answer(talk, question).clauses]
    assert [(claim.kind, claim.what, claim.persons) for claim in claims] == [("heard", ("Hello.",), ("t1",))]


def test_who_is_asked_is_not_told_what_the_robot_said(talk):
    claims = [clause.claim for clause in answer(talk, "What did t1 say to you?").clauses]
    assert [claim.what[0] for claim in claims if claim.kind == "heard"] == ["Hello.", "Thank you very much."]
    for question in ("Did t1 say goodbye to you?", "Did anybody say thank you to you?"):
        assert not answer(talk, question).text.startswith(("Yes", "No"))


@pytest.mark.parametrize(
    "question", ["What did I say?", "Was habe ich gesagt?", "Qu'est-ce que j'ai dit ?", "¿Qué he dicho?"]
)
def test_who_asks_is_told_what_he_said_himself(talk, question):
    claims = [clause.claim for clause in answer(talk, question).clauses]
    assert [claim.what[0] for claim in claims if claim.kind == "heard"] == ["Hello.", "Thank you very much."]


def test_the_robot_is_asked_whether_it_heard_somebody(talk):
    claims = [clause.claim for clause in answer(talk, "Did you hear me say thank you?").clauses]
    assert [claim.what for claim in claims if claim.kind == "heard"] == [("Thank you very much.",)]


def test_what_was_said_to_who_came_in_is_told(talk):
    claims = [clause.claim for clause in answer(talk, "What did you say to me when I came in?").clauses]
    assert claims
    assert {claim.kind for claim in claims} <= {"said", "did"}


def test_what_an_agent_calls_its_own_is_my_in_its_answer():
    records = [TraceRecord(stamp=SECOND, id="a-1", source="cleaner", kind="action", what="recharge(cleaner, dock)")]
    wording = Wording({}, {"recharge": "fills its battery at {1}"})
    run = RunView(None, History(records), None)
    facts = Facts(Subjects(run.history, wording, Vocabulary(), {}))
    assert Speech(facts, "en", "", is_single=True).did(records[0], None, at=False).text == "I filled my battery at dock"
    assert (
        Speech(facts, "en", "", is_single=False).did(records[0], None, at=False).text.startswith("cleaner filled its")
    )
