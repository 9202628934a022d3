"""Wordings of questions: indirect ones, typing errors, statements, passives, and what must be refused."""

from __future__ import annotations

import random
import time

import pytest

from socialbot.runs.asking import answer
from socialbot.runs.asking._clauses import without_matrix
from socialbot.runs.asking._words import corrected, similarity, tokens
from socialbot.runs.asking.languages import ENGLISH, LANGUAGES
from socialbot.runs.asking.languages.lexicon import done_by, meanings, named_meanings
from socialbot.runs.run import RunView
from tests.runs.asking.waldo_run import two_visitors

GREETED = "At 2.2 s I greeted person t1 because"
NOT_HELPED = "I did not offer person t2 help because person t2 had only been here for 4.7 s"


@pytest.fixture(scope="module")
def waldo() -> RunView:
    return two_visitors()


@pytest.mark.parametrize(
    "question",
    [
        "I wonder why you greeted t1.",
        "Not sure why you greeted t1, can you tell me?",
        "Um, so, why did you, you know, greet t1?",
        "I don't understand why you greeted t1.",
        "Why was it that you greeted t1?",
        "why did yuo greet teh frist visitor",
        "Reason for greeting t1?",
        "What triggered the greeting at t=2.2?",
        "Why did you greet the person who was here at the beginning?",
    ],
)
def test_the_reason_of_a_deed_is_asked_for(waldo, question):
    assert answer(waldo, question).text.startswith(GREETED)


@pytest.mark.parametrize(
    "question",
    [
        "Did you help t2 or did you forget it?",
        "Is it true that you helped t2?",
        "I was wondering if you had offered help to t2.",
        "You helped t1, so why not t2?",
        "Why was only t1 offered help, and t2 left out?",
        "didnt you hlep t2",
    ],
)
def test_what_was_left_undone_is_asked_for(waldo, question):
    assert NOT_HELPED in answer(waldo, question).text


@pytest.mark.parametrize(
    ("question", "text"),
    [
        # States and counts are asked for
        ("how mnay visitors came", "2 people were here."),
        ("Total number of visitors?", "2 people were here."),
        ("Longest visit?", "Person t1 was here from 2 to 13.9 s."),
        ("Was anyone there a quarter of a minute in?", "At 15 s I saw nobody."),
        ("Show me what was detected at 22 s.", "At 22 s I saw person t2 4 m away."),
        ("Könntest du mir sagen, wann t2 da war?", "Person t2 war von 20 bis 24,9 s hier."),
        # Short and mistyped questions
        ("Any visitors at 22 s?", "At 22 s I saw person t2 4 m away."),
        ("wat did you see at 22 s", "At 22 s I saw person t2 4 m away."),
        ("how meny visiters came", "2 people were here."),
        ("Whose visit was the shortest?", "Person t2 was here from 20 to 24.9 s."),
        ("What was your first act after t1 had walked off?", "At 15.9 s I stayed idle."),
        ("Combien de personnes as-tu vues ?", "2 personnes étaient là."),
    ],
)
def test_states_counts_and_short_questions_are_understood(waldo, question, text):
    assert answer(waldo, question).text == text


@pytest.mark.parametrize(
    "question",
    [
        "Did t1 thank you for the offer?",
        "What did you give t2?",
        "Did you give t1 a present?",
        "Was t1 a woman?",
        "What does t1 look like?",
        "Which way did the first visitor leave?",
        "Who is the president?",
        "Was anybody refused?",
    ],
)
def test_other_questions_are_refused(waldo, question):
    found = answer(waldo, question)
    assert not found.known
    assert {each.claim.kind for each in found.clauses} <= {"not_named"}
    assert found.examples


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("I do not know why you left", "why you left"),
        ("Might I ask when t2 came?", "when t 2 came"),
        ("Is it right that you saw t1?", "you saw t 1"),
        ("Who was here, do you know?", "who was here"),
        ("Do you know whether t1 came?", "t 1 came"),
        ("Did you see anyone when t1 came?", "did you see anyone when t 1 came"),
        ("What do you know?", "what do you know"),
        ("Why did you wait?", "why did you wait"),
    ],
)
def test_a_clause_that_only_asks_is_left_out(text, asked):
    assert " ".join(without_matrix(tokens(text), ENGLISH)) == asked


