import sys
import threading
import time

import miniaudio
import numpy as np
import pytest

from socialbot.speech import playback
from socialbot.speech.playback import DevicePlayer, find_player
from socialbot.speech.synthesis import Sound
from tests.system.running import eventually

NULL = miniaudio.Backend.NULL
"""miniaudio's own device without hardware, which takes sound in real time and drops it."""


def tone(seconds: float) -> Sound:
    return Sound(np.arange(round(22050 * seconds), dtype=np.int16), 22050)


class End:
    """Callback that records its calls and thread."""

    def __init__(self) -> None:
        self.calls: list[str | None] = []
        self.thread: threading.Thread | None = None
        self._event = threading.Event()

    def __call__(self, error: str | None) -> None:
        self.calls.append(error)
        self.thread = threading.current_thread()
        self._event.set()

    def wait(self, timeout: float = 30.0) -> list[str | None]:
        assert self._event.wait(timeout)
        return self.calls


@pytest.fixture
def player():
    found = find_player([NULL])
    assert found is not None
    yield found
    found.stop()


def test_reports_the_end_once_from_another_thread(player):
    end = End()
    began = time.monotonic()
    player.play(tone(0.4), end)
    assert end.calls == []
    assert end.wait() == [None]
    assert time.monotonic() - began >= 0.4
    assert end.thread is not threading.main_thread()


def test_stopped_sound_reports_no_end(player):
    end = End()
    player.play(tone(60.0), end)
    player.stop()
    player.stop()
    assert end.calls == []
    assert not any(thread.name == "socialbot-playback" for thread in threading.enumerate())


def test_new_sound_stops_the_present_one(player):
    first, second = End(), End()
    player.play(tone(10.0), first)
    player.play(tone(0.1), second)
    assert second.wait() == [None]
    assert first.calls == []


def test_plays_several_sounds(player):
    for _ in range(3):
        end = End()
        player.play(tone(0.05), end)
        assert end.wait() == [None]


def test_reports_a_device_that_cannot_be_opened():
    end = End()
    DevicePlayer(miniaudio.Backend.COREAUDIO).play(tone(0.1), end)
    (error,) = end.wait()
    assert error is not None
    assert error.startswith("MiniaudioError")


def test_reports_a_device_that_stops_while_playing(player, monkeypatch):
    monkeypatch.setattr(playback, "_PATIENCE_S", 0.2)
    devices: list[miniaudio.PlaybackDevice] = []
    opening = playback.open_device

    def remember(backend: miniaudio.Backend, sample_rate: int) -> miniaudio.PlaybackDevice:
        devices.append(opening(backend, sample_rate))
        return devices[-1]

    monkeypatch.setattr(playback, "open_device", remember)
    end = End()
    player.play(tone(10.0), end)
    assert eventually(lambda: bool(devices) and devices[0].running)
    miniaudio.lib.ma_device_stop(devices[0]._device)
    assert end.wait() == ["the sound device takes no more sound"]


def test_reports_a_device_that_takes_no_sound(player, monkeypatch):
    monkeypatch.setattr(playback, "_PATIENCE_S", 0.1)
    monkeypatch.setattr(miniaudio.PlaybackDevice, "start", lambda *_: None)
    end = End()
    player.play(tone(0.1), end)
    assert end.wait() == ["the sound device takes no more sound"]


def test_all_samples_reach_the_device_in_order_with_silence_after_them():
    sound = tone(0.3)
    source = playback._Source(sound)
    frames = source.frames()
    taken = b""
    for wanted in (100, 1, 5000, 10**6):
        assert not source.over.is_set()
        taken += frames.send(wanted)
    with pytest.raises(StopIteration):
        frames.send(1)
    assert source.over.is_set()
    samples = np.frombuffer(taken, np.int16)
    assert np.array_equal(samples[: sound.samples.size], sound.samples)
    assert not samples[sound.samples.size :].any()
    assert samples.size / 22050 == pytest.approx(0.5)


def test_without_a_device_there_is_no_player():
    assert find_player([miniaudio.Backend.COREAUDIO]) is None
    assert isinstance(find_player([miniaudio.Backend.COREAUDIO, NULL]), DevicePlayer)


def test_without_the_library_there_is_no_player(monkeypatch):
    monkeypatch.setitem(sys.modules, "miniaudio", None)
    assert find_player() is None


def test_null_device_is_not_a_usual_backend():
    assert NULL not in playback.usual_backends("p")


def test_looking_for_a_device_never_fails():
    found = find_player()
    assert found is None or isinstance(found, DevicePlayer)
