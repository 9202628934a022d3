"""What happens in a live run, told to every page that looks: at most ten times a second, and only what is new."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from typing import Any

import msgspec

from socialbot.core.clock import SECOND
from socialbot.runs.narration import LogLine, told
from socialbot.runs.run import Run, node_views
from socialbot.runs.state import AgentMoment, Moment
from socialbot.runs.timeline import Changed

PERIOD_S = 0.1
NODES_S = 1.0
"""So often it is told how the nodes are."""

QUIET_S = 5.0
"""After so long without news a sign of life is sent, also while the run is being looked at: a page that hears none for
three times as long takes the connection for lost."""

LONGEST_QUEUE = 50
"""A page that has so much news waiting is sent away; it comes back and begins anew."""

MOST_LINES = 50
"""So many lines of the log are told at once: nobody reads more of what passes by."""


class News(msgspec.Struct, frozen=True):
    """What is new: the moment, with those agents only that have changed; bars that are new or have changed; lines.

    It began at ``began_s``, as in an `Overview`: a page may be older than the first record. What was before ``since_s``
    is forgotten.
    """

    t: float
    began_s: float
    since_s: float
    moment: Moment
    bars: tuple[Changed, ...]
    log: tuple[LogLine, ...]


Look = Callable[[Callable[[], Any]], Awaitable[Any]]
"""Calls a function in the thread in which the run is looked at."""


class Broadcast:
    """Looks at the ``run`` as long as somebody listens; ``look`` calls a function in the run's thread.

    ``shut`` gives why nothing can be asked of agents, as `Office.shut`.
    """

    def __init__(self, run: Callable[[], Run], shut: Callable[[], str], look: Look) -> None:
        self._run = run
        self._shut = shut
        self._look = look
        self._pages: set[asyncio.Queue[bytes | None]] = set()
        self._task: asyncio.Task[None] | None = None
        self._agents: dict[str, AgentMoment] = {}
        self._records = 0
        self._last: Moment | None = None

    async def listen(self) -> AsyncIterator[bytes]:
        """The events for one page, until it goes: first everything that holds, then what is new."""
        page: asyncio.Queue[bytes | None] = asyncio.Queue()
        run = self._run()
        yield _event("moment", await self._look(lambda: run.course.at(run.end)))
        if not run.live:
            yield _event("ended", {})
            return
        self._pages.add(page)
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._tell())
        try:
            while True:
                try:
                    event = await asyncio.wait_for(page.get(), QUIET_S)
                except asyncio.TimeoutError:
                    event = _event("alive", {})
                if event is None:
                    return
                yield event
        finally:
            self._pages.discard(page)

    def change(self) -> None:
        """Tells every page that the run has ended, or is another one."""
        for page in self._pages:
            page.put_nowait(_event("ended", {}))
            page.put_nowait(None)
        self._agents.clear()
        self._last = None

    async def close(self) -> None:
        """Sends every page away."""
        for page in self._pages:
            page.put_nowait(None)
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task

    async def _tell(self) -> None:
        loop = asyncio.get_running_loop()
        due = nodes_due = loop.time()
        while self._pages and self._run().live:
            news = await self._look(self._news)
            if news is not None:
                self._send(_event("news", news))
            if loop.time() >= nodes_due:
                nodes_due = loop.time() + NODES_S
                self._send(_event("nodes", await self._look(self._nodes)))
                self._send(_event("office", self._shut()))
            due = max(due + PERIOD_S, loop.time() + PERIOD_S / 2)
            await asyncio.sleep(due - loop.time())

    def _send(self, event: bytes) -> None:
        for page in list(self._pages):
            if page.qsize() >= LONGEST_QUEUE:
                self._pages.discard(page)
                page.put_nowait(None)
            else:
                page.put_nowait(event)

    def _nodes(self) -> Any:
        run = self._run()
        return node_views(run, run.end)

    def _news(self) -> News | None:
        """What is new since the last time; None when nothing is."""
        run = self._run()
        moment = run.course.at(run.end)
        changed = tuple(agent for agent in moment.agents if self._agents.get(agent.name) != agent)
        bars = run.timeline.changed()
        history = run.history
        fresh = min(history.forgotten + len(history) - self._records, MOST_LINES)
        lines = told(run, history.part(max(0, len(history) - fresh), len(history)))
        self._records = history.forgotten + len(history)
        self._agents.update((agent.name, agent) for agent in changed)
        before, self._last = self._last, moment
        if before is not None and before.at_s == moment.at_s and not (changed or bars or lines):
            return None
        shown = msgspec.structs.replace(moment, agents=changed)
        since_s = history.seconds(history.since)
        return News(moment.at_s, history.start / SECOND, since_s, shown, bars, tuple(lines))


def _event(name: str, content: Any) -> bytes:
    return b"event: " + name.encode() + b"\ndata: " + msgspec.json.encode(content) + b"\n\n"
