"""Progress bars, on a terminal only."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from socialbot.cli._options import bar

SHOWN = """
from socialbot.cli._options import bar
with bar("writing [b]", "images", 8) as advance:
    advance(3)
print("done")
"""


def on_terminal(code: str) -> tuple[str, str]:
    """Return the output of ``code``, and its stderr on a terminal."""
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
            pass  # Linux: the other end is closed
    return done.stdout, shown.decode()


def test_bar_is_shown_on_a_terminal():
    printed, shown = on_terminal(SHOWN)
    assert printed == "done\n"
    assert "writing [b]" in shown
    assert "3/8" in shown
    assert shown.rstrip().endswith("\x1b[2K")


def test_no_bar_without_terminal(capfd: pytest.CaptureFixture[str]):
    with bar("writing", "images") as advance:
        advance(3)
    assert capfd.readouterr() == ("", "")
