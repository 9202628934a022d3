"""Channel between a process and its supervisor, run locks, and the DDS profile of a process."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from socialbot.bridge import environment, process
from socialbot.bridge.process import CHANNEL_VARIABLE, Report, SupervisorChannel, channel_pair, own_channel
from socialbot.bridge.run_announcer import locked_runs, run_lock
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.speaker import Speaker
from socialbot.vision.image_transport import ImageReceiver, ImageSender
from tests.system.running import PATIENCE_S, next_line


@pytest.fixture
def ends() -> Iterator[tuple[SupervisorChannel, SupervisorChannel]]:
    """The ends of the supervisor and of the process."""
    ours, end = channel_pair()
    theirs = SupervisorChannel(end)
    yield ours, theirs
    ours.close()
    theirs.close()


def test_messages_arrive_in_order(ends):
    ours, theirs = ends
    assert ours.receive() == []
    theirs.send("head", "starting")
    theirs.send("head", "active")
    theirs.send("head", "active", {"/speech/say": 1, "/health": 3})
    assert ours.receive() == [
        Report("head", "starting"),
        Report("head", "active"),
        Report("head", "active", {"/speech/say": 1, "/health": 3}),
    ]
    ours.send("head", "deactivate")
    assert theirs.wait() == ("head", "deactivate")


def test_a_channel_is_broken_when_the_other_end_is_closed(ends):
    ours, theirs = ends
    theirs.send("head", "active")
    theirs.close()
    assert ours.receive() == [Report("head", "active")]
    assert ours.broken
    assert ours.wait() is None
    ours.send("head", "deactivate")


def test_any_number_of_lost_publishers_fits_into_a_report(ends):
    ours, theirs = ends
    lost = {f"/{number:0255}": number for number in range(100)}
    theirs.send(64 * "h", "active", lost)
    (report,) = ours.receive()
    assert report.node == 64 * "h"
    assert report.lost
    assert report.lost.items() <= lost.items()


def test_sending_never_blocks(ends):
    ours, theirs = ends
    for _ in range(20_000):
        theirs.send("head", "active")
    assert not theirs.broken
    assert 0 < len(ours.receive()) < 20_000


def test_a_process_takes_its_channel_from_the_environment():
    ours, end = channel_pair()
    number = os.dup(end.fileno())
    os.set_inheritable(number, True)
    end.close()
    environment = {CHANNEL_VARIABLE: str(number)}
    theirs = own_channel(environment)
    assert theirs is not None
    assert environment == {}
    assert not os.get_inheritable(number)
    theirs.send("head", "active")
    assert ours.receive() == [Report("head", "active")]
    theirs.close()
    ours.close()
    assert own_channel({}) is None


HOLD = "from socialbot.bridge.run_announcer import run_lock\nwith run_lock('abc'): print(); input()"


def test_a_lock_is_listed_in_its_domain_until_it_is_released(monkeypatch: pytest.MonkeyPatch):
    before = locked_runs()
    with run_lock("0123456789abcdef"):
        assert locked_runs() == {**before, "0123456789abcdef": os.getpid()}
        with monkeypatch.context() as elsewhere:
            elsewhere.setenv("ROS_DOMAIN_ID", "7")
            assert "0123456789abcdef" not in locked_runs()
    assert locked_runs() == before


def test_the_lock_of_a_killed_process_is_released():
    before = locked_runs()
    holder = subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert next_line(holder) == "\n"
    assert locked_runs() == {**before, "abc": holder.pid}
    holder.kill()
    holder.wait()
    assert locked_runs() == before


def test_lost_packets_of_nodes_with_streams_are_sent_again_at_once_on_a_network(tmp_path, monkeypatch):
    link = {"link": "/view/link", "ack": "/view/link/ack"}
    nodes = {
        "sender": NodeConfig("sender", ImageSender, remap={"image": "/view", **link}),
        "receiver": NodeConfig("receiver", ImageReceiver, remap={"image": "/view/there", **link}),
        "speech": NodeConfig("speech", Speaker),
    }
    graph = Graph("g", tuple(nodes.values()), inputs=frozenset({"/view", "/speech/say"}))
    found = {}
    for name in nodes:
        monkeypatch.setenv(environment.PROFILE_VARIABLE, str(environment.WIFI_PROFILE))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
        process._use_topics(graph, [name])
        profile = Path(os.environ[environment.PROFILE_VARIABLE]).read_text("utf-8")
        found[name] = [topic for topic in ("/view/link", "/view/link/ack", "/view/there") if f'"{topic}"' in profile]
        assert all(f'"{topic}/_seal"' in profile for topic in found[name])
    assert found == {"sender": ["/view/link"], "receiver": ["/view/link/ack", "/view/there"], "speech": []}


SLOW_TO_LEAVE = """
import sys, time
from contextlib import contextmanager
from socialbot.bridge import process
from socialbot.core.errors import NodeError
from socialbot.graph.node import Graph, Node, NodeConfig

def find_a_node(*_):
    raise NodeError("nodes with these names are running already: one")

@contextmanager
def slow_context(args, context=process.ros_context):
    with context(args) as ros:
        try:
            yield ros
        finally:
            time.sleep(1.0)

process.LEAVE_S, process.ros_context, process.expect_free_names = 0.01, slow_context, find_a_node
try:
    process.run_nodes(Graph("one", (NodeConfig("one", Node),)), ["one"], sim_time=False)
except NodeError as error:
    sys.exit(error.exit_code)
"""


@pytest.mark.ros
def test_an_error_is_reported_even_if_dds_is_left_slowly() -> None:
    """A process that the alarm of well processes ends has no exit code, and seems to have ended well."""
    done = subprocess.run([sys.executable, "-c", SLOW_TO_LEAVE], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 6, done.stderr
