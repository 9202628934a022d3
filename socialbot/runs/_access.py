"""Access control and limits of the page server: host name, token, origin, and size and time of request bodies."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import ipaddress
import socket
from collections.abc import Mapping
from http.cookies import SimpleCookie
from typing import Any
from urllib.parse import urlencode, urlsplit

import msgspec
from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

JSON = "application/json"
FRESH = {"Cache-Control": "no-store"}
"""Answers must not be cached: the server may show another run later."""


def reply(content: Any, *, status: int = 200) -> Response:
    """Return ``content``, which may hold structs, as JSON."""
    return Response(msgspec.json.encode(content), status, FRESH, JSON)


def reply_error(status: int, what: str) -> Response:
    """Return an error as JSON."""
    return reply({"error": what}, status=status)


def _refusal(status: int, what: str) -> Response:
    """Return an error that ends its connection, so that strangers keep no place."""
    answer = reply_error(status, what)
    answer.headers["Connection"] = "close"
    return answer


COOKIE = "socialbot_inspect"
OTHER_SITE = "the request comes from another site"

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob:",
        "connect-src 'self'",
        "media-src 'self'",
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
    URL parameter that sets a cookie. Requests must come from the page, or from no other site; a link may open the page.
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
        answer: ASGIApp = self._app
        if not is_own_name(headers.get("host", "")):
            answer = _refusal(421, "this server has another name")
        elif self._token and (refusal := self._without_access(scope, headers)):
            answer = refusal
        elif reason := foreign(headers, scope["path"], reads=scope["method"] in ("GET", "HEAD")):
            answer = _refusal(403, reason)
        await answer(scope, receive, send_with_headers)

    def _without_access(self, scope: Scope, headers: Headers) -> Response | None:
        query = QueryParams(scope["query_string"])
        if _same(query.get("token", ""), self._token):
            rest = urlencode([(name, value) for name, value in query.multi_items() if name != "token"])
            path = "/" + scope["path"].lstrip("/")  # a path that begins with two slashes is another site
            response: Response = RedirectResponse(path + (f"?{rest}" if rest else ""), 303, FRESH)
            if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
                # A link of another site: browsers send the cookie only if this page goes on by itself.
                response = Response(headers={**FRESH, "Refresh": f"0; url={response.headers['location']}"})
            response.set_cookie(COOKIE, self._pass, httponly=True, samesite="strict")
            return response
        scheme, _, given = headers.get("authorization", "").partition(" ")
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        if scheme.lower() == "bearer" and _same(given.strip(), self._token):
            return None
        if cookie is not None and _same(cookie.value, self._pass):
            return None
        return _refusal(401, "the token is missing or wrong: open the printed address")


MAX_BODY_BYTES = 64 * 1024
BODY_WITHIN_S = 5.0  # time for the body of a request


class BodyLimit:
    """Middleware that refuses large bodies, and slow ones."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD"):
            await self._app(scope, receive, send)
            return
        try:
            body = await asyncio.wait_for(_body(receive), BODY_WITHIN_S)
        except asyncio.TimeoutError:
            await reply_error(408, f"the body did not arrive in {BODY_WITHIN_S:.0f} s")(scope, receive, send)
            return
        if len(body) > MAX_BODY_BYTES:
            await reply_error(413, f"the body is larger than {MAX_BODY_BYTES} bytes")(scope, receive, send)
            return
        parts = iter([{"type": "http.request", "body": body, "more_body": False}])

        async def receive_again() -> Message:
            return next(parts, None) or await receive()

        await self._app(scope, receive_again, send)


async def _body(receive: Receive) -> bytes:
    """The body of a request, or its beginning if it is too large."""
    body, more = b"", True
    while more and len(body) <= MAX_BODY_BYTES:
        message = await receive()
        body, more = body + message.get("body", b""), message.get("more_body", False)
    return body


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


def foreign(headers: Headers, path: str, *, reads: bool) -> str:
    """Return the reason to refuse a request, which ``reads`` or changes state; empty if accepted."""
    is_own_site = headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none")
    if reads:
        is_link = (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) == ("navigate", "document")
        return "" if is_own_site or (is_link and path == "/") else OTHER_SITE
    if headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
        return "the content type must be application/json"
    origin = headers.get("origin")
    is_foreign = origin is not None and origin.partition("://")[2] != headers.get("host")
    return OTHER_SITE if is_foreign or not is_own_site else ""


def _machine() -> tuple[str, str]:
    name = socket.gethostname().lower()
    return name, f"{name.partition('.')[0]}.local"


def _same(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())
