"""Facts as people write them: ``(at box1 table)``, ``(battery r1) = 80``, ``box1 - box``."""

from __future__ import annotations

import re

from socialbot.agent_messages import FLUENT, INSTANCE, PREDICATE, Fact
from socialbot.errors import PlanningError

_NAME = r"[a-z][\w-]*"
_OBJECT = r"[\w?*{}.-]+"
_FORM = re.compile(
    rf"\(\s*(?P<name>{_NAME})(?P<params>(?:\s+{_OBJECT})*)\s*\)(?:\s*=\s*(?P<value>\S+))?"
    rf"|(?P<object>{_OBJECT})\s+-\s+(?P<type>{_NAME})"
)


def parse_facts(text: str) -> tuple[Fact, ...]:
    """The facts in ``text``, one or more, as `Fact` shows them. Raises PlanningError for anything else."""
    text = text.strip().lower()
    found: list[Fact] = []
    while text or not found:
        form = _FORM.match(text)
        if form is None:
            remedy = "write (at box1 table), (battery r1) = 80, or box1 - box"
            raise PlanningError(f"{text or 'nothing'!r} is no fact", remedy=remedy)
        found.append(_fact(form))
        text = text[form.end() :].lstrip()
    return tuple(found)


def parse_fact(text: str) -> Fact:
    """The one fact in ``text``. Raises PlanningError."""
    fact, *more = parse_facts(text)
    if more:
        raise PlanningError(f"{text!r} is more than one fact", remedy="give one at a time")
    return fact


def _fact(form: re.Match[str]) -> Fact:
    if form["object"] is not None:
        return Fact(name=form["object"], pddl_type=INSTANCE, type=form["type"])
    params = tuple(form["params"].split())
    if form["value"] is None:
        return Fact(name=form["name"], pddl_type=PREDICATE, params=params)
    try:
        return Fact(name=form["name"], pddl_type=FLUENT, params=params, value=float(form["value"]))
    except ValueError as error:
        raise PlanningError(f"{form['value']!r} is no number") from error
