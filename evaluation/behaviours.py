"""Seeded regressions: do the shipped expectations catch plausible faults, and nothing else?

``python -m evaluation.behaviours`` puts each fault of ``behaviours_faults.yaml`` into a copy of the package, runs
``socialbot test`` there with the expectations of that agent, and counts the faults that they catch. It then repeats the
runs without a fault, inline and over ROS, and counts false alarms.

Waldo is tested on what the person detector sees in three bags: each is replayed once, and its detections are the bag of
all runs. The warehouse and the hospital are simulated.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Annotated
from xml.etree import ElementTree

import typer
from ruamel.yaml import YAML

from evaluation.report import Bar, JsonOption, QuickOption, Report, Value, run
from socialbot.bags.reader import open_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.errors import GraphError, SocialbotError
from socialbot.core.messages import PersonDetections
from socialbot.runs.expectations import evaluate, load_behaviours
from socialbot.runs.record import RunRecord
from socialbot.runtime.bag_source import BAG_GRAPH, BagSource, graph_of
from socialbot.runtime.run import run as run_graph
from socialbot.runtime.trials import Trial

ROOT = Path(__file__).parents[1]
FAULTS = Path(__file__).with_name("behaviours_faults.yaml")
BAGS = ("data/synthetic/corridor", "data/synthetic/visitors_tune", "data/synthetic/lens_large_tune")
"""People walk through a corridor, come to a door one after the other, or stand near the camera from the beginning."""
HOSPITAL = ("hospital", "--set", "world.rate=100.0", "--set", "coordinator.proactive=false")
"""Each mission meets a problem, which the coordinator does not see before."""
DETECTIONS = "/humans/bodies/detections"
QUICK_REPEATS = 2
TIMEOUT_S = 600.0
LIMIT_S = 300.0

GRAPH = """
name: waldo
inputs: [/humans/bodies/detections]
nodes:
  bdi_engine: {type: waldo}
  listener: {type: listener}
  speech: {type: speaker, parameters: {engine: bdi_engine}, remap: {health: /bdi_engine/health}}
  head: {type: head, parameters: {engine: bdi_engine}, remap: {health: /bdi_engine/health}}
