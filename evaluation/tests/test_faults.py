from __future__ import annotations

import json
import math
import os
import random
import shutil
import struct
import subprocess
import sys
from collections import Counter
from pathlib import Path

import msgspec
import psutil
import pytest

from evaluation.faults import ROWS, Row, chosen, main, try_all
from evaluation.faults_clocks import CLOCK_VARIABLE, build_library, set_clock
from evaluation.faults_flood import Decision, rate_hz, recovered_s
from evaluation.faults_network import frames, highest, overheads_ms
from evaluation.faults_outage import after_s, is_centred
from evaluation.faults_plan import Plan, Skipped, busy_processes
from evaluation.faults_power import DETECTIONS, missing, read, whole_lines
from evaluation.faults_rtps import _longest
from evaluation.faults_strangers import Effects, Stranger, refusals, say, with_keys
from evaluation.faults_watch import DIAGNOSTICS, Heard, heard, stamp_of
from evaluation.report import Report
from evaluation.rtps_attack import ATTACKS, HEADER, ports
from socialbot.bags.writer import BagWriter
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.keys import load_keys, new_key
from socialbot.bridge.security import REASONS, Seal, SealError
from socialbot.core.clock import SECOND
from socialbot.core.errors import NodeError, ParameterError
from socialbot.core.messages import PersonDetections, SpeechStatus
from socialbot.runs.record import RunRecord
from tests.system.running import eventually, next_line


def meets(report, plan):
    report.add("meets_s", "time", 1.0, 2.0)
    return "1 s"


def misses(report, plan):
    report.add("misses_s", "time", 3.0, plan.of(1.0, 2.0))
    return "3 s"


def cannot(report, plan):
    raise Skipped("no right")


def breaks(report, plan):
    raise NodeError("it has ended", where="robot")


@pytest.fixture
def tried(tmp_path):
    report, told = Report("faults", quick=True), []
    rows = {name: Row(f"{__name__}:{name}", f"fault {name}", "within 2 s") for name in ("meets", "misses")}
    rows |= {name: Row(f"{__name__}:{name}", f"fault {name}", "nothing") for name in ("cannot", "breaks")}
    try_all(rows, report, Plan(tmp_path, 51, told.append, quick=True))
    return report, told


def test_a_row_is_met_when_all_of_its_figures_are_and_one_that_breaks_ends_no_other(tried):
    report, told = tried
    table = report.tables["faults"]
    assert [row["met"] for row in table.values()] == [True, False, None, False]
    assert table["fault cannot"]["measured"] == "skipped: no right"
    assert table["fault breaks"]["measured"] == "came to nothing: robot: it has ended"
    assert report.unmet == ["misses_s", "breaks_tried"]
    assert told[0] == "meets: fault meets"
    assert told[3].startswith("misses: 3 s (NOT met, ")


def test_rows_keep_their_order_and_unknown_ones_are_refused():
    assert chosen("") == list(ROWS)
    assert chosen("outage, clear") == ["clear", "outage"]
    with pytest.raises(ParameterError, match="no row 'loss'"):
        chosen("loss")


def test_the_command_writes_the_table_and_ends_with_1_when_something_is_missed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("evaluation.faults.ROWS", {"misses": Row(f"{__name__}:misses", "a fault", "within 1 s")})
    with pytest.raises(SystemExit) as ended:
        main(only="", quick=False, domain=51, json=tmp_path / "figures.json", out=tmp_path)
    assert ended.value.code == 1
    assert json.loads((tmp_path / "figures.json").read_text("utf-8"))["faults"]["a fault"]["met"] is False
    assert "within 1 s" in capsys.readouterr().out


WITHOUT_VOICE = """
import runpy, sys
sys.modules["espeakng_loader"] = None
sys.argv[1:] = ["--quick", "--only", sys.argv[1], "--out", sys.argv[2]]
runpy.run_module("evaluation.faults", run_name="__main__")
"""


