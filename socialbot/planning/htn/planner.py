"""Task planner: depth-first search for plans, and repairs of plans that have failed or no longer fit the world."""

from __future__ import annotations

import itertools
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypedDict

from socialbot.core.errors import PlanningError
from socialbot.planning.htn.domain import Item, Operator, TaskDomain, TaskState, item_text
from socialbot.planning.htn.tree import TaskAnswer, TaskFault, TaskLimits, TaskNode, TaskStatus, TaskTree, TaskVerdict

if TYPE_CHECKING:
    from typing_extensions import Unpack


@dataclass(frozen=True, slots=True, eq=False)
class Trail:
    """Linked list of decisions, newest first: ``what`` was executed, or refined by ``method``."""

    before: Trail | None
    what: TaskPlace
    method: str | None


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """State of the search with its decisions and the number of actions."""

    state: TaskState
    trail: Trail | None = None
    done: int = 0


class LimitReached(Exception):  # noqa: N818 - no error
    """Time or attempts are used up."""


class Cancelled(Exception):  # noqa: N818 - no error
    """The caller has cancelled the call."""


class TaskDomainError(Exception):
    """The domain or the request is wrong."""

    def __init__(self, fault: TaskFault, what: str, *, where: str | None = None, remedy: str | None = None) -> None:
        super().__init__(str(PlanningError(what, where=where, remedy=remedy)))
        self.fault = fault


@dataclass(eq=False, slots=True)
class TaskPlace:
    """Position of an item: below another one, at a node of a tree, or new at the top."""

    item: Item
    above: TaskPlace | None = None
    node: int | None = None


@dataclass(frozen=True, slots=True)
class Alternative:
    """Constraint that a task leads to other ``actions`` from index ``failed`` on, or earlier."""

    place: TaskPlace
    actions: tuple[Item, ...]
    failed: int

    def holds(self, trail: Trail | None) -> bool:
        """Return whether a trail that ends with the task satisfies the constraint."""
        new = [entry.what.item for entry in back(trail, self.place) if entry.method is None]
        again = len(self.actions) - self.failed <= len(new) <= len(self.actions)
        return not again or self.actions[len(self.actions) - len(new) :] != tuple(reversed(new))


def back(trail: Trail | None, start: TaskPlace | None = None) -> Iterator[Trail]:
    """Yield decisions from the newest back to the one of ``start``, or to the first."""
    while trail is not None:
        yield trail
        trail = None if trail.what is start else trail.before


@dataclass(frozen=True, slots=True, eq=False)
class _Agenda:
    """Linked list of the tasks that are not done yet."""

    what: TaskPlace | Alternative
    later: _Agenda | None


def _before(todo: Sequence[TaskPlace | Alternative], later: _Agenda | None) -> _Agenda | None:
    """Return an agenda with ``todo`` in front."""
    for what in reversed(todo):
        later = _Agenda(what, later)
    return later


