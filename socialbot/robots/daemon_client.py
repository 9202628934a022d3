"""Client of the daemon of a Reachy Mini: its REST interface over HTTP, and a thread that streams targets.

The daemon is a program of its own (``pip install reachy-mini``, ``reachy-mini-daemon``). It describes its interface at
``/openapi.json``.
"""

from __future__ import annotations

import http.client
import json
import logging
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import urlsplit

from socialbot.core.errors import DeviceError, ParameterError

TIMEOUT_S = 2.0
"""Time limit of a request, with the whole answer."""

MAX_ANSWER_BYTES = 1 << 20
"""Largest answer."""

LONGEST_REASON = 200
"""Characters of the texts of a daemon in errors."""

UPLOAD_TIMEOUT_S = 15.0
"""Time limit of the upload of a sound, which the daemon examines."""

POLL_S = 1.0
"""Time between two looks at the state of a daemon that gets no targets."""

RETRY_S = (0.25, 4.0)
"""Shortest and longest time until a daemon that does not answer is asked again."""

START = "start reachy-mini-daemon, or give its address as url"

log = logging.getLogger("socialbot.reachy_mini")


class _TimedSocket(socket.socket):
    """Socket with one time limit for all that it receives: an answer may come byte by byte."""

    deadline = 0.0

    def recv_into(self, buffer: Any, nbytes: int = 0, flags: int = 0) -> int:
        left_s = self.deadline - time.monotonic()
        if left_s <= 0:
            raise TimeoutError("timed out")
        self.settimeout(left_s)
        return super().recv_into(buffer, nbytes, flags)


class DaemonClient:
    """Requests to a daemon on one connection that is kept open. For one thread.

    Each method raises DeviceError if the daemon does not answer or refuses a request.
    """

    def __init__(self, url: str, *, timeout_s: float = TIMEOUT_S) -> None:
        """Raises ParameterError unless ``url`` is an http address."""
        parts = urlsplit(url)
        try:
            port = parts.port or 80
        except ValueError:
            port = 0
        if parts.scheme != "http" or not parts.hostname or not port or parts.path not in ("", "/"):
            raise ParameterError(
                f"{url!r} is not the address of a daemon", where="url", remedy="write it as in http://127.0.0.1:8000"
            )
        self.url = url.rstrip("/")
        self._timeout_s = timeout_s
        self._connection = http.client.HTTPConnection(parts.hostname, port, timeout=timeout_s)

    def close(self) -> None:
        """Close the connection; the next request opens another."""
        self._connection.close()

    def status(self) -> dict[str, Any]:
        """State of the daemon: ``state`` is "running" when the robot can move; ``version``, ``no_media``, ``error``."""
        return self._json("GET", "/api/daemon/status")

    def motor_mode(self) -> str:
        """Mode of the motors: "enabled", "disabled" or "gravity_compensation"."""
        return str(self._json("GET", "/api/motors/status").get("mode", ""))

    def full_state(self) -> dict[str, Any]:
        """Present ``head_pose`` (x, y, z in m; roll, pitch, yaw in rad), ``antennas_position`` and ``body_yaw``."""
        return self._json("GET", "/api/state/full")

    def set_target(self, target: Mapping[str, Any]) -> None:
        """Set the target of head, antennas and body."""
        self._json("POST", "/api/move/set_target", target)

    def media_available(self) -> bool:
        """Whether the daemon holds camera and sound."""
        return bool(self._json("GET", "/api/media/status").get("available"))

    def release_media(self) -> None:
        """Let other programs open camera and sound."""
        self._json("POST", "/api/media/release")

    def acquire_media(self) -> None:
        """Give camera and sound back to the daemon."""
        self._json("POST", "/api/media/acquire")

    def upload_sound(self, name: str, wav: bytes) -> None:
        """Store a .wav file with the daemon."""
        boundary = secrets.token_hex(16)
        head = (
            f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n'
            "Content-Type: audio/wav\r\n\r\n"
        )
        body = head.encode("ascii") + wav + f"\r\n--{boundary}--\r\n".encode("ascii")
        self._request("POST", "/api/media/sounds/upload", body, f"multipart/form-data; boundary={boundary}")

    def play_sound(self, name: str) -> None:
        """Play a stored sound on the robot's loudspeaker."""
        self._json("POST", "/api/media/play_sound", {"file": name})

    def stop_sound(self) -> None:
        self._json("POST", "/api/media/stop_sound")

    def _json(self, method: str, path: str, content: Mapping[str, Any] | None = None) -> dict[str, Any]:
        body = None if content is None else json.dumps(content, allow_nan=False).encode("ascii")
        answer = self._request(method, path, body, "application/json")
        try:
            page = json.loads(answer)
        except (ValueError, RecursionError) as error:
            raise DeviceError(f"no valid answer to {path}", where=self.url, remedy=START) from error
        return page if isinstance(page, dict) else {}

    def _request(self, method: str, path: str, body: bytes | None = None, kind: str = "") -> bytes:
        headers = {"Content-Type": kind} if body is not None else {}
        try:
            connected = self._connected()
            self._connection.request(method, path, body, headers)
            connected.deadline = time.monotonic() + self._timeout_s
            answer = self._connection.getresponse()
            text = answer.read(MAX_ANSWER_BYTES + 1)
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise DeviceError(
                f"the daemon does not answer: {error or type(error).__name__}", where=self.url, remedy=START
            ) from error
        if len(text) > MAX_ANSWER_BYTES:
            self.close()
            what = f"the answer to {path} is larger than {MAX_ANSWER_BYTES >> 20} MiB"
            raise DeviceError(what, where=self.url, remedy=START)
        if not 200 <= answer.status < 300:
            raise DeviceError(
                f"{method} {path} was refused with {answer.status}: {_detail(text)}",
                where=self.url,
                remedy="see the log of the daemon",
            )
        return text

    def _connected(self) -> _TimedSocket:
        if not isinstance(self._connection.sock, _TimedSocket):
            self._connection.connect()
            self._connection.sock = _TimedSocket(fileno=self._connection.sock.detach())
        self._connection.sock.settimeout(self._timeout_s)
        return self._connection.sock


