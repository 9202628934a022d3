"""Speech and hearing of ROS robots: text to speech by an action or topic, and recognised speech."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial
from typing import Any

from socialbot.core.messages import HeardSpeech, RosMessage, Utterance
from socialbot.graph.calls import CallResult, PendingCall, make_message
from socialbot.graph.node import Node
from socialbot.graph.ports import Input, Output, Parameter
from socialbot.graph.services import ActionClient, ClientPort
from socialbot.speech.playback import OnEnd
from socialbot.speech.speaker import Speaker, SpeechVoice
from socialbot.speech.synthesis import Sound

LONGEST_S = 30.0
"""Default time limit of an utterance."""


class _NoVoice:
    """Voice of a robot that synthesizes speech itself."""

    def say(self, text: str) -> Sound:
        raise NotImplementedError("the robot speaks")


class RobotSpeaker(Speaker):
    """Speaker of a robot that synthesizes speech itself, with the queue and status of `Speaker`."""

    def find_voice(self) -> SpeechVoice:
        return _NoVoice()

    def find_player(self) -> None:
        return None


class ActionSpeaker(RobotSpeaker):
    """Speaker that sends each utterance as the goal of an action; subclasses declare the client ``speak``.

    An utterance fails with its goal. When the node stops, its goal is cancelled.
    """

    speak: Any

    limit_s = Parameter(LONGEST_S, "time limit of an utterance, s", minimum=1.0, maximum=600.0)

    _goal: PendingCall | None = None

    def goal(self, utterance: Utterance) -> Mapping[str, Any]:
        """Return the fields of the goal for an utterance."""
        raise NotImplementedError

    def failure(self, result: Any) -> str:
        """Return the reason of a failure from the result of a goal that succeeded; empty if there is none."""
        raise NotImplementedError

    def perform(self, utterance: Utterance, on_end: OnEnd) -> str:
        then = partial(self._on_result, on_end)
        self._goal = self.speak.send_goal(self.goal(utterance), then, deadline_s=self.limit_s)
        return ""

    def hush(self) -> None:
        if self._goal is not None:
            self._goal.cancel()

    def on_server(self, port: ClientPort, *, present: bool) -> None:
        self.report_health(
            "ok" if present else "degraded", "" if present else f"no action server {port.topic}: start the robot's TTS"
        )

    def _on_result(self, on_end: OnEnd, result: CallResult) -> None:
        self._goal = None
        if not result.ok:
            on_end(getattr(result.message, "error_msg", "") or result.reason or result.outcome)
        else:
            on_end(self.failure(result.message) or None)


class TtsSpeaker(ActionSpeaker):
    """Speaker by the text-to-speech action of ROS4HRI (tts_msgs/action/TTS)."""

    speak = ActionClient("tts_msgs/action/TTS", "/tts_engine/tts")

    locale = Parameter("", "language, such as en_GB; empty: the robot's")
    tts_voice = Parameter("", "voice of the robot; empty: its usual one")

    def goal(self, utterance: Utterance) -> Mapping[str, Any]:
        return {"input": utterance.text, "locale": self.locale, "voice": self.tts_voice}

    def failure(self, result: Any) -> str:
        return getattr(result, "error_msg", "")


class SaySkillSpeaker(ActionSpeaker):
    """Speaker by the say skill of ROS4HRI (communication_skills/action/Say)."""

    speak = ActionClient("communication_skills/action/Say", "/skill/say")

    def goal(self, utterance: Utterance) -> Mapping[str, Any]:
        return {"meta": {"caller": self.name, "priority": _NORMAL_PRIORITY}, "input": utterance.text}

    def failure(self, result: Any) -> str:
        answer = getattr(result, "result", None)
        code = getattr(answer, "error_code", 0)
        return (getattr(answer, "error_msg", "") or f"error {code}") if code else ""


_NORMAL_PRIORITY = 128


class TopicSpeaker(RobotSpeaker):
    """Speaker by a topic of texts (std_msgs/String), such as /speech of naoqi_driver.

    The robot does not report the end of speech. It is estimated from the number of words and ``rate_wpm``.
    """

    text = Output("std_msgs/msg/String", "/speech")

    def perform(self, utterance: Utterance, on_end: OnEnd) -> str:
        self.text.publish(make_message("std_msgs/msg/String", {"data": utterance.text}))
        words = len(utterance.text.split()) + 1
        self.call_after(60.0 * words / self.rate_wpm, partial(on_end, None))
        return ""

    def hush(self) -> None:
        """A robot without an end of speech cannot be interrupted."""


class RobotEars(Node):
    """Publishes each sentence that a robot's own speech recognition understood (hri_msgs/msg/LiveSpeech)."""

    speech = Input("hri_msgs/msg/LiveSpeech", "/humans/voices/anonymous_speaker/speech")
    heard = Output(HeardSpeech, "/humans/voices/speech")

    voice = Parameter("anonymous_speaker", "id of the voice")
    least_confidence = Parameter(0.0, "lowest confidence of a sentence", minimum=0.0, maximum=1.0)

    _start = 0
    """Stamp (ns) of the first words of a sentence."""

    @speech
    def on_speech(self, message: RosMessage) -> None:
        self._start = self._start or message.stamp
        text = message.final.strip()
        if not text:
            return
        start, self._start = self._start, 0
        confidence = min(max(float(message.confidence), 0.0), 1.0) if math.isfinite(message.confidence) else 0.0
        if confidence >= self.least_confidence:
            self.heard.publish(
                HeardSpeech(
                    stamp=message.stamp,
                    start=start,
                    text=text,
                    language=re.split("[-_]", message.language)[0].lower(),
                    confidence=confidence,
                    voice=self.voice,
                )
            )
