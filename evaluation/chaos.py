"""Random faults without end against Waldo, the warehouse and the hospital at once.

``python -m evaluation.chaos --hours 6 --seed 1`` starts ``socialbot up`` for each graph, draws one fault after the
other, and checks the invariants of `chaos_checks` after each. It ends with the first violation, names its seed and
number, and keeps all records. The same seed draws the same faults.

Everything runs in namespaces of its own (network, /dev/shm, process ids), which need root and `unshare`; without them,
faults of the network and the disk are left out.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from evaluation.chaos_checks import Check, Subject, states
from evaluation.faults_clocks import CLOCK_VARIABLE, build_library, set_clock
from evaluation.faults_deaths import SCENE, SETTINGS
from evaluation.faults_plan import Skipped, busy_processes, write_pictures
from evaluation.report import run
from socialbot.bridge import environment
from socialbot.core.errors import ParameterError, suggestion
from socialbot.runtime._processes import RestartPolicy

LOSS = """
add table inet chaos
add chain inet chaos arriving {{ type filter hook input priority 0; }}
add rule inet chaos arriving meta l4proto udp {chance}drop
"""


@dataclass(frozen=True)
class Site:
    """Graphs under test; ``isolated`` if network and disks are their own."""

    subjects: Sequence[Subject]
    isolated: bool
    kills: dict[tuple[str, str], list[float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """Fault of a ``kind`` on one graph and node, of a ``size`` and a duration (s)."""

    kind: str
    subject: Subject
    node: str
    size: int
    seconds: float

    @classmethod
    def drawn(cls, kinds: Sequence[str], subjects: Sequence[Subject], chance: random.Random) -> Fault:
        """Draw a fault. The number of draws does not depend on the result."""
        kind, subject = chance.choice(list(kinds)), chance.choice(list(subjects))
        node, size = chance.choice(subject.nodes), chance.randrange(1000)
        return cls(kind, subject, node, size, round(chance.uniform(0.5, 3.0), 2))

    def __str__(self) -> str:
        return FAULTS[self.kind].text(self)


@dataclass(frozen=True)
class Kind:
    """Kind of fault: how it is caused, described, and whether it needs namespaces."""

    cause: Callable[[Fault, Site], None]
    text: Callable[[Fault], str]
    needs_isolation: bool = False


def cause(fault: Fault, site: Site) -> None:
    """Cause a fault, and wait for its end."""
    FAULTS[fault.kind].cause(fault, site)


MOST_KILLS = RestartPolicy().times - 1
"""Most kills of a node in a period of the restart policy, after which a supervisor gives it up, as it should."""


def _kill(fault: Fault, site: Site) -> None:
    kills, now = site.kills.setdefault((fault.subject.name, fault.node), []), time.monotonic()
    kills[:] = [at for at in kills if at > now - RestartPolicy().within_s]
    if len(kills) >= MOST_KILLS:
        return
    kills.append(now)
    if pid := fault.subject.pid(fault.node):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        fault.subject.reported.pop(fault.node, None)


def _pause(fault: Fault, site: Site) -> None:
    if pid := fault.subject.pid(fault.node):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGSTOP)
            time.sleep(fault.seconds)
            os.kill(pid, signal.SIGCONT)


def _load(fault: Fault, site: Site) -> None:
    with busy_processes(_processes(fault)):
        time.sleep(2 * fault.seconds)


def _lose(fault: Fault, site: Site) -> None:
    percent = _percent(fault)
    chance = f"numgen random mod 100 < {percent} " if percent < 100 else ""
    subprocess.run(["nft", "-f", "-"], input=LOSS.format(chance=chance), text=True, check=True)
    try:
        time.sleep(2 * fault.seconds)
    finally:
        subprocess.run(["nft", "delete", "table", "inet", "chaos"], check=True)


def _fill(fault: Fault, site: Site) -> None:
    path = fault.subject.disk / "filling"
    with path.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(1 << 16))
    time.sleep(fault.seconds)
    path.unlink()


def _remove(fault: Fault, site: Site) -> None:
    shutil.rmtree(fault.subject.disk / "run", ignore_errors=True)
    time.sleep(fault.seconds)


def _shift(fault: Fault, site: Site) -> None:
    if fault.subject.clock is not None:
        set_clock(fault.subject.clock, _seconds(fault))


def _processes(fault: Fault) -> int:
    return 2 + fault.size % 7


def _percent(fault: Fault) -> int:
    return (5, 20, 50, 100)[fault.size % 4]


def _seconds(fault: Fault) -> int:
    return (-86400, -3600, -2, 0, 2, 3600, 86400)[fault.size % 7]


FAULTS: Mapping[str, Kind] = {
    "kill": Kind(_kill, lambda fault: f"kill of {fault.subject.name}/{fault.node}"),
    "pause": Kind(_pause, lambda fault: f"pause of {fault.subject.name}/{fault.node} for {fault.seconds} s"),
    "load": Kind(_load, lambda fault: f"{_processes(fault)} busy processes for {2 * fault.seconds:.1f} s"),
    "loss": Kind(
        _lose,
        lambda fault: f"{_percent(fault)} % of all packets lost for {2 * fault.seconds:.1f} s",
        needs_isolation=True,
    ),
    "full": Kind(_fill, lambda fault: f"disk of {fault.subject.name} full for {fault.seconds} s", needs_isolation=True),
    "removed": Kind(_remove, lambda fault: f"run folder of {fault.subject.name} removed", needs_isolation=True),
    "clock": Kind(_shift, lambda fault: f"clock of {fault.subject.name} set to {_seconds(fault):+d} s"),
}


VIOLATION_EXIT = 1
INSIDE = "SOCIALBOT_CHAOS_INSIDE"
GRAPHS = ("waldo", "warehouse", "hospital")
FIRST_DOMAIN = 71
BETWEEN_S = (1.0, 6.0)  # time between two faults
DISK = "24m"

Tell = Callable[[str], None]
OnlyOption = Annotated[str, typer.Option(metavar="GRAPH,GRAPH", help=f"Only these graphs: {', '.join(GRAPHS)}.")]
FaultsOption = Annotated[str, typer.Option("--faults", metavar="FAULT,FAULT", help=f"Only: {', '.join(FAULTS)}.")]


def main(
    hours: Annotated[float, typer.Option(min=0.001, help="Duration.")] = 6.0,
    seed: Annotated[int, typer.Option(help="Seed of the faults.")] = 1,
    only: OnlyOption = "",
    faults: FaultsOption = "",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the records; default: in runs/.")] = None,
) -> None:
    """Draw random faults against running graphs, and check invariants after each."""
    graphs, kinds = _chosen(only, GRAPHS, "--only"), _chosen(faults, tuple(FAULTS), "--faults")
    folder = (out or Path("runs") / f"chaos-{datetime.now(timezone.utc):%Y%m%d-%H%M%S}").resolve()
    _enter_namespaces()
    console = Console(highlight=False, soft_wrap=True)
    violations = chaos(folder, graphs, kinds, seed, hours * 3600, lambda line: console.print(line, markup=False))
    if violations:
        sys.exit(VIOLATION_EXIT)


def _chosen(text: str, known: tuple[str, ...], option: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    for name in names:
        if name not in known:
            raise ParameterError(f"no {name!r}", where=option, remedy=suggestion(name, known))
    return names or known


def _enter_namespaces() -> None:
    """Start this command again in namespaces of its own, if that is possible; returns in the end."""
    if INSIDE in os.environ or os.geteuid() != 0 or shutil.which("unshare") is None:
        return
    prepare = 'mount -t tmpfs tmpfs /dev/shm && ip link set lo up && exec "$@"'
    command = [
        "unshare",
        "--net",
        "--mount",
        "--pid",
        "--fork",
        "--kill-child",
        "--mount-proc",
        "sh",
        "-c",
        prepare,
        "sh",
    ]
    again = [sys.executable, "-m", "evaluation.chaos", *sys.argv[1:]]
    if subprocess.run([*command, "true"], capture_output=True, check=False).returncode == 0:
        sys.exit(subprocess.run([*command, *again], env={**os.environ, INSIDE: "1"}, check=False).returncode)


def chaos(
    folder: Path, graphs: tuple[str, ...], kinds: tuple[str, ...], seed: int, limit_s: float, tell: Tell
) -> list[str]:
    """Run ``graphs`` with faults of these ``kinds`` for ``limit_s``; return the violated invariants."""
    folder.mkdir(parents=True)
    chance, begun = random.Random(seed), time.monotonic()
    with ExitStack() as stack, (folder / "events.jsonl").open("w") as events:
        subjects = [stack.enter_context(_running(folder, name, number)) for number, name in enumerate(graphs)]
        check = Check(subjects)
        site = Site(subjects, isolated=INSIDE in os.environ)
        possible = [kind for kind in kinds if not FAULTS[kind].needs_isolation or site.isolated]
        if missing := [kind for kind in kinds if kind not in possible]:
            tell(f"left out without namespaces of their own: {', '.join(missing)}")
        violations = check.after("start", 0.0)
        tell(f"seed {seed}: {', '.join(graphs)} are up; faults: {', '.join(possible)}")
        number, slowest = 0, 0.0
        while not violations and time.monotonic() - begun < limit_s:
            time.sleep(chance.uniform(*BETWEEN_S))
            number += 1
            fault = Fault.drawn(possible, subjects, chance)
            at = time.monotonic()
            cause(fault, site)
            ended = time.monotonic()
            violations = check.after(str(fault), at)
            recovered = time.monotonic() - ended
            slowest = max(slowest, recovered)
            line = {
                "number": number,
                "fault": str(fault),
                "s": round(ended - at, 2),
                "recovered_s": round(recovered, 2),
            }
            events.write(json.dumps({**line, "at_s": round(at - begun, 1), "violations": violations}) + "\n")
            events.flush()
            if number % 10 == 0 or violations:
                tell(f"{number}: {fault}; well after {recovered:.1f} s (at most {slowest:.1f} s)")
        if violations:
            (folder / "threads.txt").write_text("\n".join(states(subjects)), encoding="utf-8")
    for violation in violations:
        tell(f"VIOLATION of seed {seed} at fault {number}: {violation}")
    verdict = f"{len(violations)} violations" if violations else "no violation"
    tell(f"{number} faults in {time.monotonic() - begun:.0f} s, {check.checks} checks: {verdict}; records: {folder}")
    return violations


@contextmanager
def _running(folder: Path, name: str, number: int) -> Iterator[Subject]:
    """``socialbot up`` of a graph in a ROS domain of its own."""
    own = folder / name
    own.mkdir()
    disk = own / "disk"
    disk.mkdir()
    isolated = INSIDE in os.environ
    if isolated:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", disk], check=True)
    arguments: list[object] = ["up", name, "--out", disk / "run", "--keep", "8"]
    if name == "waldo":
        arguments += ["--camera", write_pictures(own / "pictures", SCENE)]
        settings = {**SETTINGS, "bdi_engine.forget_after_s": "4.0"}
        arguments += [word for setting, value in settings.items() for word in ("--set", f"{setting}={value}")]
    variables = {"ROS_DOMAIN_ID": str(FIRST_DOMAIN + number), "SOCIALBOT_FOLDERS": str(folder)}
    try:
        library, clock = build_library(own), own / "clock"
        set_clock(clock, 0)
        variables |= {"LD_PRELOAD": str(library), CLOCK_VARIABLE: str(clock)}
    except Skipped:
        clock = None
    environment.prepare(variables)
    with (own / "up.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "socialbot", *map(str, arguments)],
            env={**os.environ, **variables},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )
    subject = Subject(name, FIRST_DOMAIN + number, process, own, disk, clock)
    try:
        with subject.observed():
            yield subject
    finally:
        process.terminate()
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if isolated:  # the disk ends with the namespace
            shutil.copytree(disk, own / "kept", ignore=shutil.ignore_patterns("filling"))


if __name__ == "__main__":
    run(main)
