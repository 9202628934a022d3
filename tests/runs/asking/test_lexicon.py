"""Lexicon of questions: forms of words in four languages, and what they mean."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.runs.asking._words import tokens
from socialbot.runs.asking.languages import LANGUAGES, lexicon
from socialbot.runs.asking.languages.lexicon import french, german, spanish


@pytest.mark.parametrize(
    ("verb", "forms"),
    [
        ("prufen", "gepruft prufst prufte pruftest pruft"),
        ("kontrollieren", "kontrolliert kontrollierte"),
        ("aufheben", "aufgehoben aufhob aufzuheben"),
        ("abholen", "abgeholt abholte"),
        ("verlassen", "verlassen verliess verlasst"),
        ("vorbereiten", "vorbereitet"),
        ("antworten", "geantwortet antwortete"),
        ("entladen", "entladen entlud"),
        ("nehmen", "nimmt nahm genommen"),
    ],
)
def test_german_verbs_have_their_forms(verb: str, forms: str) -> None:
    assert {(one,) for one in forms.split()} <= set(german((verb,), True))


def test_prefix_of_a_german_verb_stands_apart() -> None:
    assert ("hob", "auf") in set(german(("aufheben",), True))
    assert ("sagtest", "hallo") in set(german(("hallo", "sagen"), True))


@pytest.mark.parametrize(
    ("verb", "forms"),
    [
        ("controler", "controle controlee controlais"),
        ("remettre", "remis remettait remet"),
        ("conduire", "conduit conduisait"),
        ("finir", "fini finissait finit"),
        ("attendre", "attendu attendait attend"),
        ("revenir", "revenu revenait revient"),
        ("eteindre", "eteint eteignait"),
        ("ranger", "range rangeait"),
    ],
)
def test_french_verbs_have_their_forms(verb: str, forms: str) -> None:
    assert {(one,) for one in forms.split()} <= set(french((verb,), True))


@pytest.mark.parametrize(
    ("verb", "forms"),
    [
        ("revisar", "revisaste reviso revisado revisarlo revisaba revisara"),
        ("recoger", "recogio recogiste recojas"),
        ("poner", "puso pusiste puesto ponia"),
        ("cerrar", "cierra cerro cerraste cerraran cierre"),
        ("descargar", "descargo descargue descargado"),
        ("ir", "fue fuiste ido iba va"),
        ("conducir", "condujo conducido"),
        ("abrir", "abrio abierto abriste"),
        ("decir", "dijo dijiste dicho"),
    ],
)
def test_spanish_verbs_have_their_forms(verb: str, forms: str) -> None:
    assert {(one,) for one in forms.split()} <= set(spanish((verb,), True))


@pytest.mark.parametrize(
    ("language", "question", "english"),
    [
        ("de", "Wohin ist der Laster gefahren?", "truck move"),
        ("de", "Hob der Kran die erste Kiste hoch?", "crane raise box"),
        ("fr", "Qui s'est garé au dépôt ?", "park depot"),
        ("es", "¿Por qué pediste que cerraran la puerta?", "request close door"),
        ("en", "Who verified the badge?", "check badge"),
    ],
)
def test_words_of_a_question_have_the_meaning_of_english_words(language: str, question: str, english: str) -> None:
    found = {each.meaning for each in lexicon.found_in(tokens(question), language)}
    assert all(found & lexicon.meanings((word,)) for word in english.split())


@given(st.lists(st.text(max_size=12), max_size=12), st.sampled_from(sorted(LANGUAGES)))
def test_places_are_those_of_the_words(words: list[str], language: str) -> None:
    for each in lexicon.found_in(words, language):
        assert list(each.places) == sorted(set(each.places))
        assert all(0 <= place < len(words) for place in each.places)


@pytest.mark.parametrize(
    ("word", "language"),
    [("handed", "en"), ("received", "en"), ("bekam", "de"), ("remis", "fr"), ("entregaste", "es")],
)
def test_handing_over_is_putting(word: str, language: str) -> None:
    assert lexicon.meanings((word,), language) & lexicon.meanings(("put",))
