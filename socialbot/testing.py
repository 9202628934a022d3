"""Test helpers: run graphs, nodes and engines in simulated time, check outputs, and expect behaviours of runs.

::

    from socialbot.testing import GraphTester

    def test_the_robot_greets_a_visitor():
        with GraphTester("graph.yaml", parameters={"speech": {"playback": "off"}}) as tester:
            tester.run(5.0)
        assert [say.text for say in tester.messages("/speech/say")] == ["Hello!"]
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socialbot.core.clock import SECOND, ManualClock, nanoseconds
from socialbot.core.errors import GraphError, MessageError, NodeError, suggestion
from socialbot.core.messages import Message, Structured, check_fields
from socialbot.graph.files import load_graph
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.runs.expectations import (
    Expectation,
    achieved,
    always,
    anyone,
    at_all_times,
    began,
    believed,
    count,
    did,
    doing,
    dropped,
    ended,
    evaluate,
    eventually,
    expect,
    failed,
    finished,
    health,
    historically,
    in_order,
    latest,
    load_behaviours,
    message,
    never,
    once,
    once_per,
    person,
    planned,
    recorded,
    said,
    told,
    wanted,
    wanting,
)

if TYPE_CHECKING:
    from socialbot.bdi import Engine, Society
    from socialbot.runs.folder import RecordedRun

__all__ = [
    "SECOND", "Expectation", "GraphTester", "ManualClock", "Structured", "achieved", "always", "anyone", "at_all_times",
    "began", "believed", "count", "did", "doing", "dropped", "ended", "evaluate", "eventually", "expect", "failed",
    "finished", "health", "historically", "in_order", "latest", "load_behaviours", "message", "never", "once",
    "once_per", "person", "planned", "recorded", "run_engine", "said", "told", "wanted", "wanting",
]  # fmt: skip


class GraphTester:
    """Test runner of a graph in one thread and simulated time, which records every message.

    Use it as a context manager: nodes start on entry and stop on exit. A node that raises fails the test on exit.
    A message that no receiver could decode, such as one with a text where its class says ``int``, raises MessageError.

    Args:
        graph: A graph, the name or path of a graph file, or a single node class. The node of a class is called
            ``node``, and its inputs are connected to the test.
        parameters: Parameters by node name; for a single node class, its own parameters.
        start: Time at the beginning (ns).
    """

    def __init__(
        self, graph: Graph | str | Path | type[Node], *, parameters: Mapping[str, Any] | None = None, start: int = 0
    ) -> None:
        if isinstance(graph, type):
            config = NodeConfig("node", graph, parameters or {})
            graph = Graph(
                "test",
                (config,),
                inputs=frozenset(topic for topic, _ in config.subscriptions),
                services=frozenset(topic for topic, _ in config.clients),
            )
        else:
            graph = graph if isinstance(graph, Graph) else load_graph(str(graph))
            graph = graph.with_parameters(parameters or {}).with_stand_ins()
        self.graph = graph
        self.runner = InlineRunner(graph, start=start)
        self._seen: list[tuple[str, int, Message]] = []
        self._kinds: dict[str, type[Message]] = {**dict.fromkeys(sorted(graph.inputs), Message), **graph.topics()}
        for topic in self._kinds:
            self.runner.tap(topic, self._note)

    def __enter__(self) -> GraphTester:
        self.runner.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.runner.close()
        failed = {name: faults.first for name, faults in self.runner.faults.items() if faults.failures}
        if failed and kind is None:
            name, first = next(iter(failed.items()))
            raise NodeError(f"failed: {first}", where=name, remedy="see the log of the test for the traceback")

    @property
    def clock(self) -> ManualClock:
        """The simulated clock."""
        return self.runner.clock

    @property
    def seconds(self) -> float:
        """The simulated time (s)."""
        return self.clock.now() / SECOND

    def node(self, name: str = "node") -> Any:
        """The node called ``name``. Raises GraphError if there is none."""
        if name not in self.runner.nodes:
            raise GraphError(f"no node {name!r}", where=self.graph.name, remedy=suggestion(name, self.runner.nodes))
        return self.runner.nodes[name]

    def send(self, topic: str, message: Message) -> None:
        """Deliver ``message`` at its stamp, or now if that has passed, with all resulting messages.

        Raises:
            GraphError: The graph has no such topic, or the nodes have not started.
            MessageError: The topic has messages of another type.
        """
        kind = self._kind(topic)
        if not isinstance(message, kind):
            raise MessageError(f"{topic} takes {kind.__name__}, not {type(message).__name__}", where=self.graph.name)
        self._expect_started()
        self.runner.feed(topic, message)

    def run(self, seconds: float) -> None:
        """Let ``seconds`` of simulated time pass. Raises GraphError if the nodes have not started."""
        self._expect_started()
        self.runner.advance(self.clock.now() + nanoseconds(seconds))

    def messages(self, topic: str) -> list[Any]:
        """All messages on ``topic`` so far, in order. Raises GraphError if the graph has no such topic."""
        self._kind(topic)
        return [message for name, _, message in self._seen if name == topic]

    def times(self, topic: str) -> list[float]:
        """Times (s) at which messages on ``topic`` were published. Raises GraphError if the graph has no such topic."""
        self._kind(topic)
        return [time / SECOND for name, time, _ in self._seen if name == topic]

    def recorded(self, folder: Path) -> RecordedRun:
        """Write what happened so far into the empty ``folder`` as a run, for `evaluate`, and open it."""
        from socialbot.runs.folder import open_run
        from socialbot.runs.record import WELL, RunRecord, with_event_log

        with RunRecord(folder) as record:
            record.describe(self.graph)
            observe = with_event_log(self.graph, record.observe)
            for topic, _, message in self._seen:
                observe(topic, message)
            record.write_results({"graph": self.graph.name, "ended": WELL})
        return open_run(folder)

    def _kind(self, topic: str) -> type[Message]:
        if topic not in self._kinds:
            remedy = suggestion(topic, self._kinds)
            raise GraphError(f"no topic {topic!r}", where=self.graph.name, remedy=remedy)
        return self._kinds[topic]

    def _expect_started(self) -> None:
        if not self.runner.started:
            remedy = "write: with GraphTester(...) as tester:"
            raise GraphError("the nodes have not started", where=self.graph.name, remedy=remedy)

    def _note(self, topic: str, message: Message) -> None:
        if isinstance(message, Structured):
            check_fields(message, where=topic)
        self._seen.append((topic, self.clock.now(), message))


def run_engine(engine: Engine | Society, seconds: float = 0.0) -> None:
    """Run an engine or a society until it is idle, then for ``seconds`` of simulated time, timers included.

    The clock of the engine must be a `ManualClock`.
    """
    clock = engine.clock
    if not isinstance(clock, ManualClock):
        raise TypeError("run_engine needs an engine with a ManualClock")
    end = clock.now() + nanoseconds(seconds)
    while True:
        while engine.run_until_idle():
            pass
        due = engine.next_wakeup()
        if due is None or due > end:
            break
        clock.set(max(due, clock.now()))
    clock.set(end)
