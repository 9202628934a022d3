"""Invariants of graphs under random faults."""

from __future__ import annotations

import itertools
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import psutil

from evaluation.faults_deaths import GREETING, SPEECH
from evaluation.faults_plan import GUARD, children, descendants, process_name
from socialbot.bridge.environment import PROFILE_VARIABLE, give_up
from socialbot.bridge.graph_observer import SpinWatch, observe_graph
from socialbot.bridge.shared_memory import stale_locks
from socialbot.core.bounded_log import parts
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, SpeechStatus, TraceRecord, Utterance
from socialbot.core.process_guard import report_alive
from socialbot.graph.files import load_graph
from socialbot.runs.record import TRACE

RECOVERY_S = 60.0
"""Limit (s) for all nodes to be active again after a fault has ended; a busy machine needs a part of it."""
FRESH_S = 3.0
APART_S = 3.5
"""Least time (s) between two greetings: the scene shows the next person later."""
ANSWER_S = 20.0
LOG, RENEWAL = "up.log", "restart everything: a process died after the clock was set back"
"""Log of ``up``, and what it says there."""
SILENT_S = 180.0
"""Longest time (s) without a greeting: the scene shows a person each 13 s, and recovery may take a minute. Like that
minute, it excludes waiting for a processor."""
ORPHAN_S = 2.0
SETTLED_S = 60.0
GROWTH, GROWTH_MB = 1.3, 30
MOST_STALE = 10
"""Most segments of shared memory of ended processes: each crash removes those before it."""
SAY = "/speech/say"
PROFILE = """<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
  <transport_descriptors><transport_descriptor>
    <transport_id>udp</transport_id><type>UDPv4</type>
    <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
  </transport_descriptor></transport_descriptors>
  <participant profile_name="observer" is_default_profile="true"><rtps>
    <userTransports><transport_id>udp</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
  </rtps></participant>
</profiles></dds>
"""
"""DDS profile of the observer, which has the real time. Shared memory finds dead readers by the time of day, and each
graph has its own."""
PRESSURE = Path("/proc/pressure/cpu")
LEAST_SHARE = 0.1


class FairClock:
    """Time (s) that counts by the share in which no process waited for a processor, and at least a tenth of it.

    So a limit of 60 s is 60 s on an idle machine, and at most 600 s on a busy one. The share comes from the pressure
    that Linux measures; without it all time counts.
    """

    def __init__(
        self, steady_s: Callable[[], float] = time.monotonic, stalled_s: Callable[[], float] | None = None
    ) -> None:
        self._steady_s, self._stalled_s = steady_s, stalled_s or waited_s
        self._before = self._steady_s(), self._stalled_s()
        self.now = 0.0

    def tick(self) -> float:
        """Count the time since the last call; return the whole."""
        now = self._steady_s(), self._stalled_s()
        passed_s, stalled_s = now[0] - self._before[0], now[1] - self._before[1]
        self._before = now
        self.now += max(LEAST_SHARE * passed_s, passed_s - stalled_s)
        return self.now


def waited_s() -> float:
    """Time (s) since the boot in which some process waited for a processor; 0 if Linux does not measure it."""
    try:
        return int(PRESSURE.read_text("ascii").split()[4].removeprefix("total=")) / 1e6
    except OSError:
        return 0.0


