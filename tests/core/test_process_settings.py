"""Scheduling and memory of processes, each in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from socialbot.core.errors import ParameterError
from socialbot.core.process_settings import PROCESS_VARIABLE, ProcessSettings, apply_settings

SHOW = """
import os, threading
from socialbot.core.errors import SocialbotError
from socialbot.core.process_settings import apply_settings
try:
    apply_settings()
except SocialbotError as error:
    raise SystemExit(f"{error.exit_code} {error.where}: {error.what}")
def show():
    print(os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.nice(0), sorted(os.sched_getaffinity(0)))
thread = threading.Thread(target=show)
thread.start()
thread.join()
try:
    print(len(bytearray(600_000_000)))
except MemoryError:
    print("out of memory")
"""


def shown(settings: ProcessSettings) -> list[str]:
    """What a thread of a process with these settings finds, or the error of the process."""
    done = subprocess.run(
        [sys.executable, "-c", SHOW],
        env={**os.environ, **settings.variables()},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return (done.stdout if done.returncode == 0 else done.stderr).splitlines()


def test_threads_inherit_niceness_and_cores() -> None:
    core = min(os.sched_getaffinity(0))
    nice = min(os.nice(0) + 3, 19)
    assert shown(ProcessSettings(nice=nice, cpus=(core,))) == [f"{os.SCHED_OTHER} 0 {nice} [{core}]", "600000000"]


def test_threads_inherit_the_real_time_priority_or_the_process_says_why() -> None:
    [first, *_] = shown(ProcessSettings(priority=7))
    permitted = f"{os.SCHED_FIFO} 7 {os.nice(0)} {sorted(os.sched_getaffinity(0))}"
    assert first in (permitted, "4 processes: priority: cannot be set: Operation not permitted")


def test_a_process_gets_no_more_memory_than_its_limit() -> None:
    assert shown(ProcessSettings(memory_mb=400))[1] == "out of memory"
    assert shown(ProcessSettings(memory_mb=2000))[1] == "600000000"


def test_a_core_that_the_machine_lacks_is_named() -> None:
    assert shown(ProcessSettings(cpus=(1000,))) == ["4 processes: cpus: cannot be set: Invalid argument"]


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        (ProcessSettings(priority=0), "'priority' must be from 1 to 99, got 0"),
        (ProcessSettings(nice=20), "'nice' must be from -20 to 19, got 20"),
        (ProcessSettings(memory_mb=10), "'memory_mb' must be from 200"),
        (ProcessSettings(cpus=()), "'cpus' must name cores"),
        (ProcessSettings(cpus=(-1,)), "'cpus' must name cores"),
    ],
)
def test_impossible_values_are_refused(settings: ProcessSettings, what: str) -> None:
    with pytest.raises(ParameterError, match=what):
        settings.check("processes.head")


@pytest.mark.parametrize("text", ["{", "[]", '{"speed": 3}', '{"cpus": 3}', '{"priority": "high"}'])
def test_an_unusable_variable_is_named(text: str) -> None:
    with pytest.raises(ParameterError, match="not valid settings") as caught:
        apply_settings({PROCESS_VARIABLE: text})
    assert caught.value.where == PROCESS_VARIABLE
