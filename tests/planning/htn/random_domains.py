"""Random domains that always end: a task leads to actions and to tasks with higher numbers only."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

from socialbot.planning.htn.domain import Item, TaskDomain, TaskState

TASKS = 4
VARIABLES = "xyz"


def random_state(chance: random.Random) -> TaskState:
    return TaskState(at={name: chance.randint(0, 1) for name in VARIABLES})


def _condition(chance: random.Random) -> Callable[[TaskState], bool]:
    if chance.random() < 0.4:
        return lambda state: True
    name, value = chance.choice(VARIABLES), chance.randint(0, 1)
    return lambda state: state.at[name] == value


def _action(chance: random.Random, name: str) -> Callable[..., Any]:
    possible, changed, value = _condition(chance), chance.choice(VARIABLES), chance.choice((0, 1, None))

    def action(state: TaskState, argument: int) -> TaskState | None:
        if not possible(state):
            return None
        if value is not None:
            state.at[changed] = (value + argument) % 2
        return state

    action.__name__ = name
    return action


def _method(chance: random.Random, number: int, name: str) -> Callable[..., Any]:
    applies = _condition(chance)
    names = [f"act{index}" for index in range(3)] * 2 + [f"task{index}" for index in range(number + 1, TASKS)]
    items = [(chance.choice(names), chance.randint(0, 1)) for _ in range(chance.choice((0, 1, 2, 2, 3)))]

    def method(state: TaskState, argument: int) -> list[Item] | None:
        return list(items) if applies(state) else None

    method.__name__ = name
    return method


def random_domain(chance: random.Random) -> TaskDomain:
    domain = TaskDomain("random")
    domain.declare_actions(_action(chance, f"act{index}") for index in range(3))
    for number in range(TASKS):
        domain.declare_task_methods(
            f"task{number}",
            (_method(chance, number, f"way{index}") for index in range(chance.randint(1, 3))),
        )
    return domain


def random_tasks(chance: random.Random) -> list[Item]:
    names = ["task0", "task0", "task1", "task2", "act0"]
    return [(chance.choice(names), chance.randint(0, 1)) for _ in range(chance.randint(1, 3))]
