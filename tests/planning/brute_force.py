"""A simulator of plans that shares no code with the validation: it knows only ground truth tables and slow loops."""

from __future__ import annotations

import itertools
from typing import Any

from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem

World = tuple[set[tuple[str, ...]], dict[tuple[str, ...], float], list[str]]


def named(term: str, env: dict[str, str]) -> str:
    return env.get(term, term)


def number(expression: Any, world: World, env: dict[str, str], duration: float) -> float:
    match type(expression).__name__:
        case "Number":
            return expression.value
        case "Duration":
            return duration
        case "Fluent":
            return world[1][(expression.name, *(named(term, env) for term in expression.terms))]
        case _:
            values = [number(part, world, env, duration) for part in expression.parts]
            return {"+": sum, "-": lambda v: v[0] - v[1], "*": lambda v: v[0] * v[1]}[expression.operator](values)


def true(formula: Any, world: World, env: dict[str, str], domain: PddlDomain) -> bool:
    match type(formula).__name__:
        case "Predicate":
            args = [named(term, env) for term in formula.terms]
            if formula.name in domain.derived:
                parameters, body = domain.derived[formula.name]
                inner = {typed.name: value for typed, value in zip(parameters, args, strict=True)}
                return true(body, world, inner, domain)  # no recursion in these domains
            return (formula.name, *args) in world[0]
        case "Equality":
            return env.get(formula.left, formula.left) == env.get(formula.right, formula.right)
        case "Not":
            return not true(formula.part, world, env, domain)
        case "And":
            return all(true(part, world, env, domain) for part in formula.parts)
        case "Or":
            return any(true(part, world, env, domain) for part in formula.parts)
        case "NumericComparison":
            left, right = number(formula.left, world, env, 0), number(formula.right, world, env, 0)
            return {
                "<": left < right,
                "<=": left <= right,
                "=": left == right,
                ">=": left >= right,
                ">": left > right,
            }[formula.comparator]
        case _:
            names = [typed.name for typed in formula.variables]
            truths = [
                true(formula.part, world, {**env, **dict(zip(names, objects, strict=True))}, domain)
                for objects in itertools.product(world[2], repeat=len(names))
            ]
            return all(truths) if formula.quantifier == "forall" else any(truths)


def flat(effect: Any, world: World, env: dict[str, str], domain: PddlDomain) -> list[tuple[Any, dict[str, str]]]:
    match type(effect).__name__:
        case "UniversalEffect":
            names = [typed.name for typed in effect.variables]
            return [
                one
                for objects in itertools.product(world[2], repeat=len(names))
                for part in effect.effects
                for one in flat(part, world, {**env, **dict(zip(names, objects, strict=True))}, domain)
            ]
        case "ConditionalEffect":
            if not true(effect.condition, world, env, domain):
                return []
            return [one for part in effect.effects for one in flat(part, world, env, domain)]
        case _:
            return [(effect, env)]


def apply(effects: list[Any], world: World, env: dict[str, str], domain: PddlDomain, duration: float) -> World:
    facts, values = set(world[0]), dict(world[1])
    single = [one for effect in effects for one in flat(effect, world, env, domain)]
    for kind in ("Delete", "Add", "NumericEffect"):
        for effect, inner in single:
            if type(effect).__name__ != kind:
                continue
            if kind == "NumericEffect":
                key = (effect.fluent.name, *(named(term, inner) for term in effect.fluent.terms))
                amount = number(effect.amount, world, inner, duration)
                old = values[key]
                values[key] = {"assign": amount, "increase": old + amount, "decrease": old - amount}[effect.operator]
            else:
                fact = (effect.predicate.name, *(named(term, inner) for term in effect.predicate.terms))
                (facts.add if kind == "Add" else facts.discard)(fact)
    return facts, values, world[2]


def is_valid(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan, running: tuple[int, ...] = ()) -> bool:
    """Whether ``plan`` is valid; no two things in it may happen at the same moment."""
    world: World = (
        {(fact.name, *fact.terms) for fact in problem.facts},
        {(fluent.name, *fluent.terms): value for fluent, value in problem.values.items()},
        [*domain.constants, *problem.objects],
    )
    events = []
    for index, step in enumerate(plan.steps):
        if index not in running:
            events.append((step.start_s, "start", index))
        if domain.actions[step.action].duration is not None:
            events.append((step.start_s + step.duration_s, "end", index))
    active = set(running)
    for _, edge, index in sorted(events):
        step = plan.steps[index]
        action = domain.actions[step.action]
        env = {typed.name: value for typed, value in zip(action.parameters, step.args, strict=True)}
        if not all(true(one.formula, world, env, domain) for one in action.conditions if one.when == edge):
            return False
        effects = [one.effect for one in action.effects if one.when == edge]
        world = apply(effects, world, env, domain, step.duration_s)
        if edge == "end":
            active.remove(index)
        elif action.duration is not None:
            active.add(index)
        for other in active:
            lasting = domain.actions[plan.steps[other].action]
            env = {typed.name: value for typed, value in zip(lasting.parameters, plan.steps[other].args, strict=True)}
            if not all(true(one.formula, world, env, domain) for one in lasting.conditions if one.when == "over all"):
                return False
    return problem.goal is None or true(problem.goal, world, {}, domain)


def moments_apart(plan: PddlPlan, gap_s: float = 0.001) -> bool:
    """Whether no two starts or ends are simultaneous."""
    times = sorted(time for step in plan.steps for time in {step.start_s, step.end_s})
    return all(later - earlier >= gap_s for earlier, later in itertools.pairwise(times))
