"""Hand-written baseline: a minimal loop for one fixed agent.

It has a set of beliefs, an event queue, plans found by name and first argument, an index for joins, a goal stack and
mailboxes. It lacks the engine's sources, stamps, failures, waits and traces.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

Fact = tuple[Any, ...]
Guard = Callable[["Hand", Fact], "Fact | None"]
Body = Callable[["Hand", Fact], None]


class Hand:
    """Hand-written agent."""

    __slots__ = ("beliefs", "count", "index", "indexed", "mail", "name", "next", "plans", "queue")

    def __init__(self, name: str = "hand", indexed: tuple[str, ...] = ()) -> None:
        self.name = name
        self.beliefs: set[Fact] = set()
        self.index: dict[Fact, set[Fact]] = {}
        self.indexed = indexed
        self.plans: dict[tuple[str, str, Any], list[tuple[Guard, Body]]] = {}
        self.queue: deque[tuple[str, Fact]] = deque()
        self.mail: deque[tuple[str, Fact]] = deque()
        self.next: Hand | None = None
        self.count = 0

    def add(self, fact: Fact) -> None:
        if fact not in self.beliefs:
            self.beliefs.add(fact)
            if fact[0] in self.indexed:
                self.index.setdefault(fact[:2], set()).add(fact)
            self.queue.append(("+", fact))

    def remove(self, fact: Fact) -> None:
        """Remove a fact without an event, as no plan needs it."""
        if fact in self.beliefs:
            self.beliefs.discard(fact)
            if fact[0] in self.indexed:
                self.index[fact[:2]].discard(fact)

    def run(self) -> None:
        queue, plans = self.queue, self.plans
        while queue:
            sign, fact = queue.popleft()
            found = plans.get((sign, fact[0], fact[1])) or plans.get((sign, fact[0], None))
            if found:
                for guard, body in found:
                    env = guard(self, fact)
                    if env is not None:
                        body(self, env)
                        break


def is_ready(agent: Hand, fact: Fact) -> Fact | None:
    """Condition ``ready(yes)``."""
    return fact if ("ready", "yes") in agent.beliefs else None


def forget_and_count(agent: Hand, fact: Fact) -> None:
    """Plan body ``-event; tick``."""
    agent.remove(fact)
    agent.count += 1


def reacting(events: list[Fact]) -> Hand:
    """Return an agent with a plan for each event, under the condition ``ready(yes)``."""
    agent = Hand()
    agent.add(("ready", "yes"))
    agent.run()
    agent.plans = {("+", name, arg): [(is_ready, forget_and_count)] for name, arg in events}
    return agent


def reacting_to_any(name: str) -> Hand:
    """Return an agent with a plan for each fact of a name, under the condition ``ready(yes)``."""
    agent = Hand()
    agent.add(("ready", "yes"))
    agent.run()
    agent.plans = {("+", name, None): [(is_ready, forget_and_count)]}
    return agent


def joining(facts: int) -> Hand:
    """Return an agent with ``+ev(K) : at(K, R) & light(R, on)``; half of the facts are ``at``, half ``light``."""
    agent = Hand(indexed=("at",))
    for i in range(facts // 2):
        agent.add(("at", i, f"r{i}"))
        agent.add(("light", f"r{i}", "on"))
    agent.queue.clear()

    def lit(agent: Hand, fact: Fact) -> Fact | None:
        for at in agent.index.get(("at", fact[1]), ()):
            if ("light", at[2], "on") in agent.beliefs:
                return fact
        return None

    agent.plans = {("+", "ev", None): [(lit, forget_and_count)]}
    return agent


def react(agent: Hand, events: list[Fact]) -> None:
    """Process events one by one."""
    for fact in events:
        agent.add(fact)
        agent.run()


def descend(depth: int) -> int:
    """Run ``+!count(N) : N > 0 <- !count(N-1); tick`` with a stack of plan, step and argument; return the ticks."""
    ticks = 0

    def last(_env: int, _step: int) -> None:
        return None

    def down(env: int, step: int) -> tuple[str, int] | None:
        nonlocal ticks
        if step == 0:
            return ("count", env - 1)
        ticks += 1
        return None

    plans = {"count": lambda number: last if number == 0 else down}
    stack: list[list[Any]] = [[plans["count"](depth), 0, depth]]
    while stack:
        frame = stack[-1]
        goal = frame[0](frame[2], frame[1])
        frame[1] += 1
        if goal is None:
            stack.pop()
        else:
            stack.append([plans[goal[0]](goal[1]), 0, goal[1]])
    return ticks


def fib(number: int) -> tuple[int, int]:
    """Run ``+!fib(N, F)`` with a stack of plan, step and variables; return the result and the number of goals."""
    goals, result = 0, 0

    def least(env: list[int], _step: int) -> tuple[str, int] | None:
        nonlocal result
        result = env[0]
        return None

    def add(env: list[int], step: int) -> tuple[str, int] | None:
        nonlocal result
        if step == 0:
            return ("fib", env[0] - 1)
        if step == 1:
            env.append(result)
            return ("fib", env[0] - 2)
        result += env[1]
        return None

    plans = {"fib": lambda number: least if number < 2 else add}
    stack: list[list[Any]] = [[plans["fib"](number), 0, [number]]]
    while stack:
        frame = stack[-1]
        goal = frame[0](frame[2], frame[1])
        frame[1] += 1
        if goal is None:
            goals += 1
            stack.pop()
        else:
            stack.append([plans[goal[0]](goal[1]), 0, [goal[1]]])
    return result, goals


class Sum:
    """Agent with a goal that sums its items: ``-+acc(0); for (item(_, V)) { ?acc(S); -+acc(S+V) }; tick``."""

    def __init__(self, items: list[Fact]) -> None:
        self.facts: dict[str, dict[Fact, None]] = {"item": dict.fromkeys(items), "acc": {}}
        self.count = 0

    def replace(self, name: str, fact: Fact) -> None:
        held = self.facts[name]
        for old in held:
            del held[old]
            break
        held[fact] = None

    def total(self) -> None:
        self.replace("acc", (0,))
        for item in list(self.facts["item"]):
            for (value,) in self.facts["acc"]:
                self.replace("acc", (value + item[1],))
                break
            else:
                return
        self.count += 1


def serve(number: int) -> int:
    """Run goals that fail in the plan of their subgoal, each handled by a failure plan; return the ticks."""
    ticks, full = 0, set[int]()

    def served(_env: int, _step: int) -> Any:
        return None

    def serve(env: int, step: int) -> Any:
        nonlocal ticks
        if step == 0:
            return ("bring", env)
        if step == 1:
            ticks += 1
            return ("", 0)
        return ("serve", env - 1) if step == 2 else None

    def bring(env: int, step: int) -> Any:
        return ("grasp", env) if step == 0 else None

    def not_brought(_env: int, _step: int) -> Any:
        nonlocal ticks
        ticks += 1
        return None

    def grasp(env: int, _step: int) -> Any:
        return None if env in full else False

    plans = {
        "serve": lambda env: serve if env > 0 else served,
        "bring": lambda env: bring,
        "grasp": lambda env: grasp,
    }
    handlers = {"bring": not_brought}
    stack: list[list[Any]] = [[serve, 0, number, "serve"]]
    while stack:
        frame = stack[-1]
        goal = frame[0](frame[2], frame[1])
        frame[1] += 1
        if goal is None:
            stack.pop()
        elif goal is False:
            while stack:
                _, _, env, name = stack.pop()
                if name in handlers:
                    stack.append([handlers[name], 0, env, ""])
                    break
        elif goal[0]:
            if goal[0] == frame[3]:
                stack.pop()  # the last goal replaces its own
            stack.append([plans[goal[0]](goal[1]), 0, goal[1], goal[0]])
    return ticks


class Ring:
    """Agents in a ring that forward tokens."""

    def __init__(self, size: int) -> None:
        self.agents = [Hand(f"a{i}") for i in range(size)]
        self.ready: deque[Hand] = deque()
        self.hops = 0
        for i, agent in enumerate(self.agents):
            agent.next = self.agents[(i + 1) % size]
            agent.plans = {("+", "token", None): [(self._going, self._hand_on)]}

    def run(self, tokens: int, hops: int) -> None:
        ready, size = self.ready, len(self.agents)
        for k in range(tokens):
            self.agents[k % size].mail.append(("env", ("token", k, hops)))
            ready.append(self.agents[k % size])
        while ready:
            agent = ready.popleft()
            if agent.mail:
                _sender, fact = agent.mail.popleft()
                agent.add(fact)
                agent.run()

    @staticmethod
    def _going(_agent: Hand, fact: Fact) -> Fact | None:
        return fact if fact[2] > 0 else None

    def _hand_on(self, agent: Hand, fact: Fact) -> None:
        agent.remove(fact)
        self.hops += 1
        receiver = agent.next
        assert receiver is not None
        receiver.mail.append((agent.name, ("token", fact[1], fact[2] - 1)))
        self.ready.append(receiver)
