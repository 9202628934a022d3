"""Plan and infer from given beliefs as an agent does, without the agent."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.files import load_rules
from socialbot.deliberation.messages import Desire, Fact
from socialbot.deliberation.rules import RuleBook
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import PlannerLimits, PlannerVerdict


def domain_of(path: Path) -> PddlDomain:
    return read_domain(path.read_text("utf-8"), where=str(path))


def believing(path: Path, facts: Iterable[Fact]) -> FactBase:
    base = FactBase(Engine("agent", ManualClock()), domain_of(path))
    for fact in facts:
        base.add(fact)
    return base


def plan_for(facts: FactBase, desire: Desire) -> PddlPlan:
    problem = facts.problem(facts.goal(desire.wanted))
    limits = PlannerLimits(timeout_s=20.0, makespan_s=desire.deadline)
    answer = make_planner("kairos").solve(facts.domain, problem, limits)
    assert answer.verdict is PlannerVerdict.SOLVED, answer.message
    assert answer.plan is not None
    return answer.plan


def settled(facts: FactBase, rules: Path) -> list[str]:
    """Apply the rules until no more effects follow; return the effects as text."""
    book, followed = RuleBook(facts), []
    for rule in load_rules(rules, facts.domain):
        book.add(rule)
    while reactions := book.react():
        for effect in (reaction.effect for reaction in reactions):
            followed.append(str(effect))
            if effect.fact is not None:
                (facts.add if effect.operation == "ADD" else facts.remove)(effect.fact)
    return followed