@dataclass(eq=False)
class TaskSearch:
    """Searches in one domain with shared limits; ``end`` is the deadline (``time.thread_time``)."""

    domain: TaskDomain
    limits: TaskLimits
    blacklist: Sequence[Item]
    cancelled: threading.Event | None
    end: float
    attempts: int = 0
    _furthest: tuple[int, str] = field(default=(-1, ""))

    def run(self, state: TaskState, todo: Sequence[TaskPlace | Alternative]) -> SearchState | None:
        """Return the state after all of ``todo``, or None.

        Raises LimitReached, Cancelled, TaskDomainError.
        """
        # Each choice is a state, the tasks that are not done in it, and the method for the first of them.
        choices: list[tuple[SearchState, _Agenda | None, int]] = [(SearchState(state.copy()), _before(todo, None), 0)]
        while choices:
            current, agenda, index = choices.pop()
            if agenda is None:
                return current
            what, later = agenda.what, agenda.later
            if isinstance(what, Alternative):
                after = self._compare(what, current)
            elif (methods := self.domain.methods.get(what.item[0])) is None:
                after = self._act(what, current)
            else:
                if index + 1 < len(methods):
                    choices.append((current, agenda, index + 1))
                after, items = None, self._refine(what, current, methods[index])
                if items is not None:
                    after = SearchState(current.state, Trail(current.trail, what, methods[index].name), current.done)
                    later = _before([TaskPlace(item, what) for item in items], later)
            if after is not None:
                choices.append((after, later, 0))
        return None

    @property
    def obstacle(self) -> str:
        """Reason for the failure after the longest sequence of actions."""
        done, what = self._furthest
        return f"after {done} action{'' if done == 1 else 's'} {what}"

    def check(self, item: Any, source: str, where: str | None = None) -> None:
        """Raises TaskDomainError if the domain has no such action or task."""
        fault, remedy = TaskFault.MALFORMED, None
        if not isinstance(item, (list, tuple)) or not item or not isinstance(item[0], str):
            what, remedy = f"{item!r:.80}, in {source}, is no task", 'write ("name", argument)'
        elif not (operators := self.domain.operators(item[0])):
            similar = self.domain.similar(item[0])
            fault, remedy = TaskFault.UNKNOWN, f"did you mean {similar!r}?" if similar else "declare it"
            what = f"{self.domain.name} has no action or task {item[0]!r}, which stands in {source}"
        else:
            wrong = next((operator for operator in operators if not operator.takes(len(item) - 1)), None)
            if wrong is None:
                return
            fault, where = TaskFault.ARITY, where or wrong.where
            what = f"{item_text(tuple(item))}, in {source}: {wrong.name} takes {wrong.arity} arguments"
        raise TaskDomainError(fault, what, where=where, remedy=remedy)

    def _act(self, place: TaskPlace, current: SearchState) -> SearchState | None:
        self._count()
        if place.item in self.blacklist:
            return self._fail(current, f"{item_text(place.item)} is blacklisted")
        action = self.domain.actions[place.item[0]]
        after = self._call(action, current.state.copy(), place.item)
        if after is None or after is False:
            return self._fail(current, f"{item_text(place.item)} cannot be done")
        if not isinstance(after, TaskState):
            what = f"{action.name} returned {after!r:.80}, which is no state"
            remedy = "return the state, or None if the action cannot be done"
            raise TaskDomainError(TaskFault.MALFORMED, what, where=action.where, remedy=remedy)
        return SearchState(after, Trail(current.trail, place, None), current.done + 1)

    def _refine(self, place: TaskPlace, current: SearchState, method: Operator) -> list[Item] | None:
        self._count()
        items = self._items(method, self._call(method, current.state, place.item))
        return self._fail(current, f"no method does {item_text(place.item)}") if items is None else items

    def _compare(self, otherwise: Alternative, current: SearchState) -> SearchState | None:
        if otherwise.holds(current.trail):
            return current
        return self._fail(current, f"{item_text(otherwise.place.item)} would fail again")

    def _count(self) -> None:
        self.attempts += 1
        if self.cancelled is not None and self.cancelled.is_set():
            raise Cancelled
        if self.attempts > self.limits.steps or time.thread_time() >= self.end:
            raise LimitReached

    def _fail(self, current: SearchState, what: str) -> None:
        if current.done >= self._furthest[0]:
            self._furthest = (current.done, what)

    def _call(self, operator: Operator, state: TaskState, item: Item) -> Any:
        try:
            return operator.function(state, *item[1:])
        except Exception as problem:
            file = operator.where.rpartition(":")[0]
            lines = [line.lineno for line in traceback.extract_tb(problem.__traceback__) if line.filename == file]
            what = f"{operator.name} for {item_text(item)}: {type(problem).__name__}: {problem}"
            where = f"{file}:{lines[-1]}" if lines else operator.where
            raise TaskDomainError(TaskFault.RAISED, what, where=where) from problem

    def _items(self, method: Operator, returned: Any) -> list[Item] | None:
        if returned is None or returned is False:
            return None
        if not isinstance(returned, (list, tuple)):
            what = f"{method.name} returned {returned!r:.80}, which is no list"
            remedy = "return a list of tasks and actions, or None if the method does not apply"
            raise TaskDomainError(TaskFault.MALFORMED, what, where=method.where, remedy=remedy)
        for item in returned:
            self.check(item, f"the result of {method.name}", method.where)
        return [tuple(item) for item in returned]


