"""A bag through a graph, by either runner, with a record of the run and, where the truth is known, its scores."""

from __future__ import annotations

import functools
import itertools
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec

from socialbot.bags.reader import Bag
from socialbot.bags.topic_mapping import feeding, takes_pictures
from socialbot.bags.world_replay import InlineStage, PlaybackResult, WorldScript, play
from socialbot.bridge.graph_observer import (
    GraphObserver,
    LatestStatistics,
    await_graph,
    expect_free_names,
    observe_graph,
)
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, GraphError, NodeError, SocialbotError
from socialbot.core.messages import Health, Message, Structured, TraceRecord
from socialbot.core.process import Ending
from socialbot.deliberation.messages import PlanExecutionInfo
from socialbot.graph.files import load_graph, parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, check_parameters
from socialbot.runs.difference import DECIDED, Comparison, compare
from socialbot.runs.record import (
    RECORDED,
    STOPPED,
    WELL,
    Observer,
    RunRecord,
    event_log_topics,
    versions,
    with_event_log,
)
from socialbot.runtime.launch import Launch
from socialbot.speech.speaker import Speaker
from socialbot.vision.metrics.scores import Scores, score
from socialbot.vision.metrics.truth import GroundTruth, load_truth, truth_beside

Runner = Literal["ros", "inline"]
TAIL_S = 3.0
"""How long time goes on after the last picture, for speech that is still to be finished."""

GRAPH_TIMEOUT_S = 60.0
"""How long the processes of a graph may take to start and to find each other."""

DRAIN_S = 0.5
"""How long, after the tail, messages may still be on their way between processes."""

BAG_GRAPH = "graph.yaml"
"""The file, in the folder of a bag, that says which graph it was recorded of."""


@dataclass(frozen=True)
class Replay:
    """What to replay, and how."""

    bag: Bag
    graph: Graph
    runner: Runner = "ros"
    composed: bool = False
    image_topic: str | None = None
    rate: float = 1.0
    paced: bool = True
    truth: Path | None = None


@dataclass
class Fate:
    """How a node fared: calls, failures, the first failure, messages of streams that it skipped, cost."""

    calls: int = 0
    failures: int = 0
    first_failure: str = ""
    skipped: int = 0
    cpu_s: float | None = None
    peak_rss_mb: float | None = None


@dataclass
class Outcome:
    """What came of a replay, for results.json and the table; ``decisions`` are compared where the bag has any."""

    results: dict[str, Any]
    scores: Scores | None
    fates: dict[str, Fate] = field(default_factory=dict)
    decisions: Comparison | None = None

    def check(self) -> None:
        """Raises NodeError when a node failed at everything it was asked to do."""
        for name, fate in self.fates.items():
            if fate.failures and fate.failures >= fate.calls:
                raise NodeError(f"failed {fate.failures} times; first: {fate.first_failure}", where=name)


def replay(plan: Replay, record: RunRecord, show: Observer) -> Outcome:
    """Carries out ``plan``; every message of note goes to ``record`` and ``show``."""
    truth = find_truth(plan)
    record.describe(plan.graph)
    # Inline, where time is simulated, a sound lasts as long as it would without being played.
    sound: dict[str, object] = {"playback": "off"} if plan.runner == "inline" else {}
    graph = keep_speech(plan.graph.without_sources(), record.folder, **sound)
    feeds = feeding(plan.bag, graph, plan.image_topic)
    begun = time.monotonic()
    decided: list[TraceRecord] = []

    def note(topic: str, message: Message) -> None:
        record.observe(topic, message)
        show(topic, message)
        if isinstance(message, TraceRecord):
            decided.append(message)

    observe = with_event_log(graph, note)
    run = _run_inline if plan.runner == "inline" else _run_ros
    fates: dict[str, Fate] = {}
    failure: SocialbotError | None = None
    ended = WELL
    try:
        with Ending().on_signals() as ending:
            fates = run(plan, graph, feeds, record.folder, observe, ending)
            ended = STOPPED if ending.asked else WELL
    except SocialbotError as error:
        failure, ended = error, str(error)
    # What was recorded up to a failure is worth as much as the rest.
    scores = score(truth, record.detections) if truth is not None else None
    results = _results(plan, graph, feeds, record, fates, scores, time.monotonic() - begun, ended)
    comparison = _compare(plan.bag, graph, decided)
    if comparison is not None:
        results["decisions"] = msgspec.to_builtins(comparison)
    if scores is not None:
        record.write_scored(scores.by_frame)
    record.write_results(results)
    if failure is not None:
        raise failure
    return Outcome(results, scores, fates, comparison)


