"""Event log of a hospital, and sentences for its actions."""

from __future__ import annotations

from socialbot.agents.teams.event_log import TeamEventLog
from socialbot.agents.teams.messages import Missions
from socialbot.graph.node import Graph

PHRASES = {
    "a_navigate_to": "goes to {1}",
    "a_open_door": "opens the door of {1}",
    "a_approach_nurse": "goes up to {1}",
    "a_authenticate_nurse": "authenticates: {0} with {1}",
    "a_authorize_patrol": "agrees on the patrol: {0} with {1}",
    "a_patrol_room": "patrols {1}",
    "a_adapt_room": "tidies {1}",
    "a_authorize_disinfect": "agrees on the light: {0} with {1}",
    "a_disinfect_room": "disinfects {1}",
    "a_charge": "charges",
    "a_infected_room": "says that {1} is to be disinfected",
}
"""Sentences for actions, by name."""


def event_log(graph: Graph) -> TeamEventLog | None:
    """The event log of the hospital in ``graph``; None for a graph without a coordinator."""
    is_team = Missions in graph.topics().values()
    return TeamEventLog("{0} is infected", "the ward has changed") if is_team else None
