from __future__ import annotations

import threading
import time

import pytest

from socialbot.bdi import Engine, send
from socialbot.bdi.literals import literal
from socialbot.bdi.society import Society
from socialbot.core.clock import SECOND, ManualClock, WallClock
from socialbot.core.errors import RuleError
from tests.bdi.lab import X, do, go, p, ping
from tests.bdi.mas import Mas

RING = "+token(N) : N > 0 & next(A) <- -token(N)[source(_)]; .send(A, tell, token(N - 1)). "


def test_a_token_circulates():
    names = [f"a{i}" for i in range(5)]
    mas = Mas(**{name: RING + f"next({names[(i + 1) % 5]})." for i, name in enumerate(names)})
    mas.a0.believe(literal("token", (12,)))
    mas.until(0)
    assert [name for name in names if "token(0)" in mas.beliefs(name)] == ["a2"]


def ring(size: int, hops: int) -> tuple[Society, dict[str, int]]:
    """Agents that hand a token on; counts how often each has its turn."""
    turns: dict[str, int] = {}
    mas = Mas(**{f"a{i}": RING + f"next(a{(i + 1) % size})." for i in range(size)})
    mas.until(0)

    class Counted(Engine):
        __slots__ = ()

        def run_until_idle(self, budget: int = 10_000) -> bool:
            turns[self.name] = turns.get(self.name, 0) + 1
            return super().run_until_idle(budget)

    for engine in mas.society.agents.values():
        engine.__class__ = Counted
    mas.a0.believe(literal("token", (hops,)))
    mas.until(0)
    return mas.society, turns


def test_only_agents_that_have_something_to_do_have_turns():
    _, turns = ring(100, 10)
    assert turns == {f"a{i}": 1 for i in range(11)}


def test_the_budget_bounds_the_turns():
    mas = Mas(a="!g. +!g <- .send(b, tell, x(1)); !g.", b="+x(X) <- -x(X)[source(_)].")
    assert mas.society.run_until_idle(10)
    assert mas.society.run_until_idle(10)


def test_an_agent_that_never_rests_leaves_others_their_turn():
    mas = Mas(a="!g. +!g <- +x; -x; !g.", b="!h(0). +!h(N) : N < 20 <- !h(N + 1). +!h(N) <- .print(N).")
    mas.society.run_until_idle(40)
    assert mas.lines == ["20"]


LOOPS = {
    "last goal": "!l(0). +!l(X) : not stop <- .print(X); .send(b, tell, y(X)); !l(X + 1). +!l(X).",
    "last goal with a failure plan": (
        "!l(0). +!l(X) : not stop <- .print(X); .send(b, tell, y(X)); !l(X + 1). -!l(X) <- .print(failed)."
    ),
    "new intention": "!l(0). +!l(X) : not stop <- .print(X); .send(b, tell, y(X)); !!l(X + 1). +!l(X).",
    "plans of one goal": (
        "!l(0). +!l(X) <- !m(X). +!m(X) : not stop <- .print(X); .send(b, tell, y(X)); !l(X + 1). +!m(X)."
    ),
    "broadcast": "!l(0). +!l(X) : not stop <- .print(X); .broadcast(tell, y(X)); !l(X + 1). +!l(X).",
    "achieve": "!l(0). +!l(X) : not stop <- .print(X); .send(b, achieve, y(X)); !l(X + 1). +!l(X).",
    "while": "!l. +!l <- +n(0); while (n(X) & not stop) { .print(X); .send(b, tell, y(X)); -+n(X + 1) }.",
}


@pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS.keys())
def test_an_agent_in_a_loop_is_not_ahead_of_the_agent_that_it_writes_to(loop: str):
    mas = Mas(a=loop, b="+y(0) <- .send(a, tell, stop). +!y(0) <- .send(a, tell, stop). +!y(X).")
    assert len(mas.until(1).lines) <= 10


def test_agents_in_loops_are_equally_fast():
    count = "!c(0). +!c(X) <- -+n(X); !c(X + 1)."
    mas = Mas(a=count, b=count)
    mas.society.run_until_idle(100)
    a, b = (next(agent.query(literal("n", (X,))))["X"] for agent in (mas.a, mas.b))
    assert abs(a - b) <= 10 < a


def test_names_are_taken_once():
    society = Society(ManualClock())
    society.add("a")
    with pytest.raises(RuleError, match="agent name a"):
        society.add("a")
    with pytest.raises(RuleError, match="in another society"):
        Society(ManualClock()).add(society.agents["a"])


@pytest.mark.parametrize("name", ["self", "percept"])
def test_no_agent_is_named_after_an_own_source_of_beliefs(name):
    """What it says would count as a conclusion or a percept of the receiver."""
    society = Society(ManualClock())
    with pytest.raises(RuleError, match=f"no agent can be named {name}"):
        society.add(name)
    assert not society.agents


def test_removed_agent_receives_nothing():
    mas = Mas(
        a="!g. +!g <- .wait(10); .send(b, tell, x(1)). -!g[error_msg(M)] <- .print(M).",
        b="!h. +!h <- .wait(5); .print(h).",
    )
    mas.society.run_until_idle()
    gone = mas.society.remove("b")
    assert gone is not None
    mas.until(1)
    assert mas.lines == ["there is no agent b"]
    assert mas.society.remove("b") is None
    mas.society.add(gone)
    mas.until(1)
    assert mas.lines == ["there is no agent b", "h"]


def test_timers_of_all_agents_are_due_in_their_order():
    mas = Mas(**{f"a{i}": f"!g. +!g <- .wait({delay}); .print({i}); .wait(40); .print(again{i})."
                 for i, delay in enumerate((30, 10, 20))})  # fmt: skip
    mas.society.run_until_idle()
    assert mas.society.next_wakeup() == 10_000_000
    assert mas.until(1).lines == ["1", "2", "0", "again1", "again2", "again0"]
    assert mas.society.next_wakeup() is None


