from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from evaluation import chaos_checks
from evaluation.chaos import FAULTS, VIOLATION_EXIT, Fault
from evaluation.chaos_checks import Check, Subject, orphans
from tests.system.running import eventually


@pytest.fixture
def subject(tmp_path: Path):
    """A process in the place of ``up``, whose nodes are all well."""
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    (tmp_path / "run").mkdir()
    made = Subject("waldo", 71, process, tmp_path, tmp_path, None)
    values = {"state": "active", "pid": str(process.pid)}
    made.reported = {node: (time.monotonic() + 1e6, values) for node in made.nodes}
    yield made
    process.kill()
    process.wait()


def test_a_seed_draws_the_same_faults(subject):
    def drawn(seed: int) -> list[str]:
        chance = random.Random(seed)
        return [str(Fault.drawn(list(FAULTS), [subject], chance)) for _ in range(200)]

    assert drawn(1) == drawn(1) != drawn(2)
    assert {kind for kind in FAULTS if any(kind in text for text in drawn(1))} >= {"kill", "pause", "clock"}


def test_graphs_that_are_well_violate_nothing(subject):
    (subject.disk / "run" / "trace.jsonl").write_bytes(b"")
    assert Check([subject]).after("nothing", 0.0) == []


def test_each_violation_is_found(subject, monkeypatch):
    monkeypatch.setattr(chaos_checks, "RECOVERY_S", 0.1)
    check, now = Check([subject]), time.monotonic()
    (subject.disk / "run" / "trace.jsonl").write_bytes(b"{}\n")
    subject.reported["head"] = (now + 1e6, {"state": "inactive", "pid": "1"})
    subject.greetings = [now - 2.0, now]
    subject.said = {"u1": now - 100.0, "u2": now}
    found = check.after("a test", now)
    assert found[0] == "waldo: not active within 0.1 s after a test: head"
    assert found[1].startswith("waldo: trace.jsonl:1 is no record")
    assert found[2:] == [
        "waldo: two greetings within 2.0 s after a test",
        "waldo: utterance u1 was neither spoken nor refused after a test",
    ]
    subject.process.kill()
    subject.process.wait()
    assert "waldo: up ended with code -9 after a test" in check.after("a test", now)


def test_a_process_that_outlives_its_graph_is_an_orphan(subject):
    code = "import time; time.sleep(60)"
    orphan = subprocess.Popen([sys.executable, "-c", code, str(subject.folder)])
    try:
        assert eventually(lambda: str(orphan.pid) in " ".join(orphans([subject])))
    finally:
        orphan.kill()
        orphan.wait()


def test_memory_that_grows_is_found(subject, monkeypatch):
    monkeypatch.setattr(chaos_checks, "SETTLED_S", 0.0)
    check = Check([subject])
    assert check.after("nothing", 0.0) == check.after("nothing", 0.0) == []
    monkeypatch.setattr(chaos_checks, "GROWTH_MB", -1e6)
    assert "grew from" in check.after("nothing", 0.0)[0]


@pytest.mark.slow
@pytest.mark.ros
def test_some_faults_of_the_warehouse(tmp_path: Path):
    command = [sys.executable, "-m", "evaluation.chaos", "--hours", "0.01", "--seed", "3", "--only", "warehouse"]
    done = subprocess.run([*command, "--out", tmp_path / "chaos"], capture_output=True, text=True, env={**os.environ})
    assert done.returncode != VIOLATION_EXIT, done.stdout
    events = [json.loads(line) for line in (tmp_path / "chaos" / "events.jsonl").read_text().splitlines()]
    assert events
    assert [event["violations"] for event in events if event["violations"]] == []
