from __future__ import annotations

from functools import partial

import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import TraceRecord
from socialbot.runs.asking import Answer, answer, answer_heard
from socialbot.runs.history import History
from socialbot.runs.run import RunView
from tests.runs.asking.waldo_run import person, run_of, two_visitors
from tests.runs.deliberating_runs import DETOUR, GRAPH


@pytest.fixture(scope="module")
def waldo() -> RunView:
    return two_visitors()


@pytest.fixture(scope="module")
def ann() -> RunView:
    """Return the run of an agent with plans and phrases, but no vocabulary."""
    plans = {(record.source, record.stamp): record.id for record in DETOUR if record.kind == "plan_start"}
    caused = [
        msgspec.structs.replace(record, cause=plans.get((record.source, record.stamp), ""))
        if record.kind == "step"
        else record
        for record in DETOUR
    ]
    return RunView(GRAPH, History(caused), None)


def kinds(found: Answer) -> list[str]:
    return [clause.claim.kind for clause in found.clauses]


def deed_of(run: RunView, found: Answer) -> str:
    """Return the action of the first record of an answer."""
    record = run.history.find(found.clauses[0].records[0])
    assert record is not None
    chain = [record, *run.history.before(record)]
    return next(each.what for each in chain if each.kind in ("action", "step"))


class TestWhy:
    def test_names_the_belief_and_what_was_different_before(self, waldo):
        found = answer(waldo, "Why did you offer help to me?")
        assert found.text == (
            "At 10.2 s I offered you help because you had been here for 8 s; at 2.2 s you had only been here for 0 s."
        )
        assert kinds(found) == ["did", "believed", "not_believed"]
        assert found.assumes == "I take you for person t1."

    def test_every_clause_names_records_of_the_trace(self, waldo):
        found = answer(waldo, "Why did you greet the second visitor?")
        assert all(clause.records for clause in found.clauses)
        assert all(waldo.history.find(id) is not None for clause in found.clauses for id in clause.records)

    def test_the_speaker_is_you(self, waldo):
        assert "At 2.2 s I greeted you" in answer(waldo, "Why did you greet me?", speaker="t1").text
        assert "At 20.2 s I greeted you" in answer(waldo, "Why did you greet me?", speaker="t2").text

    @pytest.mark.parametrize(
        ("question", "at_s", "begin"),
        [
            ("Why did you greet me?", 9.2, "7 seconds ago I greeted you because"),
            ("Why did you greet me?", 3.0, "Just now I greeted you because"),
            ("Warum hast du mich gegrüßt?", 9.2, "Vor 7 Sekunden: ich habe Sie begrüßt"),
            ("Pourquoi m'as-tu salué ?", 9.2, "Il y a 7 secondes, "),
            ("¿Por qué me saludaste?", 9.2, "Hace 7 segundos "),
            ("What are you doing?", 9.2, "Just now I was doing nothing; the last thing was 7 seconds ago: I greeted"),
            ("What will you do next?", 1.0, "Just now I had no intention"),
            ("Was machst du?", 9.2, "Gerade eben: ich tat gerade nichts; das Letzte war vor 7 Sekunden: ich"),
        ],
    )
    def test_times_are_told_from_the_question_on_when_spoken(self, waldo, question, at_s, begin):
        found = answer(waldo, question, speaker="t1", at_s=at_s, spoken=True)
        assert found.text.startswith(begin)
        written = answer(waldo, question, speaker="t1", at_s=at_s)
        assert [clause.claim for clause in found.clauses] == [clause.claim for clause in written.clauses]

    def test_a_step_is_explained_by_its_plan(self, ann):
        found = answer(ann, "why did you ask bob to help")
        assert found.text == "At 3 s ann asked bob to help because that was step 1 of 1 of ann's plan for be_home."

    def test_a_deed_that_was_not_done_has_no_reason(self, waldo):
        found = answer(waldo, "Why did you offer help to the second visitor?")
        assert found.text.startswith("I did not offer person t2 help")


class TestWhyNot:
    def test_names_the_missing_belief(self, waldo):
        found = answer(waldo, "Why didn't you offer help to the second visitor?")
        assert found.text == "I did not offer person t2 help because person t2 had only been here for 4.7 s."

    def test_at_a_time(self, waldo):
        found = answer(waldo, "Why did you not help me at 7 s?")
        assert found.text == "At 7 s I did not offer you help because you had only been here for 4.8 s."

    def test_a_deed_that_was_done(self, waldo):
        found = answer(waldo, "Why did you not greet the man at 5 seconds?")
        assert found.text == "At 2.2 s I greeted person t1."

    def test_names_what_was_done_before(self, waldo):
        found = answer(waldo, "Why did you not greet t1 at 12 s?")
        assert found.text == "At 12 s I did not greet person t1 because at 2.2 s I greeted person t1."


