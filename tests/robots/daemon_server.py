"""Daemon of a Reachy Mini for tests: an HTTP server with the paths and types of the real daemon's /openapi.json.

The head follows its targets at once, as in the daemon's mock-up. `FIELDS` and `PATHS` are compared with the real
daemon in test_reachy_mini.py.
"""

from __future__ import annotations

import json
import math
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

PATHS = {
    ("get", "/api/daemon/status"),
    ("get", "/api/motors/status"),
    ("get", "/api/state/full"),
    ("post", "/api/move/set_target"),
    ("get", "/api/media/status"),
    ("post", "/api/media/release"),
    ("post", "/api/media/acquire"),
    ("post", "/api/media/play_sound"),
    ("post", "/api/media/stop_sound"),
    ("post", "/api/media/sounds/upload"),
    ("delete", "/api/media/sounds/{filename}"),
}
"""Methods and paths that the client uses."""

FIELDS = {
    "FullBodyTarget": {"target_head_pose", "target_antennas", "target_body_yaw", "timestamp"},
    "XYZRPYPose": {"x", "y", "z", "roll", "pitch", "yaw"},
    "PlaySoundRequest": {"file"},
    "MotorStatus": {"mode"},
}
"""Fields of the types that the client sends or reads."""


class DaemonServer(ThreadingHTTPServer):
    """State of the robot, and what the daemon was asked."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.state = "running"
        self.mode = "enabled"
        self.media = True
        self.head = dict.fromkeys(FIELDS["XYZRPYPose"], 0.0)
        self.antennas = [-0.1745, 0.1745]
        self.targets: list[dict[str, Any]] = []
        self.arrived = threading.Condition()
        """Notified of each target."""
        self.requests: list[str] = []
        self.sounds: dict[str, bytes] = {}
        self.played: list[str] = []
        self._connections: set[socket.socket] = set()

    def get_request(self) -> tuple[socket.socket, Any]:
        connection, address = super().get_request()
        self._connections.add(connection)
        return connection, address

    def server_close(self) -> None:
        super().server_close()
        for connection in self._connections:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that went away is no error."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    @property
    def robot(self) -> DaemonServer:
        assert isinstance(self.server, DaemonServer)
        return self.server

    def log_message(self, format: str, *args: Any) -> None: ...

    def answer(self, content: Any, status: int = 200) -> None:
        body = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_GET(self) -> None:
        daemon = self.robot
        daemon.requests.append(f"GET {self.path}")
        answers: dict[str, Any] = {
            "/api/daemon/status": {"state": daemon.state, "version": "1.13.0", "no_media": False, "error": None},
            "/api/motors/status": {"mode": daemon.mode},
            "/api/state/full": {"head_pose": daemon.head, "antennas_position": daemon.antennas, "body_yaw": 0.0},
            "/api/media/status": {"available": daemon.media, "released": not daemon.media, "no_media": False},
        }
        if self.path in answers:
            self.answer(answers[self.path])
        else:
            self.answer({"detail": "Not Found"}, 404)

    def do_POST(self) -> None:
        daemon = self.robot
        daemon.requests.append(f"POST {self.path}")
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        match self.path:
            case "/api/move/set_target":
                self.take_target(json.loads(body))
            case "/api/media/sounds/upload":
                head, _, rest = body.partition(b"\r\n\r\n")
                name = head.split(b'filename="')[1].split(b'"')[0].decode()
                if not rest.startswith(b"RIFF"):
                    self.answer({"detail": "Unsupported or invalid audio file"}, 400)
                    return
                daemon.sounds[name] = rest[: rest.rindex(b"\r\n--")]
                self.answer({"status": "ok", "path": f"/tmp/{name}"})
            case "/api/media/play_sound":
                daemon.played.append(json.loads(body)["file"])
                self.answer({"status": "ok"})
            case "/api/media/release" | "/api/media/acquire":
                daemon.media = self.path.endswith("acquire")
                self.answer({"status": "ok"})
            case "/api/media/stop_sound":
                self.answer({"status": "ok"})
            case _:
                self.answer({"detail": "Not Found"}, 404)

    def take_target(self, target: dict[str, Any]) -> None:
        """Check and take a target as the types of the daemon do."""
        daemon, head = self.robot, target.get("target_head_pose") or {}
        numbers = [*head.values(), *(target.get("target_antennas") or ()), target.get("target_body_yaw") or 0.0]
        known = target.keys() <= FIELDS["FullBodyTarget"] and head.keys() <= FIELDS["XYZRPYPose"]
        if not known or not all(type(value) in (int, float) and math.isfinite(value) for value in numbers):
            self.answer({"detail": "Input should be a valid number"}, 422)
            return
        daemon.head = {**daemon.head, **head}
        daemon.antennas = target.get("target_antennas") or daemon.antennas
        with daemon.arrived:
            daemon.targets.append(target)
            daemon.arrived.notify_all()
        self.answer({"status": "ok"})


@contextmanager
def running_daemon(port: int = 0) -> Iterator[DaemonServer]:
    """A daemon that ends with the block; its connections end, too."""
    daemon = DaemonServer(port)
    thread = threading.Thread(target=daemon.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield daemon
    finally:
        daemon.shutdown()
        daemon.server_close()
        thread.join()
