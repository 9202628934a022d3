"""Branch a recorded run: run its input again up to a moment, change something, and go on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialbot.agents.dialogue.language_model import PROPOSAL
from socialbot.bags.reader import IMAGE_TYPES, open_bag
from socialbot.bdi import Engine, Plan
from socialbot.bdi.agentspeak import AgentSpeakError, parse, parse_plan
from socialbot.core.errors import ParameterError, RuleError, RunError
from socialbot.core.messages import AGENT_COMMANDS, AgentCommand, TraceRecord
from socialbot.graph.files import with_changes
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node
from socialbot.runs.difference import decision_digest
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.narration import Narrator
from socialbot.runs.record import RunRecord
from socialbot.runs.why import actions
from socialbot.runtime.bag_source import BagSource, find_truth
from socialbot.runtime.perception_cache import PerceptionCache
from socialbot.runtime.run import RunSource, run
from socialbot.runtime.simulated_source import SimulatedSource

COMMANDS = ("believe", "forget", "achieve", "drop")


@dataclass(frozen=True)
class BranchChange:
    """Change at the branch, with its text.

    The kinds are "believe", "forget", "achieve", "drop", "set", "rule", "without", and "proposal", whose text is the id
    of a record.
    """

    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind} {self.text}"


@dataclass(frozen=True)
class Futures:
    """Both futures of a run from ``at_s`` on. ``reproduced`` tells whether the unchanged one is as recorded."""

    at_s: float
    unchanged: RecordedRun
    changed: RecordedRun
    reproduced: bool


def branch(recorded: RecordedRun, at_s: float, changes: Sequence[BranchChange], agent: str, folder: Path) -> Futures:
    """Run a recorded run twice, with and without ``changes`` at ``at_s``, into subfolders of ``folder``.

    Args:
        recorded: The run, of a bag or a simulation.
        at_s: Time of the run, s.
        changes: The changes at that time, in order.
        agent: Node of the agent; empty if there is only one.
        folder: New folder for both runs.

    Raises:
        RunError: The run has no input that can be repeated, or does not contain the time.
        ParameterError: A change is impossible, with the reason.
        SocialbotError: The graph or the bag is unusable.
    """
    graph = recorded.graph
    if graph is None:
        raise RunError("the graph of the run is unknown", where=str(recorded.folder), remedy="record the run again")
    if not 0 <= at_s <= recorded.lasted_s:
        remedy = f"give a time from 0 to {recorded.lasted_s:.2f} s"
        raise RunError(f"the run does not contain {at_s:.2f} s", where=str(recorded.folder), remedy=remedy)
    stamp = recorded.history.stamp(at_s)
    changer = _Changer(recorded, graph, agent, changes, stamp)
    runs = []
    for name, on_runner in ("unchanged", None), ("changed", changer.prepare):
        with _input_of(recorded, cached=not changer.perception) as source, RunRecord(folder / name) as record:
            run(graph, source, record, changer.observe, on_runner=on_runner)
        runs.append(open_run(folder / name))
    changer.check()
    unchanged, changed = runs
    return Futures(at_s, unchanged, changed, decision_digest(unchanged) == decision_digest(recorded))


class _Changer:
    """Makes changes in a running graph, and notes those that are refused."""

    def __init__(
        self, recorded: RecordedRun, graph: Graph, agent: str, changes: Sequence[BranchChange], stamp: int
    ) -> None:
        self._agent = _agent(graph, agent) if any(change.kind != "set" for change in changes) else ""
        self._changes = changes
        self._stamp = stamp
        self._problems: list[ParameterError] = []
        self._plans = {
            change: _proposed_plans(recorded, change.text) for change in changes if change.kind == "proposal"
        }
        self._values = {change: _setting(graph, change.text) for change in changes if change.kind == "set"}
        self.perception = any(
            "external_files" in vars(graph.node(node).type) for values in self._values.values() for node in values
        )
        """Whether a node that looks at images is changed, so that the cache does not serve."""

    def prepare(self, runner: InlineRunner) -> None:
        runner.call_at(self._stamp, lambda: self._change(runner))

    def observe(self, topic: str, message: Any) -> None:
        if isinstance(message, TraceRecord) and message.kind == "refused" and message.cause.startswith("what-if-"):
            reason = str(message.detail.get("reason", "it was refused"))
            self._problems.append(ParameterError(f"refused: {reason}", where=f"{self._agent}: {message.what}"))

    def check(self) -> None:
        """Raise ParameterError if a change was refused."""
        if self._problems:
            raise self._problems[0]

    def _change(self, runner: InlineRunner) -> None:
        for number, change in enumerate(self._changes, 1):
            try:
                if change.kind in COMMANDS:
                    self._command(runner, number, change)
                elif change.kind == "set":
                    for node, values in self._values[change].items():
                        for name, value in values.items():
                            runner.nodes[node].set_parameter(name, value)
                else:
                    _change_rules(runner.nodes[self._agent], change, self._plans.get(change, ()))
            except ParameterError as error:
                self._problems.append(error)

    def _command(self, runner: InlineRunner, number: int, change: BranchChange) -> None:
        command: Any = change.kind
        message = AgentCommand(
            stamp=runner.clock.now(), id=f"what-if-{number}", agent=self._agent, command=command, text=change.text
        )
        runner.enqueue(AGENT_COMMANDS, message)


def _proposed_plans(recorded: RecordedRun, record_id: str) -> tuple[Plan, ...]:
    """Return the plans of an accepted proposal in a run. Raises ParameterError."""
    record = recorded.history.find(record_id)
    if record is None or (record.kind, record.what) != (PROPOSAL, "plan"):
        remedy = "give the id of a record of the kind proposal, about a plan, in trace.jsonl"
        raise ParameterError(f"the run has no proposed plans {record_id!r}", where="--proposal", remedy=remedy)
    if record.detail.get("refused"):
        raise ParameterError(f"{record_id} was refused: {record.detail['refused']}", where="--proposal")
    try:
        return parse(str(record.detail.get("answer", "")), record_id).plans
    except AgentSpeakError as error:
        raise ParameterError(error.what, where=f"--proposal {record_id}") from error


def _change_rules(node: Node, change: BranchChange, proposed: Sequence[Plan]) -> None:
    engine = getattr(node, "engine", None)
    if not isinstance(engine, Engine):
        raise ParameterError("its rules cannot be changed", where=node.name)
    if change.kind in ("rule", "proposal"):
        try:
            for plan in proposed or [parse_plan(change.text, "--rule")]:
                engine.library.add_rule(plan)
        except (AgentSpeakError, RuleError) as error:
            raise ParameterError(
                error.what, where=f"--{change.kind} {change.text}", remedy="write a plan in AgentSpeak"
            ) from error
        return
    heads = {plan: str(plan).partition(" >> ")[0] for plan in engine.library}
    found = [
        plan for plan, head in heads.items() if change.text in (plan.label, engine.library.given_label(plan), head)
    ]
    found = found or [plan for plan, head in heads.items() if change.text in head]
    if not found:
        remedy = f"it has {'; '.join(dict.fromkeys(heads.values()))}"
        raise ParameterError(f"{node.name} has no rule like {change.text!r}", where="--without", remedy=remedy)
    for plan in found:
        engine.library.remove(plan)


def _agent(graph: Graph, name: str) -> str:
    agents = [config.name for config in graph.nodes if config.type.is_agent]
    if name in agents or (len(agents) == 1 and not name):
        return name or agents[0]
    what = f"no agent {name!r}" if name else f"the graph has {len(agents)} agents"
    raise ParameterError(what, where="--agent", remedy=f"give one of {', '.join(agents) or 'none: it has no agent'}")


def _setting(graph: Graph, text: str) -> dict[str, dict[str, object]]:
    """Parse ``NODE.PARAMETER=VALUE``: the values by node and parameter. Raises ParameterError or GraphError."""
    changed = with_changes(graph, [text])
    before = {config.name: config.parameters for config in graph.nodes}
    name = text.partition("=")[0].partition(".")[2]
    found = {}
    for config in changed.nodes:
        if config.parameters is not before[config.name] and dict(config.parameters) != dict(before[config.name]):
            found[config.name] = {name: config.parameters[name]}
    if not found:
        raise ParameterError("this is its value already", where=f"--set {text}", remedy="give another value")
    for node in found:
        if graph.node(node).type.parameters()[name].fixed:
            remedy = f"compare with `socialbot replay BAG --set {text}`, which sets it from the start"
            raise ParameterError("it can only be set before the node starts", where=f"--set {text}", remedy=remedy)
    return found


@contextmanager
def _input_of(recorded: RecordedRun, *, cached: bool) -> Iterator[RunSource]:
    """Open the input of a run again. Raises RunError for a live run."""
    bag = recorded.results.get("bag", {})
    if bag.get("path"):
        path = Path(bag["path"])
        if not path.exists():
            raise RunError(
                f"its bag {path} does not exist", where=str(recorded.folder), remedy="put the bag back there"
            )
        with open_bag(path) as opened:
            kinds = {topic.name: topic.type for topic in opened.topics}
            images = [name for name in bag.get("topics", {}) if kinds.get(name) in IMAGE_TYPES]
            pictures = [topic.name for topic in opened.image_topics]
            chosen = next((name for name in images if name in pictures), None)
            cache = PerceptionCache() if cached else None
            yield BagSource(opened, chosen, truth=find_truth(opened), cache=cache)
    elif "simulated_s" in recorded.results:
        yield SimulatedSource(limit_s=max(recorded.results["simulated_s"] * 4, 60.0))
    else:
        remedy = "record a bag with `socialbot bag record` beside a live run, and replay it"
        raise RunError(
            "a live run cannot be repeated: its input is not recorded", where=str(recorded.folder), remedy=remedy
        )


def acts_from(run: RecordedRun, at_s: float) -> list[tuple[float, str]]:
    """Actions and utterances of the agents of a run from ``at_s`` on: times (s) and sentences."""
    narrator = Narrator(run.wording, run.history)
    done = [(run.history.seconds(record.stamp), narrator.clause(record).sentence()) for record in actions(run.history)]
    return [(time, text) for time, text in done if time >= at_s]


def side_by_side(futures: Futures) -> list[tuple[float, str, str]]:
    """Rows of both futures by time (s): events in both, or in one of them only."""
    one, other = (acts_from(run, futures.at_s) for run in (futures.unchanged, futures.changed))
    rows: list[tuple[float, str, str]] = []
    left = list(other)
    for time, text in one:
        same = next((each for each in left if each[1] == text and each[0] == time), None)
        if same is not None:
            left.remove(same)
        rows.append((time, text, text if same is not None else ""))
    return sorted([*rows, *((time, "", text) for time, text in left)], key=lambda row: row[0])
