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
from collections.abc import Iterable

from socialbot.bdi.agentspeak.lexer import ESCAPES, TRIGGERS, WRITTEN, Level, is_function, is_plain, is_quoted
from socialbot.bdi.literals import Change, Event, Literal, is_source, literal
from socialbot.bdi.plans import Inference, Plan
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
    Scoped,
    Step,
    Update,
    While,
    fail,
    wait,
)
from socialbot.bdi.terms import (
    Aggregate,
    Atom,
    Call,
    Comparison,
    Computation,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    FunctionCondition,
    Holds,
    LiteralVariable,
    Negation,
    OwnName,
    Rest,
    Truth,
    Variable,
)

_SIGNS = {change: sign + kind for (sign, kind), change in TRIGGERS.items()}
_ESCAPED = str.maketrans({char: f"\\{letter}" for letter, char in ESCAPES.items() if letter not in "'\""})


def agentspeak(item: object) -> str:
    """Print a plan or rule with its final dot, an event, a step, a condition or a term in Jason's syntax."""
    match item:
        case Plan():
            return f"{_plan(item)}.{_inner(item)}"
        case Inference():
            return f"{_rule(item)}."
        case Event():
            return _event(item)
        case Step():
            return _step(item)
        case Condition():
            return _condition(item)
    return _term(item)


def _rule(rule: Inference) -> str:
    # A rule without a condition is a belief with variables.
    condition = f" :- {_condition(rule.condition)}" if rule.condition.terms or not rule.head.names() else ""
    return f"{_literal(rule.head)}{condition}"


def _plan(plan: Plan) -> str:
    context = f" : {_condition(plan.condition)}" if plan.condition.terms else ""
    until = "" if plan.until is None else f" <: {_condition(plan.until)}"
    body = f" <- {_body(plan.body)}" if plan.body else ""
    return f"{_label(plan)}{_event(plan.event)}{context}{until}{body}"


def _inner(plan: Plan) -> str:
    return f" {{ {' '.join(map(agentspeak, plan.inner))} }}" if plan.inner else ""


def _label(plan: Plan) -> str:
    notes = ["atomic"] if plan.atomic else []
    if plan.priority:
        notes.append(f"priority({plan.priority})")
    if plan.stage is not None:
        plain = is_plain(plan.stage) and not is_function(plan.stage, 0)
        notes.append(f"stage({plan.stage if plain else _term(plan.stage)})")
    notes += map(_term, plan.annotations)
    if plan.label is None and not notes:
        return ""
    name = "" if plan.label is None else _name(plan.label) if isinstance(plan.label, str) else _term(plan.label)
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
    return f"{_SIGNS[event.change]}{_target(event.literal)}"


# Bodies


def _body(body: Iterable[Step]) -> str:
    return "; ".join(map(_step, body))


def _block(body: tuple[Step, ...]) -> str:
    return f"{{ {_body(body)} }}" if body else "{ }"


def _step(step: Step) -> str:
    match step:
        case Do(wait(args=(seconds,)), limit_s):
            return _limited(literal(".wait", (_milliseconds(seconds),)), limit_s)
        case Do(fail(args=reasons), limit_s):
            return _limited(literal(".fail", tuple(literal("error_msg", (reason,)) for reason in reasons)), limit_s)
        case Do(action, limit_s):
            return _limited(action, limit_s)
        case Achieve(goal, apart, limit_s):
            return f"{'!!' if apart else '!'}{_limited(goal, limit_s)}"
        case Ask(query):
            return f"?{_condition(query, Level.POWER) if isinstance(query, Condition) else _term(query)}"
        case Update(sign, Inference() as rule):
            return f"{sign}{_term(rule)}"
        case Update(sign, changed):
            return f"{sign}{_target(changed)}"
        case Forget(forgotten) if any(map(is_source, forgotten.annotations)):
            return f"for ({_term(forgotten)}) {{ --{_term(forgotten)} }}"
        case Forget(forgotten):
            return f".abolish({_term(forgotten)})"
        case Constrain(condition):
            return _constraint(condition)
        case Enter(stage):
            return f".enter({_term(Atom(stage))})"
        case Await(what, limit_s):
            awaited = f"{{{_event(what)}}}" if isinstance(what, Event) else _condition(what)
            return f".wait({awaited}{'' if limit_s is None else f', {_term(_milliseconds(limit_s))}'})"
        case If(condition, then, otherwise):
            text = f"if ({_condition(condition)}) {_block(then)}"
            if len(otherwise) == 1 and isinstance(otherwise[0], If):
                return f"{text} el{_step(otherwise[0])}"
            return f"{text} else {_block(otherwise)}" if otherwise else text
        case While(condition, body):
            return f"while ({_condition(condition)}) {_block(body)}"
        case For(condition, body):
            return f"for ({_condition(condition)}) {_block(body)}"
        case Fork(branches, every):
            return f" {'|&|' if every else '|||'} ".join(map(_branch, branches))
        case Scoped():
            return _body(step.body)
    raise TypeError(step)


