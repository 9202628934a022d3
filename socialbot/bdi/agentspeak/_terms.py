"""Parser of terms and conditions, which share one grammar."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NoReturn, TypeGuard, TypeVar

from socialbot.bdi.agentspeak.lexer import (
    BINARY,
    END,
    KEYWORDS,
    REFUSED,
    REMEDIES,
    UNSUPPORTED,
    AgentSpeakError,
    Level,
    Source,
    is_function,
    qualified,
)
from socialbot.bdi.literals import Event, Literal, literal
from socialbot.bdi.plans import Inference, Plan
from socialbot.bdi.steps import PlanBody
from socialbot.bdi.terms import (
    Atom,
    Call,
    Comparison,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    Holds,
    LiteralVariable,
    Negation,
    Rest,
    Truth,
    Variable,
    conjunction,
)
from socialbot.core.errors import RuleError

MAX_OPERANDS = 100
"""Most operands of one expression or conjunction, whose evaluation is nested."""

MAX_NESTED = 100
"""Most parts in each other: expressions in parentheses, after ``not`` or as exponents, branches, and plans."""

VARIABLE, NAME, NUMBER, STRING, QUOTED = range(1, 6)
KINDS = {
    **dict.fromkeys("ABCDEFGHIJKLMNOPQRSTUVWXYZ_", VARIABLE),
    **dict.fromkeys("abcdefghijklmnopqrstuvwxyz", NAME),
    **dict.fromkeys("0123456789", NUMBER),
    '"': STRING,
    "'": QUOTED,
}
_variable = lru_cache(1024)(Variable)
T = TypeVar("T")


class TermReader:
    """Parser of the tokens of a source; ``at`` is the next token.

    Attributes:
        namespace: Namespace of literals without a prefix, empty for the default one and within terms.
        own_namespace: Namespace of the text, written ``this_ns``.
        local_namespaces: Unique names of the local namespaces.
        functions: Predicates of registered functions, by name and arity; '' for functions in Python.
        grouped: Content of the last parentheses.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.words = source.words
        self.at = 0
        self.namespace = self.own_namespace = ""
        self.local_namespaces: dict[str, str] = {}
        self.functions: dict[tuple[str, int], str] = {}
        self.grouped: object = None
        self._depth = 0

    def fail(self, expected: str, at: int | None = None, remedy: str | None = None) -> NoReturn:
        """Raise a syntax error at a token, by default the current one."""
        at = self.at if at is None else at
        word = self.words[at]
        if word in UNSUPPORTED:
            construct, instead = UNSUPPORTED[word]
            raise self.source.error(at, f"{construct} is not supported", instead)
        remedy = REMEDIES.get(word, remedy)
        if word[0] == "." and len(word) > 1 and "'.'" in expected:
            ended = f"leave a blank between '.' and '{word[1:]}'"
            remedy = f"write ';' between steps; if a plan ends here, {ended}" if "';'" in expected else ended
        shown = "the end of the text" if word == END else f"'{word}'" if len(word) < 40 else f"'{word[:36]}...'"
        raise self.source.error(at, f"expected {expected}, found {shown}", remedy)

    def unsupported(self, construct: str, at: int, remedy: str | None = None) -> AgentSpeakError:
        return self.source.error(at, f"{construct} is not supported", remedy)

    def skip(self, word: str, expected: str) -> None:
        if self.words[self.at] != word:
            self.fail(expected)
        self.at += 1

    # Conditions

    def condition(self) -> Condition:
        start = self.at
        return self.as_condition(self.expression(Level.OR), start)

    def as_condition(self, value: object, start: int) -> Condition:
        if isinstance(value, Atom):
            if value.name in ("true", "false"):
                return Truth(value.name == "true")
            return literal(qualified(self.namespace, value.name, 0))
        if isinstance(value, Condition):
            return value
        if isinstance(value, Call) and "." in value.function:
            return literal(value.function, value.args)
        if isinstance(value, (Variable, LiteralVariable)):
            if self.words[self.at] in REMEDIES:
                self.fail("an operator")
            return Holds(value)
        raise self.source.error(start, "expected a condition, found a term", "compare it, with = or <, for example")

    def expression(self, level: int) -> object:
        """Read operators that bind at least as tightly as ``level``."""
        words = self.words
        start = self.at
        if words[start] == "not" and level <= Level.COMPARE:
            self.at += 1
            value: object = Negation(self.as_condition(self.nested(self.expression, Level.COMPARE), start + 1))
        else:
            value = self.primary()
            operand = level == Level.SUM and words[start - 1] in ("=", "==", "\\==")
            if level >= Level.SUM and words[start] == "(" and is_condition(value) and not operand:
                self.fail(
                    "a term",
                    start,
                    "a condition is a term as an argument, such as a(X > 1), not in a list or an annotation",
                )
        joined = 0
        while True:
            operator = BINARY.get(words[self.at])
            # A missing '.' before the next plan: +!g
            if operator is None or operator[0] < level or words[self.at + 1] in ("!", "?"):
                return value
            joined += operator[0] != Level.OR
            if joined == MAX_OPERANDS:
                remedy = "compute it in several steps, or by rules"
                raise self.source.error(self.at, f"more than {MAX_OPERANDS} operands in one expression", remedy)
            value = self.joined(value, start, *operator)

    def nested(self, read: Callable[..., T], *args: Any) -> T:
        """Read a part within another one."""
        self._depth += 1
        if self._depth > MAX_NESTED:
            remedy = "write the inner ones as plans or rules of their own"
            raise self.source.error(self.at, f"more than {MAX_NESTED} parts in each other", remedy)
        found = read(*args)
        self._depth -= 1
        return found

    def joined(self, left: object, start: int, level: int, symbol: str) -> object:
        """Join the left operand with the right one."""
        at = self.at
        self.at = after = at + 1
        if level >= Level.SUM:
            left = self.operand(left, start, at)
            right = self.nested(self.expression, level) if level == Level.POWER else self.expression(level + 1)
            return Expression(symbol, left, self.operand(right, after, at))
        if level == Level.COMPARE:
            left = self.unqualified(left)
            namespace, self.namespace = self.namespace, ""
            right = self.expression(Level.SUM)
            self.namespace = namespace
            if BINARY.get(self.words[self.at], (0,))[0] == Level.COMPARE:
                self.fail("one comparison", remedy="join two comparisons with '&'")
            return Comparison(symbol, self.compared(left, start), self.compared(right, after))
        condition = self.as_condition(left, start)
        if left is self.grouped and isinstance(condition, Conjunction if level == Level.AND else Disjunction):
            condition = Conjunction((condition,))  # (a & b) & c is printed as written
        other = self.as_condition(self.expression(Level.NOT if level == Level.AND else Level.AND), after)
        if level == Level.AND:
            return conjunction(condition, other)
        before = condition.terms if isinstance(condition, Disjunction) else (conjunction(condition),)
        return Disjunction((*before, conjunction(other)))

    def unqualified(self, value: object) -> object:
        """Remove the namespace of the text from an operand, which is a term."""
        prefix = f"{self.namespace}::"
        if self.namespace and isinstance(value, Literal) and value.functor.startswith(prefix):
            value = value.with_()
            value.functor = value.functor.removeprefix(prefix)
        return value

    def operand(self, value: object, start: int, at: int) -> object:
        """Check an operand of the arithmetic operator at ``at``; structures become function calls."""
        value = self.unqualified(value)
        if isinstance(value, (int, float, Variable, Expression, Call)):
            return value
        if is_plain_structure(value):
            return Call(value.functor, *value.args)
        if isinstance(value, Atom) and "." in value.name and self.words[start][0] != "'":
            return Call(value.name)
        missing = start < at and self.words[at] in ("+", "-")
        self.fail(
            f"a number, a variable or a function as operand of '{self.words[at]}'",
            start,
            f"when a plan or belief ends before the '{self.words[at]}', write '.' there" if missing else None,
        )

    def compared(self, value: object, start: int) -> object:
        """Convert a term to one side of a comparison; a condition in parentheses is a term."""
        if is_condition(value) and self.words[start] != "(":
            self.fail("a term to compare", start)
        is_quoted = self.words[start][0] == "'"
        if is_plain_structure(value) and "." in value.functor and not is_quoted:
            return Call(value.functor, *value.args)
        if isinstance(value, Literal) and value.args and "." in value.functor and is_quoted:
            value.functor = value.functor.strip("'")  # the quotes tell it from a call, and are no part of the name
        return value

    # Terms

    def primary(self) -> object:
        word = self.words[self.at]
        kind = KINDS.get(word[0])
        if kind == VARIABLE:
            return self.variable_term()
        if kind == NAME:
            return self.structure()
        if kind == NUMBER:
            return self.number()
        if kind == STRING and len(word) > 1:
            self.at += 1
            return self.source.unquoted(self.at - 1)
        return self.rare(word)

    def rare(self, word: str) -> object:
        """Read an uncommon kind of term."""
        first = word[0]
        if first in "+-" and len(word) == 1:
            return self.signed()
        if first == "(":
            self.at += 1
            value = self.nested(self.expression, Level.OR)
            self.skip(")", "an operator or ')'")
            self.grouped = value
            return value
        if first == "[":
            return self.list()
        if first == "~" or word == "::" or (first == "'" and len(word) > 1):
            return self.structure()
        if first == "." and len(word) > 1:
            return self.number() if KINDS.get(word[1]) == NUMBER else self.structure()
        if first == "{":
            return self.braces()
        if first.isalpha():  # non-ASCII letters have no token kind
            return self.variable_term() if self.is_variable() else self.structure()
        self.fail("a term")

    def is_variable(self, ahead: int = 0) -> bool:
        first = self.words[self.at + ahead][0]
        return first == "_" or first.isupper()

    def variable_term(self) -> Variable | LiteralVariable:
        """Read a variable with optional annotations, or a literal with a variable as its namespace."""
        if self.words[self.at + 1] == "::":
            return self.in_namespace()
        variable = self.variable()
        if self.words[self.at] != "[":
            return variable
        return LiteralVariable(variable, self.annotations())

    def in_namespace(self) -> LiteralVariable:
        namespace = _variable(self.words[self.at])
        self.at += 2
        found = self.literal_or_variable("a literal after '::'")
        if isinstance(found, LiteralVariable):
            return LiteralVariable(found.variable, found.annotations, found.negated, namespace)
        if isinstance(found, Literal):
            found = self.unqualified(found)
        return LiteralVariable(found, namespace=namespace)

    def variable(self) -> Variable:
        at = self.at
        self.at = at + 1
        if self.words[at + 1] == "(":
            raise self.unsupported("a variable with arguments", at, "names begin with a small letter")
        try:
            return _variable(self.words[at])
        except RuleError:
            self.fail("a variable, of letters, digits and _", at)

    def number(self) -> float:
        word = self.words[self.at]
        try:
            value = int(word) if word.isdecimal() else float(word)
        except ValueError:  # Python limits the number of digits
            value = math.inf
        if value == math.inf:
            raise self.source.error(self.at, "this number is too large")
        self.at += 1
        return value

    def signed(self) -> object:
        """Read a term after a sign, which binds tighter than any operator, as in Jason."""
        at = self.at
        self.at += 1
        value = self.operand(self.primary(), at + 1, at)
        if self.words[at] == "+":
            return value
        return -value if isinstance(value, (int, float)) else Expression("-", 0, value)

    def list(self) -> object:
        items = self.in_brackets()
        if self.words[self.at - 1] == "]":
            return items
        start = self.at
        tail = self.primary()
        if not isinstance(tail, (Variable, tuple, Cons)):
            self.fail("a variable or a list after '|'", start)
        self.skip("]", "']' after the tail of a list")
        if isinstance(tail, tuple):
            return (*items, *tail)
        return Cons((*items, *tail.items), tail.tail) if isinstance(tail, Cons) else Cons(items, tail)

    def items(self, level: int = Level.SUM) -> tuple[object, ...]:
        items = [self.expression(level)]
        while self.words[self.at] == ",":
            self.at += 1
            items.append(self.expression(level))
        return tuple(items)

    def structure(self) -> object:
        """Read a name with optional arguments and annotations; an atom if it has neither."""
        words = self.words
        start = self.at
        namespace = self.namespace
        if words[start] == "::" or words[start + 1] == "::":
            namespace = self.prefix()
        at = self.at
        negated = words[at] == "~"
        if (negated or at != start) and self.is_variable(negated):
            self.at += negated
            variable = self.variable()
            notes = self.annotations() if words[self.at] == "[" else ()
            return LiteralVariable(variable, notes, negated, Atom(namespace or "default") if at != start else None)
        name = self.name(at + negated)
        self.at = at + negated + 1
        args = self.arguments(name) if words[self.at] == "(" else ()
        if words[self.at] == "[":
            return literal(qualified(namespace, name, len(args)), args, self.annotations(), negated=negated)
        if negated:
            return literal(qualified(namespace, name, len(args)), args, negated=True)
        if "." in name and words[at][0] != "'" and self.is_call(name, len(args)):
            call = Call(name, *args)
            if (name, len(args)) in self.functions:
                call.predicate = self.functions[name, len(args)]
            return call
        # The namespace of an atom is added where it is a condition or a step.
        if at == start and not args:
            return Atom((self.own_namespace or "default") if name == "this_ns" else name)
        name = qualified(namespace, name, len(args))
        return literal(name, args) if args or self.namespace else Atom(name)

    def prefix(self) -> str:
        """Read a namespace up to ``::``; an empty one is that of the text."""
        name = self.own_namespace
        if self.words[self.at] != "::":
            word = self.name(self.at)
            self.at += 1
            name = "" if word == "default" else self.own_namespace if word == "this_ns" else word
        self.at += 1
        return self.local_namespaces.get(name, name)

    def is_call(self, name: str, arity: int) -> bool:
        return is_function(name, arity) or (name, arity) in self.functions

    def name(self, at: int) -> str:
        word = self.words[at]
        first = word[0]
        if first == "'" and len(word) > 1:
            word = self.source.name(at)
        elif word in KEYWORDS or not (first.isalpha() or (first == "." and len(word) > 1)) or first.isupper():
            self.fail("a name" if at == self.at else "a name after '~'", at)
        if word in REFUSED:
            raise self.source.error(at, *REFUSED[word])
        return word

    def arguments(self, name: str) -> tuple[object, ...]:
        """Read arguments in parentheses, terms or conditions."""
        self.at += 1
        if self.words[self.at] == ")":
            self.fail(f"an argument of '{name}'", remedy=f"write '{name}' without parentheses")
        namespace, self.namespace = self.namespace, ""
        args = self.items(Level.OR)
        self.namespace = namespace
        self.skip(")", "',' or ')'")
        return args

    def annotations(self) -> tuple[object, ...]:
        notes = self.in_brackets("',', '|' or ']' after an annotation", "]|")
        if self.words[self.at - 1] != "|":
            return notes
        tail = self.list() if self.words[self.at] == "[" else self.variable()
        self.skip("]", "']' after the tail of the annotations")
        if isinstance(tail, Cons):
            return (*notes, *tail.items, Rest(tail.tail))
        return (*notes, *tail) if isinstance(tail, tuple) else (*notes, Rest(tail))

    def in_brackets(self, expected: str = "',', '|' or ']' in a list", empty: str = "]") -> tuple[object, ...]:
        """Read terms up to and including ``]`` or ``|``; there are none before a sign of ``empty``."""
        self.at += 1
        namespace, self.namespace = self.namespace, ""
        items = () if self.words[self.at] in tuple(empty) else self.items()
        self.namespace = namespace
        if self.words[self.at] != "|":
            self.skip("]", expected)
        else:
            self.at += 1
        return items

    def literal(self, what: str = "a literal") -> Literal:
        """Read a literal where no other term is allowed."""
        start = self.at
        value = self.literal_or_variable(what)
        if not isinstance(value, Literal):
            self.fail(what, start)
        return value

    def literal_or_variable(self, what: str) -> Literal | Variable | LiteralVariable:
        """Read a literal, or a variable for one."""
        start = self.at
        if self.is_variable():
            return self.variable_term()
        first = self.words[start][0]
        if KINDS.get(first) not in (NAME, QUOTED) and first not in "~:" and (first.isupper() or not first.isalpha()):
            self.fail(what)
        value = self.structure()
        if isinstance(value, Atom) and value.name not in ("true", "false") and value.name[:1] != ".":
            return literal(qualified(self.namespace, value.name, 0))
        if isinstance(value, LiteralVariable) or (isinstance(value, Literal) and value.functor[:1] != "."):
            return value
        self.fail(what, start)

    def braces(self) -> Plan | Event | PlanBody | Inference:
        """Read a plan, an event, steps or a rule as a term."""
        raise NotImplementedError


def is_plain_structure(value: object) -> TypeGuard[Literal]:
    """Check whether a value has the form of a function call."""
    return isinstance(value, Literal) and bool(value.args) and not value.annotations and not value.negated


def is_condition(value: object) -> bool:
    """Check whether a parsed value can only be a condition."""
    return isinstance(value, (Comparison, Conjunction, Disjunction, Negation))
