from __future__ import annotations

import random

import pytest

from evaluation.dialogue import damaged, measure, reception_script, unrelated


def test_sentences_without_errors_are_understood_in_all_languages():
    script = reception_script()
    assert len(script.languages) == 4
    for language in script.languages:
        assert measure(script, language, 0.0, 40) == {"understood": 40}


def test_errors_change_words():
    words = ["where", "is", "the", "library"] * 50
    assert damaged(words, 0.0, words, random.Random(1)) == words
    changed = damaged(words, 0.5, ["other"], random.Random(1))
    assert "other" in changed
    assert len(changed) < len(words)
    assert 50 < sum(word in words for word in changed) < 150


@pytest.mark.slow
def test_unrelated_sentences_are_not_understood():
    script = reception_script()
    texts = unrelated()
    assert sum(bool(script.grammar.read(text, "en")) for text in texts) <= len(texts) / 60
