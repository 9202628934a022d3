"""Sound as PCM: messages, WAV files and conversion."""

import struct
import sys
import wave
from pathlib import Path

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import DeviceError, InstallationError, MessageError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData
from socialbot.speech import audio
from socialbot.speech.audio import (
    RATE_HZ,
    Converter,
    WavFile,
    chunks_of,
    duration_ns,
    level_db,
    read_wav,
    samples_of,
)
from tests.speech.sounds import silence, tone


def write_wav(path: Path, samples: np.ndarray, rate: int, width: int = 2) -> Path:
    """Write int16 samples of shape (n,) or (n, channels) with a width in bytes."""
    samples = samples.reshape(len(samples), -1)
    with wave.open(str(path), "wb") as file:
        file.setnchannels(samples.shape[1])
        file.setsampwidth(width)
        file.setframerate(rate)
        if width == 1:
            file.writeframes(((samples >> 8) + 128).astype(np.uint8).tobytes())
        else:
            wide = samples.astype(np.int64) << (8 * (width - 2))
            file.writeframes(wide.astype("<i8").reshape(-1, 1).view(np.uint8)[:, :width].tobytes())
    return path


def frequency(samples: np.ndarray, rate: int = RATE_HZ) -> float:
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(samples.size)))
    return float(np.fft.rfftfreq(samples.size, 1 / rate)[int(np.argmax(spectrum))])


def test_samples_of_a_stereo_message() -> None:
    sound = AudioData(stamp=0, samples=struct.pack("<4h", 1, -1, 2, -2), sample_rate=8000, channels=2)
    assert samples_of(sound).tolist() == [[1, -1], [2, -2]]
    assert duration_ns(sound) == 2 * SECOND // 8000


@pytest.mark.parametrize("rate", [7999, 96001, 1])
def test_message_with_an_unusable_rate_is_refused(rate: int) -> None:
    with pytest.raises(MessageError, match=f"sound of {rate} Hz is not supported"):
        samples_of(AudioData(stamp=0, samples=b"\0\0", sample_rate=rate))


@pytest.mark.parametrize("channels", [33, 2**62])
def test_message_of_many_channels_is_refused(channels: int) -> None:
    with pytest.raises(MessageError, match="channels is not supported"):
        samples_of(AudioData(stamp=1, samples=b"", sample_rate=16000, channels=channels))


def test_message_with_half_a_sample_is_refused() -> None:
    with pytest.raises(MessageError, match="3 bytes are no whole samples of 1 channels"):
        samples_of(AudioData(stamp=0, samples=b"\0\0\0", sample_rate=16000))


def test_levels() -> None:
    assert level_db(silence(0.1)) == -100
    assert level_db(np.zeros(0, np.int16)) == -100
    assert level_db(tone(0.5, 32767)) == pytest.approx(-3.01, abs=0.01)


@pytest.mark.parametrize("rate", [8000, 11025, 16000, 22050, 32000, 44100, 48000, 96000])
@pytest.mark.parametrize("channels", [1, 2])
def test_conversion_keeps_pitch_and_duration_of_any_rate(rate: int, channels: int) -> None:
    if rate != RATE_HZ:
        pytest.importorskip("av")
    wave_form = 8000 * np.sin(2 * np.pi * 440 * np.arange(rate) / rate)
    samples = np.repeat(np.rint(wave_form).astype(np.int16)[:, None], channels, axis=1)
    converter = Converter(rate, channels)
    made = np.concatenate([converter.push(piece) for piece in np.array_split(samples, 23)])
    assert abs(made.size - RATE_HZ) <= RATE_HZ * 0.005
    assert frequency(made) == pytest.approx(440, abs=2)
    assert level_db(made) == pytest.approx(level_db(samples), abs=0.3)


def test_conversion_without_pyav_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    assert Converter(RATE_HZ, 1).push(np.ones((3, 1), np.int16)).tolist() == [1, 1, 1]
    with pytest.raises(InstallationError, match="PyAV is not installed") as caught:
        Converter(44100, 1)
    assert caught.value.remedy == extra_command("hear")


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_wav_files_of_any_width(tmp_path: Path, width: int) -> None:
    samples = np.array([[0, 256], [-512, 32512], [-32768, 1024]], np.int16)
    file = WavFile(write_wav(tmp_path / "sound.wav", samples, 16000, width))
    assert (file.sample_rate, file.channels, file.frames) == (16000, 2, 3)
    assert file.read(2) + file.read(2) == samples.astype("<i2").tobytes()
    assert file.read(2) == b""


