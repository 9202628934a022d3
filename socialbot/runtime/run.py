"""Run a graph on a source of input: a bag, live sensors or a simulated world."""

from __future__ import annotations

import atexit
import itertools
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from socialbot.core.clock import ManualClock
from socialbot.core.decoding import from_builtins
from socialbot.core.errors import NodeError
from socialbot.core.messages import Health, Message, Structured
from socialbot.core.process import Ending
from socialbot.core.process_guard import guarded
from socialbot.deliberation.messages import PlanExecutionInfo
from socialbot.graph.inline import InlineRunner, Recorded
from socialbot.graph.node import Graph, check_parameters
from socialbot.runs.difference import DecisionComparison
from socialbot.runs.record import (
    LOGS,
    RECORDED,
    SOUNDS,
    WELL,
    MessageObserver,
    RunTrace,
    event_log_topics,
    versions,
    with_event_log,
    world_view_topics,
)
from socialbot.runtime.launch import Launch
from socialbot.speech.speaker import Speaker

if TYPE_CHECKING:
    from socialbot.bridge.graph_observer import GraphObserver
    from socialbot.vision.metrics.scores import Scores

Runner = Literal["ros", "inline"]

GRAPH_TIMEOUT_S = 60.0  # time limit for the processes of a graph to start and to connect


@dataclass
class NodeResult:
    """Statistics of one node over a run."""

    calls: int = 0
    failures: int = 0
    first_failure: str = ""
    skipped: int = 0
    cpu_s: float | None = None
    peak_rss_mb: float | None = None


@dataclass
class RunResult:
    """Result of a run.

    Attributes:
        ended: Reason for the end, as in results.json.
        seconds: Simulated duration of a simulation.
        wall_s: Real duration.
        nodes: Statistics by node name.
        scores: Detection scores, if the ground truth is known.
        decisions: Comparison with the decisions in the bag, if any.
        results: Content of results.json.
    """

    ended: str = WELL
    seconds: float = 0.0
    wall_s: float = 0.0
    nodes: dict[str, NodeResult] = field(default_factory=dict)
    scores: Scores | None = None
    decisions: DecisionComparison | None = None
    results: dict[str, Any] = field(default_factory=dict)

    def check(self) -> None:
        """Raises NodeError when every call of a node failed."""
        for name, node in self.nodes.items():
            if node.failures and node.failures >= node.calls:
                raise NodeError(f"failed {node.failures} times; first: {node.first_failure}", where=name)


class RunSource:
    """Input of a run. An object serves one run; subclasses are `BagSource`, `LiveSource` and `SimulatedSource`.

    Attributes:
        nodes: Names of the nodes of the graph that run on this machine; None for all.
    """

    nodes: Collection[str] | None = None

    def prepare(self, graph: Graph, runner: Runner, folder: Path) -> Graph:
        """Return ``graph`` adapted to this source, with files of its nodes in ``folder``."""
        return graph

    def observe(self, topic: str, message: Message) -> None:
        """Receive a message of the run."""

    def execute(self, execution: Execution) -> None:
        """Run the graph until the source ends or a signal arrives."""
        raise NotImplementedError

    def results(self, execution: Execution) -> dict[str, Any]:
        """Return the entries of results.json specific to this source."""
        return {}


@dataclass
class Execution:
    """Run in progress, as passed to its source."""

    graph: Graph
    runner: Runner
    composed: bool
    record: RunTrace
    observe: MessageObserver
    ending: Ending
    result: RunResult
    on_runner: Callable[[InlineRunner], None] | None = None

    @property
    def logs(self) -> Path:
        return self.record.folder / LOGS

    @contextmanager
    def inline(
        self,
        topics: Mapping[str, type[Message]],
        start: int,
        recorded: Mapping[str, Recorded] | None = None,
        graph: Graph | None = None,
    ) -> Iterator[InlineRunner]:
        """Create an inline runner that starts at ``start`` (ns) and observes ``topics``; not started yet.

        ``recorded`` are the services with recorded answers, ``graph`` a graph to run instead of that of the run.
        """
        runner = InlineRunner(graph or self.graph, start=start, recorded=recorded)
        for topic in topics:
            runner.tap(topic, self.observe)
        if self.on_runner is not None:
            self.on_runner(runner)
        try:
            yield runner
        finally:
            runner.close()
        for name, faults in runner.faults.items():
            self.result.nodes[name] = NodeResult(faults.calls, faults.failures, faults.first)

    @contextmanager
    def processes(self, topics: Mapping[str, type[Message]]) -> Iterator[tuple[GraphObserver, Launch]]:
        """Run the graph in ROS processes on simulated time and observe ``topics``.

        Raises:
            NodeError: A process failed, or a node of the same name is running already.
        """
        from socialbot.bridge.graph_observer import LatestStatistics, expect_free_names, observe_graph
        from socialbot.bridge.translator import with_standard_types

        statistics = LatestStatistics(self.graph)
        with (
            with_standard_types(self.graph, self.observe) as observe,
            observe_graph(topics, observe, statistics.note, self.graph.wire, clock=ManualClock()) as observer,
        ):
            expect_free_names(observer.ros, self.graph)
            with Launch(self.graph, self.logs, sim_time=True, composed=self.composed) as launch:
                yield observer, launch
        failed = [f"{name} ({code})" for name, code in launch.exit_codes.items() if code]
        if failed and not self.ending.asked:
            raise NodeError(f"did not end well: {', '.join(failed)}", where=str(self.logs))
        self.result.nodes.update(
            (name, from_builtins(values, NodeResult, strict=False))
            for name, values in sorted(statistics.latest.items())
        )

    def await_graph(self, observer: GraphObserver, launch: Launch) -> None:
        """Wait until all nodes are connected, or a signal arrives. Raises NodeError after `GRAPH_TIMEOUT_S`."""
        from socialbot.bridge.graph_observer import await_graph, not_connected

        def ended() -> bool:
            launch.check()
            return self.ending.asked

        connections = observer.connections(self.graph)
        missing = await_graph(observer.ros, self.graph, connections, timeout_s=GRAPH_TIMEOUT_S, ended=ended)
        if missing and not self.ending.asked:
            raise not_connected(missing, GRAPH_TIMEOUT_S)