def _detail(text: bytes) -> str:
    try:
        found = json.loads(text)["detail"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return text[:LONGEST_REASON].decode("utf-8", "replace")
    return str(found)[:LONGEST_REASON]


class TargetStream:
    """Thread that sends the newest target to a daemon, and waits for one that is down to be back.

    After `close`, no request leaves any more.

    Args:
        url: Address of the daemon.
        on_up: Called in the thread with the state of the robot, when the daemon begins to answer.
        on_down: Called in the thread with the reason, when it stops to answer.
    """

    def __init__(self, url: str, on_up: Callable[[dict[str, Any]], None], on_down: Callable[[str], None]) -> None:
        self._client = DaemonClient(url)
        self._on_up, self._on_down = on_up, on_down
        self._wakeup = threading.Condition()
        self._next: Mapping[str, Any] | None = None
        self._closed = False
        self._is_up: bool | None = None
        self._retry_s = RETRY_S[0]
        self._thread = threading.Thread(target=self._run, name="socialbot-reachy-mini", daemon=True)
        self._thread.start()

    def send(self, target: Mapping[str, Any]) -> None:
        """Send a target soon, in place of one that was not sent yet; none is kept while the daemon is down."""
        with self._wakeup:
            if self._is_up:
                self._next = target
                self._wakeup.notify()

    def close(self) -> None:
        """End the thread; a request in progress ends first, within its time limit."""
        with self._wakeup:
            self._closed, self._next = True, None
            self._wakeup.notify()
        self._thread.join(2 * TIMEOUT_S)
        self._client.close()

    def _run(self) -> None:
        while not self._closed:
            if not self._is_up:
                self._look()
                continue
            with self._wakeup:
                if self._next is None and not self._closed:
                    self._wakeup.wait(POLL_S)
                target, self._next = self._next, None
                if self._closed:
                    return
            try:
                if target is None:
                    self._expect_running()
                else:
                    self._client.set_target(target)
            except DeviceError as error:
                self._note_down(error)

    def _look(self) -> None:
        """Ask a daemon that is down for its state, and wait if it is still down."""
        try:
            self._expect_running()
            state = self._client.full_state()
        except DeviceError as error:
            self._note_down(error)
            self._pause(self._retry_s)
            self._retry_s = min(2 * self._retry_s, RETRY_S[1])
            return
        self._retry_s = RETRY_S[0]
        self._is_up = True
        self._on_up(state)

    def _expect_running(self) -> None:
        status = self._client.status()
        if status.get("state") != "running":
            reason = status.get("error") or f"it is {status.get('state')}"
            raise DeviceError(
                f"the robot cannot move: {str(reason)[:LONGEST_REASON]}",
                where=self._client.url,
                remedy="start the robot",
            )
        mode = self._client.motor_mode()
        if mode != "enabled":
            raise DeviceError(
                f"the motors are {mode[:LONGEST_REASON] or 'off'}", where=self._client.url, remedy="wake up the robot"
            )

    def _note_down(self, error: DeviceError) -> None:
        reason = f"{error.what} ({error.remedy})"
        if self._is_up is not False:
            self._is_up = False
            self._on_down(reason)
            log.warning("%s: %s", self._client.url, reason)

    def _pause(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        with self._wakeup:
            while not self._closed and (left := end - time.monotonic()) > 0:
                self._wakeup.wait(left)
