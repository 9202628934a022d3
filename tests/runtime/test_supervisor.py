"""Restarts of crashed and hung processes. Small scripts stand in for processes of nodes, which start slowly."""

from __future__ import annotations

import logging
import os
import re
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partialmethod
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

from socialbot.bridge import shared_memory
from socialbot.bridge.process import CHANNEL_VARIABLE
from socialbot.bridge.shared_memory import PortWatch
from socialbot.core.errors import NodeError, SocialbotError
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.runtime import _lost_publishers, _processes, launch
from socialbot.runtime._processes import STARVED_LIMITS, ProcessorWaits, RestartPolicy
from socialbot.runtime.fork_server import PR_SET_NAME, ForkServer
from socialbot.runtime.launch import ABSENT_S, RESTARTS_VARIABLE, Supervisor
from tests.system.running import PATIENCE_S

pytestmark = pytest.mark.ros

WELL = """
while True:
    say("active")
    time.sleep(0.05)
"""
POLICY = RestartPolicy(times=2, first_s=0.01, longest_s=0.05, hung_s=60.0, ready_s=60.0)
IMPATIENT = replace(POLICY, hung_s=0.5)  # a busy machine may make a process look hung
SPEAKING = f"""
import os, socket, sys, time
line = socket.socket(fileno=int(os.environ["{CHANNEL_VARIABLE}"]))
def say(word): line.send(f"{{sys.argv[1]}} {{word}}".encode())
"""


class Idle(Node):
    """Does nothing."""


GRAPH = Graph("idlers", (NodeConfig("one", Idle), NodeConfig("two", Idle)))


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Scripts of the processes by node name; the default is `WELL`."""
    bodies: dict[str, str] = {}

    def start(_: ForkServer, arguments: list[str], log: Path, *, variables: dict[str, str], channel: int) -> Any:
        name = arguments[-1]
        with log.open("ab") as output:
            return subprocess.Popen(
                [sys.executable, "-S", "-c", SPEAKING + bodies.get(name, WELL), name],
                env={**os.environ, **variables, CHANNEL_VARIABLE: str(channel)},
                stdout=output,
                stderr=output,
                pass_fds=(channel,),
            )

    monkeypatch.setattr(ForkServer, "start", start)
    return bodies


@pytest.fixture
def memory_group() -> Iterator[Path]:
    """File that takes the processes of a cgroup with 50 MB of memory. Skips the test where none can be made."""
    root = Path("/sys/fs/cgroup/memory" if Path("/sys/fs/cgroup/memory").exists() else "/sys/fs/cgroup")
    group = root / f"socialbot-test-{os.getpid()}"
    try:
        group.mkdir()
    except OSError as error:
        pytest.skip(f"no cgroup: {error.strerror}")
    try:
        limit = next(
            (file for name in ("memory.limit_in_bytes", "memory.max") if (file := group / name).exists()), None
        )
        if limit is None:
            pytest.skip("no cgroup with a limit of memory")
        limit.write_text("50000000")
        yield group / "cgroup.procs"
    finally:
        group.rmdir()


def attended(supervisor: Supervisor, until: Callable[[], bool], timeout_s: float = PATIENCE_S) -> bool:
    deadline = monotonic() + timeout_s
    while not until():
        if monotonic() > deadline:
            return False
        supervisor.attend(0.02)
    return True


def test_restarts_a_killed_process_alone(
    scripts: dict[str, str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == two.state == "active")
        before = supervisor.pids
        os.kill(before["one"], signal.SIGKILL)
        assert attended(supervisor, lambda: one.restarts == 1)
        assert attended(supervisor, lambda: one.state == "active")
        assert supervisor.pids["one"] != before["one"]
        assert supervisor.pids["two"] == before["two"]
        assert one.last_error == "was ended by signal 9"
        said, back = (record.getMessage() for record in caplog.records)
        # How long it had lived is up to the machine.
        assert re.fullmatch(r"one was ended by signal 9; started again (at once|in 0\.0 s) \(no\. 1\)", said)
        assert back == "one is back"
    assert one.state == two.state == "ended"


def test_the_log_that_ros_writes_for_this_process_is_rotated(
    scripts: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, other = tmp_path / f"python_{os.getpid()}_1.log", tmp_path / f"python_{os.getpid() + 1}_1.log"
    for each in (log, other):
        each.write_bytes(bytes(6_000_000))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    with Supervisor(GRAPH, tmp_path / "run", policy=POLICY) as supervisor:
        assert attended(supervisor, lambda: log.stat().st_size == 0)
        assert other.stat().st_size == 6_000_000


def test_logs_of_servers_beside_the_nodes_are_rotated(scripts: dict[str, str], tmp_path: Path) -> None:
    log = tmp_path / "discovery_server.log"
    log.write_bytes(bytes(6_000_000))
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        assert attended(supervisor, lambda: log.stat().st_size == 0, 10.0)
    assert log.with_name("discovery_server.log.1").stat().st_size == 6_000_000


def test_a_process_that_linux_killed_for_lack_of_memory_is_reported_so(
    scripts: dict[str, str], tmp_path: Path, memory_group: Path
) -> None:
    scripts["one"] = f"""
