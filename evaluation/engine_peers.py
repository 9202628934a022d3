"""Other Python engines on the same workloads: python-agentspeak and py_trees, if installed.

Install them with ``make bench``. Event counts are scaled to about one second per engine.
"""

from __future__ import annotations

import gc
import importlib.util
import operator
import sys
from collections.abc import Callable, Iterator
from typing import Any

from evaluation.engine_host import fresh, import_ms, rss_kib
from evaluation.engine_programs import COUNT_TEXT, REACT_TEXT, plan_texts
from evaluation.engine_workloads import Scale, timed

PASSES = 3
BUDGET_NS = 700_000_000
"""Approximate processor time of one pass."""

Rates = dict[str, float]
"""Rates by figure; ``engine_rate_1000`` is the rate with 1000 plans."""

Workload = Callable[[Scale], Rates]


def peers() -> dict[str, dict[str, Workload]]:
    """Return the workloads of each installed peer."""
    found: dict[str, dict[str, Workload]] = {}
    if importlib.util.find_spec("agentspeak"):
        found["agentspeak"] = AgentSpeak().workloads()
    if importlib.util.find_spec("py_trees"):
        found["py_trees"] = Trees().workloads()
    return found


def rate(work: Callable[[int], object], most: int, least: int = 1) -> float:
    """Return units per second of ``work(units)``, with as many units as fit the budget."""
    probe = max(least, min(most, 20))
    cost = max(1.0, timed(lambda: work(probe)) / probe)
    units = int(max(least, min(most, BUDGET_NS / cost)))
    gc.collect()
    return units * 1e9 / min(timed(lambda: work(units)) for _ in range(PASSES))


