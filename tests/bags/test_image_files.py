"""Image and video files that claim more pixels than the memory holds."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.bags.conversion import import_bag
from socialbot.bags.image_files import SUFFIXES, open_video, read_image, video_stamps
from socialbot.core.errors import BagError, DeviceError, ImageError
from socialbot.core.limits import JPEG_SCANS
from socialbot.core.messages import CompressedImage
from socialbot.vision.camera_node import open_frames
from socialbot.vision.images import bgr_from_compressed
from socialbot.vision.metrics.formats.yolo import image_size

SIDE = 60_000  # 3.6 gigapixels


def png_part(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width: int, height: int) -> bytes:
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes(1_000_000))
    return b"\x89PNG\r\n\x1a\n" + png_part(b"IHDR", head) + png_part(b"IDAT", rows) + png_part(b"IEND", b"")


def bmp(width: int, height: int) -> bytes:
    content = bytes(1000)
    return (
        b"BM"
        + struct.pack("<IHHI", 54 + len(content), 0, 0, 54)
        + struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)
        + content
    )


def ppm(width: int, height: int) -> bytes:
    return f"P6 {width} {height} 255\n".encode() + bytes(1000)


@pytest.mark.parametrize(("suffix", "make"), [(".png", png), (".bmp", bmp), (".ppm", ppm)])
@pytest.mark.parametrize(
    "read",
    [
        read_image,
        lambda path: open_frames(str(path.parent)),
        lambda path: import_bag(str(path.parent), path.parent / "bag"),
    ],
    ids=["file", "camera", "import"],
)
def test_a_gigapixel_image_is_refused(
    tmp_path: Path, suffix: str, make: Callable[[int, int], bytes], read: Callable[[Path], object]
) -> None:
    path = tmp_path / f"image{suffix}"
    path.write_bytes(make(SIDE, SIDE))
    with pytest.raises((ImageError, BagError), match=r"more than 34 million pixels|cannot be decoded"):
        read(path)


@pytest.mark.parametrize("suffix", sorted(SUFFIXES))
def test_images_of_all_suffixes_are_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"image{suffix}"
    assert cv2.imwrite(str(path), np.full((4, 6, 3), 200, np.uint8))
    assert read_image(path).shape == (4, 6, 3)
    assert image_size(path) == (6, 4)


@pytest.mark.parametrize("content", [b"", b"text"])
def test_other_files_are_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "image.png").write_bytes(content)
    with pytest.raises(ImageError, match="cannot be decoded") as caught:
        read_image(tmp_path / "image.png")
    assert caught.value.where == str(tmp_path / "image.png")


def test_a_truncated_png_is_refused_before_its_lengths_are_allocated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenCV allocated 3 GB for the 84 bytes of a file that ends within its second part."""
    (tmp_path / "whole.png").write_bytes(png(8, 6) + b"trailing bytes")
    (tmp_path / "cut.png").write_bytes(png(8, 6)[:60])
    assert read_image(tmp_path / "whole.png").shape == (6, 8, 3)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("OpenCV reads the file"))
    with pytest.raises(ImageError, match="the file is truncated"):
        read_image(tmp_path / "cut.png")


def test_a_video_of_huge_frames_is_refused(tmp_path: Path) -> None:
    small, large = tmp_path / "small.avi", tmp_path / "large.avi"
    for path, size in ((small, (64, 48)), (large, (8192, 4200))):
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, size)
        writer.write(np.zeros((size[1], size[0], 3), np.uint8))
        writer.release()
    open_video(small).release()
    with pytest.raises(ImageError, match="more than 34 million pixels"):
        open_video(large)
    with pytest.raises(ImageError, match="No such file"):
        open_video(tmp_path / "none.avi")
    (tmp_path / "text.avi").write_text("no video")
    with pytest.raises(ImageError, match="cannot be opened"):
        open_video(tmp_path / "text.avi")


def film(path: Path, code: str = "MJPG") -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 10, (64, 48))
    assert writer.isOpened()
    for level in range(5):
        writer.write(np.full((48, 64, 3), 50 * level, np.uint8))
    writer.release()
    return path