if os.environ["{RESTARTS_VARIABLE}"] == "0":
    with open("{memory_group}", "w") as group:
        group.write(str(os.getpid()))
    taken = bytearray(b"1" * 200_000_000)
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one = supervisor.members["one"]
        assert attended(supervisor, lambda: one.restarts == 1 and one.state == "active")
        assert one.last_error.startswith("was ended by signal 9, by Linux, as the memory")


def test_renews_processes_started_between_two_times(scripts: dict[str, str], tmp_path: Path) -> None:
    """Renewals are not counted as crashes."""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == two.state == "active")
        before = supervisor.pids
        supervisor.renew(one.started, (one.started + two.started) / 2)
        for times in range(1, 2 * POLICY.times + 1):
            assert attended(supervisor, lambda times=times: one.restarts == times and one.state == "active")
            supervisor.renew(one.started, one.started)
        assert attended(supervisor, lambda: one.restarts == 2 * POLICY.times + 1 and one.state == "active")
        assert supervisor.pids["two"] == before["two"]
        assert supervisor.pids["one"] != before["one"]
        assert (one.last_error, one.is_given_up, two.restarts) == ("", False, 0)


@pytest.mark.parametrize("ends", ["sys.exit(0)", "os._exit(9)"])
def test_a_process_that_lost_a_running_publisher_is_started_again(
    scripts: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    ends: str,
) -> None:
    """It is asked to end, for that a node can stop its actuator. Restarts are not counted as crashes."""
    monkeypatch.setattr(_lost_publishers, "RENEWAL_PAUSE_S", 0.2)
    monkeypatch.setattr(_lost_publishers, "STEADY_S", 0.2)
    scripts["two"] = f"""
import signal
def end(*_): {ends}
signal.signal(signal.SIGINT, end)
while True:
    say("active /health:1")
    time.sleep(0.05)
"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == "active" and two.restarts > POLICY.times)
        assert (one.restarts, two.is_given_up) == (0, False)
        assert two.last_error == "does not receive /health any more"
        scripts["two"] = WELL
        assert attended(supervisor, lambda: not two.lost.get("two", True) and two.state == "active")
    expected = "two does not receive /health any more; started again with a new DDS participant (no. 1)"
    assert caplog.records[0].getMessage() == expected


def test_a_process_whose_port_in_shared_memory_is_lost_is_started_again(
    scripts: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_lost_publishers, "RENEWAL_PAUSE_S", 0.2)
    monkeypatch.setattr(shared_memory, "CHECK_S", 0.1)
    monkeypatch.setattr(shared_memory, "SCAN_S", 0.2)
    monkeypatch.setattr(PortWatch, "__init__", partialmethod(PortWatch.__init__, folder=tmp_path))
    port = tmp_path / "fastrtps_port7411"
    scripts["two"] = f"""
