"""Terminal display of a live run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TypeVar

from rich.console import Console
from rich.live import Live
from rich.text import Text

from socialbot.core.clock import SECOND
from socialbot.core.messages import (
    HeadCommand,
    Health,
    HeardSpeech,
    JointTrajectory,
    Message,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    TraceRecord,
    Utterance,
)
from socialbot.core.registry import phrases_of
from socialbot.deliberation.messages import PlanExecutionInfo
from socialbot.graph.health import is_unconnected
from socialbot.graph.node import Graph
from socialbot.runs.narration import Narrator, Verb, Wording
from socialbot.runs.record import trace_record

_STYLES = {
    "sees": "cyan",
    "believes": "yellow",
    "wants": "magenta",
    "does": "bold",
    "hears": "bold cyan",
    "says": "bold green",
    "head": "blue",
    "fails": "bold red",
    "waits": "yellow",
    "works": "green",
    "notes": "yellow",
}
_VERBS = {"belief": "believes", "goal": "wants", "action": "does", "failure": "fails"}
_SIGNS: dict[Verb, tuple[str, str]] = {
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
_V = TypeVar("_V")
_AGENT_STYLES = ("bold", "blue", "red", "green", "yellow", "magenta", "cyan")
_SEEN_EVERY_S = 1.0
_BAR = 24
_KEPT = 200  # actions and utterances that later speech may refer to
_LATE_NS = SECOND // 2  # by which the record of an action may arrive after its speech


@dataclass
class _Repeats:
    """Failures that equal the line printed last: their text, number and last time (ns)."""

    text: str = ""
    times: int = 0
    last: int = 0

    def count(self, stamp: int) -> None:
        self.times += 1
        self.last = stamp


class _Lacks:
    """What each node of ``graph`` lacks, by its health. Inputs that lack only another node's messages do not count.

    The remark of a node that works counts if it was made at the start.
    """

    def __init__(self, graph: Graph) -> None:
        self._published = {topic for config in graph.nodes for topic, _ in config.publications}
        self._lacks = {config.name: "" for config in graph.nodes}
        self._new = set(self._lacks)

    def change(self, health: Health) -> tuple[str, str] | None:
        """Verb and text of a line about a change; None without one."""
        if health.node not in self._lacks:
            return None
        if health.node in self._new and not is_unconnected(health):
            self._new.remove(health.node)
            if health.state == "ok" and health.reason:
                return "notes", f"{health.node}: {health.reason}"
        lacks = health.reason if self._counts(health) else ""
        before, self._lacks[health.node] = self._lacks[health.node], lacks
        if lacks == before:
            return None
        if not lacks:
            return "works", f"{health.node} again"
        return "waits" if health.state == "waiting" else "fails", f"{health.node}: {lacks}"

    def _counts(self, health: Health) -> bool:
        if health.state not in ("waiting", "degraded", "failed") or is_unconnected(health):
            return False
        return health.state == "failed" or not health.silent or not self._published.issuperset(health.silent)


class Display:
    """Print a line for each event, above a status line with time, progress and current activity.

    Deliberating agents appear as sentences of their story, other agents as beliefs, goals and actions.
    """

    def __init__(
        self,
        console: Console,
        graph: Graph | None = None,
        *,
        start: int | None = None,
        until: int | None = None,
        details: bool = False,
        health_of: Graph | None = None,
    ) -> None:
        """Create the display.

        Args:
            console: Where to print.
            graph: The graph that runs, without its sources.
            start: Time (ns) that counts as 0 s; that of the first record by default, as in the record of the run, and
                before it that of the first line.
            until: Time (ns) of the end; the expected end of the plans by default.
            details: Also print a line for each head motion and each change of the number of people in view.
            health_of: The whole graph, to also print a line when one of its nodes lacks something, and when it works
                again.
        """
        nodes = graph.nodes if graph is not None else ()
        tells_story = any(node.type.deliberates for node in nodes)
        agents = [node.name for node in nodes]
        self._console = console
        self._narrator = Narrator(Wording(phrases=phrases_of(graph))) if tells_story else None
        self._agent_styles = {name: _AGENT_STYLES[number % len(_AGENT_STYLES)] for number, name in enumerate(agents)}
        self._width = max(map(len, agents), default=0)
        self._details = details
        self._live = Live(console=console, refresh_per_second=8, transient=True) if console.is_terminal else None
        self._start = start
        self._first_line: int | None = None
        self._until = until
        self._plan_ends: dict[str, int] = {}
        self._doing: dict[str, dict[str, str]] = {}
        self._persons: Sequence[PersonDetection] | None = None
        self._head = ""
        self._seen_at = -math.inf
        self._seen_count = 0
        self._actions: dict[str, None] = {}
        self._causes: dict[str, str] = {}
        self._unspoken: dict[str, SpeechStatus] = {}
        self._repeats = _Repeats()
        self._lacks = None if health_of is None else _Lacks(health_of)

    def __enter__(self) -> Display:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._show_speech(math.inf)
        self._end_repeats()
        if self._live is not None:
            self._live.stop()

    def show(self, topic: str, message: Message) -> None:
        """Show one message; messages of other types are ignored."""
        if self._start is None and trace_record(topic, message) is not None:
            self._start = message.stamp
        self._show_speech(message.stamp)
        match message:
            case TraceRecord():
                self._show_record(message)
            case PersonDetections():
                self._persons = message.known
                self._show_persons(message)
            case Utterance():
                _keep(self._causes, message.id, message.cause)
                self._show_speech(message.stamp)
            case SpeechStatus(state="started"):
                self._unspoken[message.utterance_id] = message
                self._show_speech(message.stamp)
            case SpeechStatus(state="failed" | "expired" | "replaced" | "interrupted"):
                self._line(message.stamp, "fails", f'to say "{message.text}": {message.state} {message.detail}')
            case Health() if self._lacks is not None:
                if (change := self._lacks.change(message)) is not None:
                    self._line(message.stamp, *change)
            case HeardSpeech():
                who = f"{message.person}: " if message.person else ""
                self._line(message.stamp, "hears", f'{who}"{message.text}"')
            case HeadCommand():
                direction = f"looks at {_degrees(message.pan_rad)}, {_degrees(message.tilt_rad)}"
                known = {"track": "follows people", "centre": "looks straight on"}
                self._detail(message.stamp, "head", known.get(message.mode, direction))
            case JointTrajectory():
                turned = ", ".join(map(_degrees, message.positions))
                self._head = f"head {turned}"
                self._detail(message.stamp, "head", f"turns to {turned} in {message.duration_s:.1f} s")
            case PlanExecutionInfo():
                left_s = message.estimated_deadline - message.current_time if message.target is not None else 0.0
                self._plan_ends[message.agent_id] = message.stamp + round(left_s * SECOND)
            case _:
                return
        self._update(message.stamp)

    def _show_record(self, record: TraceRecord) -> None:
        if self._narrator is None:
            if record.kind == "failure":
                self._show_failure(record)
            elif record.kind in _VERBS:
                self._line(record.stamp, _VERBS[record.kind], record.what)
            if record.kind == "action":
                _keep(self._actions, record.id, None)
                self._show_speech(record.stamp)
            return
        doing = self._doing.setdefault(record.source, {})
        if record.kind == "step":
            doing[record.what] = self._narrator.wording.step(record)
        elif record.kind == "step_end":
            doing.pop(record.what, None)
        sentence = self._narrator.story(record)
        if sentence is not None:
            verb, text = sentence
            sign, style = _SIGNS[verb]
            agent = (f"{record.source:<{self._width}}  ", self._agent_styles.get(record.source, ""))
            self._print(record.stamp, agent, (f"{sign} {text}", style))

    def _show_failure(self, record: TraceRecord) -> None:
        """Print a failure. Equal ones after it, as of a sensor at each frame, are counted instead."""
        detail = record.detail
        text = f"{record.what}: {detail.get('message') or detail.get('reason')}"
        if where := detail.get("where"):  # of an exception; for a step of a plan, the message begins with its class
            kind = "" if detail.get("reason") == "exception" else f"{detail.get('reason', '')}: "
            text = f"{record.what}: {kind}{detail.get('message', '')} ({where})"
        if text == self._repeats.text:
            self._repeats.count(record.stamp)
        else:
            self._line(record.stamp, "fails", text)
            self._repeats = _Repeats(text)

    def _end_repeats(self) -> None:
        repeats, self._repeats = self._repeats, _Repeats()
        if repeats.times:
            self._line(repeats.last, "fails", f"... {repeats.times} more {'time' if repeats.times == 1 else 'times'}")

    def _show_speech(self, now: float) -> None:
        """Print speech that has begun, once the action behind it is shown: topics of a live run arrive in any order."""
        for speech in list(self._unspoken.values()):
            cause = self._causes.get(speech.utterance_id)
            if self._narrator is not None or cause == "" or cause in self._actions or now - speech.stamp > _LATE_NS:
                del self._unspoken[speech.utterance_id]
                self._line(speech.stamp, "says", f'"{speech.text}"')

    def _show_persons(self, message: PersonDetections) -> None:
        """Print changes of the number of persons, at most once a second as detections flicker."""
        seconds, count = self._seconds(message.stamp), len(message.known)
        if self._details and count != self._seen_count and seconds - self._seen_at >= _SEEN_EVERY_S:
            self._seen_count, self._seen_at = count, seconds
            self._line(message.stamp, "sees", people_text(message.known))

    def _line(self, stamp: int, verb: str, text: str) -> None:
        self._print(stamp, (f"{verb:<9}", _STYLES[verb]), (text, _STYLES[verb]))

    def _detail(self, stamp: int, verb: str, text: str) -> None:
        if self._details:
            self._line(stamp, verb, text)

    def _print(self, stamp: int, *parts: tuple[str, str]) -> None:
        self._end_repeats()
        if self._first_line is None:
            self._first_line = stamp
        self._console.print(Text.assemble((f"{self._seconds(stamp):7.2f} s  ", "dim"), *parts), soft_wrap=True)

    def _update(self, stamp: int) -> None:
        if self._live is None or self._start is None:
            return
        until = self._until if self._until is not None else max(self._plan_ends.values(), default=self._start)
        share = min(1.0, (stamp - self._start) / (max(until, stamp) - self._start)) if until > self._start else 0.0
        bar = ("━" * round(_BAR * share)).ljust(_BAR, "╌")
        people = "" if self._persons is None else people_text(self._persons)
        doing = (f"{agent} {', '.join(now.values())}" for agent, now in self._doing.items() if now)
        status = "   ".join(filter(None, (people, self._head, *doing)))
        line = f"{self._seconds(stamp):7.2f} s  {bar}  {status}"
        self._live.update(Text(line, "dim", no_wrap=True, overflow="ellipsis"))

    def _seconds(self, stamp: int) -> float:
        return (stamp - (self._start or self._first_line or 0)) / SECOND


def _keep(kept: dict[str, _V], key: str, value: _V) -> None:
    kept[key] = value
    if len(kept) > _KEPT:
        del kept[next(iter(kept))]


def people_text(persons: Sequence[PersonDetection]) -> str:
    """Return the persons in view, nearest first: "2 people: 3.1 m 4° left, 5.0 m ahead"."""
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
