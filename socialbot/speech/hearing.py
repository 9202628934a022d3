"""Hearing node: voice activity, speech recognition, and the interruption of the robot's own speech."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.core.messages import (
    AudioData,
    HeardSpeech,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    StopSpeech,
    VoiceActivity,
)
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.speech.audio import RATE_HZ, Converter, duration_ns, samples_of
from socialbot.speech.hearing_echo import FRAME, NO_ECHO_DB, BargeInDetector, EchoCanceller, OwnVoice
from socialbot.speech.recognition import RecognizedText, SpeechRecognizer, WhisperRecognizer
from socialbot.speech.voice_activity import (
    CHUNK,
    CHUNK_NS,
    SileroDetector,
    SpeechSegment,
    SpeechSegmenter,
    VoiceDetector,
    VoiceThresholds,
)

MOST_WAITING = 4
"""Longest queue of speech for recognition; beyond it the oldest is dropped and counted."""

_GAP_S = 0.25  # A longer gap in the sound ends speech.
_BEAT_S = 1.0  # Longest time between two messages about voice activity.
_SOUND_DEADLINE_S = 2.0
_CLIPPED = 32767
_CLIPPED_SHARE = 0.01
_WINDOW_S = 5.0


class SoundCheck:
    """Counter of clipped and of missing sound, in windows of `_WINDOW_S`."""

    def __init__(self) -> None:
        self._samples = self._clipped = self._zeros = 0

    def push(self, samples: np.ndarray, sample_rate: int) -> str | None:
        """Add int16 samples; at the end of a window return what is wrong with it, "" if nothing."""
        self._samples += samples.size
        self._clipped += int(np.count_nonzero(np.abs(samples.astype(np.int32)) >= _CLIPPED))
        self._zeros += samples.size - int(np.count_nonzero(samples))
        if self._samples < _WINDOW_S * sample_rate * samples.shape[1]:
            return None
        clipped, silent = self._clipped / self._samples, self._zeros == self._samples
        self._samples = self._clipped = self._zeros = 0
        if silent:
            return "the microphone sends only zeros; unmute it, or choose another one"
        if clipped >= _CLIPPED_SHARE:
            return f"{clipped:.0%} of the sound is clipped; lower the gain of the microphone"
        return ""


_RECENT_S = 1.0
_WITHIN_RAD = 0.35  # Largest angle between the sound and the person.
_FACING_RAD = 0.6


class SpeakerFinder:
    """Finds who speaks by the direction of the sound, else takes the person in view who faces the robot."""

    def __init__(self) -> None:
        self._seen: PersonDetections | None = None
        self._sound: tuple[int, float] | None = None

    def on_persons(self, detections: PersonDetections) -> None:
        self._seen = detections

    def on_direction(self, stamp: int, bearing_rad: float) -> None:
        """Set the direction of the sound, positive to the left; one that is not finite is ignored."""
        if math.isfinite(bearing_rad):
            self._sound = (stamp, bearing_rad)

    def find(self, time: int) -> tuple[str, float | None]:
        """Track id and bearing (rad) of the person who speaks at ``time`` (ns); "" or None if unknown."""
        seen = self._seen
        persons: list[PersonDetection] = []
        if seen is not None and abs(time - seen.stamp) <= nanoseconds(_RECENT_S):
            persons = [person for person in seen.persons if person.track_id]
        if self._sound is not None and abs(time - self._sound[0]) <= nanoseconds(_RECENT_S):
            return self._towards(self._sound[1], persons), self._sound[1]
        if len(persons) > 1:
            persons = [each for each in persons if each.facing_rad is not None and each.facing_rad <= _FACING_RAD]
        if len(persons) != 1:
            return "", None
        return persons[0].track_id, persons[0].bearing_rad

    @staticmethod
    def _towards(bearing: float, persons: list[PersonDetection]) -> str:
        near = [
            (abs(person.bearing_rad - bearing), person.track_id)
            for person in persons
            if person.bearing_rad is not None and abs(person.bearing_rad - bearing) <= _WITHIN_RAD
        ]
        return min(near)[1] if near else ""


class Hearing(Node):
    """Recognises what people say.

    While the robot speaks, and for the tail of its voice afterwards, nothing is heard. The tail is measured from the
    level of the sound after each utterance; ``tail_s`` counts before. If the speaker publishes its sound
    (``publish_sound``), the echo is removed, and a person who speaks then interrupts the robot and is heard.

    The speaker of a voice is the person in the direction of the sound, or else the only person in view, or the only one
    who faces the robot.

    Recognition runs in a thread of its own. With ``in_step`` the node takes the next sound only after it, so that a
    replay over ROS gives the same results each time; replays set it.
    """

    sound = Input(AudioData, "/audio", deadline_s=_SOUND_DEADLINE_S)
    status = Input(SpeechStatus, "/speech/status", optional=True)
    own_voice = Input(AudioData, "/speech/audio", optional=True)
    persons = Input(PersonDetections, "/humans/bodies/detections", Delivery.NEWEST, optional=True)
    direction = Input("geometry_msgs/msg/PoseStamped", "/sound_localization", Delivery.NEWEST, optional=True)
    speech = Output(HeardSpeech, "/humans/voices/speech")
    activity = Output(VoiceActivity, "/humans/voices/activity")
    stop_speech = Output(StopSpeech, "/speech/stop")

    model = Parameter("base", "speech model: base, tiny.en, or a folder with one", fixed=True)
    languages = Parameter("en", "languages to choose from, as in en,de (ISO 639-1)", fixed=True)
    vocabulary = Parameter("", "names and words to expect, as text", fixed=True)
    threads = Parameter(1, "threads of the recogniser", minimum=1, maximum=64, fixed=True)
    least_confidence = Parameter(0.3, "lowest confidence of a text that counts", minimum=0.0, maximum=1.0)
    speech_probability = Parameter(0.5, "probability of speech that begins it", minimum=0.05, maximum=0.95, fixed=True)
    silence_s = Parameter(0.5, "silence that ends speech, s", minimum=0.1, maximum=5.0, fixed=True)
    max_speech_s = Parameter(25.0, "longest speech, s; it is cut there", minimum=1.0, maximum=28.0, fixed=True)
    tail_s = Parameter(0.4, "time after the robot's own speech in which its echo is still heard, s", minimum=0.0)
    measure_tail = Parameter(True, "measure that time, from the first utterance on", fixed=True)
    barge_in = Parameter(True, "whether a person may interrupt the robot")
    in_step = Parameter(False, "recognise before the next sound is taken", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self.dropped = 0
        """Number of pieces of speech that were dropped because recognition is too slow."""
        self._recognizer: SpeechRecognizer | None = None
        self._detector: VoiceDetector | None = None
        self._canceller: EchoCanceller | None = None
        self._converter: Converter | None = None
        self._segmenter = SpeechSegmenter(
            VoiceThresholds(
                begin=self.speech_probability,
                end=0.7 * self.speech_probability,
                silence_s=self.silence_s,
                max_speech_s=self.max_speech_s,
            )
        )
        self._own = OwnVoice(self.tail_s, measures=self.measure_tail)
        self._barge_in = BargeInDetector()
        self._has_floor = False
        self._speaker = SpeakerFinder()
        self._check = SoundCheck()
        self._raw = np.zeros(0, np.int16)
        """Sound that is not a whole frame yet; it ends at ``_end``."""
        self._clean = np.zeros((3, 0), np.float32)
        """Sound as recorded and without echo that is not a whole chunk yet, and its rest (dB).

        It ends where ``_raw`` begins."""
        self._end = 0
        self._voices = 0
        self._active = False
        self._last_beat: int | None = None
        self._recognizing = False
        self._waiting: deque[tuple[SpeechSegment, VoiceActivity]] = deque()

    def start(self) -> None:
        """Load the networks.

        Raises:
            InstallationError: A package or the model is missing.
            ParameterError: The model does not know a language.
        """
        self._detector = self.find_detector()
        self._recognizer = self.find_recognizer()

    def stop(self) -> None:
        self._waiting.clear()

    def find_detector(self) -> VoiceDetector:
        """Return the detector of speech; subclasses may override it. Raises InstallationError."""
        return SileroDetector()

    def find_recognizer(self) -> SpeechRecognizer:
        """Return the recogniser; subclasses may override it. Raises InstallationError and ParameterError."""
        languages = tuple(filter(None, (each.strip().lower() for each in self.languages.split(","))))
        try:
            return WhisperRecognizer(self.model, languages, vocabulary=self.vocabulary, threads=self.threads)
        except ParameterError as error:
            raise ParameterError(error.what, where=f"{self.name}.{error.where}", remedy=error.remedy) from error

    def on_parameter(self, name: str) -> None:
        self._own.tail_s = self.tail_s

    @status
    def on_status(self, status: SpeechStatus) -> None:
        self._own.on_status(status)
        if status.state == "started":
            self._has_floor = False
            self._barge_in.reset()

    @own_voice
    def on_own_voice(self, sound: AudioData) -> None:
        self._own.on_sound(sound)

    @persons
    def on_persons(self, detections: PersonDetections) -> None:
        self._speaker.on_persons(detections)

    @direction
    def on_direction(self, pose: Any) -> None:
        at = pose.pose.position
        self._speaker.on_direction(pose.stamp, math.atan2(at.y, at.x))

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self._end_stream()

    @sound
    def on_sound(self, sound: AudioData) -> None:
        """Process a piece of sound. Raises MessageError if it is no sound that can be heard."""
        samples = samples_of(sound)
        if abs(sound.stamp - self._end) > nanoseconds(_GAP_S):
            self._end_stream()
        rate, channels = sound.sample_rate, sound.channels
        if self._converter is None or (self._converter.sample_rate, self._converter.channels) != (rate, channels):
            self._end_stream()
            self._converter = Converter(rate, channels)
        problem = self._check.push(samples, rate)
        if problem is not None:
            self.report_health("degraded" if problem else "ok", problem)
        self._raw = np.concatenate([self._raw, self._converter.push(samples)])
        self._end = sound.stamp + duration_ns(sound)
        self._take_frames()
        self._publish_activity()

    def _take_frames(self) -> None:
        """Remove the echo from whole frames, and process whole chunks."""
        count = self._raw.size - self._raw.size % FRAME
        if not count:
            return
        frames, begin = self._raw[:count], self._end - self._raw.size * SECOND // RATE_HZ
        self._raw = self._raw[count:]
        played = self._own.played(begin, count)
        clean, rest_db = frames, np.full(count // FRAME, NO_ECHO_DB)
        if played is not None:
            self._canceller = self._canceller or EchoCanceller()
            clean, rest_db = self._canceller.process(frames, played)
        added = np.stack([frames, clean, np.repeat(rest_db, FRAME)]).astype(np.float32)
        sound = np.concatenate([self._clean, added], axis=1)
        time = begin + (count - sound.shape[1]) * SECOND // RATE_HZ
        while sound.shape[1] >= CHUNK:
            raw, without = sound[:2, :CHUNK].astype(np.int16)
            self._take_chunk(raw, without, float(sound[2, CHUNK - 1]), time)
            sound, time = sound[:, CHUNK:], time + CHUNK_NS
        self._clean = sound

    def _take_chunk(self, raw: np.ndarray, clean: np.ndarray, rest_db: float, time: int) -> None:
        assert self._detector is not None
        probability = self._detector.probability(clean)
        self._own.push(time, time + CHUNK_NS, raw)
        if self._own.is_heard(time) and not self._has_floor:
            interrupts = self._barge_in.push(rest_db, probability)
            if self.barge_in and self._own.known and interrupts:
                self._has_floor = True
                self.stop_speech.publish(StopSpeech(stamp=self.clock.now(), reason="a person speaks"))
            else:
                probability = 0.0
        segment = self._segmenter.push(clean, time, probability)
        if segment is not None:
            self._on_segment(segment)
        elif self._segmenter.speaking and not self._active:
            self._active = True
            self._voices += 1
            self._last_beat = None

    def _end_stream(self) -> None:
        """End speech at a gap in the sound."""
        segment = self._segmenter.flush()
        if segment is not None:
            self._on_segment(segment)
        self._segmenter.reset()
        if self._detector is not None:
            self._detector.reset()
        self._converter = None
        self._raw, self._clean = np.zeros(0, np.int16), np.zeros((3, 0), np.float32)

    def _on_segment(self, segment: SpeechSegment) -> None:
        if not self._active:
            self._active = True
            self._voices += 1
        self._waiting.append((segment, self._voice(segment.end)))
        self._active, self._last_beat = False, None
        if len(self._waiting) > MOST_WAITING:
            self._waiting.popleft()
            self.dropped += 1
            self.log.warning("recognition is too slow: %d pieces of speech were dropped", self.dropped)
        self._recognize()

    def _recognize(self) -> None:
        """Recognise the waiting speech, one piece at a time."""
        recognizer = self._recognizer
        assert recognizer is not None
        while self._waiting and not self._recognizing:
            segment, voice = self._waiting.popleft()
            if self.in_step:
                self._publish_speech(segment, voice, recognizer.recognize(segment.samples))
                continue
            self._recognizing = True
            work = partial(recognizer.recognize, segment.samples)
            self.context.run_in_background(work, partial(self._on_recognized, segment, voice))

    def _on_recognized(
        self, segment: SpeechSegment, voice: VoiceActivity, result: RecognizedText | Exception | None
    ) -> None:
        self._recognizing = False
        if isinstance(result, Exception):
            self.log.warning("speech is not recognised: %s: %s", type(result).__name__, result)
        else:
            self._publish_speech(segment, voice, result)
        self._recognize()

    def _publish_speech(self, segment: SpeechSegment, voice: VoiceActivity, result: RecognizedText | None) -> None:
        if result is None or result.confidence < self.least_confidence:
            return
        self.speech.publish(
            HeardSpeech(
                stamp=segment.end,
                start=segment.start,
                text=result.text,
                alternatives=result.alternatives,
                language=result.language,
                confidence=round(result.confidence, 3),
                person=voice.person,
                voice=voice.voice,
            )
        )

    def _publish_activity(self) -> None:
        """Publish a change of the voice activity, and a heartbeat; in step, an answer to each sound."""
        last = self._last_beat
        if self.in_step or last is None or self._end - last >= nanoseconds(_BEAT_S):
            self._last_beat = self._end
            self.activity.publish(self._voice(self._end))

    def _voice(self, stamp: int) -> VoiceActivity:
        if not self._active:
            return VoiceActivity(stamp=stamp, active=False)
        person, bearing = self._speaker.find(stamp)
        return VoiceActivity(stamp=stamp, active=True, voice=f"voice{self._voices}", person=person, bearing_rad=bearing)