import mmap
lock = open("{port}_el", "w")
file = open("{port}", "w+b")
file.truncate(5000)
memory = mmap.mmap(file.fileno(), 0)
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == two.state == "active")
        assert attended(supervisor, lambda: bool(two.ports and two.ports.ports))
        port.unlink()
        assert attended(supervisor, lambda: two.restarts == 1 and two.state == "active")
        assert attended(supervisor, lambda: bool(two.ports and two.ports.ports))
        assert two.last_error == "does not receive messages in shared memory any more"
        assert not attended(supervisor, lambda: two.restarts > 1, timeout_s=1.0)
        assert (one.restarts, two.is_given_up) == (0, False)


def test_a_documented_error_ends_only_a_first_start(scripts: dict[str, str], tmp_path: Path) -> None:
    """Such as a camera that was unplugged meanwhile."""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        assert attended(supervisor, lambda: supervisor.well == {"one", "two"})
    scripts["one"] = f"""
if os.environ["{RESTARTS_VARIABLE}"] == "0":
    sys.exit(4)
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY, well=supervisor.well) as again:
        one = again.members["one"]
        assert attended(again, lambda: one.restarts == 1 and one.state == "active")
    with pytest.raises(SocialbotError), Supervisor(GRAPH, tmp_path, policy=POLICY) as first:
        attended(first, lambda: False)


@pytest.mark.parametrize("cares", [True, False])
def test_repeats_the_signal_and_then_kills(
    scripts: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cares: bool
) -> None:
    monkeypatch.setattr(_processes, "ASKED_AGAIN_S", 0.05)
    monkeypatch.setattr(_processes, "GRACE_S", 60.0 if cares else 0.1)
    again = "signal.signal(signal.SIGINT, signal.SIG_DFL)" if cares else "None"
    scripts["one"] = f"import signal\nsignal.signal(signal.SIGINT, lambda *_: {again})" + WELL
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == two.state == "active")
        before = supervisor.pids
        supervisor.renew(one.started, one.started)
        assert attended(supervisor, lambda: one.restarts == 1 and one.state == "active")
        assert supervisor.pids["one"] != before["one"]
        assert (one.last_error, one.is_given_up) == ("", False)


def test_a_graph_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    """A part of it would count as a graph when there is room again."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            _processes.write_graph(GRAPH, tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
    assert _processes.write_graph(GRAPH, tmp_path).read_text().startswith("name: idlers")


