"""Waldo in a corridor, and the people whom he sees there."""

from __future__ import annotations

from socialbot.agents.waldo.nodes import WaldoNode
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import ActionRequest, Message, Mind, PersonDetection, PersonDetections, TraceRecord
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig

DETECTIONS = "/humans/bodies/detections"
PERIOD_S = 0.1
GREETING, SEVERAL, OFFER = (
    parameter.default for parameter in (WaldoNode.greeting, WaldoNode.greeting_several, WaldoNode.offer)
)
FAR = WaldoNode.range_m.default + 0.1
"""Too far away (m) to be Waldo's business."""


def person(distance: float | None = 2.0, track: str = "") -> PersonDetection:
    return PersonDetection(x=0, y=0, w=10, h=30, score=1.0, track_id=track, distance_m=distance)


ANNA, BEN, CARL = (person(track=name) for name in ("t1", "t2", "t3"))


class Corridor:
    """Waldo in a corridor, seen ten times a second; what he does, and when (s)."""

    def __init__(self, **parameters: object) -> None:
        config = NodeConfig("waldo", WaldoNode, {"vanish_s": 1.5, **parameters})
        self.runner = InlineRunner(Graph("test", (config,), inputs=frozenset({DETECTIONS})))
        self.node = self.runner.nodes["waldo"]
        self.did: list[tuple[float, str]] = []
        self.said: list[str] = []
        self.trace: list[TraceRecord] = []
        self.minds: list[Mind] = []
        self.frame = 0
        self.faces: bool | None = None
        self.camera_ahead_s = 0.0
        self.shown: list[int] = []
        self.runner.tap("/waldo/actions", self._act)
        self.runner.tap("/waldo/trace", lambda _, record: self.trace.append(record))  # type: ignore[arg-type]
        self.runner.tap("/waldo/mind", lambda _, mind: self.minds.append(mind))  # type: ignore[arg-type]
        self.runner.start()

    def _act(self, topic: str, action: Message) -> None:
        assert isinstance(action, ActionRequest)
        self.did.append((action.stamp / SECOND, str(action.arguments[0]) if action.arguments else action.name))
        self.said += [str(sentence) for sentence in action.arguments[1:]]

    def see(self, *persons: PersonDetection, times: int = 1) -> None:
        for _ in range(times):
            now = self.frame * nanoseconds(PERIOD_S)
            stamp = now + nanoseconds(self.camera_ahead_s)
            if any(p.distance_m is None or p.distance_m <= WaldoNode.range_m.default for p in persons):
                self.shown.append(now)
            self.runner.feed(
                DETECTIONS,
                PersonDetections(
                    stamp=stamp, frame_id="camera", width=640, height=480, persons=persons, faces=self.faces
                ),
                time=now,
            )
            self.frame += 1

    def until(self, seconds: float, *persons: PersonDetection) -> None:
        """Frames with ``persons`` until ``seconds``, that moment not included."""
        while self.frame * PERIOD_S < seconds - 1e-9:
            self.see(*persons)

    def pattern(self, frames: str) -> None:
        """A frame for each digit: how many people it shows."""
        for digit in frames:
            self.see(*[person()] * int(digit))

    @property
    def faults(self) -> int:
        return self.runner.faults["waldo"].failures


# Who is who


def offers(corridor: Corridor) -> list[float]:
    return [when for when, what in corridor.did if what == "offer"]
