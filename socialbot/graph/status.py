"""Status of the nodes of a running graph, from /diagnostics and /health."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from socialbot.core.messages import Health

SILENT_S = 3.0
"""Timeout of a node on /diagnostics, where every live node publishes each second."""

LIFELESS_S = 2.0
"""Timeout of an active node on /health, where its working thread publishes several times a second."""

MOST_NODES = 1000
"""Limit of tracked nodes: other programs may publish any number of names."""

LONGEST_TEXT = 500

LASTING = {"machine", "state", "restarts", "last_error", "failures", "first_failure"}
"""Values that stay valid for a node that timed out; all others are measurements."""

ACTIVE = "active"
PAUSED = "paused"
CONDITIONS = {"failed": "failed", "degraded": "input silent", "waiting": "no input yet", "paused": PAUSED}
"""Conditions of an active node by its reported health, if that is not ok."""


@dataclass(frozen=True)
class Spread:
    """Mean and 99th percentile of recent durations (ms)."""

    mean_ms: float
    p99_ms: float


@dataclass(frozen=True)
class NodeStatus:
    """Status of one node. Unknown values are None.

    Attributes:
        state: Lifecycle state; of a dead node ``waiting``, ``given up`` or ``ended``; empty before its first message.
        heard_s: Time (s) since its last message; None before the first.
        lifeless: Whether it is active but publishes no heartbeats.
        twin: Process and machine of another node with the same name.
        call: Duration of a callback.
        age: Age of messages at the end of their callback, since their stamp.
        cpu_percent: Processor time of the process, in percent of one core.
        memory_mb: Memory of the process.
        shares: Other nodes in the same process.
    """

    name: str
    machine: str = ""
    state: str = ""
    heard_s: float | None = None
    lacks_heartbeat: bool = False
    twin: str = ""
    health: str = ""
    reason: str = ""
    silent: tuple[str, ...] = ()
    lacks: str = ""
    handled_hz: float | None = None
    published_hz: float | None = None
    call: Spread | None = None
    age: Spread | None = None
    cpu_percent: float | None = None
    memory_mb: float | None = None
    pid: int | None = None
    shares: tuple[str, ...] = ()
    restarts: int = 0
    last_error: str = ""
    failures: int = 0
    first_failure: str = ""
    refused: int = 0
    refusals: str = ""
    resubscribed: str = ""
    dropped: str = ""

    @property
    def condition(self) -> str:
        """The condition in a few words; `ACTIVE` if all is well."""
        if self.heard_s is None:
            return "no messages"
        if self.heard_s > SILENT_S:
            return f"no messages for {self.heard_s:.0f} s"
        if self.twin:
            return "duplicate name"
        if self.state != ACTIVE:
            return self.state or "unknown"
        if self.lacks_heartbeat:
            return "no heartbeat"
        if self.health == "degraded" and not self.silent:
            return "degraded"
        return CONDITIONS.get(self.health, ACTIVE)

    @property
    def is_well(self) -> bool:
        """Whether the node is active without a fault, or paused."""
        return self.condition in (ACTIVE, PAUSED)


@dataclass
class _Reports:
    values: Mapping[str, str] = field(default_factory=dict)
    first: float = 0.0
    last: float | None = None
    health: Health | None = None
    health_at: float = -math.inf
    publishers: deque[str] = field(default_factory=lambda: deque(maxlen=3))
    """The last publishers under this name, without repeats in a row."""
    twin: str = ""
    twin_at: float = -math.inf

    def record_publisher(self, speaker: str, now: float) -> None:
        """Record a publisher. A former publisher that returns is no restart: two nodes run under the name."""
        if self.publishers and self.publishers[-1] == speaker:
            return
        self.publishers.append(speaker)
        if len(self.publishers) == self.publishers.maxlen and self.publishers[0] == speaker:
            self.twin, self.twin_at = self.publishers[1], now


class NodeStatuses:
    """Status of nodes, collected from /diagnostics and /health.

    ``expected`` maps the expected nodes to their machines, in order; without it all nodes are tracked. Times are in s
    of a monotonic clock. One thread may write while another reads. Without any health message, as without the keys,
    heartbeats are not required.
    """

    def __init__(self, expected: Mapping[str, str] | None = None) -> None:
        self._has_health_reports = False
        self._expected = dict(expected or {})
        self._reports: dict[str, _Reports] = {name: _Reports() for name in self._expected}

    def note(self, name: str, values: Mapping[str, str], now: float) -> None:
        """Record the values of a node on /diagnostics. Other programs may publish there too."""
        if "state" not in values or "machine" not in values or (one := self._of(name)) is None:
            return
        if one.last is None or now - one.last > SILENT_S:
            one.first = now
        one.values, one.last = values, now
        if "pid" in values:
            one.record_publisher(f"process {_text(values, 'pid')} on {_text(values, 'machine')}", now)

    def note_health(self, health: Health, now: float) -> None:
        """Record a health message. A bag player may publish them too."""
        self._has_health_reports = True
        if health.node in self._reports and (one := self._of(health.node)) is not None:
            one.health, one.health_at = health, now

    @property
    def expects(self) -> bool:
        """Whether the expected nodes are known."""
        return bool(self._expected)

    @property
    def complete(self) -> bool:
        """Whether all expected nodes have published, and the active ones also their health."""
        return bool(self._expected) and all(
            one.last is not None and (one.health is not None or one.values["state"] != ACTIVE)
            for one in tuple(self._reports.values())
        )

    def statuses(self, now: float) -> list[NodeStatus]:
        """The status of every node, in the expected order, else by machine and name."""
        found = [self._status(name, one, now) for name, one in tuple(self._reports.items())]
        return found if self._expected else sorted(found, key=lambda one: (one.machine, one.name))

    def _of(self, name: str) -> _Reports | None:
        if name in self._reports:
            return self._reports[name]
        if self._expected or len(self._reports) >= MOST_NODES:
            return None
        return self._reports.setdefault(name, _Reports())

    def _status(self, name: str, one: _Reports, now: float) -> NodeStatus:
        if one.last is None:
            return NodeStatus(name, self._expected.get(name, ""))
        gone = now - one.last > SILENT_S
        values = {key: one.values[key] for key in LASTING & one.values.keys()} if gone else one.values
        state, pid = _text(values, "state"), _number(values, "pid")
        health = one.health if state == ACTIVE else None
        sign_of_life = max(one.health_at, one.first)
        return NodeStatus(
            name=name,
            machine=_text(values, "machine"),
            state=state,
            heard_s=now - one.last,
            twin=one.twin if now - one.twin_at <= SILENT_S else "",
            lacks_heartbeat=state == ACTIVE and self._has_health_reports and one.last - sign_of_life > LIFELESS_S,
            health=health.state if health else "",
            reason=printable(health.reason) if health else "",
            silent=tuple(map(printable, health.silent)) if health else (),
            lacks=_text(values, "unconnected") if state == ACTIVE else "",
            handled_hz=_number(values, "call_hz"),
            published_hz=_number(values, "publish_hz"),
            call=_spread(values, "call"),
            age=_spread(values, "age"),
            cpu_percent=_number(values, "cpu_percent"),
            memory_mb=_number(values, "rss_mb"),
            pid=None if pid is None else int(pid),
            shares=self._sharing(name, values),
            restarts=int(_number(values, "restarts") or 0),
            last_error=_text(values, "last_error"),
            failures=int(_number(values, "failures") or 0),
            first_failure=_text(values, "first_failure"),
            refused=int(_number(values, "refused") or 0),
            refusals=_text(values, "refusals"),
            resubscribed=_text(values, "resubscribed"),
            dropped=_text(values, "dropped"),
        )

    def _sharing(self, name: str, values: Mapping[str, str]) -> tuple[str, ...]:
        def process(values: Mapping[str, str]) -> tuple[str | None, str | None]:
            return values.get("machine"), values.get("pid")

        if "pid" not in values:
            return ()
        others = (other for other, one in tuple(self._reports.items()) if process(one.values) == process(values))
        return tuple(other for other in others if other != name)


def all_well(statuses: Sequence[NodeStatus]) -> bool:
    """Whether there are nodes and all of them are well."""
    return bool(statuses) and all(one.is_well for one in statuses)


def printable(text: str) -> str:
    """Make text from the network safe for a terminal: one line of printable characters."""
    flat = " ".join(text.split())[:LONGEST_TEXT]
    return "".join(letter if letter.isprintable() else "?" for letter in flat)


def _text(values: Mapping[str, str], key: str) -> str:
    return printable(values.get(key, ""))


def _number(values: Mapping[str, str], key: str) -> float | None:
    try:
        number = float(values[key])
    except (KeyError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _spread(values: Mapping[str, str], name: str) -> Spread | None:
    mean, p99 = _number(values, f"{name}_mean_ms"), _number(values, f"{name}_p99_ms")
    # Without calls both are zero.
    return None if mean is None or p99 is None or not p99 else Spread(mean, p99)
