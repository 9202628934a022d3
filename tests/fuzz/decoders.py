"""Everything of socialbot that reads what others wrote, each as a function of bytes.

For bad input a decoder raises SocialbotError and nothing else. The seeds are what the project itself writes.
"""

from __future__ import annotations

import functools
import io
import itertools
import json
import os
import sys
import tempfile
import wave
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from socialbot.agents.dialogue.language_model import Prompt
from socialbot.agents.dialogue.proposals import Proposals, Whitelist
from socialbot.agents.dialogue.script import Script, load_script
from socialbot.agents.hospital.missions import HospitalCoordinator
from socialbot.agents.hospital.ward.ward import paper_ward
from socialbot.agents.hospital.ward.ward import parse_faults as parse_ward_faults
from socialbot.agents.reception.building import load_building
from socialbot.agents.teams.missions import CoordinatorMemory
from socialbot.agents.warehouse.layout import parse_layout
from socialbot.agents.warehouse.scenario import parse_faults as parse_warehouse_faults
from socialbot.agents.warehouse.scenario import scenario_of
from socialbot.bags import codec
from socialbot.bags.image_files import decode_image, open_video
from socialbot.bags.types import RosbagsTypes
from socialbot.bdi import Engine, Failed, Record
from socialbot.bdi.agentspeak.loading import load as load_program
from socialbot.bdi.agentspeak.projects import read_project
from socialbot.bdi.saving import read as read_mind
from socialbot.bdi.saving import restore, write
from socialbot.bdi.stdlib._strings import replaced
from socialbot.bdi.trace import JsonLines, read_trace
from socialbot.bridge.keys import Keys, load_private_key
from socialbot.bridge.message_tags import LEAST_BYTES, TagKeys
from socialbot.bridge.security import Freshness, Opener, Stream
from socialbot.bridge.topics import parse_message
from socialbot.core import limits, paths
from socialbot.core.clock import ManualClock
from socialbot.core.errors import RuleError, SocialbotError
from socialbot.core.messages import (
    BoxMarkers,
    CameraInfo,
    CompressedImage,
    Image,
    JointTrajectory,
    Message,
    Structured,
)
from socialbot.core.registry import graph_names, graph_text, node_types
from socialbot.deliberation.files import load_beliefs, load_desires, load_rules, restore_mind, save_mind
from socialbot.deliberation.requests import Policies
from socialbot.graph import files as graph_file
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig, check_parameters
from socialbot.planning.pddl.domain import parse_plan
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.robots.profile import parse_profile
from socialbot.robots.simulation.people import read_script
from socialbot.robots.simulation.place import read_place
from socialbot.runs._server import LONGEST_QUESTION
from socialbot.runs.asking import answer
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.sweeps import BagResult
from socialbot.runtime.deployment import load_deployment
from socialbot.runtime.sweeps import Journal, parse_variation
from socialbot.speech.audio import read_wav
from socialbot.speech.neural import read_config, split
from socialbot.speech.spoken_text import spoken_text
from socialbot.vision.camera import CameraModel, read_calibration
from socialbot.vision.camera_pose import load_pose
from socialbot.vision.images import ENCODINGS, bgr_from_compressed, bgr_from_image
from socialbot.vision.metrics.formats import labelled_sources, sniff
from socialbot.vision.metrics.frames import load_labels
from socialbot.vision.metrics.truth import load_truth, truth_from_messages
from tests.deliberation.office import Office, job
from tests.fuzz.bag_decoders import bag_decoders, sensor_decoders
from tests.fuzz.decoder import STAMP, Decoder, StringMessage, text_of
from tests.fuzz.examples import example, structured
from tests.fuzz.node_decoders import node_decoders
from tests.fuzz.run_folders import QUESTIONS, read_all, recorded_lines, write_run
from tests.fuzz.run_folders import mutated as with_wrong_values
from tests.vision.test_camera import CALIBRATION

