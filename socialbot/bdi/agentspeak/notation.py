"""Print plans as Python source that can be pasted into a program.

Names become classes: goals subclasses of Goal, actions of Action, all others of Belief. A name that cannot be a
class, or would need two (a goal and a belief, for example), is printed as ``literal("at", (X,))``. Variables are bare
names.

>>> from socialbot.bdi.agentspeak.parser import parse_plan
>>> rules(parse_plan("+seen(P) : known(P, yes) & not asleep & P > 3 <- !greet(P)[within(5)]; .print(P)"))
'+seen(P) / (known(P, Atom("yes")) & ~asleep() & (P > 3)) >> [greet(P).within(5), Do(literal(".print", (P,)))]'
"""

from __future__ import annotations

import keyword
import math

from socialbot.bdi.literals import Change, Event, Literal, Structure
from socialbot.bdi.plans import Inference, Plan
from socialbot.bdi.steps import Achieve, Ask, Await, Constrain, Do, Enter, For, Forget, Fork, If, Step, Update, While
from socialbot.bdi.terms import (
    Atom,
    Call,
    Comparison,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    FunctionCondition,
    Negation,
    Term,
    Truth,
    Variable,
)

GOAL, ACTION, BELIEF = "goal", "action", "belief"

RESERVED = frozenset({
    "Achieve", "Ask", "Atom", "Await", "Call", "Change", "Comparison", "Conjunction", "Cons", "Constrain",
    "Disjunction", "Do", "Event", "Expression", "FunctionCondition", "Inference", "NOTHING", "Negation", "Plan",
    "Truth", "Update", "Variable", "apart", "as_long_as", "ask", "atomic", "conjunction", "enter", "fail", "first_of",
    "float", "for_each", "labelled", "literal", "priority", "replace", "stage", "test", "together", "wait", "wait_for",
    "when",
})  # fmt: skip
"""Names of Python and `socialbot.bdi` that the printed source uses."""


def rules(item: Plan | Inference) -> str:
    """Print a plan, a list of one or an inference as Python source."""
    return _Notation(item).whole(item)


class _Uses:
    """Names in an item with their kinds: goal, action, belief, or several of these."""

    def __init__(self) -> None:
        self.roles: dict[str, set[str]] = {}
        self.variables: set[str] = set()

    def role(self, item: object, role: str) -> None:
        if isinstance(item, Literal):
            self.roles.setdefault(item.functor, set()).add(role)
            self.terms((*item.args, *item.annotations))
        else:
            self.term(item)

    def terms(self, terms: tuple[object, ...]) -> None:
        for term in terms:
            self.term(term)

    def term(self, term: object) -> None:
        if isinstance(term, Variable):
            self.variables.add(term.name)
        elif isinstance(term, tuple):
            self.terms(term)
        elif isinstance(term, Literal):
            self.roles.setdefault(term.functor, set())
            self.terms((*term.args, *term.annotations))
        elif isinstance(term, Expression):
            self.terms((term.left, term.right))
        elif isinstance(term, Call):
            self.terms(term.args)
        elif isinstance(term, Cons):
            self.terms((*term.items, term.tail))
        elif isinstance(term, Plan):
            self.plan(term)
        elif isinstance(term, Event):
            self.event(term)
        elif isinstance(term, Condition):
            self.condition(term)

    def condition(self, condition: Condition) -> None:
        if isinstance(condition, (Conjunction, Disjunction)):
            for term in condition.terms:
                self.condition(term)
        elif isinstance(condition, Negation):
            self.condition(condition.condition)
        elif isinstance(condition, Comparison):
            self.terms((condition.left, condition.right))
        elif isinstance(condition, Literal):
            self.role(condition, BELIEF)

    def event(self, event: Event) -> None:
        wanted = event.change in (Change.WANTED, Change.FAILED, Change.ASKED, Change.UNANSWERED)
        self.role(event.literal, GOAL if wanted else BELIEF)

    def plan(self, plan: Plan) -> None:
        self.event(plan.event)
        self.condition(plan.condition)
        self.body(plan.body)
        self.terms(plan.annotations)

    def body(self, body: tuple[Step, ...]) -> None:
        for step in body:
            self.step(step)

    def step(self, step: Step) -> None:
        if isinstance(step, Do):
            self.role(step.action, ACTION)
            self.term(step.limit_s)
        elif isinstance(step, Achieve):
            self.role(step.goal, GOAL)
            self.term(step.limit_s)
        elif isinstance(step, (Update, Forget)):
            self.role(step.literal, BELIEF)
        elif isinstance(step, Ask) and not isinstance(step.query, Variable):
            self.condition(step.query)
        elif isinstance(step, Ask):
            self.term(step.query)
        elif isinstance(step, Await):
            self.terms((step.what, step.limit_s))
        elif isinstance(step, Fork):
            for branch in step.branches:
                self.body(branch)
        elif isinstance(step, If):
            self.condition(step.condition)
            self.body(step.then + step.otherwise)
        elif isinstance(step, (While, For)):
            self.condition(step.condition)
            self.body(step.body)
        elif isinstance(step, Constrain):
            self.condition(step.condition)


