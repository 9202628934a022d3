"""Shows a run in the terminal as it happens: what is perceived, believed, decided and said, and the head's moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.live import Live
from rich.text import Text

from socialbot.clock import SECOND
from socialbot.messages import (
    HeadCommand,
    JointTrajectory,
    Message,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    TraceRecord,
)

STYLES = {
    "sees": "cyan",
    "believes": "yellow",
    "wants": "magenta",
    "does": "bold",
    "says": "bold green",
    "head": "blue",
    "fails": "bold red",
}
SPOKEN_KINDS = {"belief": "believes", "goal": "wants", "action": "does", "failure": "fails"}
SEEN_EVERY_S = 1.0


class Display:
    """Prints a line for each thing that happens, and keeps one line with the present moment below them.

    ``start`` is the stamp (ns) that counts as 0 s; ``until`` the stamp of the end, for the progress.
    """

    def __init__(self, console: Console, *, start: int, until: int) -> None:
        self._console = console
        self._start = start
        self._until = until
        self._live = Live(console=console, refresh_per_second=8, transient=True) if console.is_terminal else None
        self._persons: Sequence[PersonDetection] = ()
        self._head = "head 0°, 0°"
        self._seen_at = -math.inf
        self._seen_count = 0

    def __enter__(self) -> Display:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, topic: str, message: Message) -> None:
        """Shows one message."""
        match message:
            case PersonDetections():
                self._persons = message.persons
                self._show_persons(message)
            case TraceRecord() if message.kind in SPOKEN_KINDS:
                text = message.what
                if message.kind == "failure":
                    text = f"{text}: {message.detail.get('message') or message.detail.get('reason')}"
                self._line(message.stamp, SPOKEN_KINDS[message.kind], text)
            case SpeechStatus(state="started"):
                self._line(message.stamp, "says", f'"{message.text}"')
            case SpeechStatus(state="failed" | "expired" | "replaced"):
                self._line(message.stamp, "fails", f'to say "{message.text}": {message.state} {message.detail}')
            case HeadCommand():
                self._line(message.stamp, "head", {"track": "follows people", "centre": "looks straight on"}.get(
                    message.mode, f"looks at {_degrees(message.pan_rad)}, {_degrees(message.tilt_rad)}"
                ))  # fmt: skip
            case JointTrajectory():
                turned = ", ".join(map(_degrees, message.positions))
                self._head = f"head {turned}"
                self._line(message.stamp, "head", f"turns to {turned} in {message.duration_s:.1f} s")
        self._update(message.stamp)

    def _show_persons(self, message: PersonDetections) -> None:
        """Says who is seen when that changes, but not more often than once a second: detections flicker."""
        seconds = self._seconds(message.stamp)
        count = len(message.persons)
        if count != self._seen_count and seconds - self._seen_at >= SEEN_EVERY_S:
            self._seen_count, self._seen_at = count, seconds
            self._line(message.stamp, "sees", people_text(message.persons))

    def _line(self, stamp: int, verb: str, text: str) -> None:
        line = Text.assemble(
            (f"{self._seconds(stamp):7.2f} s  ", "dim"), (f"{verb:<9}", STYLES[verb]), Text(text, STYLES[verb])
        )
        self._console.print(line, soft_wrap=True)

    def _update(self, stamp: int) -> None:
        if self._live is not None:
            share = min(1.0, (stamp - self._start) / max(1, self._until - self._start))
            bar = ("━" * round(20 * share)).ljust(20, "╌")
            now = f"{self._seconds(stamp):7.2f} s  {bar}  {people_text(self._persons)}  {self._head}"
            self._live.update(Text(now, "dim", no_wrap=True, overflow="ellipsis"))

    def _seconds(self, stamp: int) -> float:
        return (stamp - self._start) / SECOND


def people_text(persons: Sequence[PersonDetection]) -> str:
    """Who is seen, nearest first: "2 people: 3.1 m 4° left, 5.0 m ahead"."""
    if not persons:
        return "nobody"
    nearest = sorted(persons, key=lambda person: math.inf if person.distance_m is None else person.distance_m)
    return f"{len(persons)} {'person' if len(persons) == 1 else 'people'}: {', '.join(map(_place, nearest))}"


def _place(person: PersonDetection) -> str:
    distance = "somewhere" if person.distance_m is None else f"{person.distance_m:.1f} m"
    degrees = round(math.degrees(person.bearing_rad or 0.0))
    side = "ahead" if degrees == 0 else f"{abs(degrees)}° {'left' if degrees > 0 else 'right'}"
    return f"{distance} {side}"


def _degrees(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.0f}°".replace("-0°", "0°")
