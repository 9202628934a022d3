"""Waldo on two machines with a person present: camera, speech and head on the robot, the rest on the workstation.

The machines are network namespaces with a virtual cable. The camera plays a 640x480 film at 30 Hz, in which one person
walks up and down and never leaves, so a second greeting is an error. An additional agent answers every processed frame,
to measure the latency from frame to action thirty times a second.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic

import cv2

from evaluation.faults_plan import Skipped, cpu_s, interrupt
from evaluation.faults_watch import Heard, heard
from evaluation.hosts import Host, N, NoHostsError, TwoHosts, two_hosts
from socialbot.bags.reader import open_bag
from socialbot.bridge.keys import new_key
from socialbot.core.errors import NodeError
from socialbot.core.messages import CompressedImage
from socialbot.vision.images import bgr_from_compressed

ROOT = Path(__file__).parents[1]
CORRIDOR = ROOT / "data" / "synthetic" / "corridor"
NEAR_S = (9.5, 12.0)
"""Part of the corridor in which one person comes from 5 m to 3 m."""

FRAME_HZ, BAG_HZ = 30, 10
GREETING = "Hallo"

TAKEN, ARRIVED = "/camera/image_raw", "/camera/image_raw/workstation"
DETECTIONS, TRACE, ACTIONS = "/humans/bodies/detections", "/waldo/trace", "/agent/actions"
SAY, SPEECH, HEAD, MOTION = "/speech/say", "/speech/status", "/head/command", "/head_controller/joint_trajectory"
HEALTH = "/health"
WATCHED = {
    "robot": (TAKEN, ACTIONS, SAY, SPEECH, HEAD, MOTION, HEALTH),
    "workstation": (ARRIVED, DETECTIONS, TRACE, HEALTH),
    "second": (SAY, SPEECH, HEALTH),
}

GRAPH = """
name: waldo
inputs: [/camera/image_raw/compressed]
paced_by: /humans/bodies/detections
nodes:
  camera:          {type: camera}
  image_converter: {type: image_converter}
  person_detector: {type: person_detector}
  bdi_engine:      {type: waldo}
  listener:        {type: listener}
  speech:          {type: speaker, parameters: {engine: bdi_engine}, remap: {health: /bdi_engine/health}}
  head:            {type: head, parameters: {engine: bdi_engine}, remap: {health: /bdi_engine/health}}
  answerer:        {type: 'evaluation.transport_nodes:Answerer'}
"""
DEPLOYMENT = """
graph: graph.yaml
machines: {machines}
discovery: {discovery}
nodes:
  camera: robot
  speech: {speaker}
  head: robot
  image_converter: workstation
  person_detector: workstation
  bdi_engine: workstation
  listener: workstation
  answerer: workstation
security: {{keys: keys}}
parameters:
  camera: {{source: '{film}', loop: true}}
  bdi_engine: {{greeting: {greeting}}}
  speech: {{playback: 'off'}}
