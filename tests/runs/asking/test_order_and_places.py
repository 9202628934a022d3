"""Questions about the time between two events, the order of deeds, places of people, and people left out."""

from __future__ import annotations

import json

import msgspec
import pytest

from evaluation.questions_check import Verifier
from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.core.vocabulary import Deed, Vocabulary
from socialbot.runs.asking import answer
from socialbot.runs.asking._answers import facts_of
from socialbot.runs.asking._facts import Facts
from socialbot.runs.asking._readings import candidates
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.folder import open_run
from socialbot.runs.history import History
from socialbot.runs.narration import Wording
from socialbot.runs.run import RunView
from tests.runs.asking.waldo_run import person, run_of

KITCHEN = (
    ("cook_a", "peel(cook_a, carrot_1)"),
    ("cook_a", "fry(cook_a, onion_1)"),
    ("cook_a", "stir(cook_a, soup)"),
    ("waiter_b", "serve(waiter_b, table_4)"),
    ("cook_a", "peel(cook_a, carrot_2)"),
    ("waiter_b", "serve(waiter_b, table_2)"),
    ("cook_a", "peel(cook_a, carrot_3)"),
)
"""Agents without vocabulary with their actions, one each two seconds."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "kitchen"
    folder.mkdir()
    records = (
        TraceRecord(stamp=2 * n * SECOND, id=f"{source}-{n}", source=source, kind="action", what=what)
        for n, (source, what) in enumerate(KITCHEN)
    )
    (folder / "trace.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in records))
    (folder / "results.json").write_text("{}")
    return folder


@pytest.fixture(scope="module")
def kitchen(folder) -> RunView:
    return open_run(folder)


@pytest.fixture(scope="module")
def visits():
    """Three visitors: t1 on the right, t2 in the middle, t3 on the left, who looks away."""
    places = {"t1": (2.0, 14.0, 500.0), "t2": (20.0, 25.0, 280.0), "t3": (30.0, 36.0, 20.0)}

    def seen(at_s: float):
        for name, (begin, end, x) in places.items():
            if begin <= at_s < end:
                one = person(name, 3.0 if name == "t1" else 2.0)
                yield msgspec.structs.replace(one, x=x, facing_rad=2.9 if name == "t3" else 0.2)

    return run_of(seen, 40.0)


@pytest.mark.parametrize(
    ("question", "language"),
    [
        ("What did you say to the two who came in?", "en"),
        ("Was hast du den beiden gesagt, die hereinkamen?", "de"),
        ("Qu'as-tu dit aux deux qui sont venus ?", "fr"),
        ("¿Qué les dijiste a los dos que vinieron?", "es"),
    ],
)
def test_two_whom_a_clause_describes_came_together(visits, question, language):
    subjects = facts_of(visits).subjects
    readings = [each.question for each in candidates(question, subjects, language)]
    assert any(each.person is not None and each.person.together for each in readings)


def claims(found) -> list[tuple[str, str]]:
    return [(clause.claim.kind, *clause.claim.persons) for clause in found.clauses]


@pytest.mark.parametrize(
    ("told", "questions"),
    [
        (
            ["saw t1"],
            ("Who was the farthest away?", "Wer war am weitesten weg?", "\u00bfQui\u00e9n estuvo m\u00e1s lejos?"),
        ),
        (["saw t2", "saw t3"], ("Who came closest?", "Wer war am n\u00e4chsten?", "Qui \u00e9tait le plus proche ?")),
        (["saw t2"], ("Who came nearer, t1 or t2?",)),
        (["saw t1", "saw t2"], ("Was t1 nearer than t2?",)),
        (["here t3"], ("Who stayed longer, t2 or t3?", "\u00bfQui\u00e9n se qued\u00f3 m\u00e1s tiempo, t2 o t3?")),
        (["here t2", "here t3"], ("Did t2 stay longer than t3?", "Blieb t2 l\u00e4nger als t3?")),
        (["here t1"], ("Who stayed longer than ten seconds?", "How many people stayed longer than ten seconds?")),
        (["here t1"], ("Wer blieb l\u00e4nger als zehn Sekunden?", "Qui est rest\u00e9 plus de dix secondes ?")),
        (["here t2", "here t3"], ("Which visitors stayed less than 8 seconds?", "Who came within 2.5 metres?")),
    ],
)
def test_visits_are_compared_and_limited(visits, told, questions):
    found = {question: [" ".join(each) for each in claims(answer(visits, question))] for question in questions}
    assert found == dict.fromkeys(questions, told)


def test_who_was_here_at_the_same_time_is_not_the_person_in_question():
    both = run_of(
        lambda at_s: [person(name, 2.0) for name in ("t1", "t2")] if at_s < 9.0 else [person("t3", 2.0)], 15.0
    )
    for question in ("Who was here at the same time as t1?", "Wer war gleichzeitig mit t1 hier?"):
        assert claims(answer(both, question)) == [("here", "t2")]
    assert not answer(both, "Who was here at the same time as t3?").known


def test_a_limit_is_not_taken_for_a_time(visits):
    assert not answer(visits, "What did you do for more than 10 seconds?").known
    assert not answer(visits, "Did anybody stay longer than 20 seconds?").known


@pytest.mark.parametrize("question", ["Why were you idle at the beginning?", "Warum warst du am Anfang untätig?"])
def test_beginning_is_the_first_time_of_a_deed(visits, question):
    (clause, *_) = answer(visits, question).clauses
    assert (clause.claim.kind, clause.claim.at_s) == ("did", 15.9)


def calls(found) -> list[str]:
    return [call for clause in found.clauses for call in clause.claim.what]


@pytest.mark.parametrize(
    ("question", "done"),
    [
        ("What did the cook do between peeling carrot 1 and peeling carrot 2?", ["fry", "stir"]),
        ("Between onion 1 and carrot 2, what did the cook do?", ["stir"]),
        ("What happened between carrot 2 and carrot 1?", ["fry", "stir", "serve"]),
    ],
)
def test_deeds_between_two_others_are_told(kitchen, folder, question, done):
    found = answer(kitchen, question)
    assert [call.partition("(")[0] for call in calls(found)] == done
    assert not Verifier(folder).faults(json.loads(msgspec.json.encode(found)))


@pytest.mark.parametrize(
    "question",
    [
        # A time between what did not happen is unknown
        "What happened between carrot 1 and carrot 9?",
        "What did you do between the comet and the eclipse?",
        # Things of which no record tells are unknown
        "Which carrot was not peeled?",
        "Which table was never served?",
        "Which onion was peeled but not fried?",
    ],
)
def test_what_no_record_of_the_kitchen_tells_is_unknown(kitchen, question):
    assert not answer(kitchen, question).known


@pytest.mark.parametrize(
    "question",
    [
        "What did you do between t1 and t2?", "What happened between the first visitor and the second?",
        "Was hast du zwischen t1 und t2 getan?", "Qu'as-tu fait entre t1 et t2 ?", "¿Qué hiciste entre t1 y t2?",
    ],
)  # fmt: skip
def test_the_time_between_two_people_is_that_without_them(visits, question):
    times = [clause.claim.at_s for clause in answer(visits, question).clauses]
    assert times
    assert all(at_s is not None and 13.9 <= at_s <= 20.0 for at_s in times)


def test_how_long_it_was_between_two_deeds_is_told_by_both(visits):
    found = answer(visits, "How long was it between the first greeting and the second?")
    assert [clause.claim.persons for clause in found.clauses] == [("t1",), ("t2",)]


@pytest.mark.parametrize(
    ("question", "call"),
    [
        ("Which carrot was peeled second?", "peel(cook_a, carrot_2)"),
        ("Which carrot was peeled last?", "peel(cook_a, carrot_3)"),
        ("Which carrot was the third to be peeled?", "peel(cook_a, carrot_3)"),
        ("Which table was served first?", "serve(waiter_b, table_4)"),
    ],
)
def test_order_is_counted_with_and_without_an_article(kitchen, question, call):
    assert calls(answer(kitchen, question)) == [call]


@pytest.mark.parametrize(
    ("question", "who"),
    [
        ("Who was greeted second?", "t2"), ("Whom did you greet last?", "t2"), ("Wen hast du zuletzt begrüßt?", "t2"),
        ("Wer wurde als Zweiter begrüßt?", "t2"), ("Qui as-tu salué en deuxième ?", "t2"),
        ("¿A quién saludaste en segundo lugar?", "t2"), ("Who did you greet first?", "t1"),
        ("Who did you greet right after t1?", "t2"),
    ],
)  # fmt: skip
def test_people_are_told_in_the_order_in_question(visits, question, who):
    assert [clause.claim.persons for clause in answer(visits, question).clauses] == [(who,)]


@pytest.mark.parametrize("question", ["At what second did you greet t1?", "In which second did you greet t1?"])
def test_a_second_in_time_is_no_order(visits, question):
    assert [clause.claim.at_s for clause in answer(visits, question).clauses] == [2.2]


@pytest.mark.parametrize(
    "question",
    [
        "What did you do right after you greeted t1?", "Was hast du direkt nach der Begrüßung von t1 getan?",
        "Qu'as-tu fait juste après avoir salué t1 ?", "¿Qué hiciste justo después de saludar a t1?",
    ],
)  # fmt: skip
def test_the_next_deed_after_another_is_told(visits, question):
    assert [clause.claim.at_s for clause in answer(visits, question).clauses] == [10.2]


@pytest.mark.parametrize(
    ("question", "at_s", "who", "side"),
    [
        ("Where was t1 at 5 s?", 5.0, "t1", "right"), ("Where is t2?", 24.9, "t2", "middle"),
        ("Where was the third visitor?", 35.9, "t3", "left"),
        ("Where was the second visitor at 22 s?", 22.0, "t2", "middle"),
        ("Wo war t1 bei 5 s?", 5.0, "t1", "right"), ("Où était t1 à 5 s ?", 5.0, "t1", "right"),
        ("¿Dónde estaba t1 a los 5 s?", 5.0, "t1", "right"),
    ],
)  # fmt: skip
def test_people_are_where_they_were_seen(visits, question, at_s, who, side):
    claims = [clause.claim for clause in answer(visits, question).clauses]
    assert [(one.kind, one.at_s, one.persons, one.what) for one in claims] == [("saw", at_s, (who,), (side,))]


@pytest.mark.parametrize(
    "question", ["At what distance did you greet t1?", "How far away was t1 when you greeted them?"]
)
def test_the_distance_at_a_deed_is_told_with_the_deed(visits, question):
    claims = [clause.claim for clause in answer(visits, question).clauses]
    assert [(one.kind, one.value) for one in claims] == [("did", None), ("saw", 3.0)]


@pytest.mark.parametrize(
    "question",
    [
        "Who got nothing from you?", "Who was left out?", "Did you leave anyone out?", "Who went away empty-handed?",
        "Wer ging leer aus?", "Wer hat nichts bekommen?", "Qui n'a rien reçu ?", "¿Quién no recibió nada?",
    ],
)  # fmt: skip
def test_people_for_whom_nothing_was_done_are_told(visits, question):
    claims = [clause.claim for clause in answer(visits, question).clauses if clause.claim.kind == "did_not"]
    assert claims
    assert {one.persons for one in claims} == {("t3",)}


@pytest.mark.parametrize(
    "question",
    [
        # People who did not come or speak are unknown
        "Who was not here?",
        "Who said nothing?",
        "Who did not turn up?",
        # What the robot should have done is unknown
        "Should you have helped t2?",
        "Ought you to have greeted t3?",
    ],
)
def test_what_people_and_the_robot_did_not_do_is_unknown(visits, question):
    assert not answer(visits, question).known


@pytest.fixture(scope="module")
def talk():
    return run_of(
        lambda at_s: [person("t1", 2.0)] if 1.0 <= at_s < 20.0 else [],
        22.0,
        heard={6.0: "Where can I find the lift?", 12.0: "Why did you greet me?"},
    )


@pytest.mark.parametrize(
    ("question", "heard"),
    [
        ("Did t1 ask you why you greeted them?", "Why did you greet me?"),
        ("When did t1 ask why you greeted him?", "Why did you greet me?"),
        ("Did anyone ask where the lift is?", "Where can I find the lift?"),
        ("Hat t1 gefragt, warum du ihn begrüßt hast?", "Why did you greet me?"),
        ("t1 a-t-il demandé pourquoi tu l'as salué ?", "Why did you greet me?"),
        ("¿Preguntó t1 por qué lo saludaste?", "Why did you greet me?"),
    ],
)
def test_what_people_asked_is_what_was_heard(talk, question, heard):
    claims = [clause.claim for clause in answer(talk, question).clauses]
    assert [one.what for one in claims if one.kind == "heard"] == [(heard,)]


@pytest.mark.parametrize(
    "question",
    [
        # What nobody asked is unknown
        "Did t1 ask where the cinema is?",
        "Did anybody ask you whether you can dance?",
        "Did t1 ask why you left?",
        # What nobody said is no answer
        "Did t1 ask you for a ticket?",
        "Did t1 say that the soup is cold?",
    ],
)
def test_what_nobody_asked_or_said_is_unknown(talk, question):
    assert not answer(talk, question).known


@pytest.mark.parametrize(
    "question", ["Can somebody tell me why you greeted t1?", "A colleague asked me why you greeted t1."]
)
def test_who_only_asks_does_not_ask_what_was_heard(talk, question):
    assert answer(talk, question).intent == "why"


NAMES = Vocabulary(
    deeds=(
        Deed(calls=("water",), words={"en": ("water",), "de": ("gießen", "gegossen"), "fr": ("arroser", "arrosé")}),
    ),
    names={
        "tree": {"en": ("sapling",), "de": ("Baum",), "fr": ("arbre",)},
        "pond": {"de": ("Teich",), "fr": ("petit lac",)},
    },
)


@pytest.fixture(scope="module")
def garden() -> Facts:
    what = ("water(hose_a, tree_1)", "water(hose_a, pond)", "water(hose_a, tree_2)")
    records = [
        TraceRecord(stamp=n * SECOND, id=f"r-{n}", source="hose_a", kind="action", what=one)
        for n, one in enumerate(what)
    ]
    return Facts(Subjects(History(records), Wording({}, {}), NAMES, {}))


@pytest.mark.parametrize(
    ("question", "things", "kind"),
    [
        ("Did you water sapling 2?", ["tree_2"], ""), ("Hast du Baum 1 gegossen?", ["tree_1"], ""),
        ("Wann hast du den Teich gegossen?", ["pond"], ""), ("As-tu arrosé le petit lac ?", ["pond"], ""),
        ("Welcher Baum wurde zuerst gegossen?", [], "tree"), ("Quels arbres as-tu arrosés ?", [], "tree"),
    ],
)  # fmt: skip
def test_names_are_read_in_the_words_that_an_agent_declares(garden, question, things, kind):
    read = candidates(question, garden.subjects)[0].question
    assert (list(read.things), read.thing_kind) == (things, kind)


@pytest.mark.parametrize(
    ("question", "who"),
    [
        ("Who came last?", "t3"), ("Who left first?", "t1"), ("Who was the second to arrive?", "t2"),
        ("Wer kam als Erster?", "t1"), ("Qui est parti en dernier ?", "t3"), ("¿Quién llegó primero?", "t1"),
    ],
)  # fmt: skip
def test_visits_are_told_in_the_order_in_question(visits, question, who):
    claims = [clause.claim for clause in answer(visits, question).clauses]
    assert [(one.kind, one.persons) for one in claims] == [("here", (who,))]


@pytest.mark.parametrize("question", ["How many people did you not greet?", "How many visitors were not greeted?"])
def test_people_are_not_counted_by_deeds_that_were_not_done(visits, question):
    assert [clause.claim.kind for clause in answer(visits, question).clauses][:1] == ["did_not"]


@pytest.mark.parametrize(
    "question",
    ["¿Por qué no dijiste nada a t3?", "¿Por qué no le dijiste nada a t3?", "Why did you say nothing to t3?"],
)
def test_nothing_is_no_word_that_was_said(visits, question):
    claim = answer(visits, question).clauses[0].claim
    assert (claim.kind, claim.persons) == ("did_not", ("t3",))


@pytest.mark.parametrize("question", ["Why were you idle at 19 s?", "Were you idle at 19 s?"])
def test_idleness_lasts_until_the_next_deed(visits, question):
    claims = [clause.claim for clause in answer(visits, question).clauses]
    assert (claims[0].kind, claims[0].at_s) == ("did", 15.9)


@pytest.fixture(scope="module")
def ferry() -> Facts:
    """Return the facts of a ferry without people, whose words are those of visits, too."""
    what = ("sail(ferry_a, harbour, island)", "sail(ferry_a, island, lighthouse)")
    records = [
        TraceRecord(stamp=4 * n * SECOND, id=f"f-{n}", source="ferry_a", kind="action", what=one)
        for n, one in enumerate(what)
    ]
    words = {"en": ("sail", "leave"), "de": ("segeln", "gesegelt", "verlassen"), "fr": ("naviguer", "parti", "quitté")}
    vocabulary = Vocabulary((Deed(calls=("sail",), words=words),), names={"island": {"de": ("Insel",), "fr": ("île",)}})
    return Facts(Subjects(History(records), Wording({}, {"sail": "sails from {1} to {2}"}), vocabulary, {}))


@pytest.mark.parametrize(
    ("question", "things"),
    [
        ("When did you leave the island?", {"island": "from"}),
        ("Wann hast du die Insel verlassen?", {"island": "from"}),
        ("Quand as-tu quitté l'île ?", {"island": "from"}), ("Pourquoi le ferry a est-il parti ?", {}),
        ("Why did ferry a leave before noon?", {}), ("Bist du zur Insel gesegelt?", {"island": "to"}),
    ],
)  # fmt: skip
def test_leaving_is_a_deed_of_agents_that_are_alone(ferry, question, things):
    read = [each.question for each in candidates(question, ferry.subjects)]
    assert things in [each.things for each in read if each.topics]


def test_a_pronoun_in_an_event_is_the_agent_of_the_question(kitchen):
    assert calls(answer(kitchen, "What did the cook do after it stirred the soup?")) == ["peel(cook_a, carrot_2)"]


def test_visits_in_a_span_of_time_are_those_of_that_time(visits):
    assert answer(visits, "Who was here between 19 and 27 s?").text == "Person t2 was here from 20 to 24.9 s."
    assert (
        answer(visits, "Is it right that nobody came between 26 and 29 s?").text == "From 26 to 29 s nobody was here."
    )


@pytest.mark.parametrize(
    "question",
    ["Who did you greet but not help?", "Who got a greeting but no help?", "Wen hast du begrüßt, aber nicht geholfen?"],
)
def test_people_for_whom_only_one_deed_was_done_are_told(visits, question):
    claims = [clause.claim for clause in answer(visits, question).clauses]
    assert {(one.kind, one.persons) for one in claims if one.kind in ("did", "did_not")} == {
        ("did", ("t2",)),
        ("did_not", ("t2",)),
    }


def test_nobody_got_help_without_a_greeting(visits):
    assert not answer(visits, "Who got help but no greeting?").known


@pytest.mark.parametrize(
    "question", ["Why did you wait before you greeted t2?", "Why did you hesitate to help t1 until 10 s?"]
)
def test_why_the_robot_waited_is_why_it_acted_then(visits, question):
    claims = [clause.claim for clause in answer(visits, question).clauses]
    assert (claims[0].kind, claims[0].at_s) in {("did", 20.2), ("did", 10.2)}


def test_several_agents_are_told_each(kitchen):
    found = answer(kitchen, "Did the cook peel and did waiter b serve carrot 1?")
    assert not found.text.startswith("Yes")


def test_deeds_by_a_time_are_counted_up_to_it(kitchen):
    claims = [clause.claim for clause in answer(kitchen, "How many carrots had the cook peeled by 9 s?").clauses]
    assert (claims[0].kind, claims[0].value, claims[0].until_s) == ("count", 2.0, 9.0)


@pytest.mark.parametrize("question", ["Did t1 and t2 come at once?", "Did you greet two people at once?"])
def test_at_once_is_no_time(visits, question):
    assert all(clause.claim.kind != "saw" for clause in answer(visits, question).clauses)


@pytest.mark.parametrize(
    ("question", "expected"),
    [
        ("What followed the frying of onion 1?", "stir(cook_a, soup)"),
        ("What came right after the cook had stirred the soup?", "serve(waiter_b, table_4)"),
        ("What preceded the frying of onion 1?", "peel(cook_a, carrot_1)"),
        ("What led up to the waiter serving table 4?", "stir(cook_a, soup)"),
        ("Was folgte auf das Braten von onion 1?", "stir(cook_a, soup)"),
    ],
)
def test_verbs_of_order_tell_what_was_before_or_after(kitchen, question, expected):
    assert calls(answer(kitchen, question)) == [expected]


@pytest.fixture(scope="module")
def outlasted() -> RunView:
    """Three visitors: t2 comes after t1 and leaves last, t3 comes last and leaves before t2."""
    places = {"t1": (2.0, 14.0), "t2": (20.0, 36.0), "t3": (24.0, 29.0)}
    return run_of(
        lambda at_s: (person(name, 3.0) for name, (begin, end) in places.items() if begin <= at_s < end), 45.0
    )


@pytest.mark.parametrize(
    ("question", "found"),
    [
        ("When did the last person leave?", "t2"),
        ("Which of the visitors was the last to leave?", "t2"),
        ("Who was the first person to leave?", "t1"),
        ("Who was the second person to leave?", "t3"),
        ("When did the second visitor leave?", "t2"),
        ("Wann ist der letzte Besucher gegangen?", "t2"),
        ("Wer war die zweite Person, die gegangen ist?", "t3"),
        ("Quand le dernier visiteur est-il parti ?", "t2"),
        ("¿Cuándo se fue la última persona?", "t2"),
        ("Who was the last person to arrive?", "t3"),
        ("How long did the last visitor stay?", "t3"),
    ],
)
def test_people_who_leave_are_counted_in_order_of_departure(outlasted, question, found):
    assert [clause.claim.persons for clause in answer(outlasted, question).clauses] == [(found,)]


@pytest.mark.parametrize(
    ("question", "begins"),
    [
        ("What did you do after 30 seconds?", [37.9]),
        ("Was hast du nach 30 Sekunden gemacht?", [37.9]),
        ("Qu'est-ce que tu as fait après 30 secondes ?", [37.9]),
        ("¿Qué hiciste después de los 30 segundos?", [37.9]),
        ("What did you do after 20 seconds?", [20.2]),
        ("What did you say after 15 seconds?", [20.2, 24.2, 28.2]),
        ("What did you do after 17 seconds?", [20.2, 24.2, 28.2, 37.9]),
        ("What did you do since 30 s?", [37.9]),
        ("Was hast du seit Sekunde 30 getan?", [37.9]),
        ("Was hast du ab Sekunde 30 getan?", [37.9]),
        ("Qu'as-tu fait à partir de la seconde 30 ?", [37.9]),
        ("¿Qué has hecho desde el segundo 30?", [37.9]),
        ("Was hast du seit 20 Sekunden getan?", [28.2, 37.9]),
        ("Did you greet anybody after 15 seconds?", [24.2]),
        ("Who was here after 22 s?", [20.0, 24.0]),
    ],
)
def test_what_came_after_a_time_is_told(outlasted, question, begins):
    found = answer(outlasted, question)
    assert [clause.claim.at_s for clause in found.clauses] == begins, found.text


def test_what_came_after_a_goal_came_after_its_end():
    seconds = {"goal": 5, "asked": 5, "achieved": 9, "thanked": 9}
    run = RunView(
        None,
        History(
            [
                record_of("goal", "closed()", seconds["goal"], "goal-1"),
                record_of("action", 'say("Please close the door.")', seconds["asked"], "say-1", cause="goal-1"),
                record_of("achieved", "closed()", seconds["achieved"], "end-1", cause="goal-1"),
                record_of("action", 'say("Thank you.")', seconds["thanked"], "say-2"),
            ]
        ),
        None,
    )
    found = answer(run, "What did you say after the door was closed?")
    assert [clause.claim.at_s for clause in found.clauses] == [4.0], found.text


def record_of(kind: str, what: str, at_s: int, name: str, cause: str = "") -> TraceRecord:
    return TraceRecord(stamp=at_s * SECOND, id=name, source="guard", kind=kind, what=what, cause=cause)
