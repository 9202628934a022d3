"""Dialogue script: intents, questions and sentences, declared in Python or in a YAML file.

A file has these parts, all optional; texts by language are a text or a list of texts::

    values:
      place:
        library: {en: [library, reading room], de: Bibliothek}
    intents:
      directions:
        slots: [place]
        en: ["where is [the] {place}"]
        de: ["wo ist [die|das|der] {place}"]
    questions:
      offer: {expects: [yes, no], tries: 1, patience_s: 8}
    sentences:
      offer: {en: Can I help you with anything?, de: Kann ich Ihnen helfen?}
      way: {en: "The {0} is on floor {1}.", de: "{0}: Etage {1}."}
"""

from __future__ import annotations

import re
import string
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec

from socialbot.agents.dialogue.intents import Grammar, Intent
from socialbot.core.errors import GraphError, RuleError, suggestion
from socialbot.core.paths import read_text
from socialbot.core.yaml import YamlSection, read_page

Names = Mapping[str, Mapping[str, Sequence[str]]]
"""Names of slot values: value to language to names."""


ANY = "any"
"""Stands for all intents, except those that are only understood if they are expected."""


_FLAGS = ("only_expected", "fallback", "urgent")


@dataclass(frozen=True)
class Question:
    """Question that a person may answer.

    Args:
        name: Its name; a sentence of this name asks it.
        expects: Intents that answer it; "any" stands for all that are not `only_expected`.
        tries: How often it is asked: again after a silence or a reply that is not understood.
        patience_s: Time for the reply after the end of the sentence, s.
    """

    name: str
    expects: tuple[str, ...]
    tries: int = 3
    patience_s: float = 8.0


_LANGUAGE = "[A-Za-z]{2}"
Language = Annotated[
    str, msgspec.Meta(pattern=_LANGUAGE, description="a language; write a code of two letters, such as en")
]
Texts = dict[Language, str | list[str]]
"""Texts by language in a file."""


class _Question(msgspec.Struct):
    expects: tuple[str, ...] = ()
    tries: Annotated[int, msgspec.Meta(ge=1, le=10)] = Question.tries
    patience_s: Annotated[float, msgspec.Meta(ge=0.5, le=120)] = Question.patience_s


class _Page(msgspec.Struct):
    values: dict[str, dict[str, Texts]] = {}
    intents: dict[str, dict[Any, Any]] = {}
    questions: dict[str, _Question] = {}
    sentences: dict[str, dict[Language, str]] = {}


