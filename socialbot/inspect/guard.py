"""Who may ask the server for something: by which name, with which token, and from which page."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import socket
from collections.abc import Mapping
from http.cookies import SimpleCookie
from urllib.parse import urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from socialbot.inspect.replies import reply_error

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
"""What every answer carries: a page that loads nothing but its own files, and is shown in no other page."""


class Guard:
    """Lets through to ``app`` what may pass, and answers all else itself.

    The server is called by its address or the name of its machine only, so that no page of another site that has its
    name point here can read it. With a ``token`` that has to be brought: as bearer, or once in the address of the page,
    which leaves a cookie. What changes something has to come from the page itself, or from no page at all.
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
        """Answers a request that brings no token, and one that brings it in its address."""
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
    """Whether a Host header is an address, ``localhost``, or the name of this machine."""
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
    """Why a request that changes something is refused; empty when it is not."""
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
