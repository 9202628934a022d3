"""Label formats of recordings: MOTChallenge, KITTI and CVAT."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import TruthError
from socialbot.vision.metrics.formats import labelled_sources
from socialbot.vision.metrics.frames import FolderImages, VideoImages
from tests.vision.metrics.label_files import (
    BOX,
    CVAT_IMAGES,
    CVAT_VIDEO,
    EXAMPLES,
    FOUR,
    HEIGHT,
    KITTI,
    MOT,
    SEQINFO,
    TRACKING,
    WIDTH,
    one,
    write,
)

# MOTChallenge


def test_mot_classes_times_and_ids(tmp_path):
    _, files, images = EXAMPLES["mot"]
    source = one(write(tmp_path, files, images))
    first, second = source.frames
    assert source.name == "Hall-01"
    assert (first.stamp, second.stamp) == (0, SECOND // 25)
    assert first.persons[0].visible == 0.75
    assert [(person.id, person.ignore) for person in second.persons] == [("1", False), ("2", True), ("3", True)]
    assert [region.box for region in second.ignore] == [(0, 90, 60, 30)]
    assert source.images.consecutive
    assert source.identities
    assert source.notes == ("not used: 1 box of class car",)
    assert source.least_visible == 0


def test_mot15_has_coordinates_instead_of_a_class(tmp_path):
    files = {"gt/gt.txt": "1,1,40,20,30,80,1,-1,-1,-1\n1,2,90,20,30,80,0,4.5,-2.1,0\n", "seqinfo.ini": SEQINFO}
    source = one(write(tmp_path, files, EXAMPLES["mot"][2]))
    assert [(person.ignore, person.visible) for person in source.frames[0].persons] == [(False, 1.0), (True, 1.0)]


def test_mot_without_ids_is_not_scored_for_identity(tmp_path):
    source = one(write(tmp_path, {"gt/gt.txt": "1,-1,40,20,30,80,1\n1,-1,90,20,30,80,1\n"}, EXAMPLES["mot"][2]))
    assert not source.identities
    assert len(source.frames[0].persons) == 2
    assert "people have no ids, as in det.txt, which holds detections and no labels" in source.notes


def test_mot_class_and_visible_share_before_a_tenth_column(tmp_path):
    text = "1,1,40,20,30,80,1,1,0.5,-1\n1,2,60,20,30,80,1,3,1,-1\n"
    source = one(write(tmp_path, {"gt.txt": text}, ("1.jpg",)))
    assert [(person.id, person.visible) for person in source.frames[0].persons] == [("1", 0.5)]
    assert "not used: 1 box of class car" in source.notes


@pytest.mark.parametrize(
    "images", [("1.jpg", "2.jpg", "3.jpg"), ("0.jpg", "1.jpg", "2.jpg"), ("a.jpg", "b.jpg", "c.jpg")]
)
def test_mot_frames_from_zero(tmp_path, images):
    text = "0,1,40,20,30,80,1,1,1\n1,1,50,20,30,80,1,1,1\n"
    source = one(write(tmp_path, {"gt.txt": text}, images))
    assert [[person.x for person in frame.persons] for frame in source.frames] == [[40], [50], []]
    assert not any("no image" in note for note in source.notes)


def test_mot_images_from_zero_and_labels_from_one_are_told(tmp_path):
    source = one(write(tmp_path, {"gt.txt": "1,1,40,20,30,80,1,1,1\n"}, ("0.jpg", "1.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [0, 1]
    assert "image 0 has no label: the numbers of the images are taken for frames" in source.notes


def test_mot_note_names_the_last_frame_without_an_image(tmp_path):
    text = "".join(f"{frame},1,40,20,30,80,1,1,1\n" for frame in (1, 3, 4))
    assert (
        "2 labelled frames have no image; the last is frame 4"
        in one(write(tmp_path, {"gt.txt": text}, ("1.jpg", "2.jpg"))).notes
    )


def test_mot_image_numbers_are_frames_where_they_fit(tmp_path):
    source = one(write(tmp_path, {"gt.txt": "9,1,40,20,30,80,1,1,1\n"}, ("7.jpg", "8.jpg", "9.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [0, 0, 1]
    source = one(write(tmp_path / "other", {"gt.txt": "1,1,40,20,30,80,1,1,1\n"}, ("7.jpg", "8.jpg", "9.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [1, 0, 0]


@pytest.mark.parametrize("there", [(1, 2, 4), (2, 3, 4), (1, 3)])
def test_mot_missing_image_does_not_move_the_labels_of_others(tmp_path, there):
    text = "".join(f"{frame},1,{frame},20,30,80,1,1,1\n" for frame in (1, 2, 3, 4))
    source = one(write(tmp_path, {"gt.txt": text}, tuple(f"{number:06}.jpg" for number in there)))
    assert [frame.persons[0].x for frame in source.frames] == list(there)
    lost = {1, 2, 3, 4} - set(there)
    assert f"{len(lost)} labelled frames have no image; the last is frame {max(lost)}" in source.notes


def test_mot_images_without_one_that_are_numbered_from_another_frame(tmp_path):
    text = "".join(f"{frame},1,{frame},20,30,80,1,1,1\n" for frame in (1, 2, 3, 4))
    source = one(write(tmp_path, {"gt.txt": text}, ("9.jpg", "10.jpg", "12.jpg")))
    assert [frame.persons[0].x for frame in source.frames] == [1, 2, 4]
    assert "image 9.jpg is taken for frame 1" in source.notes


@pytest.mark.parametrize(
    ("files", "images"),
    [
        ({"annotations.xml": CVAT_VIDEO}, "images/frame_{:06}.png"),
        ({"label_02/0001.txt": TRACKING}, "image_02/0001/{:06}.png"),
    ],
)
def test_labels_from_zero_and_images_from_one(tmp_path, files, images):
    names = [images.format(number) for number in range(5)]
    right = one(write(tmp_path / "right", files, tuple(names[:4])))
    moved = one(write(tmp_path / "moved", files, tuple(names[1:])))
    assert [frame.persons for frame in moved.frames] == [frame.persons for frame in right.frames]
    assert [frame.stamp for frame in moved.frames] == [frame.stamp for frame in right.frames]
    assert any(note.endswith("is taken for frame 0") for note in moved.notes)
    assert not any("no image" in note for note in moved.notes)


def test_mot_beside_a_video(tmp_path):
    write(tmp_path, {"gt/gt.txt": MOT}, ())
    film = cv2.VideoWriter(str(tmp_path / "hall.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (WIDTH, HEIGHT))
    for _ in range(3):
        film.write(np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    film.release()
    source = one(tmp_path)
    assert isinstance(source.images, VideoImages)
    assert [frame.stamp for frame in source.frames] == [0, SECOND // 10, SECOND // 5]
    assert [each.stamp for each in source.images.read()] == [frame.stamp for frame in source.frames]
    assert [len(frame.persons) for frame in source.frames] == [1, 3, 0]
    # The video may be somewhere else.
    other = write(tmp_path / "other", {"gt.txt": MOT}, ())
    assert one(tmp_path / "hall.avi", other / "gt.txt").frames == source.frames


TIMES_MS = (0, 33, 66, 500, 900)


def film_of_a_phone(path: Path, **options: str) -> Path:
    """Write a video with a variable frame rate, each image brighter than the one before."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for number, time_ms in enumerate(TIMES_MS):
            frame = av.VideoFrame.from_ndarray(np.full((HEIGHT, WIDTH, 3), 40 * number, np.uint8), format="rgb24")
            frame.pts, frame.time_base = time_ms, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(("suffix", "options"), [(".mp4", {}), (".mkv", {}), (".mkv", {"live": "1"})])
