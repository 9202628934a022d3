"""A graph on live input, watched and recorded until it is told to end."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from rich.console import Console

from socialbot.agents.agent_node import AgentNode
from socialbot.bridge.observing import Fates, observing
from socialbot.bridge.readiness import expect_free_names
from socialbot.bridge.restarting import RestartPolicy
from socialbot.bridge.supervisor import Supervisor, Variables, no_variables
from socialbot.clock import WallClock
from socialbot.display import Display
from socialbot.ending import Ending
from socialbot.graph import Graph
from socialbot.messages import Message
from socialbot.replay import keep_speech, observed_topics
from socialbot.report.display import RunDisplay
from socialbot.report.telling import telling
from socialbot.run_record import RunRecord
from socialbot.run_report import RunReport

ATTEND_S = 0.1


def run_live(
    graph: Graph,
    record: RunRecord,
    console: Console,
    *,
    composed: bool = False,
    policy: RestartPolicy | None = None,
    nodes: Collection[str] | None = None,
    variables: Variables = no_variables,
) -> None:
    """Runs ``graph`` until SIGINT or SIGTERM, and tells on ``console`` what happens. What dies is started again.

    With ``nodes`` it runs only these, and tells of what they say and hear; ``variables`` as for a `Supervisor`.
    Raises what `Supervisor.attend` does.
    """
    graph = keep_minds(keep_speech(graph, record.folder), record.folder / "minds")
    from socialbot.bridge.obituaries import Obituaries

    with Ending().on_signals() as ending, display_of(graph, console) as shown:

        def observe(topic: str, message: Message) -> None:
            record.observe(topic, message)
            shown.show(topic, message)

        with observing(topics_of(graph, nodes), telling(graph, observe), Fates(graph).note) as onlooker:
            expect_free_names(onlooker.ros, graph, nodes)
            with Supervisor(
                graph, record.folder / "log", composed=composed, policy=policy, nodes=nodes, variables=variables
            ) as supervisor:
                obituaries = Obituaries(onlooker.ros, supervisor)
                while not ending.asked:
                    supervisor.attend(ATTEND_S)
                    obituaries.tell()


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
    """``graph`` with agents that keep their minds in ``folder``, where they are not told to keep them elsewhere."""
    folder.mkdir(parents=True, exist_ok=True)
    kept: dict[str, dict[str, object]] = {}
    for placement in graph.placements:
        known = placement.type.parameters()
        for parameter in {"mind_file", "memory_file"} & known.keys() - placement.parameters.keys():
            if not issubclass(placement.type, AgentNode) or placement.type.keeps_mind:
                kept[placement.name] = {parameter: str((folder / f"{placement.name}.json").resolve())}
    return graph.with_parameters(kept)


def display_of(graph: Graph, console: Console) -> Display | RunDisplay:
    """What shows a live run of ``graph``: as a story where agents deliberate, else what is perceived and done."""
    report = RunReport(graph)
    if report.deliberates:
        return RunDisplay(console, report.phrases, graph.without_sources())
    now = WallClock().now()
    return Display(console, start=now, until=now)
