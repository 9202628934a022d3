"""Runs as tables and as tiers of ELAN."""

from __future__ import annotations

import csv
import json
import os
import resource
import shutil
import subprocess
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import RunError, SocialbotError
from socialbot.core.messages import HeardSpeech, TraceRecord
from socialbot.runs.annotations import COLUMNS, write_csv, write_elan
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.pages import write_file
from socialbot.runs.record import RunTrace
from tests.runs.runs import greeting
from tests.system.running import socialbot_here


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return greeting(tmp_path_factory.mktemp("runs") / "run", tenths=60)


def tiers(path: Path) -> dict[str, list[tuple[int, int, str]]]:
    """Read an ELAN file: tiers with begin and end (ms) and text of their annotations."""
    document = ElementTree.parse(path).getroot()
    slots = {slot.attrib["TIME_SLOT_ID"]: int(slot.attrib["TIME_VALUE"]) for slot in document.iter("TIME_SLOT")}
    types = {each.attrib["LINGUISTIC_TYPE_ID"] for each in document.iter("LINGUISTIC_TYPE")}
    found: dict[str, list[tuple[int, int, str]]] = {}
    for tier in document.iter("TIER"):
        assert tier.attrib["LINGUISTIC_TYPE_REF"] in types
        found[tier.attrib["TIER_ID"]] = [
            (slots[each.attrib["TIME_SLOT_REF1"]], slots[each.attrib["TIME_SLOT_REF2"]], each[0].text or "")
            for each in tier.iter("ALIGNABLE_ANNOTATION")
        ]
    return found