def test_rows_with_speech_say_at_once_that_the_voice_is_missing(tmp_path):
    command = [sys.executable, "-c", WITHOUT_VOICE, "packets,clear", str(tmp_path / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stdout) == (5, "")
    assert "espeak-ng is not installed" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_rows_have_records_of_their_own(tmp_path):
    plan = Plan(tmp_path, 51, print)
    assert plan.records("clear").is_dir()
    with pytest.raises(FileExistsError):
        plan.records("clear")


def test_busy_processes_use_the_processor_until_the_end():
    with busy_processes(2) as pids:
        assert eventually(lambda: all(psutil.Process(pid).cpu_times().user > 0.1 for pid in pids))
    assert not [pid for pid in pids if psutil.pid_exists(pid)]


ASK = "import datetime as d, sys, time as t\nfor line in sys.stdin: print(t.time_ns(), int(t.time()), t.monotonic_ns())"


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_library_changes_only_clocks_that_can_be_set(tmp_path: Path) -> None:
    clock = tmp_path / "clock"
    set_clock(clock, 0)
    variables = {**os.environ, "LD_PRELOAD": str(build_library(tmp_path)), CLOCK_VARIABLE: str(clock)}
    with subprocess.Popen(
        [sys.executable, "-uc", ASK], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=variables
    ) as other:
        assert other.stdin is not None
        told = []
        for ahead_s in (0, -3600, 86400, 0):
            set_clock(clock, ahead_s)
            other.stdin.write("\n")
            other.stdin.flush()
            told.append([int(word) for word in next_line(other).split()])
        other.stdin.close()
    begun = told[0]
    for ahead_s, (precise, coarse, steady) in zip((0, -3600, 86400, 0), told, strict=True):
        passed = steady - begun[2]
        assert 0 <= passed < 30 * 10**9
        assert abs(precise - begun[0] - passed - ahead_s * 10**9) < 10**8
        assert abs(coarse - begun[1] - ahead_s) <= 30


WAIT = """
import ctypes, time
libc = ctypes.CDLL(None)
free, until = ctypes.create_string_buffer(64), (ctypes.c_long * 2)(int(time.time()) + 2, 0)
libc.sem_init(free, 0, 0)
begun = time.monotonic()
libc.sem_timedwait(free, until)
print(time.monotonic() - begun)
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize("ahead_s", [-86400, 86400])
def test_who_waits_until_a_time_of_day_waits_by_the_changed_clock(tmp_path: Path, ahead_s: int) -> None:
    """Threads of DDS wait so for shared memory; they would spin, or sleep for a day."""
    clock = tmp_path / "clock"
    set_clock(clock, ahead_s)
    variables = {**os.environ, "LD_PRELOAD": str(build_library(tmp_path)), CLOCK_VARIABLE: str(clock)}
    waited = subprocess.run([sys.executable, "-c", WAIT], env=variables, capture_output=True, text=True, check=True)
    assert float(waited.stdout) > 0.5


def seen(stamp: int) -> PersonDetections:
    return PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=())


def test_messages_up_to_a_second_before_the_cut_must_exist():
    heard = [(1 * SECOND, 10), (2 * SECOND, 20), (3 * SECOND, 30)]
    assert missing(heard, frozenset({10, 20}), 3 * SECOND) == 0
    assert missing(heard, frozenset({10}), 3 * SECOND) == 1
    assert missing(heard, frozenset(), 5 * SECOND) == 3


def test_a_recording_is_read_up_to_where_it_breaks_off(tmp_path: Path):
    with BagWriter(tmp_path / "bag") as bag, RunRecord(tmp_path / "run") as record:
        for stamp in (1, 2, 3):
            bag.write(DETECTIONS, seen(stamp), stamp * SECOND)
            record.observe(DETECTIONS, seen(stamp))
        trace = tmp_path / "run" / "trace.jsonl"
        trace.write_bytes(trace.read_bytes()[:-5])
    kept = read(tmp_path / "bag", trace)
    assert (kept.in_bag, kept.in_trace, kept.bag_until) == ({1, 2, 3}, {1, 2}, 3 * SECOND)


def test_a_trace_that_is_damaged_elsewhere_is_no_record(tmp_path: Path):
    (tmp_path / "trace.jsonl").write_text("{broken\n")
    with pytest.raises(msgspec.MsgspecError):
        whole_lines(tmp_path / "trace.jsonl")


class TestFlood:
    """Decisions at 5 a second, of which most are missing from 10 to 26 s."""

    DECISIONS = tuple(
        Decision(number / 5, 0.1) for number in range(300) if not 10.0 <= number / 5 < 26.0 or number % 5 == 0
    )

    def test_counts_the_decisions_of_a_time(self):
        assert rate_hz(self.DECISIONS, 0.0, 10.0) == 5.0
        assert rate_hz(self.DECISIONS, 10.0, 20.0) == 1.0

    def test_the_graph_is_itself_again_when_a_whole_step_has_the_usual_rate(self):
        assert recovered_s(self.DECISIONS, 20.0, 50.0, 5.0) == pytest.approx(26.0 - 20.0, abs=0.8)
        assert recovered_s(self.DECISIONS, 30.0, 50.0, 5.0) == 0.0
        assert recovered_s(self.DECISIONS, 20.0, 28.0, 5.0) == math.inf


KNOWN = bytes(range(16))


@pytest.mark.parametrize("name", ATTACKS)
def test_packets_are_those_of_the_seed_and_fit_into_one_frame(name):
    first, again = ([ATTACKS[name](random.Random(seed), KNOWN) for seed in range(200)] for _ in range(2))
    assert first == again
    assert len(set(first)) > 150
    assert max(map(len, first)) <= 1500
    assert name == "noise" or all(packet.startswith(HEADER) for packet in first)


def test_false_messages_have_the_id_of_the_publisher():
    for name in ("heartbeats", "gaps", "endless_gap"):
        packet = ATTACKS[name](random.Random(1), KNOWN)
        assert packet[8:20] == KNOWN[:12]
        assert packet[28:32] == KNOWN[12:]
        assert len(packet) == 24 + int.from_bytes(packet[22:24], "little")


def test_ports_are_those_of_the_domain():
    assert ports(43)[:3] == [18150, 18160, 18161]


def test_the_longest_gap_includes_both_ends():
    assert _longest([0.0, 1.5, 2.0, 9.0], 1.0, 5.0) == 3.0
    assert _longest([], 1.0, 5.0) == 4.0


MS = 1_000_000


def at(time, stamp=0, **said):
    return Heard(time, "/topic", stamp, said)


def test_frames_are_paired_by_stamp_within_the_time_of_the_test():
    taken = [at(0, stamp) for stamp in (5, 10, 20, 30, 40)]
    came = [at(stamp + 3 * MS, stamp) for stamp in (5, 10, 30, 40)] + [at(99 * MS, 30)]
    found = frames(taken, came, 10, 40)
    assert found.taken == (10, 20, 30)
    assert found.came == {10: 10 + 3 * MS, 30: 30 + 3 * MS}, "of two arrivals the first counts"
    assert found.arrived == 2
    assert found.lost_share == pytest.approx(1 / 3)
    assert found.ages_ms() == [3.0, 3.0]


def test_a_time_without_frames_counts_as_lost():
    assert frames([], [], 0, 1).lost_share == 1.0


def test_the_time_at_the_detector_is_none_of_the_overhead():
    there, seen, acted = {0: 10 * MS, 1: 10 * MS}, {0: 70 * MS}, {0: 85 * MS, 1: 99 * MS}
    assert overheads_ms(acted, there, seen) == [25.0], "of a frame that nobody looked at nothing is known"


def test_the_maximum_over_the_time_counts():
    told = [
        Heard(time, DIAGNOSTICS, 0, {"node": "camera", "publish_max_ms": most})
        for time, most in ((1, "90.0"), (5, "2.5"), (6, "3.5"), (9, "80.0"))
    ]
    told.append(Heard(5, DIAGNOSTICS, 0, {"node": "dead", "state": "waiting"}))
    assert highest(told, "publish_max_ms", 5, 9) == {"camera": 3.5}


def test_the_first_after_a_moment_counts():
    assert after_s([at(SECOND), at(4 * SECOND), at(3 * SECOND)], 2 * SECOND) == 1.0
    assert after_s([at(SECOND)], 2 * SECOND) is None


def test_a_head_that_looks_straight_on_is_centred():
    assert is_centred(at(0, positions=(0.0, -0.004)))
    assert not is_centred(at(0, positions=(0.0, 0.03)))


@pytest.mark.parametrize(("mark", "order"), [(1, "<"), (0, ">")])
def test_the_stamp_is_read_from_the_bytes_of_a_picture(mark, order):
    data = bytes([0, mark, 0, 0]) + struct.pack(f"{order}iI", 1_763_760_000, 7) + b"more"
    assert stamp_of(data) == 1_763_760_000 * SECOND + 7


def test_a_line_that_is_still_being_written_is_left_out(tmp_path):
    file = tmp_path / "heard.jsonl"
    assert list(heard(file)) == []
    file.write_text(json.dumps({"at": 1, "topic": "/a", "stamp": 2, "said": {"x": 3}}) + '\n{"at": 4')
    assert list(heard(file)) == [Heard(1, "/a", 2, {"x": 3})]


REALM, TOPIC = "ROS domain 7", "/speech/say"


@pytest.mark.parametrize("reason", REASONS)
def test_a_real_receiver_refuses_each_attack_for_its_stated_reason(tmp_path: Path, reason: str):
    new_key("robot", tmp_path)
    keys = load_keys(tmp_path)
    seal = Seal(keys, realm=REALM, window_s=5.0)
    opener, genuine = seal.opener(TOPIC), seal.stream(TOPIC).seal('"genuine"')
    assert opener.open(genuine) == '"genuine"'
    attack = Stranger(TOPIC, REALM, keys, genuine, '"strange"').attacks()[reason]
    for number in range(4):
        with pytest.raises(SealError) as error:
            opener.open(attack(number))
        assert error.value.reason == reason


def test_refusals_of_all_nodes_are_added_up():
    latest = {"a": {"refusals": "3 forged, 1 unknown sender"}, "b": {"refusals": "2 forged"}, "c": {"refusals": ""}}
    assert refusals(latest) == Counter({"forged": 5, "unknown sender": 1})


def test_there_is_something_to_say_on_each_topic():
    assert list(say("friend")) == list(say("strange"))
    assert all(say("friend")[topic] != message for topic, message in say("strange").items())


def test_effects_are_counted_by_their_text():
    effects = Effects()
    for _ in range(2):
        effects.note("/speech/status", SpeechStatus(stamp=1, utterance_id="u", state="started", text="friend"))
    assert effects.seen == {("/speech/status", "started friend"): 2}
    assert effects.told() == {"/speech/status"}


def test_keys_are_set_for_as_long_as_the_block_lasts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(KEYS_VARIABLE, raising=False)
    new_key("robot", tmp_path)
    with with_keys(tmp_path) as keys:
        assert keys.name == "robot"
    assert KEYS_VARIABLE not in os.environ