@pytest.mark.parametrize(
    ("question", "kind", "deed"),
    [
        ("What made you say hello to the first person?", "why", 'speak("greeting")'),
        ("for what reason did you offer assistance", "why", 'speak("offer")'),
        ("How come you welcomed me?", "why", 'speak("greeting")'),
        ("can you tell me why you helped t1", "why", 'speak("offer")'),
        ("why did you grit me", "why", 'speak("greeting")'),
        ("wide did you creed me", "why", 'speak("greeting")'),
        ("When was help offered?", "when", 'speak("offer")'),
        ("at what time did you salute t2", "when", 'speak("greeting")'),
        ("Did you greet anyone at twenty seconds?", "did", 'speak("greeting")'),
        ("Warum hast du mich begrüßt?", "why", 'speak("greeting")'),
        ("Wann hast du Hilfe angeboten?", "when", 'speak("offer")'),
        ("Pourquoi m'avez-vous salué ?", "why", 'speak("greeting")'),
        ("Quand as-tu proposé ton aide ?", "when", 'speak("offer")'),
        ("¿Por qué me ofreciste ayuda?", "why", 'speak("offer")'),
        ("¿Cuándo saludaste a la primera persona?", "when", 'speak("greeting")'),
    ],
)
def test_other_words_reach_the_same_record(waldo, question, kind, deed):
    found = answer(waldo, question)
    assert (found.known, found.intent, deed_of(waldo, found)) == (True, kind, deed)


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("What did you see at 22 s?", "At 22 s I saw person t2 4 m away."),
        ("Was siehst du bei Sekunde 22?", "Bei 22 s: ich sah Person t2 in 4 m Entfernung."),
        ("Who was here?", "Person t1 was here from 2 to 13.9 s and person t2 was here from 20 to 24.9 s."),
        ("How many visitors came?", "2 people were here."),
        ("Did you see t1?", "Person t1 was here from 2 to 13.9 s."),
        ("Would you say you greeted t1?", "Yes: at 2.2 s I greeted person t1."),
        ("¿Cuántas personas viste?", "2 personas estuvieron aquí."),
        ("How often did you greet people?", "2 times: at 2.2 s I greeted person t1 and at 20.2 s I greeted person t2."),
        ("Did you greet the man at 21 seconds?", "Yes: at 20.2 s I greeted person t2."),
        ("Did you help t2?", "No: I did not offer person t2 help because person t2 had only been here for 4.7 s."),
        ("What did you say at 10 seconds?", 'At 10.2 s I said "Can I help you with anything?".'),
        ("When was I here?", "You were here from 20 to 24.9 s."),
        ("Wer war hier?", "Person t1 war von 2 bis 13,9 s hier und Person t2 war von 20 bis 24,9 s hier."),
    ],
)
def test_answers(waldo, question, text):
    assert answer(waldo, question).text == text