@pytest.mark.parametrize("write", [write_csv, write_elan, lambda run, path: write_file(path, 5000 * "new ")])
def test_a_full_disk_leaves_the_file_of_before(
    write: Callable[[RecordedRun, Path], object], folder: Path, tmp_path: Path
) -> None:
    """Files of a limited size fail as on a full disk."""
    run, path = open_run(folder), tmp_path / "table"
    path.write_text("of before")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(SocialbotError, match="cannot be written"):
            write(run, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_text() == "of before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_table_can_go_to_a_pipe(folder: Path, tmp_path: Path) -> None:
    """Such as /dev/stdout. It stays a pipe."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        write_csv(open_run(folder), pipe)
        assert reader.communicate()[0].startswith(b"time_s,")
    assert pipe.is_fifo()


def test_a_table_has_a_row_per_record(folder: Path, tmp_path: Path):
    run = open_run(folder)
    assert write_csv(run, tmp_path / "run.csv") == len(run.history)
    with (tmp_path / "run.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    assert head == list(COLUMNS)
    assert [(row[6], int(row[1])) for row in rows] == [(record.id, record.stamp) for record in run.history]
    details = [json.loads(row[8]) if row[8] else {} for row in rows]
    assert details == [record.detail for record in run.history]
    assert {one["distance_m"] for each in details for one in each.get("persons", ())} == {4.0}
    (said,) = [row for row in rows if row[4] == "utterance"]
    assert (said[0], said[2], said[5]) == ("0.700", "8", "Hello! Nice to see you.")


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1+1", "@SUM(1)", "\t=1", "\n=1", "\r=1", "\x1b]0;t\x07\ufffe"])
def test_texts_of_strangers_are_neither_formulas_nor_control_characters(folder: Path, tmp_path: Path, text: str):
    copied = shutil.copytree(folder, tmp_path / "run")
    trace = copied / "trace.jsonl"
    records = [msgspec.json.decode(line) for line in trace.read_bytes().splitlines()]
    trace.write_bytes(b"\n".join(msgspec.json.encode({**each, "what": text + each["what"]}) for each in records))
    run = open_run(copied)
    write_csv(run, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(encoding="utf-8", newline="") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert not [cell for cell in cells if cell.startswith(tuple("=+-@\t\r\n")) or "\x1b" in cell]
    assert write_elan(run, tmp_path / "run.eaf")
    assert tiers(tmp_path / "run.eaf")


def test_elan_gets_visitors_speech_beliefs_goals_and_actions(folder: Path, tmp_path: Path):
    count = write_elan(open_run(folder), tmp_path / "run.eaf")
    found = tiers(tmp_path / "run.eaf")
    assert sum(map(len, found.values())) == count
    assert found["visitor t1"] == [(500, 5900, "in time, 4.0 m")]
    assert found["speech"] == [(700, 2420, "Hello! Nice to see you.")]
    assert (700, 2050, 'present("t1")') in found["bdi_engine: beliefs, present"]
    assert [text for _, _, text in found["bdi_engine: actions"]] == ['speak("greeting")', "stayIdle()"]
    assert "GreetPeople()" in [text for _, _, text in found["bdi_engine: goals"]]


def test_elan_gets_what_people_said(tmp_path: Path):
    """From the begin of each sentence, with a tier per person; of others the speaker is not known."""
    with RunTrace(tmp_path / "run") as trace:
        for start, end, text, person in ((1, 3, "Where is the lift?", "p1"), (2, 4, "I think upstairs.", "")):
            heard = HeardSpeech(stamp=end * SECOND, start=start * SECOND, text=text, person=person)
            trace.observe("/humans/voices/speech", heard)
    write_elan(run_of_start(tmp_path / "run", 0), tmp_path / "run.eaf")
    assert tiers(tmp_path / "run.eaf") == {
        "heard from p1": [(1000, 3000, "Where is the lift?")],
        "heard": [(2000, 4000, "I think upstairs.")],
    }


def test_annotations_of_a_tier_do_not_overlap(folder: Path, tmp_path: Path):
    write_elan(open_run(folder), tmp_path / "run.eaf")
    for tier in tiers(tmp_path / "run.eaf").values():
        assert all(begin < end for begin, end, _ in tier)
        assert all(first[1] <= second[0] for first, second in pairwise(tier))


def run_of_start(folder: Path, start: int) -> RecordedRun:
    (folder / "results.json").write_text(json.dumps({"bag": {"path": "none", "start": start}}))
    return open_run(folder)


def run_of(folder: Path, *records: tuple[float, str, str]) -> RecordedRun:
    """Write a run of records of one agent, with time (s), kind and text."""
    folder.mkdir()
    lines = [
        TraceRecord(stamp=round(time_s * SECOND), id=f"r{number}", source="cook", kind=kind, what=what)
        for number, (time_s, kind, what) in enumerate(records)
    ]
    (folder / "trace.jsonl").write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in lines))
    return open_run(folder)


def test_annotations_that_overlap_keep_their_times(tmp_path: Path):
    run = run_of(
        tmp_path / "run",
        *((0, "belief", 'present("a")'), (1, "belief", 'present("b")'), (1, "belief", 'present("c")')),
        *((2, "unbelief", 'present("a")'), (3, "unbelief", 'present("c")'), (3, "belief", 'present("a")')),
        *((4, "action", "wave()"), (4.2, "action", "nod()"), (9, "unbelief", 'present("b")')),
    )
    write_elan(run, tmp_path / "run.eaf")
    assert tiers(tmp_path / "run.eaf") == {
        "cook: beliefs, present": [(0, 2000, 'present("a")'), (3000, 9000, 'present("a")')],
        "cook: beliefs, present (2)": [(1000, 3000, 'present("c")')],
        "cook: beliefs, present (3)": [(1000, 9000, 'present("b")')],
        "cook: actions": [(4000, 4200, "wave()"), (4200, 4700, "nod()")],
    }


def test_thousands_of_beliefs_that_overlap_take_little_time(tmp_path: Path):
    run = run_of(tmp_path / "run", *((1.0 + number / 1000, "belief", f"seen({number})") for number in range(20_000)))
    begin = time.process_time()
    assert write_elan(run, tmp_path / "run.eaf") == 20_000
    assert time.process_time() - begin < 6.0
    assert len(tiers(tmp_path / "run.eaf")) == 19_999  # the last begins when the others end


def test_a_goal_and_a_belief_may_be_called_the_same(tmp_path: Path):
    run = run_of(
        tmp_path / "run",
        *((0, "goal", "tidy"), (2, "belief", "tidy"), (2.5, "achieved", "tidy"), (4, "unbelief", "tidy")),
    )
    write_elan(run, tmp_path / "run.eaf")
    assert tiers(tmp_path / "run.eaf") == {
        "cook: goals": [(0, 2500, "tidy")],
        "cook: beliefs, tidy": [(2000, 4000, "tidy")],
    }


@pytest.mark.parametrize("suffix", [".csv", ".eaf"])
def test_the_command_chooses_the_format_by_the_suffix(folder: Path, tmp_path: Path, suffix: str):
    done = socialbot_here("export", folder, tmp_path / f"run{suffix}")
    assert (done.returncode, (tmp_path / f"run{suffix}").stat().st_size > 500) == (0, True), done.stderr


def test_unusable_files_are_refused(folder: Path, tmp_path: Path):
    with pytest.raises(RunError, match="cannot be written"):
        write_csv(open_run(folder), tmp_path / "missing" / "run.csv")
    done = socialbot_here("export", folder, tmp_path / "run.txt")
    assert (done.returncode, "the suffix names no format" in done.stderr) == (4, True)


def test_labels_of_a_run_are_columns_and_properties(tmp_path: Path):
    labels = ("--label", "participant=P01", "--label", "condition=no greeting")
    done = socialbot_here("demo", "cleaner", "--limit", "1", "--out", tmp_path / "run", *labels)
    assert done.returncode in (0, 10), done.stderr
    run = open_run(tmp_path / "run")
    assert run.results["labels"] == {"participant": "P01", "condition": "no greeting"}
    write_csv(run, tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text("utf-8").splitlines()[0].endswith("cause,detail,participant,condition")
    write_elan(run, tmp_path / "run.eaf")
    properties = ElementTree.parse(tmp_path / "run.eaf").getroot().iter("PROPERTY")
    assert {each.attrib["NAME"]: each.text for each in properties} == run.results["labels"]


@pytest.mark.parametrize("label", ["P01", "=P01", "participant=", "a b=1"])
def test_unusable_labels_are_refused(tmp_path: Path, label: str):
    done = socialbot_here("demo", "cleaner", "--out", tmp_path / "run", "--label", label)
    assert (done.returncode, "is not a label" in done.stderr) == (4, True)
