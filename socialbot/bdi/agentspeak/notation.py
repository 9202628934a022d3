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
from socialbot.bdi.plans import Inference, Plan, parts_of
from socialbot.bdi.steps import (
    Achieve,
    Ask,
    Await,
    Constrain,
    Do,
    Enter,
    For,
    Forget,
    Fork,
    If,
    PlanBody,
    Step,
    Update,
    While,
)
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
    Holds,
    LiteralVariable,
    Negation,
    Rest,
    Term,
    Truth,
    Variable,
)

_WITHOUT_AND = (Comparison, FunctionCondition)
_OF_BELIEFS = (Change.ADDED, Change.REMOVED, Change.HELD, Change.CHANGED)
GOAL, ACTION, BELIEF = "goal", "action", "belief"

RESERVED = frozenset({
    "Achieve", "Ask", "Atom", "Await", "Call", "Change", "Comparison", "Conjunction", "Cons", "Constrain",
    "Disjunction", "Do", "Event", "Expression", "FunctionCondition", "Holds", "Inference", "LiteralVariable",
    "NOTHING", "Negation", "Plan", "PlanBody", "Rest", "Truth", "Update", "Variable", "apart", "as_long_as", "ask",
    "atomic", "compute", "conjunction", "count", "enter", "fail", "findall", "first_of", "float", "for_each",
    "labelled", "literal", "max_of", "min_of", "my_name", "priority", "replace", "stage", "sum_of", "test", "together",
    "wait", "wait_for", "when",
})  # fmt: skip
"""Names of Python and `socialbot.bdi` that the printed source uses."""


def rules(item: Plan | Inference) -> str:
    """Print a plan, a list of one or an inference as Python source."""
    return _Notation(item).whole(item)