class TestPeople:
    @pytest.mark.parametrize(
        "question",
        [
            "Why did you help t1 but not t2?",
            "Why did t1 get help and t2 didn't?",
            "Why did you offer help to t1 rather than t2?",
            "Why did the first visitor get help and the second not?",
            "Warum hast du t1 geholfen, aber t2 nicht?",
            "Pourquoi as-tu aidé t1 et pas t2 ?",
            "¿Por qué ayudaste a t1 y no a t2?",
        ],
    )
    def test_two_are_contrasted(self, waldo, question):
        found = answer(waldo, question)
        assert deed_of(waldo, found) == 'speak("offer")'
        undone = [clause.claim for clause in found.clauses if clause.claim.kind == "did_not"]
        assert [claim.persons for claim in undone] == [("t2",)]
        assert ("4.7 s" if found.language == "en" else "4,7 s") in found.text

    @pytest.mark.parametrize(
        ("question", "text"),
        [
            ("How often did you greet the 1st visitor?", "Once: at 2.2 s I greeted person t1."),
            ("How often did you greet the 2nd visitor?", "Once: at 20.2 s I greeted person t2."),
            ("Wie oft hast du den 2. Besucher begrüßt?", "Einmal: bei 20,2 s: ich habe Person t2 begrüßt."),
            ("Combien de fois as-tu salué le 1er visiteur ?", "Une fois: à 2,2 s, j'ai salué la personne t1."),
            ("Combien de fois as-tu salué le 2e visiteur ?", "Une fois: à 20,2 s, j'ai salué la personne t2."),
            ("¿Cuántas veces saludaste al 2º visitante?", "Una vez: a los 20,2 s saludé a la persona t2."),
            ("When did you greet the man who came 1st?", "At 2.2 s I greeted person t1."),
            ("What did you see at the 22nd second?", "At 22 s I saw person t2 4 m away."),
        ],
    )
    def test_numbers_in_digits(self, waldo, question, text):
        assert answer(waldo, question).text == text

    @pytest.mark.parametrize("number", ["9" * 13, "9" * 400, "9" * 5000])
    @pytest.mark.parametrize(
        "question",
        [
            "What happened at {} s?",
            "What happened at {}:59?",
            "What happened at {}.5 s?",
            "What happened at the {}th second?",
            "What happened {} minutes ago?",
            "What did you see at -{} s?",
            "Who was the {}th visitor?",
            "What did you do after 5 point ² s? {}",
        ],
    )
    def test_huge_numbers_are_no_numbers(self, waldo, question, number):
        assert isinstance(answer(waldo, question.format(number)), Answer)

    @pytest.mark.parametrize(
        "question",
        [
            "How often did you greet the 3rd visitor?",
            "Why did you not greet the third visitor?",
            "Did a third visitor come?",
            "Why did you help t1, but not the third visitor?",
        ],
    )
    def test_somebody_who_did_not_come_is_not_known(self, waldo, question):
        found = answer(waldo, question)
        assert not found.known

    def test_two_who_are_only_joined_are_not_contrasted(self, waldo):
        assert "did_not" not in kinds(answer(waldo, "Why did you help t1 and t2?"))

    def test_a_contrast_without_a_deed_is_not_known(self, waldo):
        assert not answer(waldo, "Why me and not her?").known

    @pytest.mark.parametrize(
        "question",
        [
            "Who did you not help?",
            "Who got no help?",
            "Did everybody get help?",
            "Was there anyone you did not help?",
            "Wem hast du nicht geholfen?",
            "Qui n'as-tu pas aidé ?",
            "¿A quién no ayudaste?",
        ],
    )
    def test_those_who_were_left_out(self, waldo, question):
        found = answer(waldo, question)
        assert (kinds(found)[0], found.clauses[0].claim.persons) == ("did_not", ("t2",))

    @pytest.mark.parametrize(
        ("question", "text"),
        [
            ("Did everybody get help?", "No: I did not offer"),
            ("Was there anyone you did not help?", "Yes: I did not offer"),
            ("Did you greet everyone?", "Yes: at 2.2 s I greeted person t1 and"),
            ("Did you ignore t2?", "No: at 20.2 s I greeted person t2."),
            ("Has anyone been ignored?", "No: at 2.2 s I greeted"),
        ],
    )
    def test_yes_and_no(self, waldo, question, text):
        assert answer(waldo, question).text.startswith(text)

    @pytest.mark.parametrize(
        ("question", "text"),
        [
            ("How long did the second visitor stay?", "Person t2 was here from 20 to 24.9 s."),
            ("Wie lange war t2 da?", "Person t2 war von 20 bis 24,9 s hier."),
            ("Who stayed the longest?", "Person t1 was here from 2 to 13.9 s."),
            ("Who had the shortest visit?", "Person t2 was here from 20 to 24.9 s."),
            (
                "How long did you wait before you offered help to t1?",
                "At 10.2 s I offered person t1 help and person t1 was here from 2 to 13.9 s.",
            ),
        ],
    )
    def test_durations(self, waldo, question, text):
        assert answer(waldo, question).text == text

    @pytest.mark.parametrize("question", ["Did t1 greet you?", "Did anybody talk to you?", "Hat t1 dich begrüßt?"])
    def test_what_people_do_to_the_robot_is_not_known(self, waldo, question):
        assert not answer(waldo, question).known


