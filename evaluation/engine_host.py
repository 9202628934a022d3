"""Cost of the engine for its host: wall-clock latencies, memory, import time and idle load.

Memory and import are measured in separate processes: ``python -m evaluation.engine_host 1000`` prints the KiB per agent
for 1000 agents.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
import time

import psutil

from evaluation import engine_programs as programs
from evaluation.engine_workloads import Figures, Scale
from evaluation.report import percentile
from socialbot.bdi import Engine, Library
from socialbot.core.clock import WallClock
from socialbot.core.errors import SocialbotError

PAUSE_S = 0.0002
"""Pause between two events from another thread, so that the engine becomes idle."""

IMPORTS = 25
"""Number of fresh interpreters that import the engine; the fastest counts."""

IMPORT = "import time; begun = time.process_time_ns(); import {0}; print(time.process_time_ns() - begun)"


def latency(scale: Scale) -> Figures:
    """Measure wall time from post to action, in the engine's thread and from another one.

    ``wake_p50_us`` is the time of the system to wake a thread that reads a pipe, without an engine.
    """
    gc.collect()
    gc.freeze()
    try:
        own = own_latencies(scale.latencies)
        posted, woken = posted_latencies(scale.latencies // 4), wakes(scale.latencies // 4)
    finally:
        gc.unfreeze()
    return {
        "p50_us": _us(own, 0.5),
        "p99_us": _us(own, 0.99),
        "thread_p50_us": _us(posted, 0.5),
        "thread_p99_us": _us(posted, 0.99),
        "wake_p50_us": _us(woken, 0.5),
        "wake_p99_us": _us(woken, 0.99),
    }


def own_latencies(number: int) -> list[int]:
    """Return times (ns) from post to action in one thread."""
    engine = programs.ready_agent(programs.react_rule(programs.stop_watch), robot=programs.Stopwatch())
    watch, person = engine.robot, programs.person("yes")
    for _ in range(number):
        watch.posted = time.perf_counter_ns()
        engine.believe(person)
        engine.run_until_idle()
    return watch.took


def posted_latencies(number: int) -> list[int]:
    """Return times (ns) from post to action across threads, with the engine idle in `Engine.run`."""
    engine = programs.ready_agent(programs.react_rule(programs.stop_watch), robot=programs.Stopwatch())
    watch, person = engine.robot, programs.person("yes")
    thread = threading.Thread(target=engine.run)
    thread.start()
    try:
        for i in range(number):
            time.sleep(PAUSE_S)
            watch.posted = time.perf_counter_ns()
            engine.believe(person)
            _await(watch.took, i + 1)
    finally:
        engine.stop()
        thread.join()
    return watch.took


def wakes(number: int) -> list[int]:
    """Return times (ns) to wake a thread by writing to a pipe."""
    (reader, writer), took, watch = os.pipe(), [], programs.Stopwatch()

    def wait() -> None:
        for _ in range(number):
            os.read(reader, 1)
            took.append(time.perf_counter_ns() - watch.posted)

    thread = threading.Thread(target=wait)
    thread.start()
    for i in range(number):
        time.sleep(PAUSE_S)
        watch.posted = time.perf_counter_ns()
        os.write(writer, b"!")
        _await(took, i + 1)
    thread.join()
    os.close(reader)
    os.close(writer)
    return took


def host(scale: Scale) -> Figures:
    """W6: memory per agent, processor time of the import and of an idle agent.

    The import of asyncio, of about the same size, shows the current speed of the machine for cold code.
    """
    return {
        "kib_per_agent": float(fresh("-m", "evaluation.engine_host", str(scale.agents))),
        "import_ms": import_ms("socialbot.bdi"),
        "asyncio_ms": import_ms("asyncio"),
        "idle_share": idle_share(scale.idle_s),
    }


def import_ms(module: str) -> float:
    """Return the processor time of an import in a fresh interpreter, without interpreter startup."""
    return min(int(fresh("-c", IMPORT.format(module))) for _ in range(IMPORTS)) / 1e6


def idle_share(seconds: float) -> float:
    """Return the processor share of an idle agent in `Engine.run`."""
    engine = programs.ready_agent(programs.react_rule())
    thread = threading.Thread(target=engine.run)
    thread.start()
    time.sleep(0.1)
    begun, used = time.monotonic(), time.process_time()
    time.sleep(seconds)
    used = time.process_time() - used
    share = used / (time.monotonic() - begun)
    engine.stop()
    thread.join()
    return round(share, 3)


def kib_per_agent(number: int) -> float:
    """Return the process memory per agent, for agents with the same plans after one reaction each."""
    clock, library = WallClock(), Library(programs.react_rule())

    def make(name: str) -> Engine:
        engine = Engine(name, clock, robot=None, library=library)
        engine.believe(programs.ready("yes"))
        engine.run_until_idle()
        return engine

    first = [make("first") for _ in range(10)]
    for engine in first:
        engine.robot = programs.Counter()
        engine.believe(programs.person("yes"))
        engine.run_until_idle()
    gc.collect()
    before = rss_kib()
    robot, agents = programs.Counter(), []
    for i in range(number):
        engine = make(f"a{i}")
        engine.robot = robot
        engine.believe(programs.person("yes"))
        engine.run_until_idle()
        agents.append(engine)
    gc.collect()
    assert robot.count == number
    return (rss_kib() - before) / len(agents)


def rss_kib() -> int:
    """Return the memory of this process."""
    return psutil.Process().memory_info().rss // 1024


def _await(took: list[int], number: int) -> None:
    deadline = time.monotonic() + 5
    while len(took) < number:
        time.sleep(PAUSE_S / 4)
        if time.monotonic() > deadline:
            raise SocialbotError("an event posted from another thread was not acted upon", where="latency")


def _us(times: list[int], share: float) -> float | None:
    found = percentile([time_ns / 1000 for time_ns in times], share)
    return None if found is None else round(found, 3)


def fresh(*arguments: str) -> str:
    """Return the output of a fresh interpreter.

    Raises:
        SocialbotError: It fails.
    """
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SocialbotError(f"a fresh interpreter failed: {done.stderr.strip()}", where=" ".join(arguments))
    return done.stdout.strip()


if __name__ == "__main__":
    print(kib_per_agent(int(sys.argv[1])))