def _branch(body: tuple[Step, ...]) -> str:
    alone = len(body) == 1 and isinstance(body[0], (Do, Achieve, Update))
    return _step(body[0]) if alone else _block(body)


def _limited(what: object, limit_s: object) -> str:
    if not isinstance(what, Literal):
        return _condition(what) if isinstance(what, Condition) else _term(what)
    written = any(isinstance(note, Literal) and note.functor == "hard_deadline" for note in what.annotations)
    return _literal(what, *(() if limit_s is None or written else (literal("within", (limit_s,)),)))


def _target(what: object) -> str:
    return _literal(what) if isinstance(what, Literal) else _term(what)


def _constraint(condition: Condition) -> str:
    """Print a condition as a step; all but comparisons are a question, since they would be an action."""
    if isinstance(condition, Conjunction) and len(condition.terms) == 1:
        condition = condition.terms[0]
    if isinstance(condition, Comparison) and not condition.binds():
        text = _condition(condition)
        return f"({text})" if text[0] in "+-{" else text  # these start another kind of step
    if isinstance(condition, Comparison) or (isinstance(condition, Literal) and "." in condition.functor):
        return _condition(condition)
    alone = isinstance(condition, (Literal, FunctionCondition))  # a plan for it would answer
    return f"?({_condition(condition)}{' & true' if alone else ''})"


def _milliseconds(seconds: object) -> object:
    if isinstance(seconds, (int, float)):
        return round(seconds * 1000) if math.isfinite(seconds) else seconds
    return Expression("*", seconds, 1000)


# Conditions


def _condition(condition: object, level: int = Level.OR) -> str:
    """Print a condition, in parentheses if its operator binds less tightly than ``level``."""
    match condition:
        case Conjunction((single,)):
            return _condition(single, level)
        case Conjunction(terms):
            return _within(" & ".join(_condition(term, Level.NOT) for term in terms) or "true", Level.AND, level)
        case Disjunction(terms):
            return _within(" | ".join(_condition(term, Level.AND) for term in terms), Level.OR, level)
        case Negation(inner):
            return _within(f"not {_condition(inner, Level.COMPARE)}", Level.NOT, level)
        case Comparison(_, left, Aggregate() as found) if condition.binds():
            return _literal(_collected(found, left))
        case Comparison(_, left, OwnName()) if condition.binds():
            return _literal(literal(".my_name", (left,)))
        case Comparison():
            left, right = _compared(condition.left), _compared(condition.right)
            return _within(f"{left} {WRITTEN[condition.symbol]} {right}", Level.COMPARE, level)
        case FunctionCondition():
            parameters = map(Variable, condition.parameters)
            return _literal(literal(".python", (_called(condition.function), *parameters)))
        case Truth():
            return str(condition)
        case Holds(what):
            return _term(what)
    assert isinstance(condition, Literal), condition
    return _literal(condition)


