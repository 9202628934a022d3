"""Replay a bag through a graph, score its detections and compare its decisions."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from socialbot.bags.cameras import is_rectified
from socialbot.bags.playback import InlineStage, PlaybackResult, WorldScript, feeding, play, takes_images
from socialbot.bags.reader import Bag, open_bag
from socialbot.bags.recorded_services import recorded_services
from socialbot.core.clock import SECOND
from socialbot.core.decoding import from_json
from socialbot.core.errors import BagError, GraphError
from socialbot.core.messages import Message, PersonDetections, TraceRecord
from socialbot.core.paths import read_text
from socialbot.core.reading import read_bytes
from socialbot.graph.files import load_graph, parse_recorded
from socialbot.graph.inline import Recorded
from socialbot.graph.node import Graph
from socialbot.runs.difference import DECIDED, DecisionComparison, compare
from socialbot.runs.record import STOPPED, MessageObserver, RunRecord, event_log_topics, with_event_log
from socialbot.runtime.perception_cache import PerceptionCache, is_redacted
from socialbot.runtime.run import (
    Execution,
    Runner,
    RunResult,
    RunSource,
    new_run_folder,
    observed_topics,
    run,
    with_speech_files,
)
from socialbot.vision.metrics.scores import Scores, score
from socialbot.vision.metrics.truth import GroundTruth, load_truth, truth_beside

TAIL_S = 3.0  # simulated time after the last image, for speech to finish
DRAIN_S = 0.5  # time for the last messages to arrive from other processes
BAG_GRAPH = "graph.yaml"  # file name of the graph in the folder of a bag


def replay(
    bag: Bag | Path | str,
    graph: Graph | Path | str | None = None,
    folder: Path | str | None = None,
    observe: MessageObserver = lambda topic, message: None,
    *,
    runner: Runner = "inline",
    truth: Path | str | None = None,
    cache: bool | PerceptionCache = True,
) -> RunResult:
    """Replay a bag through a graph.

    Args:
        bag: An open bag, or its path.
        graph: The graph, its file or its name; by default the graph of the bag, else Waldo's.
        folder: Folder of the run record; by default a new one below runs/.
        observe: Called with the topic and message of every message.
        runner: "inline" for one thread and simulated time, "ros" for processes over DDS.
        truth: Ground truth file; by default NAME.truth.json beside the bag, if it exists.
        cache: Whether an inline replay takes what nodes see in images from the user's cache, and keeps it there; or
            another cache.

    Raises:
        SocialbotError: The bag or the graph is unusable, or the run failed.
    """
    if not isinstance(bag, Bag):
        with open_bag(Path(bag)) as opened:
            return replay(opened, graph, folder, observe, runner=runner, truth=truth, cache=cache)
    if not isinstance(graph, Graph):
        graph = graph_of(bag.path) if graph is None else load_graph(graph)
    kept = cache if isinstance(cache, PerceptionCache) else PerceptionCache() if cache else None
    source = BagSource(bag, truth=find_truth(bag, None if truth is None else Path(truth)), cache=kept)
    with RunRecord(new_run_folder() if folder is None else Path(folder)) as record:
        return run(graph, source, record, observe, runner=runner)


@dataclass
class BagSource(RunSource):
    """A bag that replaces the sources of a graph.

    Attributes:
        bag: The open bag.
        image_topic: Topic of the images to use, when the bag has several.
        rate: Speed of a ROS replay; 1 is as recorded.
        paced: Wait for slow nodes instead of skipping frames, in a ROS replay.
        truth: Ground truth, for the scores.
        cache: Cache for what nodes see in images, in an inline replay; None for no cache.
    """

    bag: Bag
    image_topic: str | None = None
    rate: float = 1.0
    paced: bool = True
    truth: GroundTruth | None = None
    cache: PerceptionCache | None = None
    _perception: str = field(default="", init=False)
    _feeds: Mapping[str, str] = field(default_factory=dict, init=False)
    _recorded: Mapping[str, Recorded] = field(default_factory=dict, init=False)
    _decisions: list[TraceRecord] = field(default_factory=list, init=False)

    def prepare(self, graph: Graph, runner: Runner, folder: Path) -> Graph:
        # Simulated speech has the duration of its sound, without playback.
        playback: dict[str, object] = {"playback": "off"} if runner == "inline" else {}
        graph = _with_camera_pose(graph, self.bag.path)
        graph = graph.without_sources()
        if runner == "ros":
            # Each sound is answered, so that the player can wait for what is heard.
            nodes = [each for each in graph.nodes if "in_step" in each.type.parameters()]
            graph = graph.with_parameters({each.name: {"in_step": True} for each in nodes})
        self._recorded = recorded_services(self.bag, graph) if runner == "inline" else {}
        graph = with_speech_files(graph.with_stand_ins(self._recorded), folder, **playback)
        graph.expect_answers(self._recorded)
        self._feeds = feeding(self.bag, graph, self.image_topic)
        if takes_images(graph) and is_rectified(self.bag.choose_image_topic(self.image_topic).name):
            # Tell detectors, unless they state it.
            nodes = [each for each in graph.nodes if "rectified" in each.type.parameters()]
            graph = graph.with_parameters({each.name: {"rectified": True, **each.parameters} for each in nodes})
        return graph

    def observe(self, topic: str, message: Message) -> None:
        if isinstance(message, TraceRecord):
            self._decisions.append(message)

    def execute(self, execution: Execution) -> None:
        if execution.runner == "inline":
            self._run_inline(execution)
        else:
            self._run_ros(execution)
        if execution.ending.asked:
            execution.result.ended = STOPPED

    def results(self, execution: Execution) -> dict[str, Any]:
        bag, record, result = self.bag, execution.record, execution.result
        assert isinstance(record, RunRecord)
        if self.truth is not None and PersonDetections in execution.graph.topics().values():
            result.scores = score(self.truth, record.detections)
            record.write_scored(result.scores.by_frame)
        result.decisions = _compare(bag, execution.graph, self._decisions)
        decisions = {} if result.decisions is None else {"decisions": msgspec.to_builtins(result.decisions)}

        def seconds(stamp: int) -> float:
            return round((stamp - bag.start) / SECOND, 3)

        return {
            "bag": {
                "path": str(bag.path.resolve()),
                "start": bag.start,
                "duration_s": bag.duration_s,
                "topics": dict(self._feeds),
                "damage": list(bag.damage),
                "cache": self._perception,
                "skipped": {topic: msgspec.to_builtins(skipped) for topic, skipped in bag.skipped.items()},
            },
            "frames": len(record.detections),
            "actions": [
                {"t_s": seconds(action.stamp), "id": action.id, "name": action.name, "arguments": action.arguments}
                for action in record.actions
            ],
            "utterances": [
                {"t_s": seconds(said.stamp), "id": said.id, "text": said.text} for said in record.utterances
            ],
            "scores": None if result.scores is None else _scores(result.scores),
            **decisions,
        }

    def _run_inline(self, execution: Execution) -> None:
        graph = execution.graph
        if takes_images(graph) and (self.cache is not None or is_redacted(self.bag.path)):
            self._run_cached(execution, self.cache or PerceptionCache())
            return
        messages = self.bag.messages(self._feeds, graph.topics())
        if takes_images(graph):
            self._feed(execution, messages, graph)
            return
        start = self._first(messages)[1].stamp
        with execution.inline(observed_topics(graph), start, self._recorded) as runner:
            script = WorldScript(self.bag, self._feeds, graph)
            stage = InlineStage(runner, script)
            stage.begin()
            runner.start()
            play(script, stage, execution.ending)

    def _run_cached(self, execution: Execution, cache: PerceptionCache) -> None:
        """Run the graph with nodes that reuse cached messages, or cache new ones."""
        perception = cache.open(self.bag, execution.graph, self._feeds)
        complete = False
        try:
            self._feed(execution, perception.messages(), perception.graph)
            complete = not execution.ending.asked
        finally:
            perception.finish(complete=complete)
        self._perception = perception.state

    def _feed(self, execution: Execution, messages: Iterator[tuple[str, Message]], graph: Graph) -> None:
        first = self._first(messages)
        topics = observed_topics(execution.graph)
        with execution.inline(topics, first[1].stamp, self._recorded, graph) as runner:
            runner.start()
            unread = itertools.chain([first], messages)
            runner.run(itertools.takewhile(lambda _: not execution.ending.asked, unread), tail_s=TAIL_S)

    def _first(self, messages: Iterator[tuple[str, Message]]) -> tuple[str, Message]:
        for first in messages:
            return first
        raise self._unreadable()

    def _run_ros(self, execution: Execution) -> None:
        if is_redacted(self.bag.path):
            remedy = "replay it with --runner inline"
            raise BagError(
                "its images are redacted, so nodes cannot look at them", where=str(self.bag.path), remedy=remedy
            )
        ending = execution.ending
        report = execution.logs / "played.json"
        with execution.processes(observed_topics(execution.graph)) as (observer, launch):
            execution.await_graph(observer, launch)
            if not ending.asked:
                arguments = ["bag", "play", str(self.bag.path), "--graph", str(execution.logs / "graph.yaml")]
                arguments += ["--rate", str(self.rate), "--report", str(report)]
                arguments += [] if self.image_topic is None else ["--image-topic", self.image_topic]
                player = launch.start("bag_player", arguments if self.paced else [*arguments, "--no-pace"])
                while player.poll() is None and not ending.asked:
                    launch.check()
                    time.sleep(0.1)
                launch.check()
                time.sleep(DRAIN_S)
        if report.exists():
            played = from_json(read_bytes(report), PlaybackResult)
            self.bag.skipped.update(played.skipped)
            if not played.sent:
                raise self._unreadable()

    def _unreadable(self) -> BagError:
        skipped = self.bag.skipped.items()
        reasons = "; ".join(f"{topic}: {which.count} damaged: {which.first}" for topic, which in skipped)
        return BagError(f"no message can be read ({reasons})", where=str(self.bag.path), remedy="record it again")


def _with_camera_pose(graph: Graph, bag: Path) -> Graph:
    """Set the pose in the file beside the bag, if there is one, in detectors that do not state one.

    Detectors do not write their pose files, so that each replay gives the same.
    """
    kept = [each for each in graph.nodes if each.parameters.get("camera_file")]
    kept = [each.name for each in kept if "keep_pose" in each.type.parameters()]
    graph = graph.with_parameters({name: {"keep_pose": False} for name in kept})
    nodes = [each for each in graph.nodes if each.type.parameters().keys() >= {"mount_height_m", "pitch_rad"}]
    if not nodes:
        return graph
    from socialbot.vision.camera_pose import load_pose, pose_beside

    pose = load_pose(pose_beside(bag))
    if pose is None:
        return graph
    known = {"mount_height_m": pose.height_m, "pitch_rad": pose.pitch_rad}
    return graph.with_parameters({each.name: {**known, **each.parameters} for each in nodes})


def graph_of(bag: Path) -> Graph:
    """Return the graph in the folder of a bag, else Waldo's. Raises GraphError.

    Bags are untrusted: modules in their folder are not imported, and their graph moves no robot.
    """
    path = bag / BAG_GRAPH
    if not path.is_file():
        return load_graph("waldo")
    return parse_recorded(read_text(path, GraphError, remedy="give one with --graph"), where=str(path), folder=bag)


def find_truth(bag: Bag, given: Path | None = None) -> GroundTruth | None:
    """Return the ground truth ``given``, or the one beside the bag if it exists. Raises TruthError."""
    path = given or truth_beside(bag.path)
    return load_truth(path) if given is not None or path.exists() else None


def _compare(bag: Bag, graph: Graph, decisions: list[TraceRecord]) -> DecisionComparison | None:
    """Compare ``decisions`` with those in the bag; None if the bag holds none."""
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
    return compare(recorded, decisions)


def _scores(scores: Scores) -> dict[str, Any]:
    """Scores by distance band as plain data."""
    names = ("tp", "fp", "fn", "precision", "recall", "f1")
    return {
        "frames": scores.frames,
        "missing_frames": scores.missing_frames,
        "bands": {name: {each: getattr(band, each) for each in names} for name, band in scores.bands.items()},
    }
