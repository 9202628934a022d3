"""HTTP server of the run page: access control and the API."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import ipaddress
import logging
import math
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from http.cookies import SimpleCookie
from typing import Any, TypeVar
from urllib.parse import urlencode, urlsplit

import msgspec
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from socialbot.core.errors import RunError
from socialbot.core.messages import Command
from socialbot.runs._broadcast import Broadcast
from socialbot.runs.narration import LogLine, told_between
from socialbot.runs.pages import PAGE, live_page
from socialbot.runs.run import CommandSender, NoCommands, RunView, node_views, overview
from socialbot.runs.why import explain, why_not

JSON = "application/json"
FRESH = {"Cache-Control": "no-store"}
"""Answers must not be cached: the server may show another run later."""


def reply(content: Any, *, status: int = 200) -> Response:
    """Return ``content``, which may hold structs, as JSON."""
    return Response(msgspec.json.encode(content), status, FRESH, JSON)


def reply_error(status: int, what: str) -> Response:
    """Return an error as JSON."""
    return reply({"error": what}, status=status)


COOKIE = "socialbot_inspect"

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob:",
        "connect-src 'self'",
        "manifest-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": POLICY,
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of every answer: the page loads only its own files and must not be framed."""


class AccessGuard:
    """Middleware that checks host name, token and origin.

    The host must be an address or the name of this machine, against DNS rebinding. A ``token`` is a bearer token, or a
    URL parameter that sets a cookie. Requests that change state must have the origin of the page, or none.
    """

    def __init__(self, app: ASGIApp, token: str = "") -> None:
        self._app = app
        self._token = token
        self._pass = hashlib.sha256(f"cookie of {token}".encode()).hexdigest() if token else ""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        headers = Headers(scope=scope)
        if not is_own_name(headers.get("host", "")):
            await reply_error(421, "this server does not answer to that name")(scope, receive, send_with_headers)
        elif self._token and await self._turned_away(scope, headers, receive, send_with_headers):
            return
        elif scope["method"] not in ("GET", "HEAD") and (fault := foreign(headers)):
            await reply_error(403, fault)(scope, receive, send_with_headers)
        else:
            await self._app(scope, receive, send_with_headers)

    async def _turned_away(self, scope: Scope, headers: Headers, receive: Receive, send: Send) -> bool:
        query = QueryParams(scope["query_string"])
        if "token" in query and _same(query["token"], self._token):
            rest = urlencode([(name, value) for name, value in query.multi_items() if name != "token"])
            place = scope["path"] + (f"?{rest}" if rest else "")
            cookie = f"{COOKIE}={self._pass}; Path=/; HttpOnly; SameSite=Strict"
            await send(
                {
                    "type": "http.response.start",
                    "status": 303,
                    "headers": [
                        (b"location", place.encode("ascii", "ignore")),
                        (b"set-cookie", cookie.encode()),
                        (b"cache-control", b"no-store"),
                    ],
                }
            )
            await send({"type": "http.response.body"})
            return True
        scheme, _, given = headers.get("authorization", "").partition(" ")
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        if scheme.lower() == "bearer" and _same(given.strip(), self._token):
            return False
        if cookie is not None and _same(cookie.value, self._pass):
            return False
        await reply_error(401, "the token is missing or wrong: open the address that was printed")(scope, receive, send)
        return True


