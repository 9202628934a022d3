"""The parts of the generator of the synthetic bags that run without Blender."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import clips
import cv2
import msgspec
import numpy as np
import optics
import outline
import pack
import pictures
import pytest
import recording
import rooms
import sensor
import story
import truths
import visits
from hypothesis import given
from hypothesis import strategies as st

from socialbot.bags.reader import open_bag
from socialbot.vision.metrics.truth import TRUTH_TOPIC, TruthMessage, load_truth

SCENES = [clip for name, clip in clips.CLIPS.items() if name != "corridor"]


def sheet(depth: float, left: float, right: float, top: float, bottom: float):
    """Two triangles that fill a rectangle of the picture at one depth."""
    pixels = np.array([[left, top, depth], [right, top, depth], [right, bottom, depth], [left, bottom, depth]])
    return outline.drawn(pixels, np.array([[0, 1, 2], [0, 2, 3]]), (480, 640))


# Outlines


@given(st.floats(0, 500), st.floats(0, 400), st.floats(3, 120), st.floats(3, 60))
def test_a_drawn_rectangle_has_no_holes_and_the_right_size(left, top, wide, high):
    drawn = sheet(3.0, left, left + wide, top, top + high)
    assert drawn.filled()[1:-1, 1:-1].all()
    assert drawn.filled().sum() == pytest.approx((wide + 1) * (high + 1), abs=2 * (wide + high) + 4)


def test_half_outside_the_picture_is_half_visible():
    own = sheet(3.0, -50, 50, 100, 200)
    assert outline.visible_share(own, np.full((480, 640), np.inf)) == pytest.approx(0.5, abs=0.02)


def test_nearer_objects_occlude_farther_ones():
    own, other = sheet(3.0, 100, 200, 100, 200), np.full((480, 640), np.inf)
    other[:, :150] = 2.0
    other[:, 150:] = 4.0
    assert outline.visible_share(own, other) == pytest.approx(0.5, abs=0.02)


def test_nothing_is_drawn_behind_the_camera():
    assert sheet(-1.0, 100, 200, 100, 200) is None


@given(st.floats(-1.4, 1.4), st.floats(1.0, 15.0), st.floats(0.1, 1.9))
def test_shadows_lie_on_the_floor_or_on_a_wall(x, y, z):
    for lamp in (np.array([0.0, 5.0, 2.7]), np.array([-0.7, 0.3, -0.6, 0.0])):
        (where,) = outline.ground_shadow(np.array([[x, y, z]]), lamp, 1.5)
        assert where[2] == pytest.approx(0, abs=1e-6) or abs(where[0]) == pytest.approx(1.5)
        assert where[2] >= -1e-6


def test_the_sun_lights_only_areas_behind_a_pane():
    sun, panes = np.array([-1.0, 0.0, -1.0]), np.array([[4.0, 5.0, 1.0, 2.0]])
    points = np.array([[0.5, 4.5, 0.5], [0.5, 5.5, 0.5], [0.5, 4.5, 1.5]])
    assert outline.sunlit(points, sun, panes, 1.5).tolist() == [True, False, False]


def test_a_point_on_the_axis_is_seen_in_the_middle():
    view = optics.CORRIDOR
    ahead = np.array([[0.0, 7 * math.cos(view.pitch), view.eye[2] - 7 * math.sin(view.pitch)]])
    assert view.projected(ahead)[0] == pytest.approx([320, 240, 7])


VIEWS = [
    optics.CORRIDOR,
    optics.View(eye=(0.2, -0.1, 1.2), pitch=0.1, yaw=0.5),
    optics.View(size=(1280, 720), focal=900.0, pitch=-0.2),
    *(clip.view for clip in rooms.ROOMS if clip.view.lens),
]


@given(st.floats(0.02, 0.98), st.floats(0.02, 0.98), st.floats(0.5, 20))
@pytest.mark.parametrize("view", VIEWS)
def test_rays_are_the_projection_backwards(view, across, down, depth):
    u, v = across * view.size[0], down * view.size[1]
    point = view.rays(np.array([u]), np.array([v])) * depth + view.eye
    assert view.projected(point)[0] == pytest.approx([u, v, depth], abs=0.01)


def test_a_camera_turned_left_shows_objects_on_the_left_in_the_middle():
    left = np.array([[-3.0, 3.0, 1.62]])
    assert optics.View(pitch=0.0, yaw=math.radians(45)).projected(left)[0, :2] == pytest.approx([320, 240])


@pytest.mark.parametrize("view", [view for view in VIEWS if view.lens])
def test_the_picture_without_the_lens_holds_the_picture_with_it(view):
    (wide, high), lookup = view.ideal().size, view.lookup()
    assert (lookup >= 0).all()
    assert lookup[..., 0].max() < wide
    assert lookup[..., 1].max() < high


@pytest.mark.parametrize("view", [view for view in VIEWS if view.lens])
def test_a_lens_moves_outer_points_outwards(view):
    radii = np.linspace(0.0, 6.0, 200)
    bent = view.bent(np.stack([radii, 0.4 * radii], 1))[:, 0]
    assert (np.diff(bent) > 0).all()


# Visits


def test_a_visit_walks_at_its_speed_and_faces_where_it_goes():
    made = visits.visit("D", 2.0, (0.0, 8.0), visits.Go(0.0, 2.0, 1.5), visits.Stay(3.0, 90, "wave"))
    assert made.role.waypoints[0][0] == 2.0
    assert made.role.waypoints[-1] == pytest.approx((9.0, 0.0, 2.0, 90.0))
    assert {heading for _, _, y, heading in made.role.waypoints if y > 2} == {0.0}
    assert made.role.arms == ((6.0, 9.0, "wave"),)


def test_turns_go_the_short_way_round():
    made = visits.visit("D", 0.0, (0.0, 8.0), visits.Stay(2.0, 170), visits.Stay(2.0, -170), visits.Stay(2.0, 160))
    headings = [heading for *_, heading in made.role.waypoints]
    assert max(abs(b - a) for a, b in itertools.pairwise(headings[2:])) <= 30


@pytest.mark.parametrize("clip", SCENES, ids=lambda clip: clip.name)
def test_people_do_not_walk_through_people_or_walls(clip):
    tracks = [(visit, story.Track(visit.role)) for visit in clip.visits]
    for index in range(clip.frames()):
        time = index / story.RATE
        here = [track(time)[:2] for visit, track in tracks if story.present(visit.role, time)]
        here = [place for place in here if abs(place[0]) < 1.5 or abs(place[1]) < 1]
        for number, place in enumerate(here):
            assert all(np.hypot(*(place - other)) > 0.45 for other in here[:number]), (clip.name, time)
            doors = [(low, high) for side, low, high in clip.layout.doorways if side * place[0] > 0]
            in_door = any(low + 0.1 < place[1] < high - 0.1 for low, high in doors)
            assert abs(place[0]) < 1.25 or in_door, (clip.name, time, place)


def test_held_back_clips_show_other_people_than_the_tuning_clips():
    every = [*SCENES, *rooms.ROOMS]
    people = {split: {v.name for c in every if c.split == split for v in c.visits} for split in ("tune", "held-back")}
    assert people["tune"] == set("DEFGHIPQR")
    assert people["held-back"] == set("JKLMNOSTU")


@pytest.mark.parametrize("clip", rooms.ROOMS, ids=lambda clip: clip.name)
def test_people_in_a_room_do_not_walk_through_people_or_walls(clip):
    tracks, room = [(visit, story.Track(visit.role)) for visit in clip.visits], clip.layout
    for index in range(clip.frames()):
        time, here = index / clip.rate, []
        for visit, track in tracks:
            if story.present(visit.role, time):
                x, y, heading = track(time)
                sits = any(start <= time <= end for start, end, _ in visit.role.seated)
                back = rooms.BEHIND if sits else 0.0
                here.append(np.array([x - back * np.sin(heading), y + back * np.cos(heading)]))
        for number, (x, y) in enumerate(here):
            assert all(np.hypot(*(here[number] - other)) > 0.45 for other in here[:number]), time
            in_door = any(low + 0.15 < x < high - 0.15 for low, high in room.doorways)
            assert abs(x) < room.half - 0.3, time
            assert in_door or not room.depth - 0.25 < y < room.depth + 0.3, time
            assert not any(abs(y - pane) < 0.25 and low - 0.2 < x < high + 0.2 for pane, low, high in room.glass), time


def test_every_theme_has_a_clip_for_tuning_and_a_held_back_one_with_other_cameras_and_rooms():
    pairs = {}
    for clip in rooms.ROOMS:
        pairs.setdefault(clip.scene, {})[clip.split] = clip
    for tune, held_back in ((pair["tune"], pair["held-back"]) for pair in pairs.values()):
        assert tune.name.endswith("_tune")
        assert held_back.name.endswith("_heldback")
        assert tune.layout.things != held_back.layout.things
    assert len({clip.start for clip in rooms.ROOMS}) == len(rooms.ROOMS)


def committed(clip):
    """Path of the clip's bag in the repository."""
    return Path(__file__).parents[1] / clip.name


