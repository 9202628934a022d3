"""Status of nodes from their own reports."""

from __future__ import annotations

import io
import json

import pytest
from rich.console import Console

from socialbot.bridge import shared_memory
from socialbot.cli._runs import print_json
from socialbot.cli.status import Screen, as_data, in_short, in_the_middle, page
from socialbot.core.messages import Health, State
from socialbot.graph.status import NodeStatuses, Spread, all_well, printable

TOLD = {
    "machine": "robot", "state": "active", "restarts": "0", "last_error": "", "calls": "30", "failures": "0",
    "refused": "0", "refusals": "", "first_failure": "", "call_mean_ms": "1.5", "call_p99_ms": "3.25",
    "age_mean_ms": "20.0", "age_p99_ms": "45.0", "call_hz": "10.0", "publish_hz": "30.1", "cpu_percent": "12.5",
    "rss_mb": "101.5", "pid": "77", "unconnected": "",
}  # fmt: skip


def health(node, state: State = "ok", reason="", silent=()):
    return Health(stamp=1, node=node, state=state, reason=reason, silent=silent)


@pytest.fixture
def roll():
    roll = NodeStatuses({"camera": "robot", "detector": "workstation"})
    roll.note("camera", TOLD, 10.0)
    roll.note_health(health("camera"), 10.0)
    roll.note("detector", TOLD | {"machine": "workstation", "pid": "78"}, 10.0)
    roll.note_health(health("detector"), 10.0)
    return roll


def conditions(roll, now):
    return [one.condition for one in roll.statuses(now)]


def shown(statuses):
    written = io.StringIO()
    Console(file=written, width=200).print(page(statuses))
    return written.getvalue()


def test_the_status_of_a_node_is_its_own_report(roll):
    camera = roll.statuses(10.5)[0]
    assert (camera.name, camera.machine, camera.condition, camera.heard_s) == ("camera", "robot", "active", 0.5)
    assert (camera.handled_hz, camera.published_hz, camera.cpu_percent, camera.memory_mb) == (10.0, 30.1, 12.5, 101.5)
    assert (camera.call, camera.age) == (Spread(1.5, 3.25), Spread(20.0, 45.0))
    assert all_well(roll.statuses(10.5))


def test_a_node_without_messages_is_missing():
    roll = NodeStatuses({"camera": "robot"})
    assert not roll.complete
    assert conditions(roll, 5.0) == ["no messages"]
    assert roll.statuses(5.0)[0].machine == "robot"


def test_a_silent_node_is_shown_with_its_silence(roll):
    roll.note("camera", TOLD, 20.0)
    roll.note_health(health("camera"), 20.0)
    assert conditions(roll, 22.0) == ["active", "no messages for 12 s"]
    assert not all_well(roll.statuses(22.0))


def test_figures_of_a_silent_node_are_hidden(roll):
    camera = roll.statuses(20.0)[0]
    assert (camera.handled_hz, camera.call, camera.memory_mb, camera.state) == (None, None, None, "active")


def test_an_active_node_without_heartbeat_hangs(roll):
    for second in range(11, 16):
        roll.note("camera", TOLD, float(second))
        roll.note_health(health("camera"), float(second))
        roll.note("detector", TOLD, float(second))
    assert conditions(roll, 15.5) == ["active", "no heartbeat"]


def test_where_no_health_can_be_heard_no_sign_of_life_is_expected():
    roll = NodeStatuses({"camera": "robot"})
    for second in range(6):
        roll.note("camera", TOLD, float(second))
    assert conditions(roll, 5.5) == ["active"]


@pytest.mark.parametrize("state", ["inactive", "waiting", "given up", "ended"])
def test_states_other_than_active_are_not_well(roll, state):
    roll.note("detector", {"machine": "workstation", "state": state, "restarts": "5", "last_error": "was ended"}, 11.0)
    detector = roll.statuses(11.0)[1]
    assert (detector.condition, detector.restarts, detector.last_error) == (state, 5, "was ended")
    assert not detector.is_well


@pytest.mark.parametrize(
    ("state", "condition"),
    [("ok", "active"), ("ended", "active"), ("failed", "failed"), ("degraded", "input silent"), ("paused", "paused")],
)
def test_the_reported_health_of_a_node_counts(roll, state, condition):
    roll.note_health(health("detector", state, "no message on /image", ("/image",)), 11.0)
    detector = roll.statuses(11.0)[1]
    assert (detector.condition, detector.reason, detector.silent) == (condition, "no message on /image", ("/image",))


def test_a_fault_that_is_no_silent_input_is_shown_as_such(roll):
    roll.note_health(health("detector", "degraded", "the lens is dirty"), 11.0)
    assert roll.statuses(11.0)[1].condition == "degraded"


