"""Actions in threads, and coroutines."""
# ruff: noqa: N801 - actions are written as agents write them

from __future__ import annotations

import asyncio
import gc
import threading
import warnings
from typing import Any

import pytest

from socialbot.bdi import Action, Engine, ThreadAction, action, error, first_of, wait
from socialbot.bdi.durative_actions import IDLE_S, Pool
from socialbot.bdi.intentions import PlanFailed
from socialbot.bdi.terms import Atom, Variable
from socialbot.core.clock import ManualClock
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, X, do, ends, go, p, q, sub
from tests.system.running import eventually

E = Variable("E")


class Threads(Lab):
    """A lab whose actions run in threads; ``settle`` runs it until a condition holds."""

    def __init__(self, *rules: Any, **more: Any) -> None:
        super().__init__(*rules, **more)
        self.posted = threading.Event()
        self.engine.wake = self.posted.set
        self.gate = threading.Event()
        self.begun = threading.Semaphore(0)

    def settle(self, so) -> None:
        for _ in range(200):
            self.posted.clear()
            self.engine.run_until_idle()
            if so():
                return
            assert self.posted.wait(60), "nothing comes"
        raise AssertionError("it never came so")


class block(ThreadAction):
    """Waits for the gate, or for being cancelled."""

    def execute(self, what: str = "x") -> object:
        lab = self.engine.robot
        lab.begun.release()
        while not lab.gate.wait(0.001):
            if self.cancelling.is_set():
                return None
        if what == "raise":
            raise OSError("broken")
        self.progress(0.5, threading.current_thread().name)
        return what != "false"


class TestThreads:
    def test_the_plan_continues_in_the_thread_of_the_engine_after_the_action(self):
        lab = Threads(go() >> [block(), do("done")], +p(X) >> [do("meanwhile")])
        lab.tell(go())
        assert lab.begun.acquire(timeout=60)
        lab.tell(+p(1))
        assert lab.done == ["meanwhile"]
        lab.gate.set()
        lab.settle(lambda: "done" in lab.done)
        assert ends(lab) == [("block()", "finished")]
        (progress,) = [record for record in lab.trace if record.kind == "progress"]
        assert progress.detail == {"fraction": 0.5, "text": "socialbot-action"}

    @pytest.mark.parametrize(("what", "reason"), [("raise", "exception"), ("false", "action_failed")])
    def test_an_exception_and_false_fail_the_goal(self, what, reason):
        lab = Threads(go() >> [block(what), do("done")], -go()[error(E)] >> [do(E)])
        lab.gate.set()
        lab.tell(go())
        lab.settle(lambda: lab.done)
        assert lab.done == [Atom(reason)]

    def test_a_time_limit_asks_it_to_stop_and_waits_until_it_has(self):
        lab = Threads(go() >> [block().within(1)], -go()[error(E)] >> [do(E)])
        lab.tell(go())
        assert lab.begun.acquire(timeout=60)
        lab.clock.advance(1)
        lab.settle(lambda: lab.done)
        assert lab.done == [Atom("timeout")]
        assert ends(lab) == [("block()", "cancelled")]

    def test_no_more_than_the_pool_allows_run_at_a_time(self):
        lab = Threads(go(X) >> [block(), do(X)])
        lab.engine.interpreter.pool = Pool(2)
        lab.tell(*(go(n) for n in range(5)))
        assert lab.begun.acquire(timeout=60)
        assert lab.begun.acquire(timeout=60)
        assert not lab.begun.acquire(timeout=0.02)
        lab.gate.set()
        lab.settle(lambda: len(lab.done) == 5)
        assert sorted(lab.done) == [0, 1, 2, 3, 4]

    def test_one_that_no_thread_has_begun_stops_at_once_and_never_begins(self):
        lab = Threads(go() >> [block()], sub() >> [block().within(1), do("no")], -sub() >> [do("late")])
        lab.engine.interpreter.pool = Pool(1)
        lab.tell(go(), sub())
        assert lab.begun.acquire(timeout=60)
        lab.clock.advance(1)
        lab.engine.run_until_idle()
        assert lab.done == ["late"]
        lab.gate.set()
        lab.settle(lambda: not lab.engine.intentions)
        assert not lab.begun.acquire(blocking=False)

    def test_a_dropped_one_that_returns_late_is_harmless(self):
        lab = Threads(go() >> [block(), do("no")])
        lab.tell(go())
        assert lab.begun.acquire(timeout=60)
        lab.engine.intentions.drop(next(iter(lab.engine.intentions)))
        lab.settle(lambda: lab.kinds("dropped"))
        assert lab.done == []
        assert ends(lab) == [("block()", "cancelled")]

    def test_closing_the_pool_ends_its_threads(self):
        lab = Threads(go() >> [block(), do("done")])
        lab.gate.set()
        lab.tell(go())
        lab.settle(lambda: lab.done)
        pool = lab.engine.interpreter.pool
        assert pool is not None
        pool.close()
        assert eventually(lambda: pool._threads == 0)
        with pytest.raises(PlanFailed, match="closed"):
            pool.submit(lambda: None)

    def test_a_running_engine_ends_its_threads(self):
        from socialbot.core.clock import WallClock

        done = threading.Event()

        @action
        def finish(engine: Engine) -> None:
            done.set()

        lab = Threads()
        engine = Engine("live", WallClock(), robot=lab)
        lab.gate.set()
        engine.add_rules(go() >> [block(), finish()])
        thread = threading.Thread(target=engine.run)
        thread.start()
        engine.achieve(go())
        assert done.wait(60)
        engine.stop()
        thread.join(60)
        pool = engine.interpreter.pool
        assert pool is not None
        assert eventually(lambda: pool._threads == 0)

    def test_an_agent_without_such_actions_has_no_threads(self):
        lab = Lab(go() >> [do("done")])
        lab.tell(go())
        assert lab.engine.interpreter.pool is None
        assert IDLE_S > 0

    def test_a_pool_of_no_threads_is_refused(self):
        with pytest.raises(RuleError, match="0 threads"):
            Pool(0)

    def test_async_execute_in_a_thread_fails_with_a_reason(self):
        class odd(ThreadAction):
            async def execute(self):  # type: ignore[override]
                pass

        lab = Threads(go() >> [odd()], -go() >> [do("failed")])
        lab.tell(go())
        lab.settle(lambda: lab.done)
        assert any("make it an Action" in str(record.detail.get("message")) for record in lab.trace)


