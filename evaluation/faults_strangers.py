"""Strangers row: unauthorized messages in the same ROS domain while keys are set.

``socialbot up`` runs speech, a head, a listener and an agent that takes beliefs, desires and requests. An authorized
sender sends each of them one message. An attacker records these and sends 10 000 messages of eight kinds over DDS:
plain text, unreadable, with an unknown or wrong sender, altered, for another topic, an hour late or early, and
replayed. Nodes must refuse all and count each on /diagnostics under its reason.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from evaluation.faults_plan import Plan, await_, beside
from evaluation.report import Report, Value
from socialbot.bridge import environment
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.keys import Keys, load_keys, new_key
from socialbot.bridge.security import REASONS, SCHEMA, Stream
from socialbot.core.clock import SECOND
from socialbot.core.messages import (
    ActionRequest,
    HeadCommand,
    JointTrajectory,
    Message,
    SpeechStatus,
    Structured,
    Utterance,
)
from socialbot.deliberation.messages import (
    INSTANCE,
    AgentReply,
    AgentRequest,
    Belief,
    BeliefSet,
    Desire,
    DesireItem,
    DesireSet,
    Fact,
)
from socialbot.graph.files import load_graph
from socialbot.graph.ports import Delivery

COUNT, QUICK_COUNT = 10_000, 960
BATCH = 288
"""48 messages for each topic: below the queue limit of a node, so that none is lost before its refusal."""
READY_S, COUNTED_S = 90.0, 30.0
HOUR = 3600 * SECOND
MOTION = "/head_controller/joint_trajectory"

GRAPH = """
name: strangers
inputs: [/waldo/actions, /humans/bodies/detections, /warehouse/boxes, /carrier_a/move_status,
         /carrier_a/add_belief, /carrier_a/del_belief, /carrier_a/add_belief_set, /carrier_a/del_belief_set,
         /carrier_a/add_desire, /carrier_a/del_desire, /agents/requests, /agents/replies]
nodes:
  listener:  {type: listener}
  speech:    {type: speaker, parameters: {playback: 'off'}}
  head:      {type: head}
  carrier_a: {type: carrier}
