"""Benchmark workloads: the engine and the hand-written loop run by turns.

Rates are per second of processor time. Each workload returns its figures by their keys in the JSON.
"""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from evaluation import engine_hand as hand
from evaluation import engine_programs as programs
from evaluation.engine_hookless import hookless
from evaluation.report import Value
from socialbot.bdi import Atom, Engine
from socialbot.bdi.literals import Belief
from socialbot.core.clock import WallClock

PASSES = 7
"""Minimum number of passes."""

STABLE = 0.01
"""Relative improvement below which the measurement ends."""

SECOND = 1_000_000_000

Pass = Callable[[], int]
"""Function that works once and returns its processor time (ns)."""


@dataclass
class Passes:
    """Measurement length: ``budget_s`` ends it after `PASSES` passes, even if unstable."""

    least: int = PASSES
    budget_s: float = 20.0


@dataclass
class Timing:
    """Least processor time (ns) of each contender for ``units`` of work."""

    units: int
    least: dict[str, int] = field(default_factory=dict)
    passes: int = 0

    def rate(self, name: str) -> float:
        return self.units * SECOND / max(1, self.least[name])

    def ratio(self, name: str, of: str) -> float:
        """Return the rate of a contender relative to another."""
        return self.least[of] / max(1, self.least[name])

    def cost_ns(self, name: str) -> float:
        return self.least[name] / self.units


def take_turns(contenders: Mapping[str, Pass], units: int, passes: Passes) -> Timing:
    """Run the contenders by turns, until the least times are stable or the budget is used up."""
    timing, begun, since_better = Timing(units), time.monotonic(), 0
    gc.collect()
    gc.freeze()
    try:
        while timing.passes < passes.least or (since_better < 3 and time.monotonic() - begun < passes.budget_s):
            since_better += 1
            for name, once in contenders.items():
                gc.collect()
                took = once()
                known = timing.least.get(name)
                if known is None or took < known * (1 - STABLE):
                    since_better = 0
                timing.least[name] = took if known is None else min(known, took)
            timing.passes += 1
    finally:
        gc.unfreeze()
    return timing


def timed(work: Callable[[], object]) -> int:
    """Return the processor time (ns) of one call."""
    begun = time.process_time_ns()
    work()
    return time.process_time_ns() - begun


Figures = dict[str, Value]


@dataclass(frozen=True)
class Scale:
    """Workload sizes: ``events`` per pass, ``depths`` of goals, ``plans`` in text."""

    events: int = 100_000
    depths: tuple[int, int] = (100_000, 1_000_000)
    facts: tuple[int, ...] = (10, 1_000, 100_000)
    plans: tuple[int, ...] = (10, 100, 1_000)
    rings: tuple[tuple[int, int], ...] = ((10, 1), (1_000, 1), (1_000, 1_000))
    texts: int = 1_000
    agents: int = 4_000
    latencies: int = 20_000
    idle_s: float = 2.0
    passes: Passes = field(default_factory=Passes)


QUICK = Scale(
    events=20_000,
    depths=(10_000, 100_000),
    facts=(10, 100_000),
    plans=(10, 1_000),
    rings=((10, 1), (1_000, 1)),
    texts=300,
    agents=1_000,
    latencies=2_000,
    idle_s=1.0,
    passes=Passes(least=5, budget_s=2.0),
)
"""Fast scale with less stable figures."""