class TestTimes:
    @pytest.mark.parametrize(
        ("question", "text"),
        [
            ("What did you do when the second visitor came?", "At 20.2 s I greeted person t2."),
            ("When t2 came, what did you do?", "At 20.2 s I greeted person t2."),
            ("What did you do before t2 came?", "At 15.9 s I stayed idle."),
            ("What did you do after you had offered help to t1?", "At 15.9 s I stayed idle."),
            ("Was hast du gemacht, nachdem t1 gegangen war?", "Bei 15,9 s: ich blieb untätig."),
            (
                "Did you greet t2 before t1?",
                "No: at 20.2 s I greeted person t2 and at 2.2 s I greeted person t1.",
            ),
            (
                "Did you offer help after t2 came?",
                "No: at 10.2 s I offered person t1 help.",
            ),
            ("What did you see when t2 came?", "At 20 s I saw person t2 4 m away."),
        ],
    )
    def test_told_by_an_event(self, waldo, question, text):
        assert answer(waldo, question).text == text

    def test_an_event_that_did_not_happen(self, waldo):
        assert not answer(waldo, "What did you do when the ninth visitor came?").known

    @pytest.mark.parametrize(
        "question",
        [
            "What did you see at -5 seconds?",
            "What did you see 100 seconds ago?",
            "What did you do between 5000 and 6000 seconds?",
        ],
    )
    def test_outside_the_run_are_not_known(self, waldo, question):
        found = answer(waldo, question)
        assert (found.known, found.intent) == (False, question.split()[3] if "see" in question else "doing")

    def test_estimated_a_little_before_the_run_count_as_its_begin(self, waldo):
        found = answer(waldo, "What did you see 10 seconds ago?", at_s=8.5)
        assert found.text == "At 0 s I saw nobody."

    def test_counted_back_with_a_short_unit(self, waldo):
        found = answer(waldo, "Was hast du vor 10 s gemacht?")
        assert found.text == answer(waldo, "Was hast du vor 10 Sekunden gemacht?").text
        assert found.text == "Bei 20,2 s: ich habe Person t2 begrüßt."

    @pytest.mark.parametrize(
        ("question", "text"),
        [
            ("What did you do between 1 and 8 seconds?", "At 2.2 s I greeted person t1."),
            ("What did you do between 5 and 8 seconds?", "From 5 to 8 s I said nothing."),
            ("What did you do between 8 and 5 seconds?", "From 5 to 8 s I said nothing."),
            ("How often did you greet people between 10 seconds and 1 minute?", "Once: at 20.2 s I greeted person t2."),
            ("How often did you greet people between 1 minute and 10 seconds?", "Once: at 20.2 s I greeted person t2."),
            ("What did you do between -5 and 8 seconds?", "At 2.2 s I greeted person t1."),
            ("How often did you greet people in the last 15 seconds?", "Once: at 20.2 s I greeted person t2."),
            ("How often after t1 left did you greet people?", "Once: at 20.2 s I greeted person t2."),
            ("How often did you greet people when t1 came?", "Once: at 2.2 s I greeted person t1."),
            (
                "How soon after t1 came did you greet them?",
                "At 2.2 s I greeted person t1 and person t1 was here from 2 to 13.9 s.",
            ),
            ("How many people were here between 15 and 30 seconds?", "One person was here."),
            ("How often did you greet people before 15 s?", "Once: at 2.2 s I greeted person t1."),
            ("Did you greet anyone in the first ten seconds?", "Yes: at 2.2 s I greeted person t1."),
            ("Did you see anyone at half a minute?", "At 29.9 s I saw nobody."),
        ],
    )
    def test_spans(self, waldo, question, text):
        assert answer(waldo, question).text == text

    def test_a_count_claims_its_span(self, waldo):
        found = answer(waldo, "How often did you greet people between 15 and 28 seconds?")
        assert (found.clauses[0].claim.at_s, found.clauses[0].claim.until_s) == (15.0, 28.0)


class TestPlaces:
    @pytest.mark.parametrize(
        ("question", "begin"),
        [
            ("Did ann go to the yard?", "Yes: at 0 s ann went from hall to yard."),
            ("Did ann go from the hall?", "Yes: at 0 s ann went from hall to yard."),
            ("Did ann go to the hall?", ("No:", "I don't know.")),
            ("Did ann go from the yard?", ("No:", "I don't know.")),
        ],
    )
    def test_count_by_the_word_before_them(self, ann, question, begin):
        assert answer(ann, question).text.startswith(begin)


