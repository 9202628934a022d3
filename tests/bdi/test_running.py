import threading
import time

from socialbot.bdi import Engine, wait
from socialbot.core.clock import SECOND, WallClock
from tests.bdi.lab import Lab, X, Y, do, go, p, ping


class Live(Lab):
    """A lab that runs by itself in a thread, by the computer's clock."""

    def __init__(self, *rules) -> None:
        super().__init__()
        self.arrived = threading.Event()
        self.engine = Engine("live", WallClock(), robot=self, sink=self.trace.append)
        self.engine.add_rules(*rules)
        self.thread = threading.Thread(target=self.engine.run)

    def note(self, what) -> None:
        self.timeline.append((time.monotonic(), what))
        if what == "last":
            self.arrived.set()

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.engine.stop()
        self.thread.join(60)
        assert not self.thread.is_alive()


def test_the_running_engine_reacts_and_waits_by_the_clock():
    with Live(go() >> [do("first"), wait(0.05), do("last")]) as live:
        live.engine.achieve(go())
        assert live.arrived.wait(60)
    (began, _), (ended, _) = live.timeline
    assert ended - began >= 0.045


def test_an_idle_running_engine_sleeps_without_limit(waits):
    with Live(+p(X) >> [do("last")]) as live:
        assert waits.get(timeout=60) is None
        live.engine.believe(p(1))
        assert live.arrived.wait(60)
        assert waits.get(timeout=60) is None
    assert waits.empty()


def test_running_engine_raises_held_for_events():
    with Live(+p(X).held_for(0.05) >> [do("last")]) as live:
        live.engine.believe(p(1))
        assert live.arrived.wait(60)


def test_stop_ends_a_sleeping_and_a_busy_engine(waits):
    with Live():
        waits.get(timeout=60)
    with Live(go() >> [do("last"), go()]) as live:
        live.engine.achieve(go())
        assert live.arrived.wait(60)


def test_stop_ends_the_loop_of_an_agent_after_its_current_step():
    said: list[str] = []
    engine = Engine("loop", WallClock())
    engine.out = said.append
    engine.add_text("!l(0). +!l(20) <- .stopMAS; !l(21). +!l(X) : X < 10000 <- .print(X); !l(X + 1).")
    engine.run()
    assert len(said) < 50


def test_item_posted_just_before_sleep_wakes_the_engine():
    lab = Lab()
    engine = Engine("tired", WallClock(), robot=lab)
    engine.add_rules(+p(X) >> [do(X)])
    run_until_idle = engine.run_until_idle

    def post_when_idle(budget: int = 10_000) -> bool:
        left = run_until_idle(budget)
        if not list(engine.beliefs):
            engine.believe(p(1))
        return left

    engine.run_until_idle = post_when_idle
    thread = threading.Thread(target=engine.run, daemon=True)
    thread.start()
    deadline = time.monotonic() + 60
    while not lab.done and time.monotonic() < deadline:
        time.sleep(0.005)
    engine.stop()
    thread.join(60)
    assert lab.done == [1]


def test_stop_before_run_ends_it_at_once():
    live = Live()
    live.engine.stop()
    live.engine.run()


def test_no_post_of_many_threads_is_lost():
    lab = Lab(+ping(X, Y) >> [do(X, Y)])

    def post(thread):
        for number in range(250):
            lab.engine.believe(ping(thread, number))

    threads = [threading.Thread(target=post, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        lab.engine.run_until_idle()
    lab.engine.run_until_idle()
    assert len(lab.done) == 1000
    for number in range(4):
        assert [told for thread, told in lab.done if thread == number] == list(range(250))


def test_many_threads_wake_a_running_engine():
    with Live(+ping(X) / (X < 100) >> [do(X)], +ping(X) >> [do("last")]) as live:
        threads = [threading.Thread(target=live.engine.believe, args=(ping(n),)) for n in range(20)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        live.engine.believe(ping(100))
        assert live.arrived.wait(60)
    assert sorted(live.done[:-1]) == list(range(20))


def test_posting_wakes_the_host():
    woken = []
    lab = Lab()
    engine = Engine("hosted", lab.clock, wake=lambda: woken.append(1))
    engine.believe(p(1))
    engine.forget(p(1))
    engine.achieve(go())
    assert len(woken) == 1  # it knows until it has run
    engine.run_until_idle()
    engine.achieve(go())
    assert len(woken) == 2


def test_running_engine_also_calls_its_own_wake(waits):
    woken = threading.Event()
    engine = Engine("hosted", WallClock(), robot=Lab(), wake=woken.set)
    engine.add_rules(+p(X) >> [do(X)])
    thread = threading.Thread(target=engine.run, daemon=True)
    thread.start()
    waits.get(timeout=60)
    engine.believe(p(1))
    engine.stop()
    thread.join(60)
    assert not thread.is_alive()
    assert woken.is_set()


def test_the_next_wakeup_is_the_earliest_timer():
    lab = Lab(go(X) >> [wait(X)])
    assert lab.engine.next_wakeup() is None
    lab.tell(go(3), go(1), go(2))
    assert lab.engine.next_wakeup() == SECOND
    lab.until(1)
    assert lab.engine.next_wakeup() == 2 * SECOND
