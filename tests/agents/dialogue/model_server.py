"""Local endpoint that answers as it is told, also in broken ways."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

Reply = Callable[["Handler"], object]


class Handler(BaseHTTPRequestHandler):
    """Calls the reply of the server; keeps the requests."""

    protocol_version = "HTTP/1.1"
    server: Server  # pyright: ignore[reportIncompatibleVariableOverride]

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self.server.requests.append((self.path, dict(self.headers), json.loads(body)))
        try:
            self.server.reply(self)
        except OSError:
            self.close_connection = True  # the client has gone

    def log_message(self, format: str, *args: Any) -> None: ...

    def send(self, body: bytes, kind: str = "application/json", status: int = 200, **headers: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)


class Server(ThreadingHTTPServer):
    """Server with the reply for the next requests."""

    daemon_threads = True
    reply: Reply
    requests: list[tuple[str, dict[str, str], Any]]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore clients that close the connection early."""


@contextmanager
def serving(reply: Reply) -> Iterator[tuple[Server, str]]:
    """Serve on loopback; yield the server and its URL."""
    with Server(("127.0.0.1", 0), Handler) as server:
        server.reply, server.requests = reply, []
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server, f"http://127.0.0.1:{server.server_port}/v1"
        finally:
            server.shutdown()
            thread.join()


def whole(text: object) -> Reply:
    """Answer with one JSON object."""
    body = json.dumps({"choices": [{"message": {"content": text}, "finish_reason": "stop"}]}).encode()
    return lambda handler: handler.send(body)


def events(*data: str) -> bytes:
    return b"".join(f"data: {each}\n\n".encode() for each in data)


def streamed(*parts: str, ends: bool = True) -> Reply:
    """Answer with a stream of events; without its end if not ``ends``."""
    data = [json.dumps({"choices": [{"delta": {"content": part}}]}) for part in parts]
    return lambda handler: handler.send(events(*data, *(["[DONE]"] if ends else [])), "text/event-stream")


def dripping(handler: Handler) -> None:
    """Send a byte at a time, without end."""
    handler.send_response(200)
    handler.send_header("Content-Type", "text/event-stream")
    handler.end_headers()
    while True:
        handler.wfile.write(b":")
        handler.wfile.flush()
        time.sleep(0.01)