def test_a_restart_of_everything_needs_no_room_for_the_graph(scripts: dict[str, str], tmp_path: Path) -> None:
    """The graph is there since the first start."""
    _processes.write_graph(GRAPH, tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4, hard))
    try:
        with Supervisor(GRAPH, tmp_path, policy=POLICY, well=()) as supervisor:
            assert attended(supervisor, lambda: all(one.state == "active" for one in supervisor.members.values()))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_restart_of_everything_waits_for_the_folder_of_the_logs(
    scripts: dict[str, str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "log"
    folder.touch()
    with Supervisor(GRAPH, folder, policy=POLICY, well=()) as supervisor:
        assert attended(supervisor, lambda: caplog.text.count("cannot be started") > 1)
        folder.unlink()
        assert attended(supervisor, lambda: all(one.state == "active" for one in supervisor.members.values()))


def test_restarts_a_hung_process(scripts: dict[str, str], tmp_path: Path) -> None:
    scripts["one"] = f"""
if os.environ["{RESTARTS_VARIABLE}"] == "0":
    say("active")
    time.sleep(60)
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=IMPATIENT) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.restarts == 1)
        assert one.last_error == "hung (one sent no report)"
        assert attended(supervisor, lambda: one.state == "active")
        assert two.restarts == 0


def test_a_hung_process_is_never_given_up(scripts: dict[str, str], tmp_path: Path) -> None:
    """Messages of strangers can make DDS hang, so they must not end a node for good."""
    scripts["one"] = f"""
say("active")
if int(os.environ["{RESTARTS_VARIABLE}"]) <= {2 * POLICY.times}:
    time.sleep(60)
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=IMPATIENT) as supervisor:
        one, _ = supervisor.members.values()
        assert attended(supervisor, lambda: one.restarts > 2 * POLICY.times and one.state == "active")


@pytest.mark.skipif(not Path("/proc/self/oom_score_adj").exists(), reason="it is a setting of Linux")
def test_the_kernel_kills_a_process_before_its_supervisor(scripts: dict[str, str], tmp_path: Path) -> None:
    """If memory runs out: the process is started again, and the supervisor is not."""

    def score(pid: int) -> int:
        return int(Path(f"/proc/{pid}/oom_score_adj").read_text())

    own = score(os.getpid())
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        assert all(score(pid) > own for pid in supervisor.pids.values())
        first = supervisor.pids["one"]
        os.kill(first, signal.SIGKILL)
        assert attended(supervisor, lambda: supervisor.pids.get("one", first) != first)
        assert score(supervisor.pids["one"]) > own
    assert score(os.getpid()) == own


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="Linux counts no waiting here")
def test_a_process_whose_dds_works_without_end_is_restarted(scripts: dict[str, str], tmp_path: Path) -> None:
    """False packets of discovery let a thread count for days, and the node goes on meanwhile."""
    scripts["one"] = f"""
import ctypes, hashlib, threading
def count():
    ctypes.CDLL(None).prctl({PR_SET_NAME}, b"dds.udp.7410")
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)
if os.environ["{RESTARTS_VARIABLE}"] == "0":
    threading.Thread(target=count, daemon=True).start()
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.restarts == 1 and one.state == "active")
        assert one.last_error == "hung (DDS works without end)"
        assert two.restarts == 0


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="Linux counts no waiting here")
@pytest.mark.slow
def test_a_process_that_waits_for_a_processor_is_not_hung_so_soon(scripts: dict[str, str], tmp_path: Path) -> None:
    core = min(os.sched_getaffinity(0))
    scripts["one"] = f"""
say("active")
if os.environ["{RESTARTS_VARIABLE}"] == "0":
    os.sched_setaffinity(0, [{core}])
    os.nice(19)
    while True:
        sum(range(100_000))
{WELL}"""
    policy = replace(POLICY, hung_s=1.0)
    rival = subprocess.Popen(
        [sys.executable, "-S", "-c", f"import os\nos.sched_setaffinity(0, [{core}])\nwhile True: pass"]
    )
    try:
        with Supervisor(GRAPH, tmp_path, policy=policy) as supervisor:
            one = supervisor.members["one"]
            assert attended(supervisor, lambda: one.states.get("one") == "active")
            reported_at = one.reported_at["one"]
            waits, waited_s = ProcessorWaits(supervisor.pids["one"]), 0.0

            def is_restarted() -> bool:
                nonlocal waited_s
                waited_s = waits.total_s(monotonic()) if one.restarts == 0 else waited_s
                return one.restarts == 1

            assert attended(supervisor, is_restarted)
            silent_s = monotonic() - reported_at
            assert waited_s > policy.hung_s / 4
            assert silent_s - waited_s > policy.hung_s or silent_s > STARVED_LIMITS * policy.hung_s
            assert one.last_error == "hung (one sent no report)"
    finally:
        rival.kill()
        rival.wait()


def note_thread(proc: Path, name: str, state: str, ran_s: float, waited_s: float, periods: int) -> None:
    task = proc / "1" / "task" / name
    task.mkdir(parents=True, exist_ok=True)
    (task / "stat").write_text(f"1 (python) {state} 1")
    (task / "schedstat").write_text(f"{ran_s * 1e9:.0f} {waited_s * 1e9:.0f} {periods}\n")


def test_threads_that_wait_for_each_other_wait_together(tmp_path: Path) -> None:
    """One holds Python's lock and waits for a processor, then the other: each for half of the time."""
    waits = ProcessorWaits(1, tmp_path)
    waited_s = [5.0, 70.0]
    for turn in range(21):
        for index, name in enumerate("ab"):
            note_thread(tmp_path, name, "S", 1.0 + turn / 1000, waited_s[index], turn)
        assert waits.total_s(100.0 + turn / 2) == pytest.approx(0.49 * turn)
        waited_s[turn % 2] += 0.49