class TestWords:
    @pytest.mark.parametrize(
        ("question", "text"),
        [
            ("Did you say goodbye?", 'No: I did not say "goodbye".'),
            ("Did you say thank you to anybody?", 'No: I did not say "thank you".'),
            ("Did you say nice to see you?", 'Yes: at 20.2 s I said "Hello! Nice to see you.".'),
            ("What was the last thing you said?", 'At 20.2 s I said "Hello! Nice to see you.".'),
            ("What did you say before you offered help?", 'At 2.2 s I said "Hello! Nice to see you.".'),
        ],
    )
    def test_of_the_robot(self, waldo, question, text):
        assert answer(waldo, question).text == text

    def test_are_counted(self, waldo):
        found = answer(waldo, "How often did you say nice to see you?")
        assert (kinds(found)[0], found.clauses[0].claim.value) == ("count", 2.0)


def test_what_is_done_and_intended_at_a_time(waldo, ann):
    doing = answer(waldo, "What are you doing?", at_s=9.0)
    assert doing.text == "At 9 s I was doing nothing; the last thing was at 2.2 s: I greeted person t1."
    assert answer(waldo, "What are you doing?", at_s=2.5).text == "At 2.2 s I greeted person t1."
    ahead = answer(waldo, "What will you do next at 5 s?")
    assert ahead.text.startswith("At 5 s I had no intention; the next thing was at 10.2 s: I offered person t1 help")
    for question in (
        "Which goal did you pursue at 10.2 s?",
        "What was your goal at 9 s?",
        "What was your aim at 11 s?",
    ):
        assert answer(waldo, question).text == "At 10.2 s I wanted OfferHelp()."
    assert answer(ann, "What will you do next?", at_s=1.0).text == (
        "At 1 s step 2 of ann's plan for be_home was next: goes from yard to hall."
    )


@pytest.mark.parametrize(
    "question",
    [
        "",
        "?!",
        "Where is the exit?",
        "What is your favourite colour?",
        "Did you offer me a drink?",
        "Why did you dance?",
        "Why did t1 leave?",
        "How old are you?",
        "Why is the sky blue?",
        "What did you see at 5000 seconds?",
        "Wo ist der Ausgang?",
        "bla bla bla",
    ],
)
def test_what_no_record_tells_is_not_known(waldo, question):
    found = answer(waldo, question)
    assert not found.known
    assert {each.claim.kind for each in found.clauses} <= {"not_named"}
    assert found.text.startswith(("I don't know.", "Das weiß ich nicht."))
    assert found.examples


def test_an_unclear_question_is_told_what_can_be_asked(waldo):
    found = answer(waldo, "bla bla bla")
    assert found.text == (
        "I don't know. I am not sure what you ask. I can tell why I did something or left it undone, what I saw, "
        "said, did and intended, and who was here when."
    )
    assert answer(waldo, "bla bla bla", spoken=True).text == "I don't know. I am not sure what you ask."
    assert answer(waldo, "What did you see at 5000 seconds?").text == "I don't know. The record does not say so."


def test_a_question_of_many_words_is_not_understood(waldo):
    question = "Why did you greet the second visitor"
    longest = f"{question}{' please' * 93}"
    assert answer(waldo, longest).text == answer(waldo, question).text
    assert answer(waldo, f"{longest} please").text.startswith("I don't know. I am not sure what you ask.")


def test_suggested_questions_are_understood(waldo):
    for code in ("en", "de", "fr", "es"):
        for one in answer(waldo, "xyzzy", language=code).examples:
            assert answer(waldo, one, language=code).known, one


def test_an_unknown_agent_is_refused(waldo):
    with pytest.raises(ParameterError, match="no agent 'r2d2'"):
        answer(waldo, "What are you doing?", agent="r2d2")


def test_a_run_without_records():
    assert not answer(RunView(None, History(), None), "Why did you greet me?").known


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("Why did you greet t2?", "I greeted person t2 because person t2 was no longer walking up to me."),
        ("Warum hast du t2 begrüßt?", "ich habe Person t2 begrüßt, denn Person t2 ist nicht mehr auf mich zugekommen."),
        ("¿Por qué saludaste a t2?", "saludé a la persona t2 porque la persona t2 ya no se acercaba a mí."),
    ],
)
def test_the_end_of_a_belief_is_a_reason_in_words(question: str, text: str) -> None:
    """A person comes who may only pass, since another one is attended to: the greeting waits until they stop."""
    run = run_of(
        lambda at: [
            person("t1", 2.0, bearing_rad=0.3),
            *([person("t2", max(2.0, 6.0 - 1.2 * (at - 4.0)), bearing_rad=-0.2)] if at > 4.0 else []),
        ],
        9.0,
    )
    found = answer(run, question)
    assert found.text.endswith(text)
    record = run.history.find(found.clauses[1].records[0])
    assert record is not None
    assert (record.kind, record.what) == ("unbelief", 'comes("t2")')


