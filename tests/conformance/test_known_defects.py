"""Mistakes that engines of this kind make, each with a test that ours does not. The docstrings tell what goes wrong."""
# ruff: noqa: N801, N803 - beliefs, goals and actions are written as agents write them, functions name variables

from __future__ import annotations

import gc
import sys
import threading
import time

from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Action, Belief, Engine, Goal, Library, Plan, variables
from socialbot.bdi.agentspeak import parse_literal
from socialbot.bdi.compiler import _runtime as runtime
from socialbot.bdi.compiler import _source as source
from socialbot.bdi.engine import Engine as AnyEngine
from socialbot.bdi.society import Society
from socialbot.core.clock import SECOND, ManualClock, WallClock

X, Y, N = variables("X Y N")


class p(Belief): ...


class q(Belief): ...


class seen(Belief): ...


class go(Goal): ...


class count(Goal): ...


class note(Action):
    def execute(self, *what: object) -> None:
        self.engine.robot.append(what[0] if len(what) == 1 else what)


class crash(Action):
    def execute(self) -> None:
        raise ZeroDivisionError("on purpose")


def agent(*rules: Plan, name: str = "me", text: str = "", library: Library | None = None) -> AnyEngine:
    engine = Engine(name, ManualClock(), robot=[], library=library)
    engine.add_rules(*rules)
    engine.add_action(note)
    engine.add_action(crash)
    if text:
        engine.add_text(text)
    return engine


def think(engine: AnyEngine) -> list[object]:
    assert not engine.run_until_idle(1_000_000)
    return engine.robot


@given(st.lists(st.integers(0, 9), unique=True, max_size=6))
@settings(max_examples=30, deadline=None)
def test_a_loop_ignores_beliefs_that_its_body_adds(numbers):
    """`for (b(X)) { +b(X+10) }` never ends, skips beliefs, or stops with "changed size during iteration"."""
    engine = agent(text="+!go <- for (b(X)) { +b(X + 10); note(X) }.")
    engine.add_text(" ".join(f"b({number})." for number in numbers))
    engine.add_text("!go.")
    assert sorted(map(int, think(engine))) == sorted(numbers)  # type: ignore[call-overload]
    assert len(engine.beliefs) == 2 * len(numbers)


def test_plans_added_at_run_time_find_registered_actions():
    """A plan from `.add_plan` or `tellHow` is compiled against the built-in actions only."""
    society = Society(ManualClock())
    one, two = society.add("one"), society.add("two")
    two.robot = []
    two.add_action(note)
    one.add_text("""
        !go.
        +!go <- .send(two, tellHow, {+!sub(X) <- note(X)}); .send(two, achieve, sub(1)).
    """)
    two.add_text("!learn. +!learn <- .add_plan({+!other(X) <- note(X)}); !other(2).")
    assert not society.run_until_idle()
    assert sorted(two.robot) == [1, 2]


def test_agents_in_threads_keep_their_variables_apart():
    """Variables bound in a global table, or in the shared condition objects of a rule, are those of another agent
    when two agents run in two threads.
    """
    library = Library(
        +p(X, Y) / ((lambda X, Y: X == Y) & seen(X) & (Y >= X)) >> [+q(X, Y)],
        +p(X, Y) >> [+q(X, Y), note("missed")],
    )
    rounds = 4_000
    done: dict[int, AnyEngine] = {}
    interval = sys.getswitchinterval()

    def run(offset: int) -> None:
        engine = agent(name=f"agent{offset}", library=library)
        for number in range(offset, offset + rounds):
            engine.believe(seen(number))
            engine.believe(p(number, number))
            engine.run_until_idle(1000)
        done[offset] = engine

    threads = [threading.Thread(target=run, args=(offset,)) for offset in (0, 1_000_000)]
    sys.setswitchinterval(1e-5)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    for offset, engine in done.items():
        assert engine.robot == []
        assert {held.belief.args for held in engine.beliefs if held.belief.functor == "q"} == {
            (number, number) for number in range(offset, offset + rounds)
        }


def test_a_ring_of_agents_loses_no_message():
    """A mailbox with one message per name, or a merge of equal beliefs, would lose tokens."""
    agents, tokens, laps = 300, 300, 3
    society = Society(ManualClock())
    for number in range(agents):
        engine = society.add(f"a{number}")
        engine.robot = []
        engine.add_action(note)
        engine.add_text(f"""
            +!token(T, 0) <- note(T).
            +!token(T, N) <- .send(a{(number + 1) % agents}, achieve, token(T, N - 1)).
        """)
    for token in range(tokens):
        society.agents[f"a{token % agents}"].achieve(parse_literal(f"token({token}, {laps})"))
    while society.run_until_idle():
        pass
    arrived = [what for engine in society.agents.values() for what in engine.robot]
    assert sorted(arrived) == list(range(tokens))