def graph_of(bag: Path) -> Graph:
    """The graph that a bag says it was recorded of; Waldo's if it does not. Raises GraphError.

    Bags come from anywhere: modules that lie in their folder are not imported.
    """
    path = bag / BAG_GRAPH
    if not path.is_file():
        return load_graph("waldo")
    try:
        return parse_graph(path.read_text("utf-8"), where=str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise GraphError(f"cannot read the graph: {error}", where=str(path), remedy="give one with --graph") from error


def _compare(bag: Bag, graph: Graph, decided: list[TraceRecord]) -> Comparison | None:
    """The decisions of deliberating agents now beside those in the bag, as long as it goes; None without any there."""
    names = {topic.name for topic in bag.topics if topic.count}
    kinds = {topic: kind for topic, kind in graph.topics().items() if kind is TraceRecord} | event_log_topics(graph)
    recorded: list[TraceRecord] = []

    def note(topic: str, message: Message) -> None:
        if isinstance(message, TraceRecord):
            recorded.append(message)

    observe = with_event_log(graph, note)
    for topic, message in bag.messages({topic: topic for topic in kinds if topic in names}, graph.topics()):
        observe(topic, message)
    if not any(record.kind in DECIDED for record in recorded):
        return None
    return compare(recorded, decided)


def find_truth(plan: Replay) -> GroundTruth | None:
    """The ground truth given, or the one that lies beside the bag. Raises TruthError when it does not fit."""
    path = plan.truth or truth_beside(plan.bag.path)
    return load_truth(path) if plan.truth is not None or path.exists() else None


def keep_speech(graph: Graph, folder: Path, **parameters: object) -> Graph:
    """``graph`` with what is said kept as .wav files in the ``folder`` of the run."""
    kept: dict[str, object] = {"folder": str((folder / "speech").resolve()), **parameters}
    speakers = [placement.name for placement in graph.placements if issubclass(placement.type, Speaker)]
    return graph.with_parameters(dict.fromkeys(speakers, kept))


def recorded_topics(graph: Graph) -> dict[str, type[Message]]:
    """The topics of ``graph`` that a run is made of."""
    return {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, RECORDED)}


def observed_topics(graph: Graph) -> dict[str, type[Message]]:
    """Those, and what else tells people of a replay of ``graph``: plans, what is said, and what it is fed with."""
    more = {
        topic: kind
        for topic, kind in graph.topics().items()
        if kind in (PlanExecutionInfo, Health) or (topic in graph.inputs and issubclass(kind, Structured))
    }
    return {**recorded_topics(graph), **event_log_topics(graph), **more}


def _run_inline(
    plan: Replay, graph: Graph, feeds: Mapping[str, str], folder: Path, observe: Observer, ending: Ending
) -> dict[str, Fate]:
    messages = plan.bag.messages(feeds, graph.topics())
    first = next(messages, None)
    if first is None:
        raise _nothing_whole(plan.bag)
    runner = InlineRunner(graph, start=first[1].stamp)
    for topic in observed_topics(graph):
        runner.tap(topic, observe)
    try:
        if takes_pictures(graph):
            runner.start()
            runner.run(_until(ending, itertools.chain([first], messages)), tail_s=TAIL_S)
        else:
            script = WorldScript(plan.bag, feeds, graph)
            stage = InlineStage(runner, script)
            stage.begin()
            runner.start()
            play(script, stage, ending)
    finally:
        runner.close()
    return {name: Fate(faults.calls, faults.failures, faults.first) for name, faults in runner.faults.items()}


def _until(ending: Ending, messages: Iterator[tuple[str, Message]]) -> Iterator[tuple[str, Message]]:
    return itertools.takewhile(lambda _: not ending.asked, messages)


def _nothing_whole(bag: Bag) -> BagError:
    reasons = "; ".join(f"{topic}: {skipped.count} damaged: {skipped.first}" for topic, skipped in bag.skipped.items())
    return BagError(f"no message can be read ({reasons})", where=str(bag.path), remedy="record it again")