def with_fragment(film: bytes, samples: int) -> bytes:
    """An MP4 film with a fragment that says that it has so many samples."""

    def box(name: bytes, *content: bytes | int) -> bytes:
        body = b"".join(each if isinstance(each, bytes) else struct.pack(">I", each) for each in content)
        return struct.pack(">I", 8 + len(body)) + name + body

    defaults = box(b"mvex", box(b"trex", 0, 1, 1, 1024, 1, 0))
    begin = film.index(b"moov") - 4
    end = begin + int.from_bytes(film[begin : begin + 4], "big")
    part = box(b"traf", box(b"tfhd", 0x020000, 1), box(b"trun", 0, samples))
    head = struct.pack(">I", end - begin + len(defaults)) + film[begin + 4 : end] + defaults
    return film[:begin] + head + film[end:] + box(b"moof", box(b"mfhd", 0, 1), part) + box(b"mdat", bytes(100))


READS = """
import sys
from pathlib import Path
from socialbot.bags.image_files import open_video, video_stamps
from socialbot.bags.sound import has_decoder, video_sound
from socialbot.core.errors import SocialbotError
from socialbot.vision.camera_node import open_frames
def frames(path):
    source = open_frames(path)
    while source.read() is not None:
        pass
def peak_mb():
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) // 1000
before = peak_mb()
for read in (lambda path: list(video_stamps(open_video(path))), frames, lambda path: list(video_sound(Path(path), 0))):
    try:
        read(sys.argv[1])
    except SocialbotError as error:
        print(error)
print(peak_mb() - before)
"""


def test_the_index_of_a_small_video_does_not_take_all_memory(tmp_path: Path) -> None:
    """1.3 KB took 3 GB."""
    path = film(tmp_path / "large.mp4", "mp4v")
    path.write_bytes(with_fragment(path.read_bytes(), 88_000_000))
    output = subprocess.run([sys.executable, "-c", READS, path], capture_output=True, text=True, check=True).stdout
    assert int(output.splitlines()[-1]) < 600, output
    assert "large.mp4: cannot be opened" in output


@pytest.mark.parametrize(
    ("name", "code"),
    [("a.avi", "MJPG"), ("a.mp4", "mp4v"), ("a.mov", "mp4v"), ("a.mkv", "mp4v"), ("a.webm", "VP80"), ("a.ts", "mp4v"),
     ("a.wmv", "WMV2"), ("a.flv", "FLV1"), ("a.ogv", "VP80"), ("a.m4v", "mp4v")],
)  # fmt: skip
def test_videos_of_usual_formats_are_read(tmp_path: Path, name: str, code: str) -> None:
    capture = open_video(film(tmp_path / name, code))
    assert sum(1 for _ in video_stamps(capture)) >= 4


@pytest.mark.parametrize("name", ["live.m3u8", "film.mp4", "film.ffconcat"])
@pytest.mark.parametrize(
    "text",
    [
        # Without an end, players read it again and again.
        "#EXTM3U\n#EXT-X-VERSION:3\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{film}\n",
        "#EXTM3U\n#EXT-X-VERSION:3\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{film}\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile private.mp4\nfile {own}\n",
    ],
)
def test_a_playlist_is_no_video(tmp_path: Path, name: str, text: str) -> None:
    """It would show the film of somebody else, and may never end."""
    other = film(tmp_path / "private.mp4", "mp4v")
    path = tmp_path / name
    path.write_text(text.format(film=other, own=name))
    with pytest.raises(ImageError, match="cannot be opened as a video: no known format"):
        open_video(path)
    with pytest.raises(DeviceError, match="cannot be opened as a video: no known format"):
        open_frames(str(path))


