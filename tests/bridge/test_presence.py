"""That `up` says it is there, and ends when somebody asks who may."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from socialbot.errors import NodeError
from socialbot.messages import DownRequest, UpStatus
from socialbot.security.keys import new_key
from tests.system.running import eventually

pytestmark = pytest.mark.ros


@contextmanager
def two_nodes() -> Iterator[tuple[Any, Any]]:
    from socialbot.bridge.session import spinning_node

    with ExitStack() as stack:
        yield stack.enter_context(spinning_node("observer")), stack.enter_context(spinning_node("down"))


def test_up_is_heard_asked_to_end_and_says_that_it_has():
    from socialbot.bridge.presence import Presence, Runs, is_gone, is_here

    asked = threading.Event()
    with two_nodes() as (up, down):
        runs = Runs(down)
        presence = Presence(up, "waldo", asked.set)
        assert eventually(lambda: presence.tell() or presence.run in runs.heard)
        assert runs.heard[presence.run].state == "up"
        assert is_here(runs.heard[presence.run])
        runs.ask_to_end("another run")
        assert eventually(lambda: runs.ask_to_end(presence.run) or asked.is_set())
        assert eventually(lambda: runs.heard[presence.run].state == "ending")
        assert not is_gone(runs.heard[presence.run])
        with pytest.raises(NodeError), presence:
            raise NodeError("all processes have died")
        assert eventually(lambda: runs.heard[presence.run].state == "ended")
        last = runs.heard[presence.run]
        assert last.reason == "all processes have died"
        assert not is_gone(last), "its process, this one, still lives"
        ended = subprocess.Popen(["true"])
        # Nobody takes note of its end, so that it stays as a zombie.
        assert eventually(lambda: is_gone(msgspec.structs.replace(last, pid=ended.pid)))
        ended.wait()
        assert is_gone(msgspec.structs.replace(last, boot="another computer"))


def test_that_it_has_ended_is_its_last_word(monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.presence import Presence

    with two_nodes() as (up, _):
        presence = Presence(up, "waldo", lambda: None)
        said: list[UpStatus] = []
        monkeypatch.setattr(presence, "_outlet", SimpleNamespace(publish=said.append))
        with presence:
            presence._take(DownRequest(stamp=1, run=presence.run))
        presence._take(DownRequest(stamp=2, run=presence.run))
        presence.tell()
        assert [status.state for status in said] == ["ending", "ended"]


def test_with_keys_only_who_has_one_is_obeyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge.presence import DOWN_TOPIC, Presence, Runs

    new_key("robot", tmp_path / "keys")
    asked = threading.Event()
    with two_nodes() as (up, down):
        stranger = Runs(down)
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        presence = Presence(up, "waldo", asked.set)
        friend = Runs(down)
        with presence:
            assert eventually(lambda: presence.tell() or presence.run in friend.heard)
            assert presence.run not in stranger.heard
            assert eventually(lambda: down.count_subscribers(DOWN_TOPIC) > 0)
            assert eventually(lambda: stranger.ask_to_end(presence.run) or presence.refused > 0)
            assert not asked.is_set()
            assert eventually(lambda: friend.ask_to_end(presence.run) or asked.is_set())


def test_strangers_cannot_fill_the_memory(monkeypatch: pytest.MonkeyPatch):
    from socialbot.bridge import presence

    monkeypatch.setattr(presence, "MOST_RUNS", 2)
    with two_nodes() as (_, down):
        runs = presence.Runs(down)
        for number in range(5):
            runs.note(UpStatus(stamp=1, run=str(number), graph="g", machine="m", boot="b", pid=number, state="up"))
        assert list(runs.heard) == ["0", "1"]
