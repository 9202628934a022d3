from __future__ import annotations

import pytest

from socialbot.agents.dialogue import Intent, Question, Script, load_script
from socialbot.core.errors import GraphError, RuleError

TEXT = """
values:
  place:
    library: {en: [library, reading room], de: Bibliothek}
intents:
  yes: {en: ["yes"], de: ["ja"]}
  directions:
    slots: [place]
    en: ["where is [the] {place}"]
questions:
  which: {expects: [directions], tries: 2, patience_s: 5}
sentences:
  which: {en: Which room?, de: Welcher Raum?}
  way: {en: "The {0} is on floor {1}.", de: "{0}: Etage {1}."}
"""


def test_reads_a_file(tmp_path):
    path = tmp_path / "script.yaml"
    path.write_text(TEXT, encoding="utf-8")
    script = load_script(path)
    assert script.languages == ("en", "de")
    assert script.grammar.read("where is the reading room", "en").slots == ("library",)
    assert script.questions["which"] == Question("which", ("directions",), 2, 5.0)
    assert script.sentence("way", ("library", 2), "de") == ("Bibliothek: Etage 2.", "de")
    assert script.sentence("way", ("library", 2), "fr") == ("The library is on floor 2.", "en")


def test_a_script_extends_another():
    other = Script([Intent("yes", phrases={"en": ["of course"]})], sentences={"which": {"en": "Which one?", "fr": "?"}})
    both = load_script("script.yaml", TEXT) | other
    assert both.grammar.read("of course", "en").intent == "yes"
    assert both.grammar.read("yes", "en").intent == "unknown"
    assert both.sentences["which"] == {"en": "Which one?", "de": "Welcher Raum?", "fr": "?"}
    assert both.grammar.read("where is the library", "en").intent == "directions"
    assert both.questions["which"].tries == 2


def test_a_question_and_the_names_of_a_slot_are_replaced():
    other = Script(
        values={"place": {"lab": {"en": ["lab"]}}},
        questions=[Question("which", ("directions",), 1)],
        base=load_script("script.yaml", TEXT),
    )
    assert other.questions["which"].tries == 1
    assert other.grammar.read("where is the lab", "en").slots == ("lab",)
    assert other.grammar.read("where is the library", "en").intent == "unknown"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("expects: [directions]", "expects: [direction]", "did you mean 'directions'"),
        ("questions:", "question:", "unknown key 'question'"),
        ("tries: 2", "tries: 0", "'tries' must be a whole number from 1 to 10"),
        ("patience_s: 5", "patience: 5", "unknown key 'patience'"),
        ("{en: Which room?, de: Welcher Raum?}", "Which room?", "expected names with values"),
        ("slots: [place]", "fallback: maybe", "'fallback' must be true or false"),
        ("slots: [place]", "slots: [room]", "slot 'room' has no values"),
        ("de: Welcher Raum?", "deutsch: Welcher Raum?", "expected a language, got 'deutsch'"),
        ("floor {1}", "floor {floor}", "unknown field {floor}"),
        ("floor {1}", "floor {1", "is no sentence"),
        ("floor {1}", "floor {1:99999999999}", "unknown field {1:99999999999}"),
        ("floor {1}", "floor {1:{2:{3}}}", "unknown field {1:{2:{3}}}"),
        ("floor {1}", "floor {1:d}", "unknown field {1:d}"),
        ("floor {1}", "floor {1!r}", "unknown field {1!r}"),
        ("floor {1}", "floor {" + "9" * 100 + "}", "unknown field {999"),
        ("where is [the] {place}", "[" * 3000 + "a" + "]" * 3000 + " {place}", "nests brackets more than 20 deep"),
        ("which: {en", "what: {en", "question 'which' has no sentence"),
    ],
)
def test_invalid_files_are_refused(old, new, problem):
    assert old in TEXT
    with pytest.raises((GraphError, RuleError)) as caught:
        load_script("script.yaml", TEXT.replace(old, new))
    assert problem in str(caught.value)


def test_sentences_need_their_arguments():
    script = load_script("script.yaml", TEXT)
    with pytest.raises(RuleError, match="needs more than 1 arguments"):
        script.sentence("way", ("library",), "en")
    with pytest.raises(RuleError, match="no sentence for 'weg'"):
        script.sentence("weg", (), "en")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(GraphError, match="cannot be read"):
        load_script(tmp_path / "none.yaml")