"""
"""Waldo behind the person detector."""


@dataclass(frozen=True)
class Fault:
    """Text that occurs once in a file, and its replacement."""

    name: str
    scene: str
    file: str
    was: str
    becomes: str


@dataclass(frozen=True)
class Outcome:
    """Names of the failed expectations of one test; ``problem`` if it did not end as a test."""

    failed: tuple[str, ...]
    problem: str = ""


@dataclass(frozen=True)
class Scene:
    """Arguments of ``socialbot test`` for one agent."""

    behaviours: str
    arguments: tuple[str, ...]


def load_faults() -> list[Fault]:
    """Return the faults of `FAULTS`."""
    return [Fault(**each) for each in YAML(typ="safe").load(FAULTS)]


def scenes(folder: Path) -> dict[str, Scene]:
    """Return the scenes by name; the detections of the bags are written into ``folder``."""
    bags = [str(detections_of(ROOT / each, folder / Path(each).name)) for each in BAGS]
    return {
        "waldo": Scene("waldo", tuple(bags)),
        "warehouse": Scene("warehouse", ("warehouse",)),
        "hospital": Scene("hospital", HOSPITAL),
    }


def detections_of(bag: Path, out: Path) -> Path:
    """Replay a bag and write the detections as a bag for Waldo."""
    seen: list[PersonDetections] = []

    def note(topic: str, message: object) -> None:
        if isinstance(message, PersonDetections):
            seen.append(message)

    with tempfile.TemporaryDirectory() as folder, open_bag(bag) as opened, RunRecord(Path(folder) / "run") as record:
        run_graph(graph_of(bag), BagSource(opened), record, note)
    with BagWriter(out, compressed=True) as written:
        for message in seen:
            written.write(DETECTIONS, message, message.stamp)
    (out / BAG_GRAPH).write_text(GRAPH, "utf-8")
    return out


def tree(folder: Path) -> Path:
    """Copy the package; large files that no fault changes are links."""
    for path in (ROOT / "socialbot").rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            copy = folder / path.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            if path.stat().st_size > 200_000:
                copy.symlink_to(path)
            else:
                shutil.copy2(path, copy)
    return folder


def put(fault: Fault, folder: Path) -> None:
    """Put a fault into a copy of the package. Raises GraphError if its text does not stand there once."""
    path = folder / fault.file
    text = path.read_text("utf-8")
    if text.count(fault.was) != 1:
        what = f"the fault {fault.name!r} stands {text.count(fault.was)} times in {fault.file}"
        raise GraphError(what, where=str(FAULTS), remedy="give a text that stands there once")
    path.write_text(text.replace(fault.was, fault.becomes), "utf-8")


def check(scene: Scene, folder: Path, runner: str = "inline", package: Path = ROOT) -> Outcome:
    """Run the expectations of a scene with the package in ``package``; records are written into ``folder``."""
    results = folder / "results.xml"
    command = [sys.executable, "-m", "socialbot", "test", scene.behaviours, *scene.arguments, "--limit", f"{LIMIT_S:g}"]
    done = subprocess.run(
        [*command, "--runner", runner, "--out", str(folder), "--junit", str(results)],
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    if done.returncode not in (0, 1) or not results.is_file():
        return Outcome((), (done.stderr or done.stdout).strip()[-300:])
    cases = ElementTree.parse(results).getroot().iter("testcase")
    return Outcome(tuple(dict.fromkeys(case.attrib["name"] for case in cases if case.find("failure") is not None)))


def seeded(faults: Sequence[Fault], prepared: Mapping[str, Scene], folder: Path) -> Iterator[tuple[Fault, Outcome]]:
    """Yield each fault with the outcome of its test."""
    for number, fault in enumerate(faults):
        with tempfile.TemporaryDirectory(dir=folder) as copy:
            put(fault, tree(Path(copy)))
            yield fault, check(prepared[fault.scene], folder / f"fault{number}", package=Path(copy))


def check_here(scene: Scene, folder: Path) -> Outcome:
    """Run the expectations of a scene inline in this process, which is faster."""
    changes = tuple(value for name, value in pairwise(scene.arguments) if name == "--set")
    sources = takewhile(lambda each: not each.startswith("--"), scene.arguments)
    trials = (Trial(source, changes=changes, limit_s=LIMIT_S) for source in sources)
    expectations = load_behaviours(scene.behaviours)
    found = [evaluate(expectations, trial.obtain(folder / str(number))) for number, trial in enumerate(trials)]
    return Outcome(tuple(dict.fromkeys(each.name for verdicts in found for each in verdicts if not each.passed)))


def repeated(prepared: Mapping[str, Scene], runner: str, repeats: int, folder: Path) -> list[Outcome]:
    """Return the outcomes of all scenes without a fault, ``repeats`` times each."""
    outcomes = []
    with Bar(f"{runner}, no fault", repeats * len(prepared)) as bar:
        for number in range(repeats):
            for name, scene in prepared.items():
                out = folder / f"{runner}-{name}-{number}"
                outcomes.append(check_here(scene, out) if runner == "inline" else check(scene, out, runner))
                shutil.rmtree(out, ignore_errors=True)
                bar.advance()
    return outcomes


def measure(repeats: int, ros_repeats: int, *, quick: bool) -> Report:
    """Seed all faults and repeat the runs without one."""
    report = Report("Seeded regressions", quick)
    faults = load_faults()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepared = scenes(folder)
        with Bar("faults", len(faults)) as bar:
            found = []
            for pair in seeded(faults, prepared, folder):
                found.append(pair)
                bar.advance()
        report.tables["faults"] = {fault.name: _row(fault, outcome) for fault, outcome in found}
        caught = sum(bool(outcome.failed) and not outcome.problem for _, outcome in found)
        report.add("faults", "seeded faults", len(faults))
        report.add("missed", "faults that no expectation catches", len(faults) - caught, 0)
        for runner, times in (("inline", repeats), ("ros", ros_repeats)):
            outcomes = repeated(prepared, runner, times, folder)
            alarms = [each for each in outcomes if each.failed or each.problem]
            report.add(f"{runner}_repeats", f"{runner}: repeats of each scene without a fault", times)
            report.add(f"{runner}_false_alarms", f"{runner}: runs with a false alarm", len(alarms), 0)
            if alarms:
                report.tables[f"false alarms, {runner}"] = {
                    str(n): {"expectations": ", ".join(each.failed), "problem": each.problem}
                    for n, each in enumerate(alarms)
                }
    return report


def _row(fault: Fault, outcome: Outcome) -> dict[str, Value]:
    first = f"{', '.join(outcome.failed[:2])}{' ...' if len(outcome.failed) > 2 else ''}"
    return {
        "agent": fault.scene,
        "caught by": outcome.problem or first or "nothing",
        "expectations": len(outcome.failed),
    }


def main(
    json: JsonOption = None,
    quick: QuickOption = False,
    repeats: Annotated[int, typer.Option(min=0, help="Repeats without a fault, inline.")] = 100,
    ros_repeats: Annotated[int, typer.Option(min=0, help="Repeats without a fault, over ROS.")] = 100,
) -> None:
    """Seed faults, count those that the shipped expectations catch, and count false alarms without a fault."""
    if quick:
        repeats, ros_repeats = min(repeats, QUICK_REPEATS), 0
    report = measure(repeats, ros_repeats, quick=quick)
    report.finish(json)
    if report.unmet:
        raise SocialbotError(f"not met: {', '.join(report.unmet)}")


if __name__ == "__main__":
    run(main)
