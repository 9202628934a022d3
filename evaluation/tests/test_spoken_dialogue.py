from __future__ import annotations

import pytest
from ruamel.yaml import YAML

from evaluation.dialogue import reception_script
from evaluation.spoken_dialogue import SENTENCES, Outcome, Sentence, lost_where, typed

SENTENCE = Sentence.read("Where is the library, please? -> directions library | find_colleague")
RIGHT = Outcome((("directions", "library"),), ("Where is the library, please?",), 1, answered=True)


def test_a_line_has_the_question_before_and_the_right_intents():
    assert SENTENCE.question == ""
    assert SENTENCE.wanted == (("directions", "library"), ("find_colleague",))
    assert Sentence.read("(offer) Yes. -> yes").question == "offer"
    assert SENTENCE.allows(("find_colleague", "anna"))
    assert not SENTENCE.allows(("directions", "laboratory"))


@pytest.mark.parametrize(
    ("heard", "texts", "voices", "where"),
    [
        ((("directions", "library"),), ("Where is the library?",), 1, ""),
        ((), (), 0, "not detected"),
        ((), (), 1, "detected, but no text"),
        ((), ("Where is", "the library, please"), 2, "split"),
        ((), ("where is the library please",), 1, "spelling, punctuation"),
        ((), ("The library, please?",), 1, "cut"),
        ((("directions", "laboratory"),), ("Where is the lab?",), 1, "misrecognised"),
    ],
)
def test_where_a_sentence_was_lost(heard, texts, voices, where):
    assert lost_where(SENTENCE, RIGHT, Outcome(heard, texts, voices, answered=True)) == where


def test_what_is_not_understood_when_typed_is_not_lost_by_hearing():
    lost = Outcome((("unknown",),), ("",), 1, answered=True)
    assert lost_where(SENTENCE, lost, lost) == "not understood when typed"


@pytest.mark.parametrize("line", ["Where is the library? -> directions library", "(shall_i_call) Yes. -> yes"])
def test_the_reception_hears_what_is_typed(line):
    sentence = Sentence.read(line)
    found = typed(sentence)
    assert sentence.allows(found.heard[-1])
    assert found.texts == (sentence.text,)


def test_the_sentences_have_known_intents_and_values():
    grammar = reception_script().grammar
    values = {value for known in grammar.values.values() for value in known}
    for lines in YAML(typ="safe").load(SENTENCES.read_text("utf-8")).values():
        assert len(lines) >= 60
        for sentence in map(Sentence.read, lines):
            assert {intent for intent, *_ in sentence.wanted} <= set(grammar.intents)
            assert {value for _, *slots in sentence.wanted for value in slots} <= values