class AgentSpeak:
    """python-agentspeak: an interpreter of AgentSpeak."""

    def workloads(self) -> dict[str, Workload]:
        return {
            "W1": self.react,
            "W2a": self.select,
            "W2b": self.join,
            "W3": self.descend,
            "W4": self.ring,
            "W5": self.texts,
            "W6": self.host,
        }

    def react(self, scale: Scale) -> Rates:
        agent, _ = self.agent(REACT_TEXT)
        return {"engine_rate": rate(lambda units: self.post(agent, ["person(yes)"] * units), scale.events)}

    def select(self, scale: Scale) -> Rates:
        found: Rates = {}
        for number in scale.plans:
            plans = (f"+ev(c{i}) : ready(yes) <- -ev(c{i}); tick." for i in range(number))
            agent, _ = self.agent("ready(yes). " + " ".join(plans))
            work = self.posting(agent, [f"ev(c{i})" for i in range(number)])
            found[f"engine_rate_{number}"] = found["engine_rate"] = rate(work, scale.events, least=number)
        return found

    def join(self, scale: Scale) -> Rates:
        found: Rates = {}
        for number in scale.facts:
            agent, _ = self.agent("+ev(K) : at(K,R) & light(R,on) <- -ev(K); tick.")
            for i in range(number // 2):
                room = self.literal(f"r{i}")
                agent.add_belief(self.literal("at", i, room), {})
                agent.add_belief(self.literal("light", room, self.literal("on")), {})
            # Ten evenly spread keys; more would exceed the budget with many facts.
            keys = range(0, number // 2, max(1, number // 20))
            work = self.posting(agent, [self.literal("ev", key) for key in keys])
            found[f"engine_rate_{number}"] = found["engine_rate"] = rate(work, scale.events, least=3)
        return found

    def descend(self, scale: Scale) -> Rates:
        from agentspeak import GoalType, Trigger  # type: ignore[import-not-found]
        from agentspeak.runtime import Intention  # type: ignore[import-not-found]

        depth = min(scale.depths[0], 20_000)

        def once() -> int:
            agent, _ = self.agent(COUNT_TEXT)
            goal = self.literal("count", depth)

            def work() -> None:
                agent.call(Trigger.addition, GoalType.achievement, goal, Intention())
                agent.run()

            return timed(work)

        return {"engine_rate": depth * 1e9 / min(once() for _ in range(PASSES))}

    def ring(self, scale: Scale) -> Rates:
        found: Rates = {}
        for size, tokens in scale.rings:
            hops = max(4, 2_000 // tokens)
            best = min(self.hand_on(size, tokens, hops) for _ in range(PASSES))
            found[f"engine_rate_{size}_{tokens}"] = hops * tokens * 1e9 / best
        return found | {"engine_rate": found["engine_rate_1000_1"]}

    def hand_on(self, size: int, tokens: int, hops: int) -> int:
        """Return the processor time (ns) of one turn with tokens in a ring."""
        from collections import defaultdict

        from agentspeak import StringSource  # type: ignore[import-not-found]
        from agentspeak.runtime import Environment  # type: ignore[import-not-found]

        actions, counter = self.actions()
        text = "+token(T,N) : N > 0 & nxt(A) <- -token(T,N); tick; .send(A, tell, token(T,N-1))."
        environment = Environment()
        agents = environment.build_agents(StringSource("ring", text), size, actions)
        for agent in agents:
            agent.beliefs = defaultdict(set)  # not shared between copies
        for i, agent in enumerate(agents):
            agent.add_belief(self.literal("nxt", agents[(i + 1) % size].name), {})

        def work() -> None:
            for k in range(tokens):
                self.believe(agents[k % size], self.literal("token", k, hops))
            environment.run()

        took = timed(work)
        assert counter[0] == tokens * hops, counter
        return took

    def texts(self, scale: Scale) -> Rates:
        from agentspeak import GoalType, Literal, Trigger  # type: ignore[import-not-found]
        from agentspeak.runtime import Intention  # type: ignore[import-not-found]

        texts = [Literal("plain_text", (text,), frozenset()) for text in plan_texts(scale.texts)]

        def once() -> int:
            agent, _ = self.agent("")

            def work() -> None:
                for text in texts:
                    agent.call(Trigger.addition, GoalType.tellHow, text, Intention())

            return timed(work)

        return {"engine_rate": len(texts) * 1e9 / min(once() for _ in range(PASSES))}

    def host(self, scale: Scale) -> Rates:
        return {
            "kib_per_agent": float(fresh("-m", "evaluation.engine_peers", "agentspeak", str(scale.agents // 4))),
            "import_ms": import_ms("agentspeak.runtime, agentspeak.stdlib"),
        }

    # Parts

    def actions(self) -> tuple[Any, list[int]]:
        import agentspeak  # type: ignore[import-not-found]
        import agentspeak.stdlib  # type: ignore[import-not-found]

        actions, counter = agentspeak.Actions(agentspeak.stdlib.actions), [0]

        @actions.add("tick", 0)
        def tick(_agent: Any, _term: Any, _intention: Any) -> Iterator[None]:
            counter[0] += 1
            yield

        return actions, counter

    def agent(self, text: str) -> tuple[Any, list[int]]:
        from agentspeak import StringSource  # type: ignore[import-not-found]
        from agentspeak.runtime import Environment  # type: ignore[import-not-found]

        actions, counter = self.actions()
        agent = Environment().build_agent(StringSource("agent", text), actions)
        agent.run()
        return agent, counter

    def literal(self, functor: str, *args: object) -> Any:
        from agentspeak import Literal  # type: ignore[import-not-found]

        return Literal(functor, args)

    def believe(self, agent: Any, belief: Any) -> None:
        from agentspeak import GoalType, Trigger  # type: ignore[import-not-found]
        from agentspeak.runtime import Intention  # type: ignore[import-not-found]

        agent.call(Trigger.addition, GoalType.belief, belief, Intention())

    def post(self, agent: Any, beliefs: list[Any]) -> None:
        """Add beliefs, given as literals or as ``name(constant)``, and run the agent after each."""
        known: dict[str, Any] = {}
        for belief in beliefs:
            if isinstance(belief, str):
                if belief not in known:
                    name, _, rest = belief.partition("(")
                    known[belief] = self.literal(name, self.literal(rest.rstrip(")")))
                belief = known[belief]
            self.believe(agent, belief)
            agent.run()

    def posting(self, agent: Any, beliefs: list[Any]) -> Callable[[int], None]:
        """Return work for `rate` that cycles through the beliefs."""
        return lambda units: self.post(agent, [beliefs[i % len(beliefs)] for i in range(units)])


class Trees:
    """py_trees: behaviour trees, with blackboard keys as beliefs and a selector of sequences as plans."""

    def workloads(self) -> dict[str, Workload]:
        """Return the supported workloads: no variables, goals, messages or texts."""
        return {"W1": self.react, "W2a": self.select, "W6": self.host}

    def react(self, scale: Scale) -> Rates:
        tree, board = self.tree(["yes"])
        return {"engine_rate": rate(lambda units: self.tick(tree, board, ["yes"], units), scale.events)}

    def select(self, scale: Scale) -> Rates:
        found: Rates = {}
        for number in scale.plans:
            names = [f"c{i}" for i in range(number)]
            tree, board = self.tree(names)
            work = self.ticking(tree, board, names)
            found[f"engine_rate_{number}"] = found["engine_rate"] = rate(work, scale.events, least=min(number, 100))
        return found

    def host(self, scale: Scale) -> Rates:
        return {
            "kib_per_agent": float(fresh("-m", "evaluation.engine_peers", "py_trees", str(scale.agents // 4))),
            "import_ms": import_ms("py_trees"),
        }

    def tree(self, names: list[str]) -> tuple[Any, Any]:
        """Return a tree that reacts to each name, and its blackboard."""
        import py_trees  # type: ignore[import-not-found]
        from py_trees.common import Access, ComparisonExpression, Status  # type: ignore[import-not-found]

        class Act(py_trees.behaviour.Behaviour):
            count = 0

            def update(self) -> Any:
                Act.count += 1
                board.set("event", "none")
                return Status.SUCCESS

        board: Any = py_trees.blackboard.Client(name="writer")
        for key, value in (("event", "none"), ("ready", "yes")):
            board.register_key(key=key, access=Access.WRITE)
            board.set(key, value)

        def holds(key: str, value: str) -> Any:
            check = ComparisonExpression(key, value, operator.eq)
            return py_trees.behaviours.CheckBlackboardVariableValue(name=f"{key} is {value}", check=check)

        root: Any = py_trees.composites.Selector("plans", memory=False)
        for name in names:
            plan: Any = py_trees.composites.Sequence(name, memory=False)
            plan.add_children([holds("event", name), holds("ready", "yes"), Act(f"act on {name}")])
            root.add_child(plan)
        tree = py_trees.trees.BehaviourTree(root)
        tree.setup()
        return tree, board

    def tick(self, tree: Any, board: Any, names: list[str], units: int) -> None:
        for i in range(units):
            board.set("event", names[i % len(names)])
            tree.tick()
        assert board.get("event") == "none", "the last event was not acted upon"

    def ticking(self, tree: Any, board: Any, names: list[str]) -> Callable[[int], None]:
        return lambda units: self.tick(tree, board, names, units)


def kib_per_agent(make: Callable[[], object], number: int) -> float:
    """Return the process memory per agent."""
    kept = [make() for _ in range(10)]
    gc.collect()
    before = rss_kib()
    kept += [make() for _ in range(number)]
    gc.collect()
    return (rss_kib() - before) / number


if __name__ == "__main__":
    making = {"agentspeak": lambda: AgentSpeak().agent(REACT_TEXT), "py_trees": lambda: Trees().tree(["yes"])}
    print(kib_per_agent(making[sys.argv[1]], int(sys.argv[2])))