@pytest.mark.parametrize("clip", [c for c in rooms.ROOMS if committed(c).exists()], ids=lambda clip: clip.name)
def test_a_committed_bag_and_its_truth_fit_their_clip(clip):
    truth = load_truth(committed(clip).with_suffix(".truth.json"))
    assert (truth.scene, truth.split, len(truth.frames)) == (clip.scene, clip.split, clip.frames())
    assert truth.frames[0].stamp == clip.start * 10**9
    persons = [person for frame in truth.frames for person in frame.persons]
    assert {person.id for person in persons} <= {visit.name for visit in clip.visits}
    assert all(person.facing_rad is not None and person.posture != "unknown" for person in persons)
    with open_bag(committed(clip)) as bag:
        topics = {topic.name for topic in bag.topics}
    assert (recording.DEPTH_TOPIC in topics) == clip.depth
    assert ("/tf" in topics) == bool(clip.turning)


@pytest.mark.parametrize("clip", [c for c in rooms.ROOMS if c.scene == "visitors"], ids=lambda clip: clip.name)
def test_six_visitors_come_one_after_the_other_and_face_the_camera(clip):
    calls, faces = [], {}
    for visit in clip.visits:
        track = story.Track(visit.role)
        times = np.arange(visit.role.waypoints[0][0], visit.role.waypoints[-1][0], 0.1)
        x, y, heading = track(times).T
        away = np.degrees(np.abs((heading - np.arctan2(-x, y) + np.pi) % (2 * np.pi) - np.pi))
        near = times[(np.hypot(x, y) < 3.0) & (away < 25)]
        faces[visit.name] = max(faces.get(visit.name, 0), len(near) / 10)
        if len(near) > 25:
            calls.append((near[0], near[-1], visit.name))
    calls.sort()
    assert all(end < start for (_, end, _), (start, _, _) in itertools.pairwise(calls))
    assert len(calls) == 7
    assert len({name for *_, name in calls}) == 6
    assert sum(longest < 0.5 for longest in faces.values()) == 2


