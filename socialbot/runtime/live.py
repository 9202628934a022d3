"""A graph on live input, watched and recorded until it is told to end."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from socialbot.agents.base.agent_node import AgentNode
from socialbot.bridge.graph_observer import expect_free_names, observe_graph
from socialbot.core import paths
from socialbot.core.clock import WallClock
from socialbot.core.errors import ParameterError, SocialbotError
from socialbot.core.messages import Message
from socialbot.core.process import Ending
from socialbot.graph.node import Graph
from socialbot.runs.console import Display
from socialbot.runs.record import WELL, RunTrace, versions, with_event_log
from socialbot.runs.report import write_report
from socialbot.runtime.processes import RestartPolicy
from socialbot.runtime.replay import keep_speech, observed_topics, parameters_of
from socialbot.runtime.run_lock import run_lock
from socialbot.runtime.supervisor import Supervisor, Variables, no_variables

ATTEND_S = 0.1

NOTEWORTHY_S = 0.5
"""By less a clock may be set without a word."""

log = logging.getLogger("socialbot.runtime.live")

LONGEST_BYTES = 20_000_000
"""A longer record is not made a page of at the end, so that nobody waits for it."""


class Surroundings:
    """What a live run depends on beside its graph; here nothing."""

    def there(self) -> AbstractContextManager[object]:
        """What has to be there as long as the processes of the graph are; entered anew each time that they start."""
        return nullcontext()

    def missed(self) -> tuple[float, float] | None:
        """When something has come: who started between these times (monotonic s) does not know of it. Told once."""
        return None


def run_live(
    graph: Graph,
    record: RunTrace,
    console: Console,
    *,
    composed: bool = False,
    policy: RestartPolicy | None = None,
    nodes: Collection[str] | None = None,
    variables: Variables = no_variables,
    minds: Path | None = None,
    surroundings: Surroundings | None = None,
) -> None:
    """Runs ``graph`` until SIGINT, SIGTERM or ``socialbot down``, and tells on ``console`` what happens.

    What dies is started again. With ``nodes`` it runs only these, and tells of what they say and hear; ``variables`` as
    for a `Supervisor`. Agents keep their minds in ``minds``, and go on with those that are there; by default in the
    folder of the record, so that they begin anew. What has missed a part of the ``surroundings`` is started again
    when that has come.
    Raises what `Supervisor.attend` does.
    """
    record.describe(graph)
    graph = keep_minds(keep_speech(graph, record.folder), minds or record.folder / "minds")
    around = surroundings or Surroundings()
    clock, names = WallClock(), {placement.name for placement in graph.placements}
    from socialbot.bridge.run_announcer import RunAnnouncer
    from socialbot.runtime.supervisor import Obituaries

    with (
        concluding(record, graph, console, composed=composed),
        Ending().on_signals() as ending,
        display_of(graph, console) as shown,
    ):

        def observe(topic: str, message: Message) -> None:
            record.observe(topic, message)
            shown.show(topic, message)

        def note(name: str, values: dict[str, str]) -> None:
            if name in names:  # others may speak on /diagnostics, too
                record.note_node(clock.now(), name, values)

        watch = ClockWatch(clock)
        well: frozenset[str] | None = None
        while not ending.asked:
            begun = time.monotonic()
            with (
                around.there(),
                observe_graph(topics_of(graph, nodes), with_event_log(graph, observe), note, graph.wire) as onlooker,
            ):
                presence = RunAnnouncer(onlooker.ros, graph.name, ending.ask)
                with run_lock(presence.run):
                    if well is None:  # later a twin is told of, as when it is found while all goes on
                        expect_free_names(onlooker.ros, graph, nodes)
                    supervisor = Supervisor(
                        graph,
                        record.folder / "log",
                        composed=composed,
                        policy=policy,
                        nodes=nodes,
                        variables=variables,
                        well=well or (),
                    )
                    with presence, supervisor:
                        obituaries = Obituaries(onlooker.ros, supervisor)
                        while not (ending.asked or renewed(supervisor, begun, around)):
                            supervisor.attend(ATTEND_S)
                            obituaries.tell()
                            presence.announce()
                            watch.look()
                        well = supervisor.well
            if not ending.asked:
                log.warning("all is started again, as it has missed what came later")


def renewed(supervisor: Supervisor, begun: float, around: Surroundings) -> bool:
    """Starts those processes again that have missed something; says whether who began at ``begun`` has, too."""
    missed = around.missed()
    if missed is None:
        return False
    begin, end = missed
    if begin <= begun <= end:
        return True
    supervisor.renew(begin, end)
    return False


@dataclass
class ClockWatch:
    """Says that somebody has set the computer's clock, which the ``clock`` of the graph does not follow."""

    clock: WallClock
    told_s: float = 0.0
    """How far the two were apart when it was told last."""

    def look(self) -> None:
        """Looks once."""
        behind_s = self.clock.behind_s
        if abs(behind_s - self.told_s) < NOTEWORTHY_S:
            return
        log.warning(
            "the clock of this computer was set %s by %.1f s; the graph goes on by the time it had, which is %.1f s %s:"
            " to take over the new one, start it again",
            "forward" if behind_s > self.told_s else "back",
            abs(behind_s - self.told_s),
            abs(behind_s),
            "behind" if behind_s > 0 else "ahead",
        )
        self.told_s = behind_s


