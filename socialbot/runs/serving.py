"""Page server with address, port, token and thread."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from socialbot.core.errors import ParameterError
from socialbot.runs._server import PageServer
from socialbot.runs.run import CommandSender, RunView

TOKEN_VARIABLE = "SOCIALBOT_TOKEN"
HOST = "127.0.0.1"
PORT = 8765

STARTED_WITHIN_S = 10.0
ENDED_WITHIN_S = 3.0
REQUEST_WITHIN_S = 5.0  # time for the head of a request
TAKEN_WITHIN_S = 30.0  # time for a client to take any part of an answer
MAX_CONNECTIONS = 100  # number of open connections; further requests get the status 503
MAX_REFUSED = 100  # number of further open connections; still further ones are closed at once


@dataclass(frozen=True)
class Address:
    """Host, port (0: any free one) and token; only loopback hosts work without a token."""

    host: str = HOST
    port: int = PORT
    token: str = ""

    def __post_init__(self) -> None:
        if not self.token and not is_loopback(self.host):
            raise ParameterError(
                "any machine that reaches this address could command the agents",
                where=f"--host {self.host}",
                remedy=f"give --token, or set {TOKEN_VARIABLE}",
            )

    def url(self, port: int) -> str:
        host = HOST if self.host in ("0.0.0.0", "::", "") else self.host
        shown = f"[{host}]" if ":" in host else host
        return f"http://{shown}:{port}/" + (f"?token={self.token}" if self.token else "")


def token_given(token: str | None) -> str:
    """Return the token of the command line or of the environment.

    Raises:
        ParameterError: The token is too short or has other characters.
    """
    found = os.environ.get(TOKEN_VARIABLE, "") if token is None else token
    if found and not (len(found) >= 8 and found.isascii() and found.replace("-", "").replace("_", "").isalnum()):
        remedy = "use 8 or more letters, digits, - and _"
        raise ParameterError("the token is too short, or has other characters", where="--token", remedy=remedy)
    return found


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches ``host``."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Serving:
    """Running server at ``url``."""

    def __init__(self, server: PageServer, url: str, loop: asyncio.AbstractEventLoop) -> None:
        self.url = url
        self._server = server
        self._loop = loop

    def show(self, run: RunView, commands: CommandSender | None = None) -> None:
        """Show another run after the end of a live one."""
        asyncio.run_coroutine_threadsafe(self._server.show(run, commands), self._loop).result()


@contextmanager
def serving(run: RunView, address: Address, commands: CommandSender | None = None) -> Iterator[Serving]:
    """Serve ``run`` from a thread while the block lasts.

    Raises:
        ParameterError: The address is not available.
    """
    with _listening(address) as listener:
        server = PageServer(run, commands)
        loop = asyncio.new_event_loop()
        served = _Uvicorn(
            uvicorn.Config(
                server.application(address.token),
                access_log=False,
                log_config=None,
                log_level=logging.ERROR,  # warnings are of the requests of strangers
                server_header=False,
                timeout_graceful_shutdown=1,
                ws="none",
                http=_PunctualProtocol,
                limit_concurrency=MAX_CONNECTIONS,
                backlog=MAX_CONNECTIONS,  # so many are accepted before any is closed
            )
        )
        thread = threading.Thread(target=_serve, args=(loop, served, listener), name="inspect", daemon=True)
        thread.start()
        try:
            if not served.has_started.wait(STARTED_WITHIN_S):
                raise ParameterError("the server does not start", where=address.host)
            yield Serving(server, address.url(listener.getsockname()[1]), loop)
        finally:
            if thread.is_alive():
                asyncio.run_coroutine_threadsafe(server.close(), loop).result(ENDED_WITHIN_S)
            served.should_exit = True
            thread.join(ENDED_WITHIN_S)


class _PunctualProtocol(H11Protocol):
    """HTTP connection that ends if no whole request comes in time, or nothing of an answer is taken.

    So idle clients take no place for long, and many of them not all file descriptors of the process.
    """

    _deadline: asyncio.TimerHandle | None = None
    _taken_deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS + MAX_REFUSED:
            transport.abort()
            return
        self._await_request()

    def connection_lost(self, exc: Exception | None) -> None:
        for deadline in filter(None, (self._deadline, self._taken_deadline)):
            deadline.cancel()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        super().pause_writing()
        self._taken_deadline = self.loop.call_later(TAKEN_WITHIN_S, self.transport.abort)

    def resume_writing(self) -> None:
        if self._taken_deadline is not None:
            self._taken_deadline.cancel()
        super().resume_writing()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._await_request()

    def _await_request(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = self.loop.call_later(REQUEST_WITHIN_S, self._close_without_request)

    def _close_without_request(self) -> None:
        if (self.cycle is None or self.cycle.response_complete) and not self.transport.is_closing():
            self.transport.close()


def _is_fault(record: logging.LogRecord) -> bool:
    """Return False for what uvicorn logs of each request that the end of the server breaks off."""
    broken_off = record.exc_info is not None and isinstance(record.exc_info[1], asyncio.CancelledError)
    return not (broken_off or str(record.msg).startswith("Cancel %s running task"))


logging.getLogger("uvicorn.error").addFilter(_is_fault)


class _Uvicorn(uvicorn.Server):
    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.has_started = threading.Event()

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.has_started.set()


def _serve(loop: asyncio.AbstractEventLoop, served: _Uvicorn, listener: socket.socket) -> None:
    asyncio.set_event_loop(loop)
    try:
        loop.run_until_complete(served.serve([listener]))
    except Exception:
        logging.getLogger("socialbot.inspect").exception("the server of the inspector ended")
    finally:
        loop.close()


@contextmanager
def _listening(address: Address) -> Iterator[socket.socket]:
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    # asyncio sets TCP_NODELAY only with an explicit protocol; otherwise the end of an answer waits 40 ms.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address.host, address.port))
        except OSError as error:
            raise ParameterError(
                f"cannot serve there: {error.strerror or error}",
                where=f"{address.host}:{address.port}",
                remedy="give another --port, or 0 for any that is free",
            ) from error
        listener.listen(128)
        yield listener
    finally:
        listener.close()
