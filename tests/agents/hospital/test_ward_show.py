from __future__ import annotations

import io

from rich.console import Console

from socialbot.agents.base.simulation import WorldFault
from socialbot.agents.hospital.terminal import TREES, HospitalTerminal, ward_text
from socialbot.agents.hospital.ward.ward import large_ward, paper_ward
from socialbot.agents.hospital.ward.world import WardWorld
from socialbot.core.clock import SECOND
from tests.agents.hospital.runs import paper_run
from tests.runs.test_plan_trees import MENDED, PLANNED, given_up_at, made_at


def printed(*things: object) -> str:
    out = io.StringIO()
    console = Console(file=out, width=120, color_system=None, highlight=False)
    for thing in things:
        console.print(thing)
    return out.getvalue()


def shown(messages: list, ward=None) -> str:
    out = io.StringIO()
    show = HospitalTerminal(Console(file=out, width=120, color_system=None, highlight=False), ward or paper_ward())
    for message in messages:
        show.show(message)
    show.finish()
    return out.getvalue()


def test_small_ward_is_listed_room_by_room():
    world = WardWorld(paper_ward(), faults=(WorldFault(1.0, "enters", "room2", 9.0), WorldFault(1.0, "dirty", "room1")))
    world.advance(2 * SECOND)
    lines = [line.split() for line in printed(ward_text(world.ward, world.state())).splitlines()]
    assert ["room1", "closed", "dirty", "✗", "infected", "nurse1"] in lines
    assert ["room2", "open", "yes", "✓", "person1"] in lines
    assert ["room4", "open", "yes", "✓", "spot1", "100%,", "uvd1", "100%"] in lines


def test_large_ward_is_summarized_in_numbers():
    world = WardWorld(large_ward(), faults=(WorldFault(1.0, "drains", "uvdrobot2"), WorldFault(1.0, "dirty", "room7")))
    world.advance(2 * SECOND)
    text = printed(ward_text(world.ward, world.state()))
    assert text.startswith("51 rooms: 50 disinfected, 1 infected: room")
    assert "not fit: room7" in text
    assert "battery low: uvdrobot2" in text


def test_run_is_shown_with_failures_new_plan_and_table():
    lines = shown(paper_run(100.0).messages).splitlines()
    assert any("✗ a_patrol_room(spotrobot1, room1)" in line for line in lines)
    assert any("✚ a_adapt_room(nurse_disinfected1, room1)" in line for line in lines)
    mission = next(line for line in reversed(lines) if line.startswith("1 ")).split()
    assert mission == ["1", "room1", "9", "13", "1", "dirty", "room", "yes", "finished", "3.50", "s"]


def test_number_of_printed_trees_is_limited():
    records = [made_at(0.0, PLANNED)]
    for number in range(TREES):
        records += [given_up_at(1.0 + number, PLANNED), made_at(1.5 + number, MENDED)]
    lines = shown(records).splitlines()
    assert sum("m_clean(room1)" in line for line in lines) == TREES
    assert sum("more trees" in line for line in lines) == 1
