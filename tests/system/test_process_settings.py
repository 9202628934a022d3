"""Scheduling and memory of the processes of a deployment."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import psutil
import pytest

from socialbot.bridge.environment import spinning_node
from tests.system.running import PATIENCE_S, eventually, running

pytestmark = [pytest.mark.ros, pytest.mark.slow]

GRAPH = """
name: eyes
nodes:
  camera: {type: camera, parameters: {source: PICTURES, loop: true}}
  image_converter: {type: image_converter}
  detector: {type: 'tests.system.nodes:LeakingDetector'}
"""
DEPLOYMENT = """
graph: graph.yaml
machines: {robot: {address: 127.0.0.1}}
domain: DOMAIN
nodes: {camera: robot, image_converter: robot, detector: robot}
processes:
  camera: {priority: 5, cpus: [CORE]}
  image_converter: {nice: 7}
  detector: {memory_mb: 700}
"""


def permitted() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


@pytest.mark.skipif(not permitted(), reason="this user may not set real-time priorities")
def test_nodes_keep_their_settings_and_one_without_memory_is_restarted(pictures: Path, tmp_path: Path) -> None:
    """Each thread has the settings, and the other nodes go on while the detector runs out of memory."""
    from diagnostic_msgs.msg import DiagnosticArray

    core = str(min(os.sched_getaffinity(0)))
    (tmp_path / "graph.yaml").write_text(GRAPH.replace("PICTURES", f"'{pictures}'"))
    text = DEPLOYMENT.replace("DOMAIN", os.environ["ROS_DOMAIN_ID"]).replace("CORE", core)
    (tmp_path / "deploy.yaml").write_text(text)
    told: dict[str, list[dict[str, str]]] = {}

    def note(array: DiagnosticArray) -> None:
        for status in array.status:
            told.setdefault(status.name, []).append({pair.key: pair.value for pair in status.values})

    def threads(node: str) -> list[int]:
        process = psutil.Process(int(told[node][-1]["pid"]))
        return [thread.id for thread in process.threads()]

    def newest(node: str, value: str) -> Any:
        return next((values[value] for values in reversed(told.get(node, [])) if value in values), None)

    with spinning_node("onlooker") as ros:
        ros.create_subscription(DiagnosticArray, "/diagnostics", note, 100)
        with running("up", tmp_path / "deploy.yaml", "--out", tmp_path / "run"):
            assert eventually(lambda: newest("camera", "pid") and newest("image_converter", "pid"), PATIENCE_S)
            assert {os.sched_getscheduler(thread) for thread in threads("camera")} == {os.SCHED_FIFO}
            assert {frozenset(os.sched_getaffinity(thread)) for thread in threads("camera")} == {frozenset({int(core)})}
            assert {os.getpriority(os.PRIO_PROCESS, thread) for thread in threads("image_converter")} == {7}
            assert eventually(lambda: int(newest("detector", "restarts") or 0) >= 1, PATIENCE_S)
            assert newest("detector", "last_error")
            assert {newest("camera", "restarts"), newest("image_converter", "restarts")} == {"0"}
    log = (tmp_path / "run" / "log" / "detector.log").read_text()
    assert "MemoryError" in log