def run(
    graph: Graph,
    source: RunSource,
    record: RunTrace,
    observe: MessageObserver = lambda topic, message: None,
    *,
    runner: Runner = "inline",
    composed: bool = False,
    summarize: Callable[[], Mapping[str, Any]] = dict,
    on_runner: Callable[[InlineRunner], None] | None = None,
) -> RunResult:
    """Run ``graph`` on ``source`` and write results.json, also after a failure.

    Args:
        graph: The whole graph; a bag replaces its sources.
        source: Input of the run.
        record: Recorder of every message.
        observe: Called with the topic and message of every message.
        runner: "inline" for one thread and simulated time, "ros" for processes over DDS.
        composed: Run all nodes in one process ("ros").
        summarize: Called after the run; returns additional entries of results.json.
        on_runner: Called with the inline runner before its nodes start; it may schedule changes.

    Raises:
        SocialbotError: The run failed.
    """
    record.describe(graph)
    graph = source.prepare(graph, runner, record.folder)
    if runner == "ros":
        from socialbot.bridge.ros_checks import expect_types

        expect_types(graph, source.nodes)
    result = RunResult()
    begun = time.monotonic()

    def note(topic: str, message: Message) -> None:
        record.observe(topic, message)
        source.observe(topic, message)
        observe(topic, message)

    with Ending().on_signals() as ending:
        observe_all = with_event_log(graph, note)
        execution = Execution(graph, runner, composed, record, observe_all, ending, result, on_runner)
        try:
            # Results of long runs take minutes, and call no library that may block.
            with guarded() if runner == "ros" else nullcontext():
                source.execute(execution)
        except Exception as error:
            result.ended = str(error) or type(error).__name__
            raise
        finally:  # keep the record of a failed run too
            result.wall_s = time.monotonic() - begun
            result.results = {
                "schema": "socialbot/results",
                "version": 1,
                "graph": graph.name,
                "runner": runner,
                "composed": composed,
                "parameters": parameters_of(graph),
                "labels": record.labels,
                **({} if record.privacy == "none" else {"privacy": record.privacy}),
                "ended": result.ended,
                "seconds": round(result.seconds, 6),
                **summarize(),
                **source.results(execution),
                "nodes": {name: msgspec.to_builtins(node) for name, node in result.nodes.items()},
                "wall_s": round(result.wall_s, 3),
                "versions": versions(),
            }
            record.write_results(result.results)
    return result


def new_run_folder(parent: Path = Path("runs")) -> Path:
    """Make a folder named by the local time, and return it; runs that begin in the same second get a number, too.

    It is removed at the end of the process if nothing was written. If it cannot be made, the record of a run says so.
    """
    name, is_first = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S"), not parent.exists()
    names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
    folder = parent / next(names)
    with suppress(OSError):
        while not _made(folder):
            folder = parent / next(names)
        atexit.register(_remove_empty, [folder.absolute(), *([parent.absolute()] if is_first else [])])
    return folder


def _made(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        return False
    return True


def _remove_empty(folders: Iterable[Path]) -> None:
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def observed_topics(graph: Graph, nodes: Collection[str] | None = None) -> dict[str, type[Message]]:
    """Return the topics to observe: recorded ones, those of the world view, plans, health and structured inputs.

    ``nodes`` limits them to topics which these nodes publish or subscribe to.
    """
    found = (
        event_log_topics(graph)
        | world_view_topics(graph)
        | {
            topic: kind
            for topic, kind in graph.topics().items()
            if issubclass(kind, (*RECORDED, PlanExecutionInfo, Health))
            or (topic in graph.inputs and issubclass(kind, Structured))
        }
    )
    chosen = [config for config in graph.nodes if nodes is None or config.name in nodes]
    ports = {topic for config in chosen for topic, _ in (*config.publications, *config.subscriptions)}
    return {topic: kind for topic, kind in found.items() if nodes is None or topic in ports}


def with_speech_files(graph: Graph, folder: Path, **parameters: object) -> Graph:
    """Return ``graph`` with speakers that write .wav files below ``folder`` and have ``parameters`` set."""
    written: dict[str, object] = {"folder": str((folder / SOUNDS).resolve()), **parameters}
    speakers = [config.name for config in graph.nodes if issubclass(config.type, Speaker)]
    return graph.with_parameters(dict.fromkeys(speakers, written))


def parameters_of(graph: Graph) -> dict[str, dict[str, Any]]:
    """Return the initial values of all parameters by node."""
    return {config.name: check_parameters(config.type, config.parameters, where=config.name) for config in graph.nodes}
