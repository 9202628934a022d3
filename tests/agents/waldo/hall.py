"""Talking Waldo in a hall, with a listener and a speaker, and the people whom he sees and hears there."""

from __future__ import annotations

from typing import TypeVar

from socialbot.agents.waldo import Listener, TalkingWaldo
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import HeardSpeech, PersonDetection, PersonDetections, TraceRecord
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.speaker import Speaker
from socialbot.testing import GraphTester

H = TypeVar("H", bound="Hall")
DETECTIONS, SPEECH = "/humans/bodies/detections", "/humans/voices/speech"


class Hall(GraphTester):
    """A hall, seen ten times a second; ``said`` lists the spoken sentences."""

    def __init__(
        self,
        agent: type[TalkingWaldo] = TalkingWaldo,
        *more: NodeConfig,
        inputs: tuple[str, ...] = (),
        start: int = 0,
        **parameters: object,
    ) -> None:
        nodes = (
            NodeConfig("waldo", agent, {"vanish_s": 1.5, **parameters}),
            NodeConfig("listener", Listener, {}),
            NodeConfig("speech", Speaker, {"playback": "off"}),
            *more,
        )
        super().__init__(Graph("test", nodes, inputs=frozenset({DETECTIONS, SPEECH, *inputs})), start=start)

    def __enter__(self: H) -> H:
        super().__enter__()
        return self

    def see(self, seconds: float, *tracks: str) -> None:
        """Let time pass with these people in view."""
        people = tuple(
            PersonDetection(x=0, y=0, w=10, h=30, score=1.0, track_id=track, distance_m=2.0) for track in tracks
        )
        for _ in range(round(seconds * 10)):
            stamp = self.clock.now()
            seen = PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=people)
            self.send(DETECTIONS, seen)
            self.runner.advance(stamp + nanoseconds(0.1))

    def hear(self, track: str, text: str, language: str = "en") -> None:
        """Let a person say something."""
        now = self.clock.now()
        speech = HeardSpeech(stamp=now, start=now - SECOND, text=text, language=language, confidence=0.9, person=track)
        self.send(SPEECH, speech)

    @property
    def said(self) -> list[str]:
        """Sentences that were spoken."""
        return [status.text for status in self.messages("/speech/status") if status.state == "started"]

    @property
    def trace(self) -> list[TraceRecord]:
        return self.messages("/waldo/trace")

    def believes(self) -> set[str]:
        return {str(one.belief) for one in self.node("waldo").engine.beliefs}

    def causes(self, record: TraceRecord) -> list[str]:
        """Ids from a record to its first cause."""
        known, chain = {one.id: one for one in self.trace}, [record.id]
        while record.cause:
            chain.append(record.cause)
            if record.cause not in known:
                break
            record = known[record.cause]
        return chain
