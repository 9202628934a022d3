"""Random faults without end against Waldo, the warehouse and the hospital at once.

``python -m evaluation.chaos --hours 6 --seed 1`` starts ``socialbot up`` for each graph, draws one fault after the
other, and checks the invariants of `chaos_checks` after each. It ends with the first violation, names its seed and
number, and keeps all records. The same seed draws the same faults.

Everything runs in namespaces of its own (network, /dev/shm, process ids), which need root and `unshare`; without them,
faults of the network and the disk are left out.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import psutil
import typer
from rich.console import Console

from evaluation.chaos_checks import Check, Subject, states
from evaluation.chaos_faults import FAULTS, Fault, Site, cause
from evaluation.faults_clocks import CLOCK_VARIABLE, build_library, set_clock
from evaluation.faults_deaths import SCENE, SETTINGS
from evaluation.faults_plan import Skipped, descendants, kill_all, write_pictures
from evaluation.report import run
from socialbot.bridge import environment
from socialbot.core.errors import ParameterError, suggestion
from socialbot.core.process_guard import CHILDREN_S, END_S, guarded, report_alive

VIOLATION_EXIT = 1
INSIDE = "SOCIALBOT_CHAOS_INSIDE"
GRAPHS = ("waldo", "warehouse", "hospital")
BETWEEN_S = (1.0, 6.0)  # time between two faults
DISK = "24m"
LATE_S = 5.0  # tolerated delay of a guard on a busy machine

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
    if folder.exists():
        raise ParameterError(f"{folder} exists already", where="--out", remedy="name a folder that does not exist")
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
        inside = subprocess.Popen([*command, *again], env={**os.environ, INSIDE: "1"})
        for ending in (signal.SIGTERM, signal.SIGHUP):  # unshare ignores them
            signal.signal(ending, lambda *_: inside.kill())
        code = inside.wait()
        sys.exit(code if code >= 0 else 128 - code)


def chaos(
    folder: Path, graphs: tuple[str, ...], kinds: tuple[str, ...], seed: int, limit_s: float, tell: Tell
) -> list[str]:
    """Run ``graphs`` with faults of these ``kinds`` for ``limit_s``; return the violated invariants."""
    folder.mkdir(parents=True)
    chance, begun = random.Random(seed), time.monotonic()
    late: list[str] = []
    with guarded(), ExitStack() as stack, (folder / "events.jsonl").open("w") as events:
        domains = [stack.enter_context(environment.own_domain(environment={})) for _ in graphs]
        started = (_running(folder, name, domain, late) for name, domain in zip(graphs, domains, strict=True))
        subjects = [stack.enter_context(each) for each in started]
        check = Check(subjects)
        site = Site(subjects, isolated=INSIDE in os.environ)
        possible = [kind for kind in kinds if not FAULTS[kind].needs_isolation or site.isolated]
        if missing := [kind for kind in kinds if kind not in possible]:
            tell(f"left out without namespaces of their own: {', '.join(missing)}")
        violations = check.after("start", 0.0)
        tell(f"seed {seed}: {', '.join(graphs)} are up; faults: {', '.join(possible)}")
        number, slowest = 0, 0.0
        while not violations and time.monotonic() - begun < limit_s:
            report_alive()
            time.sleep(chance.uniform(*BETWEEN_S))
            number += 1
            fault = Fault.drawn(possible, subjects, chance)
            at = time.monotonic()
            cause(fault, site)
            ended = time.monotonic()
            may_end = (fault.subject.name, fault.node) if FAULTS[fault.kind].ends_node else ("", "")
            violations = check.after(str(fault), at, may_end)
            recovered = time.monotonic() - ended
            slowest = max(slowest, recovered)
            line = {
                "number": number,
                "fault": str(fault),
                "s": round(ended - at, 2),
                "recovered_s": round(recovered, 2),
                "load": os.getloadavg()[0],
                "shared_mb": round(shutil.disk_usage("/dev/shm").used / 1e6, 1),
                "up_mb": {one.name: _memory_mb(one.process.pid) for one in subjects},
            }
            events.write(json.dumps({**line, "at_s": round(at - begun, 1), "violations": violations}) + "\n")
            events.flush()
            if number % 10 == 0 or violations:
                tell(f"{number}: {fault}; well after {recovered:.1f} s (at most {slowest:.1f} s)")
        if violations:
            (folder / "threads.txt").write_text("\n".join(states(subjects)), encoding="utf-8")
        if check.observed_anew:
            tell(f"DDS blocked an observer of this command {check.observed_anew} times")
    violations += late
    for violation in violations:
        tell(f"VIOLATION of seed {seed} at fault {number}: {violation}")
    verdict = f"{len(violations)} violations" if violations else "no violation"
    tell(f"{number} faults in {time.monotonic() - begun:.0f} s, {check.checks} checks: {verdict}; records: {folder}")
    return violations


@contextmanager
def _running(folder: Path, name: str, domain: int, violations: list[str]) -> Iterator[Subject]:
    """``socialbot up`` of a graph in the ROS ``domain``; add what its end violates."""
    own = folder / name
    own.mkdir()
    disk, scratch = own / "disk", own / "tmp"
    disk.mkdir()
    scratch.mkdir()
    isolated = INSIDE in os.environ
    if isolated:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", disk], check=True)
    arguments: list[object] = ["up", name, "--out", disk / "run", "--keep", "8"]
    if name == "waldo":
        arguments += ["--camera", write_pictures(own / "pictures", SCENE)]
        settings = {**SETTINGS, "bdi_engine.forget_after_s": "4.0"}
        arguments += [word for setting, value in settings.items() for word in ("--set", f"{setting}={value}")]
    variables = {"ROS_DOMAIN_ID": str(domain), "SOCIALBOT_FOLDERS": str(folder), "TMPDIR": str(scratch)}
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
    subject = Subject(name, domain, process, own, disk, clock)
    try:
        with subject.observed():
            yield subject
    finally:
        violations += [f"{name}: {what} after SIGTERM" for what in _end(process)]
        if left := sorted(path.name for path in scratch.iterdir()):
            violations.append(f"{name}: left in the folder of temporary files: {', '.join(left)}")
        if isolated:  # the disk ends with the namespace
            shutil.copytree(disk, own / "kept", ignore=shutil.ignore_patterns("filling"))


def _memory_mb(pid: int) -> int:
    try:
        return round(psutil.Process(pid).memory_info().rss / 1e6)
    except psutil.NoSuchProcess:
        return 0


def _end(process: subprocess.Popen[bytes]) -> Iterator[str]:
    """End ``up`` by SIGTERM."""
    report_alive()
    family = {psutil.Process(pid) for pid in descendants(process.pid)} if process.poll() is None else set()
    process.terminate()
    try:
        code = process.wait(END_S + LATE_S)
    except subprocess.TimeoutExpired:
        yield f"up did not end within {END_S + LATE_S:g} s"
        kill_all([process.pid])
        return
    if code:
        yield f"up ended with code {code}"
    _, left = psutil.wait_procs(family, CHILDREN_S + LATE_S)
    for each in left:
        yield f"process {each.pid} outlived up"
        each.kill()


if __name__ == "__main__":
    run(main)
