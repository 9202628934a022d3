"""Soak test of the engine: memory and latencies under steady load, minute by minute.

``python -m evaluation.soak --minutes 30 --rate 10000`` posts this number of events a second from another thread to two
agents. They remember, join, pursue goals, fail and recover, wait, exchange messages and add and remove plans, with a
trace of the latest records. The command prints one line a minute.
"""
# ruff: noqa: D101, N801 - beliefs, goals and actions are written as agents write them

from __future__ import annotations

import gc
import logging
import random
import statistics
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

import typer

from evaluation.engine_host import rss_kib
from evaluation.report import JsonOption, Report, Value, percentile, run
from socialbot.bdi import Belief, Engine, Goal, PlanFailed, Reactor, Record, action, apart, ask, send, variables, wait
from socialbot.bdi.society import Society
from socialbot.core.clock import WallClock
from socialbot.core.errors import SocialbotError

GROWTH_LIMIT = 0.01
"""Limit for memory growth: slope of a line through the last two thirds of the samples."""

P99_LIMIT = 1.5
"""Limit for latency drift: median p99 of the last third of the minutes, relative to the first third."""

BEHIND_LIMIT_S = 1.0
"""Limit (s) for the backlog of posts and agents."""

BATCH_S = 0.001
PROBE_EVERY = 50
PEOPLE, ROOMS, TEXTS, RECORDS = 200, 20, 50, 10_000
MIB = 1024

MinutesOption = Annotated[float, typer.Option(min=0.05, help="Duration in minutes.")]
RateOption = Annotated[float, typer.Option(min=1, help="Events a second.")]

A, K, P, R, N, _ = variables("A K P R N _")


class seen(Belief): ...


class light(Belief): ...


class known(Belief): ...


class question(Belief): ...


class answer(Belief): ...


class probe(Reactor): ...


class greet(Goal): ...


class fetch(Goal): ...


class rest(Goal): ...


class consult(Goal): ...


@dataclass
class Deeds:
    """Counts of actions, and latencies of the probes."""

    counts: dict[str, int] = field(default_factory=dict)
    posted: dict[int, int] = field(default_factory=dict)
    took: list[int] = field(default_factory=list)


@action
def note(engine: Any, what: str) -> None:
    """Count an action."""
    counts = engine.robot.counts
    counts[what] = counts.get(what, 0) + 1


@action
def grasp(engine: Any, number: int) -> None:
    """Fail for every seventh number."""
    if number % 7 == 0:
        raise PlanFailed("it slipped")


@action
def arrive(engine: Any, number: int) -> None:
    """Record the time since a probe was posted."""
    deeds = engine.robot
    deeds.took.append(time.perf_counter_ns() - deeds.posted.pop(number))


RULES = [
    +probe(N) >> [arrive(N)],
    +seen(P, R) / (light(R, "on") & ~known(P)) >> [+known(P), apart(greet(P))],
    +seen(P, R) / light(R, "off") >> [-seen(P, R), note("dark")],
    -seen(P, R) / known(P) >> [-known(P), note("left")],
    +light(R, "on").held_for(0.5) >> [note("held")],
    greet(P) >> [ask(seen(P, R)), fetch(P), note("greeted")],
    -greet(P) >> [note("not greeted")],
    fetch(K) / (K % 3 == 0) >> [grasp(K), rest(K)],
    fetch(K) >> [grasp(K), note("fetched")],
    -fetch(K) / (K % 2 == 0) >> [note("recovered")],
    rest(K) >> [wait(0.02), note("rested")],
    consult(K) >> [send("other", question(K))],
    +answer(K, A) >> [-answer(K, A), note("answered")],
]

OTHER_RULES = [+question(K) >> [-question(K), send("agent", answer(K, K + 1))]]