"""

READY_S = 180.0
LOOK_S = 0.02


@dataclass(frozen=True)
class Scene(Generic[N]):
    """The machines with the messages received on each."""

    hosts: N
    folder: Path
    speaker: str = "robot"
    watchers: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    halves: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    @contextmanager
    def up(self, machine: str) -> Iterator[subprocess.Popen[bytes]]:
        """Start the half of ``machine`` for the block, as users do."""
        command = (sys.executable, "-m", "socialbot", "up", self.folder / "waldo.yaml", "--machine", machine)
        with self._started(machine, f"{machine}.log", *command, "--out", self.folder / machine) as process:
            self.halves[machine] = process
            yield process

    @contextmanager
    def _started(self, machine: str, log: str, *command: object) -> Iterator[subprocess.Popen[bytes]]:
        with (self.folder / log).open("w") as output:
            variables = {"PYTHONPATH": str(ROOT), "SOCIALBOT_FOLDERS": str(self.folder)}
            process = self.host(machine).start(*command, variables=variables, stdout=output, stderr=output)
        try:
            yield process
        finally:
            interrupt(process)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Record messages on both machines during the block."""
        with ExitStack() as undo:
            for machine in self.hosts.machines:
                topics = WATCHED[machine]
                command = (sys.executable, "-m", "evaluation.faults_watch", self.folder / "waldo.yaml", machine)
                self.watchers[machine] = undo.enter_context(
                    self._started(machine, f"{machine}-watch.log", *command, self.file(machine), *topics)
                )
            yield

    def host(self, machine: str) -> Host:
        return self.hosts.machines[machine]

    def file(self, machine: str) -> Path:
        return self.folder / f"{machine}.jsonl"

    def heard(self, machine: str, *topics: str) -> list[Heard]:
        """Return the messages of ``topics`` received on ``machine`` so far."""
        return [one for one in heard(self.file(machine)) if one.topic in topics]

    def spoken(self, begin: int = 0) -> list[Heard]:
        """Return the utterances started since ``begin`` (ns)."""
        return [one for one in self.heard(self.speaker, SPEECH) if one.said["state"] == "started" and one.at >= begin]

    def await_greeting(self) -> None:
        """Wait until the robot has greeted and every frame is answered."""
        self.await_(
            lambda: len(self.heard("robot", ACTIONS)) > FRAME_HZ and bool(self.spoken()), READY_S, "nobody was greeted"
        )

    def await_(self, holds: Callable[[], bool], timeout_s: float, lack: str) -> None:
        """Wait until ``holds`` returns true; on timeout raise NodeError with ``lack``."""
        deadline = time.monotonic() + timeout_s
        while not holds():
            for machine, half in self.halves.items():
                if half.poll() is not None:
                    raise NodeError("it has ended", where=machine, remedy=f"see {self.folder / machine}.log")
            if time.monotonic() > deadline:
                raise NodeError(f"{lack} within {timeout_s:g} s", where=str(self.folder), remedy="see the logs there")
            time.sleep(LOOK_S)

    def cpu_s(self, machine: str) -> float:
        """Return the processor seconds of all live processes of ``machine`` without observers."""
        host = self.host(machine)
        pids = subprocess.check_output(["ip", "netns", "pids", host.name], text=True).split()
        aside = {host.keeper, self.watchers[machine].pid}
        return sum(cpu_s(int(pid)) for pid in pids if int(pid) not in aside)


@contextmanager
def scene(folder: Path) -> Iterator[Scene[TwoHosts]]:
    """Yield robot and workstation, observed and without nodes, with records in ``folder``.

    Raises:
        Skipped: The machines cannot be created.
    """
    with scene_over(two_hosts(), folder) as made:
        yield made


@contextmanager
def scene_over(
    network: AbstractContextManager[N], folder: Path, *, speaker: str = "robot", discovery: str = "peers"
) -> Iterator[Scene[N]]:
    """Yield the machines of another network.

    Args:
        network: The hosts.
        folder: Where the records are written.
        speaker: The machine that speaks.
        discovery: How the machines find each other, as in a deployment file.

    Raises:
        Skipped: The machines cannot be created.
    """
    try:
        with network as hosts:
            for name in hosts.machines:
                new_key(name, folder / "keys")
            make_film(folder / "film.avi")
            (folder / "graph.yaml").write_text(GRAPH)
            machines = ", ".join(f"{name}: {{address: {host.address}}}" for name, host in hosts.machines.items())
            film, greeting = folder / "film.avi", GREETING
            page = DEPLOYMENT.format(
                machines=f"{{{machines}}}", discovery=discovery, speaker=speaker, film=film, greeting=greeting
            )
            (folder / "waldo.yaml").write_text(page)
            made = Scene(hosts, folder, speaker)
            with made.watched():
                yield made
    except NoHostsError as reason:
        raise Skipped(f"no machines: {reason}") from reason


def make_film(path: Path) -> None:
    """Write a film of an approaching and retreating person, which loops without a cut."""
    pictures = []
    begin_s, end_s = NEAR_S
    with open_bag(CORRIDOR) as bag:
        for _, message in bag.messages({topic.name: topic.name for topic in bag.image_topics}):
            if isinstance(message, CompressedImage) and begin_s <= (message.stamp - bag.start) / 1e9 < end_s:
                pictures.append(bgr_from_compressed(message))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), float(FRAME_HZ), (640, 480))
    for picture in pictures + pictures[-2:0:-1]:
        for _ in range(FRAME_HZ // BAG_HZ):
            writer.write(picture)
    writer.release()