def react(scale: Scale) -> Figures:
    """W1: event, condition, belief change and action."""
    units = scale.events
    rules = programs.ready_agent(programs.react_rule())
    text = programs.agent(text=programs.REACT_TEXT)
    traced = programs.ready_agent(programs.react_rule(), sink=lambda record: None)
    with hookless() as without:
        bare = without.ready_agent(without.react_rule())
        bare_belief = without.person("yes")
        for _ in range(3):
            bare.believe(bare_belief)
            bare.run_until_idle()
    fact = ("person", "yes")
    yardstick = hand.reacting([fact])
    person = programs.person
    timing = take_turns(
        {
            "hand": lambda: timed(lambda: hand.react(yardstick, [fact] * units)),
            "engine": lambda: post(rules, [person("yes")] * units),
            "bare": lambda: post(bare, [bare_belief] * units),
            "agentspeak": lambda: post(text, [programs.person(Atom("yes"))] * units),
            "fresh": lambda: timed(lambda: _post_new(rules, units)),
            "hand_fresh": lambda: timed(lambda: _react_new(yardstick, units)),
        },
        units,
        scale.passes,
    )
    # Garbage of the trace would slow down the next contender.
    tracing = take_turns({"traced": lambda: post(traced, [person("yes")] * (units // 10))}, units // 10, scale.passes)
    return {
        **compared(timing),
        "agentspeak_rate": timing.rate("agentspeak"),
        "agentspeak_ratio": timing.ratio("agentspeak", of="hand"),
        "fresh_rate": timing.rate("fresh"),
        "fresh_hand_rate": timing.rate("hand_fresh"),
        "fresh_ratio": timing.ratio("fresh", of="hand_fresh"),
        "hook_cost": 1 - timing.ratio("engine", of="bare"),
        "hook_cost_ns": timing.cost_ns("engine") - timing.cost_ns("bare"),
        "traced_rate": tracing.rate("traced"),
        "traced_cost_ns": tracing.cost_ns("traced") - timing.cost_ns("engine"),
    }


def select(scale: Scale) -> Figures:
    """W2a: selection among many plans for one kind of event by a constant."""
    figures: Figures = {}
    contenders: dict[str, Pass] = {}
    for number in scale.plans:
        names = [f"c{i}" for i in range(number)]
        order = [i % number for i in range(scale.events)]
        engine = programs.ready_agent(*programs.plan_for_each(names))
        beliefs: list[Belief] = [programs.ev(name) for name in names]
        facts = [("ev", name) for name in names]
        yardstick = hand.reacting(facts)
        contenders[f"engine_{number}"] = _posting(engine, [beliefs[i] for i in order])
        contenders[f"hand_{number}"] = _reacting(yardstick, [facts[i] for i in order])
    timing = take_turns(contenders, scale.events, scale.passes)
    few, many = scale.plans[0], scale.plans[-1]
    for number in scale.plans:
        figures |= compared(timing, str(number))
    return {
        **figures,
        **compared(timing, str(many), suffix=""),
        "of_few": timing.ratio(f"engine_{many}", of=f"engine_{few}"),
    }


def join(scale: Scale) -> Figures:
    """W2b: condition that joins two kinds of facts, with many facts."""
    figures: Figures = {}
    contenders: dict[str, Pass] = {}
    for number in scale.facts:
        keys = [i % (number // 2) for i in range(scale.events)]
        engine = programs.agent(programs.join_rule())
        for i in range(number // 2):
            engine.believe(programs.at(i, f"r{i}"))
            engine.believe(programs.light(f"r{i}", "on"))
            engine.run_until_idle()
        beliefs: list[Belief] = [programs.ev(i) for i in range(number // 2)]
        facts = [("ev", i) for i in range(number // 2)]
        contenders[f"engine_{number}"] = _posting(engine, [beliefs[i] for i in keys])
        contenders[f"hand_{number}"] = _reacting(hand.joining(number), [facts[i] for i in keys])
    timing = take_turns(contenders, scale.events, scale.passes)
    few, many = scale.facts[0], scale.facts[-1]
    for number in scale.facts:
        figures |= compared(timing, str(number))
    slower = timing.ratio(f"engine_{few}", of=f"engine_{many}")
    return {**figures, **compared(timing, str(many), suffix=""), "slower_than_few": slower}


def descend(scale: Scale) -> Figures:
    """W3: deeply nested goals."""
    figures: Figures = {}
    agents = {
        "engine": programs.agent(*programs.count_rules(stacked=False)),
        "agentspeak": programs.agent(text=programs.COUNT_TEXT),
        "stacked": programs.agent(*programs.count_rules(stacked=True)),
        "agentspeak_stacked": programs.agent(text=programs.STACKED_TEXT),
    }
    for depth in scale.depths:

        def pursuing(engine: Engine, depth: int = depth) -> Pass:
            return lambda: timed(lambda: pursue(engine, depth))

        contenders: dict[str, Pass] = {name: pursuing(engine) for name, engine in agents.items()}
        contenders["hand"] = lambda depth=depth: timed(lambda: hand.descend(depth))
        timing = take_turns(contenders, depth, scale.passes)
        found = compared(timing)
        for name in list(agents)[1:]:
            found[f"{name}_rate"] = timing.rate(name)
            found[f"{name}_ratio"] = timing.ratio(name, of="hand")
        figures |= found | {f"{key}_{depth}": value for key, value in found.items()}
    shallow, deep = (peak_kib(agents["engine"], depth) for depth in (1_000, scale.depths[0]))
    return {**figures, "peak_kib_1000": shallow, f"peak_kib_{scale.depths[0]}": deep, "growth_kib": deep - shallow}


def ring(scale: Scale) -> Figures:
    """W4: agents in a ring forward tokens."""
    figures: Figures = {}
    for size, tokens in scale.rings:
        hops = scale.events // tokens
        contenders: dict[str, Pass] = {
            "engine": _ring(size, tokens, hops, text=False),
            "agentspeak": _ring(size, tokens, hops, text=True),
            "hand": _hand_ring(size, tokens, hops),
        }
        timing = take_turns(contenders, tokens * hops, scale.passes)
        found = compared(timing)
        found |= {
            "agentspeak_rate": timing.rate("agentspeak"),
            "agentspeak_ratio": timing.ratio("agentspeak", of="hand"),
        }
        figures |= {f"{key}_{size}_{tokens}": value for key, value in found.items()}
        if (size, tokens) == (1_000, 1):
            figures |= found
    return figures


def texts(scale: Scale) -> Figures:
    """W5: parsing and adding distinct AgentSpeak plans."""
    number, turn = scale.texts, [0]

    def adding(*, eagerly: bool) -> Pass:
        def once() -> int:
            engine = programs.agent()
            plans = programs.plan_texts(number, turn[0])
            turn[0] += number

            def work() -> None:
                for text in plans:
                    engine.add_text(text)
                if eagerly:
                    for trigger in engine.library.triggers.values():
                        for plan in trigger.plans:
                            plan.compile()

            took = timed(work)
            assert len(list(engine.library)) == number
            return took

        return once

    timing = take_turns({"lazily": adding(eagerly=False), "eagerly": adding(eagerly=True)}, number, scale.passes)
    return {"engine_rate": timing.rate("lazily"), "eager_rate": timing.rate("eagerly")}


# Parts


def compared(timing: Timing, name: str = "", suffix: str | None = None) -> Figures:
    """Return the rates of the engine and of the hand-written loop, and their ratio."""
    contender = f"_{name}" if name else ""
    suffix = contender if suffix is None else suffix
    return {
        f"engine_rate{suffix}": timing.rate(f"engine{contender}"),
        f"hand_rate{suffix}": timing.rate(f"hand{contender}"),
        f"ratio{suffix}": timing.ratio(f"engine{contender}", of=f"hand{contender}"),
    }


def post(engine: Engine, beliefs: Sequence[Belief]) -> int:
    """Post beliefs one by one and run the engine; return the processor time (ns)."""

    def work() -> None:
        believe, run = engine.believe, engine.run_until_idle
        for belief in beliefs:
            believe(belief)
            run()

    before = engine.robot.count
    took = timed(work)
    assert engine.robot.count == before + len(beliefs), (engine.robot.count - before, len(beliefs))
    return took


def pursue(engine: Engine, depth: int) -> None:
    """Pursue nested goals to their end."""
    engine.achieve(programs.count(depth))
    while engine.run_until_idle():
        pass


def peak_kib(engine: Engine, depth: int) -> float:
    """Return the peak memory (KiB) of Python objects allocated while goals are pursued."""
    gc.collect()
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        pursue(engine, depth)
        return (tracemalloc.get_traced_memory()[1] - before) / 1024
    finally:
        tracemalloc.stop()


def _posting(engine: Engine, beliefs: list[Belief]) -> Pass:
    return lambda: post(engine, beliefs)


def _reacting(agent: hand.Hand, facts: list[hand.Fact]) -> Pass:
    return lambda: timed(lambda: hand.react(agent, facts))


def _post_new(engine: Engine, units: int) -> None:
    believe, run, person = engine.believe, engine.run_until_idle, programs.person
    for _ in range(units):
        believe(person("yes"))
        run()


def _react_new(agent: hand.Hand, units: int) -> None:
    yes = "".join(["y", "es"])
    for _ in range(units):
        agent.add(("person", yes))
        agent.run()


def _hand_ring(size: int, tokens: int, hops: int) -> Pass:
    agents = hand.Ring(size)

    def once() -> int:
        agents.hops = 0
        took = timed(lambda: agents.run(tokens, hops))
        assert agents.hops == tokens * hops
        return took

    return once


def _ring(size: int, tokens: int, hops: int, *, text: bool) -> Pass:
    from socialbot.bdi.society import Society

    society, clock = Society(WallClock()), WallClock()
    model = programs.agent(text=programs.RING_TEXT) if text else programs.agent(programs.ring_rule())
    agents = [Engine(f"a{i}", clock, library=model.library) for i in range(size)]
    for i, engine in enumerate(agents):
        society.add(engine)
        name = f"a{(i + 1) % size}"
        engine.believe(programs.nxt(Atom(name) if text else name))
    _settle(society.run_until_idle)

    def once() -> int:
        def work() -> None:
            for k in range(tokens):
                agents[k % size].believe(programs.token(k, hops))
            _settle(society.run_until_idle)

        took = timed(work)
        for k in range(tokens):
            # The last agent shows that all hops are done.
            assert programs.token(k, 0) in agents[(k + hops) % size].beliefs
            agents[(k + hops) % size].forget(programs.token(k, 0))
        _settle(society.run_until_idle)
        return took

    return once


def _settle(run: Callable[[], bool | None]) -> None:
    while run():
        pass


WORKLOADS: dict[str, Callable[[Scale], Figures]] = {
    "W1": react,
    "W2a": select,
    "W2b": join,
    "W3": descend,
    "W4": ring,
    "W5": texts,
}
"""Workloads by their names on the command line; W6 and the latencies are in `evaluation.engine_host`."""
