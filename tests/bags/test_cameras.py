"""Which topics of a bag have pictures, which have depth, and which camera they belong to."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.bags.cameras import ImageKind, best, camera_of, image_kind
from socialbot.bags.reader import BagWriter, open_bag
from socialbot.core.errors import BagError
from socialbot.core.messages import CompressedImage, Image
from tests.bags.making_bags import RAW, START, make_with_rosbags, picture


def raw(encoding: str) -> Image:
    return Image(stamp=START, frame_id="c", height=2, width=2, encoding=encoding, step=8, data=np.zeros(16, np.uint8))


def packed(form: str, pixels: np.ndarray | None = None) -> CompressedImage:
    data = np.zeros(40, np.uint8) if pixels is None else cv2.imencode(".png", pixels)[1].reshape(-1)
    return CompressedImage(stamp=START, frame_id="c", format=form, data=data)


DEEP = np.full((4, 4), 2000, np.uint16)


@pytest.mark.parametrize(
    ("topic", "image", "kind"),
    [
        ("/camera/image_raw", raw("bgr8"), ImageKind.COLOUR),
        ("/camera/image_raw", raw("bayer_rggb8"), ImageKind.COLOUR),
        ("/camera/image_mono", raw("mono8"), ImageKind.GREY),
        ("/camera/image_raw", raw("16UC1"), ImageKind.DEPTH),
        ("/camera/image_raw", raw("32FC1"), ImageKind.DEPTH),
        ("/camera/depth/image_rect_raw", raw("mono16"), ImageKind.DEPTH),
        ("/camera/image_raw", raw("mono16"), ImageKind.GREY),
        ("/camera/infra1/image_rect_raw", raw("mono8"), ImageKind.INFRARED),
        ("/camera/ir/image", raw("mono16"), ImageKind.INFRARED),
        ("/thermal/image_raw", raw("16UC1"), ImageKind.INFRARED),
        ("/first/image_raw", raw("bgr8"), ImageKind.COLOUR),
        ("/camera/depth/image_color", raw("rgb8"), ImageKind.DEPTH_VIEW),
        ("/camera/depth/image_raw/compressedDepth", packed("passthrough"), ImageKind.DEPTH),
        ("/camera/aligned_depth/image_raw/compressedDepth", packed("mono16; compressedDepth"), ImageKind.DEPTH),
        ("/oddly/named", packed("32FC1; compressedDepth rvl"), ImageKind.DEPTH),
        ("/camera/depth/image_raw/compressed", packed("16UC1; png compressed "), ImageKind.DEPTH),
        ("/camera/depth/compressed", packed("png", DEEP), ImageKind.DEPTH),
        ("/camera/image_raw/compressed", packed("rgb8; jpeg compressed bgr8"), ImageKind.COLOUR),
        ("/camera/image/compressed", packed("png", np.zeros((4, 4, 3), np.uint8)), ImageKind.COLOUR),
        ("/camera/depth/image_raw", None, ImageKind.DEPTH),
        ("/camera/image_raw", None, ImageKind.COLOUR),
    ],
)  # fmt: skip
def test_kind_of_images(topic: str, image: Image | CompressedImage | None, kind: ImageKind) -> None:
    assert image_kind(topic, image) is kind


def test_camera_is_the_namespace() -> None:
    names = ("/camera/image_raw", "/camera/image_raw/compressed", "/camera/image_raw/compressedDepth")
    assert {camera_of(name) for name in names} == {"/camera"}


def test_one_topic_is_chosen_for_each_camera_of_the_best_kind() -> None:
    kinds = {
        "/camera/color/image_raw": ImageKind.COLOUR,
        "/camera/color/image_raw/compressed": ImageKind.COLOUR,
        "/camera/infra1/image_rect_raw": ImageKind.INFRARED,
        "/fisheye/image_raw": ImageKind.GREY,
    }
    assert best(kinds) == ["/camera/color/image_raw"]
    del kinds["/camera/color/image_raw"]
    assert best(kinds) == ["/camera/color/image_raw/compressed"]
    assert best(kinds | {"/left/image_raw": ImageKind.COLOUR}) == [
        "/camera/color/image_raw/compressed",
        "/left/image_raw",
    ]


def test_depth_is_never_the_picture(tmp_path: Path) -> None:
    depth, packed_depth = "/camera/depth/image_raw", "/a/depth/image/compressedDepth"
    contents = [(depth, START, raw("16UC1")), (packed_depth, START + 1, packed("32FC1; compressedDepth"))]
    with open_bag(make_with_rosbags(tmp_path / "depth", contents)) as bag:
        assert bag.image_topics == ()
        assert [topic.name for topic in bag.depth_topics] == [packed_depth, depth]
        with pytest.raises(BagError, match="no images but those of depth"):
            bag.choose_image_topic()
        with pytest.raises(BagError, match="has depth images"):
            bag.choose_image_topic(depth)
    infrared = ("/camera/infra1/image_rect_raw", START + 2, raw("mono8"))
    with open_bag(make_with_rosbags(tmp_path / "infrared", [*contents, infrared])) as bag:
        assert bag.choose_image_topic().name == "/camera/infra1/image_rect_raw"
    with open_bag(make_with_rosbags(tmp_path / "colour", [*contents, infrared, (RAW, START, picture(5))])) as bag:
        assert bag.choose_image_topic().name == RAW
        assert bag.choose_image_topic(infrared[0]).name == infrared[0]


def test_bag_of_one_frame_has_no_rate(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for nanosecond in range(4):
            writer.write(RAW, picture(START), START + nanosecond)
    with open_bag(tmp_path / "bag") as bag:
        assert bag.rate_hz(bag.topic(RAW)) is None