def test_a_paused_node_is_shown_as_paused_and_well(roll):
    roll.note_health(health("detector", "paused", "paused by a person"), 10.5)
    statuses = roll.statuses(10.5)
    assert all_well(statuses)
    text = shown(statuses)
    assert "paused" in text.splitlines()[2].split()
    assert "detector: paused by a person" in text
    assert "all 2 nodes are well" in text
    roll.note_health(health("detector", "degraded", "paused by a person; no message on /image", ("/image",)), 10.6)
    assert not all_well(roll.statuses(10.6))


def test_it_is_complete_when_everybody_was_heard_with_health():
    roll = NodeStatuses({"camera": "robot"})
    roll.note("camera", TOLD, 1.0)
    assert not roll.complete
    roll.note_health(health("camera"), 1.1)
    assert roll.complete


def test_without_expectations_all_nodes_are_shown_by_machine_but_no_drivers():
    roll = NodeStatuses()
    roll.note("speech", TOLD | {"machine": "b"}, 1.0)
    roll.note("head", TOLD | {"machine": "b"}, 1.0)
    roll.note("mind", TOLD | {"machine": "a"}, 1.0)
    roll.note("battery", {"voltage": "11.9"}, 1.0)
    roll.note_health(health("player"), 1.0)
    assert [one.name for one in roll.statuses(1.0)] == ["mind", "head", "speech"]
    assert not all_well(NodeStatuses().statuses(1.0))


def test_two_nodes_of_one_name_are_reported(roll):
    for tenth in range(101, 106):
        roll.note("camera", TOLD | {"pid": "99" if tenth % 2 else "77"}, tenth / 10)
    camera = roll.statuses(10.6)[0]
    assert camera.condition == "duplicate name"
    assert not camera.is_well
    assert "camera: another node has this name: process 77 on robot" in shown(roll.statuses(10.6))
    for second in range(11, 15):
        roll.note("camera", TOLD, float(second))
        roll.note_health(health("camera"), float(second))
    assert roll.statuses(14.5)[0].condition == "active"


def test_a_restarted_node_is_not_a_second_node(roll):
    for second, pid in enumerate(("77", "77", "99", "99", "55", "55"), 11):
        roll.note("camera", TOLD | {"pid": pid}, float(second))
        roll.note_health(health("camera"), float(second))
        assert roll.statuses(float(second))[0].condition == "active"


def test_unknown_nodes_are_ignored_if_the_expected_nodes_are_known(roll):
    roll.note("intruder", TOLD, 10.0)
    assert len(roll.statuses(10.0)) == 2


def test_figures_that_are_none_are_left_out(roll):
    roll.note("camera", TOLD | {"cpu_percent": "much", "rss_mb": "nan", "restarts": "-", "age_p99_ms": "0"}, 10.0)
    camera = roll.statuses(10.0)[0]
    assert (camera.cpu_percent, camera.memory_mb, camera.restarts, camera.age) == (None, None, 0, None)


def test_control_characters_from_the_network_are_removed():
    assert printable("a\x1b[2Jb\nc\u202e") == "a?[2Jb c?"
    assert len(printable("a" * 10_000)) == 500


def test_the_table_lists_nodes_and_faults_below(roll):
    roll.note(
        "camera",
        TOLD | {"refused": "3", "refusals": "3 forged", "restarts": "2", "last_error": "hung", "dropped": "79 said"},
        20.0,
    )
    roll.note_health(health("camera", "failed", "no device"), 20.0)
    text = shown(roll.statuses(20.0))
    lines = text.splitlines()
    headings = "node machine state in Hz out Hz call ms age ms CPU % MB restarts refused"
    assert " ".join(lines[0].split()) == headings
    assert " ".join(lines[1].split()) == "camera robot failed 10 30 1.5/3.2 20/45 12 102 2 3"
    assert " ".join(lines[2].split()) == "detector workstation no messages for 10 s"
    assert "camera: its process hung; restarted 2 times" in lines
    assert "camera: no device" in lines
    assert "camera: refused 3 forged" in lines
    assert "camera: too slow for its inputs, and dropped messages: 79 said" in lines
    assert lines[-1] == "0 of 2 nodes are well"


def test_nodes_of_one_process_show_its_costs_once():
    roll = NodeStatuses()
    for name in ("ear", "mouth"):
        roll.note(name, TOLD, 1.0)
        roll.note_health(health(name), 1.0)
    statuses = roll.statuses(1.0)
    assert [one.shares for one in statuses] == [("mouth",), ("ear",)]
    lines = shown(statuses).splitlines()
    assert lines[1].split()[-2:] == ["12", "102"]
    assert lines[2].split()[-2:] == ['"', '"']
    assert lines[-1] == "all 2 nodes are well"


