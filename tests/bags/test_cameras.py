"""Image and depth topics of a bag, and their cameras."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.bags.cameras import (
    ImageKind,
    best,
    best_depth,
    best_points,
    camera_info_of,
    camera_of,
    depth_first,
    image_kind,
    is_rectified,
    transform_topics,
)
from socialbot.bags.playback import feeding
from socialbot.bags.reader import BagWriter, open_bag
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, GraphError
from socialbot.core.messages import (
    CameraInfo,
    CompressedDepth,
    CompressedImage,
    DepthImage,
    DepthInfo,
    Image,
    Message,
    PointCloud,
    Transforms,
)
from socialbot.graph.files import load_graph
from tests.bags.making_bags import INFO, RAW, START, K, make_with_rosbags, picture, times


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
        ("/optris/temperature_image", raw("mono16"), ImageKind.INFRARED),
        ("/thermalgrabber_ros/temperature_image", raw("32FC1"), ImageKind.MAP),
        ("/camera/aligned_depth_to_infra1/image_raw", raw("16UC1"), ImageKind.DEPTH),
        ("/camera/depth_to_ir/image_raw", raw("mono16"), ImageKind.DEPTH),
        ("/camera/depth_to_ir/image_raw", raw("32FC1"), ImageKind.DEPTH),
        ("/depth_camera/ir/image_raw", raw("16UC1"), ImageKind.INFRARED),
        ("/camera/ir_to_depth/image_raw", raw("16UC1"), ImageKind.INFRARED),
        ("/first/image_raw", raw("bgr8"), ImageKind.COLOUR),
        ("/camera/depth/image_color", raw("rgb8"), ImageKind.DEPTH_VIEW),
        ("/camera/depth/image_raw/compressedDepth", packed("passthrough"), ImageKind.DEPTH),
        ("/camera/aligned_depth/image_raw/compressedDepth", packed("mono16; compressedDepth"), ImageKind.DEPTH),
        ("/oddly/named", packed("32FC1; compressedDepth rvl"), ImageKind.DEPTH),
        ("/camera/depth/image_raw/compressed", packed("16UC1; png compressed "), ImageKind.DEPTH),
        ("/camera/depth/compressed", packed("png", DEEP), ImageKind.DEPTH),
        ("/camera/image_raw/compressed", packed("rgb8; jpeg compressed bgr8"), ImageKind.COLOUR),
        ("/camera/image/compressed", packed("png", np.zeros((4, 4, 3), np.uint8)), ImageKind.COLOUR),
        ("/zed/zed_node/confidence/confidence_map", raw("32FC1"), ImageKind.MAP),
        ("/zed/zed_node/confidence/confidence_map/compressedDepth", packed("32FC1; compressedDepth"), ImageKind.MAP),
        ("/camera/camera/confidence/image_rect_raw", raw("mono8"), ImageKind.MAP),
        ("/stereo/disparity/image_raw", raw("16UC1"), ImageKind.MAP),
        ("/stereo/disparity/image_color", raw("rgb8"), ImageKind.DEPTH_VIEW),
        ("/thermal/temperature", raw("32FC1"), ImageKind.MAP),
        ("/front/instance_segmentation", raw("32SC1"), ImageKind.MAP),
        ("/semantic_robot/front/camera/image_raw", raw("mono8"), ImageKind.GREY),
        ("/flir_boson/image_raw", raw("16UC1"), ImageKind.INFRARED),
        ("/flir_camera/image_raw", raw("bayer_rggb8"), ImageKind.COLOUR),
        ("/flir_camera/image_raw/compressed", packed("bayer_rggb8; jpeg compressed bgr8"), ImageKind.COLOUR),
        ("/flir_camera/image_raw", raw("rgb8"), ImageKind.INFRARED),  # maybe heat in false colours
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


def test_values_that_are_no_pictures_are_named(tmp_path: Path) -> None:
    confidence = "/zed/zed_node/confidence/confidence_map"
    with open_bag(make_with_rosbags(tmp_path / "alone", [(confidence, START, raw("32FC1"))])) as bag:
        assert bag.image_topics == bag.depth_topics == ()
        with pytest.raises(BagError, match=f"no images but values, not pictures, on {confidence}"):
            bag.choose_image_topic()
        with pytest.raises(BagError, match="has values such as confidences"):
            bag.choose_image_topic(confidence)


def test_bag_of_one_frame_has_no_rate(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for nanosecond in range(4):
            writer.write(RAW, picture(START), START + nanosecond)
    with open_bag(tmp_path / "bag") as bag:
        assert bag.rate_hz(bag.topic(RAW)) is None


def test_depth_of_the_same_camera_and_view_is_preferred() -> None:
    image = "/front/color/image_raw"
    frames = {
        "/front/depth/image_rect_raw": "front_depth_optical_frame",
        "/front/aligned_depth_to_color/image_raw": "front_color_optical_frame",
        "/front/aligned_depth_to_color/image_raw/compressedDepth": "front_color_optical_frame",
        "/back/aligned_depth_to_color/image_raw": "back_color_optical_frame",
    }
    ranked = []
    while (found := best_depth(image, "front_color_optical_frame", frames)) is not None:
        ranked.append(found)
        del frames[found]
    assert ranked == [
        "/front/aligned_depth_to_color/image_raw",
        "/front/aligned_depth_to_color/image_raw/compressedDepth",
        "/front/depth/image_rect_raw",
        "/back/aligned_depth_to_color/image_raw",
    ]


def test_registered_depth_of_another_camera_is_not_preferred_to_that_in_the_frame() -> None:
    frames = {f"/spot/depth_registered/{side}/image": f"{side}_fisheye" for side in ("back", "frontleft", "right")}
    assert best_depth("/spot/camera/right/image", "right_fisheye", frames) == "/spot/depth_registered/right/image"


@pytest.mark.parametrize(
    ("image", "infos", "others", "chosen"),
    [
        ("/camera/image_raw/compressed", ["/camera/camera_info", "/camera_info"], [], "/camera/camera_info"),
        ("/zed/rgb/color/rect/image", ["/zed/rgb/color/rect/image/camera_info"], [],
         "/zed/rgb/color/rect/image/camera_info"),
        ("/camera/color/image_raw", ["/camera/camera_info"], [], "/camera/camera_info"),
        ("/camera/color/image_raw", ["/camera/camera_info"], ["/camera/image_raw"], ""),
        ("/rear/image_raw", ["/camera_info"], ["/image_raw"], ""),
        ("/image_raw", ["/camera_info"], ["/rear/image_raw"], "/camera_info"),
        ("/head/right_image", ["/head/left_camera_info", "/head/right_camera_info"], ["/head/left_image"],
         "/head/right_camera_info"),
        ("/camera/image_raw", ["/lidar/camera_info"], [], ""),
        ("/rgb1/image", ["/aligned1/camera_info", "/rear1/camera_info"], [], "/aligned1/camera_info"),
        # Recordings of librealsense.
        ("/device_0/sensor_1/Color_0/image/data",
         ["/device_0/sensor_0/Depth_0/info/camera_info", "/device_0/sensor_1/Color_0/info/camera_info"],
         ["/device_0/sensor_0/Depth_0/image/data"], "/device_0/sensor_1/Color_0/info/camera_info"),
        ("/device_0/sensor_0/Infrared_1/image/data",
         ["/device_0/sensor_0/Infrared_1/info/camera_info", "/device_0/sensor_0/Infrared_2/info/camera_info"],
         ["/device_0/sensor_0/Infrared_2/image/data"], "/device_0/sensor_0/Infrared_1/info/camera_info"),
        ("/device_0/Color_0/image/data", ["/device_0/Color_0/info/camera_info"], ["/device_0/Color_0/thumbnail/data"],
         ""),
        ("/camera/color/image_raw", ["/camera/depth/camera_info"], [], ""),
    ],
)  # fmt: skip
def test_camera_info_belongs_to_the_images(image: str, infos: list[str], others: list[str], chosen: str) -> None:
    frames = {"/rgb1/image": "color", "/aligned1/camera_info": "color"}
    unnamed = "/device_0/"
    frame = lambda topic: frames.get(  # noqa: E731
        topic, "" if topic.startswith(unnamed) else f"frame{topic}".rpartition("/")[0]
    )
    assert camera_info_of(image, infos, [image, *others], frame) == chosen


def test_lidar_is_preferred_to_clouds_of_a_depth_camera() -> None:
    clouds = {"/camera/points": "depth_optical_frame", "/velodyne_points": "velodyne", "/obstacles": "map"}
    assert best_points(clouds, with_depth=True) == "/velodyne_points"
    assert best_points({"/camera/points": "depth_optical_frame"}, with_depth=True) is None
    assert best_points({"/camera/points": "depth_optical_frame"}, with_depth=False) == "/camera/points"


def test_picture_follows_the_depth_of_its_stamp() -> None:
    """Pictures come after 1.0 s, depth after 1.4 s; the camera_info in between keeps its place."""
    items = sorted(
        [(stamp + 10, "rgb", stamp) for stamp in range(0, 40, 2)]
        + [(stamp + 14, "depth", stamp) for stamp in range(0, 40, 2)]
        + [(stamp, "info", stamp) for stamp in range(0, 50, 10)]
    )
    scale = SECOND // 10
    order = list(depth_first(items, lambda item: (item[1], item[2] * scale), {"depth"}, {"rgb"}))
    assert sorted(order) == items
    seen: list[int] = []
    for _, topic, stamp in order:
        if topic == "depth":
            seen.append(stamp)
        elif topic == "rgb":
            assert stamp in seen
    for topic in ("rgb", "info"):
        assert [item for item in order if item[1] == topic] == [item for item in items if item[1] == topic]


def test_picture_does_not_wait_for_missing_depth() -> None:
    items = [(stamp, "rgb", stamp) for stamp in range(60)]
    yielded: list[int] = []
    read = 0

    def reading():
        nonlocal read
        for item in items:
            read += 1
            yield item

    for _, _, stamp in depth_first(reading(), lambda item: (item[1], item[2] * SECOND // 10), {"depth"}, {"rgb"}):
        assert read - stamp <= 22
        yielded.append(stamp)
    assert yielded == list(range(60))


DEPTH_TOPIC, DEPTH_INFO = "/camera/depth/image_rect_raw", "/camera/depth/camera_info"


def depth_bag(path: Path, *, frame: str) -> Path:
    lag = 4 * SECOND // 10
    contents: list[tuple[str, int, Message | bytes]] = []
    for time in times(6):
        info = CameraInfo(stamp=time, frame_id="camera", width=8, height=6, k=K)
        depth = DepthImage(
            stamp=time, frame_id=frame, height=6, width=8, encoding="16UC1", step=16, data=np.full(96, 7, np.uint8)
        )
        contents += [(RAW, time, picture(time)), (DEPTH_TOPIC, time + lag, depth), (INFO, time, info)]
        contents += [(DEPTH_INFO, time, DepthInfo(stamp=time, frame_id=frame, width=8, height=6, k=K))]
        contents += [("/tf", time, Transforms(stamp=time, transforms=()))]
    return make_with_rosbags(path, sorted(contents, key=lambda each: each[1]))


def test_depth_feeds_the_person_detector(tmp_path: Path) -> None:
    graph = load_graph("waldo").without_sources()
    with open_bag(depth_bag(tmp_path / "registered", frame="camera")) as bag:
        assert bag.depth_sensors_for(RAW) == {DEPTH_TOPIC: DepthImage, DEPTH_INFO: DepthInfo}
        feeds = feeding(bag, graph, None)
        assert feeds == {
            RAW: "/camera/image_raw", INFO: INFO, DEPTH_TOPIC: "/camera/depth/image_raw", DEPTH_INFO: DEPTH_INFO,
            "/tf": "/tf",
        }  # fmt: skip
        order = [(topic, each.stamp) for topic, each in bag.messages(feeds, graph.topics())]
    for time in times(6):
        assert order.index(("/camera/depth/image_raw", time)) < order.index(("/camera/image_raw", time))
    with open_bag(depth_bag(tmp_path / "other", frame="depth")) as bag:
        assert bag.depth_sensors_for(RAW)["/tf"] is Transforms


@pytest.mark.parametrize(
    ("image", "trees", "chosen"),
    [
        ("/camera/image_raw", ["/tf_static", "/tf"], ["/tf", "/tf_static"]),
        ("/robot1/camera/image_raw", ["/robot1/tf", "/robot2/tf", "/robot2/tf_static"], ["/robot1/tf"]),
        ("/robot1/camera/image_raw", ["/tf", "/robot1/tf", "/tf_static"], ["/robot1/tf", "/tf_static"]),
        ("/robot10/camera/image_raw", ["/robot1/tf", "/robot1/tf_static"], []),
    ],
)
def test_transforms_of_the_robot_of_the_camera(image: str, trees: list[str], chosen: list[str]) -> None:
    assert transform_topics(image, trees) == chosen


def test_transforms_in_a_namespace_feed_the_person_detector(tmp_path: Path) -> None:
    graph = load_graph("waldo").without_sources()
    image, still = "/robot1/camera/image_raw", Transforms(stamp=START, transforms=())
    contents = [(image, START, picture(START)), ("/robot1/tf", START, still), ("/robot1/tf_static", START, still)]
    with open_bag(make_with_rosbags(tmp_path / "bag", contents)) as bag:
        feeds = feeding(bag, graph, None)
    assert feeds == {image: "/camera/image_raw", "/robot1/tf": "/tf", "/robot1/tf_static": "/tf_static"}


def test_images_that_are_recorded_raw_and_compressed_are_played_once(tmp_path: Path) -> None:
    graph = load_graph("waldo").without_sources()
    jpeg = packed("jpeg", np.zeros((6, 8), np.uint8))
    contents = [(RAW, START, picture(START)), (f"{RAW}/compressed", START, jpeg), ("/rear/image_raw", START, jpeg)]
    with open_bag(make_with_rosbags(tmp_path / "both", contents[:2])) as bag:
        assert feeding(bag, graph, None) == {RAW: RAW}
        assert feeding(bag, graph, f"{RAW}/compressed") == {f"{RAW}/compressed": f"{RAW}/compressed"}
    with open_bag(make_with_rosbags(tmp_path / "rear", contents)) as bag:
        assert feeding(bag, graph, "/rear/image_raw") == {"/rear/image_raw": f"{RAW}/compressed"}


TWO = """
name: two
inputs: [/left/image, /left/camera_info, /left/depth/image, /right/image, /right/camera_info, /right/depth/image]
nodes:
""" + "".join(
    f"""
  {side}_converter: {{type: image_converter, remap: {{image_raw: /{side}/image, image_color: /{side}/color}}}}
  {side}:
    type: person_detector
    remap: {{image: /{side}/color, camera_info: /{side}/camera_info, depth: /{side}/depth/image,
            detections: /{side}/detections, annotations: /{side}/annotations}}