@pytest.mark.parametrize("clip", SCENES, ids=lambda clip: clip.name)
def test_light_fades_only_in_an_empty_scene(clip):
    fading = [index for index in range(clip.frames()) if 0 < clip.fading(index)[2] < 1]
    assert bool(fading) == bool(clip.fades)
    for index in fading:
        for visit in clip.visits:
            x, y, _ = story.Track(visit.role)(index / story.RATE)
            assert not story.present(visit.role, index / story.RATE) or abs(x) > 1.5 or abs(x) > 0.61 * y + 0.2


# Pictures


def test_a_region_is_blended_in_without_an_edge(tmp_path):
    empty = pictures.Empty(*(np.full((480, 640, 3), value, np.float32) for value in (0.5, 0.25)))
    cv2.imwrite(str(tmp_path / "0003_0.png"), np.full((100, 80, 3), 65535, np.uint16))
    bodies = np.ones((480, 640), bool)
    np.savez(tmp_path / "0003.npz", bodies=np.packbits(bodies))
    light = pictures.composed(tmp_path, 3, [[200, 380, 280, 480]], empty)
    assert light[430, 240] == pytest.approx([4.0] * 3)
    assert light[479, 240] == pytest.approx([4.0] * 3)
    assert light[379, 240] == pytest.approx([0.5] * 3)
    assert np.abs(np.diff(light[430, :, 0])).max() < 3.5 / pictures.FEATHER + 0.01


def test_a_quick_render_is_made_true_beside_bodies_and_left_alone_on_them():
    empty = pictures.Empty(*(np.full((480, 640, 3), value, np.float32) for value in (0.5, 0.25)))
    bodies = np.zeros((480, 640), bool)
    bodies[100:300, 200:300] = True
    factor = empty.correction(bodies)
    assert factor[50, 50] == pytest.approx([2.0] * 3)
    assert factor[200, 250] == pytest.approx([1.0] * 3)


def test_a_picture_of_another_kind_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(SystemExit, match="run render"):
        pictures.light_of(tmp_path / "a.png")