class fetch(Action):
    async def execute(self, what: str) -> object:
        lab = self.engine.robot
        lab.begun.release()
        await asyncio.sleep(0)
        if what == "raise":
            raise OSError("broken")
        if what == "rest":
            try:
                await asyncio.Event().wait()
            finally:
                lab.gate.set()
        return what != "false"


@action
async def ask_web(engine: Engine, what: str) -> None:
    await asyncio.sleep(0)
    engine.believe(q(what))


class TestCoroutines:
    def test_the_plan_continues_after_a_coroutine(self):
        lab = Threads(go() >> [fetch("x"), ask_web("y"), do("done")])
        lab.tell(go())
        lab.settle(lambda: lab.done)
        assert 'q("y")' in lab.beliefs
        assert ends(lab) == [("fetch", "finished"), ("ask_web", "finished")]
        actions = [record.id for record in lab.trace if record.kind == "action"]
        assert [record.cause for record in lab.trace if record.kind == "action_end"] == actions[:2]

    @pytest.mark.parametrize(("what", "reason"), [("raise", "exception"), ("false", "action_failed")])
    def test_an_exception_and_false_fail_the_goal(self, what, reason):
        lab = Threads(go() >> [fetch(what), do("done")], -go()[error(E)] >> [do(E)])
        lab.tell(go())
        lab.settle(lambda: lab.done)
        assert lab.done == [Atom(reason)]

    def test_it_is_cancelled_and_waited_for(self):
        lab = Threads(go() >> [first_of([fetch("rest")], [wait(1)]), do("after")])
        lab.tell(go())
        assert lab.begun.acquire(timeout=60)
        lab.clock.advance(1)
        lab.settle(lambda: lab.done)
        assert lab.gate.is_set()
        assert lab.done == ["after"]
        assert ends(lab) == [("fetch", "cancelled")]

    def test_all_of_them_run_in_one_thread(self):
        seen: set[int] = set()

        @action
        async def look(engine: Engine) -> None:
            seen.add(threading.get_ident())

        labs = [Threads(go() >> [look(), do("done")]) for _ in range(3)]
        for lab in labs:
            lab.tell(go())
        for lab in labs:
            lab.settle(lambda lab=lab: lab.done)
        assert len(seen) == 1
        assert threading.get_ident() not in seen

    def test_one_that_was_never_begun_leaves_no_warning(self):
        engine = Engine("a", ManualClock())
        engine.add_rules(go() >> [ask_web("x")])
        engine.achieve(go())
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            engine.run_until_idle(1)
            for intention in list(engine.intentions):
                engine.intentions.drop(intention)
            gc.collect()
        assert engine.mind().intentions == ()