def test_wav_file_with_the_extensible_header(tmp_path: Path) -> None:
    path = write_wav(tmp_path / "sound.wav", np.arange(100, dtype=np.int16), 16000)
    plain = path.read_bytes()
    guid = b"\x01\x00\x00\x00\x00\x00\x10\x00\x80\x00\x00\xaa\x00\x38\x9b\x71"
    fmt = struct.pack("<HHIIHHHHI", 0xFFFE, 1, 16000, 32000, 2, 16, 22, 16, 4) + guid
    body = b"WAVEfmt " + struct.pack("<I", len(fmt)) + fmt + plain[plain.index(b"data") :]
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)
    assert read_wav(path).tolist() == list(range(100))


def test_read_wav_converts(tmp_path: Path) -> None:
    pytest.importorskip("av")
    path = write_wav(tmp_path / "sound.wav", np.repeat(tone(1.0)[:, None], 2, axis=1), 48000)
    assert read_wav(path).size == pytest.approx(RATE_HZ / 3, abs=20)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "truncated"),
        (b"not a sound at all", "RIFF"),
        (b"RIFF\x04\0\0\0WAVE", "fmt chunk"),
        (b"RIFF\x14\0\0\0WAVEjunk\xff\xff\xff\x7fdata\0\0\0\0", "truncated"),
    ],
)
def test_file_without_sound_is_refused(tmp_path: Path, content: bytes, why: str) -> None:
    path = tmp_path / "sound.wav"
    path.write_bytes(content)
    with pytest.raises(DeviceError, match=why) as caught:
        WavFile(path)
    assert caught.value.where == str(path)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="No such file"):
        WavFile(tmp_path / "none.wav")


def test_file_of_a_rate_out_of_range_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="4000 Hz are not supported"):
        WavFile(write_wav(tmp_path / "sound.wav", silence(0.1), 4000))


def header(*, channels: int = 1, rate: int = 16000, bits: int = 16, claimed: int = 0xFFFFFFF0) -> bytes:
    """Header of a WAV file that claims to hold almost 4 GiB."""
    size = channels * bits // 8
    fmt = struct.pack("<HHIIHH", 1, channels, rate, min(rate * size, 0xFFFFFFFF), size & 0xFFFF, bits)
    return (
        b"RIFF"
        + struct.pack("<I", 0xFFFFFFFF)
        + b"WAVEfmt "
        + struct.pack("<I", len(fmt))
        + fmt
        + b"data"
        + (struct.pack("<I", claimed))
    )


def test_a_truncated_file_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "sound.wav"
    path.write_bytes(header(channels=2) + np.arange(6, dtype="<i2").tobytes() + b"half")
    file = WavFile(path)
    assert file.frames < 100
    assert np.frombuffer(file.read(96000), "<i2").tolist()[:6] == [0, 1, 2, 3, 4, 5]
    assert file.read(96000) == b""
    path.write_bytes(header() + b"\1")
    assert read_wav(path).size == 0


@pytest.mark.parametrize("channels", [33, 65535])
def test_a_file_of_many_channels_is_refused(tmp_path: Path, channels: int) -> None:
    path = tmp_path / "sound.wav"
    path.write_bytes(header(channels=channels))
    with pytest.raises(DeviceError, match=f"{channels} channels are not supported"):
        WavFile(path)


def test_a_long_file_is_not_read_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audio, "DATA_BYTES", 2 << 20)
    path = tmp_path / "sound.wav"
    with path.open("wb") as file:
        file.write(header())
        file.truncate(2 << 20)
    assert read_wav(path).size
    with path.open("ab") as file:
        file.truncate(3 << 20)
    with pytest.raises(DeviceError, match="more than 2 MiB of sound"):
        read_wav(path)


def test_chunks_are_stamped_without_gaps() -> None:
    chunks = chunks_of(tone(0.12), start=SECOND)
    assert [chunk.stamp for chunk in chunks] == [SECOND, SECOND + SECOND // 20, SECOND + SECOND // 10]
    assert b"".join(chunk.samples for chunk in chunks) == tone(0.12).tobytes()
