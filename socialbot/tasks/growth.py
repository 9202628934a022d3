"""How trees grow: what a search found becomes nodes, and what stays as it was keeps its ids."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from socialbot.tasks.gtpyhop import Trail
from socialbot.tasks.search import Place, back
from socialbot.tasks.tree import Node, Status, TaskTree


def progressed(tree: TaskTree, reached: Node, status: Status) -> TaskTree:
    """``tree`` after all that is planned before the action ``reached`` was done; that one has ``status``."""
    nodes = dict(tree.nodes)
    for node in tree.plan:
        if node.id == reached.id:
            break
        nodes[node.id] = replace(node, status="done")
    if status != "failed" or reached.parent is not None:
        nodes[reached.id] = replace(reached, status=status)
        return replace(tree, nodes=nodes)
    # No task is above it, so its own node has to tell both that it failed and that it is tried once more.
    nodes[tree.next_id] = replace(reached, id=tree.next_id, parent=reached.id, former=(), status="failed")
    nodes[reached.id] = replace(reached, former=(*reached.former, tree.next_id))
    return replace(tree, nodes=nodes, next_id=tree.next_id + 1)


def grown(tree: TaskTree, tops: Iterable[Place], trail: Trail | None, redone: int | None = None) -> TaskTree:
    """``tree`` with ``tops`` done as ``trail`` tells; those that stand at no node become new roots.

    A task that is done by the same method and leads to the same as before keeps the ids below it, except for
    ``redone``: what was done and what failed below that becomes former, the rest is left out.
    """
    methods: dict[Place, str | None] = {}
    below: dict[Place, list[Place]] = {}
    for entry in reversed(list(back(trail))):
        place: Place = entry.what
        methods[place] = entry.method
        if place.above is not None:
            below.setdefault(place.above, []).append(place)

    nodes, roots, next_id = dict(tree.nodes), list(tree.roots), tree.next_id
    waiting: list[tuple[Place, Node]] = []
    for top in tops:
        if (at := top.node) is None:
            waiting.append((top, Node(next_id, top.item)))
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
            nearer = [(child, Node(id, child.item, node.id)) for id, child in enumerate(children, next_id)]
            next_id += len(children)
            node = replace(node, children=tuple(new.id for _, new in nearer))
        waiting += reversed(nearer)
        method = methods[place]
        nodes[node.id] = replace(node, method=method, status="planned" if method is None else None)
    return TaskTree(nodes, tuple(roots), next_id)


def _remains(tree: TaskTree, redone: int) -> Iterator[Node]:
    """What is left of the nodes at and below ``redone``: what was done, what failed, and the tasks for that."""
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