def progressed(tree: TaskTree, reached: TaskNode, status: TaskStatus) -> TaskTree:
    """Return a tree after the execution of all actions before ``reached``, which gets ``status``."""
    nodes = dict(tree.nodes)
    for node in tree.plan:
        if node.id == reached.id:
            break
        nodes[node.id] = replace(node, status="done")
    if status != "failed" or reached.parent is not None:
        nodes[reached.id] = replace(reached, status=status)
        return replace(tree, nodes=nodes)
    # Without a parent the node itself represents both the failure and the repetition.
    nodes[tree.next_id] = replace(reached, id=tree.next_id, parent=reached.id, former=(), status="failed")
    nodes[reached.id] = replace(reached, former=(*reached.former, tree.next_id))
    return replace(tree, nodes=nodes, next_id=tree.next_id + 1)


def build_tree(tree: TaskTree, tops: Iterable[TaskPlace], trail: Trail | None, redone: int | None = None) -> TaskTree:
    """Return a tree with ``tops`` decomposed as in ``trail``; those without a node become new roots.

    A task with the same method and children keeps the ids below it. Executed and failed nodes below ``redone`` become
    former nodes; its other nodes are removed.
    """
    methods: dict[TaskPlace, str | None] = {}
    below: dict[TaskPlace, list[TaskPlace]] = {}
    for entry in reversed(list(back(trail))):
        place: TaskPlace = entry.what
        methods[place] = entry.method
        if place.above is not None:
            below.setdefault(place.above, []).append(place)

    nodes, roots, next_id = dict(tree.nodes), list(tree.roots), tree.next_id
    waiting: list[tuple[TaskPlace, TaskNode]] = []
    for top in tops:
        if (at := top.node) is None:
            waiting.append((top, TaskNode(next_id, top.item)))
            roots.append(next_id)
            next_id += 1
        else:
            waiting.append((top, tree.nodes[at]))
            for gone in tree.walk(at):
                del nodes[gone.id]
    if redone is not None:
        nodes.update((node.id, node) for node in _remains(tree, redone))
    waiting.reverse()
    while waiting:
        place, node = waiting.pop()
        children = below.get(place, [])
        if node.id == redone:
            node = replace(nodes[node.id], children=())
        same = [child.item for child in children] == [tree.nodes[id].item for id in node.children]
        if same and node.method == methods[place]:
            nearer = [(child, tree.nodes[id]) for child, id in zip(children, node.children, strict=True)]
        else:
            nearer = [(child, TaskNode(id, child.item, node.id)) for id, child in enumerate(children, next_id)]
            next_id += len(children)
            node = replace(node, children=tuple(new.id for _, new in nearer))
        waiting += reversed(nearer)
        method = methods[place]
        nodes[node.id] = replace(node, method=method, status="planned" if method is None else None)
    return TaskTree(nodes, tuple(roots), next_id)


def _remains(tree: TaskTree, redone: int) -> Iterator[TaskNode]:
    """Yield the executed and failed nodes at and below ``redone``, with their ancestors."""
    left = {redone: tree.nodes[redone]}
    for node in tree.walk(redone):
        if node.status in ("done", "failed"):
            above: int | None = node.id
            while above is not None and above not in left:
                left[above] = tree.nodes[above]
                above = tree.nodes[above].parent
    for node in left.values():
        former = tuple(id for id in node.former if id in left)
        children = tuple(id for id in node.children if id in left)
        if node.id == redone:
            yield replace(node, former=former + children, children=())
        else:
            yield replace(node, former=former, children=children)


LIMITS = TaskLimits()


class SearchOptions(TypedDict, total=False):
    """Options of a call of `TaskPlanner`: actions that are not planned, and an event that ends the call."""

    blacklist: Iterable[Item]
    cancelled: threading.Event | None


