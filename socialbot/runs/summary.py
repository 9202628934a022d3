"""A run of deliberating agents in figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from socialbot.runs.story import Story


@dataclass(frozen=True)
class Summary:
    """A run in figures. ``world`` says what came of it in the world, as `socialbot.runs.report_worlds` has it."""

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