class NodeThread:
    """Two agents and their event source."""

    def __init__(self, rate: float, seed: int = 1) -> None:
        self.rate = rate
        self.deeds = Deeds()
        self.records: deque[Record] = deque(maxlen=RECORDS)
        self.behind_s = 0.0
        self.events = 0
        self._random = random.Random(seed)
        self.agent = self._make("agent", *RULES)
        self.other = self._make("other", *OTHER_RULES)
        self.society = Society(WallClock())
        self.society.add(self.agent)
        self.society.add(self.other)
        self._posts: list[Callable[[int], object]] = [
            *[self._see] * 40, *[self._leave] * 20, *[self._switch] * 10, *[self._want] * 20, *[self._consult] * 10,
        ]  # fmt: skip

    def _make(self, name: str, *rules: Any) -> Engine:
        engine = Engine(name, WallClock(), robot=self.deeds, sink=self.records.append)
        engine.add_rules(*rules)
        return engine

    def post_until(self, begun: float, end: float) -> None:
        """Post the due events (monotonic seconds); late ones keep their due times."""
        while (now := time.monotonic()) < end:
            due = int((now - begun) * self.rate)
            if due > self.events:
                self.behind_s = max(self.behind_s, (due - self.events) / self.rate)
            for _ in range(due - self.events):
                self.post()
            time.sleep(max(0.0, BATCH_S - (time.monotonic() - now)))

    def post(self) -> None:
        self.events += 1
        number = self.events
        if number % PROBE_EVERY == 0:
            self.deeds.posted[number] = time.perf_counter_ns()
            self.agent.believe(probe(number))
        elif number % 10_007 == 0:
            self._teach(number)
        else:
            self._random.choice(self._posts)(number)

    def backlog(self) -> int:
        return sum(
            len(engine.interpreter.inbox) + len(engine.interpreter.events) for engine in (self.agent, self.other)
        )

    # Events

    def _see(self, number: int) -> None:
        self.agent.believe(seen(self._random.randrange(PEOPLE), self._random.randrange(ROOMS)), source="percept")

    def _leave(self, number: int) -> None:
        self.agent.forget(seen(self._random.randrange(PEOPLE), _))

    def _switch(self, number: int) -> None:
        room, on = self._random.randrange(ROOMS), self._random.random() < 0.7
        self.agent.forget(light(room, "off" if on else "on"))
        self.agent.believe(light(room, "on" if on else "off"))

    def _want(self, number: int) -> None:
        self.agent.achieve(fetch(self._random.randrange(PEOPLE)))

    def _consult(self, number: int) -> None:
        self.agent.achieve(consult(self._random.randrange(PEOPLE)))

    def _teach(self, number: int) -> None:
        new, old = number % TEXTS, (number + TEXTS // 2) % TEXTS
        text = f"@taught{new} +seen(P, {new}) : light({new}, on) & not known(P) <- -seen(P, {new})."
        agent = self.agent

        def change() -> None:
            agent.remove_plan(f"taught{old}")
            agent.remove_plan(f"taught{new}")
            agent.add_text(text)

        agent.call(change)


@dataclass(frozen=True)
class Minute:
    """Measurements of one minute."""

    end_s: float
    events: int
    rss_mib: float
    cpu_share: float
    p50_us: float
    p99_us: float
    max_us: float
    backlog: int

    def line(self) -> str:
        return (
            f"{self.end_s / 60:6.2f} min  {self.events:8} events  {self.rss_mib:7.2f} MiB  "
            f"{self.cpu_share:4.0%} of a core  p50 {self.p50_us:6.0f} µs  p99 {self.p99_us:7.0f} µs  "
            f"longest {self.max_us:7.0f} µs  waiting {self.backlog}"
        )

    def row(self) -> dict[str, Value]:
        return {
            "events": self.events,
            "rss_mib": round(self.rss_mib, 2),
            "cpu_share": round(self.cpu_share, 3),
            "p50_us": round(self.p50_us),
            "p99_us": round(self.p99_us),
            "max_us": round(self.max_us),
            "backlog": self.backlog,
        }


def soak(
    life: NodeThread, seconds: float, period_s: float, tell: Callable[[str], object]
) -> tuple[list[Minute], list[float]]:
    """Run the load; return the minutes (or shorter periods) and the memory (MiB) of each second.

    Raises:
        SocialbotError: The agents stop.
    """
    minutes: list[Minute] = []
    memory: list[float] = []
    thread = threading.Thread(target=life.society.run, name="agents", daemon=True)
    thread.start()
    begun, used = time.monotonic(), time.process_time()
    try:
        while (passed := time.monotonic() - begun) < seconds:
            began, before, end = time.monotonic(), life.events, begun + min(seconds, passed + period_s)
            while (now := time.monotonic()) < end:
                life.post_until(begun, min(end, now + 1.0))
                memory.append(rss_kib() / MIB)
                if not thread.is_alive():
                    raise SocialbotError("the agents have stopped", where=f"after {life.events} events")
            took, life.deeds.took = life.deeds.took, []
            times = [ns / 1000 for ns in took] or [float("inf")]
            p50, p99, longest = (percentile(times, share) or 0.0 for share in (0.5, 0.99, 1.0))
            used, cpu = time.process_time(), time.process_time() - used
            share = cpu / max(1e-9, time.monotonic() - began)
            minute = Minute(end - begun, life.events - before, memory[-1], share, p50, p99, longest, life.backlog())
            minutes.append(minute)
            tell(minute.line())
    finally:
        life.society.stop()
        thread.join(10)
    return minutes, memory


def growth(memory: list[float]) -> float:
    """Return the relative memory growth over the last two thirds of the samples, by a fitted line."""
    late = memory[len(memory) // 3 :]
    if len(late) < 2:
        return 0.0
    slope, start = statistics.linear_regression(range(len(late)), late)
    return slope * (len(late) - 1) / start


def p99_drift(minutes: list[Minute]) -> float:
    """Return the median p99 of the last third of the minutes, relative to that of the first third."""
    third = max(1, len(minutes) // 3)
    first, last = (statistics.median(m.p99_us for m in part) for part in (minutes[:third], minutes[-third:]))
    return last / first


def verdict(report: Report, life: NodeThread, minutes: list[Minute], memory: list[float]) -> None:
    """Add the results to the report."""
    seconds, deeds = minutes[-1].end_s, life.deeds.counts
    report.add("seconds", "time, s", round(seconds, 1))
    report.add("events", "events posted", life.events)
    report.add("rate", "events a second", round(life.events / seconds))
    report.add("behind_s", "largest delay of the process, s", round(life.behind_s, 3), BEHIND_LIMIT_S)
    report.add("rss_begin_mib", "memory after one third of the run, MiB", round(memory[len(memory) // 3], 2))
    report.add("rss_end_mib", "memory at the end, MiB", round(memory[-1], 2))
    most = max(minute.backlog for minute in minutes)
    report.add("waiting", "largest number of queued events at the end of a minute", most, BEHIND_LIMIT_S * life.rate)
    text = "growth of memory over the last two thirds, share"
    report.add("memory_growth", text, round(growth(memory), 5), GROWTH_LIMIT)
    report.add(
        "p50_us", "post to action, median of the minutes' p50, µs", round(statistics.median(m.p50_us for m in minutes))
    )
    report.add(
        "p99_us", "post to action, median of the minutes' p99, µs", round(statistics.median(m.p99_us for m in minutes))
    )
    report.add(
        "p99_drift", "p99 in the last third as a multiple of the first third's", round(p99_drift(minutes), 2), P99_LIMIT
    )
    report.add("lost", "probes without an action", len(life.deeds.posted), 0)
    for what in ("greeted", "not greeted", "fetched", "recovered", "rested", "held", "dark", "left", "answered"):
        report.add(what.replace(" ", "_"), f"times: {what}", deeds.get(what, 0))
    report.add(
        "all_happened", "all kinds of events occurred", all(report_value for report_value in deeds.values()), True
    )
    report.tables = {"minutes": {f"{m.end_s / 60:.2f}": m.row() for m in minutes}}


def main(minutes: MinutesOption = 30, rate: RateOption = 10_000, json: JsonOption = None) -> None:
    """Run two agents under a steady load, and check that memory and latencies stay constant."""
    logging.getLogger("socialbot.bdi").setLevel(logging.ERROR)  # failures are intended
    report = Report("soak", quick=False)
    life = NodeThread(rate)
    gc.collect()
    seconds = minutes * 60
    periods, memory = soak(life, seconds, min(60.0, seconds / 6), lambda line: print(line, flush=True))
    verdict(report, life, periods, memory)
    report.finish(json)


if __name__ == "__main__":
    run(main)