def test_threads_that_wait_at_once_count_once(tmp_path: Path) -> None:
    waits = ProcessorWaits(1, tmp_path)
    for turn in range(21):
        for name in "ab":
            note_thread(tmp_path, name, "R", 1.0, 5.0, 7)
        assert waits.total_s(100.0 + turn / 2) == pytest.approx(turn / 2)
    for name in "ab":  # its wait has ended: Linux counts it
        note_thread(tmp_path, name, "S", 1.1, 15.0, 8)
    assert waits.total_s(110.5) == pytest.approx(10.0)
    note_thread(tmp_path, "c", "S", 1.0, 40.0, 7)  # a new thread, which waited before
    assert waits.total_s(111.0) == pytest.approx(10.0)


def test_a_silent_process_that_waits_for_a_processor_is_hung_after_more_limits(
    scripts: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts["one"] = "say('active')\ntime.sleep(600)"
    note_thread(tmp_path, "a", "R", 1.0, 5.0, 7)  # ready, and does not run
    monkeypatch.setattr(launch, "ProcessorWaits", lambda pid: ProcessorWaits(1, tmp_path))
    policy = replace(POLICY, hung_s=0.2)
    with Supervisor(GRAPH, tmp_path / "log", policy=policy) as supervisor:
        one = supervisor.members["one"]
        assert attended(supervisor, lambda: bool(one.hung))
        assert monotonic() - one.reported_at["one"] > STARVED_LIMITS * policy.hung_s


def test_a_system_suspend_is_no_hang(scripts: dict[str, str], tmp_path: Path) -> None:
    """A closed laptop or a halted virtual machine suspends supervisor and nodes together."""
    with Supervisor(GRAPH, tmp_path, policy=IMPATIENT) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == two.state == "active")
        before = supervisor.pids
        for pid in before.values():
            os.kill(pid, signal.SIGSTOP)
        supervisor.attend(0.0)
        sleep(ABSENT_S + IMPATIENT.hung_s)
        supervisor.attend(0.02)
        for pid in before.values():
            os.kill(pid, signal.SIGCONT)
        assert not attended(supervisor, lambda: bool(one.restarts or two.restarts), timeout_s=IMPATIENT.hung_s)
        assert supervisor.pids == before


def test_a_machine_may_have_no_nodes(tmp_path: Path) -> None:
    with Supervisor(GRAPH, tmp_path, nodes=()) as supervisor:
        supervisor.attend(0.0)


