"""Families of desires: those that prepare another one, and who ends together with whom."""

from __future__ import annotations

from collections.abc import Iterator

from socialbot.agent_messages import Condition, Conjunction, Desire, Dnf
from socialbot.deliberation.desires import DesireSet, End, Wish
from socialbot.deliberation.options import Options
from socialbot.deliberation.patterns import has_wildcards, variables_in

LIFT = 0.01
"""How much higher the priority of a desire is that prepares another one."""


def lacking(wish: Wish, options: Options) -> tuple[Desire, ...]:
    """What to desire first, as the precondition or the context of a desire does not hold."""
    if not wish.is_prepared():
        return preparations(wish.desire, wish.desire.precondition, "precondition") if options.autosub_prec else ()
    if not wish.is_in_context():
        return preparations(wish.desire, wish.desire.context, "context") if options.autosub_context else ()
    return ()


def preparations(desire: Desire, dnf: Dnf, what: str) -> tuple[Desire, ...]:
    """Desires that make a clause of ``dnf`` true each, for ``desire``: named ``<desire>_fulfill_<what><number>``."""
    return tuple(
        Desire(
            name=f"{desire.name}_fulfill_{what}{number}",
            conditions=clause.literals,
            priority=lifted(desire.priority),
            deadline=desire.deadline,
            parent=desire.name,
        )
        for number, clause in enumerate(dnf.clauses)
        if _can_be_wanted(clause)
    )


def ending_with(wish: Wish, how: End, reason: str, desires: DesireSet) -> Iterator[tuple[Wish, str]]:
    """Who is dropped, and why, now that a desire has ended; each is to be taken out of ``desires`` when it is told.

    These are the desires that prepared it; when it is fulfilled, those that prepared the same as it did; and when it
    is dropped, and none such is left, what it was to prepare.
    """
    yield from _descendants(wish, desires)
    parent = desires.get(wish.desire.parent)
    if parent is None:
        return
    siblings = desires.children(parent.name)
    if how == "fulfilled":
        for sibling in siblings:
            yield sibling, f"{wish.name} is fulfilled"
            yield from _descendants(sibling, desires)
    elif not siblings and not (parent.is_prepared() and parent.is_in_context()):
        reason = f"cannot be prepared: {reason}"
        yield parent, reason
        yield from ending_with(parent, "dropped", reason, desires)


def hindrances(wish: Wish, options: Options) -> tuple[str, str] | None:
    """What of a desire does not hold, and is not desired though it should be, with the reason; None without that."""
    lacks_precondition = not wish.is_prepared()
    asked = options.autosub_prec if lacks_precondition else options.autosub_context and not wish.is_in_context()
    if not asked or lacking(wish, options):
        return None
    what = "precondition" if lacks_precondition else "context"
    return f"{wish.name}_fulfill_{what}", "no plan can bring it about: it asks for an object, or does not say for which"


def prepares(child: Desire, desire: Desire) -> bool:
    """Whether it was made to prepare another desire, rather than by somebody who has only called that its parent."""
    return child.parent == desire.name and child.name.startswith(f"{desire.name}_fulfill_")


def lifted(priority: float) -> float:
    """The priority of what prepares a desire with this one."""
    return min(1.0, priority + LIFT)


def _descendants(wish: Wish, desires: DesireSet) -> Iterator[tuple[Wish, str]]:
    for child in desires.children(wish.name):
        yield child, f"{wish.name} has ended"
        yield from _descendants(child, desires)


def _can_be_wanted(clause: Conjunction) -> bool:
    """Whether a plan can bring it about: no plan makes an object, or knows which one is meant."""
    return bool(clause.literals) and all(_may_change(check) for check in clause.literals)


def _may_change(check: Condition) -> bool:
    fact = check.condition_to_check
    return check.check != "EX" and not any(has_wildcards(term) or variables_in(term) for term in fact.params)
