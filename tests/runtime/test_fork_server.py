"""Processes from the fork server: children like any others, and none is lost when the server is killed."""

from __future__ import annotations

import ast
import ctypes
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from socialbot.graph.files import load_graph
from socialbot.graph.status import ACTIVE
from socialbot.runtime import _processes
from socialbot.runtime import fork_server as fork_server_module
from socialbot.runtime.fork_server import ForkedProcess, ForkServer, started_early
from socialbot.runtime.launch import Supervisor
from tests.system.running import PATIENCE_S, eventually

pytestmark = [pytest.mark.ros, pytest.mark.skipif(sys.platform != "linux", reason="needs Linux")]

UNKNOWN_NODE = ["node", "nobody"]
WAIT_S = 60.0
PR_GET_CHILD_SUBREAPER = 37


@pytest.fixture(scope="module")
def fork_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    fork_server = ForkServer(load_graph("waldo"), tmp_path_factory.mktemp("fork_server"))
    yield fork_server
    fork_server.close()


def is_subreaper() -> bool:
    answer = ctypes.c_int(-1)
    ctypes.CDLL(None).prctl(PR_GET_CHILD_SUBREAPER, ctypes.byref(answer), 0, 0, 0)
    return bool(answer.value)


def test_a_fork_runs_the_command_line_and_logs_its_error(fork_server: ForkServer, tmp_path: Path):
    log = tmp_path / "nobody.log"
    log.write_text("before\n")
    process = fork_server.start(UNKNOWN_NODE, log)
    assert isinstance(process, ForkedProcess)
    assert process.wait(WAIT_S) == 4
    before, *said = log.read_text().splitlines()
    assert before == "before"
    assert "'nobody'" in "".join(said)
    assert "Traceback" not in log.read_text()


@pytest.fixture
def many_files() -> Iterator[None]:
    """More open files than `select` can watch."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(limits[0], min(2048, limits[1])), limits[1]))
    files = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]
    yield
    for file in files:
        os.close(file)
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)


@pytest.mark.usefixtures("many_files")
def test_a_graph_starts_in_a_process_with_many_open_files(tmp_path: Path) -> None:
    with Supervisor(load_graph("waldo"), tmp_path, nodes=["head"]) as supervisor:
        assert eventually(lambda: supervisor.attend(0.1) or supervisor.members["head"].state == ACTIVE)


RECORDER = """\
import json, os
from pathlib import Path
from socialbot.graph.node import Node

class Recorder(Node):
    def start(self):
        temporary = Path(__file__).with_name(f"{os.getpid()}.new")
        temporary.write_text(json.dumps({n: v for n, v in os.environ.items() if n.startswith("ROS_SECURITY_")}))
        temporary.rename(temporary.with_suffix(".json"))
"""


@pytest.mark.parametrize("servers", [fork_server_module.MAX_SERVERS, 0])
def test_variables_of_sros2_reach_every_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, servers: int) -> None:
    """With and without a fork server. The wheels end if ROS_SECURITY_ENABLE is true, as they lack the security."""
    variables = {
        "ROS_SECURITY_ENABLE": "false",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(tmp_path / "keystore"),
        "ROS_SECURITY_ENCLAVE_OVERRIDE": "/socialbot/robot",
    }
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(fork_server_module, "MAX_SERVERS", servers)
    monkeypatch.setattr(sys, "path", list(sys.path))
    module = f"recorder_{servers}"
    (tmp_path / f"{module}.py").write_text(RECORDER)
    file = tmp_path / "recorders.yaml"
    file.write_text(
        f"name: recorders\nnodes: {{one: {{type: '{module}:Recorder'}}, two: {{type: '{module}:Recorder'}}}}"
    )
    with Supervisor(load_graph(str(file)), tmp_path / "log") as supervisor:
        assert eventually(lambda: supervisor.attend(0.1) or len([*tmp_path.glob("*.json")]) == 2)
    assert [json.loads(path.read_text()) for path in tmp_path.glob("*.json")] == [variables, variables]


@pytest.mark.slow
def test_a_server_compiles_damaged_modules_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the nodes of its graph, and of those that each node imports."""
    monkeypatch.setenv("PYTHONPYCACHEPREFIX", str(tmp_path / "compiled"))
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    names = ("agents/waldo/nodes", "bridge/_node_thread")
    for is_damaged in (False, True):
        server = ForkServer(load_graph("waldo"), tmp_path)
        try:
            process = server.start(UNKNOWN_NODE, tmp_path / "log")
            assert isinstance(process, ForkedProcess)
            assert process.wait(WAIT_S) == 4
        finally:
            server.close()
        for name in () if is_damaged else names:
            compiled = next(tmp_path.rglob(f"socialbot/{name}.{sys.implementation.cache_tag}.pyc"))
            compiled.write_bytes(compiled.read_bytes()[:200])