"""


def say(word: str) -> dict[str, Structured]:
    """Return a message with ``word`` for each attacked topic."""
    fact = Fact(name=word, pddl_type=INSTANCE, type="box")
    desire = Desire(name=word, value=(Fact(name="fully_loaded", params=("carrier_a",)),))
    speak = (word, f"{word} acts")
    return {
        "/speech/say": Utterance(stamp=1, id=word, text=word),
        "/head/command": HeadCommand(stamp=1, mode="look", pan_rad=0.5 if word == "friend" else -0.5, cause=word),
        "/waldo/actions": ActionRequest(stamp=1, id=word, agent="waldo", name="speak", arguments=speak),
        "/carrier_a/add_belief": Belief(stamp=1, belief=fact),
        "/carrier_a/add_desire": DesireItem(stamp=1, desire=desire),
        "/agents/requests": AgentRequest(
            stamp=1, id=word, sender=word, group="grippers", receiver="carrier_a", operation="check", belief=fact
        ),
    }


EFFECTS: dict[str, type[Message]] = {
    "/speech/status": SpeechStatus,
    "/speech/say": Utterance,
    "/head/command": HeadCommand,
    MOTION: JointTrajectory,
    "/carrier_a/belief_set": BeliefSet,
    "/carrier_a/desire_set": DesireSet,
    "/agents/replies": AgentReply,
}
TOLD = {"/speech/status", "/speech/say", "/head/command", "/carrier_a/belief_set", "/agents/replies"}
"""Topics that show the effects of authorized messages."""


@dataclass
class Effects:
    """Observed effects: counts by topic and content."""

    seen: Counter[tuple[str, str]] = field(default_factory=Counter)

    def note(self, topic: str, message: Message) -> None:
        match message:
            case SpeechStatus():
                self.seen[topic, f"{message.state} {message.text}"] += 1
            case Utterance():
                self.seen[topic, message.text] += 1
            case HeadCommand():
                self.seen[topic, f"{message.mode} {message.pan_rad} {message.cause}"] += 1
            case JointTrajectory():
                self.seen[topic, f"{message.positions[0]:.1f}"] += 1
            case BeliefSet() | DesireSet():
                for one in message.value:
                    self.seen[topic, str(one.name if isinstance(one, Desire) else one)] = 1  # published repeatedly
            case AgentReply():
                self.seen[topic, message.id] += 1

    def told(self) -> set[str]:
        """Topics with observed effects of authorized messages."""
        return {topic for (topic, what), _ in self.seen.items() if "friend" in what}


@dataclass(frozen=True)
class Stranger:
    """Generator of attacks on one topic, by their expected refusal reason."""

    topic: str
    realm: str
    keys: Keys
    genuine: str
    plain: str

    def attacks(self) -> Mapping[str, Callable[[int], str]]:
        """Return the attack texts by reason, each a function of a number."""
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

        own = Keys(self.keys.name, Ed25519PrivateKey.generate(), {})
        pretended, other_realm = self._stream(own), Stream(self.keys, "ROS domain 99", self.topic)
        unknown = self._stream(Keys("nobody", own.private, {}))
        moved = Stream(self.keys, self.realm, "/elsewhere")
        late = Stream(self.keys, self.realm, self.topic, now=lambda: time.time_ns() - HOUR)
        early = Stream(self.keys, self.realm, self.topic, now=lambda: time.time_ns() + HOUR)
        return {
            "unsealed": lambda number: self.plain,
            "unreadable": lambda number: f'{{"schema":"{SCHEMA}","sender":{number}}}',
            "unknown sender": lambda number: unknown.seal(self.plain),
            "forged": lambda number: (
                pretended.seal(self.plain), other_realm.seal(self.plain), self._altered(payload=self.plain),
                self._altered(number=number + 10**6, time=time.time_ns()),
            )[number % 4],
            "moved": lambda number: moved.seal(self.plain),
            "late": lambda number: late.seal(self.plain),
            "early": lambda number: early.seal(self.plain),
            "replayed": lambda number: self.genuine,
        }  # fmt: skip

    def _stream(self, keys: Keys) -> Stream:
        return Stream(keys, self.realm, self.topic)

    def _altered(self, **changes: object) -> str:
        return msgspec.json.encode(msgspec.json.decode(self.genuine) | changes).decode()


@contextmanager
def with_keys(folder: Path) -> Iterator[Keys]:
    """Set the keys in ``folder`` for this process and its children."""
    before = os.environ.get(KEYS_VARIABLE)
    os.environ[KEYS_VARIABLE] = str(folder)
    try:
        yield load_keys(folder)
    finally:
        if before is None:
            del os.environ[KEYS_VARIABLE]
        else:
            os.environ[KEYS_VARIABLE] = before


def refusals(latest: Mapping[str, Mapping[str, str]]) -> Counter[str]:
    """Return the refusals of all nodes by reason, from /diagnostics."""
    found: Counter[str] = Counter()
    for values in latest.values():
        for part in filter(None, values.get("refusals", "").split(", ")):
            count, _, reason = part.partition(" ")
            found[reason] += int(count)
    return found


def strangers(report: Report, plan: Plan) -> str:
    """Send attacks, and count effects and refusals."""
    environment.prepare(domain=plan.domain)
    folder = plan.records("strangers")
    count = plan.of(COUNT, QUICK_COUNT)
    (folder / "graph.yaml").write_text(GRAPH)
    new_key("robot", folder / "keys")
    with with_keys(folder / "keys") as keys:
        friendly, done, refused, begun_s = _besiege(plan, folder, keys, count)
    strange = Counter({key: done[key] - friendly[key] for key in done if done[key] != friendly[key]})
    wrong = {reason: refused[reason] for reason in REASONS if refused[reason] != _expected(reason, count)}
    report.add("strangers_said", "strangers: messages", count)
    report.add("strangers_seconds", "strangers: duration, s", round(begun_s, 1))
    report.add("strangers_executed", "strangers: executed commands", sum(strange.values()), 0)
    report.add("strangers_uncounted", "strangers: messages not counted as refused", count - refused.total(), 0)
    report.add("strangers_misjudged", "strangers: kinds counted under a wrong reason", len(wrong), 0)
    rows: dict[str, dict[str, Value]] = {reason: {"refused": refused[reason]} for reason in REASONS}
    report.tables["strangers"] = rows
    return f"{sum(strange.values())} of {count} executed, {refused.total()} counted, under {len(refused)} reasons"


def _expected(reason: str, count: int) -> int:
    return sum(_reason(number) == reason for number in range(count))


def _reason(number: int) -> str:
    return REASONS[number // len(say("")) % len(REASONS)]


def _besiege(
    plan: Plan, folder: Path, keys: Keys, count: int
) -> tuple[Counter[tuple[str, str]], Counter[tuple[str, str]], Counter[str], float]:
    """Return the effects before and after the attacks, the refusals, and the duration (s)."""
    from socialbot.bridge.graph_observer import LatestStatistics, observe_graph
    from socialbot.bridge.topics import publish_once

    graph = load_graph(str(folder / "graph.yaml"))
    effects, fates = Effects(), LatestStatistics(graph)
    with (
        observe_graph(EFFECTS, effects.note, fates.note) as watch,
        beside(plan, folder, "up", "up", folder / "graph.yaml", "--out", folder / "run"),
    ):
        await_(lambda: _standing(fates.latest, len(graph.nodes)), READY_S, "no graph", folder)
        mouths = {topic: Mouth(watch.ros, topic) for topic in say("")}
        for topic, message in say("friend").items():
            publish_once(watch.ros, topic, message, timeout_s=READY_S)
        await_(lambda: all(mouth.heard for mouth in mouths.values()), READY_S, "not all was heard", folder)
        await_(lambda: effects.told() >= TOLD, READY_S, "the friend was not obeyed", folder)
        await_(lambda: all(mouth.connected for mouth in mouths.values()), READY_S, "no connections", folder)
        time.sleep(3.0)  # authorized actions end
        friendly, begun = Counter(effects.seen), time.monotonic()
        words, realm = say("strange"), f"ROS domain {plan.domain}"
        attacks = [
            Stranger(topic, realm, keys, mouth.heard[0], msgspec.json.encode(words[topic]).decode()).attacks()
            for topic, mouth in mouths.items()
        ]
        for first in range(0, count, BATCH):
            for number in range(first, min(first + BATCH, count)):
                place = number % len(attacks)
                text = attacks[place][_reason(number)](number // len(attacks) // len(REASONS))
                list(mouths.values())[place].say(text)
            said = min(first + BATCH, count)
            await_(lambda said=said: refusals(fates.latest).total() >= said, COUNTED_S, "not all was counted", folder)
        took_s = time.monotonic() - begun
        time.sleep(3.0)  # wait for late effects
        return friendly, Counter(effects.seen), refusals(fates.latest), took_s


def _standing(latest: Mapping[str, Mapping[str, str]], nodes: int) -> bool:
    return sum(values.get("state") == "active" for values in latest.values()) == nodes


class Mouth:
    """Raw publisher and subscriber on one topic."""

    def __init__(self, ros: Any, topic: str) -> None:
        from std_msgs.msg import String

        from socialbot.bridge.qos import publisher_qos

        self._string = String
        self.heard: list[str] = []
        self._publisher = ros.create_publisher(String, topic, publisher_qos(Delivery.EVERY))
        self._hearing = ros.create_subscription(String, topic, self._hear, publisher_qos(Delivery.EVERY))

    def _hear(self, message: Any) -> None:
        if len(self.heard) < 1:
            self.heard.append(message.data)

    @property
    def connected(self) -> bool:
        """Whether another process subscribes."""
        return self._publisher.get_subscription_count() >= 2

    def say(self, text: str) -> None:
        """Publish ``text`` unchanged."""
        self._publisher.publish(self._string(data=text))