def test_each_language_has_words_of_asking():
    indirect = {"de": "Ich möchte wissen, wer da war", "fr": "Je voudrais savoir qui était là"}
    indirect |= {"es": "Quiero saber quién estuvo aquí", "en": "I want to know who was here"}
    asked = {code: without_matrix(tokens(text), LANGUAGES[code])[0] for code, text in indirect.items()}
    assert asked == {"de": "wer", "fr": "qui", "es": "quien", "en": "who"}


@pytest.mark.parametrize("code", ["de", "en", "es", "fr"])
def test_each_word_alone_is_answered_or_refused(waldo, code):
    """A verb of saying alone ended with an IndexError."""
    of_saying = [phrase for name in ("say", "hear", "asks", "replies") for phrase in LANGUAGES[code].phrases[name]]
    for phrase in of_saying:
        assert answer(waldo, " ".join(phrase)).text
    words = sorted(LANGUAGES[code].known_words)
    for word in random.Random(5).sample(words, 40):
        assert answer(waldo, word).text


def test_many_unknown_words_take_little_time(waldo):
    """A page takes questions of 500 characters; words of the Spanish lexicon were stemmed for each unknown one."""
    chance = random.Random(3)
    words = ["".join(chance.choices("abcdefghijklmnoprstuvw", k=9)) for _ in range(50)]
    answer(waldo, words[0])  # reads the lexicon
    begun = time.process_time()
    assert not answer(waldo, " ".join(words)).known
    assert time.process_time() - begun < 4.0


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("teh", "the"), ("yuo", "you"), ("wher", "where"), ("visiter", "visitor"), ("greeet", "greet"),
        ("thank", "thank"), ("pick", "pick"), ("door", "door"), ("xyz", "xyz"), ("th", "th"), ("greets", "greets"),
    ],
)  # fmt: skip
def test_mistyped_words_are_corrected(word, meant):
    known = {"the", "you", "where", "visitor", "greet", "than", "kick", "room", "greeted"}
    assert corrected(word, known, frozenset({"door"})) == meant


def test_two_words_that_are_equally_near_are_no_correction():
    assert corrected("bexes", {"boxes", "buxes"}, frozenset()) == "bexes"


def test_words_with_other_first_sounds_are_not_alike():
    assert similarity("fall", "call") < 0.72
    assert similarity("creet", "greet") > 0.72


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("Which of the two visitors got help?", "At 10.2 s I offered person t1 help."),
        ("Who came right after t1?", "Person t2 was here from 20 to 24.9 s."),
        ("Which visitor came before t2?", "Person t1 was here from 2 to 13.9 s."),
        ("How many folks did you see today?", "2 people were here."),
        ("When the first visitor had gone, what did you do next?", "At 15.9 s I stayed idle."),
        ("Does the log show anybody at 22 s?", "At 22 s I saw person t2 4 m away."),
        ("How come t1 got greeted two times?", "At 2.2 s I greeted person t1 because person t1 paid attention to me"),
    ],
)
def test_people_are_named_in_other_words(waldo, question, text):
    assert answer(waldo, question).text.startswith(text.rstrip("."))


def test_people_left_out_are_asked_for_by_a_verb(waldo):
    assert NOT_HELPED in answer(waldo, "Did you forget to help anyone?").text


def test_plans_of_people_are_unknown(waldo):
    assert not answer(waldo, "What will the visitors do next?").known


@pytest.mark.parametrize("question", ["Do you have any plans?", "Is there something you want to do now?"])
def test_plans_are_asked_for(waldo, question):
    assert answer(waldo, question).intent == "next"


