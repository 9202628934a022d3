"""Building of a reception: its rooms, colleagues and opening hours, from a YAML file::

    timezone: Europe/Berlin
    hours:
      mon-fri: "08:00-18:00"
      sat: "10:00-14:00"
    rooms:
      library:
        names: {en: [library, reading room], de: Bibliothek}
        way: {en: "The library is on the second floor.", de: "Die Bibliothek ist im zweiten Stock."}
    colleagues:
      anna: {names: {en: [Anna Smith, Anna]}, room: library, contact: "12"}
    emergency: anna

Days are single ones or ranges; a colleague needs no room. The colleague of ``emergency`` is called in an emergency.
A room may have ``hours`` of its own.
"""

from __future__ import annotations

import re
import zoneinfo
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, time, timezone, tzinfo
from pathlib import Path

import msgspec

from socialbot.agents.dialogue import Script
from socialbot.agents.dialogue.script import Texts, listed, page_of
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, suggestion
from socialbot.core.installation import pip_command
from socialbot.core.yaml import YamlSection

BUILDING = Path(__file__).with_name("building.yaml")
"""Building of the demo."""

DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")

_HOURS = re.compile(r"([01]?\d|2[0-3]):([0-5]\d)\s*-\s*([01]?\d|2[0-3]):([0-5]\d)")


class Colleague(msgspec.Struct):
    """Person who can be called, with names by language; ``room`` is "" if unknown."""

    names: Texts
    contact: str
    room: str = ""


@dataclass(frozen=True)
class Building:
    """Rooms, colleagues and opening hours of a building.

    Args:
        rooms: Names of the rooms by language.
        ways: Sentences with the way to each room, by language.
        people: Names of the colleagues by language.
        colleagues: The colleagues.
        hours: Opening and closing time by day of the week, 0 for Monday.
        zone: Time zone of the hours.
        room_hours: The same for rooms with hours of their own.
        emergency: Colleague who is called in an emergency, "" for none.
    """

    rooms: Mapping[str, Mapping[str, list[str]]]
    ways: Mapping[str, Mapping[str, str]]
    people: Mapping[str, Mapping[str, list[str]]]
    colleagues: Mapping[str, Colleague]
    hours: Mapping[int, tuple[time, time]]
    zone: tzinfo
    room_hours: Mapping[str, Mapping[int, tuple[time, time]]] = field(default_factory=dict)
    emergency: str = ""

    def script(self) -> Script:
        """Return the sentences with the ways, as situations ``way_ROOM``."""
        return Script(sentences={f"way_{room}": texts for room, texts in self.ways.items()})

    def hours_at(self, now: int) -> tuple[str, str] | None:
        """Opening and closing time on the day of ``now`` (ns), as texts such as 8:00; None if it is closed that day."""
        return self.hours_on("today", now)

    def hours_on(self, day: str, now: int, room: str = "") -> tuple[str, str] | None:
        """Opening and closing time on one of `DAYS`, today or tomorrow, seen from ``now`` (ns); None if closed.

        They are those of the building, or of a ``room`` in `room_hours`.
        """
        today = self._local(now).weekday()
        weekday = DAYS.index(day) if day in DAYS else (today + (day == "tomorrow")) % 7
        times = (self.room_hours[room] if room else self.hours).get(weekday)
        return None if times is None else (_clock_text(times[0]), _clock_text(times[1]))

    def clock_at(self, now: int) -> str:
        """Time of day at ``now`` (ns) in the building, such as 8:05."""
        return _clock_text(self._local(now).time())

    def is_open(self, now: int) -> bool:
        """Whether the building is open at ``now`` (ns)."""
        local = self._local(now)
        times = self.hours.get(local.weekday())
        return times is not None and times[0] <= local.time() < times[1]

    def _local(self, now: int) -> datetime:
        return datetime.fromtimestamp(now // SECOND, self.zone)


class _Room(msgspec.Struct):
    names: Texts
    way: Texts
    hours: dict[str, str] = {}


class _Page(msgspec.Struct):
    timezone: str = "UTC"
    hours: dict[str, str] = {}
    rooms: dict[str, _Room] = {}
    colleagues: dict[str, Colleague] = {}
    emergency: str = ""


def load_building(path: Path | str, text: str | None = None) -> Building:
    """Read a building from a YAML file, or from its ``text``.

    Raises:
        GraphError: The file cannot be read, or is invalid.
    """
    root = page_of(path, text)
    page = root.read(_Page)
    for name, one in page.colleagues.items():
        if one.room and one.room not in page.rooms:
            where = root.line("colleagues", name, "room")
            raise GraphError(f"unknown room {one.room!r}", where=where, remedy=suggestion(one.room, page.rooms))
    if page.emergency and page.emergency not in page.colleagues:
        what, remedy = f"unknown colleague {page.emergency!r}", suggestion(page.emergency, page.colleagues)
        raise GraphError(what, where=root.line("emergency"), remedy=remedy)
    return Building(
        {name: listed(room.names) for name, room in page.rooms.items()},
        {
            name: {language: " ".join(texts) for language, texts in listed(room.way).items()}
            for name, room in page.rooms.items()
        },
        {name: listed(one.names) for name, one in page.colleagues.items()},
        page.colleagues,
        _week(page.hours, root, "hours"),
        _zone(page.timezone, root.line("timezone")),
        {name: _week(room.hours, root, "rooms", name, "hours") for name, room in page.rooms.items() if room.hours},
        page.emergency,
    )


def _week(hours: Mapping[str, str], root: YamlSection, *path: str) -> dict[int, tuple[time, time]]:
    return dict(entry for days, text in hours.items() for entry in _days(days, text, root.line(*path, days)))


def _days(days: str, hours: str, where: str) -> list[tuple[int, tuple[time, time]]]:
    first, _, last = days.partition("-")
    for day in (first, last or first):
        if day not in DAYS:
            raise GraphError(f"unknown day {day!r}", where=where, remedy=suggestion(day, DAYS))
    opens = closes = time()
    if match := _HOURS.fullmatch(hours):
        opens, closes = time(int(match[1]), int(match[2])), time(int(match[3]), int(match[4]))
    if opens >= closes:
        raise GraphError(f"no hours: {hours!r}", where=where, remedy='write them as in "08:00-18:00"')
    begin, end = DAYS.index(first), DAYS.index(last or first)
    count = (end - begin) % 7 + 1
    return [((begin + day) % 7, (opens, closes)) for day in range(count)]


def _zone(name: str, where: str) -> tzinfo:
    if name == "UTC":
        return timezone.utc
    try:
        return zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError) as error:
        install = pip_command("install", "tzdata")
        remedy = f"write it as in Europe/Berlin; without a time zone database on this machine: {install}"
        raise GraphError(f"unknown time zone {name!r}", where=where, remedy=remedy) from error


def _clock_text(at: time) -> str:
    return f"{at.hour}:{at.minute:02d}"