class Script:
    """Intents, questions and sentences of a dialogue.

    Args:
        intents: The intents, most specific first.
        values: Values by slot, see `Grammar`.
        questions: The questions.
        sentences: Sentences by situation and language; ``{0}`` is the first argument.
        where: Place of the declaration, for errors.
        base: Script that this one extends: its parts are replaced by equally named ones and tried after them.

    Raises:
        RuleError: A part refers to an unknown one, or a phrase or sentence is invalid.
    """

    def __init__(
        self,
        intents: Iterable[Intent] = (),
        values: Mapping[str, Names] | None = None,
        questions: Iterable[Question] = (),
        sentences: Mapping[str, Mapping[str, str]] | None = None,
        where: str = "dialogue",
        base: Script | None = None,
    ) -> None:
        intents = list(intents)
        self.questions = {question.name: question for question in questions}
        self.sentences = {name: dict(texts) for name, texts in (sentences or {}).items()}
        if base is not None:
            new = {intent.name for intent in intents}
            intents += [one for name, one in base.grammar.intents.items() if name not in new]
            values = {**base.grammar.values, **(values or {})}
            self.questions = {**base.questions, **self.questions}
            names = dict.fromkeys((*base.sentences, *self.sentences))
            self.sentences = {name: {**base.sentences.get(name, {}), **self.sentences.get(name, {})} for name in names}
        self.grammar = Grammar(intents, values)
        for question in self.questions.values():
            for intent in question.expects:
                if intent != ANY and intent not in self.grammar.intents:
                    remedy = suggestion(intent, self.grammar.intents)
                    raise RuleError(
                        f"question {question.name!r} expects the unknown intent {intent!r}", where=where, remedy=remedy
                    )
            if question.name not in self.sentences:
                remedy = suggestion(question.name, self.sentences)
                raise RuleError(f"question {question.name!r} has no sentence", where=where, remedy=remedy)
        for name, texts in self.sentences.items():
            for language, text in texts.items():
                _check_fields(text, f"{where}: sentence {name}, {language}")

    def __or__(self, other: Script) -> Script:
        """Return both scripts in one; parts of the right one replace equally named ones and are tried first."""
        grammar = other.grammar
        return Script(grammar.intents.values(), grammar.values, other.questions.values(), other.sentences, base=self)

    @property
    def languages(self) -> tuple[str, ...]:
        """Languages in which the script understands and speaks, in the order of its phrases."""
        spoken = {language for texts in self.sentences.values() for language in texts}
        return tuple(language for language in self.grammar.languages if language in spoken)

    def sentence(self, situation: str, arguments: Sequence[object], language: str) -> tuple[str, str]:
        """Return the sentence for a situation and its language: the given one, or else the first that has it.

        Arguments that are values of a slot are shown by their name in the language.

        Raises:
            RuleError: There is no such sentence, or it needs more arguments.
        """
        texts = self.sentences.get(situation)
        if not texts:
            raise RuleError(f"no sentence for {situation!r}", remedy=suggestion(situation, self.sentences))
        language = language if language in texts else next(iter(texts))
        shown = [self.grammar.name_of(one, language) if isinstance(one, str) else one for one in arguments]
        try:
            return texts[language].format(*shown), language
        except IndexError as error:
            raise RuleError(f"sentence {situation!r} needs more than {len(shown)} arguments") from error


def load_script(path: Path | str, text: str | None = None, base: Script | None = None) -> Script:
    """Read a script from a YAML file.

    Args:
        path: The file.
        text: Its content, if it has been read.
        base: Script that the file extends; it may use its values, intents and sentences.

    Raises:
        GraphError: The file cannot be read or does not follow the layout.
        RuleError: A part refers to an unknown one, or a phrase or sentence is invalid.
    """
    root = page_of(path, text)
    page, intents = root.read(_Page), root.section("intents", {})
    return Script(
        [_intent(str(name), intents.section(name)) for name in intents.page],
        {slot: {value: listed(names) for value, names in values.items()} for slot, values in page.values.items()},
        [Question(name, one.expects, one.tries, one.patience_s) for name, one in page.questions.items()],
        page.sentences,
        where=str(path),
        base=base,
    )


def page_of(path: Path | str, text: str | None = None) -> YamlSection:
    """Parse a YAML file, or its ``text`` if it has been read. Raises GraphError."""
    if text is None:
        text = read_text(Path(path), GraphError, remedy="name a YAML file")
    return read_page(text, where=str(path))


def listed(texts: Texts) -> dict[str, list[str]]:
    """Return the texts of a file by language, each as a list."""
    return {language: [text] if isinstance(text, str) else text for language, text in texts.items()}


def _intent(name: str, section: YamlSection) -> Intent:
    flags = {key: section.value(key, bool, False) for key in _FLAGS}
    phrases = {key: section.value(key, str | list[str]) for key in section.page if re.fullmatch(_LANGUAGE, str(key))}
    section.only("slots", *_FLAGS, *phrases)
    return Intent(name, section.value("slots", tuple[str, ...], ()), listed(phrases), **flags)


def _check_fields(text: str, where: str) -> None:
    try:
        fields = [(name, form, kind) for _, name, form, kind in string.Formatter().parse(text) if name is not None]
    except ValueError as error:
        raise RuleError(
            f"{text!r} is no sentence: {error}", where=where, remedy="write {{ and }} for braces"
        ) from error
    for name, form, kind in fields:
        if form or kind or not re.fullmatch("[0-9]{1,2}", name):
            shown = f"{name}{f'!{kind}' if kind else ''}{f':{form}' if form else ''}"
            raise RuleError(
                f"{text!r} has the unknown field {{{shown}}}", where=where, remedy="write {0} for the first argument"
            )
