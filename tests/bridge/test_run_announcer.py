"""That `up` says it is there, and ends when somebody asks who may."""

from __future__ import annotations

import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from socialbot.bridge.security import new_key
from socialbot.core.errors import NodeError
from socialbot.core.messages import DownRequest, UpStatus
from socialbot.core.process import Ending
from socialbot.runtime.run_lock import run_lock
from tests.system.running import eventually

pytestmark = pytest.mark.ros


@contextmanager
def two_nodes() -> Iterator[tuple[Any, Any]]:
    from socialbot.bridge.environment import spinning_node

    with ExitStack() as stack:
        yield stack.enter_context(spinning_node("observer")), stack.enter_context(spinning_node("down"))


def test_up_is_heard_asked_to_end_and_says_that_it_has():
    from socialbot.bridge.run_announcer import RunAnnouncer, RunStatuses, is_gone, is_here

    asked = threading.Event()
    with two_nodes() as (up, down):
        runs = RunStatuses(down)
        presence = RunAnnouncer(up, "waldo", asked.set)
        assert eventually(lambda: presence.announce() or presence.run in runs.statuses)
        assert runs.statuses[presence.run].state == "up"
        assert is_here(runs.statuses[presence.run])
        runs.ask_to_end("another run")
        assert eventually(lambda: runs.ask_to_end(presence.run) or asked.is_set())
        assert eventually(lambda: runs.statuses[presence.run].state == "ending")
        assert not is_gone(runs.statuses[presence.run])
        with pytest.raises(NodeError), presence:
            raise NodeError("all processes have died")
        assert eventually(lambda: runs.statuses[presence.run].state == "ended")
        last = runs.statuses[presence.run]
        assert last.reason == "all processes have died"
        assert not is_gone(last), "its process, this one, still lives"
        ended = subprocess.Popen(["true"])
        # Nobody takes note of its end, so that it stays as a zombie.
        assert eventually(lambda: is_gone(msgspec.structs.replace(last, pid=ended.pid)))
        ended.wait()
        assert is_gone(msgspec.structs.replace(last, boot="another computer"))


def test_that_it_has_ended_is_its_last_word(monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.run_announcer import RunAnnouncer

    with two_nodes() as (up, _):
        presence = RunAnnouncer(up, "waldo", lambda: None)
        said: list[UpStatus] = []
        monkeypatch.setattr(presence, "_sender", SimpleNamespace(publish=said.append))
        with presence:
            presence._on_request(DownRequest(stamp=1, run=presence.run))
        presence._on_request(DownRequest(stamp=2, run=presence.run))
        presence.announce()
        assert [status.state for status in said] == ["ending", "ended"]


def test_with_keys_only_who_has_one_is_obeyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.run_announcer import DOWN_TOPIC, RunAnnouncer, RunStatuses

    new_key("robot", tmp_path / "keys")
    asked = threading.Event()
    with two_nodes() as (up, down):
        stranger = RunStatuses(down)
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        presence = RunAnnouncer(up, "waldo", asked.set)
        friend = RunStatuses(down)
        with presence:
            assert eventually(lambda: presence.announce() or presence.run in friend.statuses)
            assert presence.run not in stranger.statuses
            assert eventually(lambda: down.count_subscribers(DOWN_TOPIC) > 0)
            assert eventually(lambda: stranger.ask_to_end(presence.run) or presence.refused > 0)
            assert not asked.is_set()
            assert eventually(lambda: friend.ask_to_end(presence.run) or asked.is_set())


def test_strangers_cannot_fill_the_memory(monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge import run_announcer as presence

    monkeypatch.setattr(presence, "MAX_RUNS", 2)
    with two_nodes() as (_, down):
        runs = presence.RunStatuses(down)
        for number in range(5):
            runs.note(UpStatus(stamp=1, run=str(number), graph="g", machine="m", boot="b", pid=number, state="up"))
        assert list(runs.statuses) == ["0", "1"]


def test_the_same_half_up_twice_is_told_once(caplog: pytest.LogCaptureFixture):
    from socialbot.bridge.run_announcer import RunAnnouncer

    with two_nodes() as (one, other):
        first, second = RunAnnouncer(one, "waldo", lambda: None), RunAnnouncer(other, "waldo", lambda: None)
        stranger = RunAnnouncer(other, "warehouse", lambda: None)
        with first, second, stranger:
            assert eventually(
                lambda: any((first.announce(), second.announce(), stranger.announce())) or len(caplog.records) >= 2
            )
            first._announced_at = second._announced_at = 0.0
            assert not eventually(lambda: any((first.announce(), second.announce())) or len(caplog.records) > 2, 1.5)
    assert {record.levelname for record in caplog.records} == {"ERROR"}
    assert all("is up twice, the other here" in record.getMessage() for record in caplog.records)


def test_down_waits_for_what_is_up_here_though_it_is_slow_to_speak():
    """As long as nothing is up it knows so at once; what is up it hears, though that says nothing for six seconds."""
    from socialbot.bridge.run_announcer import RunAnnouncer, RunStatuses
    from socialbot.cli.down import LISTEN_S, Target, heard

    everything = Target(lambda one: one.graph == "waldo")
    with two_nodes() as (up, down):
        runs, begun = RunStatuses(down), time.monotonic()
        assert heard(runs, everything, Ending(), 20.0) == []
        assert time.monotonic() - begun < 0.5
        presence = RunAnnouncer(up, "waldo", lambda: None)
        late = threading.Timer(LISTEN_S + 1.0, presence.announce)
        late.start()
        with run_lock(presence.run):
            assert [one.run for one in heard(runs, everything, Ending(), 20.0)] == [presence.run]
        assert time.monotonic() - begun > LISTEN_S
        with presence:
            late.join()


def test_down_gives_up_on_another_machine_that_nobody_hears():
    from socialbot.bridge.run_announcer import RunStatuses
    from socialbot.cli.down import LISTEN_S, Target, heard

    with two_nodes() as (_, down):
        begun = time.monotonic()
        assert heard(RunStatuses(down), Target(lambda _: True, ("robot", "here"), "here"), Ending(), 20.0) == []
        assert LISTEN_S <= time.monotonic() - begun < LISTEN_S + 2.0
