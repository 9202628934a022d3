from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.dialogue import UNKNOWN, Grammar, Intent
from socialbot.agents.dialogue._templates import words
from socialbot.agents.dialogue.intents import similarity
from socialbot.core.errors import RuleError

PLACES = {
    "library": {"en": ["library", "reading room"], "de": ["Bibliothek", "Bücherei"], "fr": ["bibliothèque"]},
    "laboratory": {"en": ["laboratory", "lab"], "de": ["Labor"], "es": ["laboratorio"]},
}
PEOPLE = {"anna": {language: ["Anna Smith", "Anna"] for language in ("en", "de", "es", "fr")}}
GRAMMAR = Grammar(
    [
        Intent("yes", phrases={"en": ["yes [please]", "sure"]}),
        Intent("no", phrases={"en": ["no [thanks|thank you]"], "de": ["nein [danke]"]}),
        Intent(
            "directions",
            ("place",),
            {
                "en": ["where is [the] {place}", "how do I get to [the] {place}", "can not find [the] {place}"],
                "de": ["wo (ist|finde ich) [die|das] {place}"],
                "es": ["dónde está [el|la] {place}"],
                "fr": ["où est [la|le] {place}"],
            },
        ),
        Intent("elsewhere", ("text",), {"en": ["(where is|how do I get to) [the] {text}"]}, fallback=True),
        Intent("place", ("place",), {"en": ["[the] {place}"], "fr": ["[la] {place}"]}, only_expected=True),
        Intent(
            "call",
            ("who",),
            {"en": ["call {who}"], "de": ["ruf[en Sie] {who} [an]"], "es": ["llame a {who}"], "fr": ["appelez {who}"]},
        ),
    ],
    {"place": PLACES, "who": PEOPLE},
)


@pytest.mark.parametrize(
    ("text", "language", "intent", "slots"),
    [
        ("Excuse me, where's the library?", "en", "directions", ("library",)),
        ("where is the reading room please", "en", "directions", ("library",)),
        ("WHERE IS THE LAB", "en", "directions", ("laboratory",)),
        ("How do I, um, get to the lab?", "en", "directions", ("laboratory",)),
        ("I can't find the library.", "en", "directions", ("library",)),
        ("Wo ist die Bücherei?", "de", "directions", ("library",)),
        ("¿Dónde está el laboratorio?", "es", "directions", ("laboratory",)),
        ("Où est la bibliothèque ?", "fr", "directions", ("library",)),
        ("Call Anna Smith, please", "en", "call", ("anna",)),
        (
            "I would like to know how I can get to the lab on the second floor",
            "en",
            "directions",
            ("laboratory",),
        ),
        ("Where is the swimming pool?", "en", "elsewhere", ("swimming pool",)),
        ("I have a dog", "en", UNKNOWN, ()),
        ("", "en", UNKNOWN, ()),
        ("Where is the library?", "de", UNKNOWN, ()),
    ],
)
def test_reads_intents_with_slots(text, language, intent, slots):
    reading = GRAMMAR.read(text, language)
    assert (reading.intent, reading.slots) == (intent, slots)
    assert bool(reading) == (intent != UNKNOWN)


@pytest.mark.parametrize(
    "text",
    [
        "where is the libary", "were is the library", "wear is the library", "where is the librarry",
        "where is the readingroom", "where is the reading rooms",
    ],
)  # fmt: skip
def test_reads_misheard_words(text):
    assert GRAMMAR.read(text, "en").slots == ("library",)


@pytest.mark.parametrize("text", ["where is the liberty", "where is the brewery", "wo ist the bakery"])
def test_other_places_are_not_taken_for_known_ones(text):
    assert GRAMMAR.read(text, "en").intent != "directions"


@pytest.mark.parametrize(
    ("text", "language"),
    [
        ("Do not call Anna", "en"), ("don't call Anna Smith", "en"), ("Never call Anna.", "en"),
        ("Rufen Sie Anna nicht an", "de"), ("No llame a Ana", "es"), ("N'appelez pas Anna", "fr"),
    ],
)  # fmt: skip
def test_negated_sentences_are_not_obeyed(text, language):
    assert GRAMMAR.read(text, language).intent != "call"


@pytest.mark.parametrize(("text", "language"), [("No, llame a Ana", "es"), ("No. Call Anna!", "en")])
def test_a_negation_ends_with_its_clause(text, language):
    assert GRAMMAR.read(text, language).intent == "call"


def test_a_negated_value_is_rejected():
    reading = GRAMMAR.read("No, not the library", "en", {"yes", "no", "place"})
    assert (reading.intent, reading.slots, reading.rejected) == ("no", (), ("library",))
    reading = GRAMMAR.read("No, not the library, the lab", "en", {"yes", "no", "place"})
    assert (reading.intent, reading.slots, reading.rejected) == ("place", ("laboratory",), ("library",))
    assert GRAMMAR.read("Pas la bibliothèque", "fr", {"place"}).intent == UNKNOWN


def test_short_replies_are_only_understood_when_they_are_expected():
    assert GRAMMAR.read("the library", "en").intent == UNKNOWN
    assert GRAMMAR.read("the library", "en", {"place"}).slots == ("library",)


def test_names_of_values_are_shown_in_the_language_of_the_person():
    assert GRAMMAR.name_of("library", "de") == "Bibliothek"
    assert GRAMMAR.name_of("library", "es") == "library"
    assert GRAMMAR.name_of("no value", "de") == "no value"