def test_the_host_is_woken_by_posts_from_outside():
    woken = []
    society = Society(ManualClock(), wake=lambda: woken.append(1))
    engine = society.add("a")
    society.run_until_idle()
    engine.believe(p(1))
    engine.believe(p(2))
    assert woken == [1]
    society.run_until_idle()
    assert len(engine.beliefs) == 2
    engine.believe(p(3))
    assert woken == [1, 1]


def test_agents_of_one_library_share_no_state():
    from socialbot.bdi.agentspeak import parse
    from socialbot.bdi.agentspeak.loading import begin, library_of

    program = parse("n(0). !g. +!g : .my_name(N) <- -+n(N).")
    library, society = library_of(program), Society(ManualClock())
    for name in ("a", "b"):
        begin(society.add(Engine(name, society.clock, library=library)), program)
    society.run_until_idle()
    assert [str(held.belief) for agent in society.agents.values() for held in agent.beliefs] == ["n(a)", "n(b)"]


# By the computer's clock


class Running:
    """A society that runs in a thread."""

    def __init__(self, **run) -> None:
        self.society = Society(WallClock())
        self.noted: list[object] = []
        self.arrived = threading.Event()
        self.thread = threading.Thread(target=lambda: self.society.run(**run))

    def add(self, name: str, *rules, text: str = "") -> Engine:
        engine = Engine(name, self.society.clock, robot=self)
        engine.add_rules(*rules)
        engine.out = self.note
        if text:
            engine.add_text(text)
        return self.society.add(engine)

    def note(self, what) -> None:
        self.noted.append(what)
        if what == "last":
            self.arrived.set()

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.society.stop()
        self.thread.join(60)
        assert not self.thread.is_alive()


def test_a_running_society_wakes_on_posts_from_any_thread(waits):
    running = Running()
    engine = running.add("a", +ping() >> [send("b", p("last"))])
    running.add("b", +p(X) >> [do(X)])
    with running:
        waits.get(timeout=60)
        engine.believe(ping())
        assert running.arrived.wait(60)


def test_an_idle_running_society_sleeps_until_the_next_timer(waits):
    running = Running()
    running.add("a", text="!g. +!g <- .wait(100000).")
    engine = running.add("b", go() >> [do("last")])
    with running:
        assert waits.get(timeout=60) > 90
        engine.achieve(go())
        assert running.arrived.wait(60)
        assert waits.get(timeout=60) > 90
    assert waits.empty()


def test_posts_from_many_threads_all_arrive():
    running = Running()
    engine = running.add("a", +p(X) >> [do(X)])
    with running:
        threads = [threading.Thread(target=lambda k=k: [engine.believe(p(k * 100 + i)) for i in range(100)])
                   for k in range(5)]  # fmt: skip
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        engine.believe(p("last"))
        assert running.arrived.wait(60)
    assert sorted(map(str, running.noted)) == sorted([*map(str, range(500)), "last"])


def test_a_society_that_does_not_linger_ends_when_nothing_is_left_to_do():
    running = Running(linger=False)
    running.add("a", text='!g. +!g <- .wait(20); .send(b, tell, x("last")).')
    running.add("b", text="+x(X) <- .wait(10); .print(X).")
    running.thread.start()
    running.thread.join(60)
    assert not running.thread.is_alive()
    assert running.noted == ["last"]


def test_a_society_runs_for_some_seconds_at_most():
    running = Running(linger=False, seconds=0.05)
    running.add("a", text="!g. +!g <- +x; -x; !g.")
    running.add("b", text="!g. +!g <- .wait(100000).")
    begun = time.monotonic()
    running.thread.start()
    running.thread.join(60)
    assert not running.thread.is_alive()
    assert time.monotonic() - begun > 0.04


@pytest.mark.parametrize("step", [".stopMAS", ".stopMAS(20)", ".stop"])
def test_an_agent_ends_the_running_of_all(step):
    running = Running()
    running.add("a", text=f"!g. +!g <- .wait(10); {step}; .print(x); .wait(1000); .print(never).")
    running.add("b", text="!g. +!g <- .wait(100000).")
    running.thread.start()
    running.thread.join(60)
    assert not running.thread.is_alive()
    assert running.noted == ["x"]


def test_loops_end_with_the_society():
    running = Running()
    running.add("a", text="!l(0). +!l(X) : X < 10000 <- .print(X); .send(b, tell, y(X)); !l(X + 1).")
    running.add("b", text="+y(20) <- .stopMAS.")
    assert running.society.run()
    assert len(running.noted) <= 40


def test_the_loop_of_a_single_agent_ends_with_the_society():
    running = Running()
    running.add("a", text="!l(0). +!l(20) <- .stopMAS; !l(21). +!l(X) : X < 10000 <- .print(X); !l(X + 1).")
    assert running.society.run()
    assert len(running.noted) <= 24


def test_now_is_the_time_of_the_society():
    mas = Mas(a="!g. +!g <- .wait(1500); .print(system.time).")
    assert mas.until(2).lines == ["1500"]
    assert mas.clock.now() == 2 * SECOND


def test_agents_begin_together():
    clock = WallClock()
    society = Society(clock)
    said: list[str] = []
    for name, text in {
        "ann": '!register. !search. +!register <- .df_register("a"). +!search <- .df_search("b", L); .print(L).',
        "bob": '!register. +!register <- .df_register("b").',
    }.items():
        engine = society.add(Engine(name, clock))
        engine.out = said.append
        engine.add_text(text)
    society.run(linger=False)
    assert said == ["[bob]"]
