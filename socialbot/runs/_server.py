"""HTTP server of the run page: the API, and the changes of a live run as server-sent events."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from typing import Any, Literal, TypeVar

import msgspec
from starlette.applications import Starlette
from starlette.datastructures import QueryParams
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from socialbot.core.clock import SECOND
from socialbot.core.decoding import from_json
from socialbot.core.errors import RunError
from socialbot.core.messages import NO_JSON, Command
from socialbot.runs._access import FRESH, AccessGuard, BodyLimit, reply, reply_error
from socialbot.runs.asking import answer, chosen_option
from socialbot.runs.distances import distances_of
from socialbot.runs.narration import LogLine, last_log_lines, log_lines
from socialbot.runs.pages import PAGE, live_page
from socialbot.runs.run import CommandSender, NoCommands, RunView, node_views, overview
from socialbot.runs.state import AgentMind, RunState
from socialbot.runs.timeline import Changed
from socialbot.runs.why import explain, why_not

PERIOD_S = 0.1
NODES_S = 1.0

QUIET_S = 5.0
"""Interval of keep-alive events; pages reconnect after three missing ones."""

LONGEST_QUEUE = 50
"""A page with more pending events is disconnected; it reconnects by itself."""

MOST_NEW_LINES = 50

T = TypeVar("T")

log = logging.getLogger("socialbot.inspect")

KEEP_UP_S = 2.0
MOST_LINES = 500
LONGEST_QUESTION = 500

SMALLEST_PACKED = 2048
DRAWING_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'"


class CommandRequest(msgspec.Struct, frozen=True):
    """Command from a person to an agent, or a sentence to say."""

    agent: str
    command: Command | Literal["say"]
    text: str = ""


class PageServer:
    """Serve the page of ``run``; ``commands`` sends commands to agents.

    One thread reads the run and processes the messages of a live run. Another thread decodes images.
    """

    def __init__(self, run: RunView, commands: CommandSender | None = None) -> None:
        self.run = run
        self.commands: CommandSender = commands or NoCommands("this run is not live")
        self._run_thread = ThreadPoolExecutor(1, "inspect")
        self._image_thread = ThreadPoolExecutor(1, "pictures")
        self._broadcast = Broadcast(self)

    def application(self, token: str = "") -> Starlette:
        @asynccontextmanager
        async def lifespan(_: Starlette) -> AsyncIterator[None]:
            keeping_up = asyncio.create_task(self._keep_up())
            yield
            keeping_up.cancel()
            with suppress(asyncio.CancelledError):
                await keeping_up
            await self.close()
            self._run_thread.shutdown(wait=False)
            self._image_thread.shutdown(wait=False)

        routes = [
            Route("/", self._index),
            Route("/favicon.ico", self._icon),
            Route("/api/live", self._live),
            Route("/api/command", self._command, methods=["POST"]),
            Route("/api/picture", self._picture),
            Route("/api/world", self._world),
            Route("/api/sound/{name}", self._sound),
            Route("/api/{name}", self._answer),
            Mount("/page", StaticFiles(directory=PAGE, check_dir=False)),
        ]
        middleware = [
            Middleware(AccessGuard, token=token),
            Middleware(BodyLimit),
            Middleware(GZipMiddleware, minimum_size=SMALLEST_PACKED, compresslevel=1),
        ]
        handlers: dict[Any, Any] = {HTTPException: _http_error, RunError: _run_error}
        return Starlette(routes=routes, middleware=middleware, exception_handlers=handlers, lifespan=lifespan)

    async def show(self, run: RunView, commands: CommandSender | None = None) -> None:
        """Show another run after the end of a live one."""
        self.run, self.commands = run, commands or NoCommands("this run has ended")
        self._broadcast.change()

    async def close(self) -> None:
        """Disconnect all listening pages."""
        await self._broadcast.close()

    async def read(self, function: Callable[[], T]) -> T:
        """Call a function in the thread of the run."""
        return await asyncio.get_running_loop().run_in_executor(self._run_thread, function)

    async def _keep_up(self) -> None:
        """Process the messages of a live run also without listening pages."""
        last_error = ""
        while True:
            await asyncio.sleep(KEEP_UP_S)
            run = self.run
            if not run.live:
                continue
            try:
                await self.read(lambda: run.end)  # noqa: B023 - awaited before the next one
            except Exception as error:  # keep processing later messages
                if repr(error) != last_error:
                    last_error = repr(error)
                    log.exception("a received message cannot be shown")

    async def _index(self, request: Request) -> Response:
        return HTMLResponse(live_page(), headers={"Cache-Control": "no-cache"})

    async def _icon(self, request: Request) -> Response:
        return FileResponse(PAGE / "icon.svg")

    async def _answer(self, request: Request) -> Response:
        name, run, commands, query = request.path_params["name"], self.run, self.commands, request.query_params
        if name == "run":
            return reply(await self.read(lambda: overview(run, commands)))
        if name not in _ANSWERS:
            raise HTTPException(404)
        return reply(await self.read(lambda: _ANSWERS[name](run, query)))

    async def _picture(self, request: Request) -> Response:
        run = self.run
        stamp = await self.read(lambda: _stamp(run, request.query_params))
        picture = await asyncio.get_running_loop().run_in_executor(self._image_thread, run.picture, stamp)
        if picture is None:
            return Response(status_code=204, headers=FRESH)  # browsers log every 4xx on the console
        at_s = await self.read(lambda: run.history.seconds(picture.stamp) if len(run.history) else 0.0)
        return Response(picture.jpeg, headers={**FRESH, "X-Time": f"{at_s:.6f}"}, media_type="image/jpeg")

    async def _world(self, request: Request) -> Response:
        run = self.run
        drawing = await self.read(lambda: run.world(_stamp(run, request.query_params)))
        if drawing is None:
            raise HTTPException(404, "this run has no world to draw")
        headers = {**FRESH, "Content-Security-Policy": DRAWING_POLICY}
        return Response(drawing, headers=headers, media_type="image/svg+xml")

    async def _sound(self, request: Request) -> Response:
        run, name = self.run, request.path_params["name"]
        sound = await asyncio.get_running_loop().run_in_executor(self._image_thread, run.sound, name)
        if sound is None:
            return Response(status_code=204, headers=FRESH)
        return Response(sound, headers=FRESH, media_type="audio/wav")

    async def _live(self, request: Request) -> Response:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        return StreamingResponse(self._broadcast.listen(), media_type="text/event-stream", headers=headers)

    async def _command(self, request: Request) -> Response:
        if self.commands.shut:
            raise HTTPException(403, self.commands.shut)
        try:
            asked = from_json(await request.body(), CommandRequest)
        except NO_JSON as error:
            raise HTTPException(400, f"not a valid command: {error}") from error
        if asked.command == "say":
            reason = await self.commands.say(asked.text)
            return reply({"accepted": not reason, "reason": reason})
        answer = await self.commands.ask(asked.agent, asked.command, asked.text)
        if answer is None:
            raise HTTPException(504, f"{asked.agent} does not answer: it is not running, or has another key")
        return reply({"accepted": answer.accepted, "reason": answer.reason})


def _why(run: RunView, query: QueryParams) -> Any:
    if plan := query.get("plan"):
        return why_not(run.history, plan)
    name = query.get("id", "").rpartition("@")[2]
    record = run.history.find(name)
    if record is None:
        dropped = ", or it was dropped: the record on disk may have it" if run.history.forgotten else ""
        raise HTTPException(404, f"there is no record {name!r}{dropped}")
    return explain(run.history, run.wording, record)


def _ask(run: RunView, query: QueryParams) -> Any:
    question, agent = query.get("question", ""), query.get("agent", "")
    if len(question) > LONGEST_QUESTION:
        raise HTTPException(400, f"a question has at most {LONGEST_QUESTION} characters (got {len(question)})")
    if agent and agent not in run.history.agents:
        agent = ""  # one without records yet
    at_s = run.history.seconds(_stamp(run, query)) if "t" in query else None
    if reply_to := query.get("reply_to", "")[:LONGEST_QUESTION]:
        options = answer(run, reply_to, at_s=at_s, agent=agent).options
        if number := chosen_option([each.question for each in options], question):
            return options[number - 1]
    return answer(run, question, at_s=at_s, agent=agent)


_ANSWERS: Mapping[str, Callable[[RunView, QueryParams], Any]] = {
    "moment": lambda run, query: run.states.at(_stamp(run, query)),
    "trees": lambda run, query: run.trees(_stamp(run, query)),
    "nodes": lambda run, query: node_views(run, _stamp(run, query)),
    "timeline": lambda run, query: {"lanes": run.timeline.lanes(), "distances": distances_of(run)},
    "log": lambda run, query: last_log_lines(
        run, _stamp(run, query, "from", 0.0), _stamp(run, query, "to"), MOST_LINES
    ),
    "why": _why,
    "ask": _ask,
}
"""Answers of the API by name, read in the thread of the run."""


def _stamp(run: RunView, query: QueryParams, name: str = "t", default: float | None = None) -> int:
    history, text = run.history, query.get(name)
    if text is None:
        return run.end if default is None else history.stamp(default)
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds) or abs(seconds) > 1e9:
        raise HTTPException(400, f"{name} must be a time in seconds (got {text!r})")
    stamp = history.stamp(seconds)
    return max(stamp, history.since) if history.since > history.start else stamp


async def _http_error(request: Request, error: HTTPException) -> Response:
    return reply_error(error.status_code, str(error.detail))


async def _run_error(request: Request, error: RunError) -> Response:
    return reply_error(404, f"{error.what}: {error.remedy}" if error.remedy else error.what)


class News(msgspec.Struct, frozen=True):
    """Changes of a live run: state with the changed agents only, bars and log lines."""

    t: float
    began_s: float
    since_s: float
    moment: RunState
    bars: tuple[Changed, ...]
    log: tuple[LogLine, ...]


class Broadcast:
    """Send the changes of the run of ``server`` to all listening pages."""

    def __init__(self, server: PageServer) -> None:
        self._server = server
        self._pages: set[asyncio.Queue[bytes | None]] = set()
        self._task: asyncio.Task[None] | None = None
        self._agents: dict[str, AgentMind] = {}
        self._records = 0
        self._late = 0
        self._last: RunState | None = None

    async def listen(self) -> AsyncIterator[bytes]:
        """Yield the events for one page: the full state, then changes."""
        page: asyncio.Queue[bytes | None] = asyncio.Queue()
        run = self._server.run
        yield _event("moment", await self._server.read(lambda: run.states.at(run.end)))
        if not run.live:
            yield _event("ended", {})
            return
        self._pages.add(page)
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._send_changes())
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

    async def _send_changes(self) -> None:
        loop = asyncio.get_running_loop()
        due = nodes_due = loop.time()
        while self._pages and self._server.run.live:
            news = await self._server.read(self._news)
            if news is not None:
                self._send(_event("news", news))
            if loop.time() >= nodes_due:
                nodes_due = loop.time() + NODES_S
                self._send(_event("nodes", await self._server.read(self._nodes)))
                self._send(_event("office", self._server.commands.shut))
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
        run = self._server.run
        return node_views(run, run.end)

    def _news(self) -> News | None:
        run = self._server.run
        moment = run.states.at(run.end)
        changed = tuple(agent for agent in moment.agents if self._agents.get(agent.name) != agent)
        bars = run.timeline.changed()
        history = run.history
        late = history.late(0)
        moved = late[self._late if self._late <= len(late) else 0 :]  # the history drops old indices
        self._late = len(late)
        fresh = min(self._records - history.forgotten, *moved, len(history))
        lines = log_lines(run, history.part(max(0, fresh, len(history) - MOST_NEW_LINES), len(history)))
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
