from __future__ import annotations

import struct
import time
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import ImageError
from socialbot.core.messages import CompressedImage, Image
from socialbot.vision.images import ENCODINGS, bgr_from_compressed, bgr_from_image


def message(rows: np.ndarray, encoding: str, width: int, *, pad: int = 0, big: bool = False) -> Image:
    """An image message from rows of bytes, with ``pad`` bytes of rubbish behind each row."""
    height, used = rows.shape
    data = np.full((height, used + pad), 0xA5, np.uint8)
    data[:, :used] = rows
    return Image(
        stamp=1, frame_id="c", height=height, width=width, encoding=encoding, step=used + pad, data=data.reshape(-1),
        is_bigendian=big,
    )  # fmt: skip


def noise(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def smooth(height: int, width: int, *, seed: int = 0) -> np.ndarray:
    rough = np.random.default_rng(seed).normal(size=(height + 40, width + 40, 3))
    big = cv2.GaussianBlur(rough, (0, 0), 6)[20:-20, 20:-20]
    return np.clip((big - big.min()) * 255 / np.ptp(big), 0, 255).astype(np.uint8)


def compressed(data: np.ndarray | bytes, form: str) -> CompressedImage:
    return CompressedImage(stamp=1, frame_id="c", format=form, data=np.frombuffer(bytes(data), np.uint8))


def encoded(extension: str, pixels: np.ndarray, *options: int) -> bytes:
    good, data = cv2.imencode(extension, pixels, options)
    assert good
    return data.tobytes()


CHANNELS = {
    "bgr8": (3, [0, 1, 2]), "8UC3": (3, [0, 1, 2]), "rgb8": (3, [2, 1, 0]), "bgra8": (4, [0, 1, 2]),
    "8UC4": (4, [0, 1, 2]), "rgba8": (4, [2, 1, 0]), "mono8": (1, [0, 0, 0]), "8UC1": (1, [0, 0, 0]),
}  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(
    encoding=st.sampled_from(sorted(CHANNELS)),
    height=st.integers(1, 20),
    width=st.integers(1, 20),
    pad=st.integers(0, 17),
    seed=st.integers(0, 1000),
)
def test_channels_are_put_in_order_whatever_size_and_padding(encoding, height, width, pad, seed):
    count, order = CHANNELS[encoding]
    pixels = noise(height, width, count, seed=seed)
    result = bgr_from_image(message(pixels.reshape(height, -1), encoding, width, pad=pad))
    assert result.dtype == np.uint8
    np.testing.assert_array_equal(result, pixels[..., order])


@settings(max_examples=40, deadline=None)
@given(
    encoding=st.sampled_from(["mono16", "16UC1"]),
    height=st.integers(1, 12),
    width=st.integers(1, 12),
    pad=st.integers(0, 5),
    big=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_sixteen_bits_keep_their_upper_eight_in_either_byte_order(encoding, height, width, pad, big, seed):
    values = np.random.default_rng(seed).integers(0, 65536, (height, width), dtype=np.uint16)
    rows = values.astype(">u2" if big else "<u2").view(np.uint8).reshape(height, -1)
    result = bgr_from_image(message(rows, encoding, width, pad=pad, big=big))
    np.testing.assert_array_equal(result, np.repeat((values >> 8)[..., None], 3, axis=2))


@pytest.mark.parametrize(
    ("encoding", "alike"),
    [
        ("bgr16", "bgr8"), ("rgb16", "rgb8"), ("bgra16", "bgra8"), ("rgba16", "rgba8"), ("16UC3", "8UC3"),
        ("16UC4", "8UC4"), ("bayer_rggb16", "bayer_rggb8"), ("bayer_gbrg16", "bayer_gbrg8"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("big", [False, True])
def test_colours_of_sixteen_bits_are_those_of_the_upper_eight(encoding, alike, big):
    values = np.random.default_rng(1).integers(0, 65536, (7, 9 * 4), dtype=np.uint16)
    rows = values.astype(">u2" if big else "<u2").view(np.uint8)
    expected = bgr_from_image(message((values >> 8).astype(np.uint8), alike, 9))
    np.testing.assert_array_equal(bgr_from_image(message(rows, encoding, 9, pad=3, big=big)), expected)


@pytest.mark.parametrize(("bits", "offset"), [(8, 7000), (10, 0), (12, 0), (14, 0), (10, 29000)])
@pytest.mark.parametrize("big", [False, True])
def test_grey_values_of_fewer_bits_fill_the_range(bits, offset, big):
    scene = smooth(48, 96)[..., 0].astype(np.uint16)
    shown = (scene - scene.min()) / float(np.ptp(scene))
    values = (offset + shown * (2**bits - 1)).astype(np.uint16)
    values[3, 5] = 65535  # a defective pixel
    rows = values.astype(">u2" if big else "<u2").view(np.uint8)
    raw = bgr_from_image(message(rows, "mono16", 96, big=big))
    file = bgr_from_compressed(compressed(encoded(".png", values), "mono16; png compressed "))
    assert raw[3, 5, 0] == 255
    np.testing.assert_array_equal(raw, file)
    least = 0.9 if bits > 8 else 0.45  # half of the range: the least span is 512 values
    assert np.corrcoef(raw[..., 0].ravel(), shown.ravel())[0, 1] > 0.98
    assert np.ptp(np.delete(raw[..., 0].ravel(), 3 * 96 + 5)) > least * 255


@pytest.mark.parametrize("encoding", ["rgb16", "bayer_rggb16"])
def test_colours_of_twelve_bits_fill_the_range(encoding):
    scene = smooth(96, 96)
    scene = scene if encoding == "rgb16" else scene[..., 0]
    rows = (scene.astype("<u2") << 4).reshape(96, -1)
    deep = bgr_from_image(message(rows.view(np.uint8), encoding, 96)).astype(float)
    flat = bgr_from_image(message(scene.reshape(96, -1), encoding.replace("16", "8"), 96)).astype(float)
    gain = 255 / np.percentile(scene, 99.8)
    assert np.abs(deep - np.minimum(gain * flat, 255)).mean() < 4


def test_noise_of_a_covered_camera_of_16_bits_stays_dark():
    values = np.random.default_rng(1).integers(0, 16, (64, 96), dtype=np.uint16)
    assert bgr_from_image(message(values.view(np.uint8), "mono16", 96)).max() < 12


@pytest.mark.parametrize(("encoding", "first"), [("nv12", "u"), ("nv21", "v")])
@pytest.mark.parametrize("pad", [0, 6])
def test_colours_in_a_plane_of_their_own_are_those_of_interleaved_ones(encoding, first, pad):
    rng = np.random.default_rng(3)
    y = rng.integers(16, 236, (8, 12)).astype(np.uint8)
    u, v = (rng.integers(16, 241, (4, 6)).astype(np.uint8) for _ in range(2))
    plane = np.stack((u, v) if first == "u" else (v, u), axis=2).reshape(4, 12)
    image = message(np.vstack([y, plane]), encoding, 12, pad=pad)
    image = Image(**{**{name: getattr(image, name) for name in image.__struct_fields__}, "height": 8})
    double_u, double_v = (np.repeat(each, 2, axis=0) for each in (u, v))
    interleaved = np.stack([double_u, y[:, 0::2], double_v, y[:, 1::2]], axis=2).reshape(8, -1)
    np.testing.assert_allclose(bgr_from_image(image), bgr_from_image(message(interleaved, "uyvy", 12)), atol=2)


@pytest.mark.parametrize("step", [12, 18, 24, 30])
def test_colours_in_a_plane_of_full_size_are_those_of_interleaved_ones(step):
    rng = np.random.default_rng(3)
    y = rng.integers(16, 236, (8, 12)).astype(np.uint8)
    u, v = (np.repeat(rng.integers(16, 241, (8, 6)).astype(np.uint8), 2, axis=1) for _ in range(2))
    brightness, colours = (
        np.full((8, step), 0xA5, np.uint8),
        np.full((8, step if step >= 24 else 2 * step), 0xA5, np.uint8),
    )
    brightness[:, :12], colours[:, :24] = y, np.stack([u, v], axis=2).reshape(8, 24)
    data = np.concatenate([brightness.reshape(-1), colours.reshape(-1)])
    image = Image(stamp=1, frame_id="c", height=8, width=12, encoding="nv24", step=step, data=data)
    interleaved = np.stack([u[:, 0::2], y[:, 0::2], v[:, 0::2], y[:, 1::2]], axis=2).reshape(8, -1)
    np.testing.assert_allclose(bgr_from_image(image), bgr_from_image(message(interleaved, "uyvy", 12)), atol=3)


@pytest.mark.parametrize(("encoding", "rows"), [("nv12", 12), ("nv21", 12), ("nv24", 24)])
def test_planes_without_padding_may_have_any_step(encoding, rows):
    data = noise(rows * 12)
    first, *others = (
        bgr_from_image(Image(stamp=1, frame_id="c", height=8, width=12, encoding=encoding, step=step, data=data))
        for step in (12, 0, 18, 24, 36)
    )
    for other in others:
        np.testing.assert_array_equal(first, other)


@pytest.mark.parametrize(
    ("encoding", "order"), [("yuv422", "uyvy"), ("uyvy", "uyvy"), ("yuv422_yuy2", "yuyv"), ("yuyv", "yuyv")]
)
@pytest.mark.parametrize("pad", [0, 6])
def test_yuv_follows_bt601(encoding, order, pad):
    rng = np.random.default_rng(3)
    height, width = 10, 16
    y = rng.integers(16, 236, (height, width)).astype(np.uint8)
    u, v = (rng.integers(16, 241, (height, width // 2)).astype(np.uint8) for _ in range(2))
    first, second = y[:, 0::2], y[:, 1::2]
    parts = {"uyvy": (u, first, v, second), "yuyv": (first, u, second, v)}[order]
    rows = np.stack(parts, axis=2).reshape(height, -1)
    luma, cb, cr = 1.164 * (y - 16.0), np.repeat(u, 2, axis=1) - 128.0, np.repeat(v, 2, axis=1) - 128.0
    expected = np.stack([luma + 2.017 * cb, luma - 0.392 * cb - 0.813 * cr, luma + 1.596 * cr], axis=2)
    result = bgr_from_image(message(rows, encoding, width, pad=pad))
    np.testing.assert_allclose(result, np.clip(expected, 0, 255), atol=2)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("pad", [0, 5])
def test_bayer_mosaics_give_back_the_scene(pattern, pad):
    scene = smooth(40, 60)
    mosaic = np.empty(scene.shape[:2], np.uint8)
    for place, letter in enumerate(pattern):
        row, column = divmod(place, 2)
        mosaic[row::2, column::2] = scene[row::2, column::2, "bgr".index(letter)]
    result = bgr_from_image(message(mosaic, f"bayer_{pattern}8", 60, pad=pad))
    wrong = np.abs(result.astype(int) - scene)[2:-2, 2:-2]
    exchanged = np.abs(result[..., ::-1].astype(int) - scene)[2:-2, 2:-2]
    assert wrong.mean() < 2
    assert exchanged.mean() > 10


def test_bgr8_is_not_copied():
    plain = message(noise(4, 15), "bgr8", 5)
    padded = message(noise(4, 15), "bgr8", 5, pad=3)
    assert np.shares_memory(bgr_from_image(plain), plain.data)
    assert np.shares_memory(bgr_from_image(padded), padded.data)


def test_last_row_may_lack_its_padding():
    rows = noise(3, 15)
    image = message(rows, "bgr8", 5, pad=3)
    short = Image(
        stamp=1, frame_id="c", height=3, width=5, encoding="bgr8", step=18, data=image.data[: 2 * 18 + 15]
    )  # fmt: skip
    np.testing.assert_array_equal(bgr_from_image(short).reshape(3, 15), rows)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_encoding_is_converted_and_refuses_too_little_data(encoding):
    # 8 bytes a pixel, and as many rows again for planes of colours, are enough for any.
    image = Image(stamp=1, frame_id="c", height=6, width=8, encoding=encoding, step=64, data=noise(12 * 64))
    assert bgr_from_image(image).shape == (6, 8, 3)
    cut = Image(stamp=1, frame_id="c", height=6, width=8, encoding=encoding, step=64, data=noise(5 * 64 + 7))
    with pytest.raises(ImageError, match=f"{encoding} image of 8x6.*bytes are needed"):
        bgr_from_image(cut)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"encoding": "32FC1"}, ["unknown encoding '32FC1'", "bgr8, rgb8|bgr8, 8UC3", "bayer_rggb8"]),
        ({"encoding": ""}, ["unknown encoding ''"]),
        ({"width": 0}, ["0x4", "no pixels"]),
        ({"height": 0}, ["6x0", "no pixels"]),
        ({"step": 17}, ["6x4", "17 bytes", "needs 18"]),
        ({"data": np.empty(0, np.uint8)}, ["0 values", "72 bytes are needed"]),
        ({"data": np.zeros(72, np.float32)}, ["float32"]),
        ({"encoding": "uyvy", "width": 5}, ["uyvy image of 5x4", "even", "4 or 6"]),
        ({"encoding": "nv12", "height": 3}, ["nv12 image of 6x3", "even", "2 or 4"]),
        ({"encoding": "bayer_rggb8", "width": 2}, ["2x4", "too small"]),
    ],
)
def test_refuses_images_that_cannot_be_converted(changes, words):
    fields = {"height": 4, "width": 6, "encoding": "bgr8", "step": 18, "data": noise(72), **changes}
    with pytest.raises(ImageError) as caught:
        bgr_from_image(Image(stamp=1, frame_id="c", **fields))
    for word in words:
        assert any(choice in str(caught.value) for choice in word.split("|")), (word, str(caught.value))
    assert caught.value.remedy


@pytest.mark.parametrize("form", ["jpeg", "jpg", "rgb8; jpeg compressed bgr8", "bgr8; jpeg compressed bgr8", "JPEG"])
def test_jpeg(form):
    scene = smooth(48, 64)
    result = bgr_from_compressed(compressed(encoded(".jpg", scene, cv2.IMWRITE_JPEG_QUALITY, 98), form))
    assert np.abs(result.astype(int) - scene).mean() < 2


@pytest.mark.parametrize("form", ["png", "bgr8; png compressed ", "bgr8; png compressed bgr8"])
def test_png(form):
    scene = noise(12, 17, 3)
    np.testing.assert_array_equal(bgr_from_compressed(compressed(encoded(".png", scene), form)), scene)


def test_compressed_rgb_exchanges_red_and_blue():
    scene = noise(12, 17, 3)
    data = encoded(".png", scene)
    result = bgr_from_compressed(compressed(data, "bgr8; png compressed rgb8"))
    np.testing.assert_array_equal(result, scene[..., ::-1])


def test_png_of_16_bits_grey_and_with_alpha():
    deep = np.random.default_rng(1).integers(0, 65536, (9, 11), dtype=np.uint16)
    grey = bgr_from_compressed(compressed(encoded(".png", deep), "mono16; png compressed "))
    np.testing.assert_array_equal(grey, np.repeat((deep >> 8)[..., None], 3, axis=2).astype(np.uint8))
    clear = noise(9, 11, 4)
    np.testing.assert_array_equal(bgr_from_compressed(compressed(encoded(".png", clear), "png")), clear[..., :3])


def test_jpeg_may_be_padded_behind_its_end():
    data = encoded(".jpg", smooth(48, 64))
    assert bgr_from_compressed(compressed(data + bytes(100), "jpeg")).shape == (48, 64, 3)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
@pytest.mark.parametrize("extension", [".jpg", ".png"])
def test_cut_file_is_refused(extension, share):
    data = encoded(extension, smooth(48, 64))
    with pytest.raises(ImageError, match=r"truncated|decoded"):
        bgr_from_compressed(compressed(data[: int(len(data) * share)], extension[1:]))


def test_jpeg_of_fill_bytes_is_refused_at_once():
    fill = b"\xff\xd8\xff\xe0\x00\x04ab" + b"\xff" * 1_000_000
    begin = time.process_time()
    with pytest.raises(ImageError, match="decoded"):
        bgr_from_compressed(compressed(fill, "jpeg"))
    assert time.process_time() - begin < 5.0, "not in proportion to the square of their number"


def test_thumbnail_does_not_hide_that_a_jpeg_is_cut():
    thumbnail = encoded(".jpg", smooth(8, 8))
    whole = encoded(".jpg", smooth(48, 64))
    header = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    assert bgr_from_compressed(compressed(whole[:2] + header + whole[2:], "jpeg")).shape == (48, 64, 3)
    with pytest.raises(ImageError, match="truncated"):
        bgr_from_compressed(compressed(whole[:2] + header + whole[2:-200], "jpeg"))


@pytest.mark.parametrize("extension", [".jpg", ".png"])
@pytest.mark.parametrize("form", ["", "bgr8", "mjpg", "rgb8; compressed"])
def test_files_without_the_name_of_their_format_are_decoded(extension, form):
    scene = smooth(48, 64)
    result = bgr_from_compressed(compressed(encoded(extension, scene), form))
    assert result.shape == scene.shape
    assert np.abs(result.astype(int) - scene).mean() < 3


@pytest.mark.parametrize(
    ("data", "form", "words"),
    [
        (b"", "jpeg", "no data"),
        (b"rubbish" * 20, "jpeg", "decoded"),
        (b"\xff\xd8\xff\xd9", "jpeg", "decoded"),
        (b"\x89PNG\r\n", "png", "decoded"),
        (b"1234", "tiff", "unknown format"),
        (b"1234", "", "unknown format"),
        (b"1234", "16UC1; compressedDepth png", "depth"),
        (b"\xff\xd8\xff\xe0", "16UC1; compressedDepth", "depth"),
    ],
)
def test_bad_compressed_images_are_named(data, form, words):
    with pytest.raises(ImageError, match=words) as caught:
        bgr_from_compressed(compressed(data, form))
    assert repr(form) in str(caught.value)
    assert caught.value.remedy


def oversized(data: bytes, width: int, height: int) -> bytes:
    """Image whose header states another size."""
    if data.startswith(b"\x89PNG"):
        head = b"IHDR" + struct.pack(">II", width, height) + data[24:29]
        return data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]
    at = data.index(b"\xff\xc0")
    return data[: at + 5] + struct.pack(">HH", height, width) + data[at + 9 :]


@pytest.mark.parametrize("extension", [".jpg", ".png"])
def test_refuses_a_header_with_gigabytes_of_pixels(extension):
    data = oversized(encoded(extension, smooth(48, 64)), 30_000, 30_000)
    with pytest.raises(ImageError, match="30000x30000 pixels are too many"):
        bgr_from_compressed(compressed(data, extension[1:]))


def test_image_size_is_found_after_other_segments():
    data = oversized(encoded(".jpg", smooth(48, 64)), 30_000, 30_000)
    # A comment, rubbish and a marker without content, all of which decoders pass over.
    data = data[:2] + b"\xff\xfe\x00\x06\xff\xc0ab" + b"rubbish\xff\x00\xff\xff\xd0" + data[2:]
    with pytest.raises(ImageError, match="too many"):
        bgr_from_compressed(compressed(data, "jpeg"))


def test_part_of_a_png_that_gives_a_length_of_gigabytes_is_refused():
    data = encoded(".png", smooth(48, 64))
    at = data.index(b"IDAT")
    with pytest.raises(ImageError, match="truncated"):
        bgr_from_compressed(compressed(data[: at - 4] + b"\x7f\xff\xff\xff" + data[at:], "png"))


@pytest.mark.parametrize("extension", [".bmp", ".tiff", ".webp"])
def test_file_of_another_kind_is_refused_whatever_its_format_says(extension):
    with pytest.raises(ImageError, match="decoded"):
        bgr_from_compressed(compressed(encoded(extension, smooth(48, 64)), "png"))
