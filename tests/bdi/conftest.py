import queue

import pytest

from socialbot.bdi._timers import Wakeup


@pytest.fixture
def waits(monkeypatch):
    """Queue of the time limits (s) with which a running engine or society has begun to sleep."""
    found, wait = queue.SimpleQueue(), Wakeup.wait
    monkeypatch.setattr(Wakeup, "wait", lambda wakeup, seconds=None: (found.put(seconds), wait(wakeup, seconds)))
    return found