@contextmanager
def concluding(record: RunTrace, graph: Graph, console: Console, *, composed: bool) -> Iterator[None]:
    """Writes what is left to write of a live run, results.json and its page, when the block is left."""
    begun, ended = time.monotonic(), WELL
    try:
        yield
    except SocialbotError as error:
        ended = str(error)
        raise
    finally:
        record.write_results(
            {
                "schema": "socialbot/results",
                "version": 1,
                "graph": graph.name,
                "runner": "ros",
                "composed": composed,
                "parameters": parameters_of(graph),
                "ended": ended,
                "wall_s": round(time.monotonic() - begun, 3),
                "versions": versions(),
            }
        )
        if record.size > LONGEST_BYTES:
            told = f"The run was long: socialbot report {record.folder} writes its page."
        else:
            told = f"Its page: {write_report(record.folder, f'{graph.name.capitalize()}, live')}"
        console.print(told, soft_wrap=True, markup=False)


def topics_of(graph: Graph, nodes: Collection[str] | None) -> dict[str, type[Message]]:
    """The topics of note that ``nodes`` of ``graph``, by default all, publish or listen to."""
    ports = {
        topic
        for placement in graph.placements
        if nodes is None or placement.name in nodes
        for topic, _ in (*placement.publications, *placement.subscriptions)
    }
    return {topic: kind for topic, kind in observed_topics(graph).items() if topic in ports}


def keep_minds(graph: Graph, folder: Path) -> Graph:
    """``graph`` with agents that keep their minds in ``folder``, where they are not told to keep them elsewhere.

    Raises ParameterError when there can be no such folder.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(
            f"no folder for minds: {error.strerror}", where=str(folder), remedy="name another"
        ) from error
    paths.allow(folder)
    kept: dict[str, dict[str, object]] = {}
    for placement in graph.placements:
        known = placement.type.parameters()
        for parameter in {"mind_file", "memory_file"} & known.keys() - placement.parameters.keys():
            if not issubclass(placement.type, AgentNode) or placement.type.keeps_mind:
                kept[placement.name] = {parameter: str((folder / f"{placement.name}.json").resolve())}
    return graph.with_parameters(kept)


def display_of(graph: Graph, console: Console) -> Display:
    """Return the terminal display of a live run of ``graph``."""
    now = WallClock().now()
    deliberates = any(placement.type.deliberates for placement in graph.placements)
    return Display(console, graph.without_sources(), start=None if deliberates else now)
