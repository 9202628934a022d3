"""Detections and actions as standard ROS messages."""

import math

import msgspec
import pytest

from socialbot.bags.reader import RosbagsTypes
from socialbot.core.clock import SECOND
from socialbot.core.messages import HeardSpeech, PersonDetection, PersonDetections
from socialbot.runs.standard_messages import (
    CAMERA,
    OPTICAL,
    PAN,
    TILT,
    Engagement,
    HeadPose,
    Mounting,
    StandardMessages,
    body_id,
    place_of,
)
from socialbot.vision.camera import CameraModel, CameraPose

TYPES = RosbagsTypes()
SAY = StandardMessages(TYPES)
ANN = PersonDetection(
    x=100.0, y=40.0, w=80.0, h=200.0, score=0.9, track_id="t1", distance_m=4.0, bearing_rad=math.pi / 6
)
SOMEBODY = PersonDetection(x=-20.0, y=300.0, w=60.0, h=400.0, score=0.4)
FOUND = PersonDetections(stamp=3 * SECOND + 5, frame_id="camera", width=640, height=480, persons=(ANN, SOMEBODY))


def there_and_back(message):
    """Encode a message and decode it by its type."""
    return TYPES.deserialize(TYPES.serialize(message), message.__msgtype__)


def turned(q, vector):
    """``vector`` turned by a quaternion."""
    x, y, z = vector
    # v + 2 q x (q x v + w v)
    ax, ay, az = (
        q.y * z - q.z * y + q.w * x,
        q.z * x - q.x * z + q.w * y,
        q.x * y - q.y * x + q.w * z,
    )
    return (
        x + 2 * (q.y * az - q.z * ay),
        y + 2 * (q.z * ax - q.x * az),
        z + 2 * (q.x * ay - q.y * ax),
    )


def test_position_of_a_person():
    assert place_of(ANN) == pytest.approx((4 * math.cos(math.pi / 6), 2.0, 0.0))
    assert place_of(ANN, HeadPose(math.pi / 3, 0.0)) == pytest.approx((0.0, 4.0, 0.0)), (
        "seen by a camera that is turned to the left"
    )
    assert place_of(SOMEBODY) is None


def test_each_located_person_has_a_frame():
    (body,) = there_and_back(SAY.bodies(FOUND)).transforms
    assert (body.header.frame_id, body.child_frame_id) == ("base_link", "body_t1")
    assert (body.header.stamp.sec, body.header.stamp.nanosec) == (3, 5)
    assert (body.transform.translation.x, body.transform.translation.y) == pytest.approx(
        (4 * math.cos(0.5236), 2.0), 1e-4
    )
    assert body.transform.translation.z == pytest.approx(0.9), "between the hips, as REP-155 has it"


@pytest.mark.parametrize(
    ("track", "expected"),
    [
        ("t1", "t1"),
        ("7", "b7"),
        ("a-b c", "a_b_c"),
        ("../x", "x"),
        ("\u00e9", "b"),
        ("a__b", "a_b"),
        ("x" * 999, "x" * 64),
    ],
)
def test_body_id_is_valid_in_topic_names(track, expected):
    assert body_id(PersonDetection(x=0.0, y=0.0, w=1.0, h=1.0, score=1.0, track_id=track)) == expected


def test_head_frames_turn_left_and_up():
    pan, tilt = there_and_back(SAY.head(0, HeadPose(0.5, 0.3))).transforms
    assert (pan.header.frame_id, pan.child_frame_id) == ("base_link", "head_pan_link")
    assert (tilt.header.frame_id, tilt.child_frame_id) == ("head_pan_link", "head_tilt_link")
    ahead = turned(pan.transform.rotation, turned(tilt.transform.rotation, (1.0, 0.0, 0.0)))
    assert ahead == pytest.approx((math.cos(0.3) * math.cos(0.5), math.cos(0.3) * math.sin(0.5), math.sin(0.3)))


@pytest.mark.parametrize(("on_head", "holder"), [(True, "head_tilt_link"), (False, "base_link")])
def test_camera_frames_on_head_or_base(on_head, holder):
    camera, optical = there_and_back(SAY.camera(0, Mounting(1.5, on_head=on_head, optical="eye"))).transforms
    assert (camera.header.frame_id, camera.child_frame_id) == (holder, "camera_link")
    assert camera.transform.translation.z == (0.0 if on_head else 1.5)
    assert there_and_back(SAY.head(0, HeadPose(0.0, 0.0), 1.5)).transforms[0].transform.translation.z == 1.5
    assert optical.child_frame_id == "eye"
    turn = optical.transform.rotation
    assert turned(turn, (0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0))
    assert turned(turn, (1.0, 0.0, 0.0)) == pytest.approx((0.0, -1.0, 0.0)), "its x is to the right"