def test_the_gain_follows_a_change_of_light_within_about_a_second():
    bright, dim = (np.full((48, 64, 3), value, np.float32) for value in (0.6, 0.06))
    exposure = sensor.Exposure()
    first = exposure.step(bright, 0.1)
    gains = [exposure.step(dim, 0.1) for _ in range(12)]
    assert first == pytest.approx(exposure.wanted(bright))
    assert gains == sorted(gains)
    assert gains[0] < 0.6 * exposure.wanted(dim) < 0.9 * exposure.wanted(dim) < gains[-1]


@given(st.floats(0.001, 3), st.floats(0.001, 3), st.floats(0.4, 4))
def test_more_light_is_never_darker(a, b, gain):
    low, high = (float(sensor.developed(np.array(value), gain)) for value in sorted((a, b)))
    assert 0 <= low <= high <= 255


def test_noise_is_the_same_for_the_same_frame_and_another_for_the_next():
    grey = np.full((48, 64, 3), 128.0)
    assert (sensor.noisy(grey, 1, 1.3) == sensor.noisy(grey, 1, 1.3)).all()
    assert (sensor.noisy(grey, 1, 1.3) != sensor.noisy(grey, 2, 1.3)).any()


# Depth and blur


def test_measured_depth_is_near_the_true_one_coarser_far_away_and_missing_in_the_shadow():
    depth = np.full((120, 200), 2.0, np.float32)
    depth[:, 120:] = 6.0
    measured = sensor.depth_image(depth, 1) / 1000
    near, far = measured[:, 20:110], measured[:, 150:]
    assert np.abs(near[near > 0] - 2).mean() < 0.02
    assert 0.02 < np.abs(far[far > 0] - 6).mean() < 0.25
    assert (measured[:, 121:130] == 0).mean() > 0.8
    assert (far == 0).mean() < 0.05
    assert (sensor.depth_image(np.full((9, 9), 20.0, np.float32), 1) == 0).all()


def test_blur_follows_the_motion_and_stays_in_its_box():
    light = np.zeros((60, 80, 3), np.float32)
    light[:, 40] = 1.0
    blurred = sensor.smeared(light, [((20, 0, 40, 60), (9.0, 0.0))])
    assert blurred[30, 36:45, 0].min() > 0.05
    assert blurred[30, 40, 0] < 0.3
    assert sensor.smeared(light, [((20, 0, 40, 60), (1.0, 0.0))]) == pytest.approx(light)


# Truth


PERSON = {"id": "J", "x": 10.0, "y": 20.0, "w": 30.0, "h": 90.0, "distance_m": 5.2, "visible": 0.9}
STAND = {"kind": "coat stand", "x": 400.0, "y": 100.0, "w": 60.0, "h": 200.0}
SHADOW = {"kind": "shadow", "x": 100.0, "y": 300.0, "w": 50.0, "h": 20.0}
ABOUT = truths.ClipTruth("clip", "scene1", "held-back", [STAND])


def record(points):
    return pictures.FrameRecord("even", [PERSON], [], [{**SHADOW, "points": points}], [])


def test_a_shadow_counts_only_where_it_is_plainly_darker():
    background = np.full((480, 640, 3), 0.5, np.float32)
    picture = background.copy()
    picture[300:320, 100:150] *= 0.6
    dark, faint = [[110, 305], [120, 310]], [[400, 305], [410, 310]]
    assert truths.frame_truth(7, record(dark), picture, background)["objects"] == [SHADOW]
    assert truths.frame_truth(7, record(faint), picture, background)["objects"] == []


def packed(tmp_path: Path, **more) -> Path:
    """A bag of three frames with its truth beside it."""
    background = np.full((480, 640, 3), 0.5, np.float32)
    frames = [truths.frame_truth(stamp, record([[5, 5]]), background, background) for stamp in (10**9, 2 * 10**9)]
    jpegs = [cv2.imencode(".jpg", np.zeros((480, 640, 3), np.uint8))[1]] * 2
    messages = [truths.message_of(f, ABOUT) for f in frames]
    recording.write_bag(tmp_path / "clip", [10**9, 2 * 10**9], jpegs, messages, 10, optics.CORRIDOR, **more)
    truths.write_truth(tmp_path / "clip.truth.json", frames, ABOUT)
    return tmp_path / "clip"