def jpeg_of_scans(scans: int) -> bytes:
    """A progressive JPEG of 640x480 whose scans repeat the first one; each is a few bytes."""

    def segment(marker: int, content: bytes) -> bytes:
        return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content

    blocks = 80 * 60
    one_code = bytes([1]) + bytes(15)
    head = segment(0xDB, bytes(1) + bytes([1] * 64)) + segment(
        0xC2, struct.pack(">BHHBBBB", 8, 480, 640, 1, 1, 0x11, 0)
    )
    tables = segment(0xC4, bytes([0]) + one_code + bytes([0])) + segment(0xC4, bytes([0x10]) + one_code + bytes([0xE0]))
    dc = segment(0xDA, bytes([1, 1, 0, 0, 0, 0])) + bytes(blocks // 8)
    ac = segment(0xDA, bytes([1, 1, 0, 1, 63, 0])) + bytes(2)  # one run of empty blocks
    return b"\xff\xd8" + head + tables + dc + ac * (scans - 1) + b"\xff\xd9"


def test_a_jpeg_of_many_scans_is_refused(tmp_path: Path) -> None:
    """Each scan takes time for all pixels: a megabyte of them minutes."""

    def message(data: bytes) -> CompressedImage:
        return CompressedImage(stamp=0, frame_id="", format="jpeg", data=np.frombuffer(data, np.uint8))

    path = tmp_path / "image.jpg"
    path.write_bytes(jpeg_of_scans(JPEG_SCANS))
    assert read_image(path).shape == bgr_from_compressed(message(path.read_bytes())).shape == (480, 640, 3)
    path.write_bytes(jpeg_of_scans(JPEG_SCANS + 1))
    with pytest.raises(ImageError, match="scans"):
        read_image(path)
    with pytest.raises(ImageError, match="scans"):
        bgr_from_compressed(message(path.read_bytes()))


def turned_jpeg(pixels: np.ndarray) -> bytes:
    """A JPEG that is stored with the left side up, as cameras held upright do."""
    tiff = b"II*\0" + struct.pack("<IHHHIII", 8, 1, 0x112, 3, 1, 6, 0)
    exif = b"Exif\0\0" + tiff
    data = cv2.imencode(".jpg", cv2.rotate(pixels, cv2.ROTATE_90_COUNTERCLOCKWISE))[1].tobytes()
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]


def test_images_of_a_file_are_turned_as_they_are_shown(tmp_path: Path) -> None:
    shown = np.zeros((160, 120, 3), np.uint8)
    shown[:40] = 200
    path = tmp_path / "a.jpg"
    path.write_bytes(turned_jpeg(shown))
    assert image_size(path) == (120, 160)
    for pixels in (read_image(path), open_frames(str(tmp_path)).read()):
        assert pixels is not None
        np.testing.assert_allclose(pixels, shown, atol=8)
    assert import_bag(str(tmp_path), tmp_path / "bag").height == 160
    # Pixels of a camera are those of the sensor, which its CameraInfo describes.
    message = CompressedImage(stamp=0, frame_id="", format="jpeg", data=np.frombuffer(path.read_bytes(), np.uint8))
    assert bgr_from_compressed(message).shape == (120, 160, 3)


def test_images_of_other_formats_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Phones save photos as HEIC."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("b.HEIC", "c.gif", "notes.txt"):
        (folder / name).write_bytes(b"x")
    told = "2 images are left out, the first: b.HEIC; convert to jpg or png"
    for read in (lambda: open_frames(str(folder)), lambda: import_bag(str(folder), tmp_path / "bag")):
        with pytest.raises((BagError, DeviceError), match="no images in this folder") as caught:
            read()
        assert caught.value.remedy == told
    cv2.imwrite(str(folder / "a.png"), np.zeros((48, 64, 3), np.uint8))
    import_bag(str(folder), tmp_path / "bag")
    assert [record.message for record in caplog.records] == [f"{folder}: {told}"]


def turned(orientation: int) -> tuple[np.ndarray, np.ndarray, bytes]:
    """An image of more than 64 KiB as it is shown and as it is stored, and its EXIF."""
    shown = np.random.default_rng(0).integers(0, 255, (200, 150, 3), np.uint8)
    stored = shown if orientation < 5 else cv2.transpose(shown)
    flips = {2: 1, 3: -1, 4: 0, 6: 0, 7: -1, 8: 1}  # before the pixels are turned
    stored = cv2.flip(stored, flips[orientation]) if orientation in flips else stored
    return shown, stored, b"MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x112, 3, 1, orientation, 0, 0)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("form", ["eXIf", "eXIf with prefix", "tEXt", "zTXt", "APP1", "iTXt", "at the end"])