class _Notation:
    """Printer of an item; ``classes`` are the names that stand for classes."""

    def __init__(self, item: Plan | Inference) -> None:
        self.roles: dict[str, set[str]] = {}
        self.variables: set[str] = set()
        self.collect(item)
        self.classes = {
            name
            for name, roles in self.roles.items()
            if len(roles) < 2 and _is_name(name) and name not in self.variables
        }

    def collect(self, part: object, role: str | None = None) -> None:
        """Collect the variables, and the names of literals with their roles: goal, action, belief or none."""
        if isinstance(part, Variable):
            self.variables.add(part.name)
        elif isinstance(part, Do):
            self.collect(part.action, ACTION if isinstance(part.action, Literal) else None)
            self.collect(part.limit_s)
        elif isinstance(part, Achieve):
            self.collect(part.goal, GOAL)
            self.collect(part.limit_s)
        else:
            inner = None
            if isinstance(part, Literal):
                self.roles.setdefault(part.functor, set()).update(() if role is None else (role,))
            elif isinstance(part, tuple):
                inner = role
            elif isinstance(part, Event):
                inner = BELIEF if part.change in _OF_BELIEFS else GOAL
            elif isinstance(part, (Condition, Step, Inference)) and not isinstance(part, Comparison):
                inner = BELIEF
            for item in parts_of(part):
                self.collect(item, inner)

    def classed(self, item: Literal) -> bool:
        """Whether a literal is printed with a class, which has no values as annotations."""
        if not all(isinstance(note, (Atom, Literal, Term)) for note in item.annotations):
            return False
        return not isinstance(item, Structure) or (item.functor in self.classes and not item.negated)

    # Plans

    def whole(self, item: Plan | Inference) -> str:
        condition = self.joined(item.condition, wrap=True)
        if isinstance(item, Inference):
            if not isinstance(item.head, Literal):
                return f"Inference({self.term(item.head)}, {condition})"
            return f"{self.literal(item.head)} << {condition}"
        given = f" / {condition}" if item.condition.terms else ""
        text = f"{self.event(item.event, head=True)}{given} >> {self.body(item.body)}"
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
        listed = plan.atomic or plan.priority or plan.stage is not None
        return f"{self.whole(plan)}[0]" if listed else f"({self.whole(plan)})"

    def event(self, event: Event, head: bool = False) -> str:
        if not isinstance(event.literal, Literal):
            return f"Event(Change.{event.change.name}, {self.term(event.literal)})"
        if event.change is Change.CHANGED and head and self.classed(event.literal):
            half = len(event.literal.args) // 2
            now, before = event.literal.with_(args=event.literal.args[:half]), event.literal.args[half:]
            return f"{self.literal(now)}.changed({', '.join(map(self.term, before))})"
        item = self.literal(event.literal)
        classed = self.classed(event.literal)
        if event.change in (Change.ADDED, Change.REMOVED):
            return f"{event.change.value}{item}"
        if event.change is Change.HELD:
            if isinstance(event.seconds, (int, float)) and event.seconds < 0:
                return f"Event(Change.HELD, {item}, {event.seconds})"
            return f"+{item}.held_for({'...' if callable(event.seconds) else event.seconds})"
        if classed and event.change is Change.FAILED:
            return f"-{item}"
        if classed and event.change is Change.WANTED and head:
            return item
        return f"Event(Change.{event.change.name}, {item})"

    # Bodies

    def steps(self, body: tuple[Step, ...]) -> str:
        """Print steps as a tuple."""
        return f"({', '.join(map(self.step, body))}{',' if len(body) == 1 else ''})"

    def body(self, body: tuple[Step, ...]) -> str:
        return f"[{', '.join(map(self.step, body))}]"

    def step(self, step: Step) -> str:
        match step:
            case Do(Condition() as action) if not isinstance(action, Literal):
                return f"Do({self.condition(action)})"
            case Do(action, limit_s):
                return self.limited(action, limit_s) or f"Do({self.term(action)}{self.limit(limit_s)})"
            case Achieve(goal, apart, limit_s):
                text = self.limited(goal, limit_s)
                if text is not None:
                    return f"apart({text})" if apart else text
                return f"Achieve({self.term(goal)}{', apart=True' if apart else ''}{self.limit(limit_s, 'limit_s=')})"
            case Ask(query):
                return f"ask({self.term(query)})"
            case Update("++", Literal() as literal):
                return f"+{self.literal(literal)}"
            case Update(sign, literal):
                return f"Update({_quoted(sign)}, {self.term(literal)})"
            case Forget(literal):
                return f"-{self.literal(literal)}"
            case Constrain(Conjunction() as condition):
                return f"test({self.joined(condition)})"
            case Constrain(condition):
                return f"Constrain({self.condition(condition)})"
            case Enter(stage):
                return f"enter({_quoted(stage)})"
            case Await(what, limit_s):
                return f"wait_for({self.awaited(what)}{self.limit(limit_s)})"
            case Fork(branches, every):
                return f"{'together' if every else 'first_of'}({', '.join(map(self.body, branches))})"
            case If(condition, then, otherwise):
                other = f", {self.body(otherwise)}" if otherwise else ""
                return f"when({self.awaited(condition)}, {self.body(then)}{other})"
            case While(condition, body):
                return f"as_long_as({self.awaited(condition)}, {self.body(body)})"
            case For(condition, body):
                return f"for_each({self.awaited(condition)}, {self.body(body)})"
        raise TypeError(step)

    def awaited(self, what: Event | Condition) -> str:
        """Print an event or condition as the operand of a conjunction."""
        if isinstance(what, Event):
            return self.event(what)
        return self.joined(what) if isinstance(what, Conjunction) else self.condition(what)

    def limited(self, what: object, limit_s: object) -> str | None:
        """Print a goal or action with its time limit; None if it has no class, or no limit that a class accepts."""
        accepted = limit_s is None or isinstance(limit_s, Term) or (isinstance(limit_s, (int, float)) and limit_s >= 0)
        if not isinstance(what, Literal) or not self.classed(what) or not accepted:
            return None
        return self.literal(what) + ("" if limit_s is None else f".within({self.term(limit_s)})")

    def limit(self, limit_s: object, name: str = "") -> str:
        return "" if limit_s is None else f", {name}{self.term(limit_s)}"

    # Conditions

    def joined(self, condition: Conjunction, wrap: bool = False) -> str:
        """Print a conjunction as an operand of one."""
        if not condition.terms:
            return "NOTHING"
        first, *more = condition.terms
        return self.condition(condition, wrap) if more else _wrapped(self.condition(first), wrap)

    def condition(self, condition: object, wrap: bool = False) -> str:
        """Print a condition; ``wrap`` adds parentheses around operators."""
        match condition:
            case Conjunction(terms):
                # Python functions and comparisons do not implement &, so one of the first two operands must.
                if len(terms) < 2 or all(isinstance(term, _WITHOUT_AND) for term in terms[:2]):
                    return f"conjunction({', '.join(map(self.condition, terms))})"
                return _wrapped(" & ".join(self.condition(term, wrap=True) for term in terms), wrap)
            case Disjunction(terms):
                return self.disjunction(terms, wrap)
            case Negation(inner):
                if isinstance(inner, _WITHOUT_AND):
                    return f"Negation({self.condition(inner)})"
                return f"~{self.condition(inner, wrap=True)}"
            case Comparison():
                symbol, left, right = condition.symbol, condition.left, condition.right
                # Python would reverse 3 < X.
                if symbol in ("=", "=..") or not isinstance(left, Term):
                    return f"Comparison({_quoted(symbol)}, {self.term(left)}, {self.term(right)})"
                return _wrapped(f"{self.term(left, wrap=True)} {symbol} {self.term(right, wrap=True)}", wrap)
            case FunctionCondition():
                name = getattr(condition.function, "__name__", "")
                return name if name.isidentifier() else f"Guard(lambda {', '.join(condition.parameters)}: ...)"
            case Truth(value):
                return f"Truth({value})"
        return self.term(condition)

    def disjunction(self, terms: tuple[Condition, ...], wrap: bool) -> str:
        parts: list[tuple[Condition, ...]] = [term.terms if isinstance(term, Conjunction) else () for term in terms]
        simple = len(parts) > 1 and all(parts) and not isinstance(parts[0][0], Disjunction)
        if not simple or all(len(part) == 1 and isinstance(part[0], _WITHOUT_AND) for part in parts[:2]):
            return f"Disjunction({self.tuple(terms)})"
        alone = (part[0] if len(part) == 1 else Conjunction(part) for part in parts)
        return _wrapped(" | ".join(self.condition(part, wrap=True) for part in alone), wrap)

    # Terms

    def term(self, term: object, wrap: bool = False) -> str:
        match term:
            case Literal():
                return self.literal(term)
            case Variable():
                proper = not keyword.iskeyword(term.name) and term.name not in RESERVED
                return term.name if proper else f"Variable({_quoted(term.name)})"
            case Atom():
                return f"Atom({_quoted(term.name)})"
            case str():
                return _quoted(term)
            case int() | float() if not isinstance(term, bool):
                if not math.isfinite(term):
                    return f'float("{term}")'
                return _wrapped(repr(term), repr(term)[0] == "-")
            case tuple():
                return self.tuple(term)
            case Expression():
                return self.arithmetic(term, wrap)
            case Call():
                return f"Call({', '.join([_quoted(term.function), *map(self.term, term.args)])})"
            case Cons():
                return f"Cons({self.tuple(term.items)}, {self.term(term.tail)})"
            case LiteralVariable(variable, notes, negated, namespace):
                end = ", negated=True" if negated else ""
                end += "" if namespace is None else f", namespace={self.term(namespace)}"
                return f"LiteralVariable({self.term(variable)}, {self.tuple(notes)}{end})"
            case Rest(tail):
                return f"Rest({self.term(tail)})"
            case Holds(what):
                return f"Holds({self.term(what)})"
            case PlanBody(steps):
                return f"PlanBody({self.steps(steps)})"
            case Inference():
                return f"({self.whole(term)})"
            case Plan():
                return self.plan(term)
            case Event():
                return self.event(term)
            case Condition():
                return self.condition(term)
        return repr(term)

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
            return f"{text}[{', '.join(map(self.term, notes))}]"
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
