"""Parser of S-expressions, and the declared names of a PDDL domain or problem, with line numbers for errors."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from socialbot.core.errors import PlanningError
from socialbot.core.limits import PDDL_DEPTH
from socialbot.planning.pddl.domain import OBJECT, PddlDomain, Signature
from socialbot.planning.pddl.formulas import Terms, TypedName

TOKEN = re.compile(r"[()]|[^\s()]+")
_OPERATOR = re.compile(r"(?<![^\s()])(?:(?:[<>]=?|[=*/+-])(?=\?)|-(?=[^\W\d]))")


def spaced(text: str) -> str:
    """Return PDDL with a blank between an operator and the word after it: ``(=?duration 5)``, ``?r -robot``."""
    return _OPERATOR.sub(lambda found: f"{found[0]} ", text)


@dataclass(frozen=True, slots=True)
class SexpWord:
    """Token of an S-expression, in lower case."""

    text: str
    line: int

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class SexpGroup:
    """Items between two parentheses; ``line`` is that of the opening one."""

    items: tuple[Sexpression, ...]
    line: int

    @property
    def head(self) -> str:
        return self.items[0].text if self.items and isinstance(self.items[0], SexpWord) else ""

    @property
    def rest(self) -> tuple[Sexpression, ...]:
        return self.items[1:]

    def __str__(self) -> str:
        return f"({' '.join(map(str, self.items))})"


Sexpression = SexpWord | SexpGroup


def read_sexpression(text: str, *, where: str) -> SexpGroup:
    """Parse a text of exactly one group; comments begin with ``;``. Raises PlanningError with the line.

    A byte order mark, and ``)`` after the end, are ignored.
    """
    whole: SexpGroup | None = None
    end = nested = 0
    open_groups: list[tuple[int, list[Sexpression]]] = []
    for number, line in enumerate(text.removeprefix("\ufeff").lower().split("\n"), 1):
        for token in TOKEN.findall(spaced(line.partition(";")[0])):
            if whole is not None and token != ")" and whole.head != "define":
                what = f"expected (define ...), found ({whole.head} ...)"
                raise PlanningError(what, where=f"{where}:{whole.line}", remedy="remove it; a file begins with (define")
            if whole is not None and token != ")":
                raise PlanningError(
                    f"unexpected text after the end: {token!r}",
                    where=f"{where}:{number}",
                    remedy=f"remove it, write it into a file of its own, or remove the extra parenthesis before it; "
                    f"(define ends in line {end}",
                )
            if whole is not None:
                continue
            if token == "(":
                if len(open_groups) == PDDL_DEPTH:
                    raise PlanningError(f"more than {PDDL_DEPTH} parentheses in each other", where=f"{where}:{number}")
                open_groups.append((number, []))
            elif not open_groups:
                raise PlanningError(
                    f"expected a parenthesis, found {token!r}",
                    where=f"{where}:{number}",
                    remedy="a file begins with (define (domain ...) or (define (problem ...)",
                )
            elif token == ")":
                begin, items = open_groups.pop()
                group = SexpGroup(tuple(items), begin)
                if open_groups:
                    open_groups[-1][1].append(group)
                else:
                    whole, end = group, number
            else:
                if token.startswith(":") and len(open_groups) > 2 and not open_groups[-1][1]:
                    nested = nested or number
                open_groups[-1][1].append(SexpWord(token, number))
    if open_groups:
        remedy = f"add the missing ), perhaps before the section in line {nested}" if nested else "add the missing )"
        raise PlanningError("this parenthesis is never closed", where=f"{where}:{open_groups[-1][0]}", remedy=remedy)
    if whole is None:
        raise PlanningError("the file is empty", where=where, remedy="a file begins with (define ...")
    return whole


RESERVED = frozenset({
    "and", "or", "not", "imply", "forall", "exists", "when", "either", "object", "number", "assign", "increase",
    "decrease", "scale-up", "scale-down",
})  # fmt: skip
_NAME = re.compile(r"[^\W\d][\w-]*")
_OBJECT_NAME = re.compile(r"[\w.@-]*[^\W\d][\w.@-]*")
"""Planners also accept names of objects such as ``2nd-floor`` and ``hall.door``."""


@dataclass(frozen=True, slots=True)
class Scope:
    """Variables of a formula with their types.

    Attributes:
        duration: Whether ``?duration`` is allowed.
        untyped: Variables of quantifiers without a type. They stand for all objects and fit every parameter.
    """

    variables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    duration: bool = False
    untyped: frozenset[str] = frozenset()

    def within(self, variables: Iterable[TypedName], *, quantified: bool = False) -> Scope:
        new = {typed.name: typed.types for typed in variables}
        untyped = {name for name, types in new.items() if quantified and types == (OBJECT,)}
        return Scope({**self.variables, **new}, self.duration, (self.untyped - new.keys()) | untyped)


DECLARED = frozenset({"type", "predicate", "function", "variable", "object"})
"""Kinds of names that files declare."""

_HDDL = ("task networks of HDDL", "write each task as an action or a goal, or use `socialbot.planning.htn`")
_MA_PDDL = "leave it out: the agents are the arguments of the actions"
_CHANCE = ("effects that depend on chance", "write the wanted outcome; the plan is made again after another one")
_OTHER_LANGUAGES: dict[str, tuple[str, str]] = {
    "oneof": _CHANCE,
    "probabilistic": _CHANCE,
    ":observe": ("observations", "write an effect; what sensors see becomes a belief while the plan runs"),
    ":task": _HDDL,
    ":method": _HDDL,
    ":htn": _HDDL,
    ":agent": ("agents of MA-PDDL", _MA_PDDL),
    ":private": ("private names of agents of MA-PDDL", _MA_PDDL),
    ":expansion": ("expansions of PDDL 1.2", "write each of its steps as an action"),
}
"""Words of languages, and of early PDDL, that extend PDDL in ways that plans cannot express, and remedies."""


@dataclass
class Vocabulary:
    """Names that are declared so far; ``objects`` are constants and, in problems, objects."""

    where: str
    domain: PddlDomain
    objects: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def error(self, what: str, at: Sexpression, remedy: str | None = None) -> PlanningError:
        return PlanningError(what, where=f"{self.where}:{at.line}", remedy=remedy)

    def unsupported(self, what: str, at: Sexpression, remedy: str) -> PlanningError:
        return self.error(f"not supported by socialbot: {what}", at, remedy)

    def _of_another_language(self, word: str, at: Sexpression) -> PlanningError:
        what, remedy = _OTHER_LANGUAGES[word]
        return self.unsupported(f"{what} ({word})", at, remedy)

    def unknown(self, kind: str, name: str, known: Iterable[str], at: Sexpression) -> PlanningError:
        """Return an error for an undeclared name: of another language, or with the nearest declared one."""
        if name in _OTHER_LANGUAGES:
            return self._of_another_language(name, at)
        names = list(known)
        near = difflib.get_close_matches(name, names, n=1)
        remedy = f"declare the {kind}" if kind in DECLARED else f"known: {', '.join(names)}"
        return self.error(f"unknown {kind} {name!r}", at, f"did you mean {near[0]!r}?" if near else remedy)

    def group(self, item: Sexpression, what: str) -> SexpGroup:
        if isinstance(item, SexpWord):
            raise self.error(f"expected {what} in parentheses, found {item}", item)
        return item

    def word(self, items: Sequence[Sexpression], index: int, what: str, of: Sexpression) -> SexpWord:
        if index >= len(items):
            raise self.error(f"{what} is missing", of)
        item = items[index]
        if isinstance(item, SexpGroup):
            raise self.error(f"expected {what}, found {item}", item)
        return item

    def parts(self, group: SexpGroup, number: int) -> tuple[Sexpression, ...]:
        """Return the items after the head, which must be one or two."""
        if len(group.rest) != number:
            wanted = "one part" if number == 1 else "two parts"
            raise self.error(f"{group.head} takes {wanted}, not {len(group.rest)}: {group}", group)
        return group.rest

    def new_name(self, word: SexpWord, what: str) -> str:
        if word.text in _OTHER_LANGUAGES and word.text.startswith(":"):
            raise self._of_another_language(word.text, word)
        reserved = word.text in RESERVED and not (what == "a type" and word.text == "number")
        pattern = _OBJECT_NAME if what == "an object" else _NAME
        if reserved or not pattern.fullmatch(word.text) or is_number(word):
            raise self.error(
                f"{word.text!r} cannot be the name of {what}",
                word,
                "names begin with a letter and consist of letters, digits, - and _"
                if not reserved
                else "the word means something in PDDL; choose another",
            )
        return word.text

    def typed_list(self, items: Sequence[Sexpression]) -> list[tuple[SexpWord, tuple[str, ...]]]:
        """Return words with their unchecked types, as in ``a b - box c``. A type without words has no effect."""
        found: list[tuple[SexpWord, tuple[str, ...]]] = []
        waiting: list[SexpWord] = []
        rest = _parted(items)
        for item in rest:
            if isinstance(item, SexpGroup):
                if item.head in _OTHER_LANGUAGES:
                    raise self._of_another_language(item.head, item)
                raise self.error(f"expected a name, found {item}", item)
            if item.text != "-":
                waiting.append(item)
                continue
            kind = next(rest, None)
            if kind is None:
                raise self.error("a type belongs after -", item)
            types = self._types(kind)
            found += ((word, types) for word in waiting)
            waiting.clear()
        return found + [(word, (OBJECT,)) for word in waiting]

    def _types(self, item: Sexpression) -> tuple[str, ...]:
        if isinstance(item, SexpWord):
            return (item.text,)
        if item.head != "either" or not item.rest:
            raise self.error(f"expected a type, found {item}", item, "several types are written (either a b)")
        return tuple(dict.fromkeys(self.word(item.items, n, "a type", item).text for n in range(1, len(item.items))))

    def known_types(self, types: tuple[str, ...], at: Sexpression) -> tuple[str, ...]:
        for name in types:
            if name not in self.domain.types:
                raise self.unknown("type", name, self.domain.types, at)
        return types

    def variables(self, items: Sequence[Sexpression], *, distinct: bool = True) -> tuple[TypedName, ...]:
        """Return declared variables; a name may only occur twice if they need not be ``distinct``."""
        found: list[TypedName] = []
        for word, types in self.typed_list(items):
            if not word.text.startswith("?") or not _NAME.fullmatch(word.text[1:]):
                raise self.error(f"expected a variable, found {word}", word, "variables begin with ?: ?box")
            if word.text == "?duration":
                raise self.error("?duration is the duration of an action and cannot be declared", word)
            if distinct and any(word.text == one.name for one in found):
                raise self.error(f"the variable {word} is declared twice", word)
            found.append(TypedName(word.text, self.known_types(types, word)))
        return tuple(found)

    def signature(self, item: Sexpression, what: str, *, distinct: bool = False) -> Signature:
        group = self.group(item, what)
        name = self.new_name(self.word(group.items, 0, f"the name of {what}", group), what)
        return Signature(name, self.variables(group.rest, distinct=distinct))

    def terms(self, word: SexpWord, group: SexpGroup, scope: Scope, kind: str) -> Terms:
        """Return the arguments of a declared predicate or function, which must match its signature."""
        known = self.domain.predicates if kind == "predicate" else self.domain.functions
        signature = known.get(word.text)
        if signature is None:
            raise self.unknown(kind, word.text, known, word)
        if len(group.rest) != len(signature.parameters):
            raise self.error(
                f"{signature.name} takes {len(signature.parameters)} terms, not {len(group.rest)}: {group}",
                group,
                f"it is declared as {signature}",
            )
        terms = tuple(self.term(item, scope) for item in group.rest)
        for item, term, parameter in zip(group.rest, terms, signature.parameters, strict=True):
            is_variable = term.startswith("?")
            types = scope.variables[term] if is_variable else self.objects[term]
            fits = self.domain.fits if is_variable else self.domain.belongs
            if term not in scope.untyped and not fits(types, parameter.types):
                raise self.error(
                    f"{term} is {_either(types)}, but the {kind} {signature.name} takes {_either(parameter.types)}",
                    item,
                    f"it is declared as {signature}",
                )
        return terms

    def term(self, item: Sexpression, scope: Scope) -> str:
        if isinstance(item, SexpGroup):
            raise self.error(f"expected an object or a variable, found {item}", item)
        if item.text.startswith("?"):
            if item.text not in scope.variables:
                raise self.unknown("variable", item.text, scope.variables, item)
        elif item.text not in self.objects:
            raise self.unknown("object", item.text, self.objects, item)
        return item.text


NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII)


def is_number(item: Sexpression) -> bool:
    return isinstance(item, SexpWord) and NUMBER.fullmatch(item.text) is not None


def _parted(items: Sequence[Sexpression]) -> Iterator[Sexpression]:
    """``-box`` is accepted as ``- box``."""
    for item in items:
        if isinstance(item, SexpWord) and len(item.text) > 1 and item.text.startswith("-"):
            yield SexpWord("-", item.line)
            yield SexpWord(item.text[1:], item.line)
        else:
            yield item


def _either(types: tuple[str, ...]) -> str:
    return f"a {' or '.join(types)}"