def test_a_domain_without_nodes_is_said(monkeypatch):
    assert "no node found in ROS domain" in shown([])
    monkeypatch.setattr(shared_memory, "other_users", lambda domain: ["ann"])
    assert "; ann may run nodes there: only the same user sees them" in shown([])


def test_scripts_get_the_same_as_json(roll, capsys):
    print_json(as_data(roll.statuses(20.0)))
    report = json.loads(capsys.readouterr().out)
    assert (report["schema"], report["version"], report["well"]) == ("socialbot/status", 1, False)
    camera = report["nodes"][0]
    assert (camera["condition"], camera["well"], camera["call"]) == ("no messages for 10 s", False, None)
    print_json(as_data(roll.statuses(10.5)))
    report = json.loads(capsys.readouterr().out)
    assert report["well"]
    assert report["nodes"][0]["call"] == {"mean_ms": 1.5, "p99_ms": 3.25}


def screen_lines(screen, now, statuses, width=100):
    written = io.StringIO()
    Console(file=written, width=width).print(screen.at(now, statuses))
    return written.getvalue().splitlines()


def test_the_screen_shows_the_duration_of_each_state(roll):
    screen = Screen(12.0)
    screen.at(10.5, roll.statuses(10.5))
    for second in range(11, 200):
        roll.note("camera", TOLD, float(second))
        roll.note_health(health("camera"), float(second))
    lines = screen_lines(screen, 200.5, roll.statuses(200.5))
    assert lines[0].startswith("1 of 2 nodes are well ")
    assert lines[2].split()[:4] == ["node", "machine", "state", "for"]
    assert lines[3].split()[:5] == ["camera", "robot", "active", "3", "min"]
    assert lines[4].split() == ["detector", "workstation", "no", "messages", "3", "min"]
    roll.note("detector", TOLD | {"machine": "workstation"}, 201.0)
    roll.note_health(health("detector", "degraded", "no message on /image", ("/image",)), 201.0)
    lines = screen_lines(screen, 201.0, roll.statuses(201.0))
    assert lines[4].split()[1:6] == ["workstation", "input", "silent", "0", "s"]
    assert lines[-1] == "detector: no message on /image"


def test_the_columns_of_the_screen_stay_where_they_are(roll):
    screen = Screen(12.0)
    ends = []
    for number, hz in enumerate(("0.1", "9.9", "30.0", "250.0")):
        roll.note(
            "camera", TOLD | {"call_hz": hz, "publish_hz": hz, "cpu_percent": hz, "rss_mb": hz}, 10.0 + number / 10
        )
        lines = screen_lines(screen, 10.5, roll.statuses(10.5))
        assert max(map(len, lines)) <= 100
        ends.append([len(lines[2]), *(lines[2].index(heading) for heading in ("in Hz", "call ms", "MB"))])
    assert len({tuple(end) for end in ends}) == 1


def test_the_screen_has_a_line_for_each_node_however_long_its_name():
    names = {"camera_image_raw_to_workstation": "workstation", "camera_image_raw_at_workstation": "workstation"}
    roll = NodeStatuses(names)
    for name in names:
        for second in (10.0, 13.0):
            roll.note(name, TOLD | {"call_mean_ms": "2094", "call_p99_ms": "6920", "machine": "workstation"}, second)
        roll.note_health(health(name), 10.0)
    lines = screen_lines(Screen(0.0), 13.0, roll.statuses(13.0))
    assert [line.split()[:4] for line in lines[3:5]] == [
        ["camera_ima…orkstation", "workstation", "no", "heartbeat"],
    ] * 2
    assert max(map(len, lines)) <= 100
    assert "2094/6920" in lines[3]


def test_the_screen_waits_before_it_misses_anybody():
    screen = Screen(12.0)
    assert screen_lines(screen, 11.0, []) == ["listening ..."]
    assert screen_lines(screen, 12.5, [])[0].startswith("no node found in ROS domain")


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.9, "59 s"), (60, "1 min"), (7300, "2 h"), (2e5, "2 d")]
)
def test_times_are_printed_in_their_largest_unit(seconds, text):
    assert in_short(seconds) == text


def test_of_a_long_name_its_ends_are_shown():
    assert in_the_middle("camera", 6) == "camera"
    assert in_the_middle("camera_at_workstation", 10) == "camer…tion"
    assert len(in_the_middle("camera_at_workstation", 11)) == 11
