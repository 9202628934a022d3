from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.planner import TaskPlanner
from socialbot.planning.htn.tree import TaskTree, TaskVerdict
from tests.planning.htn.brute_force import Way, actions, way, ways
from tests.planning.htn.random_domains import random_domain, random_state, random_tasks

seeds = st.integers(0, 10**9).map(random.Random)


def check_form(tree: TaskTree) -> None:
    assert sorted(tree.nodes) == sorted(node.id for node in tree.walk())
    for node in tree.nodes.values():
        assert node.id < tree.next_id
        assert (node.status is None) == (node.method is not None)
        for below in node.children + node.former:
            assert tree.nodes[below].parent == node.id
    assert all(tree.nodes[root].parent is None for root in tree.roots)


def items(tree: TaskTree) -> list[Item]:
    return [node.item for node in tree.plan]


@given(seeds)
@settings(max_examples=300, deadline=None)
def test_the_plan_is_the_first_of_all_ways_and_impossible_means_that_there_is_none(chance):
    domain, state, tasks = random_domain(chance), random_state(chance), random_tasks(chance)
    blacklist = [("act0", chance.randint(0, 1))] if chance.random() < 0.3 else []
    untouched = state.copy()
    answer = TaskPlanner(domain).plan(state, tasks, blacklist=blacklist)
    first = next(ways(domain, state, tasks, blacklist), None)
    assert state == untouched
    if first is None:
        assert (answer.verdict, answer.tree) == (TaskVerdict.IMPOSSIBLE, None)
        return
    assert answer.verdict is TaskVerdict.PLAN
    assert answer.tree is not None
    assert tuple(way(answer.tree, root) for root in answer.tree.roots) == first[0]
    assert [node.item for node in answer.plan] == actions(first[0])
    assert domain.after(state, items(answer.tree)) == first[1]
    check_form(answer.tree)


def same_end(old: list[Item], failed: int, new: list[Item]) -> bool:
    """Whether ``new`` is how ``old`` ended, from the action number ``failed`` or an earlier one on."""
    return any(old[index:] == new for index in range(failed + 1))


def expected(
    domain, state: TaskState, tree: TaskTree, failed: int, blacklist: list[Item]
) -> tuple[int, tuple[Way, ...]] | None:
    """The node that has to be redone after ``failed``, and how all goes on from there."""
    path = tree.path(failed)
    for node in path[1:] or path:
        later = [tree.nodes[id].item for above in tree.path(node.id) for id in tree.later(above)]
        below = [other.id for other in tree.walk(node.id, former=False) if other.method is None]
        old = [tree.nodes[id].item for id in below]
        found = [some for some, _ in ways(domain, state, [node.item, *later], blacklist)]
        other = [some for some in found if not same_end(old, below.index(failed), actions(some[:1]))]
        if found:
            return node.id, (other or found)[0]
    return None


@given(seeds)
@settings(max_examples=300, deadline=None)
def test_replanning_redoes_the_nearest_task_that_can_be_in_another_way_if_there_is_one(chance):
    domain, state, tasks = random_domain(chance), random_state(chance), random_tasks(chance)
    planner = TaskPlanner(domain)
    tree = planner.plan(state, tasks).tree
    for _ in range(3):
        if tree is None or not tree.plan:
            return
        position = chance.randrange(len(tree.plan))
        failed, done = tree.plan[position], tree.plan[:position]
        state = domain.after(state, [node.item for node in done])
        if chance.random() < 0.5:
            state.at[chance.choice("xyz")] = chance.randint(0, 1)
        blacklist = [failed.item] if chance.random() < 0.3 else []
        answer = planner.replan(state, tree, failed.id, blacklist=blacklist)
        right = expected(domain, state, tree, failed.id, blacklist)
        if right is None:
            assert answer.verdict is TaskVerdict.IMPOSSIBLE
            return
        new = answer.tree
        assert new is not None
        assert answer.redone == right[0]
        tops = [right[0], *(id for above in new.path(right[0]) for id in new.later(above))]
        assert tuple(way(new, top) for top in tops) == right[1]
        assert items(new) == actions(right[1])
        before = [(node.item, node.status) for node in tree.history]
        assert [(node.item, node.status) for node in new.history] == [
            *before,
            *((node.item, "done") for node in done),
            (failed.item, "failed"),
        ]
        assert new.tasks == tree.tasks
        check_form(new)
        kept = {node.id for node in new.plan} & tree.nodes.keys()
        assert all(new.nodes[id].item == tree.nodes[id].item for id in kept)
        tree = new


@given(seeds)
@settings(max_examples=200, deadline=None)
def test_a_plan_that_is_still_right_is_not_revised(chance):
    domain, state, tasks = random_domain(chance), random_state(chance), random_tasks(chance)
    planner = TaskPlanner(domain)
    answer = planner.plan(state, tasks)
    if answer.tree is None or not answer.plan:
        return
    position = chance.randrange(len(answer.plan))
    now = domain.after(state, [node.item for node in answer.plan[:position]])
    revised = planner.revise(now, answer.tree, answer.plan[position].id)
    assert revised.tree is not None
    assert revised.plan == answer.plan[position:]
    assert revised.redone is None
    assert [node.id for node in revised.tree.history] == [node.id for node in answer.plan[:position]]


@given(seeds)
@settings(max_examples=200, deadline=None)
def test_a_revised_plan_can_be_carried_out_and_begun_tasks_go_on_where_that_is_possible(chance):
    domain, state, tasks = random_domain(chance), random_state(chance), random_tasks(chance)
    planner = TaskPlanner(domain)
    tree = planner.plan(state, tasks).tree
    if tree is None or not tree.plan:
        return
    position = chance.randrange(len(tree.plan))
    upcoming = tree.plan[position]
    now = domain.after(state, [node.item for node in tree.plan[:position]])
    now.at[chance.choice("xyz")] = chance.randint(0, 1)
    answer = planner.revise(now, tree, upcoming.id)
    for node in tree.path(upcoming.id):
        later = [tree.nodes[id].item for above in tree.path(node.id) for id in tree.later(above)]
        first = next(ways(domain, now, [node.item, *later]), None)
        if first is not None:
            assert [action.item for action in answer.plan] == actions(first[0])
            assert answer.redone == (None if node == upcoming else node.id)
            assert answer.tree is not None
            check_form(answer.tree)
            return
    assert answer.verdict is TaskVerdict.IMPOSSIBLE