ROOT = Path(graph_file.__file__).parents[1]
TYPES = RosbagsTypes()
PROJECT = b"""MAS room {
    environment: room:Room(20)
    agents: a b.asl [beliefs="likes(20)", goals="greet"]; // one
            a #2;  /* two */
    aslSourcePath: "src/asl";
}
"""
DEPLOYMENT = b"""graph: waldo
domain: 42
discovery: {server: 'robot:11811'}
machines:
  robot: {address: 10.77.0.1}
  workstation: {address: 10.77.0.2}
nodes: {camera: robot, image_converter: workstation, person_detector: workstation, bdi_engine: workstation,
  listener: workstation, speech: robot, head: robot}
pictures:
  /camera/image_raw: {transport: jpeg, quality: 80, rate_hz: 30}
restart: {times: 5, within_s: 60, first_s: 0.2, longest_s: 5}
parameters:
  bdi_engine: {greeting: Hallo}
"""
PROBLEM = b"""(define (problem tidy) (:domain cleaner-domain)
  (:objects robot - cleaner home kitchen - waypoint) ; two rooms
  (:init (in robot home) (dock home) (workfree robot) (= (battery_charge robot) 90.5))
  (:goal (and (cleaned kitchen) (not (dirty home)) (> (battery_charge robot) 1e1)))
  (:metric minimize (total-time)))
"""


@functools.cache
def decoders() -> tuple[Decoder, ...]:
    """All of them."""
    bags = bag_decoders(tuple(_images()), tuple(_compressed()), scratch())
    return tuple(itertools.chain(_messages(), sensor_decoders(), _files(), _minds(), bags, _words(), node_decoders()))


# Messages


def _messages() -> Iterator[Decoder]:
    texts = tuple(msgspec.json.encode(message) for message in structured())
    yield Decoder(
        "json", lambda data: codec.decode(Structured, StringMessage(text_of(data))), (*texts, b"good morning")
    )
    yield Decoder("cdr-string", _cdr(Structured), tuple(map(_serialized, structured())))
    yield Decoder("cdr-image", _cdr(Image, bgr_from_image, Image.bgr), tuple(map(_serialized, _images())))
    pictures = tuple(map(_serialized, _compressed()))
    yield Decoder("cdr-compressed-image", _cdr(CompressedImage, bgr_from_compressed), pictures)
    info = CameraInfo(
        stamp=STAMP, frame_id="camera", width=8, height=6, k=(500, 0, 4, 0, 500, 3, 0, 0, 1), d=(0.1,) * 5
    )
    yield Decoder("cdr-camera-info", _cdr(CameraInfo, CameraModel.from_info), (_serialized(info),))
    motion = JointTrajectory(
        stamp=STAMP, joint_names=("pan", "tilt"), positions=(0.1, 0.2), velocities=(0.0, 0.0), duration_s=0.5
    )
    yield Decoder("cdr-trajectory", _cdr(JointTrajectory), (_serialized(motion),))
    boxes = BoxMarkers(stamp=STAMP, frame_id="camera", boxes=((1.0, 2.0, 3.0, 4.0),))
    yield Decoder("cdr-boxes", _cdr(BoxMarkers), (_serialized(boxes),))
    files = tuple(bytes(picture.data) for picture in _compressed())
    yield Decoder("picture", lambda data: bgr_from_compressed(_picture(data)), files)
    encoded = tuple(
        cv2.imencode(suffix, np.zeros((6, 8, 3), np.uint8))[1].tobytes()
        for suffix in (".png", ".jpg", ".bmp", ".ppm", ".tiff", ".webp")
    )
    yield Decoder("image-file", lambda data: decode_image(data, where="image"), encoded)
    sealed = tuple(_stream().seal(text_of(text)).encode() for text in texts[:4])
    yield Decoder("sealed", lambda data: _opener().open(text_of(data)), sealed)
    tags = tuple(_tag_keys().seal(_keys(), "stream", number, bytes(LEAST_BYTES)) or "" for number in range(3))
    yield Decoder("tags", _read_tags, tuple(text.encode() for text in tags))
    yield Decoder("sent-by-hand", _by_hand, tuple(_handwritten(message) for message in structured()))