def test_what_people_will_do_is_unknown(waldo):
    assert not answer(waldo, "Will t1 come back?").known


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("Why did you lend t1 a hand?", "At 10.2 s I offered person t1 help"),
        ("Did you disregard t1?", "No: at 2.2 s I greeted person t1."),
        ("On what grounds was person two shown no assistance?", "I did not offer person t2 help"),
        ("Rationale for greeting t1?", GREETED),
        ("At which moment was t1 greeted?", "At 2.2 s I greeted person t1."),
        ("What prevented you from helping t2?", "I did not offer person t2 help"),
        ("In how many cases did you greet somebody?", "2 times: at 2.2 s"),
        ("What's the total number of visitors?", "2 people were here."),
        ("Who have you seen?", "Person t1 was here from 2 to 13.9 s"),
        ("Was anyone close to you at 22 s?", "At 22 s I saw person t2 4 m away."),
        ('Have you ever said "come in"?', 'No: I did not say "come in".'),
        ("Quote what you said to t2.", 'At 20.2 s I said "Hello! Nice to see you.".'),
        ("Did t1 leave before t2?", "Person t1 was here from 2 to 13.9 s and person t2 was here"),
        ("Bekam t2 Hilfe?", "Nein: ich habe Person t2 keine Hilfe angeboten"),
    ],
)
def test_other_words_of_the_same_meaning_reach_the_record(waldo, question, text):
    assert answer(waldo, question).text.startswith(text)


def test_silence_towards_a_person_is_a_deed_left_undone(waldo):
    found = answer(waldo, "Why did you hold back with t2 after 22 s?")
    assert not found.known or "did not stay idle" not in found.text
    assert not answer(waldo, "Did you idle with t2?").known


@pytest.mark.parametrize(
    "question",
    [
        # Requests and deeds of people are refused
        "Can you greet t2 now?",
        "Could you help t2?",
        "Please greet t2.",
        "Kannst du t2 begrüßen?",
        "Peux-tu saluer t2 ?",
        "¿Puedes saludar a t2?",
        "Help me!",
        "Did t1 like your help?",
        "What did t2 want?",
        "What is t1's name?",
        "Did you ask t1 for his name?",
        # Words that only resemble the grammar are not answered
        "What would you do if ten people came?",
        "How many kids does t1 have?",
        "What water you?",
        "Did you tickle the bird?",
    ],
)
def test_requests_deeds_of_people_and_other_words_are_refused(waldo, question):
    assert not answer(waldo, question).known


def test_synonyms_are_known_for_the_names_of_actions():
    assert meanings(("grab",)) & named_meanings("pickup")
    assert meanings(("sanitise",)) & named_meanings("disinfects")
    assert meanings(("nonsense",)) == frozenset()


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("What tempted you to address t1?", GREETED),
        ("Somebody told me you greeted t1. True?", "Yes: at 2.2 s I greeted person t1"),
        ("How come the second one only got a greeting and no help?", NOT_HELPED),
        ("What did t1 hear from you?", 'I said "'),
        ("Why did you great the fird visitor?", "I don't know. The record does not say so"),  # two people came
        ("When did t1 stroll in?", "Person t1 was here from"),
        ("Until when did t1 hang around?", "Person t1 was here from"),
        ("weather you helped t2 i want to know", NOT_HELPED),
    ],
)
def test_other_phrases_are_understood(waldo, question, text):
    assert text in answer(waldo, question).text


def test_words_that_do_a_deed_have_its_verbs() -> None:
    assert meanings(("let", "in")) <= done_by(tokens("Come in, Ann"))
    assert meanings(("turn", "away")) <= done_by(tokens("You stay outside: the badge is unknown"))
    assert meanings(("admit",)) <= done_by(tokens("Kommen Sie herein, Ann"))
    assert done_by(tokens("I am coming")) == frozenset()


def test_number_of_deeds_in_a_statement_is_checked(waldo) -> None:
    assert answer(waldo, "You greeted t1 twice, didn't you?").text.startswith("Once: at 2.2 s I greeted person t1")
