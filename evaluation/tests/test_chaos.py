from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import pytest
from psutil import process_iter

from evaluation import chaos, chaos_checks
from evaluation.chaos import VIOLATION_EXIT, _end
from evaluation.chaos_checks import Check, FairClock, Subject, orphans, waited_s
from evaluation.chaos_faults import FAULTS, Fault, Site, cause
from evaluation.faults_plan import busy_processes
from socialbot.bridge.environment import own_domain
from socialbot.bridge.shared_memory import stale_locks
from socialbot.core.errors import ParameterError
from tests.system.running import eventually, next_line


@pytest.fixture
def subject(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A process in the place of ``up``, whose nodes are all well."""
    # Other runs on this machine leave shared memory in /dev/shm.
    monkeypatch.setattr(chaos_checks, "stale_locks", lambda: stale_locks(tmp_path))
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    (tmp_path / "run").mkdir()
    made = Subject("waldo", 71, process, tmp_path, tmp_path, None, has_guard=False)
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
    assert {kind for kind in FAULTS if any(kind in text for text in drawn(1))} >= {
        "kill",
        "pause",
        "clock",
        "memory",
        "guard",
    }


def test_graphs_that_are_well_violate_nothing(subject):
    (subject.disk / "run" / "trace.jsonl").write_bytes(b"")
    assert Check([subject]).after("nothing", 0.0) == []


def test_each_violation_is_found(subject, monkeypatch):
    monkeypatch.setattr(chaos_checks, "RECOVERY_S", 0.1)
    check, now = Check([subject]), time.monotonic()
    (subject.disk / "run" / "trace.jsonl").write_bytes(b"{}\n")
    subject.reported["head"] = (now + 1e6, {"state": "inactive", "pid": "1"})
    subject.greetings = [(now - 2.0, "u3"), (now, "u4")]
    subject.said = {"u1": now - 100.0, "u2": now}
    found = check.after("a test", now)
    assert found[0] == "waldo: not active within 0.1 s after a test: head"
    assert found[1].startswith("waldo: trace.jsonl:1 is no record")
    assert found[2:] == [
        "waldo: two greetings within 2.0 s: u3, u4 after a test",
        "waldo: utterance u1 was neither spoken nor refused after a test",
    ]
    subject.process.kill()
    subject.process.wait()
    assert "waldo: up ended with code -9 after a test" in check.after("a test", now)


OBSERVING = """
import subprocess, sys
from pathlib import Path
from evaluation.chaos_checks import Subject
folder = Path(sys.argv[1])
subject = Subject("waldo", int(sys.argv[2]), subprocess.Popen(["true"]), folder, folder, None, has_guard=False)
with subject.observed():
    print(sum("/dev/shm/fast" in line for line in Path("/proc/self/maps").read_text().splitlines()))
"""


@pytest.mark.ros
def test_the_observer_shares_no_memory_with_graphs_of_other_clocks(tmp_path):
    with own_domain(environment={}) as domain:
        command = [sys.executable, "-c", OBSERVING, str(tmp_path), str(domain)]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["0"]


def test_a_missing_guard_is_found(subject, monkeypatch):
    monkeypatch.setattr(chaos_checks, "RECOVERY_S", 0.1)
    subject.has_guard = True
    assert Check([subject]).after("nothing", 0.0) == ["waldo: not active within 0.1 s after nothing: guard"]


def test_a_process_restarted_without_a_cause_is_found(subject):
    check = Check([subject])
    assert check.after("nothing", 0.0) == []
    subject.reported["head"] = (time.monotonic() + 1e6, {"state": "active", "pid": str(os.getpid())})
    assert check.after("a pause", 0.0, ("waldo", "camera")) == ["waldo: head was restarted without a cause at a pause"]
    subject.reported["head"] = (time.monotonic() + 1e6, {"state": "active", "pid": str(os.getppid())})
    assert check.after("a kill", 0.0, ("waldo", "head")) == []


def test_a_process_without_memory_may_end_during_the_next_fault(subject):
    check = Check([subject])
    pids = iter((os.getpid(), os.getppid()))

    def restart():
        subject.reported["head"] = (time.monotonic() + 1e6, {"state": "active", "pid": str(next(pids))})

    assert check.after("no memory", 0.0, ("waldo", "head")) == []
    restart()
    assert check.after("a pause", 0.0) == []
    restart()
    assert check.after("a pause", 0.0) == ["waldo: head was restarted without a cause at a pause"]


def test_silence_excludes_waiting_for_a_processor(subject, monkeypatch):
    steady_s, stalled_s = 100.0, 7.0
    monkeypatch.setattr(chaos_checks, "FairClock", lambda: FairClock(lambda: steady_s, lambda: stalled_s))
    check = Check([subject])
    steady_s, stalled_s = steady_s + 200.0, stalled_s + 30.0
    assert check.after("a load", 0.0) == []
    steady_s += 20.0
    assert check.after("a kill", 0.0) == ["waldo: no greeting was heard for 190 s after a kill"]
    subject.greeted = time.monotonic()
    assert check.after("a greeting", 0.0) == []
    steady_s += 181.0
    assert check.after("nothing", 0.0) == ["waldo: no greeting was heard for 181 s after nothing"]


def test_a_limit_counts_time_without_waiting_for_a_processor():
    steady_s, stalled_s = 100.0, 7.0
    clock = FairClock(lambda: steady_s, lambda: stalled_s)
    steady_s += 10.0
    assert clock.tick() == 10.0
    steady_s, stalled_s = steady_s + 10.0, stalled_s + 4.0
    assert clock.tick() == 16.0
    steady_s, stalled_s = steady_s + 10.0, stalled_s + 10.0
    assert clock.tick() == 17.0, "a tenth counts on the busiest machine, so that the limit comes"


@pytest.mark.skipif(not chaos_checks.PRESSURE.exists(), reason="Linux measures no pressure here")
def test_waiting_for_a_processor_is_read():
    before = waited_s()
    with busy_processes(2 * (os.cpu_count() or 1)):
        assert eventually(lambda: waited_s() > before + 0.05)


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("import signal; signal.signal(signal.SIGTERM, lambda *_: exit(0))", []),
        ("import signal; signal.signal(signal.SIGTERM, lambda *_: exit(7))", ["up ended with code 7"]),
        ("import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)", ["up did not end within 0.1 s"]),
    ],
)
def test_the_end_of_up_is_checked(program, expected, monkeypatch):
    monkeypatch.setattr(chaos, "END_S", 60.0 if not expected or "code" in expected[0] else 0.0)
    monkeypatch.setattr(chaos, "LATE_S", 0.1)
    code = f"{program}; print(flush=True); import time; time.sleep(600)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
        assert next_line(process) == "\n"
        assert list(_end(process)) == expected


def test_a_node_gets_no_more_memory_for_a_while(subject):
    """It has its memory again afterwards."""
    code = """
taken = []
while True:
    input()
    try:
        taken.append(bytearray(b"x" * 50_000_000))
        print("taken", flush=True)
    except MemoryError:
        print("refused", flush=True)
"""
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as one:
        assert one.stdin is not None

        def ask() -> str:
            assert one.stdin is not None
            one.stdin.write("\n")
            one.stdin.flush()
            return next_line(one)

        assert ask() == "taken\n"
        subject.reported["head"] = (time.monotonic(), {"state": "active", "pid": str(one.pid)})
        fault = Thread(target=cause, args=(Fault("memory", subject, "head", 0, 5.0), Site([subject], isolated=False)))
        before = resource.prlimit(one.pid, resource.RLIMIT_DATA)
        fault.start()
        assert eventually(lambda: resource.prlimit(one.pid, resource.RLIMIT_DATA) != before)
        assert ask() == "refused\n"
        fault.join()
        assert ask() == "taken\n"
        one.kill()


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


def test_a_folder_of_other_records_is_refused(tmp_path: Path):
    with pytest.raises(ParameterError, match=f"{tmp_path} exists already"):
        chaos.main(out=tmp_path)


@pytest.mark.ros
@pytest.mark.skipif(os.geteuid() != 0, reason="namespaces need root")
@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_all_processes(ending, tmp_path: Path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "evaluation.chaos", "--only", "warehouse", "--out", out]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        assert eventually(out.exists)  # by a process in the namespaces
        process.send_signal(ending)
        assert process.wait() == 128 + signal.SIGKILL
    assert eventually(
        lambda: not any(str(out) in " ".join(each.info["cmdline"] or ()) for each in process_iter(["cmdline"]))
    )


@pytest.mark.slow
@pytest.mark.ros
def test_some_faults_of_the_warehouse(tmp_path: Path):
    command = [sys.executable, "-m", "evaluation.chaos", "--hours", "0.01", "--seed", "3", "--only", "warehouse"]
    done = subprocess.run([*command, "--out", tmp_path / "chaos"], capture_output=True, text=True, env={**os.environ})
    assert done.returncode != VIOLATION_EXIT, done.stdout
    events = [json.loads(line) for line in (tmp_path / "chaos" / "events.jsonl").read_text().splitlines()]
    assert events
    assert [event["violations"] for event in events if event["violations"]] == []
