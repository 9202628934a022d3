"""The vocabulary of a domain or problem while it is read: which names there are, and what fits where."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from socialbot.errors import PlanningError
from socialbot.planning.domain import OBJECT, Domain, Signature
from socialbot.planning.formulas import Terms, Typed
from socialbot.planning.sexpressions import Group, Sexpression, Word

RESERVED = frozenset({
    "and", "or", "not", "imply", "forall", "exists", "when", "either", "object", "number", "assign", "increase",
    "decrease", "scale-up", "scale-down",
})  # fmt: skip
_NAME = re.compile(r"[^\W\d][\w-]*")


@dataclass(frozen=True, slots=True)
class Scope:
    """The variables that a formula may use, with their types, and whether it may use ``?duration``."""

    variables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    duration: bool = False

    def within(self, variables: Iterable[Typed]) -> Scope:
        """The scope inside a quantifier or an action."""
        return Scope({**self.variables, **{typed.name: typed.types for typed in variables}}, self.duration)


@dataclass
class Vocabulary:
    """The names that are known so far. ``objects`` are all that can be named: constants, in problems objects too."""

    where: str
    domain: Domain
    objects: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def error(self, what: str, at: Sexpression, remedy: str | None = None) -> PlanningError:
        """An error with the file and the line of ``at``."""
        return PlanningError(what, where=f"{self.where}:{at.line}", remedy=remedy)

    def unsupported(self, what: str, at: Sexpression) -> PlanningError:
        """An error for what PDDL knows and socialbot does not."""
        return self.error(f"not supported by socialbot: {what}", at)

    def unknown(self, kind: str, name: str, known: Iterable[str], at: Sexpression) -> PlanningError:
        """An error for a name that is not declared, with the nearest one that is."""
        near = difflib.get_close_matches(name, list(known), n=1)
        return self.error(
            f"unknown {kind} {name!r}", at, f"did you mean {near[0]!r}?" if near else f"declare the {kind}"
        )

    def group(self, item: Sexpression, what: str) -> Group:
        """``item`` if it is a group."""
        if isinstance(item, Word):
            raise self.error(f"expected {what} in parentheses, found {item}", item)
        return item

    def word(self, items: Sequence[Sexpression], index: int, what: str, of: Sexpression) -> Word:
        """The word at ``index``."""
        if index >= len(items):
            raise self.error(f"{what} is missing", of)
        item = items[index]
        if isinstance(item, Group):
            raise self.error(f"expected {what}, found {item}", item)
        return item

    def new_name(self, word: Word, what: str) -> str:
        """The name that ``word`` gives to something."""
        if word.text in RESERVED or not _NAME.fullmatch(word.text):
            raise self.error(
                f"{word.text!r} cannot be the name of {what}",
                word,
                "names begin with a letter and consist of letters, digits, - and _"
                if word.text not in RESERVED
                else "the word means something in PDDL; choose another",
            )
        return word.text

    # Lists with types

    def typed_list(self, items: Sequence[Sexpression]) -> list[tuple[Word, tuple[str, ...]]]:
        """Words with their types, as in ``a b - box c``; the types are not looked up."""
        found: list[tuple[Word, tuple[str, ...]]] = []
        waiting: list[Word] = []
        rest = _parted(items)
        for item in rest:
            if isinstance(item, Group):
                raise self.error(f"expected a name, found {item}", item)
            if item.text != "-":
                waiting.append(item)
                continue
            kind = next(rest, None)
            if kind is None or not waiting:
                raise self.error("a name belongs before -, and a type after it", item)
            types = self._types(kind)
            found += ((word, types) for word in waiting)
            waiting.clear()
        return found + [(word, (OBJECT,)) for word in waiting]

    def _types(self, item: Sexpression) -> tuple[str, ...]:
        if isinstance(item, Word):
            return (item.text,)
        if item.head != "either" or not item.rest:
            raise self.error(f"expected a type, found {item}", item, "several types are written (either a b)")
        return tuple(dict.fromkeys(self.word(item.items, n, "a type", item).text for n in range(1, len(item.items))))

    def known_types(self, types: tuple[str, ...], at: Sexpression) -> tuple[str, ...]:
        """``types`` if all are declared."""
        for name in types:
            if name not in self.domain.types:
                raise self.unknown("type", name, self.domain.types, at)
        return types

    def variables(self, items: Sequence[Sexpression]) -> tuple[Typed, ...]:
        """The variables that a list declares."""
        found: dict[str, Typed] = {}
        for word, types in self.typed_list(items):
            if not word.text.startswith("?") or not _NAME.fullmatch(word.text[1:]):
                raise self.error(f"expected a variable, found {word}", word, "variables begin with ?: ?box")
            if word.text == "?duration":
                raise self.error("?duration is the duration of an action and cannot be declared", word)
            if word.text in found:
                raise self.error(f"the variable {word} is declared twice", word)
            found[word.text] = Typed(word.text, self.known_types(types, word))
        return tuple(found.values())

    def signature(self, item: Sexpression, what: str) -> Signature:
        """The signature of a predicate or function."""
        group = self.group(item, what)
        name = self.new_name(self.word(group.items, 0, f"the name of {what}", group), what)
        return Signature(name, self.variables(group.rest))

    # Uses of what was declared

    def terms(self, signature: Signature, group: Group, scope: Scope, kind: str) -> Terms:
        """The terms that a predicate or function is given, if they fit it."""
        if len(group.rest) != len(signature.parameters):
            raise self.error(
                f"{signature.name} takes {len(signature.parameters)} terms, not {len(group.rest)}: {group}",
                group,
                f"it is declared as {signature}",
            )
        terms = tuple(self.term(item, scope) for item in group.rest)
        for item, term, parameter in zip(group.rest, terms, signature.parameters, strict=True):
            types = scope.variables[term] if term.startswith("?") else self.objects[term]
            if not self.domain.fits(types, parameter.types):
                raise self.error(
                    f"{term} is {_either(types)}, but the {kind} {signature.name} takes {_either(parameter.types)}",
                    item,
                    f"it is declared as {signature}",
                )
        return terms

    def term(self, item: Sexpression, scope: Scope) -> str:
        """The name of an object or variable that is declared."""
        if isinstance(item, Group):
            raise self.error(f"expected an object or a variable, found {item}", item)
        if item.text.startswith("?"):
            if item.text not in scope.variables:
                raise self.unknown("variable", item.text, scope.variables, item)
        elif item.text not in self.objects:
            raise self.unknown("object", item.text, self.objects, item)
        return item.text


def _parted(items: Sequence[Sexpression]) -> Iterator[Sexpression]:
    """The items of a list with types; ``-box`` is ``- box``, as many write it."""
    for item in items:
        if isinstance(item, Word) and len(item.text) > 1 and item.text.startswith("-"):
            yield Word("-", item.line)
            yield Word(item.text[1:], item.line)
        else:
            yield item


def _either(types: tuple[str, ...]) -> str:
    return f"a {' or '.join(types)}"