def _collected(found: Aggregate, *result: object) -> Literal:
    """Internal action with the value of an aggregate, if there is one."""
    arguments = (found.condition,) if found.kind == "count" else (found.template, found.condition)
    if found.kind == "count" or (found.kind == "findall" and result):
        return literal(f".{found.kind}", (*arguments, *result))
    return literal(".python", (Atom(found.kind), *arguments, *result))


def _within(text: str, binds: int, level: int) -> str:
    return text if binds >= level else f"({text})"


def _called(function: object) -> Atom:
    return Atom(getattr(function, "__name__", type(function).__name__))


# Terms


def _term(term: object, internal: bool = False) -> str:
    """Print a term; ``internal`` marks an argument of an internal action, which may be a condition."""
    match term:
        case Variable():
            return term.name if term.name[0] == "_" or term.name[0].isupper() else f"_{term.name}"
        case Literal():
            return _literal(term, known=True)
        case Atom():
            return _name(term.name, 0)
        case str():
            return _string(term)
        case None | bool():
            return str(term).lower()
        case int():
            return int.__repr__(term)
        case float():
            return float.__repr__(term) if math.isfinite(term) else _string(float.__repr__(term))
        case tuple():
            return f"[{', '.join(map(_term, term))}]"
        case Cons():
            return f"[{', '.join(map(_term, term.items))} | {_term(term.tail)}]"
        case Expression():
            return _arithmetic(term)
        case Aggregate():
            return _literal(_collected(term))
        case OwnName():
            return _literal(literal(".python", (Atom("my_name"),)))
        case Computation():
            return _literal(literal(".python", (_called(term.function), *map(Variable, term.parameters))))
        case Call():
            return f"{'' if is_function(term.function, len(term.args)) else '+'}{_call(term)}"
        case Event():
            return f"{{{_event(term)}}}"
        case LiteralVariable(variable, notes, negated, namespace):
            prefix = "" if namespace is None else f"{_term(namespace)}::"
            return f"{prefix}{'~' if negated else ''}{_target(variable)}{_notes(notes)}"
        case PlanBody(steps):
            return f"{{ {_body(steps)} }}" if steps else "{ }"
        case Inference():
            return f"{{{_rule(term)}{'' if ':-' in _rule(term) else ' :- true'}}}"
        case Plan():
            bare = not term.body and not term.condition.terms and not _label(term)
            return f"{{{_plan(term)}{' <-' if bare else ''}}}"
        case Condition():
            return _condition(term, Level.OR if internal else Level.POWER)
    return _string(repr(term))


def _string(text: str) -> str:
    return '"' + text.translate(_ESCAPED).replace('"', '\\"') + '"'


def _name(name: str, arity: int = -1) -> str:
    """Print a name, in quotes where the bare name has another meaning, such as a function of this arity."""
    if is_plain(name) and not is_function(name, arity):
        return name
    if is_quoted(name):
        return name
    namespace, separator, rest = name.partition("::")
    if separator and (is_quoted(namespace) or is_quoted(rest)):
        return f"{_name(namespace)}::{_name(rest)}"
    return "'" + name.translate(_ESCAPED).replace("'", "\\'") + "'"


def _literal(item: Literal, *notes: object, known: bool = False) -> str:
    """Print a literal with added annotations; ``known`` quotes the names of functions."""
    name = _name(item.functor, len(item.args) if known and not item.annotations and not item.negated else -1)
    return f"{'~' if item.negated else ''}{name}{_args(item.functor, item.args)}{_notes((*item.annotations, *notes))}"


def _args(name: str, args: tuple[object, ...]) -> str:
    return f"({', '.join(_term(arg, '.' in name) for arg in args)})" if args else ""


def _notes(notes: tuple[object, ...]) -> str:
    if not notes:
        return ""
    rest = f"|{_term(notes[-1].tail)}" if isinstance(notes[-1], Rest) else ""
    return f"[{', '.join(map(_term, notes[:-1] if rest else notes))}{rest}]"


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
    name = call.function if is_plain(call.function) else _name(call.function)
    return f"{name}{_args(call.function, call.args)}"
