from __future__ import annotations

import re

import pytest

from socialbot.agents.waldo import TalkingWaldo, small_talk
from socialbot.agents.waldo.vocabulary import VOCABULARY
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import GraphError, ParameterError
from socialbot.core.messages import HeardSpeech, VoiceActivity
from socialbot.runs.asking.languages import LANGUAGES as ASKED_IN
from tests.agents.waldo.corridor import GREETING, OFFER
from tests.agents.waldo.hall import SPEECH, Hall

LANGUAGES = ("en", "de", "es", "fr")


def test_every_sentence_and_intent_of_waldo_is_in_all_languages():
    script = small_talk()
    assert script.languages == LANGUAGES
    assert {name: set(texts) for name, texts in script.sentences.items() if set(texts) != set(LANGUAGES)} == {}
    intents = [one for one in script.grammar.intents.values() if one.name not in ("unclear", "choice")]  # no phrases
    assert {one.name: set(one.phrases) for one in intents if set(one.phrases) != set(LANGUAGES)} == {}


@pytest.mark.parametrize(
    ("language", "familiar"),
    [("de", r"\b(du|dich|dir|dein\w*)\b"), ("es", r"\b(te|t\u00fa|ti|tu)\b"), ("fr", r"\b(tu|te|toi)\b")],
)
def test_visitors_are_addressed_politely_in_talk_and_in_answers(language, familiar):
    deeds = (each for deed in VOCABULARY.deeds for each in (deed.did, deed.did_not))
    conditions = (each for one in VOCABULARY.conditions for each in (one.held, one.lacked))
    to_visitors = [
        texts[language][0] for texts in (*deeds, *conditions) if not isinstance(texts.get(language, ""), str)
    ]
    answers = {name: text for name, text in ASKED_IN[language].sentences.items() if name != "examples"}  # for the robot
    small_talks = [texts[language] for texts in small_talk().sentences.values()]
    assert len(to_visitors) > 10
    assert [each for each in (*to_visitors, *answers.values(), *small_talks) if re.search(familiar, each)] == []


def test_greets_and_offers_help_and_asks_what_a_person_needs():
    with Hall() as hall:
        hall.see(1.0)
        hall.see(11.5, "t1")
        assert hall.said == [GREETING, OFFER]
        hall.hear("t1", "Yes, please")
        hall.see(3.0, "t1")
        hall.hear("t1", "Nothing, good bye!")
        hall.see(3.0, "t1")
    assert hall.said == [GREETING, OFFER, "How can I help you?", "Goodbye!"]
    assert 'greeted("t1")' in hall.believes()


def test_a_person_who_does_not_answer_is_not_asked_again():
    with Hall() as hall:
        hall.see(40.0, "t1")
    assert hall.said == [GREETING, OFFER]


def test_a_person_who_has_talked_with_waldo_gets_no_offer():
    with Hall() as hall:
        hall.see(4.0, "t1")
        hall.hear("t1", "What can you do?")
        hall.see(20.0, "t1")
    assert hall.said == [GREETING, "I am Waldo. I greet people and answer their questions."]


@pytest.mark.parametrize(
    ("language", "text", "reply"),
    [
        ("de", "Danke schön!", "Gern geschehen."),
        ("es", "Muchas gracias", "De nada."),
        ("fr", "Merci beaucoup", "Je vous en prie."),
    ],
)
def test_speaks_the_language_of_each_person(language, text, reply):
    with Hall() as hall:
        hall.see(3.0, "t1", "t2")
        hall.hear("t1", text, language)
        hall.see(3.0, "t1", "t2")
        hall.hear("t2", "Thank you")
        hall.see(3.0, "t1", "t2")
        spoken = [(one.text, one.language, one.person) for one in hall.messages("/speech/say")]
    assert spoken[1:] == [(reply, language, "t1"), ("You are welcome.", "en", "t2")]


def test_waldo_begins_in_the_language_of_the_place():
    with Hall(language="de") as hall:
        hall.see(12.0, "t1")
        assert {one.language for one in hall.messages("/speech/say")} == {"de"}
    assert hall.said == ["Hallo! Schön, Sie zu sehen.", "Kann ich Ihnen helfen?"]


def test_repeats_the_last_sentence():
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "Pardon?")
        hall.see(3.0, "t1")
    assert hall.said == [GREETING, GREETING]


def test_a_reply_is_caused_by_what_was_heard():
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "Thank you")
        stamp = hall.clock.now()
        hall.see(3.0, "t1")
        action = next(one for one in hall.trace if one.kind == "action" and "welcome" in one.what)
    assert hall.causes(action)[-1] == f"heard-{stamp}"


