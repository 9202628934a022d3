"""The reader of formulas, numeric expressions and effects."""

from __future__ import annotations

import math
import re
from typing import cast

from socialbot.planning.formulas import (
    Add,
    And,
    Arithmetic,
    Change,
    Comparator,
    Comparison,
    Delete,
    Duration,
    Effect,
    Expression,
    Fluent,
    ForEach,
    Formula,
    Not,
    Number,
    Or,
    Predicate,
    Quantified,
    Same,
    When,
)
from socialbot.planning.sexpressions import Group, Sexpression, Word
from socialbot.planning.vocabulary import Scope, Vocabulary

COMPARATORS = frozenset({"<", "<=", "=", ">=", ">"})
ARITHMETIC = frozenset("+-*/")
CHANGES = frozenset({"assign", "increase", "decrease", "scale-up", "scale-down"})
PREFERENCES = frozenset({
    "preference", "always", "sometime", "within", "at-most-once", "sometime-after", "sometime-before",
    "always-within", "hold-during", "hold-after",
})  # fmt: skip
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII)


def is_number(item: Sexpression) -> bool:
    """Whether it is written like a number."""
    return isinstance(item, Word) and _NUMBER.fullmatch(item.text) is not None


class FormulaReader:
    """Makes formulas and effects of S-expressions, and checks each name. Raises PlanningError with the line."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.names = vocabulary

    # Formulas

    def formula(self, item: Sexpression, scope: Scope) -> Formula:
        """A formula; an empty group always holds."""
        group = self.names.group(item, "a condition")
        if not group.items:
            return And()
        match group.head:
            case "and":
                return And(tuple(self.formula(part, scope) for part in group.rest))
            case "or":
                return Or(tuple(self.formula(part, scope) for part in group.rest))
            case "not":
                return Not(self.formula(self._only(group), scope))
            case "imply":
                left, right = self.pair(group)
                return Or((Not(self.formula(left, scope)), self.formula(right, scope)))
            case "forall" | "exists" as quantifier:
                listed, part = self.pair(group)
                variables = self.names.variables(self.names.group(listed, "variables").items)
                return Quantified(quantifier, variables, self.formula(part, scope.within(variables)))
            case head if head in COMPARATORS:
                return self._comparison(group, scope)
            case _:
                return self.predicate(group, scope)

    def predicate(self, item: Sexpression, scope: Scope) -> Predicate:
        """A predicate that is declared, with terms that fit it."""
        group = self.names.group(item, "a predicate")
        word = self.names.word(group.items, 0, "the name of a predicate", group)
        signature = self.names.domain.predicates.get(word.text)
        if signature is None:
            if word.text in PREFERENCES:
                raise self.names.unsupported(f"preferences and constraints ({word.text})", word)
            raise self.names.unknown("predicate", word.text, self.names.domain.predicates, word)
        return Predicate(word.text, self.names.terms(signature, group, scope, "predicate"))

    def _comparison(self, group: Group, scope: Scope) -> Formula:
        left, right = self.pair(group)
        if group.head == "=" and self._is_term(left) and self._is_term(right):
            return Same(self.names.term(left, scope), self.names.term(right, scope))
        return Comparison(cast("Comparator", group.head), self.expression(left, scope), self.expression(right, scope))

    def _is_term(self, item: Sexpression) -> bool:
        return (
            isinstance(item, Word)
            and item.text != "?duration"
            and not is_number(item)
            and (item.text in self.names.objects or item.text not in self.names.domain.functions)
        )

    # Numbers

    def expression(self, item: Sexpression, scope: Scope) -> Expression:
        """A numeric expression."""
        if isinstance(item, Word):
            return self._number(item, scope)
        word = self.names.word(item.items, 0, "a number or function", item)
        if word.text in ARITHMETIC:
            parts = tuple(self.expression(part, scope) for part in item.rest)
            if len(parts) < 2 and not (word.text == "-" and parts):
                raise self.names.error(f"{word} takes two numbers: {item}", item)
            if word.text in "-/" and len(parts) > 2:
                raise self.names.error(f"{word} takes two numbers, not {len(parts)}: {item}", item)
            return Arithmetic(word.text, parts)  # pyright: ignore[reportArgumentType]
        return self.fluent(item, scope)

    def _number(self, word: Word, scope: Scope) -> Expression:
        if is_number(word):
            value = float(word.text)
            if not math.isfinite(value):
                raise self.names.error(f"{word} is too large a number", word)
            return Number(value)
        if word.text == "?duration":
            if not scope.duration:
                raise self.names.error("?duration has no meaning here", word, "use it in effects of durative actions")
            return Duration()
        if word.text == "#t":
            raise self.names.unsupported("continuous effects (#t)", word)
        return self.fluent(Group((word,), word.line), scope)

    def fluent(self, item: Sexpression, scope: Scope) -> Fluent:
        """A function that is declared, with terms that fit it; its name alone if it takes none."""
        group = Group((item,), item.line) if isinstance(item, Word) else item
        word = self.names.word(group.items, 0, "the name of a function", group)
        signature = self.names.domain.functions.get(word.text)
        if signature is None:
            raise self.names.unknown("function", word.text, self.names.domain.functions, word)
        return Fluent(word.text, self.names.terms(signature, group, scope, "function"))

    # Effects

    def effects(self, item: Sexpression, scope: Scope) -> tuple[Effect, ...]:
        """Effects; ``and`` and empty groups leave no trace."""
        group = self.names.group(item, "an effect")
        if not group.items:
            return ()
        match group.head:
            case "and":
                return tuple(effect for part in group.rest for effect in self.effects(part, scope))
            case "not":
                return (Delete(self._changed(self._only(group), scope)),)
            case "forall":
                listed, part = self.pair(group)
                variables = self.names.variables(self.names.group(listed, "variables").items)
                return (ForEach(variables, self.effects(part, scope.within(variables))),)
            case "when":
                condition, part = self.pair(group)
                return (When(self.formula(condition, scope), self.effects(part, scope)),)
            case head if head in CHANGES:
                fluent, amount = self.pair(group)
                changed = self.fluent(fluent, scope)
                return (Change(head, changed, self.expression(amount, scope)),)  # pyright: ignore[reportArgumentType]
            case _:
                return (Add(self._changed(group, scope)),)

    def _changed(self, item: Sexpression, scope: Scope) -> Predicate:
        predicate = self.predicate(item, scope)
        if predicate.name in self.names.domain.derived:
            raise self.names.error(f"{predicate.name} is derived: no action can change it", item)
        return predicate

    # Forms

    def pair(self, group: Group) -> tuple[Sexpression, Sexpression]:
        """The two parts after the head."""
        if len(group.rest) != 2:
            raise self.names.error(f"{group.head} takes two parts, not {len(group.rest)}: {group}", group)
        return group.rest[0], group.rest[1]

    def _only(self, group: Group) -> Sexpression:
        if len(group.rest) != 1:
            raise self.names.error(f"{group.head} takes one part, not {len(group.rest)}: {group}", group)
        return group.rest[0]