def test_video_with_a_variable_frame_rate_has_its_own_times(tmp_path, suffix, options):
    film_of_a_phone(tmp_path / f"hall{suffix}", **options)
    source = one(write(tmp_path, {"gt.txt": MOT}, ()))
    assert [frame.stamp for frame in source.frames] == [time * SECOND // 1000 for time in TIMES_MS]
    read = [(each.stamp, round(each.bgr().mean() / 40)) for each in source.images.read()]
    assert read == [(frame.stamp, number) for number, frame in enumerate(source.frames)]


def test_labelled_images_of_a_video_with_a_variable_frame_rate(tmp_path):
    film_of_a_phone(tmp_path / "hall.mkv")
    text = CVAT_IMAGES.replace("a.jpg", "frame_000002").replace("b.jpg", "frame_000004")
    source = one(write(tmp_path, {"annotations.xml": text}, ()))
    assert [frame.stamp for frame in source.frames] == [TIMES_MS[2] * SECOND // 1000, TIMES_MS[4] * SECOND // 1000]
    source = one(write(tmp_path, {"annotations.xml": CVAT_VIDEO}, ()))
    assert [frame.stamp for frame in source.frames] == [time * SECOND // 1000 for time in TIMES_MS]


def test_two_images_of_one_frame_of_a_video_are_refused(tmp_path):
    film_of_a_phone(tmp_path / "hall.mp4")
    text = CVAT_IMAGES.replace("a.jpg", "east/frame_2").replace("b.jpg", "west/frame_2")
    with pytest.raises(TruthError, match=r"east/frame_2 and west/frame_2 are the same file, an image of .*hall"):
        one(write(tmp_path, {"annotations.xml": text}, ()))


def test_many_mot_sequences(tmp_path):
    for name in ("MOT-02", "MOT-10"):
        write(tmp_path / "train" / name, {"gt/gt.txt": MOT}, ("img1/000001.jpg", "img1/000002.jpg"))
    for folder in (tmp_path, tmp_path / "train"):
        assert [source.name for source in labelled_sources(folder)] == ["MOT-02", "MOT-10"]
    # Test sequences come without labels.
    write(tmp_path / "test" / "MOT-01", {"seqinfo.ini": SEQINFO}, ("img1/000001.jpg",))
    first, second = labelled_sources(tmp_path)
    assert (first.name, second.name) == ("MOT-02", "MOT-10")
    assert [note for note in first.notes if "MOT-01" in note] == ["1 sequences have no labels, the first: MOT-01"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1,1,2,3", "line 2: 4 columns"),
        ("1,1,2,x,4,5,1,1,1", "line 2: 'x' in column 4 is not a number"),
        ("1,1,2,nan,4,5,1,1,1", "line 2: 'nan' in column 4"),
        ("1,1,2,3,-4,5,1,1,1", "line 2: the box 2, 3, -4, 5"),
        ("1.5,1,2,3,4,5,1,1,1", "line 2: frame 1.5 and id 1 must be whole numbers"),
        ("1,1,2,3,4,5,1,1,1", "line 2: id 1 has two boxes in one image"),
    ],
)
def test_broken_mot(tmp_path, line, message):
    write(tmp_path, {"gt/gt.txt": f"1,1,40,20,30,80,1,1,1\n{line}\n"}, EXAMPLES["mot"][2])
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path)
    assert "gt.txt" in str(error.value)
    assert error.value.remedy


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("1,0,59,43,17,19,1,4,0,0\n1,1,40,20,30,80,1,1,0,2\n", "class, truncation and occlusion, as in VisDrone"),
        ("84,8,27,11,0,0,0,0\n55,22,19,28,1,1,0,0\n", "no box is wider than one pixel"),
        ("1,1,0.25,0.17,0.19,0.67,1,1,1\n", "no box is wider than one pixel"),
    ],
)
def test_tables_with_other_columns_are_not_mot(tmp_path, lines, message):
    write(tmp_path, {"gt/gt.txt": lines}, EXAMPLES["mot"][2])
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path)
    assert "confidence, class, visibility" in str(error.value.remedy)