def test_who_leaves_ends_the_conversation():
    with Hall() as hall:
        hall.see(11.5, "t1")
        assert 'turn("t1")' in hall.believes()
        hall.see(3.0)
    assert not {one for one in hall.believes() if one.startswith(("turn", "asked", "replied"))}


def test_speech_of_people_who_do_not_talk_to_waldo_is_ignored():
    with Hall() as hall:
        hall.see(2.0)
        hall.hear("t9", "I had pasta for lunch")
        hall.see(2.0)
    assert hall.said == []


def test_sleeps_after_a_while_alone_and_wakes_for_the_next_person():
    with Hall(sleep_after_s=20.0) as hall:
        hall.see(3.0, "t1")
        hall.see(25.0)
        assert 'asleep("alone")' in hall.believes()
        head = hall.messages("/head/command")[-1]
        assert (head.mode, head.tilt_rad) == ("look", -0.5)
        hall.hear("", "I had pasta for lunch")
        hall.see(1.0)
        hall.see(3.0, "t2")
        assert 'asleep("alone")' not in hall.believes()
        assert [one.mode for one in hall.messages("/head/command")][-2:] == ["track", "track"]
    assert hall.said == [GREETING, GREETING]


def test_sleeps_on_request_until_it_is_woken():
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "Good night, Waldo")
        hall.see(3.0, "t1")
        hall.hear("t1", "Thank you")
        hall.see(15.0, "t1", "t2")
        assert hall.said == [GREETING, "Good night."]
        hall.hear("t1", "Wake up!")
        hall.see(3.0, "t1", "t2")
    assert hall.said == [GREETING, "Good night.", "I am awake."]


def test_a_new_visitor_wakes_and_is_greeted_after_all_have_left():
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "Good night, Waldo")
        hall.see(3.0, "t1")
        hall.see(5.0)
        hall.see(3.0, "t2")
    assert hall.said == [GREETING, "Good night.", GREETING]


@pytest.mark.parametrize(
    ("language", "question", "parts"),
    [
        ("en", "Why did you greet me?", ("I greeted you because", "you paid attention to me")),
        ("en", "Why did you offer help?", ("I offered you help because", "you had been here for 8 s")),
        ("de", "Warum hast du mich gegrüßt?", ("ich habe Sie begrüßt, denn", "Sie haben sich mir zugewandt")),
        ("en", "What do you see?", ("I saw person t1",)),
    ],
)
def test_answers_questions_about_what_it_did_from_the_trace(language, question, parts):
    with Hall() as hall:
        hall.see(2.0)
        hall.see(14.0, "t1")
        hall.hear("t1", question, language)
        hall.see(4.0, "t1")
        (record,) = [one for one in hall.trace if one.kind == "answer"]
        detections = {one.id for one in hall.messages("/humans/bodies/detections")}
        said = {one.id for one in hall.messages("/speech/say")}
        known = {one.id for one in hall.trace} | detections | said
    assert [part for part in parts if part not in record.what] == []
    assert record.what == hall.said[-1]
    assert record.detail["known"]
    assert record.detail["question"] == question
    assert all(clause["records"] and set(clause["records"]) <= known for clause in record.detail["clauses"])


def test_an_open_question_is_asked_again_after_a_restart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Hall(mind_file="mind.json") as hall:
        hall.see(11.5, "t1")
        assert 'turn("t1")' in hall.believes()
    with Hall(mind_file="mind.json", start=round(12 * SECOND)) as hall:
        hall.see(25.0, "t1")
        assert 'greeted("t1")' in hall.believes()
        assert not {one for one in hall.believes() if one.startswith(("turn", "asked", "replied", "talks"))}
        hall.hear("t1", "Thank you")
        hall.see(3.0, "t1")
    assert hall.said == [OFFER, "You are welcome."]


def test_says_that_it_does_not_know():
    with Hall() as hall:
        hall.see(4.0, "t1")
        hall.hear("t1", "Why is the sky blue?")
        hall.see(4.0, "t1")
    assert hall.said[-1].startswith("I don't know")


def test_waits_while_a_person_is_speaking():
    with Hall(inputs=("/humans/voices/activity",)) as hall:
        hall.see(1.0)
        hall.send("/humans/voices/activity", VoiceActivity(stamp=hall.clock.now(), active=True, voice="v1"))
        hall.see(4.0, "t1")
        assert hall.said == []
        hall.send("/humans/voices/activity", VoiceActivity(stamp=hall.clock.now(), active=False, voice="v1"))
        hall.see(1.0, "t1")
    assert hall.said == [GREETING]


