"""Print plans and their parts in AgentSpeak.

Parsing the printed text of an AgentSpeak item gives an equal item. Some Python constructs have a counterpart: a
variable ``x`` becomes ``_x``, a class ``Person`` the quoted name ``'Person'``, True and False the atoms ``true`` and
``false``, None the atom ``none``. Other Python objects become strings of their repr. Python functions become
``.python(name, X)``, which the parser rejects.

>>> from socialbot.bdi.agentspeak.parser import parse_plan
>>> agentspeak(parse_plan("@greet[atomic] +seen(P):known(P)&not asleep<-!greet(P)[within(5)];.wait(100)"))
'@greet[atomic] +seen(P) : known(P) & not asleep <- !greet(P)[within(5)]; .wait(100).'
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from socialbot.bdi.actions import fail, wait
from socialbot.bdi.agentspeak.lexer import (
    AND,
    COMPARE,
    ESCAPES,
    KEYWORDS,
    NOT,
    OR,
    POWER,
    TRIGGERS,
    WRITTEN,
    is_function,
)
from socialbot.bdi.literals import Change, Event, Literal, literal
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
    Truth,
    Variable,
)

_PLAIN = re.compile(r"\.?[^\W\dA-Z_]\w*(?:\.[^\W\d]\w*)*")
_SIGNS = {change: sign + kind for (sign, kind), change in TRIGGERS.items()}
_ESCAPED = str.maketrans({char: f"\\{letter}" for letter, char in ESCAPES.items() if letter not in "'\""})


def agentspeak(item: object) -> str:
    """Print a plan or rule with its final dot, an event, a step, a condition or a term in Jason's syntax."""
    if isinstance(item, Plan):
        return f"{_plan(item)}."
    if isinstance(item, Inference):
        return f"{_literal(item.head)} :- {_condition(item.condition, OR)}."
    if isinstance(item, Event):
        return _event(item)
    if isinstance(item, Step):
        return _step(item)
    if isinstance(item, Condition):
        return _condition(item, OR)
    return _term(item)


def _plan(plan: Plan) -> str:
    context = f" : {_condition(plan.condition, OR)}" if plan.condition.terms else ""
    body = f" <- {_body(plan.body)}" if plan.body else ""
    return f"{_label(plan)}{_event(plan.event)}{context}{body}"


def _label(plan: Plan) -> str:
    notes = ["atomic"] if plan.atomic else []
    if plan.priority:
        notes.append(f"priority({plan.priority})")
    if plan.stage is not None:
        plain = _is_plain(plan.stage) and not is_function(plan.stage, 0)
        notes.append(f"stage({plan.stage if plain else _term(plan.stage)})")
    notes += map(_term, plan.annotations)
    if plan.label is None and not notes:
        return ""
    name = "" if plan.label is None else _name(plan.label)
    return f"@{name}[{', '.join(notes)}] " if notes else f"@{name} "


def _event(event: Event) -> str:
    if event.change is Change.HELD:
        known = isinstance(event.seconds, (int, float))
        seconds = event.seconds if known else literal(".python", (_called(event.seconds),))
        return f"+{_literal(event.literal, literal('held_for', (seconds,)))}"
    if event.change is Change.CHANGED:
        half = len(event.literal.args) // 2
        now, before = event.literal.with_(args=event.literal.args[:half]), event.literal.args[half:]
        return f"+{_literal(now, literal('changed', before))}"
    return f"{_SIGNS[event.change]}{_literal(event.literal)}"


# Bodies


def _body(body: Iterable[Step]) -> str:
    return "; ".join(map(_step, body))


def _block(body: tuple[Step, ...]) -> str:
    return f"{{ {_body(body)} }}" if body else "{ }"


