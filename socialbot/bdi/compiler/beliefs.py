"""Changes of beliefs by bodies in generated code."""

from __future__ import annotations

from socialbot.bdi.compiler.source import Function, tuple_of
from socialbot.bdi.compiler.terms import build, has_value, refresh, value, values
from socialbot.bdi.literals import Literal, Structure
from socialbot.bdi.steps import Forget, Update
from socialbot.bdi.terms import Variable, names_in


def notes_of(f: Function, literal: Literal) -> str:
    """The expression of the annotations of what the agent itself says."""
    if not literal.annotations:
        return "SELF"
    notes = [build(f, note) for note in literal.annotations]
    named = any(isinstance(note, Literal) and note.functor == "source" for note in literal.annotations)
    return tuple_of(notes) if named else f"({', '.join(notes)}, *SELF)"


def update(f: Function, step: Update) -> None:
    """Writes a change; but for ``++``, the local r then holds what to wait for, or None."""
    literal, sign = step.literal, step.sign
    if isinstance(literal, Variable):
        f.line(f"r = ag.update_of({sign!r}, {value(f, literal)}, c)", step)
        return
    relation = f.relation(literal.key)
    if sign in ("-", "--"):
        before = set(f.scope)
        known = "_" not in names_in(literal.args) and has_value(f, literal.args)
        if known and _anyones(literal):
            f.line(f"r = ag.remove_any({relation}, {values(f, literal.args)}, c, {sign == '-'})", step)
            return
        known = known and "_" not in names_in(literal.annotations) and has_value(f, literal.annotations)
        args = values(f, literal.args) if known else tuple_of([build(f, arg) for arg in literal.args])
        method = "remove_known" if known else "remove"
        f.line(f"r = ag.{method}({relation}, {args}, {notes_of(f, literal)}, c, {sign == '-'})", step)
        refresh(f, names_in(literal), before)
        return
    args = values(f, literal.args)
    if type(literal) is not Structure:
        f.unit.library.declare(type(literal))
    if sign == "++":
        f.line(f"ag.add({relation}, {args}, {notes_of(f, literal)}, c)", step)
    else:
        method = "add_here" if sign == "+" else "replace"
        f.line(f"r = ag.{method}({relation}, {args}, {notes_of(f, literal)}, c)", step)


def forget(f: Function, step: Forget) -> None:
    """Writes that every belief that matches goes, whoever said it."""
    literal = step.literal
    relation = f.relation(literal.key)
    if "_" not in names_in(literal) and has_value(f, literal) and not literal.annotations:
        args = values(f, literal.args)
        # Nobody has to know: no call.
        f.line(f"if {relation}.quiet and ag.sink is None:")
        f.line(f"    {relation}.facts.pop({args}, None)", step)
        f.line(f"else: ag.forget_one({relation}, {args}, c)", step)
    else:
        args = tuple_of([build(f, arg) for arg in literal.args])
        notes = tuple_of([build(f, note) for note in literal.annotations])
        f.line(f"ag.forget_all({relation}, {args}, {notes}, c)", step)


def _anyones(literal: Literal) -> bool:
    """Whether a belief is told by ``[source(_)]``."""
    notes = literal.annotations
    return len(notes) == 1 and isinstance(notes[0], Literal) and str(notes[0]) == "source(_)"