def test_mot15_places_on_whole_metres(tmp_path):
    source = one(write(tmp_path, {"gt/gt.txt": "1,1,40,20,30,80,1,0,0,0\n"}, EXAMPLES["mot"][2]))
    assert len(source.frames[0].persons) == 1


def test_broken_seqinfo(tmp_path):
    write(tmp_path, {"gt/gt.txt": MOT, "seqinfo.ini": "[Sequence]\nframeRate=fast\n"}, EXAMPLES["mot"][2])
    with pytest.raises(TruthError, match="frameRate is 'fast'"):
        labelled_sources(tmp_path)
    write(tmp_path, {"seqinfo.ini": "frameRate=3\n"}, ())
    with pytest.raises(TruthError, match=r"seqinfo.ini: cannot be read"):
        labelled_sources(tmp_path)


# KITTI


def test_kitti_distances_and_ignored(tmp_path):
    _, files, images = EXAMPLES["kitti"]
    [frame] = one(write(tmp_path, files, images)).frames
    walking, sitting, cyclist = frame.persons
    assert walking.distance_m == 5  # 3 m to the side, 4 m ahead
    assert not walking.ignore
    assert sitting.ignore  # four fifths are cut off
    assert cyclist.ignore
    assert [region.box for region in frame.ignore] == [(0, 0, 20, 20)]
    assert frame.ranged