@pytest.mark.parametrize(
    ("one", "other", "alike"), [("anna", "ana", 1.0), ("where", "wehre", 0.8), ("abc", "xyz", 0.0), ("", "", 1.0)]
)
def test_similarity(one, other, alike):
    assert similarity(one, other) == similarity(other, one) == pytest.approx(alike)


@pytest.mark.parametrize(
    ("phrase", "problem"),
    [
        ("where is {room}", "unknown slot 'room'"), ("(where", "lacks ')'"), ("where]", "without its other bracket"),
        ("[where]", "can be empty"), ("", "can be empty"), ("{", "invalid '{'"), ("(a|b) " * 10, "too many variants"),
    ],
)  # fmt: skip
def test_invalid_phrases_are_refused_with_their_place(phrase, problem):
    with pytest.raises(RuleError, match="intent directions, en") as caught:
        Grammar([Intent("directions", ("place",), {"en": [phrase]})], {"place": PLACES})
    assert problem in str(caught.value)


def test_slots_need_values():
    with pytest.raises(RuleError, match="slot 'place' has no values"):
        Grammar([Intent("directions", ("place",))])


@given(st.text(max_size=120), st.sampled_from(["en", "de", "es", "fr", "xx", ""]))
def test_any_text_is_read(text, language):
    reading = GRAMMAR.read(text, language, {"yes", "no", "place"})
    assert 0 <= reading.score <= 1
    assert reading.words <= sum(map(len, words(text, language)))


@pytest.mark.parametrize(
    ("text", "language", "plain"),
    [
        ("Dr. Miller", "en", [["doctor", "miller"]]),
        ("Is Mr Brown in?", "en", [["is", "mister", "brown", "in"]]),
        ("I drive.", "en", [["i", "drive"]]),
        ("Où est Mme Miller ?", "fr", [["ou", "est", "madame", "miller"]]),
        ("M. Brown", "fr", [["monsieur", "brown"]]),
        ("Pouvez-vous m'aider ?", "fr", [["pouvez", "vous", "m", "aider"]]),
        ("Dr. Weber, Raum zwölf", "de", [["doktor", "weber"], ["raum", "12"]]),
        ("room twelve or Room 12", "en", [["room", "12", "or", "room", "12"]]),
        ("At 3:30, please. 5!", "en", [["at", "3:30"], ["please"], ["5"]]),
        ("Raum 2.15, 3,5 km...", "de", [["raum", "2.15"], ["3,5", "km"]]),
    ],
)
def test_spellings_of_the_same_speech_are_equal(text, language, plain):
    assert words(text, language) == plain


@pytest.mark.parametrize(
    ("text", "at"), [("Remind me at 3:30 today.", "3:30 today"), ("remind me at 14.30, please", "14.30")]
)
def test_free_words_of_a_slot_include_times(text, at):
    grammar = Grammar([Intent("remind", ("text",), {"en": ["remind me at {text}"]})])
    assert grammar.read(text, "en").slots == (at,)


def test_numbers_in_names_and_phrases_are_read_as_in_speech():
    rooms = {"lab": {"en": ["room 2.15"]}}
    grammar = Grammar([Intent("directions", ("place",), {"en": ["I am due at 3:30 in {place}"]})], {"place": rooms})
    reading = grammar.read("I am due at 3:30 in room 2.15.", "en")
    assert (reading.intent, reading.slots) == ("directions", ("lab",))


@pytest.mark.parametrize(
    ("text", "slots"),
    [
        ("Library?", ("library",)),
        ("The lab, please", ("laboratory",)),
        ("Hello, to the library, thank you!", ("library",)),
        ("No, not the library, the lab.", ("laboratory",)),
        ("The library was nice yesterday", None),
        ("I like the lab", None),
        ("Not the library", None),
    ],
)
def test_a_phrase_can_be_the_whole_sentence(text, slots):
    grammar = Grammar([Intent("directions", ("place",), {"en": ["^[to] [the] {place}$"]})], {"place": PLACES})
    reading = grammar.read(text, "en")
    assert (reading.slots if reading else None) == slots
    assert reading.left == 0


def test_words_that_a_phrase_leaves_are_counted():
    assert GRAMMAR.read("Excuse me, where is the library, please?", "en").left == 0
    assert GRAMMAR.read("Where is the library of my old school", "en").left == 3


@pytest.mark.parametrize(
    ("text", "language"),
    [("Don't call Bob, call Anna.", "en"), ("Call Anna, don't call Bob.", "en"), ("Nicht Bob, ruf Anna", "de")],
)
def test_a_clause_without_the_negation_is_read(text, language):
    reading = GRAMMAR.read(text, language)
    assert (reading.intent, reading.slots) == ("call", ("anna",))
    assert not GRAMMAR.read("Don't call Anna, don't call Bob.", "en")


def test_a_short_phrase_with_errors_is_no_phrase_of_a_long_sentence():
    """One word like "help" or "stop" is in many sentences that ask for nothing."""
    phrases = {
        "help": Intent("help", phrases={"en": ["help [me]"]}),
        "alarm": Intent("alarm", phrases={"en": ["is trapped"]}, urgent=True),
    }
    grammar = Grammar(phrases.values(), {})
    long = "these are single pictures so no box of another picture helps"
    assert grammar.read("helps", "en").intent == grammar.read("no picture helps", "en").intent == "help"
    assert grammar.read(long, "en").intent == UNKNOWN
    assert grammar.read(long, "en", expected=["help"]).intent == "help"
    assert grammar.read(long.replace("helps", "help"), "en").intent == "help"
    assert grammar.read("my daughter is traped in the lift behind the second door", "en").intent == "alarm"