def is_own_name(host: str) -> bool:
    """Return whether a Host header is an address, ``localhost``, or the name of this machine."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    if name in ("localhost", *_machine()):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def foreign(headers: Headers) -> str:
    """Return the reason to refuse a request that changes state; empty if accepted."""
    if headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
        return "only application/json is taken"
    origin = headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != headers.get("host"):
        return "that comes from another site"
    if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
        return "that comes from another site"
    return ""


def _machine() -> tuple[str, str]:
    name = socket.gethostname().lower()
    return name, f"{name.partition('.')[0]}.local"


def _same(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())


T = TypeVar("T")

log = logging.getLogger("socialbot.inspect")

KEEP_UP_S = 2.0
MOST_LINES = 500

LARGEST_COMMAND = 65_536
"""Limit for the body of a command (bytes)."""

SMALLEST_PACKED = 2048
"""Smaller answers (bytes) are not compressed."""

DRAWING_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'"
"""Drawings use inline styles and load nothing."""


class Asked(msgspec.Struct, frozen=True):
    """Command from a person to an agent."""

    agent: str
    command: Command
    text: str = ""


class PageServer:
    """Serve the page of ``run``; ``office`` takes commands.

    One thread reads the run and processes the messages of a live run. Another thread decodes images.
    """

    def __init__(self, run: RunView, office: CommandSender | None = None) -> None:
        self.run = run
        self.office: CommandSender = office or NoCommands("this run is not live")
        self._desk = ThreadPoolExecutor(1, "inspect")
        self._darkroom = ThreadPoolExecutor(1, "pictures")
        self._broadcast = Broadcast(lambda: self.run, lambda: self.office.shut, self._look)

    def application(self, token: str = "") -> Starlette:
        @asynccontextmanager
        async def lifespan(_: Starlette) -> AsyncIterator[None]:
            keeping_up = asyncio.create_task(self._keep_up())
            yield
            keeping_up.cancel()
            with suppress(asyncio.CancelledError):
                await keeping_up
            await self.close()
            self._desk.shutdown(wait=False)
            self._darkroom.shutdown(wait=False)

        routes = [
            Route("/", self._index),
            Route("/favicon.ico", self._icon),
            *(Route(f"/api/{name}", _answered(ask)) for name, ask in self._questions().items()),
            Route("/api/live", self._live),
            Route("/api/command", self._command, methods=["POST"]),
            Mount("/page", StaticFiles(directory=PAGE, check_dir=False)),
        ]
        middleware = [
            Middleware(AccessGuard, token=token),
            Middleware(GZipMiddleware, minimum_size=SMALLEST_PACKED, compresslevel=1),
        ]
        handlers: dict[Any, Any] = {HTTPException: _refused, RunError: _not_there}
        return Starlette(routes=routes, middleware=middleware, exception_handlers=handlers, lifespan=lifespan)

    async def show(self, run: RunView, office: CommandSender | None = None) -> None:
        """Show another run after the end of a live one."""
        self.run, self.office = run, office or NoCommands("this run has ended")
        self._broadcast.change()

    async def close(self) -> None:
        """Disconnect all listening pages."""
        await self._broadcast.close()

    async def _keep_up(self) -> None:
        """Process the messages of a live run also without listening pages."""
        told = ""
        while True:
            await asyncio.sleep(KEEP_UP_S)
            run = self.run
            if not run.live:
                continue
            try:
                await self._look(lambda: run.end)  # noqa: B023 - awaited before the next one
            except Exception as error:  # keep processing later messages
                if repr(error) != told:
                    told = repr(error)
                    log.exception("some of what was heard cannot be shown")

    async def _look(self, look: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._desk, look)

    # The page

    async def _index(self, request: Request) -> Response:
        return HTMLResponse(live_page(), headers={"Cache-Control": "no-cache"})

    async def _icon(self, request: Request) -> Response:
        path = PAGE / "icon.svg"
        return FileResponse(path) if path.is_file() else Response(status_code=204)

    # Queries

    def _questions(self) -> dict[str, Callable[[Request], Awaitable[Response]]]:
        return {
            "run": self._overview,
            "moment": self._moment,
            "picture": self._picture,
            "world": self._world,
            "trees": self._trees,
            "nodes": self._nodes,
            "timeline": self._timeline,
            "log": self._log,
            "why": self._why,
        }

    async def _overview(self, request: Request) -> Response:
        run, office = self.run, self.office
        return reply(await self._look(lambda: overview(run, office)))

    async def _moment(self, request: Request) -> Response:
        run = self.run
        return reply(await self._look(lambda: run.course.at(_stamp(request, run))))

    async def _picture(self, request: Request) -> Response:
        run = self.run
        stamp = await self._look(lambda: _stamp(request, run))
        picture = await asyncio.get_running_loop().run_in_executor(self._darkroom, run.picture, stamp)
        if picture is None:
            return Response(status_code=204, headers=FRESH)  # browsers log every 4xx on the console
        at_s = await self._look(lambda: run.history.seconds(picture.stamp) if len(run.history) else 0.0)
        headers = {**FRESH, "X-Time": f"{at_s:.6f}"}
        return Response(picture.jpeg, headers=headers, media_type="image/jpeg")

    async def _world(self, request: Request) -> Response:
        run = self.run
        drawing = await self._look(lambda: run.world(_stamp(request, run)))
        if drawing is None:
            raise HTTPException(404, "this run has no world to draw")
        headers = {**FRESH, "Content-Security-Policy": DRAWING_POLICY}
        return Response(drawing, headers=headers, media_type="image/svg+xml")

    async def _trees(self, request: Request) -> Response:
        run = self.run
        return reply(await self._look(lambda: run.trees(_stamp(request, run))))

    async def _nodes(self, request: Request) -> Response:
        run = self.run
        return reply(await self._look(lambda: node_views(run, _stamp(request, run))))

    async def _timeline(self, request: Request) -> Response:
        run = self.run
        return reply({"lanes": await self._look(lambda: run.timeline.lanes())})

    async def _log(self, request: Request) -> Response:
        run = self.run

        def lines() -> list[LogLine]:
            return told_between(run, _stamp(request, run, "from", 0.0), _stamp(request, run, "to"), MOST_LINES)

        return reply(await self._look(lines))

    async def _why(self, request: Request) -> Response:
        run = self.run
        if plan := request.query_params.get("plan"):
            return reply(await self._look(lambda: why_not(run.history, plan)))
        name = request.query_params.get("id", "").rpartition("@")[2]
        record = await self._look(lambda: run.history.find(name))
        if record is None:
            forgotten = ", or it is forgotten: the record on disk may have it" if run.history.forgotten else ""
            raise HTTPException(404, f"there is no record {name!r}{forgotten}")
        return reply(await self._look(lambda: explain(run.history, run.wording, record)))

    async def _live(self, request: Request) -> Response:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        return StreamingResponse(self._broadcast.listen(), media_type="text/event-stream", headers=headers)

    # Commands to agents

    async def _command(self, request: Request) -> Response:
        if self.office.shut:
            raise HTTPException(403, self.office.shut)
        body = b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > LARGEST_COMMAND:
                raise HTTPException(413, "that is too long")
        try:
            asked = msgspec.json.decode(body, type=Asked)
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise HTTPException(400, f"that cannot be read: {error}") from error
        answer = await self.office.ask(asked.agent, asked.command, asked.text)
        if answer is None:
            raise HTTPException(504, f"{asked.agent} does not answer: it is not there, or does not know this key")
        return reply({"accepted": answer.accepted, "reason": answer.reason})


def _stamp(request: Request, run: RunView, name: str = "t", default: float | None = None) -> int:
    text = request.query_params.get(name)
    if text is None:
        return run.end if default is None else run.history.stamp(default)
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds) or abs(seconds) > 1e9:
        raise HTTPException(400, f"{name} is to be a time in seconds")
    stamp = run.history.stamp(seconds)
    history = run.history
    return max(stamp, history.since) if history.since > history.start else stamp


def _answered(ask: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """Wrap a bound method, as Starlette expects functions."""

    async def answer(request: Request) -> Response:
        return await ask(request)

    return answer


async def _refused(request: Request, error: HTTPException) -> Response:
    return reply_error(error.status_code, str(error.detail))


async def _not_there(request: Request, error: RunError) -> Response:
    return reply_error(404, f"{error.what}: {error.remedy}" if error.remedy else error.what)