def test_a_process_adopts_orphans_only_during_a_request(fork_server: ForkServer, tmp_path: Path):
    fork_server.start(UNKNOWN_NODE, tmp_path / "log").wait(WAIT_S)
    assert not is_subreaper()


def test_a_fork_is_a_child_with_an_exit_code(fork_server: ForkServer, tmp_path: Path):
    process = fork_server.start(["node", "head"], tmp_path / "head.log")
    assert process.poll() is None
    assert f"PPid:\t{os.getpid()}\n" in Path(f"/proc/{process.pid}/status").read_text()
    process.kill()
    assert process.wait(WAIT_S) == process.poll() == -signal.SIGKILL
    process.send_signal(signal.SIGINT)  # no effect: it has exited


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_right_after_the_fork_ends_it_cleanly(fork_server: ForkServer, tmp_path: Path, how: signal.Signals):
    process = fork_server.start(["node", "head"], tmp_path / "head.log")
    process.send_signal(how)
    assert process.wait(WAIT_S) == 0
    assert (tmp_path / "head.log").read_text() == ""


def test_waiting_raises_after_the_timeout(fork_server: ForkServer, tmp_path: Path):
    process = fork_server.start(["node", "head"], tmp_path / "head.log")
    os.kill(process.pid, signal.SIGSTOP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.01)
    process.kill()
    process.wait(WAIT_S)


def test_forks_outlive_a_killed_server_and_a_new_server_starts(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(fork_server_module, "ANSWER_S", WAIT_S)  # on a busy machine, its imports may take long
    fork_server = ForkServer(load_graph("waldo"), tmp_path)
    try:
        head = fork_server.start(["node", "head"], tmp_path / "head.log")
        assert eventually(lambda: Path(f"/proc/{head.pid}/comm").read_text() == "head\n")
        os.kill(head.pid, signal.SIGSTOP)
        assert fork_server.server_pid
        os.kill(fork_server.server_pid, signal.SIGKILL)
        plain = fork_server.start(UNKNOWN_NODE, tmp_path / "plain.log")
        assert not isinstance(plain, ForkedProcess)
        assert [record.getMessage().partition(":")[0] for record in caplog.records] == [
            "plain starts without a fork server"
        ]
        fork = fork_server.start(UNKNOWN_NODE, tmp_path / "fork.log")
        assert isinstance(fork, ForkedProcess)
        assert plain.wait(WAIT_S) == fork.wait(WAIT_S) == 4
        assert head.poll() is None
        head.kill()
        head.wait(WAIT_S)
    finally:
        fork_server.close()


def test_a_server_that_does_not_answer_is_asked_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    """Each further wait would delay the start of a graph on a busy machine."""
    monkeypatch.setattr(fork_server_module, "ANSWER_S", 0.2)
    fork_server = ForkServer(load_graph("waldo"), tmp_path)
    try:
        fork_server.prepare()
        assert fork_server.server_pid
        os.kill(fork_server.server_pid, signal.SIGSTOP)
        processes = [fork_server.start(UNKNOWN_NODE, tmp_path / f"{number}.log") for number in range(2)]
        assert [process.wait(WAIT_S) for process in processes] == [4, 4]
        assert [record.getMessage() for record in caplog.records] == ["0 starts without a fork server: timed out"]
    finally:
        fork_server.close()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="Linux counts no waiting here")