"""
    for side in ("left", "right")
)


@pytest.mark.parametrize("chosen", ["left", "right"])
def test_two_cameras_with_depth_feed_two_detectors(tmp_path: Path, chosen: str) -> None:
    (tmp_path / "two.yaml").write_text(TWO)
    contents: list[tuple[str, int, Message | bytes]] = []
    for side in ("left", "right"):
        depth = DepthImage(
            stamp=START, frame_id="camera", height=6, width=8, encoding="16UC1", step=16, data=np.zeros(96, np.uint8)
        )
        info = CameraInfo(stamp=START, frame_id="camera", width=8, height=6, k=K)
        contents += [(f"/{side}/image", START, picture(START)), (f"/{side}/camera_info", START, info)]
        contents += [(f"/{side}/depth/image", START, depth)]
    with open_bag(make_with_rosbags(tmp_path / "bag", contents)) as bag:
        feeds = feeding(bag, load_graph(str(tmp_path / "two.yaml")).without_sources(), f"/{chosen}/image")
    assert feeds == {name: name for name, _, _ in contents}


SHARED = """
name: shared
inputs: [/camera/image_raw/compressed, /camera/image_raw, /rear/image_raw]
nodes:
  front_converter: {type: image_converter}
  rear_converter: {type: image_converter, remap: {image_raw: /rear/image_raw, image_color: /rear/color}}