@pytest.mark.parametrize(
    ("heard", "alternatives", "taken"),
    [
        ("Why did you creep me?", ["Why did you greet me?"], 1),
        ("Why did you creep the second for stir?", ["Why did you greet the second visitor?"], 1),
        ("Why did you creep me?", ["Why did you creep knee?", "What did you creep?", "Why did you greet me?"], 3),
        ("Why did you read me?", ["Why did you greet me?", "Why did you treat me?"], 1),
        ("Why did you read me?", ["Why did you leave me?"], 0),
        ("Why did you read me?", ["Why did you juggle?"], 0),
        ("Why did you creep me?", [], 0),
        ("Why did you juggle?", ["Why did you greet me?"], 0),  # nothing that sounds alike
        ("Why didn't you creep me?", ["Why did you greet me?"], 0),
        ("Why did you greet me?", ["Why did you leave me?"], 0),
        ("What is my name?", ["What did you say?"], 0),  # no word of it is unknown
    ],
)
def test_another_recognised_text_counts_only_for_misheard_words(waldo, heard, alternatives, taken):
    texts = [heard, *alternatives]
    text, found = answer_heard(texts, partial(answer, waldo))
    assert text == texts[taken]
    assert found == answer(waldo, text)


@pytest.mark.parametrize("times", [1, 2])
def test_the_words_of_a_spoken_question_may_be_misheard(waldo, times):
    """The record of a question does not make its words known, not even if it is asked again."""
    texts = ["Why did you read me?", "Why did you greet me?"]
    last = list(waldo.history)[-1]
    asked = [
        TraceRecord(stamp=last.stamp + n * SECOND, id=f"heard-{n}", source="ears", kind="hearing", what=texts[0])
        for n in range(times)
    ]
    run = RunView(waldo.graph, History([*waldo.history, *asked]), None)
    assert answer_heard(texts, partial(answer, run, asked_as=asked[-1].id))[0] == texts[1]


def test_a_spoken_question_does_not_record_its_own_words(waldo):
    asked = TraceRecord(
        stamp=list(waldo.history)[-1].stamp, id="heard", source="ears", kind="hearing", what="Why did you read me?"
    )
    run = RunView(waldo.graph, History([*waldo.history, asked]), None)
    assert kinds(answer(run, asked.what, asked_as=asked.id)) == ["not_named"]


@pytest.mark.parametrize(
    ("heard", "alternatives", "taken"),
    [
        ("When was carrier unloaded?", ["When was Carol unloaded?", "When was carrier A unloaded?"], 2),
        ("When was carrier B unloaded?", ["When was carrier A unloaded?"], 0),
        ("When was carrier unloaded?", ["When was carrier Q unloaded?"], 0),
    ],
)
def test_a_text_with_the_letter_of_a_name_counts_before_one_without_it(heard, alternatives, taken):
    run = RunView(
        None,
        History(
            TraceRecord(stamp=SECOND, id=one, source=one, kind="action", what=f"unload({one})")
            for one in ("carrier_a", "carrier_b")
        ),
        None,
    )
    texts = [heard, *alternatives]
    assert answer_heard(texts, partial(answer, run))[0] == texts[taken]


@pytest.mark.parametrize(
    ("question", "begin"),
    [
        ("Did you greet t2 and why?", "Yes: at 20"),
        ("When did you greet t2, and why?", "At 20"),
        ("Hast du t2 begrüßt, und warum?", "Ja: bei 20"),
        ("As-tu salué t2, et pourquoi ?", "Oui: à 20"),
        ("¿Saludaste a t2 y por qué?", "Sí: a los 20"),
    ],
)
def test_a_second_question_for_the_reason_is_answered(waldo, question, begin):
    found = answer(waldo, question)
    assert found.text.startswith(begin), found.text
    assert kinds(found)[:2] == ["did", "believed"]


def test_the_reason_of_several_deeds_is_that_of_the_last_one(waldo):
    found = answer(waldo, "Who did you greet, and why?")
    assert kinds(found)[:4] == ["did", "did", "did", "believed"]
    assert [clause.claim.persons for clause in found.clauses[:3]] == [("t1",), ("t2",), ("t2",)]


def test_a_second_question_for_the_reason_needs_a_deed(waldo):
    assert kinds(answer(waldo, "Did you greet t9, and why?")) == ["not_named"]
    assert kinds(answer(waldo, "Who was here, and why?")) == ["here", "here"]