def test_the_truth_file_is_read_by_the_evaluation(tmp_path):
    truth = load_truth(packed(tmp_path).with_suffix(".truth.json"))
    assert (truth.scene, truth.split) == ("scene1", "held-back")
    assert [thing.kind for thing in truth.objects] == ["coat stand"]
    assert [frame.persons[0].id for frame in truth.frames] == ["J", "J"]
    assert truth.frames[1].light == "even"


def test_every_image_in_the_bag_has_its_truth_at_its_time(tmp_path):
    images, people = "/camera/image_raw/compressed", TRUTH_TOPIC
    with open_bag(packed(tmp_path)) as bag:
        found = list(bag.raw_messages({images: images, people: people}))
    stamps = {topic: [stamp for name, stamp, *_ in found if name == topic] for topic in (images, people)}
    assert stamps[people] == stamps[images] == [10**9, 2 * 10**9]


def test_depth_comes_a_little_after_its_image_and_is_read_back(tmp_path):
    depth = np.arange(480 * 640, dtype=np.uint16).reshape(480, 640) % 5000
    with open_bag(packed(tmp_path, depths={10**9: depth})) as bag:
        found = list(bag.raw_messages({recording.DEPTH_TOPIC: recording.DEPTH_TOPIC}))
    assert [stamp for _, stamp, *_ in found] == [10**9 + recording.DEPTH_LAG]
    data = found[0][3]
    png = np.frombuffer(data[data.index(b"\x89PNG") :], np.uint8)
    assert (cv2.imdecode(png, cv2.IMREAD_UNCHANGED) == depth).all()


def chain(transforms: list, point: np.ndarray) -> np.ndarray:
    """A point of the last frame in the first one."""
    for moved in reversed(transforms):
        q, t = moved.transform.rotation, moved.transform.translation
        x, y, z, w = q.x, q.y, q.z, q.w
        turn = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        point = turn @ point + [t.x, t.y, t.z]
    return point


@pytest.mark.parametrize("clip", [c for c in rooms.ROOMS if c.turning], ids=lambda clip: clip.name)
@pytest.mark.parametrize("time", [0.0, 3.1, 7.7, 10.0])
def test_transforms_of_a_head_say_where_the_camera_looks(clip, time):
    head = recording.Head(lambda _: clip.pan_tilt(time), clip.view.eye[2], clips.NOSE)
    messages = [message for topic, _, _, message in head.messages(0, 0) if topic in ("/tf", "/tf_static")]
    fixed, moving = messages[0].transforms, messages[1].transforms
    view = clip.view_at(time)
    for depth in (0.0, 4.0):
        x, y, z = np.array(view.eye) + depth * view.axes[2]
        assert chain([*moving, *fixed], np.array([0.0, 0.0, depth])) == pytest.approx([y, -x, z], abs=1e-6)


def test_a_truth_message_is_complete_in_itself():
    background = np.full((480, 640, 3), 0.5, np.float32)
    frame = truths.frame_truth(7, record([[5, 5]]), background, background)
    message = msgspec.json.decode(truths.message_of(frame, ABOUT), type=TruthMessage)
    assert (message.stamp, message.scene, message.split, message.light) == (7, "scene1", "held-back", "even")
    assert [thing.kind for thing in message.objects] == ["coat stand"]
    assert message.persons[0].distance_m == 5.2


def test_people_are_counted_by_distance_when_visible_enough():
    people = [{**PERSON, "distance_m": d, "visible": v} for d, v in ((1.9, 0.3), (2.0, 1.0), (12.0, 0.2), (12.0, 0.25))]
    assert truths.counted([{"persons": people}, {"persons": []}]) == [1, 1, 1]


def test_the_table_of_counts_adds_up_by_scene(tmp_path):
    packed(tmp_path)
    both = truths.rows([tmp_path / "clip.truth.json"] * 2)
    assert both[2:] == ["| scene1, held-back | 2 | 0 | 0 | 2 | 0 |"] * 2 + ["| **scene1** | 4 | 0 | 0 | 4 | 0 |"]


def test_the_counts_are_renewed_between_their_marks(tmp_path):
    readme = tmp_path / "README.md"
    packed(tmp_path)
    readme.write_text("before\n" + "old".join(pack.MARKS) + "after\n")
    for _ in range(2):
        pack.write_counts(readme, [tmp_path / "clip.truth.json"])
    assert readme.read_text().startswith("before\n" + pack.MARKS[0] + "| | frames")
    assert readme.read_text().endswith("|\n" + pack.MARKS[1] + "after\n")
