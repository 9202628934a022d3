"""Every error a user can meet: what happened, where, and what to do about it.

The command line prints one of these as a single message and ends with its
``exit_code``; a traceback is reserved for defects of socialbot itself.

| code | meaning |
|---|---|
| 0 | finished, or ended by SIGINT or SIGTERM |
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
from collections.abc import Iterable

__all__ = [
    "BagError", "DeviceError", "GraphError", "ImageError", "InstallationError", "MessageError", "NodeError",
    "ParameterError", "PlanningError", "RuleError", "RunError", "SocialbotError", "TruthError",
    "suggestion",
]  # fmt: skip


class SocialbotError(Exception):
    """What went wrong, where it did, and the remedy; the base of all errors meant for users."""

    exit_code = 1

    def __init__(self, what: str, *, where: str | None = None, remedy: str | None = None) -> None:
        super().__init__(what, where, remedy)
        self.what = what
        self.where = where
        self.remedy = remedy

    def __reduce__(self) -> tuple[object, ...]:
        # An exception is made anew from its arguments by position; these are given by name.
        return _made_again, (type(self), self.args), self.__dict__

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        return f"{text}\n  remedy: {self.remedy}" if self.remedy else text


def _made_again(kind: type[SocialbotError], args: tuple[object, ...]) -> SocialbotError:
    return kind.__new__(kind, *args)


class BagError(SocialbotError):
    """A bag, video or image folder that cannot be read or written."""

    exit_code = 3


class ImageError(SocialbotError):
    """One image that cannot be converted: unknown encoding, wrong size, damaged JPEG."""

    exit_code = 3


class TruthError(SocialbotError):
    """A ground truth file that does not fit its schema."""

    exit_code = 3


class RunError(SocialbotError):
    """A folder that holds no run, or something in a run that is not there."""

    exit_code = 3


class MessageError(SocialbotError):
    """A message on the wire that does not fit its schema; it is refused and counted."""

    exit_code = 3


class GraphError(SocialbotError):
    """A graph with unknown nodes, ports, topics or types, or one that does not fit together."""

    exit_code = 4


class ParameterError(SocialbotError):
    """A parameter that does not exist, has the wrong type or is out of range."""

    exit_code = 4


class RuleError(SocialbotError):
    """A rule, belief, goal or action of an agent that is put together wrongly."""

    exit_code = 4


class PlanningError(SocialbotError):
    """A domain, problem, plan, or a file of beliefs, desires or rules that cannot be used."""

    exit_code = 4


class InstallationError(SocialbotError):
    """A part that is not installed."""

    exit_code = 5


class NodeError(SocialbotError):
    """A node that failed while the graph was running."""

    exit_code = 6


class DeviceError(SocialbotError):
    """A camera or sound device that is missing or has vanished."""

    exit_code = 7


def suggestion(word: str, known: Iterable[str]) -> str:
    """A remedy for the unknown ``word``: the closest of the ``known`` names, and all of them."""
    names = sorted(known)
    close = difflib.get_close_matches(word, names, n=1)
    listed = f"known: {', '.join(names) or 'none'}"
    return f"did you mean {close[0]!r}? {listed}" if close else listed
