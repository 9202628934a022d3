"""Show a run in the terminal while it happens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.live import Live
from rich.text import Text

from socialbot.core.clock import SECOND
from socialbot.core.messages import (
    HeadCommand,
    JointTrajectory,
    Message,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    TraceRecord,
)
from socialbot.deliberation.messages import PlanExecutionInfo
from socialbot.graph.node import Graph
from socialbot.runs.narration import Narrator, Phrases, Sentence, Verb

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


SIGNS: dict[Verb, tuple[str, str]] = {
    "wants": ("◆", "magenta"),
    "plans": ("▤", "cyan"),
    "does": ("·", ""),
    "asks": ("→", "yellow"),
    "tells": ("→", "dim"),
    "reached": ("✓", "bold green"),
    "fails": ("✗", "bold red"),
    "drops": ("✗", "bold red"),
    "rests": ("-", "dim"),
    "refuses": ("✗", "bold red"),
    "senses": ("~", "yellow"),
}
AGENT_STYLES = ("bold", "blue", "red", "green", "yellow", "magenta", "cyan")
BAR = 24


class RunDisplay:
    """Prints a line for each thing that happens, and keeps one line below them: the time, and who does what now.

    Its bar fills up to the time at which the plans are expected to end.
    """

    def __init__(self, console: Console, phrases: Phrases, graph: Graph) -> None:
        """``graph`` holds the agents that are shown, ``phrases`` how their actions are said."""
        agents = [placement.name for placement in graph.placements]
        self._console = console
        self._narrator = Narrator(phrases)
        self._styles = {name: AGENT_STYLES[number % len(AGENT_STYLES)] for number, name in enumerate(agents)}
        self._width = max(map(len, agents), default=0)
        self._live = Live(console=console, refresh_per_second=12, transient=True) if console.is_terminal else None
        self._start: int | None = None
        self._ends: dict[str, int] = {}
        self._doing: dict[str, dict[str, str]] = {}

    def __enter__(self) -> RunDisplay:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, topic: str, message: Message) -> None:
        """Shows one message."""
        match message:
            case TraceRecord():
                self._start = message.stamp if self._start is None else self._start
                self._note(message)
                sentence = self._narrator.tell(message)
                if sentence is not None:
                    self._line(sentence)
            case PlanExecutionInfo():
                left_s = message.estimated_deadline - message.current_time if message.target is not None else 0.0
                self._ends[message.agent_id] = message.stamp + round(left_s * SECOND)
            case _:
                return
        self._update(message.stamp)

    def _note(self, record: TraceRecord) -> None:
        doing = self._doing.setdefault(record.source, {})
        if record.kind == "step":
            doing[record.what] = self._narrator.phrase(record.detail["action"], record.detail["args"])
        elif record.kind == "step_end":
            doing.pop(record.what, None)

    def _line(self, sentence: Sentence) -> None:
        sign, style = SIGNS[sentence.verb]
        line = Text.assemble(
            (f"{self._seconds(sentence.stamp):7.2f} s  ", "dim"),
            (f"{sentence.agent:<{self._width}}  ", self._styles.get(sentence.agent, "")),
            (f"{sign} {sentence.text}", style),
        )
        self._console.print(line, soft_wrap=True)

    def _update(self, stamp: int) -> None:
        if self._live is None or self._start is None:
            return
        whole = max(*self._ends.values(), stamp) - self._start if self._ends else 0
        share = (stamp - self._start) / whole if whole else 0.0
        bar = ("━" * round(BAR * share)).ljust(BAR, "╌")
        doing = "   ".join(f"{agent} {', '.join(now.values())}" for agent, now in self._doing.items() if now)
        self._live.update(
            Text(f"{self._seconds(stamp):7.2f} s  {bar}  {doing}", "dim", no_wrap=True, overflow="ellipsis")
        )

    def _seconds(self, stamp: int) -> float:
        return (stamp - (self._start or 0)) / SECOND