def _run_ros(
    plan: Replay, graph: Graph, feeds: Mapping[str, str], folder: Path, observe: Observer, ending: Ending
) -> dict[str, Fate]:
    fates = LatestStatistics(graph)
    logs = folder / "log"
    topics = observed_topics(graph)
    with observe_graph(topics, observe, fates.note, graph.wire) as onlooker:
        expect_free_names(onlooker.ros, graph)
        report = logs / "played.json"
        with Launch(graph, logs, sim_time=True, composed=plan.composed) as launch:
            _await_graph(onlooker, graph, launch, ending)
            if not ending.asked:
                arguments = _player_arguments(plan, logs / "graph.yaml", report)
                player = launch.start("bag_player", arguments)
                while player.poll() is None and not ending.asked:
                    launch.check()
                    time.sleep(0.1)
                launch.check()
                time.sleep(DRAIN_S)
    failed = {name: code for name, code in launch.exit_codes.items() if code}
    if failed and not ending.asked:
        raise NodeError(
            f"did not end well: {', '.join(f'{name} ({code})' for name, code in failed.items())}", where=str(logs)
        )
    if report.exists():
        played = msgspec.json.decode(report.read_bytes(), type=PlaybackResult)
        plan.bag.skipped.update(played.skipped)
        if not played.sent:
            raise _nothing_whole(plan.bag)
    return ros_fates(fates)


def ros_fates(fates: LatestStatistics) -> dict[str, Fate]:
    """How the nodes of a graph over ROS fared, by their last word on /diagnostics."""
    return {
        name: Fate(
            calls=int(values["calls"]),
            failures=int(values["failures"]),
            first_failure=values["first_failure"],
            skipped=int(values["skipped"]),
            cpu_s=float(values["cpu_s"]),
            peak_rss_mb=float(values["peak_rss_mb"]),
        )
        for name, values in sorted(fates.latest.items())
    }


def _await_graph(onlooker: GraphObserver, graph: Graph, launch: Launch, ending: Ending) -> None:
    def ended() -> bool:
        launch.check()
        return ending.asked

    missing = await_graph(onlooker.ros, graph, onlooker.connections(graph), timeout_s=GRAPH_TIMEOUT_S, ended=ended)
    if missing and not ending.asked:
        raise NodeError(
            f"the graph does not stand after {GRAPH_TIMEOUT_S:.0f} s; missing {'; '.join(missing)}",
            remedy="look into the nodes' logs in the folder of the run; `socialbot doctor` checks the installation",
        )


def _player_arguments(plan: Replay, graph_file: Path, report: Path) -> list[str]:
    arguments = ["bag", "play", str(plan.bag.path), "--graph", str(graph_file), "--rate", str(plan.rate)]
    arguments += ["--report", str(report)]
    if plan.image_topic is not None:
        arguments += ["--image-topic", plan.image_topic]
    return arguments if plan.paced else [*arguments, "--no-pace"]


def _results(
    plan: Replay,
    graph: Graph,
    feeds: Mapping[str, str],
    record: RunRecord,
    fates: Mapping[str, Fate],
    scores: Scores | None,
    wall_s: float,
    ended: str,
) -> dict[str, Any]:
    seconds = functools.partial(_seconds_after, plan.bag.start)
    return {
        "schema": "socialbot/results",
        "version": 1,
        "bag": {
            "path": str(plan.bag.path.resolve()),
            "start": plan.bag.start,
            "duration_s": plan.bag.duration_s,
            "topics": dict(feeds),
            "damage": list(plan.bag.damage),
            "skipped": {topic: msgspec.to_builtins(skipped) for topic, skipped in plan.bag.skipped.items()},
        },
        "runner": plan.runner,
        "composed": plan.composed,
        "graph": graph.name,
        "parameters": parameters_of(graph),
        "ended": ended,
        "frames": len(record.detections),
        "actions": [
            {"t_s": seconds(action.stamp), "id": action.id, "name": action.name, "arguments": action.arguments}
            for action in record.actions
        ],
        "utterances": [{"t_s": seconds(said.stamp), "id": said.id, "text": said.text} for said in record.utterances],
        "scores": None if scores is None else scores_table(scores),
        "nodes": {name: msgspec.to_builtins(fate) for name, fate in fates.items()},
        "wall_s": round(wall_s, 3),
        "versions": versions(),
    }


def parameters_of(graph: Graph) -> dict[str, dict[str, Any]]:
    """All parameters of all nodes, as they are at the start."""
    return {
        placement.name: check_parameters(placement.type, placement.parameters, where=placement.name)
        for placement in graph.placements
    }


def scores_table(scores: Scores) -> dict[str, Any]:
    """Scores as plain data, by band."""
    return {
        "frames": scores.frames,
        "missing_frames": scores.missing_frames,
        "bands": {
            name: {
                "tp": band.tp,
                "fp": band.fp,
                "fn": band.fn,
                "precision": band.precision,
                "recall": band.recall,
                "f1": band.f1,
            }
            for name, band in scores.bands.items()
        },
    }


def _seconds_after(start: int, stamp: int) -> float:
    return round((stamp - start) / SECOND, 3)
