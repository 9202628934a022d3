"""What nodes tell of themselves on /diagnostics: a standard type, so that any tool can read it.

With keys, each status holds what it tells a second time, sealed, among its own values; who has keys believes that only.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from socialbot.bridge.wire import reason_of, wire
from socialbot.errors import MessageError

DIAGNOSTICS_TOPIC = "/diagnostics"
SEAL = "seal"
"""The key of the value that holds name and values under a seal."""

Take = Callable[[str, dict[str, str]], None]
"""Takes the name of a node and what it tells of itself."""

log = logging.getLogger("socialbot.diagnostics")
_DECODER = msgspec.json.Decoder(tuple[str, dict[str, str]])


class DiagnosticsOutlet:
    """Tells through the rclpy node ``ros`` how nodes fare."""

    def __init__(self, ros: Any) -> None:
        self._ros = ros
        self._stream = wire().stream(DIAGNOSTICS_TOPIC)
        self._publisher = ros.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, 10)

    def publish(self, statuses: list[DiagnosticStatus]) -> None:
        """Sends what there is to tell."""
        for status in statuses:
            self._seal(status)
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self._ros.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _seal(self, status: DiagnosticStatus) -> None:
        if self._stream is not None:
            text = msgspec.json.encode((status.name, values_of(status))).decode()
            status.values = [*status.values, KeyValue(key=SEAL, value=self._stream.seal(text))]


class DiagnosticsInlet:
    """Hears through the rclpy node ``ros`` how nodes fare, and calls ``take`` in its thread.

    What is not to be believed is counted in ``refused`` and logged; others than nodes of socialbot may speak there too,
    and are heard only where there are no keys.
    """

    def __init__(self, ros: Any, take: Take) -> None:
        self.refused = 0
        self._take = take
        self._opener = wire().opener(DIAGNOSTICS_TOPIC)
        self.subscription = ros.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, self._receive, 100)

    def _receive(self, array: Any) -> None:
        for status in array.status:
            try:
                told = self._believed(status)
            except MessageError as error:
                self._refuse(error)
            else:
                if told is not None:
                    self._take(*told)

    def _believed(self, status: Any) -> tuple[str, dict[str, str]] | None:
        """Name and values of ``status``; None of a driver without a seal. Raises MessageError for what is forged."""
        values = values_of(status)
        seal = values.pop(SEAL, "")
        if self._opener is None:
            return status.name, values
        if not seal and not is_ours(values):
            return None
        text = self._opener.open(seal)
        try:
            return None if text is None else _DECODER.decode(text)
        except msgspec.MsgspecError as error:
            raise MessageError(f"no diagnostics: {error}") from error

    def _refuse(self, error: MessageError) -> None:
        self.refused += 1
        if str(self.refused).strip("0") == "1":
            log.warning("%s, refused %d (%s): %s", DIAGNOSTICS_TOPIC, self.refused, reason_of(error), error)


def is_ours(values: Mapping[str, str]) -> bool:
    """Whether a node of socialbot tells ``values``, or somebody who pretends to be one; drivers tell others."""
    return "state" in values and "machine" in values


def values_of(status: Any) -> dict[str, str]:
    """The values of a status by their keys."""
    return {pair.key: pair.value for pair in status.values}
