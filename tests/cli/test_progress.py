"""How far something has come: on a terminal only."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from socialbot.cli._progress import bar

SHOWN = """
from socialbot.cli._progress import bar, waiting
with bar("writing", "pictures", 8) as advance:
    advance(3)
with waiting("a [planner] looks"):
    pass
print("done")
"""


def on_terminal(code: str) -> tuple[str, str]:
    """What ``code`` prints, and what it shows on a terminal by stderr."""
    ours, theirs = pty.openpty()
    with os.fdopen(ours, "rb", buffering=0) as screen:
        done = subprocess.run(
            [sys.executable, "-c", code],
            stdout=subprocess.PIPE,
            stderr=theirs,
            text=True,
            timeout=60,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
        )
        os.close(theirs)
        shown = b""
        try:
            while some := screen.read(65536):
                shown += some
        except OSError:
            pass  # what Linux says when nobody has the other end any more
    return done.stdout, shown.decode()


def test_a_bar_is_shown_on_a_terminal_and_gone_at_the_end():
    printed, shown = on_terminal(SHOWN)
    assert printed == "done\n"
    assert "writing" in shown
    assert "3/8" in shown
    assert "a [planner] looks" in shown
    assert shown.rstrip().endswith("\x1b[2K")


def test_elsewhere_nothing_is_shown(capfd: pytest.CaptureFixture[str]):
    with bar("writing", "pictures") as advance:
        advance(3)
    assert capfd.readouterr() == ("", "")