def _step(step: Step) -> str:
    if isinstance(step, Do):
        return _action(step)
    if isinstance(step, Achieve):
        return f"{'!!' if step.apart else '!'}{_limited(step.goal, step.limit_s)}"
    if isinstance(step, Ask):
        query = step.query
        return f"?{_term(query) if isinstance(query, Variable) else _condition(query, POWER)}"
    if isinstance(step, Update):
        return f"{step.sign}{_limited(step.literal, None)}"
    if isinstance(step, Forget):
        return f".abolish({_term(step.literal)})"
    if isinstance(step, Constrain):
        return _constraint(step)
    if isinstance(step, Enter):
        return f".enter({_term(Atom(step.stage))})"
    if isinstance(step, Await):
        what = f"{{{_event(step.what)}}}" if isinstance(step.what, Event) else _condition(step.what, OR)
        return f".wait({what}{'' if step.limit_s is None else f', {_milliseconds(step.limit_s)}'})"
    return _nested(step)


def _nested(step: Step) -> str:
    if isinstance(step, If):
        return _if(step)
    if isinstance(step, While):
        return f"while ({_condition(step.condition, OR)}) {_block(step.body)}"
    if isinstance(step, For):
        return f"for ({_condition(step.condition, OR)}) {_block(step.body)}"
    assert isinstance(step, Fork), step
    return f" {'|&|' if step.every else '|||'} ".join(map(_branch, step.branches))


def _if(step: If) -> str:
    text = f"if ({_condition(step.condition, OR)}) {_block(step.then)}"
    if len(step.otherwise) == 1 and isinstance(step.otherwise[0], If):
        return f"{text} el{_if(step.otherwise[0])}"
    return f"{text} else {_block(step.otherwise)}" if step.otherwise else text


def _branch(body: tuple[Step, ...]) -> str:
    alone = len(body) == 1 and isinstance(body[0], (Do, Achieve, Update))
    return _step(body[0]) if alone else _block(body)


def _action(step: Do) -> str:
    action = step.action
    if isinstance(action, wait) and action.args:
        action = literal(".wait", (_in_milliseconds(action.args[0]),))
    elif isinstance(action, fail):
        action = literal(".fail", tuple(literal("error_msg", (reason,)) for reason in action.args))
    return _limited(action, step.limit_s)


def _limited(what: Literal | Variable, limit_s: object) -> str:
    notes = () if limit_s is None else (literal("within", (limit_s,)),)
    return _literal(what, *notes) if isinstance(what, Literal) else f"{_term(what)}{_notes(notes)}"


def _constraint(step: Constrain) -> str:
    condition = step.condition
    if isinstance(condition, Conjunction) and len(condition.terms) == 1:
        condition = condition.terms[0]
    text = _condition(condition, OR)
    if text[0] in "+-{":  # these start another kind of step
        return f"({text})"
    return (
        f"{text} & true" if isinstance(condition, (Literal, FunctionCondition)) else text
    )  # a lone literal would be an action


def _in_milliseconds(seconds: object) -> object:
    if isinstance(seconds, (int, float)):
        return round(seconds * 1000) if math.isfinite(seconds) else seconds
    return Expression("*", seconds, 1000)


def _milliseconds(seconds: object) -> str:
    return _term(_in_milliseconds(seconds))


# Conditions


def _condition(condition: object, level: int) -> str:
    """Print a condition, in parentheses if its operator binds less tightly than ``level``."""
    if isinstance(condition, Conjunction):
        if len(condition.terms) == 1:
            return _condition(condition.terms[0], level)
        return _within(" & ".join(_condition(term, NOT) for term in condition.terms) or "true", AND, level)
    if isinstance(condition, Disjunction):
        return _within(" | ".join(_condition(term, AND) for term in condition.terms), OR, level)
    if isinstance(condition, Negation):
        return _within(f"not {_condition(condition.condition, COMPARE)}", NOT, level)
    if isinstance(condition, Comparison):
        left, right = _compared(condition.left), _compared(condition.right)
        return _within(f"{left} {WRITTEN[condition.symbol]} {right}", COMPARE, level)
    if isinstance(condition, FunctionCondition):
        parameters = [Variable(name) for name in condition.parameters]
        return _literal(literal(".python", (_called(condition.function), *parameters)))
    if isinstance(condition, Truth):
        return str(condition)
    assert isinstance(condition, Literal), condition
    return _literal(condition)


def _within(text: str, binds: int, level: int) -> str:
    return text if binds >= level else f"({text})"


def _called(function: object) -> Atom:
    return Atom(getattr(function, "__name__", type(function).__name__))