@pytest.mark.parametrize(
    ("labels", "images"),
    [("default/label_2/a.txt", "default/image_2/a.png"), ("label_2/train/a.txt", "image_2/train/a.png")],
)
def test_kitti_in_the_folder_of_a_part(tmp_path, labels, images):
    """Exports of CVAT and Datumaro have a folder for each subset."""
    write(tmp_path, {labels: KITTI}, (images,))
    assert len(one(tmp_path).frames[0].persons) == 3


def test_kitti_tracking(tmp_path):
    _, files, images = EXAMPLES["kitti tracking"]
    source = one(write(tmp_path, files, images))
    assert [len(frame.persons) for frame in source.frames] == [1, 0, 1]
    assert [frame.stamp for frame in source.frames] == [0, SECOND // 10, SECOND // 5]
    assert source.identities
    assert source.frames[0].persons[0].id == "4"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Pedestrian 0 0 0 1 2 3 4", "000004.txt, line 6: 8 columns instead of 15"),
        ("Pedestrian 0 0 0 x 2 3 4 1 1 1 1 1 1 1", "line 6: 'x' in column 4"),
        ("Pedestrian 0 0 0 9 2 3 4 1 1 1 1 1 1 1", "line 6: the box 9, 2, -6, 2"),
    ],
)
def test_broken_kitti(tmp_path, line, message):
    write(tmp_path, {"label_2/000004.txt": KITTI + line + "\n"}, ("image_2/000004.png",))
    with pytest.raises(TruthError, match=message):
        labelled_sources(tmp_path)


# CVAT


def test_cvat_images(tmp_path):
    _, files, images = EXAMPLES["cvat images"]
    source = one(write(tmp_path, files, images))
    assert source.name == "hall"
    first, second = source.frames
    assert [person.box for person in first.persons] == [BOX, (90, 20, 20, 40)]
    assert second.persons == ()
    assert source.notes == ("not used: 1 box of class car", "not used: 1 box of shape points")


@pytest.mark.parametrize("folder", ["images/{}/", "images/default/{}/", "{}/"])
def test_cvat_projects_have_images_of_the_same_name_in_subsets(tmp_path, folder):
    """Projects number the images of each task from 0, and their exports have a folder for each subset."""
    person = '<box label="person" xtl="40" ytl="20" xbr="70" ybr="100"></box>'
    entry = '<image id="0" name="a.jpg" subset="{}" task_id="{}" width="160" height="120">{}</image>'
    text = entry.format("Train", 3, person) + entry.format("Test", 4, person * 2) + entry.format("Val", 5, "")
    images = tuple(f"{folder.format(part)}a.jpg" for part in ("Train", "Test", "Val"))
    source = one(write(tmp_path, {"annotations.xml": f"<annotations>{text}</annotations>"}, images))
    assert isinstance(source.images, FolderImages)
    shown = {
        Path(name).parent.name: len(frame.persons)
        for name, frame in zip(source.images.images, source.frames, strict=True)
    }
    assert shown == {"Train": 1, "Test": 2, "Val": 0}


@pytest.mark.parametrize(
    ("shape", "box"),
    [
        ('<box label="person" xtl="20" ytl="50" xbr="100" ybr="70" rotation="90.00"></box>', (50, 20, 20, 80)),
        ('<box label="person" xtl="20" ytl="50" xbr="100" ybr="70" rotation="180"></box>', (20, 50, 80, 20)),
        ('<box label="person" xtl="40" ytl="40" xbr="80" ybr="80" rotation="45"></box>', (31.72, 31.72, 56.57, 56.57)),
        ('<ellipse label="person" cx="60" cy="60" rx="10" ry="40"></ellipse>', (50, 20, 20, 80)),
        ('<ellipse label="person" cx="60" cy="60" rx="10" ry="40" rotation="270"></ellipse>', (20, 50, 80, 20)),
        (
            """<skeleton label="person"><points label="1" outside="0" points="50,20"></points>
            <points label="2" outside="0" points="70,100"></points>
            <points label="3" outside="1" points="0,0"></points></skeleton>""",
            (50, 20, 20, 80),
        ),
    ],
)
def test_cvat_box_around_other_shapes(tmp_path, shape, box):
    head, _, rest = CVAT_IMAGES.partition("    <box")
    source = one(write(tmp_path, {"annotations.xml": head + shape + rest[rest.index("</image>") :]}, ("images/a.jpg",)))
    assert source.frames[0].persons[0].box == pytest.approx(box, abs=0.01)


