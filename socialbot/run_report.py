"""Puts together, while a run goes on, what its page tells, and writes it: report.html, and a picture of the world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialbot.agents.deliberating import Deliberating
from socialbot.agents.hospital.chronicle import PHRASES
from socialbot.agents.hospital.coordinator_node import HospitalCoordinator
from socialbot.errors import SocialbotError
from socialbot.graph import Graph
from socialbot.messages import Message, TraceRecord
from socialbot.report.page import Page, lead_of
from socialbot.report.story import Story, story_of
from socialbot.report.worlds import World, world_of

SHOTS = 8
"""So many pictures there are of a run, at most."""
APART_S = 4.0
"""Moments that lie nearer to each other than this, or an even share of a short run, share a picture."""


@dataclass(frozen=True)
class Summary:
    """A run in figures. ``world`` says what came of it in the world, as `socialbot.report.worlds` has it."""

    story: Story
    world: Mapping[str, Any]

    @property
    def reached(self) -> bool:
        """Whether all that the run was about was reached."""
        return {desire.how for desire in self.story.aims} == {"fulfilled"}

    @property
    def given_up(self) -> int:
        """How many plans were given up."""
        return sum(plan.given_up for plan in self.story.plans)

    @property
    def requests_for_desires(self) -> int:
        """How many requests were for a desire."""
        return sum(request.about_desire for request in self.story.requests)

    def results(self) -> dict[str, Any]:
        """As plain data, for results.json."""
        story = self.story
        return {
            "reached": self.reached,
            "duration_s": round(story.duration_s, 3),
            "agents": {
                agent: {
                    "plans": sum(plan.agent == agent for plan in story.plans),
                    "given_up": sum(plan.agent == agent and plan.given_up for plan in story.plans),
                    "steps": sum(step.agent == agent for step in story.steps),
                    "requests": sum(request.sender == agent for request in story.requests),
                }
                for agent in story.agents
            },
            "desires": [
                {
                    "agent": desire.agent,
                    "name": desire.name,
                    "why": desire.why,
                    "from_s": round(story.seconds(desire.adopted), 3),
                    "to_s": None if desire.ended is None else round(story.seconds(desire.ended), 3),
                    "planned_s": planned_s,
                    "took_s": None if took_s is None else round(took_s, 3),
                    "how": desire.how,
                    "reason": desire.reason,
                }
                for desire in story.desires
                for planned_s, took_s in [story.makespans_s(desire)]
            ],
            "requests_for_desires": self.requests_for_desires,
            **self.world,
        }


class RunReport:
    """Takes the messages of a run of ``graph``, with all its nodes; `write` writes its page."""

    def __init__(self, graph: Graph) -> None:
        self.records: list[TraceRecord] = []
        self._graph = graph
        kinds = [placement.type for placement in graph.placements]
        agents = [kind for kind in kinds if issubclass(kind, Deliberating)]
        directs = any(issubclass(kind, HospitalCoordinator) for kind in kinds)
        self.deliberates = bool(agents) or directs
        """Whether there are agents to tell of."""
        self.phrases = {action: said for kind in agents for action, said in kind.phrases.items()}
        self.phrases |= PHRASES if directs else {}
        self._world: World | None = world_of(graph)

    def observe(self, topic: str, message: Message) -> None:
        """Takes one message."""
        if isinstance(message, TraceRecord):
            self.records.append(message)
        elif self._world is not None:
            self._world.take(message)

    def summary(self) -> Summary:
        """The run as far as it has come."""
        story = story_of(self.records, self.phrases)
        return Summary(story, self._world.results(story) if self._world else {})

    def write(self, folder: Path, title: str, results: Mapping[str, Any]) -> Path:
        """Writes report.html, and a picture of the world at the end, to ``folder``; ``results`` are those of the run.

        Raises SocialbotError when that is not possible.
        """
        summary, world = self.summary(), self._world
        story = summary.story
        page = Page(
            title=title,
            lead=lead_of(story),
            good=summary.reached,
            verdict="goal reached" if summary.reached else "goal not reached",
            story=story,
            tiles=[*_tiles(summary), *(world.tiles(story) if world else [])],
            scene=world.scene(story, _shots(world, story)) if world else None,
            setting=self._setting(results),
        )
        path = folder / "report.html"
        try:
            path.write_text(page.html(), encoding="utf-8")
            if world:
                (folder / world.file).write_text(world.picture(story.end, f"{title}, at the end"), encoding="utf-8")
        except OSError as error:
            raise SocialbotError(f"cannot be written: {error.strerror}", where=str(path)) from error
        return path

    def _setting(self, results: Mapping[str, Any]) -> dict[str, object]:
        """How it was run: only parameters that are not as their nodes have them by default."""
        told: dict[str, object] = {"graph": results["graph"], "runner": results["runner"], "ended": results["ended"]}
        if "bag" in results:
            told["bag"] = results["bag"]["path"]
        told["in real time"] = f"{results['wall_s']:.1f} s"
        told |= {
            f"{placement.name}.{name}": value
            for placement in self._graph.placements
            for name, value in placement.parameters.items()
            if value != placement.type.parameters()[name].default
        }
        return told | results["versions"]


def _shots(world: World, story: Story) -> list[str]:
    return [world.picture(stamp, f"{story.seconds(stamp):.1f} s: {what}") for stamp, what in _moments(story)]


def _tiles(summary: Summary) -> list[tuple[str, str]]:
    story = summary.story
    tiles = []
    if story.first is not None:
        planned_s, took_s = story.makespans_s(story.first)
        tiles.append(("-" if took_s is None else f"{took_s:.1f} s", f"for {story.first.name}"))
        if planned_s is not None:
            tiles.append((f"{planned_s:.1f} s", "in its first plan"))
    tiles.append((str(len(story.plans)), f"plans of {len(story.agents)} agents, {summary.given_up} given up"))
    tiles.append((str(sum(step.began is not None for step in story.steps)), "steps begun"))
    if story.words:
        tiles.append((str(len(story.words)), "messages between agents"))
    else:
        tiles.append((str(len(story.requests)), f"requests, {summary.requests_for_desires} for a desire"))
    return tiles


def _moments(story: Story) -> list[tuple[int, str]]:
    """What to show pictures of: start and end, plans that were given up, and what agents took up by themselves."""
    turns = [(plan.ended or 0, f"{plan.agent} gives up plan {plan.number}") for plan in story.plans if plan.reason]
    turns += [
        (desire.adopted, f"{desire.agent} wants {desire.name}")
        for desire in story.desires
        if desire.why.startswith("its rule")
    ]
    apart_s = min(APART_S, story.duration_s / SHOTS)
    chosen = [(story.start, "the start")]
    for stamp, what in sorted(turns):
        if story.seconds(stamp) - story.seconds(chosen[-1][0]) >= apart_s and len(chosen) < SHOTS - 1:
            chosen.append((stamp, what))
    return [*chosen, (story.end, "the end")]
