"""Shows a run of deliberating agents in the terminal as it happens: who does what, requests, failures and new plans."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.live import Live
from rich.text import Text

from socialbot.agent_messages import PlanExecutionInfo
from socialbot.clock import SECOND
from socialbot.graph import Graph
from socialbot.messages import Message, TraceRecord
from socialbot.report.narration import Narrator, Phrases, Sentence, Verb

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
