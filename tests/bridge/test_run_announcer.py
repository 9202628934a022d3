"""Announcements of runs, and requests to end them."""

from __future__ import annotations

import subprocess
import threading
import time
from pathlib import Path
from secrets import token_hex

import msgspec
import pytest

from socialbot.bridge.keys import new_key
from socialbot.bridge.run_announcer import run_lock
from socialbot.core.errors import NodeError
from socialbot.core.messages import DownRequest, UpStatus
from socialbot.core.process import Ending
from tests.bridge.hosting import spinning_nodes
from tests.system.running import eventually

pytestmark = pytest.mark.ros


def test_announces_a_run_and_ends_it_on_request():
    from socialbot.bridge.run_announcer import RunAnnouncer, RunStatuses, is_gone, is_here

    asked = threading.Event()
    with spinning_nodes("observer", "down") as (up, down):
        runs = RunStatuses(down)
        announcer = RunAnnouncer(up, "waldo", asked.set, token_hex(8))
        assert eventually(lambda: announcer.announce() or announcer.run in runs.statuses)
        assert runs.statuses[announcer.run].state == "up"
        assert is_here(runs.statuses[announcer.run])
        runs.ask_to_end("another run")
        assert eventually(lambda: runs.ask_to_end(announcer.run) or asked.is_set())
        assert eventually(lambda: runs.statuses[announcer.run].state == "ending")
        assert not is_gone(runs.statuses[announcer.run])
        with pytest.raises(NodeError), announcer:
            raise NodeError("all processes have died")
        assert eventually(lambda: runs.statuses[announcer.run].state == "ended")
        last = runs.statuses[announcer.run]
        assert last.reason == "all processes have died"
        assert not is_gone(last), "its process is this one"
        ended = subprocess.Popen(["true"])
        # Not waited for, it stays a zombie.
        assert eventually(lambda: is_gone(msgspec.structs.replace(last, pid=ended.pid)))
        ended.wait()
        assert is_gone(msgspec.structs.replace(last, boot="another computer"))


def test_ended_is_the_last_status(monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.run_announcer import RunAnnouncer

    with spinning_nodes("observer", "down") as (up, _):
        announcer = RunAnnouncer(up, "waldo", lambda: None, token_hex(8))
        said: list[UpStatus] = []
        monkeypatch.setattr(announcer._sender, "publish", said.append)
        with announcer:
            announcer._on_request(DownRequest(stamp=1, run=announcer.run))
        announcer._on_request(DownRequest(stamp=2, run=announcer.run))
        announcer.announce()
        assert [status.state for status in said] == ["ending", "ended"]


def test_accepts_only_sealed_requests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.run_announcer import DOWN_TOPIC, RunAnnouncer, RunStatuses

    new_key("robot", tmp_path / "keys")
    asked = threading.Event()
    with spinning_nodes("observer", "down") as (up, down):
        stranger = RunStatuses(down)
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        announcer = RunAnnouncer(up, "waldo", asked.set, token_hex(8))
        friend = RunStatuses(down)
        with announcer:
            assert eventually(lambda: announcer.announce() or announcer.run in friend.statuses)
            assert announcer.run not in stranger.statuses
            assert eventually(lambda: down.count_subscribers(DOWN_TOPIC) > 0)
            assert eventually(lambda: stranger.ask_to_end(announcer.run) or announcer._requests.refused > 0)
            assert not asked.is_set()
            assert eventually(lambda: friend.ask_to_end(announcer.run) or asked.is_set())


def test_limits_the_number_of_runs(monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge import run_announcer as announcer

    monkeypatch.setattr(announcer, "MAX_RUNS", 2)
    with spinning_nodes("observer", "down") as (_, down):
        runs = announcer.RunStatuses(down)
        for number in range(5):
            runs.note(UpStatus(stamp=1, run=str(number), graph="g", machine="m", boot="b", pid=number, state="up"))
        assert list(runs.statuses) == ["0", "1"]


def test_logs_a_duplicate_run_once(caplog: pytest.LogCaptureFixture):
    from socialbot.bridge.run_announcer import RunAnnouncer

    with spinning_nodes("observer", "down") as (one, other):
        first, second = (
            RunAnnouncer(one, "waldo", lambda: None, token_hex(8)),
            RunAnnouncer(other, "waldo", lambda: None, token_hex(8)),
        )
        stranger = RunAnnouncer(other, "warehouse", lambda: None, token_hex(8))
        with first, second, stranger:
            assert eventually(
                lambda: any((first.announce(), second.announce(), stranger.announce())) or len(caplog.records) >= 2
            )
            first._announced_at = second._announced_at = 0.0
            assert not eventually(lambda: any((first.announce(), second.announce())) or len(caplog.records) > 2, 1.5)
    assert {record.levelname for record in caplog.records} == {"ERROR"}
    assert all("is up twice, the other here" in record.getMessage() for record in caplog.records)


def test_down_waits_for_slow_runs_of_this_computer(monkeypatch: pytest.MonkeyPatch):
    """Without a run it returns at once; with one it waits for its first status."""
    from socialbot.bridge.run_announcer import RunAnnouncer, RunStatuses
    from socialbot.cli.down import LISTEN_S, Target, find_runs

    listen_s = 1.5

    everything = Target(lambda one: one.graph == "waldo")
    with spinning_nodes("observer", "down") as (up, down):
        runs, begun = RunStatuses(down), time.monotonic()
        assert find_runs(runs, everything, Ending(), 60.0) == []
        assert time.monotonic() - begun < LISTEN_S
        monkeypatch.setattr("socialbot.cli.down.LISTEN_S", listen_s)
        begun = time.monotonic()
        announcer = RunAnnouncer(up, "waldo", lambda: None, token_hex(8))
        late = threading.Timer(listen_s + 0.5, announcer.announce)
        late.start()
        with run_lock(announcer.run):
            assert [one.run for one in find_runs(runs, everything, Ending(), 60.0)] == [announcer.run]
        assert time.monotonic() - begun > listen_s
        with announcer:
            late.join()


def test_down_gives_up_on_unreachable_machines(monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.run_announcer import RunStatuses
    from socialbot.cli.down import Target, find_runs

    monkeypatch.setattr("socialbot.cli.down.LISTEN_S", 1.0)

    with spinning_nodes("observer", "down") as (_, down):
        begun = time.monotonic()
        assert find_runs(RunStatuses(down), Target(lambda _: True, ("robot", "here"), "here"), Ending(), 120.0) == []
        assert 1.0 <= time.monotonic() - begun < 60.0
