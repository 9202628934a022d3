"""The writer of problems. Formulas write themselves: ``str(formula)`` is PDDL."""

from __future__ import annotations

from collections.abc import Container, Iterable

from socialbot.planning.domain import Problem
from socialbot.planning.formulas import Typed, number_text, typed_text


def problem_text(problem: Problem, constants: Container[str] = ()) -> str:
    """The problem in PDDL, the same text for equal problems; ``constants``, which the domain declares, are left out.

    Without a goal there is no ``:goal``, which planners may not take.
    """
    objects = (Typed(name, types) for name, types in problem.objects.items() if name not in constants)
    values = [f"(= {fluent} {number_text(value)})" for fluent, value in problem.values.items()]
    lines = [
        f"(define (problem {problem.name})",
        f"  (:domain {problem.domain})",
        _section(":objects", (typed_text([one]) for one in sorted(objects, key=lambda one: (one.types, one.name)))),
        _section(":init", [*sorted(map(str, problem.facts)), *sorted(values)]),
    ]
    if problem.goal is not None:
        lines.append(f"  (:goal {problem.goal})")
    if problem.metric is not None:
        lines.append(f"  (:metric {problem.metric})")
    return "\n".join(lines) + ")\n"


def _section(name: str, items: Iterable[str]) -> str:
    return "\n    ".join((f"  ({name}", *items)) + ")"
