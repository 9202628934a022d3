"""Packets row: malformed and false RTPS packets from another machine, against nodes that are open to the network."""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import psutil

from evaluation.faults_plan import Plan, Skipped, await_
from evaluation.hosts import ROBOT, WORKSTATION, Host, NoHostsError, two_hosts
from evaluation.report import Report, Value
from evaluation.rtps_attack import ATTACKS
from socialbot.bridge.environment import wait_for
from socialbot.bridge.keys import new_key

ROOT = Path(__file__).parents[1]
TOPIC, RATE_HZ = "/speech/say", 50
BOUND_S = 2.0
"""Longest gap (s) after the end of an attack."""
SUPERVISED = ("endless_gap", "removed_publishers", "removed_subscriptions")
"""Attacks after which a supervisor has to start a process again."""
UNSUPERVISED = tuple(name for name in ATTACKS if name not in (*SUPERVISED, "acknacks"))
"""Attacks after which a process goes on without a supervisor; ``acknacks`` does harm on a bad link only."""
FORGED, FORGED_BOUND_S = ("heartbeats", "gaps", "freed_messages"), 15.0
"""Attacks in the name of a publisher, after which a subscription has to be replaced."""
CALM_S = 20.0
NEW_S = 30.0

TALK = f"""
import time
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import Utterance
with spinning_node("talker") as ros:
    sender, number = open_transport().advertise(ros, "{TOPIC}", Utterance), 0
    while True:
        sender.publish(Utterance(stamp=time.time_ns(), id=str(number), text="word"))
        number += 1
        time.sleep(1 / {RATE_HZ})
"""
HEAR = f"""
import time
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import Utterance
with spinning_node("hearer") as ros:
    open_transport().subscribe(ros, "{TOPIC}", Utterance, lambda one: print(time.monotonic(), one.id, flush=True))
    time.sleep(3600)
"""


def packets(report: Report, plan: Plan) -> str:
    """Attack a publisher and a subscriber with keys with each kind of packet.

    Raises:
        Skipped: This machine cannot have two hosts.
    """
    folder = plan.records("packets")
    new_key("robot", folder / "keys")
    seconds = plan.of(20.0, 5.0)
    rows = report.tables.setdefault("packets", {})
    try:
        with two_hosts() as hosts:
            for name in UNSUPERVISED:
                bound_s = FORGED_BOUND_S if name in FORGED else BOUND_S
                rows[name] = row = _attack(hosts.robot, hosts.workstation, name, seconds, folder / name, plan.domain)
                plan.tell(f"packets: {name}: " + ", ".join(f"{key} {value}" for key, value in row.items()))
                report.add(
                    f"packets_{name}_after_s", f"packets: {name}, longest gap after, s", row["gap after, s"], bound_s
                )
                new = row["a new subscriber hears"]
                report.add(f"packets_{name}_new", f"packets: {name}, a new subscriber hears the publisher", new, True)
                report.add(f"packets_{name}_alive", f"packets: {name}, both processes go on", row["alive"], True)
    except NoHostsError as error:
        raise Skipped(str(error)) from error
    worst = max(rows, key=lambda name: float(rows[name]["gap during, s"] or 0))
    return f"longest gap during an attack {rows[worst]['gap during, s']} s ({worst})"


def _attack(robot: Host, workstation: Host, name: str, seconds: float, folder: Path, domain: int) -> dict[str, Value]:
    folder.mkdir()
    variables = {
        "PYTHONPATH": str(ROOT),
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "SOCIALBOT_DATAGRAM_BYTES": "",
        "FASTRTPS_DEFAULT_PROFILES_FILE": "",
    }
    own = {**variables, "ROS_STATIC_PEERS": WORKSTATION, "SOCIALBOT_KEYS": str(folder.parent / "keys")}
    heard = folder / "hearer.log"
    with _script(robot, TALK, folder / "talker.log", own) as talker, _script(robot, HEAR, heard, own) as hearer:
        await_(lambda: len(_arrivals(heard)) > RATE_HZ, 60.0, "nothing heard", folder)
        memory = _memory(hearer) + _memory(talker)
        command = [sys.executable, "-m", "evaluation.rtps_attack", name, ROBOT, TOPIC, str(seconds)]
        with (folder / "attack.log").open("w") as log:
            attack = workstation.start(
                *command, variables={**variables, "ROS_STATIC_PEERS": ROBOT}, stdout=log, stderr=log
            )
        try:
            await_(lambda: "begins" in (folder / "attack.log").read_text(), 60.0, "no attack", folder)
            begun = time.monotonic()
            attack.wait(seconds + 60)
        finally:
            attack.kill()
            attack.wait()
        ended = time.monotonic()
        time.sleep(CALM_S)
        now = time.monotonic()
        grown = _memory(hearer) + _memory(talker) - memory
        alive = hearer.poll() is None and talker.poll() is None
        again = folder / "again.log"
        with _script(robot, HEAR, again, own):
            restarted = wait_for(lambda: bool(_arrivals(again)), NEW_S)
    arrivals = _arrivals(heard)
    numbers = [number for _, number in arrivals]
    sent = (folder / "attack.log").read_text().split()[-1]
    return {
        "packets": int(sent) if sent.isdecimal() else None,
        "gap during, s": _longest([at for at, _ in arrivals], begun, ended),
        "gap after, s": _longest([at for at, _ in arrivals], ended, now),
        "lost": max(numbers) - min(numbers) + 1 - len(set(numbers)),
        "grown, MB": round(grown / 1e6, 1),
        "alive": alive,
        "a new subscriber hears": restarted,
    }


@contextmanager
def _script(host: Host, text: str, log: Path, variables: Mapping[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("w") as output:
        process = host.start(sys.executable, "-c", text, variables=variables, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _arrivals(log: Path) -> list[tuple[float, int]]:
    lines = [line.split() for line in log.read_text().split("\n")[:-1]]
    return [(float(words[0]), int(words[1])) for words in lines if len(words) == 2 and words[1].isdecimal()]


def _longest(times: list[float], begin: float, end: float) -> float:
    """Longest time (s) without an arrival between two times."""
    inside = [begin, *(at for at in times if begin < at < end), end]
    return round(max(later - sooner for sooner, later in itertools.pairwise(inside)), 2)


def _memory(process: subprocess.Popen[bytes]) -> int:
    try:
        return psutil.Process(process.pid).memory_info().rss
    except psutil.Error:
        return 0