@pytest.mark.parametrize(
    ("pose", "on_head", "mounting"),
    [
        ({}, False, Mounting(optical="eye")),
        ({"camera_pose_source": "people"}, False, Mounting(1.52, 0.1, optical="eye", source="estimated from people")),
        ({"camera_pose_source": "file"}, False, Mounting(1.52, 0.1, optical="eye", source="from a file")),
        ({"camera_pose_source": "given"}, True, Mounting(1.52, 0.35, True, "eye", "given")),
        ({"camera_pose_source": "tf"}, False, Mounting(optical="eye")),
        ({"camera_pose_source": "people", "camera_height_m": None}, False, Mounting(optical="eye")),
    ],
    ids=["assumed", "estimated", "file", "given, on a head that looks up", "transforms", "incomplete"],
)
def test_the_mounting_takes_the_pose_that_the_detector_knows(pose, on_head, mounting):
    found = PersonDetections(
        stamp=0, frame_id="eye", width=640, height=480, persons=(),
        **{"camera_height_m": 1.52, "camera_pitch_rad": 0.1, **pose},
    )  # fmt: skip
    known = Mounting(on_head=on_head).updated(found, HeadPose(0.5, 0.25))
    assert known == mounting


def test_the_mounting_ignores_small_changes_of_an_estimate():
    pose = {"camera_height_m": 1.52, "camera_pitch_rad": 0.1, "camera_pose_source": "people"}
    known = Mounting().updated(msgspec.structs.replace(FOUND, **pose))
    assert known.updated(msgspec.structs.replace(FOUND, **pose | {"camera_height_m": 1.53})) == known
    assert known.updated(msgspec.structs.replace(FOUND, **pose | {"camera_height_m": 1.55})).height_m == 1.55


def test_no_optical_frame_for_images_in_the_camera_frame():
    (camera,) = there_and_back(SAY.camera(0, Mounting(optical=CAMERA))).transforms
    assert (camera.header.frame_id, camera.child_frame_id) == ("base_link", CAMERA)


@pytest.mark.parametrize("pose", [HeadPose(0.0, 0.0), HeadPose(0.4, 0.3), HeadPose(-0.7, -0.4)])
def test_body_lies_on_the_ray_through_the_frames(pose):
    seeing = CameraModel(525.0, 525.0, 320.0, 240.0, 640, 480, CameraPose(height_m=1.62, pitch_rad=0.1))
    u, v = 500.0, 120.0
    bearing, elevation = seeing.direction(u, v)
    person = msgspec.structs.replace(ANN, bearing_rad=bearing, elevation_rad=elevation)
    frames = {
        frame.child_frame_id: frame.transform.rotation
        for frame in (*SAY.head(0, pose).transforms, *SAY.camera(0, Mounting(1.2, 0.1, on_head=True)).transforms)
    }
    ray = ((u - seeing.cx) / seeing.fx, (v - seeing.cy) / seeing.fy, 1.0)
    for frame in (OPTICAL, CAMERA, TILT, PAN):
        ray = turned(frames[frame], ray)
    place = place_of(person, pose)
    assert place is not None
    x, y, _ = place
    assert math.atan2(y, x) == pytest.approx(math.atan2(ray[1], ray[0]))
    assert math.hypot(x, y) == pytest.approx(ANN.distance_m)
    if pose == (0.0, 0.0):
        assert math.atan2(ray[2], math.hypot(*ray[:2])) == pytest.approx(elevation)


def test_boxes_have_centres_and_sizes_in_pixels():
    boxes = there_and_back(SAY.boxes(FOUND))
    assert boxes.header.frame_id == "camera"
    first, second = boxes.detections
    assert (first.id, second.id) == ("t1", "")
    assert (first.bbox.center.position.x, first.bbox.center.position.y) == (140.0, 140.0)
    assert (first.bbox.size_x, first.bbox.size_y) == (80.0, 200.0)
    assert (first.results[0].hypothesis.class_id, first.results[0].hypothesis.score) == ("person", 0.9)


def box(person: PersonDetection) -> tuple[float, ...]:
    return person.x, person.y, person.w, person.h


def test_engagement_has_the_level_and_the_stamp_of_the_image():
    told = there_and_back(SAY.engagement(FOUND, msgspec.structs.replace(ANN, facing_rad=0.1, distance_m=2.0)))
    assert told.level == Engagement.ENGAGED
    assert told.header.frame_id == FOUND.frame_id


def test_region_is_a_fraction_of_the_image():
    region = there_and_back(SAY.region(FOUND, box(ANN), ANN.score))
    assert (region.xmin, region.xmax) == pytest.approx((100 / 640, 180 / 640))
    assert (region.ymin, region.ymax) == pytest.approx((40 / 480, 0.5))
    assert region.c == pytest.approx(0.9)
    beyond = there_and_back(SAY.region(FOUND, box(SOMEBODY), SOMEBODY.score))
    assert (beyond.xmin, beyond.ymax) == (0.0, 1.0)


def test_tracked_persons_have_ids():
    assert there_and_back(SAY.ids(FOUND.stamp, FOUND.frame_id, ["t1"])).ids == ["t1"]


def test_recognised_speech_has_text_language_and_time():
    heard = HeardSpeech(stamp=2 * SECOND, start=SECOND, text="Where is room 204?", language="en", confidence=0.75)
    told = there_and_back(SAY.live_speech(heard))
    assert (told.final, told.language, told.confidence) == ("Where is room 204?", "en", 0.75)
    assert told.header.stamp.sec == 2
    assert told.incremental == ""


def test_joint_state_has_names():
    state = there_and_back(SAY.joints(0, ("head_pan_joint", "head_tilt_joint"), (0.5, -0.1)))
    assert state.name == ["head_pan_joint", "head_tilt_joint"]
    assert list(state.position) == [0.5, -0.1]
    assert not len(state.velocity)