def test_a_script_adds_intents_and_sentences(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "more.yaml").write_text('sentences:\n  welcome: {en: "Any time!"}\n', encoding="utf-8")
    with Hall(script="more.yaml") as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "Thank you")
        hall.see(3.0, "t1")
    assert hall.said == [GREETING, "Any time!"]


def test_invalid_parameters_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match="no script in 'it'"):
        Hall(language="it")
    with pytest.raises(GraphError, match="cannot be read"):
        Hall(TalkingWaldo, script="none.yaml")


@pytest.mark.parametrize("text", ["How often did you greet me?", "How many people did you see?", "Who do you see now?"])
def test_what_no_phrase_matches_is_answered_from_the_trace(text):
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", text)
        hall.see(5.0, "t1")
    assert 'heard("t1", "ask_why", [])' in hall.believes()
    [found] = [record for record in hall.trace if record.kind == "answer"]
    assert found.detail["known"]
    assert all(clause["records"] for clause in found.detail["clauses"])


def test_a_misheard_question_is_answered_by_an_alternative():
    with Hall() as hall:
        hall.see(3.0, "t1")
        now = hall.clock.now()
        hall.send(
            SPEECH,
            HeardSpeech(
                stamp=now, start=now - SECOND, text="White did a beet me.", alternatives=("Why did you greet me?",),
                language="en", confidence=0.6, person="t1",
            ),
        )  # fmt: skip
        hall.see(5.0, "t1")
    assert "I greeted you because" in hall.said[-1]
    [record] = [record for record in hall.trace if record.kind == "answer"]
    assert record.detail["question"] == "Why did you greet me?"


UNCLEAR = "What about the first visitor?"


@pytest.mark.parametrize(
    ("reply", "told"),
    [
        ("The second one, please.", f'I said "{GREETING}"'),
        pytest.param("What you said.", f'I said "{GREETING}"', marks=pytest.mark.slow),
        ("Yes.", "I greeted you"),
        pytest.param("what you did", "I greeted you", marks=pytest.mark.slow),
        ("No.", "All right."),
        pytest.param("Why did you greet me?", "I greeted you because", marks=pytest.mark.slow),
    ],
)
def test_a_question_that_is_not_clear_is_asked_back(reply, told):
    with Hall() as hall:
        hall.see(16.0, "t1")
        hall.hear("t1", UNCLEAR)
        hall.see(4.0, "t1")
        assert hall.said[-1] == "Do you ask what I did 16 seconds ago, or what I said 16 seconds ago?"
        options = '["what I did 16 seconds ago", "what I said 16 seconds ago"]'
        assert f'heard("t1", "unclear", {options})' in hall.believes()
        assert 'asked("t1", "clarify")' in hall.believes()
        hall.hear("t1", reply)
        hall.see(6.0, "t1")
    assert told in hall.said[-1]
    assert not {each for each in hall.believes() if each.startswith(("asked", "turn"))}
    for record in (each for each in hall.trace if each.kind == "answer"):
        assert record.detail["known"]
        assert all(clause["records"] for clause in record.detail["clauses"])
        [action] = [each for each in hall.trace if each.id == record.cause]
        assert action.what.startswith('explain("t1"')


def test_nobody_says_which_question_is_meant():
    with Hall() as hall:
        hall.see(16.0, "t1")
        hall.hear("t1", UNCLEAR)
        hall.see(20.0, "t1")
        said = len(hall.said)
        hall.hear("t1", "The second one")
        hall.see(5.0, "t1")
    assert not {each for each in hall.believes() if each.startswith(("asked", "turn"))}
    assert hall.said[said:] == ["Sorry, I did not understand."]


def test_readings_are_forgotten_with_their_person():
    with Hall() as hall:
        hall.see(16.0, "t1")
        hall.hear("t1", UNCLEAR)
        hall.see(20.0, "t1")
        conversation = hall.node("waldo").conversation
        assert list(conversation.understood) == ["t1"]
        hall.see(1.0)
        hall.runner.advance(hall.clock.now() + nanoseconds(conversation.policy.forget_s))
    assert not conversation.understood


@pytest.mark.parametrize(
    ("question", "answered"),
    [
        ("What was the last thing you said?", f'12 seconds ago I said "{OFFER}".'),
        ("What did I say?", "Sorry, I did not understand."),  # nothing before the question
    ],
)
def test_answers_about_what_was_said(question, answered):
    with Hall() as hall:
        hall.see(20.0, "t1")
        said = len(hall.said)
        hall.hear("t1", question)
        hall.see(4.0, "t1")
    assert hall.said[said] == answered


def test_statements_are_not_taken_for_questions():
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "All people were here yesterday.")
        hall.see(3.0, "t1")
    assert hall.said[-1] == "Sorry, I did not understand."