"""


def test_two_cameras_do_not_share_the_topic_of_compressed_images(tmp_path: Path) -> None:
    (tmp_path / "shared.yaml").write_text(SHARED)
    with pytest.raises(
        GraphError, match="front_converter and rear_converter share /camera/image_raw/compressed"
    ) as why:
        load_graph(str(tmp_path / "shared.yaml"))
    assert "image_compressed" in str(why.value.remedy)
    (tmp_path / "raw.yaml").write_text(SHARED.replace("/camera/image_raw/compressed, ", ""))
    graph = load_graph(str(tmp_path / "raw.yaml"))
    jpeg = packed("jpeg", np.zeros((6, 8), np.uint8))
    contents = [(f"/{side}/image_raw/compressed", START, jpeg) for side in ("camera", "rear")]
    with (
        open_bag(make_with_rosbags(tmp_path / "bag", contents)) as bag,
        pytest.raises(GraphError, match="share /camera/image_raw/compressed"),
    ):
        feeding(bag, graph, "/rear/image_raw/compressed")


def test_messages_with_distances_are_told_apart(tmp_path: Path) -> None:
    packed_topic = "/camera/depth/image_raw/compressedDepth"
    cloud = PointCloud(
        stamp=START, frame_id="velodyne", height=1, width=0, fields=(), is_bigendian=False, point_step=1, row_step=0,
        data=np.zeros(0, np.uint8),
    )  # fmt: skip
    contents = [
        (RAW, START, picture(START)), (packed_topic, START + 1, packed("16UC1; compressedDepth")),
        ("/velodyne", START, cloud),
    ]  # fmt: skip
    with open_bag(make_with_rosbags(tmp_path / "bag", contents)) as bag:
        assert bag.depth_sensors_for(RAW) == {packed_topic: CompressedDepth, "/velodyne": PointCloud}


@pytest.mark.parametrize(
    ("topic", "rectified"),
    [
        ("/camera/image_rect", True),
        ("/camera/image_rect_color/compressed", True),
        ("/left/rgb_rect", True),
        ("/camera/image_raw", False),
        ("/camera/rectangle/image", False),
        ("/camera_rect/image_raw/compressed", False),
    ],
)
def test_names_of_rectified_images(topic: str, rectified: bool) -> None:
    assert is_rectified(topic) is rectified
