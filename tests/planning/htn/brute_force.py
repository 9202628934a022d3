"""Every way to do a list of tasks, found by the simplest means."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from socialbot.planning.htn.domain import Item, TaskDomain, TaskState
from socialbot.planning.htn.tree import TaskTree

Way = tuple[Item, Any, tuple[Any, ...]]
"""An item, the method of a task, and the ways of what it leads to."""


def ways(
    domain: TaskDomain, state: TaskState, items: Sequence[Item], blacklist: Sequence[Item] = ()
) -> Iterator[tuple[tuple[Way, ...], TaskState]]:
    """All the ways to do ``items`` one after the other, and the states they lead to, the first methods first."""
    if not items:
        yield (), state
        return
    for way, between in ways_of(domain, state, items[0], blacklist):
        for rest, after in ways(domain, between, items[1:], blacklist):
            yield (way, *rest), after


def ways_of(
    domain: TaskDomain, state: TaskState, item: Item, blacklist: Sequence[Item]
) -> Iterator[tuple[Way, TaskState]]:
    if item[0] in domain.actions:
        after = None if item in blacklist else domain.actions[item[0]].function(state.copy(), *item[1:])
        if after is not None:
            yield (item, None, ()), after
        return
    for method in domain.methods[item[0]]:
        items = method.function(state, *item[1:])
        if items is not None:
            for below, after in ways(domain, state, items, blacklist):
                yield (item, method.name, below), after


def way(tree: TaskTree, node: int) -> Way:
    """Decomposition of a node in the task tree."""
    here = tree.nodes[node]
    return here.item, here.method, tuple(way(tree, child) for child in here.children)


def actions(some: Sequence[Way]) -> list[Item]:
    """The actions of ways, in order."""
    return [action for item, method, below in some for action in (actions(below) if method else [item])]