class _Notation:
    def __init__(self, item: Plan | Inference) -> None:
        uses = _Uses()
        if isinstance(item, Plan):
            uses.plan(item)
        else:
            uses.role(item.head, BELIEF)
            uses.condition(item.condition)
        self.variables = uses.variables
        self.classes = {
            name
            for name, roles in uses.roles.items()
            if len(roles) < 2 and _is_name(name) and name not in self.variables
        }

    def classed(self, item: Literal) -> bool:
        return not isinstance(item, Structure) or (item.functor in self.classes and not item.negated)

    # Plans

    def whole(self, item: Plan | Inference) -> str:
        if isinstance(item, Inference):
            return f"{self.literal(item.head)} << {self.joined(item.condition, wrap=True)}"
        text = self.core(item)
        if item.annotations:
            text = f"replace({text}, annotations={self.term(item.annotations)})"
        if item.label is not None:
            text = f"labelled({_quoted(item.label)}, {text})"
        if item.stage is not None:
            text = f"stage({_quoted(item.stage)}, {text})"
        if item.priority:
            text = f"priority({item.priority}, {text})"
        return f"atomic({text})" if item.atomic else text

    def plan(self, plan: Plan) -> str:
        """Print a plan as an argument, where a list is not allowed."""
        given = {
            "label": None if plan.label is None else _quoted(plan.label),
            "stage": None if plan.stage is None else _quoted(plan.stage),
            "priority": str(plan.priority) if plan.priority else None,
            "atomic": "True" if plan.atomic else None,
            "annotations": self.term(plan.annotations) if plan.annotations else None,
        }
        options = "".join(f", {name}={value}" for name, value in given.items() if value is not None)
        return f"replace({self.core(plan)}{options})" if options else f"({self.core(plan)})"

    def core(self, plan: Plan) -> str:
        condition = f" / {self.joined(plan.condition, wrap=True)}" if plan.condition.terms else ""
        return f"{self.event(plan.event, head=True)}{condition} >> {self.body(plan.body)}"

    def event(self, event: Event, head: bool = False) -> str:
        if event.change is Change.CHANGED and head and self.classed(event.literal):
            half = len(event.literal.args) // 2
            now, before = event.literal.with_(args=event.literal.args[:half]), event.literal.args[half:]
            return f"{self.literal(now)}.changed({', '.join(map(self.term, before))})"
        item = self.literal(event.literal)
        classed = self.classed(event.literal)
        if event.change in (Change.ADDED, Change.REMOVED):
            return f"{event.change.value}{item}"
        if event.change is Change.HELD:
            seconds = event.seconds if isinstance(event.seconds, (int, float)) else "..."
            return f"+{item}.held_for({seconds})"
        if classed and event.change is Change.FAILED:
            return f"-{item}"
        if classed and event.change is Change.WANTED and head:
            return item
        return f"Event(Change.{event.change.name}, {item})"

    # Bodies

    def body(self, body: tuple[Step, ...]) -> str:
        return f"[{', '.join(map(self.step, body))}]"

    def step(self, step: Step) -> str:
        if isinstance(step, Do):
            return (
                self.limited(step.action, step.limit_s) or f"Do({self.literal(step.action)}{self.limit(step.limit_s)})"
            )
        if isinstance(step, Achieve):
            return self.achieve(step)
        if isinstance(step, Ask):
            return f"ask({self.term(step.query)})"
        if isinstance(step, Update):
            return self.update(step)
        if isinstance(step, Forget):
            return f"-{self.literal(step.literal)}"
        if isinstance(step, Constrain):
            if isinstance(step.condition, Conjunction):
                return f"test({self.joined(step.condition)})"
            return f"Constrain({self.condition(step.condition)})"
        if isinstance(step, Enter):
            return f"enter({_quoted(step.stage)})"
        if isinstance(step, Await):
            return f"wait_for({self.awaited(step.what)}{self.limit(step.limit_s)})"
        return self.nested(step)

    def nested(self, step: Step) -> str:
        if isinstance(step, Fork):
            return f"{'together' if step.every else 'first_of'}({', '.join(map(self.body, step.branches))})"
        if isinstance(step, If):
            otherwise = f", {self.body(step.otherwise)}" if step.otherwise else ""
            return f"when({self.awaited(step.condition)}, {self.body(step.then)}{otherwise})"
        assert isinstance(step, (While, For)), step
        name = "as_long_as" if isinstance(step, While) else "for_each"
        return f"{name}({self.awaited(step.condition)}, {self.body(step.body)})"

    def awaited(self, what: Event | Condition) -> str:
        """Print an event or condition as the operand of a conjunction."""
        if isinstance(what, Event):
            return self.event(what)
        return self.joined(what) if isinstance(what, Conjunction) else self.condition(what)

    def achieve(self, step: Achieve) -> str:
        goal = self.limited(step.goal, step.limit_s)
        if goal is not None:
            return f"apart({goal})" if step.apart else goal
        apart = ", apart=True" if step.apart else ""
        return f"Achieve({self.term(step.goal)}{apart}{self.limit(step.limit_s, 'limit_s=')})"

    def limited(self, what: Literal | Variable, limit_s: object) -> str | None:
        """Print a goal or action with its time limit; None if it has no class."""
        if isinstance(what, Variable) or not self.classed(what):
            return None
        return self.literal(what) + ("" if limit_s is None else f".within({self.term(limit_s)})")

    def limit(self, limit_s: object, name: str = "") -> str:
        return "" if limit_s is None else f", {name}{self.term(limit_s)}"

    def update(self, step: Update) -> str:
        if step.sign != "++" or isinstance(step.literal, Variable):
            return f"Update({_quoted(step.sign)}, {self.term(step.literal)})"
        return f"+{self.literal(step.literal)}"

    # Conditions

    def joined(self, condition: Conjunction, wrap: bool = False) -> str:
        """Print a conjunction as an operand of one."""
        if not condition.terms:
            return "NOTHING"
        first, *more = condition.terms
        return self.condition(condition, wrap) if more else _wrapped(self.condition(first), wrap)

    def condition(self, condition: object, wrap: bool = False) -> str:
        """Print a condition; ``wrap`` adds parentheses around operators."""
        if isinstance(condition, Conjunction):
            return self.conjunction(condition, wrap)
        if isinstance(condition, Disjunction):
            return self.disjunction(condition, wrap)
        if isinstance(condition, Negation):
            if isinstance(condition.condition, (Comparison, FunctionCondition)):
                return f"Negation({self.condition(condition.condition)})"
            return f"~{self.condition(condition.condition, wrap=True)}"
        if isinstance(condition, Comparison):
            return self.comparison(condition, wrap)
        if isinstance(condition, FunctionCondition):
            name = getattr(condition.function, "__name__", "")
            return name if name.isidentifier() else f"Guard(lambda {', '.join(condition.parameters)}: ...)"
        return f"Truth({condition.value})" if isinstance(condition, Truth) else self.term(condition)

    def conjunction(self, condition: Conjunction, wrap: bool) -> str:
        terms = condition.terms
        # Python functions and comparisons do not implement &, so one of the first two operands must.
        if len(terms) < 2 or all(isinstance(term, (Comparison, FunctionCondition)) for term in terms[:2]):
            return f"conjunction({', '.join(map(self.condition, terms))})"
        return _wrapped(" & ".join(self.condition(term, wrap=True) for term in terms), wrap)

    def disjunction(self, condition: Disjunction, wrap: bool) -> str:
        parts = [list(term.terms) if isinstance(term, Conjunction) else [] for term in condition.terms]
        simple = len(parts) > 1 and all(parts) and not isinstance(parts[0][0], Disjunction)
        if not simple or all(
            len(part) == 1 and isinstance(part[0], (Comparison, FunctionCondition)) for part in parts[:2]
        ):
            return f"Disjunction({self.tuple(condition.terms)})"
        alone = (part[0] if len(part) == 1 else Conjunction(tuple(part)) for part in parts)
        return _wrapped(" | ".join(self.condition(part, wrap=True) for part in alone), wrap)

    def comparison(self, condition: Comparison, wrap: bool) -> str:
        symbol, left, right = condition.symbol, condition.left, condition.right
        # Python would reverse 3 < X.
        if symbol in ("=", "=..") or not isinstance(left, Term):
            return f"Comparison({_quoted(symbol)}, {self.term(left)}, {self.term(right)})"
        return _wrapped(f"{self.term(left, wrap=True)} {symbol} {self.term(right, wrap=True)}", wrap)

    # Terms

    def term(self, term: object, wrap: bool = False) -> str:
        if isinstance(term, Literal):
            return self.literal(term)
        if isinstance(term, Variable):
            proper = not keyword.iskeyword(term.name) and term.name not in RESERVED
            return term.name if proper else f"Variable({_quoted(term.name)})"
        if isinstance(term, str):
            return _quoted(term)
        if isinstance(term, Atom):
            return f"Atom({_quoted(term.name)})"
        if isinstance(term, (int, float)) and not isinstance(term, bool):
            return _number(term)
        if isinstance(term, tuple):
            return self.tuple(term)
        if isinstance(term, Expression):
            return self.arithmetic(term, wrap)
        if isinstance(term, Call):
            return f"Call({', '.join([_quoted(term.function), *map(self.term, term.args)])})"
        if isinstance(term, Cons):
            return f"Cons({self.tuple(term.items)}, {self.term(term.tail)})"
        if isinstance(term, Plan):
            return self.plan(term)
        if isinstance(term, Event):
            return self.event(term)
        return self.condition(term) if isinstance(term, Condition) else repr(term)

    def tuple(self, terms: tuple[object, ...]) -> str:
        return f"({', '.join(map(self.term, terms))}{',' if len(terms) == 1 else ''})"

    def arithmetic(self, term: Expression, wrap: bool) -> str:
        number = isinstance(term.left, (int, float)) and isinstance(term.right, Term)
        if term.symbol not in ("div", "mod") and (number or isinstance(term.left, Term)):
            return _wrapped(f"{self.term(term.left, wrap=True)} {term.symbol} {self.term(term.right, wrap=True)}", wrap)
        return f"Expression({_quoted(term.symbol)}, {self.term(term.left)}, {self.term(term.right)})"

    def literal(self, item: Literal) -> str:
        notes = item.annotations
        if self.classed(item):
            text = f"{item.functor}({', '.join(map(self.term, item.args))})"
            if not notes:
                return text
            alone = len(notes) == 1 and not isinstance(notes[0], tuple)
            return f"{text}[{self.term(notes[0]) if alone else self.tuple(notes)}]"
        parts = [_quoted(item.functor), self.tuple(item.args) if item.args or notes else ""]
        parts += [self.tuple(notes) if notes else "", "negated=True" if item.negated else ""]
        return f"literal({', '.join(filter(None, parts))})"


def _is_name(name: str) -> bool:
    return name.isidentifier() and not keyword.iskeyword(name) and name not in RESERVED


def _quoted(text: str) -> str:
    """Quote a string, with double quotes if possible."""
    quoted = repr(text)
    return f'"{quoted[1:-1]}"' if quoted[0] == "'" and '"' not in text and "\\'" not in quoted else quoted


def _wrapped(text: str, wrap: bool) -> str:
    return f"({text})" if wrap else text


def _number(number: float) -> str:
    if math.isfinite(number):
        text = repr(number)
        return f"({text})" if text[0] == "-" else text
    return f'float("{number}")'
