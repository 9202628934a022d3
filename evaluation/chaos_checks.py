"""Invariants of graphs under random faults."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import psutil

from evaluation.faults_deaths import GREETING, SPEECH
from evaluation.faults_plan import descendants
from socialbot.bridge.graph_observer import observe_graph
from socialbot.core.bounded_log import parts
from socialbot.core.messages import Message, SpeechStatus, TraceRecord, Utterance
from socialbot.graph.files import load_graph
from socialbot.runs.record import TRACE

RECOVERY_S = 60.0
"""Limit (s) for all nodes to be active again after a fault has ended; a busy machine needs a part of it."""
FRESH_S = 3.0
APART_S = 3.5
"""Least time (s) between two greetings: the scene shows the next person later."""
ANSWER_S = 20.0
ORPHAN_S = 2.0
SETTLED_S = 60.0
GROWTH, GROWTH_MB = 1.3, 30
SAY = "/speech/say"


@dataclass
class Subject:
    """A running graph, and what it published.

    Attributes:
        clock: File with the shift of the clock of its processes; None without a C compiler.
    """

    name: str
    domain: int
    process: subprocess.Popen[bytes]
    folder: Path
    disk: Path
    clock: Path | None
    reported: dict[str, tuple[float, Mapping[str, str]]] = field(default_factory=dict)
    greetings: list[float] = field(default_factory=list)
    said: dict[str, float] = field(default_factory=dict)
    """Times of utterances without a status yet, by id."""

    def __post_init__(self) -> None:
        self.graph = load_graph(self.name)
        self.nodes = [config.name for config in self.graph.nodes]

    @contextmanager
    def observed(self) -> Iterator[None]:
        """Observe the diagnostics of the nodes, and speech."""
        before = os.environ.get("ROS_DOMAIN_ID")
        os.environ["ROS_DOMAIN_ID"] = str(self.domain)
        topics: dict[str, type[Message]] = {SAY: Utterance, SPEECH: SpeechStatus} if self.name == "waldo" else {}
        with observe_graph(topics, self._observe, self._note):
            os.environ.pop("ROS_DOMAIN_ID")
            if before is not None:
                os.environ["ROS_DOMAIN_ID"] = before
            yield

    def pid(self, node: str) -> int:
        """Process of a node; 0 while it has none."""
        return int(self.reported.get(node, (0.0, {}))[1].get("pid", 0))

    def ill(self) -> list[str]:
        """Nodes that are not active, or have not reported lately."""
        now = time.monotonic()
        return [
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
                self.greetings.append(time.monotonic())


class Check:
    """Checks of all invariants; `after` runs them once the graphs are well again."""

    def __init__(self, subjects: Sequence[Subject]) -> None:
        self._subjects = subjects
        self._memory: dict[int, tuple[float, int]] = {}
        """Process id: begin of its observation, and its memory (bytes) after `SETTLED_S`, or 0."""
        self._faults: list[tuple[float, float]] = []
        self.checks = 0

    def after(self, fault: str, begun: float) -> list[str]:
        """Wait for recovery from a fault that began at ``begun``; return the violated invariants."""
        found: list[str] = []
        deadline = time.monotonic() + RECOVERY_S
        while (ill := self._ill()) and time.monotonic() < deadline and self._all_run():
            time.sleep(0.1)
        self._faults.append((begun, time.monotonic()))
        found += [f"{name}: not active within {RECOVERY_S:g} s after {fault}: {', '.join(ill[name])}" for name in ill]
        for subject in self._subjects:
            if (code := subject.process.poll()) is not None:
                found.append(f"{subject.name}: up ended with code {code} after {fault}")
            found += [f"{subject.name}: {what} after {fault}" for what in (*_trace(subject), *self._speech(subject))]
        found += [f"orphan after {fault}: {orphan}" for orphan in orphans(self._subjects)]
        found += [f"{what} after {fault}" for what in self._growth()]
        self.checks += 1
        return found

    def _ill(self) -> dict[str, list[str]]:
        return {subject.name: ill for subject in self._subjects if (ill := subject.ill())}

    def _all_run(self) -> bool:
        return all(subject.process.poll() is None for subject in self._subjects)

    def _speech(self, subject: Subject) -> Iterator[str]:
        for earlier, later in zip(subject.greetings, subject.greetings[1:], strict=False):
            if later - earlier < APART_S:
                yield f"two greetings within {later - earlier:.1f} s"
        del subject.greetings[:-1]
        now = time.monotonic()
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
    deadline = time.monotonic() + ORPHAN_S
    while found and time.monotonic() < deadline:
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
