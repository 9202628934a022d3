"""Domains for the tests of the deliberation."""

from __future__ import annotations

from socialbot.deliberation.messages import FLUENT, INSTANCE, Dnf, Fact, FactCondition, FactConjunction
from socialbot.planning.pddl.domain import OBJECT, PddlDomain, Signature
from socialbot.planning.pddl.formulas import TypedName


def signature(text: str) -> Signature:
    """``on ?b:box ?p:box|base`` as a signature."""
    name, *words = text.split()
    parameters = (word.partition(":") for word in words)
    return Signature(name, tuple(TypedName(var, tuple(kinds.split("|"))) for var, _, kinds in parameters))


def domain(types: dict[str, str], predicates: list[str], functions: list[str], constants: dict[str, str]) -> PddlDomain:
    return PddlDomain(
        name="yard",
        types={OBJECT: (), **{kind: (parent,) for kind, parent in types.items()}},
        predicates={made.name: made for made in map(signature, predicates)},
        functions={made.name: made for made in map(signature, functions)},
        constants={name: (kind,) for name, kind in constants.items()},
    )


YARD = domain(
    {"thing": OBJECT, "box": "thing", "base": "thing", "carrier": OBJECT},
    [
        "on ?b:box ?t:thing ?s:base",
        "in ?a:thing ?b:thing",
        "clear ?t:thing",
        "carrier_in_base ?c:carrier ?s:base",
        "next_to ?a:thing|carrier ?b:thing",
        "loaded",
    ],
    ["stacked ?s:base", "moving_boxes ?c:carrier", "distance ?a:base ?b:base", "load"],
    {"start": "base"},
)


def p(name: str, *params: str) -> Fact:
    return Fact(name=name, params=params)


def n(name: str, *params: str, value: float = 0.0) -> Fact:
    return Fact(name=name, pddl_type=FLUENT, params=params, value=value)


def i(name: str, kind: str = "") -> Fact:
    return Fact(name=name, pddl_type=INSTANCE, type=kind)


def dnf(*clauses: list[tuple[str, Fact]]) -> Dnf:
    """Conjunctions from pairs of check and fact."""
    return Dnf(
        clauses=tuple(
            FactConjunction(
                literals=tuple(FactCondition(check=check, condition_to_check=fact) for check, fact in clause)  # type: ignore[arg-type]
            )
            for clause in clauses
        )
    )
