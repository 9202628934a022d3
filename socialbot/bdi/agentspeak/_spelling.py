"""Format terms, conditions, steps, plans and rules as Jason prints them.

`socialbot.bdi.agentspeak.printer` prints text that the parser reads again; this text is for output.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from decimal import Decimal
from typing import Any

from socialbot.bdi.agentspeak.lexer import KEYWORDS, WRITTEN, is_quoted
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import Change, Event, Literal, literal
from socialbot.bdi.plans import Inference, Plan
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, For, Fork, If, PlanBody, Step, Update, While
from socialbot.bdi.terms import (
    Aggregate,
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
    OwnName,
    Rest,
    Variable,
    order,
)
from socialbot.bdi.unification import Var, resolve


def said(term: Any) -> str:
    """Format a term for printing: a top-level string appears without quotes."""
    term = resolve(term)
    if isinstance(term, str):
        return term
    if term.__class__ is Var:
        return f"{term}<no-value>"
    return spelled(term)


def plain(term: Any) -> str:
    """Format a term as a part of a string: names appear without quotes, too."""
    term = resolve(term)
    if term.__class__ is not Atom:
        return said(term)
    return term.name[1:-1] if is_quoted(term.name) else term.name


def spelled(term: Any) -> str:
    """Format a term: no spaces, and no fraction for integers."""
    if term.__class__ is Atom:
        return _name(term.name)
    if isinstance(term, str):
        return f'"{term}"'
    if isinstance(term, bool) or term is None:
        return str(term).lower()
    if isinstance(term, float):
        return _decimal(term)
    if term.__class__ is tuple:
        return f"[{_list(term)}]"
    if term.__class__ is Cons:
        return f"[{_list(term.items)}|{spelled(term.tail)}]"
    if isinstance(term, Literal):
        args = f"({_list(term.args)})" if term.args else ""
        return f"{'~' if term.negated else ''}{_name(term.functor)}{args}{_notes(term.annotations)}"
    if isinstance(term, Plan):
        return f"{{ {_plan(term)} }}"
    if isinstance(term, Inference):
        return f"{{ {_rule(term)} }}"
    if isinstance(term, PlanBody):
        if term.bare and term.steps:
            return _body(term.steps)
        return f"{{ {_body(term.steps)} }}" if term.steps else "{ }"
    if isinstance(term, Event):
        return f"{{ {_event(term)} }}"
    if isinstance(term, Condition):
        return _condition(term)
    if isinstance(term, Expression):
        return _arithmetic(term)
    if isinstance(term, Call):
        return f"{term.function}({_list(term.args)})" if term.args else term.function
    if isinstance(term, LiteralVariable):
        namespace = "" if term.namespace is None else f"{spelled(term.namespace)}::"
        return f"{namespace}{'~' if term.negated else ''}{spelled(term.variable)}{_notes(term.annotations)}"
    if isinstance(term, (Aggregate, OwnName)):
        return agentspeak(term)
    return str(term)


def spelled_item(item: Plan | Inference) -> str:
    """Format a plan or rule without braces, as `.list_plans` and `.list_rules` do."""
    return f"{_plan(item)}{'' if item.inner else '.'}" if isinstance(item, Plan) else _rule(item)


def _list(terms: Iterable[Any]) -> str:
    return ",".join(map(spelled, terms))


def _notes(notes: tuple[Any, ...]) -> str:
    """Format annotations, which Jason keeps in the order of terms."""
    if not notes:
        return ""
    rest = f"|{spelled(notes[-1].tail)}" if isinstance(notes[-1], Rest) else ""
    kept = notes[:-1] if rest else notes
    return f"[{_list(sorted(kept, key=order) if len(kept) > 1 else kept)}{rest}]"


def _name(name: str) -> str:
    bare = name.removeprefix("~")  # as =.. takes a negated literal apart
    if bare.isidentifier() and bare[0].islower() and bare not in KEYWORDS:
        return name
    return agentspeak(Atom(name))


def _decimal(number: float) -> str:
    """Format a float as Java does: whole numbers without a fraction, small and large ones with an exponent."""
    if math.isnan(number) or math.isinf(number):
        return {math.inf: "Infinity", -math.inf: "-Infinity"}.get(number, "NaN")
    if number.is_integer() and abs(number) < 2**63:
        return str(int(number))
    if 1e-3 <= abs(number) < 1e7:
        return repr(number)
    digits, exponent = f"{Decimal(repr(number)):e}".split("e")
    return f"{digits if '.' in digits else digits + '.0'}E{int(exponent)}"


def _arithmetic(term: Expression) -> str:
    if term.symbol == "-" and type(term.left) is int and term.left == 0:
        return f"(-{spelled(term.right)})"
    sign = WRITTEN[term.symbol]
    return f"({spelled(term.left)}{f' {sign} ' if sign.isalpha() else sign}{spelled(term.right)})"


def _condition(condition: Any) -> str:
    match condition:
        case Conjunction((single,)) | Disjunction((single,)):
            return spelled(single)
        case Conjunction((first, *others)):
            return f"({spelled(first)} & {_condition(Conjunction(tuple(others)))})"
        case Disjunction((first, *others)):
            return f"({spelled(first)} | {_condition(Disjunction(tuple(others)))})"
        case Conjunction(()):
            return "true"
        case Negation(inner):
            return f"not ({spelled(inner)})"
        case Holds(what):
            return spelled(what)
        case FunctionCondition():
            return agentspeak(condition)
        case Comparison() if condition.binds():
            return agentspeak(condition)
        case Comparison():
            return f"({spelled(condition.left)} {WRITTEN[condition.symbol]} {spelled(condition.right)})"
    return str(condition)


def _event(event: Event) -> str:
    if event.change in (Change.HELD, Change.CHANGED):
        return agentspeak(event)
    return f"{event.change.value}{spelled(resolve(event.literal))}"


def _rule(rule: Inference) -> str:
    return f"{spelled(rule.head)} :- {_condition(rule.condition)}"


def _plan(plan: Plan) -> str:
    label = plan.known.label if plan.known else label_term(plan)
    text = "" if label is None else f"@{spelled(label)} "
    condition = plan.without_truth().condition
    context = f" : {_condition(condition)}" if condition.terms else ""
    until = "" if plan.until is None else f" <: {_condition(plan.until)}"
    body = f" <- {_body(plan.body)}" if plan.body else ""
    if not plan.inner:
        return f"{text}{_event(plan.event)}{context}{until}{body}"
    inner = "".join(f"\n   {_plan(each)}{'' if each.inner else '.'}" for each in plan.inner)
    return f"{text}{_event(plan.event)}{context}{until} {{{f'{chr(10)}  {body}.' if body else ''}{inner}\n}}"


def label_term(plan: Plan) -> Any:
    """Return the label of a plan with its annotations as a term, None without either."""
    notes: list[Any] = [Atom("atomic")] if plan.atomic else []
    if plan.priority:
        notes.append(literal("priority", (plan.priority,)))
    if plan.stage is not None:
        notes.append(literal("stage", (Atom(plan.stage),)))
    notes += plan.annotations
    if isinstance(plan.label, Variable):
        return LiteralVariable(plan.label, tuple(notes))
    return literal(plan.label or "", (), tuple(notes)) if plan.label is not None or notes else None


def _body(steps: Iterable[Step]) -> str:
    return "; ".join(map(spelled_step, steps))


def spelled_step(step: Step) -> str:
    """Format a step; control structures have the form of internal actions, such as ``.if_then_else(c,a,b)``."""
    match step:
        case Do(action, None) if isinstance(action, (Literal, Condition, Variable, LiteralVariable)):
            return spelled(action)
        case Achieve(goal, apart, None):
            return f"{'!!' if apart else '!'}{spelled(goal)}"
        case Ask(query):
            return f"?{spelled(query)}"
        case Update(sign, changed):
            return f"{sign}{spelled(changed)}"
        case Constrain(condition):
            return _condition(condition)
        case If(condition, then, otherwise):
            parts = [then, otherwise] if otherwise else [then]
            return f".if_then_else({','.join([_condition(condition), *map(_body, parts)])})"
        case While(condition, body):
            return f".loop({_condition(condition)},{_body(body)})"
        case For(condition, body):
            return f".foreach({_condition(condition)},{_body(body)})"
        case Fork(branches, every):
            return f".fork({','.join(['and' if every else 'or', *map(_body, branches)])})"
    return agentspeak(step)
