"""The microphone node: files, devices, and devices that fail."""

import sys
from collections.abc import Callable
from pathlib import Path

import miniaudio
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import DeviceError, InstallationError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData, Health, Message
from socialbot.core.paths import FOLDERS_VARIABLE
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech import microphone
from socialbot.speech.audio import duration_ns
from socialbot.speech.microphone import Capture, Microphone, OnSound
from tests.speech.sounds import tone
from tests.speech.test_audio import write_wav
from tests.system.running import eventually

NULL = miniaudio.Backend.NULL


class Source:
    """A microphone node in the inline runner, and its sound."""

    def __init__(self, kind: type[Microphone] = Microphone, **parameters: object) -> None:
        config = NodeConfig("microphone", kind, parameters)
        self.runner = InlineRunner(Graph("test", (config,)), start=SECOND)
        self.sounds: list[AudioData] = []
        self.runner.tap("/audio", self._note)
        self.runner.start()

    def _note(self, topic: str, message: Message) -> None:
        assert isinstance(message, AudioData)
        assert message.stamp + duration_ns(message) <= self.runner.clock.now()
        self.sounds.append(message)

    @property
    def state(self) -> str:
        return self.health.state

    @property
    def health(self) -> Health:
        context = self.runner.context_of("microphone")
        assert context is not None
        return context.health_monitor.health()

    def until(self, seconds: float) -> None:
        self.runner.advance(round(seconds * SECOND))


@pytest.fixture
def wav(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    write_wav(tmp_path / "sound.wav", tone(0.52), 16000)
    return "sound.wav"


def test_file_is_published_in_real_time(wav: str) -> None:
    source = Source(source=wav)
    source.until(1.31)
    assert [each.stamp for each in source.sounds] == [SECOND + n * SECOND // 20 for n in range(6)]
    source.until(3)
    assert b"".join(each.samples for each in source.sounds) == tone(0.52).tobytes()
    assert source.state == "waiting"


def test_file_restarts_with_loop(wav: str) -> None:
    source = Source(source=wav, loop=True)
    source.until(2.1)
    assert b"".join(each.samples for each in source.sounds)[: 4 * 8320] == 2 * tone(0.52).tobytes()
    assert source.state == "ok"


def test_missing_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DeviceError, match="No such file"):
        Source(source="none.wav")
    with pytest.raises(DeviceError, match="No such file"):
        Microphone.expect_available({"source": "none.wav"})


def test_file_outside_of_the_folders_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.delenv(FOLDERS_VARIABLE, raising=False)
    write_wav(tmp_path / "sound.wav", tone(0.1), 16000)
    with pytest.raises(ParameterError, match="is outside of"):
        Source(source=str(tmp_path / "sound.wav"))


def test_capture_of_a_real_device() -> None:
    got: list[bytes] = []
    capture = Capture("default", 16000, 1, 0.02, got.append, backends=[NULL])
    try:
        assert eventually(lambda: sum(map(len, got)) >= 3200)
    finally:
        capture.close()
    assert {len(data) % 2 for data in got} == {0}


def test_unknown_device_lists_the_known_ones() -> None:
    with pytest.raises(DeviceError, match="no such microphone") as caught:
        Capture("Studio 9000", 16000, 1, 0.02, lambda data: None, backends=[NULL])
    assert "NULL Capture Device" in str(caught.value.remedy)


def test_without_a_device_the_reason_is_a_sentence() -> None:
    backend = miniaudio.Backend.SNDIO  # of another system
    with pytest.raises(DeviceError, match=r"no microphone \([a-z ]+\)") as caught:
        Capture("default", 16000, 1, 0.02, lambda data: None, backends=[backend])
    assert "plug one in" in str(caught.value.remedy)


def test_refused_permission_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may read every device, so the permission is made up."""
    (tmp_path / "pcmC0D0c").touch()
    monkeypatch.setattr(microphone, "SOUND_DEVICES", tmp_path)
    monkeypatch.setattr(microphone.os, "access", lambda path, mode: False)
    backend = miniaudio.Backend.SNDIO  # of another system
    with pytest.raises(DeviceError, match="no microphone") as caught:
        Capture("default", 16000, 1, 0.02, lambda data: None, backends=[backend])
    assert caught.value.remedy == (
        f"permission for {tmp_path / 'pcmC0D0c'} is refused: add the user to the group 'audio', and log in again"
    )


def test_missing_package_is_one_clear_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "miniaudio", None)
    with pytest.raises(InstallationError, match="miniaudio is not installed") as caught:
        Capture("default", 16000, 1, 0.02, lambda data: None)
    assert caught.value.remedy == extra_command("hear")


class Plug:
    """Device that a test feeds."""

    def __init__(self) -> None:
        self.on_sound: Callable[[bytes], None] | None = None
        self.present = True
        self.opened = 0

    def open(self, on_sound: OnSound) -> "Plug":
        if not self.present:
            raise DeviceError("no microphone", where="default", remedy="plug one in")
        self.on_sound, self.opened = on_sound, self.opened + 1
        return self

    def close(self) -> None:
        self.on_sound = None


PLUG = Plug()


class Plugged(Microphone):
    """Microphone whose device is `PLUG`."""

    def open_device(self, on_sound: OnSound) -> Plug:
        return PLUG.open(on_sound)


@pytest.fixture
def plug(monkeypatch: pytest.MonkeyPatch) -> Plug:
    made = Plug()
    monkeypatch.setattr(sys.modules[__name__], "PLUG", made)
    return made


def speak(source: Source, plug: Plug, *times: float) -> None:
    for time in times:
        source.until(time)
        assert plug.on_sound is not None
        plug.on_sound(tone(0.05).tobytes())
        source.until(time)


def test_bursts_are_stamped_one_after_the_other(plug: Plug) -> None:
    source = Source(Plugged)
    speak(source, plug, 1.05, 1.16, 1.161, 1.2)
    assert [each.stamp for each in source.sounds] == [SECOND + n * SECOND // 20 for n in range(4)]


def test_lost_sound_is_a_gap(plug: Plug) -> None:
    source = Source(Plugged)
    speak(source, plug, 1.05, 1.8)
    assert [each.stamp / SECOND for each in source.sounds] == [1.0, 1.75]


def test_missing_microphone_is_reported_once_and_retried(plug: Plug, caplog: pytest.LogCaptureFixture) -> None:
    plug.present = False
    source = Source(Plugged)
    source.until(8)
    assert source.state == "failed"
    assert source.health.reason == "default: no microphone; plug one in; retried every 2 s"
    assert caplog.text.count("default: no microphone; plug one in; retried every 2 s") == 1
    plug.present = True
    source.until(9.5)
    speak(source, plug, 9.6)
    assert source.state == "ok"
    assert len(source.sounds) == 1


def test_unplugged_microphone_is_opened_again(plug: Plug, caplog: pytest.LogCaptureFixture) -> None:
    source = Source(Plugged)
    speak(source, plug, 1.05, 1.1)
    source.until(2.5)
    assert source.state == "failed"
    assert "default: no more sound; check the connection; retried every 2 s" in caplog.text
    source.until(4.3)
    assert plug.opened == 2
    speak(source, plug, 4.4)
    assert source.state == "ok"
    assert source.sounds[-1].stamp / SECOND == pytest.approx(4.35)
