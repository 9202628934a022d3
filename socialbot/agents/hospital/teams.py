"""Who does a mission: by what they can do, whether they are free, and whose missions are less urgent."""

from __future__ import annotations

from collections.abc import Mapping

from socialbot.agents.hospital.missions import KINDS, Member, Mission, Role, by_number
from socialbot.agents.hospital.ward_messages import AWAY, WardState


def team_for(mission: Mission, members: Mapping[str, Member], ward: WardState) -> dict[str, str] | None:
    """Who is free to play each role of a mission, by the variables of the roles; None if somebody is missing."""
    team: dict[str, str] = {}
    for role in KINDS[mission.kind].roles:
        able = candidates(mission, role, members, ward)
        found = next((each for each in able if not each.mission and each.name not in team.values()), None)
        if found is None:
            return None
        team[role.variable] = found.name
    return team


def candidates(mission: Mission, role: Role, members: Mapping[str, Member], ward: WardState) -> list[Member]:
    """Who can play a role, free or not: those with full batteries first, then by number."""
    found: list[tuple[bool, tuple[str, int], Member]] = []
    for member in members.values():
        state = ward.agent(member.name) if role.needs <= member.capabilities else None
        if state is not None and state.place != AWAY and (not role.at_home or state.home == mission.room):
            found.append((state.low_battery, by_number(member.name), member))
    return [member for *_, member in sorted(found, key=lambda each: each[:2])]


def yielding(
    mission: Mission, members: Mapping[str, Member], missions: Mapping[int, Mission], ward: WardState
) -> list[Mission]:
    """The less urgent missions that have whom a mission lacks, of equal ones the latest; none if that is no help."""
    chosen: dict[int, Mission] = {}
    taken: set[str] = set()
    for role in KINDS[mission.kind].roles:
        able = [each for each in candidates(mission, role, members, ward) if each.name not in taken]
        free = next((each for each in able if not each.mission or each.mission in chosen), None)
        if free is None:
            lower = [each for each in able if missions[each.mission].priority < mission.priority]
            if not lower:
                return []
            free = min(lower, key=lambda each: (missions[each.mission].priority, -each.mission))
            chosen[free.mission] = missions[free.mission]
        taken.add(free.name)
    return list(chosen.values())