def test_png_files_are_turned_as_they_are_shown(tmp_path: Path, orientation: int, form: str) -> None:
    """Older programs write the EXIF as hexadecimal text, which OpenCV does not read."""
    shown, stored, exif = turned(orientation)
    raw = b"Exif\0\0" + exif
    lines = b"\n".join(raw.hex().encode()[at : at + 72] for at in range(0, 2 * len(raw), 72))
    text = b"\nexif\n%8d\n%s\n" % (len(raw), lines)
    key = b"Raw profile type exif\0"
    parts = {
        "eXIf": png_part(b"eXIf", exif),
        "eXIf with prefix": png_part(b"eXIf", raw),
        "tEXt": png_part(b"tEXt", key + text),
        "APP1": png_part(b"zTXt", key.replace(b"exif", b"APP1") + b"\0" + zlib.compress(text)),
        "iTXt": png_part(b"iTXt", key + b"\1\0\0\0" + zlib.compress(text)),
    }
    part = parts.get(form, png_part(b"zTXt", key + b"\0" + zlib.compress(text)))
    data = cv2.imencode(".png", stored)[1].tobytes()
    at = data.rfind(b"IEND") - 4 if form == "at the end" else data.find(b"IDAT") - 4
    path = tmp_path / "a.png"
    path.write_bytes(data[:at] + part + data[at:])
    np.testing.assert_array_equal(read_image(path), shown)
    assert image_size(path) == (150, 200)
    message = CompressedImage(stamp=0, frame_id="", format="png", data=np.frombuffer(path.read_bytes(), np.uint8))
    np.testing.assert_array_equal(bgr_from_compressed(message), stored)


@pytest.mark.parametrize(
    "content",
    [
        lambda: b"",
        lambda: b"\0no zlib",
        lambda: b"\0" + zlib.compress(b"\nexif\n      12\nno hexadecimal digits\n"),
        lambda: b"\0" + zlib.compress(b"\nexif\n" + bytes(100_000_000)),
    ],
    ids=["empty", "no zlib", "no digits", "bomb"],
)
def test_damaged_exif_in_the_text_of_a_png_is_ignored(tmp_path: Path, content: Callable[[], bytes]) -> None:
    part = b"Raw profile type exif\0" + content()
    stored = turned(1)[1]
    data = cv2.imencode(".png", stored)[1].tobytes()
    at = data.find(b"IDAT") - 4
    (tmp_path / "a.png").write_bytes(data[:at] + png_part(b"zTXt", part) + data[at:])
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), stored)


@pytest.mark.parametrize("suffix", sorted(SUFFIXES))
@pytest.mark.parametrize("share", [0.3, 0.8, 0.999])
def test_a_cut_file_is_refused_in_each_format(tmp_path: Path, suffix: str, share: float) -> None:
    """Some decoders fill the rest with grey."""
    pixels = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)
    data = cv2.imencode(suffix, pixels)[1].tobytes()
    path = tmp_path / f"a{suffix}"
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ImageError, match=r"truncated|cannot be decoded"):
        read_image(path)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_webp_files_are_turned_as_they_are_shown(tmp_path: Path, orientation: int) -> None:
    """Many programs put the prefix of JPEG before the EXIF of a WebP, which OpenCV does not expect."""
    shown, stored, exif = turned(orientation)
    (width, height), lossless = stored.shape[1::-1], [cv2.IMWRITE_WEBP_QUALITY, 101]
    size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    coded = cv2.imencode(".webp", stored, lossless)[1].tobytes()[12:]
    path = tmp_path / "a.webp"
    for content, expected in ((b"Exif\0\0" + exif, shown), (exif, shown), (b"", stored)):
        chunks = b"VP8X" + struct.pack("<IB3x", 10, 8) + size + coded
        chunks += b"EXIF" + struct.pack("<I", len(content)) + content
        path.write_bytes(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WEBP" + chunks)
        np.testing.assert_array_equal(read_image(path), expected)