class TaskPlanner:
    """Planner for the tasks of one domain; stateless and thread-safe. It raises nothing: errors are in the answer.

    A set ``cancelled`` or the timeout ends a call at the next action or method. Blacklisted actions, such as
    ``("a_open_door", "spot1", "room1")``, are not planned.
    """

    def __init__(self, domain: TaskDomain) -> None:
        self.domain = domain

    def plan(
        self, state: TaskState, tasks: Iterable[Item], limits: TaskLimits = LIMITS, **options: Unpack[SearchOptions]
    ) -> TaskAnswer:
        """Plan a sequence of tasks from a state, which is not changed."""

        def work(search: TaskSearch) -> TaskAnswer:
            items = list(tasks)
            for item in items:
                search.check(item, "the request")
            tops = [TaskPlace(tuple(item)) for item in items]
            found = search.run(state, tops)
            return _impossible(search) if found is None else _solved(build_tree(TaskTree(), tops, found.trail))

        return self._answer(work, limits, **options)

    def replan(
        self,
        state: TaskState,
        tree: TaskTree,
        failed: int,
        limits: TaskLimits = LIMITS,
        **options: Unpack[SearchOptions],
    ) -> TaskAnswer:
        """Repair a plan from ``state`` after the action at the node ``failed``; earlier actions are executed.

        The nearest ancestor with another decomposition is planned again, preferably without the same action, and then
        all later tasks. Executed actions stay in the tree; unchanged later nodes keep their ids.
        """

        def work(search: TaskSearch) -> TaskAnswer:
            path = _path(tree, failed)
            old = progressed(tree, path[0], "failed")
            attempts = itertools.product(path[1:] or path, (False, True))
            answers = (_redo(search, state, old, node, failed, again=again) for node, again in attempts)
            return next(filter(None, answers), None) or _impossible(search)

        return self._answer(work, limits, **options)

    def revise(
        self,
        state: TaskState,
        tree: TaskTree,
        next_node: int,
        limits: TaskLimits = LIMITS,
        **options: Unpack[SearchOptions],
    ) -> TaskAnswer:
        """Repair a plan from a changed ``state`` before the action at ``next_node``.

        Started tasks keep their decomposition if possible; the others are planned again. The tree of a plan that is
        still valid stays equal, apart from executed actions.
        """

        def work(search: TaskSearch) -> TaskAnswer:
            path = _path(tree, next_node)
            old = progressed(tree, path[0], "planned")
            answers = (_redo(search, state, old, node, None, again=True) for node in path)
            return next(filter(None, answers), None) or _impossible(search)

        return self._answer(work, limits, **options)

    def _answer(
        self,
        work: Callable[[TaskSearch], TaskAnswer],
        limits: TaskLimits,
        blacklist: Iterable[Item] = (),
        cancelled: threading.Event | None = None,
    ) -> TaskAnswer:
        begin = time.monotonic()
        end = time.thread_time() + limits.timeout_s
        search = TaskSearch(self.domain, limits, [tuple(item) for item in blacklist], cancelled, end)
        try:
            for item in search.blacklist:
                search.check(item, "the blacklist")
            answer = work(search)
        except LimitReached:
            message = f"no plan within {limits.timeout_s:g} s and {limits.steps} attempts"
            answer = TaskAnswer(TaskVerdict.TIMEOUT, message=message)
        except Cancelled:
            answer = TaskAnswer(TaskVerdict.CANCELLED, message="cancelled")
        except TaskDomainError as problem:
            answer = TaskAnswer(TaskVerdict.ERROR, message=str(problem), fault=problem.fault)
        return replace(answer, seconds=time.monotonic() - begin)


def _solved(tree: TaskTree, redone: int | None = None) -> TaskAnswer:
    return TaskAnswer(TaskVerdict.PLAN, tree, redone=redone)


def _impossible(search: TaskSearch) -> TaskAnswer:
    return TaskAnswer(TaskVerdict.IMPOSSIBLE, message=f"no plan: {search.obstacle}")


def _path(tree: TaskTree, id: int) -> list[TaskNode]:
    if id not in tree.nodes or tree.nodes[id].status != "planned":
        what = f"the tree has no planned action at node {id}"
        raise TaskDomainError(TaskFault.UNKNOWN, what, remedy="give the id of a node of the plan")
    return tree.path(id)


def _redo(
    search: TaskSearch, state: TaskState, tree: TaskTree, node: TaskNode, failed: int | None, *, again: bool
) -> TaskAnswer | None:
    """Return the tree with a new decomposition of ``node`` and all later tasks; None if there is none.

    Unless ``again``, the decomposition must differ from the one in which ``failed`` failed.
    """
    top = TaskPlace(node.item, node=node.id)
    later = [id for above in tree.path(node.id) for id in tree.later(above)]
    tops = [top, *(TaskPlace(tree.nodes[id].item, node=id) for id in later)]
    todo: list[TaskPlace | Alternative] = [*tops]
    if failed is not None and not again:
        actions = [below for below in tree.walk(node.id, former=False) if below.method is None]
        index = [action.id for action in actions].index(failed)
        todo.insert(1, Alternative(top, tuple(action.item for action in actions), index))
    found = search.run(state, todo)
    if found is None:
        return None
    redone = node.id if node.method is not None or failed is not None else None
    return _solved(build_tree(tree, tops, found.trail, redone), redone)