def test_the_first_server_may_wait_for_a_processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On a busy machine, nodes that start without it would each import what it imports once."""
    core = min(os.sched_getaffinity(0))
    monkeypatch.setattr(fork_server_module, "ANSWER_S", 4.0)
    monkeypatch.setattr(_processes, "STARVED_LIMITS", 100)
    fork_server = ForkServer(load_graph("waldo"), tmp_path)
    busy = f"import os\nos.sched_setaffinity(0, [{core}])\nwhile True: pass"
    rivals = [subprocess.Popen([sys.executable, "-S", "-c", busy]) for _ in range(2)]
    try:
        fork_server.prepare()
        assert fork_server.server_pid
        os.sched_setaffinity(fork_server.server_pid, [core])
        os.setpriority(os.PRIO_PROCESS, fork_server.server_pid, 5)
        begun = time.monotonic()
        process = fork_server.start(UNKNOWN_NODE, tmp_path / "log")
        assert isinstance(process, ForkedProcess), f"after {time.monotonic() - begun:.1f} s"
        assert process.wait(WAIT_S) == 4
    finally:
        for rival in rivals:
            rival.kill()
            rival.wait()
        fork_server.close()


def test_a_server_that_started_early_gets_the_settings_of_the_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SOCIALBOT_GONE", "1")
    with started_early():
        early = fork_server_module._early
        assert early is not None
        monkeypatch.delenv("SOCIALBOT_GONE")
        monkeypatch.setenv("SOCIALBOT_LATER", "2")
        monkeypatch.syspath_prepend(str(tmp_path))
        fork_server = ForkServer(load_graph("waldo"), tmp_path)
        try:
            process = fork_server.start(["node", "head"], tmp_path / "head.log")
            assert isinstance(process, ForkedProcess)
            assert fork_server.server_pid == early.process.pid
            assert fork_server_module._early is None
            command = "import os, sys; print((dict(os.environ), sys.path), flush=True)"
            graph = tmp_path / "graph.yaml"
            graph.write_text("name: one\nnodes: {one: {type: 'asks_for_environment:Asks'}}")
            (tmp_path / "asks_for_environment.py").write_text(command)
            fork_server.start(["node", "--graph", str(graph), "one"], tmp_path / "one.log").wait(WAIT_S)
            variables, path = ast.literal_eval((tmp_path / "one.log").read_text().splitlines()[0])
            assert "SOCIALBOT_GONE" not in variables
            assert variables["SOCIALBOT_LATER"] == "2"
            assert str(tmp_path) in path
            process.kill()
            process.wait(WAIT_S)
        finally:
            fork_server.close()
    assert not Path(f"/proc/{early.process.pid}").exists()


def test_an_early_server_that_nobody_takes_ends_with_the_block():
    with started_early():
        early = fork_server_module._early
        assert early is not None
        assert early.process.poll() is None
    assert early.process.poll() is not None


def test_starting_a_server_early_imports_little():
    """A command starts it before its own imports, which take seconds on a busy machine."""
    heavy = ("numpy", "ruamel.yaml", "rosbags", "cv2")
    code = f"import sys, socialbot.runtime.fork_server; print([one for one in {heavy} if one in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_up_without_a_page_imports_no_server_of_pages():
    code = """
import atexit, sys
from socialbot.__main__ import run
atexit.register(lambda: print([one for one in ("starlette", "uvicorn", "jinja2") if one in sys.modules]))
sys.argv = ["socialbot", "up", "nothing.yaml"]
run()
"""
    ended = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
    assert ended.returncode == 4
    assert ended.stdout.strip() == "[]"


def test_a_run_that_attends_its_processes_is_not_hung(tmp_path: Path) -> None:
    """The start of a server reports the first sign of life; a run of minutes must go on with them."""
    program = f"""
import time
from pathlib import Path
from socialbot.core.process_guard import guarded, report_alive
from socialbot.graph.files import load_graph
from socialbot.runtime.launch import Launch

launch = Launch(load_graph("waldo"), Path({str(tmp_path)!r}))
with guarded(hung_s=5.0):
    report_alive()
    end = time.monotonic() + 8.0
    while time.monotonic() < end:
        launch.check()
        time.sleep(0.1)
launch.stop()
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == 0, ended.stderr