# Terms


def _term(term: object, internal: bool = False) -> str:
    """Print a term; ``internal`` marks an argument of an internal action, which may be a condition."""
    if isinstance(term, Variable):
        return term.name if term.name[0] == "_" or term.name[0].isupper() else f"_{term.name}"
    if isinstance(term, Literal):
        return _literal(term, known=True)
    if isinstance(term, Atom):
        return _name(term.name, 0)
    if isinstance(term, (str, bool, int, float)) or term is None:
        return _constant(term)
    if isinstance(term, tuple):
        return f"[{', '.join(map(_term, term))}]"
    if isinstance(term, Cons):
        return f"[{', '.join(map(_term, term.items))} | {_term(term.tail)}]"
    if isinstance(term, Expression):
        return _arithmetic(term)
    if isinstance(term, Call):
        return f"{'' if is_function(term.function, len(term.args)) else '+'}{_call(term)}"
    if isinstance(term, (Plan, Event)):
        return _in_braces(term)
    if isinstance(term, Condition):
        return _condition(term, OR if internal else POWER)
    return _string(repr(term))


def _constant(value: object) -> str:
    if isinstance(value, str):
        return _string(value)
    if value is None or isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return int.__repr__(value)
    assert isinstance(value, float)
    return float.__repr__(value) if math.isfinite(value) else _string(float.__repr__(value))


def _string(text: str) -> str:
    return '"' + text.translate(_ESCAPED).replace('"', '\\"') + '"'


def _is_plain(name: str) -> bool:
    """Check whether a name needs no quotes."""
    known = _PLAIN.fullmatch(name) is not None and name not in KEYWORDS
    return known and (name[0] == "." or (name[0].isalpha() and not name[0].isupper()))


def _name(name: str, arity: int = -1) -> str:
    """Print a name, in quotes where the bare name has another meaning, such as a function of this arity."""
    if _is_plain(name) and not is_function(name, arity):
        return name
    return "'" + name.translate(_ESCAPED).replace("'", "\\'") + "'"


def _literal(item: Literal, *notes: object, known: bool = False) -> str:
    """Print a literal with added annotations; ``known`` quotes the names of functions."""
    name = _name(item.functor, len(item.args) if known and not item.annotations and not item.negated else -1)
    return f"{'~' if item.negated else ''}{name}{_args(item.functor, item.args)}{_notes((*item.annotations, *notes))}"


def _args(name: str, args: tuple[object, ...]) -> str:
    return f"({', '.join(_term(arg, '.' in name) for arg in args)})" if args else ""


def _notes(notes: tuple[object, ...]) -> str:
    return f"[{', '.join(map(_term, notes))}]" if notes else ""


def _compared(term: object) -> str:
    """Print one side of a comparison, where a structure with a dotted name would be a function call."""
    if isinstance(term, Expression):
        return _arithmetic(term)
    if isinstance(term, Call) and "." in term.function:
        return _call(term)
    text = _term(term)
    if isinstance(term, Literal) and "." in term.functor and term.args and text[0] not in "'~":
        return text.replace(term.functor, f"'{term.functor}'", 1)
    return text


def _arithmetic(term: Expression) -> str:
    if term.symbol == "-" and type(term.left) is int and term.left == 0 and not isinstance(term.right, (int, float)):
        return f"-{_operand(term.right)}"
    return f"{_operand(term.left)} {WRITTEN[term.symbol]} {_operand(term.right)}"


def _operand(term: object) -> str:
    if isinstance(term, Call):
        return _call(term)
    negative = isinstance(term, (int, float)) and not isinstance(term, bool) and str(term)[0] == "-"
    return f"({_term(term)})" if negative or isinstance(term, Expression) else _term(term)


def _call(call: Call) -> str:
    name = call.function if _is_plain(call.function) else _name(call.function)
    return f"{name}{_args(call.function, call.args)}"


def _in_braces(term: Plan | Event) -> str:
    if isinstance(term, Event):
        return f"{{{_event(term)}}}"
    bare = not term.body and not term.condition.terms and not _label(term)
    return f"{{{_plan(term)}{' <-' if bare else ''}}}"