def _serialized(message: Message) -> bytes:
    return TYPES.serialize(codec.encode(message, TYPES))


def _cdr(kind: type[Message], *uses: Callable[[Any], object]) -> Callable[[bytes], object]:
    """Decodes a serialised message and does with it what a node would."""
    name = codec.ros_type(kind)

    def decode(data: bytes) -> None:
        message = codec.decode(kind, TYPES.deserialize(data, name))
        for use in uses:
            with suppress(SocialbotError):
                use(message)

    return decode


def _images() -> Iterator[Image]:
    for encoding in ENCODINGS:
        data = np.arange(4 * 16, dtype=np.uint8)
        yield Image(stamp=STAMP, frame_id="camera", height=4, width=4, encoding=encoding, step=16, data=data)


def _compressed() -> Iterator[CompressedImage]:
    pixels = np.arange(12 * 16 * 3, dtype=np.uint8).reshape(12, 16, 3)
    for suffix, options in ((".jpg", []), (".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]), (".png", [])):
        data = cv2.imencode(suffix, pixels, options)[1].reshape(-1)
        yield CompressedImage(stamp=STAMP, frame_id="camera", format=suffix[1:], data=data)


def _picture(data: bytes) -> CompressedImage:
    return CompressedImage(stamp=STAMP, frame_id="", format="jpeg", data=np.frombuffer(data, np.uint8))


@functools.cache
def _keys() -> Keys:
    private = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
    return Keys("robot", private, {"robot": private.public_key()})


def _stream() -> Stream:
    return Stream(_keys(), "ROS domain 42", "/speech/say", now=lambda: STAMP)


def _opener() -> Opener:
    freshness = Freshness(2.0, joins_late=True, now=lambda: STAMP, steady=int)
    return Opener(_keys(), "ROS domain 42", "/speech/say", freshness)


def _tag_keys() -> TagKeys:
    return TagKeys("ROS domain 42", "/camera/image_raw")


def _read_tags(data: bytes) -> None:
    tag = _tag_keys().read(text_of(data), _keys(), _keys().trusted["robot"], "stream", 1)
    if tag is not None:
        tag.fits(data)


def _by_hand(data: bytes) -> Message:
    schema, _, text = text_of(data).partition("\n")
    return parse_message(schema, text, stamp=STAMP)


def _handwritten(message: Structured) -> bytes:
    fields = msgspec.to_builtins(message)
    del fields["schema"]
    return f"{type(message).__name__}\n".encode() + msgspec.json.encode(fields)


# Files


@functools.cache
def _root() -> tempfile.TemporaryDirectory[str]:
    memory = Path("/dev/shm")
    folder = tempfile.TemporaryDirectory(prefix="socialbot-fuzz-", dir=memory if memory.is_dir() else None)
    paths.allow(Path(folder.name))
    return folder


def scratch() -> Path:
    """The folder of this process for files to be read, in memory where there is such a place."""
    folder = Path(_root().name, str(os.getpid()))
    folder.mkdir(exist_ok=True)
    return folder


def _file(read: Callable[[Path], object], name: str = "input") -> Callable[[bytes], object]:
    """Has ``read`` read a file."""

    def decode(data: bytes) -> object:
        path = scratch() / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        return read(path)

    return decode


def _content(*names: str) -> tuple[bytes, ...]:
    return tuple((ROOT / name).read_bytes() for name in names)


@contextmanager
def _same_path() -> Iterator[None]:
    before = list(sys.path)
    try:
        yield
    finally:
        sys.path[:] = before


def _load_graph(path: Path) -> None:
    with _same_path():
        graph_file.load_graph(str(path))


def _load_deployment(path: Path) -> None:
    with _same_path():
        load_deployment(path)


def _files() -> Iterator[Decoder]:
    graphs = tuple(text.encode() for name in graph_names() if (text := graph_text(name)))
    yield Decoder("graph", _file(_load_graph, "graph.yaml"), graphs)
    yield Decoder("deployment", _file(_load_deployment, "deployment.yaml"), (DEPLOYMENT,))
    domains = _content(
        "agents/cleaner/cleaner.pddl", "agents/cleaner/team_cleaner.pddl", "agents/warehouse/carrier.pddl",
        "agents/warehouse/gripper.pddl",
    )  # fmt: skip
    yield Decoder("domain", lambda data: read_domain(text_of(data)), domains)
    cleaner = read_domain(text_of(domains[0]))
    yield Decoder("problem", lambda data: read_problem(text_of(data), cleaner), (PROBLEM,))
    plan = b"; cost 1\n0.000: (move cleaner_1 base room_a) [5.000]\n5.001: (clean room_a)  [1e1] ; last\n"
    yield Decoder("plan", lambda data: parse_plan(text_of(data)), (plan,))
    for name, read in (("beliefs", load_beliefs), ("desires", load_desires), ("rules", load_rules)):
        seeds = _content(f"agents/cleaner/cleaner_{name}.yaml")
        yield Decoder(name, _file(functools.partial(read, domain=cleaner)), seeds)
    person = b'{"id": "a", "x": 1.5, "y": 2, "w": 3, "h": 4, "distance_m": 2.0, "visible": 1}'
    about = b'"version": 1, "image_topic": "/camera/image_raw", "scene": "one", "split": "tune"'
    frames = b'{"stamp": 1, "light": "sun", "persons": [' + person + b']}, {"stamp": 2, "persons": []}'
    truth = b'{"schema": "socialbot/truth", ' + about + b', "frames": [' + frames + b"]}"
    frame = b'{"schema": "socialbot/truth_frame", ' + about + b', "stamp": 1, "persons": [' + person + b"]}"
    yield Decoder("truth", _file(load_truth), (truth,))
    yield Decoder("truth-messages", lambda data: truth_from_messages(text_of(data).split("\n\n"), "bag"), (frame,))
    pictures = b'[{"image": "a.jpg", "boxes": [{"x": 1, "y": 2, "w": 30, "h": 40}], "complete": false, "scene": "one"}]'
    yield Decoder("pictures", _file(load_labels), (pictures,))
    yield from _data_sets()
    yield Decoder("private-key", _private_key, (_pem(),))
    yield Decoder("video", _file(_read_video, "video.avi"), (_video(),))
    yield Decoder("wav", _file(read_wav, "sound.wav"), (_wav(1), _wav(2)))
    pose = b'{"height_m": 1.2, "pitch_rad": 0.1, "height_std_m": 0.1, "pitch_std_rad": 0.01, "people": 4}'
    yield Decoder("camera-pose", _file(load_pose, "a.camera.json"), (pose,))
    yield Decoder("calibration", _file(read_calibration, "ost.yaml"), (CALIBRATION.encode(),))
    yield Decoder("project", _file(_read_project, "a.mas2j"), (PROJECT,))
    dialogue = _content("agents/waldo/small_talk.yaml")
    yield Decoder("dialogue", lambda data: load_script("dialogue", text_of(data)), dialogue)
    places = _content("robots/simulation/places/foyer.yaml", "robots/simulation/places/office.yaml")
    yield Decoder("place", lambda data: read_place(text_of(data), where="place"), places)
    layouts = (b"carriers: 2\nstacks: [[box_1], []]\ndeposits: [[box_1], []]\n", b"carriers: 3\nboxes: 9\nseed: 3\n")
    yield Decoder("layout", lambda data: parse_layout(text_of(data), where="layout"), layouts)
    script = b"place: foyer\npeople:\n- id: ada\n  enter: entrance\n  legs: [{walk: [1, 2]}, {talk: 6, to: ada}]\n"
    yield Decoder("people-script", lambda data: read_script(text_of(data), where="script"), (script,))
    building = _content("agents/reception/building.yaml")
    yield Decoder("building", lambda data: load_building("building", text_of(data)), building)
    journal = Journal(scratch() / "made" / "results.jsonl")
    journal.add("a", BagResult(bag="film"))
    yield Decoder("sweep-journal", _file(Journal, "sweep/results.jsonl"), (journal.path.read_bytes(),))
    config = {"phoneme_id_map": {"^": [1], "$": [2], "_": [0]}, "espeak": {"voice": "en"}, "audio": {"sample_rate": 1}}
    yield Decoder("voice", _file(read_config, "a.onnx.json"), (json.dumps(config).encode(),))
    robots = _content("robots/profiles/tiago.yaml")
    yield Decoder("robot", lambda data: parse_profile(text_of(data), "robot.yaml"), robots)


def _read_project(path: Path) -> object:
    for name in ("a.asl", "b.asl"):
        (path.parent / name).touch()
    return read_project(path)


def _wav(width: int) -> bytes:
    file = io.BytesIO()
    with wave.open(file, "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(width)
        sound.setframerate(16_000)
        sound.writeframes(bytes(range(100)) * 2 * width)
    return file.getvalue()


def _video() -> bytes:
    path = scratch() / "made.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (16, 12))
    for _ in range(2):
        writer.write(np.zeros((12, 16, 3), np.uint8))
    writer.release()
    return path.read_bytes()


def _read_video(path: Path) -> None:
    capture = open_video(path)
    for _ in range(3):
        capture.read()
    capture.release()


def _data_sets() -> Iterator[Decoder]:
    box = b"40.00 20.00 70.00 100.00 1.89 0.48 1.20 3.00 1.47 4.00 0.01\n"
    coco = (
        b'{"images": [{"id": 1, "file_name": "a.png", "width": 160, "height": 120, "video_id": 1, "frame_id": 0}],'
        b' "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [40, 20, 30, 80], "area": 9, "iscrowd": 0'
        b', "instance_id": 2}], "categories": [{"id": 1, "name": "person"}], "videos": [{"id": 1, "fps": 10}]}'
    )
    voc = (
        b"<annotation><filename>a.png</filename><size><width>160</width><height>120</height></size><object>"
        b"<name>person</name><difficult>0</difficult><bndbox><xmin>40</xmin><ymin>20</ymin><xmax>70</xmax>"
        b"<ymax>100</ymax></bndbox></object></annotation>"
    )
    sides = b'occluded="0" xtl="40" ytl="20" xbr="70" ybr="100"'
    images = (
        b'<annotations><image id="0" name="a.png" width="160" height="120"><box label="person" ' + sides + b"/>"
        b'<polygon label="person" points="1.0,2.0;3.5,2;3,9"/></image></annotations>'
    )
    track = (
        b'<annotations><meta><task><start_frame>0</start_frame></task></meta><track id="1" label="person">'
        b'<box frame="0" outside="0" ' + sides + b'/><box frame="4" outside="0" ' + sides + b"/></track></annotations>"
    )
    examples: dict[str, tuple[str, tuple[bytes, ...]]] = {
        "coco": ("coco.json", (coco,)),
        "mot": ("gt.txt", (b"1,1,40,20,30,80,1,1,0.75\n1,2,90,20,30,80,1,1,1\n", b"1,1,40,20,30,80,1,-1,-1,-1\n")),
        "kitti": ("a.txt", (b"Pedestrian 0.00 0 -0.20 " + box, b"0 1 Pedestrian 0 0 -0.20 " + box)),
        "yolo": ("labels/a.txt", (b"0 0.34375 0.5 0.1875 0.66666667\n", b"0 0.25 0.5 0.5 0.5 0.25 0.75\n")),
        "yolo-names": (
            "data.yaml",
            (b"train: .\nnames: [person, car]\n", b"names:\n  0: person\nkpt_shape: [17, 3]\n"),
        ),
        "seqinfo": ("seqinfo.ini", (b"[Sequence]\nname=A\nimDir=.\nframeRate=30\nseqLength=1\n",)),
        "voc": ("a.xml", (voc,)),
        "cvat": ("annotations.xml", (images, track)),
    }
    for name, (file, seeds) in examples.items():
        yield Decoder(f"labels-{name}", functools.partial(_labels, name.partition("-")[0], file), seeds)


@functools.cache
def _pixels() -> bytes:
    return cv2.imencode(".png", np.zeros((120, 160, 3), np.uint8))[1].tobytes()


def _labels(format: str, name: str, data: bytes) -> None:
    """Read a data set of one image, with one file of ``data``."""
    folder = scratch() / f"data-set-{name.replace('/', '-')}"
    for path, content in ((folder / "a.png", _pixels()), (folder / name, data)):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    if name == "data.yaml":
        (folder / "labels").mkdir(exist_ok=True)
        (folder / "labels" / "a.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    if format == "seqinfo":
        format = "mot"
        (folder / "gt.txt").write_text("1,1,40,20,30,80,1,1,1\n")
    file = folder / name
    place = folder if name in ("data.yaml", "seqinfo.ini", "labels/a.txt") else file
    sniff(file)
    sniff(folder)
    labelled_sources(folder, None if place == folder else place, format)


def _pem() -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    return _keys().private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def _private_key(data: bytes) -> None:
    path = scratch() / "robot.private.pem"
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(data)
    load_private_key(path)


# Programs and minds


def _engine() -> Engine:
    return Engine("fuzz", ManualClock(STAMP), seed=1)


def _minds() -> Iterator[Decoder]:
    programs = _content("agents/hospital/nurse.asl", "agents/hospital/uvd.asl", "agents/hospital/spot.asl")
    yield Decoder("agentspeak", lambda data: load_program(_engine(), text_of(data)), programs)
    replaced = (b"(ab)+\nabab", b"[a-z]+ (x|y)\nab x", b"(?P<n>a{2,3}?)\\1\naaaa")
    yield Decoder("regular-expression", _replaced, replaced)
    program = 'light(on). !wander. @p[atomic] +!wander : light(on) <- -light(on); +light([1, 2.5, "x", f(y)]); !later.'
    engine = _engine()
    load_program(engine, program)
    path = scratch() / "mind"
    write(engine, path)
    yield Decoder("mind", _file(_restored), (path.read_bytes(),))
    office = Office()
    office.want(job("a"))
    save_mind(office.deliberator, path)
    yield Decoder("kept", _file(_recalled), (path.read_bytes(),))
    memory = msgspec.json.encode(example(msgspec.inspect.type_info(CoordinatorMemory)))
    yield Decoder("memory", _file(_remembered), (memory, msgspec.json.encode(CoordinatorMemory())))
    with JsonLines(path) as trace:
        for number, kind in enumerate(("belief", "plan", "action")):
            trace(Record(f"r{number}", STAMP + number, kind, "wander", f"r{number - 1}", {"source": "self"}))
    yield Decoder("trace", _file(read_trace), (path.read_bytes(),))
    for name, (lines, _) in recorded_lines().items():
        yield Decoder(f"run-{name}", functools.partial(_read_run, name), (b"\n".join(lines) + b"\n",))
    yield Decoder("question", _asked, tuple(question.encode() for question in QUESTIONS))
    yield Decoder("run-values", lambda data: _read_run(*with_wrong_values(data)), (b"0",))


def _read_run(name: str, trace: bytes) -> None:
    read_all(write_run(scratch() / "run", name, trace))


@functools.cache
def _asked_run() -> RecordedRun:
    return open_run(write_run(scratch() / "asked", "waldo", b"\n".join(recorded_lines()["waldo"][0]) + b"\n"))


def _asked(data: bytes) -> None:
    msgspec.json.encode(answer(_asked_run(), text_of(data)[:LONGEST_QUESTION]))


def _replaced(data: bytes) -> None:
    pattern, _, text = text_of(data).partition("\n")
    try:
        replaced(".replace", pattern, "", text)
    except Failed as failed:
        raise RuleError(str(failed)) from failed


def _restored(path: Path) -> None:
    restore(_engine(), read_mind(path))


def _recalled(path: Path) -> None:
    restore_mind(Office(beliefs="").deliberator, path)


def _remembered(path: Path) -> None:
    config = NodeConfig("coordinator", HospitalCoordinator, {"memory_file": str(path)})
    InlineRunner(Graph("fuzz", (config,), inputs=frozenset(topic for topic, _ in config.subscriptions)))


# Words of parameters, and parameters


def _words() -> Iterator[Decoder]:
    ward, cast = paper_ward(), scenario_of()
    room, robot = next(iter(ward.room_by_name)), ward.robots[0]
    seeds = (f"10 dirty {room}; 20.5 drains {robot}; 1e1 silent {room} 5", f"3 stalls {robot} 7; 4 enters {room} 2")
    yield Decoder("ward-faults", lambda data: parse_ward_faults(text_of(data), ward), tuple(map(str.encode, seeds)))
    carrier = next(iter(cast.carriers))
    seeds = (f"10 leaves {carrier}; 20.5 slips; 1e1 silent {carrier} 5; 3 stalls {carrier} 7",)
    yield Decoder(
        "warehouse-faults", lambda data: parse_warehouse_faults(text_of(data), cast), tuple(map(str.encode, seeds))
    )
    policies = (b"a, b\na\nb\na,b\n0.5, 1.0",)
    yield Decoder("policies", _policies, policies)
    yield Decoder("variation", _variation, (b"head.range_m=1:9:0.5", b"head.mode=a,b", b"head.range_m=2:3:1"))
    yield Decoder("said", _said, (b"Where is the *library*, please? <b>Dr. Miller</b> [asks](x) at 2.15.",))
    answers = (
        b'{"intent": "directions", "slots": {"place": "library"}}',
        b"At 2 s, I greeted t1.",
        b"+!greet(X) : near(X) & X > 2 <- say(X); if (near(X)) { say(X + 1) }; ?near(Y); !greet(Y).",
    )
    yield Decoder("proposals", _proposed, answers)
    yield Decoder("parameters", _check_parameters, tuple(_defaults()))


def _variation(data: bytes) -> None:
    parse_variation(text_of(data)).listed()


def _said(data: bytes) -> None:
    """Understand a sentence, and say it."""
    grammar, text = _small_talk().grammar, text_of(data)[: limits.SENTENCE_CHARACTERS]
    for language in grammar.languages:
        grammar.read(text, language)
    for language in ("en", "de", "es", "fr"):
        split(spoken_text(text, language))


@functools.cache
def _small_talk() -> Script:
    return load_script("dialogue", text_of(_content("agents/waldo/small_talk.yaml")[0]))


class _Model:
    """Language model with one answer."""

    def __init__(self, answer: str) -> None:
        self._answer = answer

    def complete(self, prompt: Prompt) -> str:
        return self._answer


def _proposed(data: bytes) -> None:
    proposals = Proposals(_Model(text_of(data)), lambda *_, **__: "r1")
    proposals.intent("Where is the library?", {"directions": ("place",)})
    proposals.phrasing(["I greeted t1 at 2 s."], "I greeted t1 at 2 s.")
    known = Whitelist(goals={"greet": 1}, actions={"say": 1}, beliefs={"near": 1})
    proposals.plan("greet people", known)


def _policies(data: bytes) -> None:
    words = dict(
        zip(("belief_ck", "belief_w", "desire_ck", "desire_w", "desire_pr"), text_of(data).split("\n"), strict=False)
    )
    Policies.parse(**words)


def _node_types() -> Iterator[type[Node]]:
    return (graph_file.node_type(name) for name in node_types())


def _defaults() -> Iterator[bytes]:
    for name in node_types():
        values = {key: parameter.default for key, parameter in graph_file.node_type(name).parameters().items()}
        yield f"{name}\n".encode() + json.dumps(values).encode()


def _check_parameters(data: bytes) -> None:
    """Values of any type, as the parameter service receives them."""
    name, _, text = text_of(data).partition("\n")
    try:
        given = json.loads(text)
    except (ValueError, RecursionError):
        return
    if name in node_types() and isinstance(given, dict):
        check_parameters(graph_file.node_type(name), given, where=name)