@dataclass
class Subject:
    """A running graph, and what it published.

    Attributes:
        clock: File with the shift of the clock of its processes; None without a C compiler.
        has_guard: Whether its process must have a guard.
    """

    name: str
    domain: int
    process: subprocess.Popen[bytes]
    folder: Path
    disk: Path
    clock: Path | None
    has_guard: bool = True
    reported: dict[str, tuple[float, Mapping[str, str]]] = field(default_factory=dict)
    greetings: list[tuple[float, str]] = field(default_factory=list)
    """Times at which greetings began (s, by the clock of the graph: they may arrive late), and their utterances."""
    greeted: float = 0.0
    """When the last greeting arrived (monotonic s)."""
    said: dict[str, float] = field(default_factory=dict)
    """Times of utterances without a status yet, by id."""

    def __post_init__(self) -> None:
        self.graph = load_graph(self.name)
        self.nodes = [config.name for config in self.graph.nodes]
        self._observation = ExitStack()
        self._renewals = 0
        self._spin: SpinWatch | None = None

    @contextmanager
    def observed(self) -> Iterator[None]:
        """Observe the diagnostics of the nodes, and speech."""
        self._observe_anew()
        try:
            yield
        finally:
            self._observation.close()

    def keep_observing(self) -> bool:
        """If DDS blocks the observer, replace it and return True. This is no fault of the graph."""
        if self._spin is None or not self._spin.is_blocked():
            return False
        give_up(self._observer.ros)
        self._observation.pop_all()
        self._observe_anew()
        return True

    def _observe_anew(self) -> None:
        profile = self.folder / "observer.xml"
        profile.write_text(PROFILE, "utf-8")
        variables = {
            PROFILE_VARIABLE: str(profile),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",  # LOCALHOST adds shared memory
            "ROS_DOMAIN_ID": str(self.domain),
        }
        before = {name: os.environ.get(name) for name in variables}
        os.environ.update(variables)
        topics: dict[str, type[Message]] = {SAY: Utterance, SPEECH: SpeechStatus} if self.name == "waldo" else {}
        try:
            self._observer = self._observation.enter_context(observe_graph(topics, self._observe, self._note))
        finally:
            for name, value in before.items():
                os.environ.pop(name)
                if value is not None:
                    os.environ[name] = value
        self._spin = SpinWatch(self._observer.ros)

    def pid(self, node: str) -> int:
        """Process of a node; 0 while it has none."""
        return int(self.reported.get(node, (0.0, {}))[1].get("pid", 0))

    def pids(self) -> dict[str, int]:
        """Processes of all nodes."""
        return {node: self.pid(node) for node in self.nodes}

    def was_renewed(self) -> bool:
        """Whether ``up`` has started all nodes again since the last call, as it does after the clock was set back."""
        log = self.folder / LOG
        before, self._renewals = self._renewals, log.read_text("utf-8").count(RENEWAL) if log.exists() else 0
        return self._renewals > before

    def ill(self) -> list[str]:
        """Nodes that are not active, or have not reported lately; ``guard`` if ``up`` has none."""
        now = time.monotonic()
        missing = [] if not self.has_guard or GUARD in map(process_name, children(self.process.pid)) else [GUARD]
        return missing + [
            node
            for node in self.nodes
            if (report := self.reported.get(node)) is None
            or report[0] < now - FRESH_S
            or report[1].get("state") != "active"
            or not psutil.pid_exists(int(report[1].get("pid", 0)))
        ]

    def _note(self, name: str, values: Mapping[str, str]) -> None:
        if name in self.nodes:
            self.reported[name] = time.monotonic(), values

    def _observe(self, topic: str, message: Message) -> None:
        if isinstance(message, Utterance):
            self.said[message.id] = time.monotonic()
        elif isinstance(message, SpeechStatus):
            self.said.pop(message.utterance_id, None)
            if message.state == "started" and message.text == GREETING:
                self.greetings.append((message.stamp / SECOND, message.utterance_id))
                self.greeted = time.monotonic()


