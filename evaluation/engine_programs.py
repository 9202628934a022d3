"""Agents for the engine benchmark, in Python notation and, for comparison, in AgentSpeak.

A counter replaces the robot; ``tick`` is its only action.
"""
# ruff: noqa: D101, N801 - beliefs, goals and actions are written as agents write them

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from socialbot.bdi import Action, Belief, Engine, Goal, Plan, action, send, variables
from socialbot.core.clock import WallClock

A, K, N, P, R, T = variables("A K N P R T")


class person(Belief): ...


class ready(Belief): ...


class ev(Belief): ...


class at(Belief): ...


class light(Belief): ...


class token(Belief): ...


class nxt(Belief): ...


class count(Goal): ...


class acc(Belief): ...


class start(Goal): ...


class total(Goal): ...


class serve(Goal): ...


class Counter:
    """Counter as the body of the agents."""

    def __init__(self) -> None:
        self.count = 0


class Stopwatch:
    """Stopwatch that stores the time (ns) from post to action."""

    def __init__(self) -> None:
        self.posted = 0
        self.took: list[int] = []


@action
def tick(engine: Any) -> None:
    """Increment the counter."""
    engine.robot.count += 1


@action
def stop_watch(engine: Any) -> None:
    """Store the elapsed time."""
    engine.robot.took.append(time.perf_counter_ns() - engine.robot.posted)


REACT_TEXT = "ready(yes). +person(yes) : ready(yes) <- -person(yes); tick."
COUNT_TEXT = "+!count(0). +!count(N) : N > 0 <- !count(N-1)."
STACKED_TEXT = "+!count(0). +!count(N) : N > 0 <- !count(N-1); tick."
RING_TEXT = "+token(T,N) : N > 0 & nxt(A) <- -token(T,N)[source(_)]; .send(A, tell, token(T,N-1))."


def react_rule(then: type[Action] = tick) -> Plan:
    """Return a plan for an arriving person: remove the belief and act."""
    return +person("yes") / ready("yes") >> [-person("yes"), then()]


def burst_rule() -> Plan:
    """Return a plan for any arriving person: remove the belief and act."""
    return +person(P) / ready("yes") >> [-person(P), tick()]


def plan_for_each(events: Iterable[str]) -> list[Plan]:
    """Return a plan for each constant."""
    return [+ev(name) / ready("yes") >> [-ev(name), tick()] for name in events]


def join_rule() -> Plan:
    """Return a plan with a condition that joins two kinds of facts."""
    return +ev(K) / (at(K, R) & light(R, "on")) >> [-ev(K), tick()]


def count_rules(*, stacked: bool) -> list[Plan]:
    """Return plans that count down by subgoals; ``stacked`` adds an action after each subgoal."""
    then = [tick()] if stacked else []
    return [count(0) >> [], count(N) / (N > 0) >> [count(N - 1), *then]]


def ring_rule() -> Plan:
    """Return a plan that forwards a token to the next agent."""
    return +token(T, N) / ((N > 0) & nxt(A)) >> [-token(T, N), send(A, token(T, N - 1))]


def plan_texts(number: int, start: int = 0) -> list[str]:
    """Return distinct AgentSpeak plans."""
    return [f"+!g{i}(X) : c{i}(X) <- a(X); !h{i}(X)." for i in range(start, start + number)]


def agent(*rules: Plan | list[Plan], text: str = "", name: str = "agent", **options: Any) -> Engine:
    """Return an idle agent with a counter, from plans or AgentSpeak text."""
    options.setdefault("robot", Counter())
    engine = Engine(name, WallClock(), **options)
    engine.add_action(tick)
    engine.add_rules(*rules)
    if text:
        engine.add_text(text)
    engine.run_until_idle()
    return engine


def ready_agent(*rules: Plan | list[Plan], **options: Any) -> Engine:
    """Return an agent with the belief ``ready("yes")``."""
    engine = agent(*rules, **options)
    engine.believe(ready("yes"))
    engine.run_until_idle()
    return engine
