from __future__ import annotations

from importlib import resources

import pytest

from socialbot.agents.reception import load_building
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError

TEXT = """
timezone: Europe/Berlin
hours:
  mon-fri: "08:00-18:00"
  sat: "10:00-14:00"
rooms:
  lab:
    names: {en: lab}
    way: {en: The lab is here.}
colleagues:
  anna: {names: {en: Anna}, room: lab, contact: "12"}
"""
TUESDAY_10 = 1_700_560_800 * SECOND  # 2023-11-21 10:00 UTC, 11:00 in Berlin
HOUR = 3600 * SECOND


def test_reads_a_building():
    building = load_building("building.yaml", TEXT)
    assert building.rooms == {"lab": {"en": ["lab"]}}
    assert building.colleagues["anna"].room == "lab"
    assert building.hours_at(TUESDAY_10) == ("8:00", "18:00")
    assert building.is_open(TUESDAY_10 + 7 * HOUR - SECOND)
    assert not building.is_open(TUESDAY_10 + 7 * HOUR)
    assert building.hours_at(TUESDAY_10 + 5 * 24 * HOUR) is None


def test_hours_may_go_over_the_end_of_the_week():
    building = load_building("building.yaml", TEXT.replace("mon-fri", "sun-tue"))
    assert sorted(building.hours) == [0, 1, 5, 6]


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("mon-fri", "mon-fry", "unknown day 'fry'"),
        ("08:00-18:00", "18:00-08:00", "no hours"),
        ("08:00-18:00", "eight", "no hours"),
        ("Europe/Berlin", "Europe/Waldo", "unknown time zone"),
        ("room: lab", "room: library", "unknown room 'library'"),
        ("way:", "path:", "unknown key 'path'"),
        ("colleagues:", "emergency: ann\ncolleagues:", "unknown colleague 'ann'"),
        ("way:", "hours: {mon-fry: '8:00-9:00'}\n    way:", "unknown day 'fry'"),
        ("rooms:", "places:", "unknown key 'places'"),
        ('contact: "12"', "contact: 12", "'contact' must be a text"),
    ],
)
def test_invalid_buildings_are_refused(old, new, problem):
    assert old in TEXT
    with pytest.raises(GraphError, match=r"building\.yaml:") as caught:
        load_building("building.yaml", TEXT.replace(old, new))
    assert problem in str(caught.value)


def test_the_demo_speaks_four_languages():
    text = resources.files("socialbot.agents.reception").joinpath("building.yaml").read_text("utf-8")
    building = load_building("building.yaml", text)
    languages = {"en", "de", "es", "fr"}
    assert {name for name, texts in {**building.ways, **building.rooms}.items() if set(texts) != languages} == set()