def test_cvat_skeleton_without_visible_points_is_told(tmp_path):
    shape = '<skeleton label="person"><points label="1" outside="1" points="50,20"></points></skeleton>'
    text = CVAT_IMAGES.replace("  </image>", f"{shape}</image>", 1)
    source = one(write(tmp_path, {"annotations.xml": text}, ("images/a.jpg", "images/b.jpg")))
    assert "not used: 1 box of shape skeleton" in source.notes


def test_cvat_images_of_a_video(tmp_path):
    text = CVAT_IMAGES.replace("a.jpg", "frame_000000").replace("b.jpg", "frame_000003")
    write(tmp_path, {"annotations.xml": text}, ())
    film = cv2.VideoWriter(str(tmp_path / "hall.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 20, (160, 120))
    for _ in range(5):
        film.write(np.full((120, 160, 3), 90, np.uint8))
    film.release()
    source = one(tmp_path)
    assert [(frame.name, frame.stamp) for frame in source.frames] == [
        ("frame_000000", 0),
        ("frame_000003", 150_000_000),
    ]
    assert not source.identities


def test_cvat_tracks_outside_and_between_key_frames(tmp_path):
    source = one(write(tmp_path, {"annotations.xml": CVAT_VIDEO}, FOUR))
    assert [[person.box for person in frame.persons] for frame in source.frames] == [
        [BOX], [(45, 20, 30, 80)], [(50, 20, 30, 80)], [],
    ]  # fmt: skip
    assert {person.id for frame in source.frames for person in frame.persons} == {"3"}
    assert source.identities
    assert source.frames[0].size == (WIDTH, HEIGHT)


def with_distances(text: str, *distances: str) -> str:
    """Give the boxes of a CVAT file a distance, in order."""
    head, *boxes = text.split("</box>")
    ends = [f'<attribute name="distance_m">{each}</attribute></box>' for each in distances]
    return head + "".join(end + box for end, box in zip(ends, boxes, strict=True))


def test_cvat_distances_in_attributes(tmp_path):
    source = one(write(tmp_path / "1", {"annotations.xml": with_distances(CVAT_VIDEO, "2.0", "4", "")}, FOUR))
    assert [[each.distance_m for each in frame.persons] for frame in source.frames] == [[2.0], [3.0], [4.0], []]
    assert source.frames[0].ranged
    text = with_distances(CVAT_IMAGES, "", "1.5")
    source = one(write(tmp_path / "2", {"annotations.xml": text}, ("a.jpg", "b.jpg")))
    assert [each.distance_m for each in source.frames[0].persons] == [None, None]
    text = with_distances(CVAT_VIDEO, "near", "", "")
    with pytest.raises(TruthError, match="line 7, distance_m: 'near' in column 1 is not a number"):
        one(write(tmp_path / "3", {"annotations.xml": text}, FOUR))


def test_cvat_with_steps_between_frames(tmp_path):
    text = CVAT_VIDEO.replace("<mode>", "<start_frame>10</start_frame><frame_filter>step=3</frame_filter><mode>")
    text = text.replace('frame="0"', 'frame="10"').replace('frame="2"', 'frame="13"').replace('frame="3"', 'frame="16"')
    images = ("images/frame_000010.png", "images/frame_000013.png", "images/frame_000016.png")
    source = one(write(tmp_path, {"annotations.xml": text}, images))
    assert [len(frame.persons) for frame in source.frames] == [1, 1, 0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CVAT_IMAGES.replace('xtl="40.00"', ""), "line 6: <box> has no xtl"),
        (CVAT_IMAGES.replace("40.00", "left"), "line 6, xtl: 'left' in column 1"),
        (CVAT_VIDEO.replace('frame="2"', 'frame="-2"'), "frame is -2"),
        (CVAT_IMAGES.replace("</annotations>", ""), "not valid XML: no element found"),
    ],
)
def test_broken_cvat(tmp_path, text, message):
    write(tmp_path, {"annotations.xml": text}, ("images/a.jpg", "images/b.jpg", *FOUR))
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path, format="cvat")
    assert "annotations.xml" in str(error.value)