class Check:
    """Checks of all invariants; `after` runs them once the graphs are well again."""

    def __init__(self, subjects: Sequence[Subject]) -> None:
        self._subjects = subjects
        self._memory: dict[int, tuple[float, int]] = {}
        """Process id: begin of its observation, and its memory (bytes) after `SETTLED_S`, or 0."""
        self._faults: list[tuple[float, float]] = []
        self._pids: dict[str, dict[str, int]] = {}
        self._may_end = ("", "")
        self._clock = FairClock()
        self._greeted = 0.0, 0.0
        """When the last greeting arrived, and the time of the clock at the next check."""
        self.checks = 0
        self.observed_anew = 0
        """How often DDS blocked an observer of this check."""

    def after(self, fault: str, begun: float, may_end: tuple[str, str] = ("", "")) -> list[str]:
        """Wait for recovery from a fault that began at ``begun``; return the violated invariants.

        The process of the graph and node ``may_end`` may be another one than before, also after the next fault: a node
        that had no memory may end some seconds later.
        """
        may, self._may_end = (may_end, self._may_end), may_end
        found: list[str] = []
        end = self._clock.tick() + RECOVERY_S
        while (ill := self._ill()) and self._clock.tick() < end and self._all_run():
            report_alive()
            self.observed_anew += sum(subject.keep_observing() for subject in self._subjects)
            time.sleep(0.1)
        self._faults.append((begun, time.monotonic()))
        found += [f"{name}: not active within {RECOVERY_S:g} s after {fault}: {', '.join(ill[name])}" for name in ill]
        for subject in self._subjects:
            if (code := subject.process.poll()) is not None:
                found.append(f"{subject.name}: up ended with code {code} after {fault}")
            found += [f"{subject.name}: {what} after {fault}" for what in (*_trace(subject), *self._speech(subject))]
        found += [f"{what} without a cause at {fault}" for what in self._restarted(may)]
        if (stale := sum(1 for _ in stale_locks())) > MOST_STALE:
            found.append(f"{stale} segments of shared memory of ended processes after {fault}")
        found += [f"orphan after {fault}: {orphan}" for orphan in orphans(self._subjects)]
        found += [f"{what} after {fault}" for what in self._growth()]
        self.checks += 1
        return found

    def _ill(self) -> dict[str, list[str]]:
        return {subject.name: ill for subject in self._subjects if (ill := subject.ill())}

    def _restarted(self, may_end: tuple[tuple[str, str], ...]) -> Iterator[str]:
        """Nodes with another process than before, except for those of ``may_end``."""
        for subject in self._subjects:
            pids, before = subject.pids(), self._pids.get(subject.name, {})
            self._pids[subject.name] = pids
            if subject.was_renewed():
                continue
            for node, pid in pids.items():
                if before.get(node, pid) != pid and (subject.name, node) not in may_end:
                    yield f"{subject.name}: {node} was restarted"

    def _all_run(self) -> bool:
        return all(subject.process.poll() is None for subject in self._subjects)

    def _speech(self, subject: Subject) -> Iterator[str]:
        for (earlier, one), (later, other) in itertools.pairwise(subject.greetings):
            if abs(later - earlier) < APART_S:  # the clock of a graph that was started again may be behind
                yield f"two greetings within {abs(later - earlier):.1f} s: {one}, {other}"
        del subject.greetings[:-1]
        now, fair_s = time.monotonic(), self._clock.tick()
        if subject.name == "waldo":
            if subject.greeted > self._greeted[0]:
                self._greeted = subject.greeted, fair_s
            if fair_s - self._greeted[1] > SILENT_S:
                yield f"no greeting was heard for {fair_s - self._greeted[1]:.0f} s"
        for utterance, at in list(subject.said.items()):
            if at > now - ANSWER_S:
                continue
            del subject.said[utterance]
            if not any(begin - ANSWER_S < at < end for begin, end in self._faults[-20:]):
                yield f"utterance {utterance} was neither spoken nor refused"

    def _growth(self) -> Iterator[str]:
        now = time.monotonic()
        known = {pid for subject in self._subjects for pid in descendants(subject.process.pid)}
        for pid in known:
            try:
                used = psutil.Process(pid).memory_info().rss
            except psutil.Error:
                continue
            begun, first = self._memory.setdefault(pid, (now, 0))
            if now - begun < SETTLED_S:
                continue
            if not first:
                self._memory[pid] = begun, used
            elif used > GROWTH * first + GROWTH_MB * 1e6:
                yield f"process {pid} grew from {first / 1e6:.0f} to {used / 1e6:.0f} MB"
        self._memory = {pid: kept for pid, kept in self._memory.items() if pid in known}


def states(subjects: Sequence[Subject]) -> Iterator[str]:
    """Describe the threads of all processes: state, and what the kernel lets them wait for."""
    for subject in subjects:
        for pid in descendants(subject.process.pid):
            for task in sorted(Path(f"/proc/{pid}/task").glob("*")):
                try:
                    status = (task / "status").read_text("utf-8").splitlines()
                    waits = (task / "wchan").read_text("utf-8")
                except OSError:
                    continue
                yield f"{subject.name} {pid} {task.name} {status[0].split()[-1]} {status[2].split()[-1]} {waits}"


def orphans(subjects: Sequence[Subject]) -> list[str]:
    """Processes of socialbot in this process namespace whose ``up`` is none of the subjects, for `ORPHAN_S`."""
    found = _strangers(subjects)
    clock = FairClock()
    while found and clock.tick() < ORPHAN_S:
        time.sleep(0.1)
        found &= _strangers(subjects)
    return [f"process {pid}" for pid in sorted(found)]


def _strangers(subjects: Sequence[Subject]) -> set[int]:
    own = {pid for subject in subjects for pid in descendants(subject.process.pid)}
    folders = [str(subject.folder) for subject in subjects]
    found = set()
    for process in psutil.process_iter(["pid", "status"]):
        try:
            if process.pid in own or process.status() == psutil.STATUS_ZOMBIE or process.pid == os.getpid():
                continue
            if any(folder in word for folder in folders for word in (*process.cmdline(), *process.environ().values())):
                found.add(process.pid)
        except psutil.Error:
            continue
    return found


def _trace(subject: Subject) -> Iterator[str]:
    """Check that all whole lines of the trace are records."""
    path = subject.disk / "run" / TRACE
    for part in parts(path):
        try:
            lines = part.read_bytes().split(b"\n")[:-1]
        except FileNotFoundError:
            continue  # the oldest part was removed meanwhile
        for number, line in enumerate(lines, 1):
            try:
                msgspec.json.decode(line, type=TraceRecord)
            except msgspec.MsgspecError as error:
                yield f"{part.name}:{number} is no record: {error}"
                break