def test_gives_up_a_process_that_crashes_too_often(
    scripts: dict[str, str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scripts["one"] = "raise SystemExit(9)"
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == "given up")
        assert attended(supervisor, lambda: two.state == "active")
        assert one.restarts == 2
    (message,) = [record.getMessage() for record in caplog.records if record.levelno == logging.ERROR]
    assert message == (
        "one is given up: it has crashed more than 2 times in 60 s; at last it ended with exit code 9; "
        f"its log: {tmp_path / 'one.log'}"
    )


def test_an_error_if_all_processes_are_given_up(scripts: dict[str, str], tmp_path: Path) -> None:
    scripts["one"] = scripts["two"] = "raise SystemExit(9)"
    with (
        pytest.raises(NodeError, match="all processes have crashed too often"),
        Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor,
    ):
        attended(supervisor, lambda: False)


def test_a_wrong_configuration_at_a_first_start_ends_all(scripts: dict[str, str], tmp_path: Path) -> None:
    scripts["one"] = "print('no such parameter'); raise SystemExit(4)"
    with (
        pytest.raises(SocialbotError, match="no such parameter") as caught,
        Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor,
    ):
        attended(supervisor, lambda: False)
    assert caught.value.exit_code == 4
    assert supervisor.pids == {}


def ends_with(code: int, what: str, remedy: str) -> str:
    """Script of a process that ends with an error."""
    error = f"INFO one: starts\nerror: {what}\n  remedy: {remedy}\n"
    return f"print({error!r}, end=''); sys.exit({code})"


def test_goes_on_without_a_part_of_the_installation(
    scripts: dict[str, str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scripts["one"] = ends_with(5, "the speech model is not installed", "make hear")
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == "given up")
        assert attended(supervisor, lambda: two.state == "active")
        assert one.last_error == "cannot start: the speech model is not installed; make hear"
    assert [record.getMessage() for record in caplog.records] == [
        "one cannot start: the speech model is not installed; make hear; the others go on without it"
    ]


def test_retries_a_missing_device_and_reports_it_once(
    scripts: dict[str, str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scripts["one"] = f"""
if os.environ["{RESTARTS_VARIABLE}"] < "4":
    {ends_with(7, "cam: no such camera", "plug it in")}
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one = supervisor.members["one"]
        assert attended(supervisor, lambda: one.state == "active")
    assert [record.getMessage() for record in caplog.records] == [
        "one cannot start: cam: no such camera; plug it in; tried again every 0.05 s; the others go on without it",
        "one is back",
    ]


def test_a_graph_of_one_process_ends_with_a_missing_device(scripts: dict[str, str], tmp_path: Path) -> None:
    scripts["one"] = ends_with(7, "cam: no such camera", "plug it in")
    with (
        pytest.raises(SocialbotError, match="no such camera") as caught,
        Supervisor(GRAPH, tmp_path, policy=POLICY, nodes=["one"]) as supervisor,
    ):
        attended(supervisor, lambda: False)
    assert caught.value.exit_code == 7


def test_a_crash_is_reported_with_its_error(
    scripts: dict[str, str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scripts["one"] = f"""
if os.environ["{RESTARTS_VARIABLE}"] == "0":
    raise ValueError("no ear")
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one = supervisor.members["one"]
        assert attended(supervisor, lambda: one.state == "active")
        assert one.last_error == "ended with exit code 1: ValueError: no ear"
    assert "one ended with exit code 1: ValueError: no ear; started again" in caplog.text


def test_retries_a_lost_device(scripts: dict[str, str], tmp_path: Path) -> None:
    scripts["one"] = f"""
if os.environ["{RESTARTS_VARIABLE}"] < "2":
    say("active")
    raise SystemExit(7)
{WELL}"""
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one = supervisor.members["one"]
        assert attended(supervisor, lambda: one.restarts == 2)
        assert attended(supervisor, lambda: one.state == "active")


def test_does_not_restart_a_process_that_ends_with_0(scripts: dict[str, str], tmp_path: Path) -> None:
    scripts["one"] = "say('active')"
    with Supervisor(GRAPH, tmp_path, policy=POLICY) as supervisor:
        one, two = supervisor.members.values()
        assert attended(supervisor, lambda: one.state == "ended")
        assert attended(supervisor, lambda: two.state == "active")
        assert one.restarts == 0


def test_a_process_that_the_system_refuses_at_the_first_start_is_an_error(tmp_path: Path) -> None:
    lowest = os.dup(0)
    os.close(lowest)
    supervisor = Supervisor(GRAPH, tmp_path, policy=POLICY)
    _processes.write_graph(GRAPH, tmp_path)
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)
    told: list[NodeError] = []

    def write(*_: object) -> Path:
        resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, limit[1]))
        return tmp_path / "graph.yaml"

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("socialbot.runtime.launch.write_graph", write)
        try:
            supervisor.__enter__()
        except NodeError as error:
            told.append(error)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limit)
    (error,) = told
    assert "idlers: a process cannot be started: Too many open files" in str(error)
    assert error.exit_code == 6
    assert supervisor.pids == {}
