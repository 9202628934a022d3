"""Errors for users: what is wrong, where, and how to fix it.

The command line prints such an error as one message and exits with its
``exit_code``. Only defects of socialbot itself cause a traceback.

| code | meaning |
|---|---|
| 0 | finished, or ended by SIGINT, SIGTERM or SIGHUP |
| 1 | a defect of socialbot (traceback) |
| 2 | the command line was wrong |
| 3 | input data cannot be used (bag, image, video, ground truth, record of a run) |
| 4 | configuration cannot be used (graph file, topic, parameter, rule, planning domain) |
| 5 | a part of the installation is missing (ROS wheels, speech library, ...) |
| 6 | a node failed while running |
| 7 | a device failed (camera, sound) |
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable

__all__ = [
    "BagError", "DeviceError", "GraphError", "ImageError", "InstallationError", "MessageError", "NodeError",
    "ParameterError", "PlanningError", "RuleError", "RunError", "SocialbotError", "TruthError",
    "suggestion",
]  # fmt: skip


_INSTALLED = frozenset({"site-packages", "dist-packages"})


class SocialbotError(Exception):
    """Base class of all errors for users: problem, location and remedy."""

    exit_code = 1

    def __init__(self, what: str, *, where: str | None = None, remedy: str | None = None) -> None:
        super().__init__(what, where, remedy)
        self.what = what
        self.where = where
        self.remedy = remedy

    def __reduce__(self) -> tuple[object, ...]:
        # Unpickling passes arguments by position, but these are keywords.
        return _made_again, (type(self), self.args), self.__dict__

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        return f"{text}\n  remedy: {self.remedy}" if self.remedy else text


def _made_again(kind: type[SocialbotError], args: tuple[object, ...]) -> SocialbotError:
    return kind.__new__(kind, *args)


class BagError(SocialbotError):
    """Unreadable or unwritable bag, video or image folder."""

    exit_code = 3


class ImageError(SocialbotError):
    """Image that cannot be converted: unknown encoding, wrong size or damaged JPEG."""

    exit_code = 3


class TruthError(SocialbotError):
    """Ground truth file that does not match its schema."""

    exit_code = 3


class RunError(SocialbotError):
    """Folder without a run, or a missing item in a run."""

    exit_code = 3


class MessageError(SocialbotError):
    """Received message that does not match its schema; it is rejected and counted."""

    exit_code = 3


class GraphError(SocialbotError):
    """Graph with inconsistent or unknown nodes, ports, topics or types."""

    exit_code = 4


class ParameterError(SocialbotError):
    """Parameter that is unknown, has the wrong type or is out of range."""

    exit_code = 4


class RuleError(SocialbotError):
    """Invalid rule, belief, goal or action of an agent; ``line`` is that of the step in AgentSpeak text, or 0."""

    exit_code = 4
    line: int = 0


class PlanningError(SocialbotError):
    """Invalid domain, problem, plan, or file of beliefs, desires or rules."""

    exit_code = 4


class InstallationError(SocialbotError):
    """Missing part of the installation."""

    exit_code = 5


class NodeError(SocialbotError):
    """Node that failed while the graph was running."""

    exit_code = 6


class DeviceError(SocialbotError):
    """Missing or disconnected camera or sound device."""

    exit_code = 7


def suggestion(word: object, known: Iterable[str]) -> str:
    """Return a remedy for the unknown ``word``: the closest of the ``known`` names, and all of them."""
    names = sorted(known)
    close = difflib.get_close_matches(str(word), names, n=1)  # a key of YAML may be a number
    listed = f"known: {', '.join(names) or 'none'}"
    return f"did you mean {close[0]!r}? {listed}" if close else listed


PACKAGE = os.path.dirname(os.path.dirname(__file__))
"""The folder of socialbot."""


def described(error: BaseException, *rooms: str) -> str:
    """Return type and message of an exception on one line, with its `place_of`.

    An error of socialbot tells the place in code of others that led to it: a handler that publishes a wrong message.
    """
    place = place_of(error, *((PACKAGE,) if isinstance(error, SocialbotError) else rooms))
    return f"{type(error).__name__}: {error}" + (f" ({place})" if place else "")


def place_of(error: BaseException, *rooms: str) -> str:
    """Return the file and line of an exception in code that ``rooms`` called; empty if no frame is there.

    Frames in the folders ``rooms``, of the room core, of the standard library and of installed packages are left out.
    """
    left_out = ("<", os.path.dirname(__file__), *(room + os.sep for room in rooms), os.path.dirname(os.__file__))
    found, entry = "", error.__traceback__
    while entry is not None:
        file = entry.tb_frame.f_code.co_filename
        if not file.startswith(left_out) and not _INSTALLED.intersection(file.split(os.sep)):
            found = f"{os.path.basename(file)}:{entry.tb_lineno}"
        entry = entry.tb_next
    return found
