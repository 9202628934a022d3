"""Who does a mission: by what they can do, whether they are free, and whose missions are less urgent."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter

from socialbot.agents.hospital.missions import KINDS, Member, Mission, Role, by_number
from socialbot.agents.hospital.ward.messages import AWAY, WardState


class Pool:
    """Those of the members who are there, as the ward shows them at one moment."""

    def __init__(self, members: Mapping[str, Member], ward: WardState) -> None:
        self._members = members
        self._ward = ward
        self._able: dict[str, dict[str, list[Member]]] = {}
        """Who can play the role of a variable, by the room where they have to be at home, if that matters."""

    def able(self, role: Role, room: str) -> list[Member]:
        """Who can play a role, free or not, by number; last come those with low batteries, before them who charges."""
        if role.variable not in self._able:
            self._able[role.variable] = self._by_home(role)
        return self._able[role.variable].get(room if role.at_home else "", [])

    def _by_home(self, role: Role) -> dict[str, list[Member]]:
        found: dict[str, list[tuple[tuple[bool, bool, tuple[str, int]], Member]]] = {}
        for member in self._members.values():
            state = self._ward.agent(member.name) if role.needs <= member.capabilities else None
            if state is not None and state.place != AWAY:
                place = found.setdefault(state.home if role.at_home else "", [])
                # Who is free and yet does something charges.
                place.append(((state.low_battery, bool(state.busy), by_number(member.name)), member))
        return {home: [member for _, member in sorted(able, key=itemgetter(0))] for home, able in found.items()}

    def team(self, mission: Mission) -> dict[str, str] | None:
        """Who is free to play each role of a mission, by the variables of the roles; None if somebody is missing."""
        team: dict[str, str] = {}
        for role in KINDS[mission.kind].roles:
            able = self.able(role, mission.room)
            found = next((each for each in able if not each.mission and each.name not in team.values()), None)
            if found is None:
                return None
            team[role.variable] = found.name
        return team

    def is_short(self, kind: str) -> bool:
        """Whether there is a role in all missions of a kind for which nobody is free."""
        roles = (role for role in KINDS[kind].roles if not role.at_home)
        return any(all(each.mission for each in self.able(role, "")) for role in roles)

    def yielding(self, mission: Mission, missions: Mapping[int, Mission]) -> list[Mission]:
        """The less urgent missions that have whom this one lacks, the latest of equal ones; none if that is no help."""
        chosen: dict[int, Mission] = {}
        taken: set[str] = set()
        for role in KINDS[mission.kind].roles:
            able = [each for each in self.able(role, mission.room) if each.name not in taken]
            free = next((each for each in able if not each.mission or each.mission in chosen), None)
            if free is None:
                lower = [each for each in able if missions[each.mission].priority < mission.priority]
                if not lower:
                    return []
                free = min(lower, key=lambda each: (missions[each.mission].priority, -each.mission))
                chosen[free.mission] = missions[free.mission]
            taken.add(free.name)
        return list(chosen.values())
