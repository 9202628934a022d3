"""Server-sent events with the changes of a live run, at most ten a second."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from typing import Any

import msgspec

from socialbot.core.clock import SECOND
from socialbot.runs.narration import LogLine, told
from socialbot.runs.run import RunView, node_views
from socialbot.runs.state import AgentMind, RunState
from socialbot.runs.timeline import Changed

PERIOD_S = 0.1
NODES_S = 1.0

QUIET_S = 5.0
"""Interval of keep-alive events; pages reconnect after three missing ones."""

LONGEST_QUEUE = 50
"""A page with more pending events is disconnected; it reconnects by itself."""

MOST_LINES = 50


class News(msgspec.Struct, frozen=True):
    """Changes of a live run: state with the changed agents only, bars and log lines."""

    t: float
    began_s: float
    since_s: float
    moment: RunState
    bars: tuple[Changed, ...]
    log: tuple[LogLine, ...]


Look = Callable[[Callable[[], Any]], Awaitable[Any]]
"""Calls a function in the thread of the run."""


class Broadcast:
    """Send the changes of ``run`` to all listening pages.

    Args:
        run: Return the run.
        shut: Return the reason for refusing commands, or an empty string.
        look: Call a function in the thread of the run.
    """

    def __init__(self, run: Callable[[], RunView], shut: Callable[[], str], look: Look) -> None:
        self._run = run
        self._shut = shut
        self._look = look
        self._pages: set[asyncio.Queue[bytes | None]] = set()
        self._task: asyncio.Task[None] | None = None
        self._agents: dict[str, AgentMind] = {}
        self._records = 0
        self._last: RunState | None = None

    async def listen(self) -> AsyncIterator[bytes]:
        """Yield the events for one page: the full state, then changes."""
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
        """Notify all pages that the run has ended or changed."""
        for page in self._pages:
            page.put_nowait(_event("ended", {}))
            page.put_nowait(None)
        self._agents.clear()
        self._last = None

    async def close(self) -> None:
        """Disconnect all pages."""
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
