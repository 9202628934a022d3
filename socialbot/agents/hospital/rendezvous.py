"""Joint actions: whoever comes first waits for the others, and they begin together."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple


class Meeting(NamedTuple):
    """What is done together, in which mission: the label of its plans, the action, its arguments."""

    label: str
    action: str
    args: tuple[str, ...]


@dataclass
class _Waiting:
    missing: set[str]
    met: Callable[[], None]


@dataclass
class Rendezvous:
    """The meetings of one agent.

    ``ready`` tells a partner that the agent is there, ``done`` answers a partner who had been there before.
    """

    ready: Callable[[str, Meeting], object]
    done: Callable[[str, Meeting], object]
    _waiting: dict[Meeting, _Waiting] = field(default_factory=dict)
    _there: dict[Meeting, set[str]] = field(default_factory=dict)

    def arrive(self, meeting: Meeting, partners: Iterable[str], met: Callable[[], None]) -> None:
        """Calls ``met`` as soon as all partners are there, at once if they are."""
        there = self._there.pop(meeting, set())
        missing: set[str] = set()
        for partner in partners:
            if partner in there:
                self.done(partner, meeting)
            else:
                missing.add(partner)
                self.ready(partner, meeting)
        if missing:
            self._waiting[meeting] = _Waiting(missing, met)
        else:
            met()

    def partner_ready(self, partner: str, meeting: Meeting) -> None:
        """Takes the word of a partner who is there."""
        if meeting in self._waiting:
            self.done(partner, meeting)
            self._come(partner, meeting)
        else:
            self._there.setdefault(meeting, set()).add(partner)

    def partner_done(self, partner: str, meeting: Meeting) -> None:
        """Takes the answer of a partner."""
        self._come(partner, meeting)

    def leave(self, meeting: Meeting) -> None:
        """Waits no longer."""
        self._waiting.pop(meeting, None)

    def forget(self, label: str) -> None:
        """Forgets all meetings but those of the plans with this label."""
        self._waiting = {meeting: found for meeting, found in self._waiting.items() if meeting.label == label}
        self._there = {meeting: found for meeting, found in self._there.items() if meeting.label == label}

    def _come(self, partner: str, meeting: Meeting) -> None:
        waiting = self._waiting.get(meeting)
        if waiting is None:
            return
        waiting.missing.discard(partner)
        if not waiting.missing:
            del self._waiting[meeting]
            waiting.met()
