"""Workloads of plan bodies: queued events, goals with values, loops, failures and chains of goals."""

from __future__ import annotations

from collections.abc import Callable

from evaluation import engine_hand as hand
from evaluation import engine_programs as programs
from evaluation.engine_rows import Job, Row
from evaluation.engine_workloads import Scale, timed
from socialbot.bdi import Engine

BURST_TEXT = "ready(yes). +person(P) : ready(yes) <- -person(P); tick."
FIB_TEXT = """
+!fib(N, F) : N < 2 <- F = N.
+!fib(N, F) <- !fib(N-1, A); !fib(N-2, B); F = A + B.
"""
SUM_TEXT = """
+!total <- -+acc(0); for (item(_, V)) { ?acc(S); -+acc(S+V) }; tick.
"""
RETRY_TEXT = """
+!serve(N) : N > 0 <- !bring(N); tick; !serve(N-1).
+!serve(0).
+!bring(N) <- !grasp(N).
-!bring(N) <- tick.
+!grasp(N) <- ?full(N).
"""


# Queued events


def burst(pending: int, *, text: bool = False) -> Callable[[Scale], Job]:
    """W1 with several events pending: each is a new belief that its plan removes before it acts."""

    def job(scale: Scale) -> Job:
        rounds = max(1, scale.events // pending)
        facts = [("person", f"p{i}") for i in range(pending)]
        yardstick = hand.reacting_to_any("person")
        if text:
            engine = programs.agent(text=BURST_TEXT)
        else:
            engine = programs.ready_agent(programs.burst_rule())
        beliefs = [programs.person(name) for _, name in facts]

        def react() -> None:
            believe, run = engine.believe, engine.run_until_idle
            for _ in range(rounds):
                for belief in beliefs:
                    believe(belief)
                run()

        def react_by_hand() -> None:
            add, run = yardstick.add, yardstick.run
            for _ in range(rounds):
                for fact in facts:
                    add(fact)
                run()

        units = rounds * pending
        return Job(units, _counting(engine, react, units), _counting_by_hand(yardstick, react_by_hand, units))

    return job


# Goals


def fib(scale: Scale) -> Job:
    """Goals that return values: a plan calls two goals and adds their results."""
    number = 18 if scale.events >= 10_000 else 7
    engine = programs.agent(text=FIB_TEXT + "+!start(N) <- !fib(N, F); result(F).")
    found: list[int] = []
    engine.add_action(lambda _, value: found.append(value), "result")
    expected, calls = hand.fib(number)

    def work() -> None:
        engine.achieve(programs.start(number))
        while engine.run_until_idle():
            pass

    def once() -> int:
        took = timed(work)
        assert found.pop() == expected
        return took

    return Job(calls, once, lambda: timed(lambda: hand.fib(number)))


def loop(scale: Scale) -> Job:
    """``for`` with a question and a replaced belief in its body."""
    items = min(1_000, scale.events)
    engine = programs.agent(text=SUM_TEXT + " ".join(f"item({i}, {i % 7})." for i in range(items)))
    rounds = max(1, scale.events // items // 5)
    expected = sum(i % 7 for i in range(items))
    yardstick = hand.Sum([(i, i % 7) for i in range(items)])

    def work() -> None:
        for _ in range(rounds):
            engine.achieve(programs.total())
            while engine.run_until_idle():
                pass

    def check_engine() -> int:
        took = _counting(engine, work, rounds)()
        assert programs.acc(expected) in engine.beliefs
        return took

    def by_hand() -> None:
        for _ in range(rounds):
            yardstick.total()

    def check_hand() -> int:
        took = timed(by_hand)
        assert list(yardstick.facts["acc"]) == [(expected,)]
        return took

    return Job(rounds * items, check_engine, check_hand)


def failures(scale: Scale) -> Job:
    """A goal fails in the plan of its subgoal, and its failure plan handles it."""
    number = max(1, scale.events // 5)
    engine = programs.agent(text=RETRY_TEXT)

    def work() -> None:
        engine.achieve(programs.serve(number))
        while engine.run_until_idle():
            pass

    def by_hand() -> int:
        def once() -> None:
            assert hand.serve(number) == 2 * number

        return timed(once)

    return Job(number, _counting(engine, work, 2 * number), by_hand)


def chain(scale: Scale) -> Job:
    """Goals in a chain, each followed by a step."""
    depth = 1_000
    rounds = max(1, scale.events // depth)
    engine = programs.agent(*programs.count_rules(stacked=True))

    def work() -> None:
        for _ in range(rounds):
            engine.achieve(programs.count(depth))
            while engine.run_until_idle():
                pass

    def by_hand() -> None:
        for _ in range(rounds):
            hand.descend(depth)

    return Job(rounds * depth, _counting(engine, work, rounds * depth), lambda: timed(by_hand))


def _counting(engine: Engine, work: Callable[[], None], ticks: int) -> Callable[[], int]:
    """Return a pass of the engine that checks its number of ticks."""

    def once() -> int:
        before = engine.robot.count
        took = timed(work)
        assert engine.robot.count == before + ticks, (engine.robot.count - before, ticks)
        return took

    return once


def _counting_by_hand(agent: hand.Hand, work: Callable[[], None], ticks: int) -> Callable[[], int]:
    def once() -> int:
        before = agent.count
        took = timed(work)
        assert agent.count == before + ticks
        return took

    return once


BODIES: dict[str, tuple[Row, ...]] = {
    "bursts": (
        *(
            Row(
                f"{pending}", f"{pending} events pending: condition, removal, action", burst(pending),
                0.45 if pending == 1 else 0.40, 0.7,
            )
            for pending in (1, 2, 10, 100)
        ),
        Row("agentspeak_100", "100 events pending, plan in AgentSpeak", burst(100, text=True)),
    ),
    "fib": (Row("fib", "goals that return values: fib(18)", fib, 0.30, 0.5),),
    "loop": (Row("loop", "for with ?acc(S) and -+acc(S+V)", loop, 0.15, 0.5),),
    "failures": (Row("failures", "goal that fails below and is handled", failures, 0.15, 0.5),),
    "chain": (Row("chain", "goals 1000 deep, a step after each", chain, 0.40, 0.7),),
}  # fmt: skip
"""Rows by the name of their workload on the command line."""