def test_a_backlog_drains_in_linear_time():
    """Queues that are lists from which the first is taken, or looked through for each event, need the square of it."""

    def drain(events: int) -> float:
        engine = agent(+p(X) >> [+q(X)])
        for number in range(events):
            engine.believe(p(number))
        gc.collect()
        gc.disable()
        try:
            begin = time.process_time()
            engine.run_until_idle(10 * events)
            end = time.process_time()
        finally:
            gc.enable()
        assert len(engine.beliefs) == 2 * events
        return end - begin

    small = min(drain(5_000) for _ in range(3))
    assert min(drain(50_000) for _ in range(2)) < 20 * small


def test_variables_of_a_finished_plan_are_released():
    """The variables of plans stay in a global table, which grows; or the next plan finds them bound."""

    class Mark:
        pass

    def marks() -> int:
        gc.collect()
        return sum(isinstance(item, Mark) for item in gc.get_objects())

    engine = agent(go(X) / p(Y) >> [count(X, Y), note("done")], count(X, Y) >> [+q(X), -q(X)])
    engine.believe(p(1))
    think(engine)
    for _ in range(100):
        engine.achieve(go(Mark()))
        think(engine)
    assert len(engine.robot) == 100
    assert not engine.intentions
    assert marks() == 0
    assert not [name for name in vars(source) if name.startswith("v_")]
    assert not [name for name in runtime.NAMES if name.startswith("v_")]


def test_an_exception_in_an_action_stops_no_agent():
    """The exception goes through the reasoning cycle and ends the thread, and with it all agents."""
    society = Society(ManualClock())
    for name in ("one", "two"):
        engine = society.add(Engine(name, society.clock, robot=[]))
        engine.add_rules(
            go() >> [crash(), note("never")],
            +p(X) / (lambda X: 1 / X > 0) >> [note(X)],
            +p(X) >> [note("zero")],
        )
        engine.achieve(go())
        engine.believe(p(0))
        engine.believe(p(1))
    assert not society.run_until_idle()
    assert [engine.robot for engine in society.agents.values()] == [["zero", 1], ["zero", 1]]


def test_several_engines_run_in_one_process():
    """The engine is a module with global state, or a class that can be made once."""
    engines = [agent(+p(X) >> [note(X)], name=f"agent{number}") for number in range(50)]
    for number, engine in enumerate(engines):
        engine.believe(p(number))
    assert [think(engine) for engine in engines] == [[number] for number in range(50)]


def test_two_engines_may_have_different_plans_for_one_class():
    """Rules are kept with the class of the belief, so that all engines have all of them."""
    one, two = agent(+p(X) >> [note("one", X)]), agent(+p(X) >> [note("two", X)])
    for engine in (one, two):
        engine.believe(p(1))
    assert (think(one), think(two)) == ([("one", 1)], [("two", 1)])


def test_an_idle_agent_uses_no_processor_time():
    """The reasoning cycle goes round with a short sleep, or without one."""
    engine = Engine("idle", WallClock(), robot=[])
    engine.add_rules(+p(X) >> [note(X)])
    engine.believe(p(1))
    timer = threading.Timer(1.0, engine.stop)
    timer.start()
    begin = time.process_time()
    engine.run()
    used = time.process_time() - begin
    timer.join()
    assert engine.robot == [1]
    assert used < 0.02


def test_a_long_wait_blocks_no_other_intention():
    """`.wait` sleeps in the thread of the agent."""
    engine = agent(text="!a. !b. +!a <- .wait(3600000); note(a). +!b <- note(b).")
    assert [str(what) for what in think(engine)] == ["b"]
    engine.clock.advance(3600)  # type: ignore[attr-defined]
    think(engine)
    assert [str(what) for what in engine.robot] == ["b", "a"]
    assert engine.next_wakeup() is None
    assert engine.clock.now() == 3600 * SECOND


def test_cancelled_timers_are_removed():
    """Each timer stays until it rings, with the plan that set it: with a goal a second that may take a day, 86400."""
    engine = agent(
        +p(X).held_for(3600) >> [note("never")],
        text="""
            +!go <- !sub[within(3600)].
            +!sub <- .wait({+b}, 3600000).
            +!rest <- .wait(3600000).
            +!stop <- .drop_intention(rest).
        """,
    )
    for _ in range(500):
        for goal in ("go", "rest"):
            engine.achieve(parse_literal(goal))
        engine.believe(p(1))
        engine.run_until_idle()
        engine.believe(parse_literal("b"))  # type: ignore[arg-type]
        engine.forget(p(1))
        engine.forget(parse_literal("b"))  # type: ignore[arg-type]
        engine.achieve(parse_literal("stop"))
        engine.run_until_idle()
    assert not engine.intentions
    assert len(engine.timers.heap) <= 64


def test_waking_a_stopped_engine_is_harmless():
    """The wake-up pipe is closed; its descriptor may belong to another file by now."""
    engine = Engine("me", WallClock())
    woken: list[object] = []
    engine.call(lambda: woken.append(engine.wake))
    engine.call(engine.stop)
    engine.run()
    (ring,) = woken
    assert callable(ring)
    ring()
