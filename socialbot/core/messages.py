"""Messages of the graph topics.

Every message is an immutable struct with a stamp in ns: a detection carries the stamp of its frame.
``bridge/codec.py`` maps messages to ROS types. A `Structured` message has no ROS type of its own and is sent as JSON
with its schema name and version (``docs/schemas``).
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, cast

import msgspec
import numpy as np

from socialbot.core import limits
from socialbot.core.clock import SECOND
from socialbot.core.decoding import from_builtins
from socialbot.core.errors import GraphError, MessageError

VERSION = 1

NO_JSON = (msgspec.MsgspecError, UnicodeError, RecursionError)
"""Exceptions of msgspec for JSON that is damaged, nested too deeply, or of other types."""

Int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""Number of 64 bits: JSON has longer ones, which neither ROS nor a page can hold."""

Stamp = Annotated[int, msgspec.Meta(ge=0, le=(2**31) * SECOND - 1)]
"""Time in ns that ROS can hold: until 2038."""

Sentence = Annotated[str, msgspec.Meta(max_length=limits.SENTENCE_CHARACTERS)]

Size = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
"""Width or height (pixels), or another number of things."""


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """Base class of all messages, with a stamp in nanoseconds."""

    stamp: Stamp


class Image(Message, frozen=True, kw_only=True):
    """Image of a camera driver (sensor_msgs/Image).

    ``data`` is a flat uint8 array of ``height * step`` bytes; a row may be padded.
    """

    frame_id: str
    height: int
    width: int
    encoding: str
    step: int
    data: np.ndarray
    is_bigendian: bool = False

    @classmethod
    def from_bgr(cls, pixels: np.ndarray, *, stamp: int, frame_id: str) -> Image:
        """Create a bgr8 image from uint8 pixels of shape (height, width, 3)."""
        height, width = pixels.shape[:2]
        flat = np.ascontiguousarray(pixels).reshape(-1)
        return cls(
            stamp=stamp, frame_id=frame_id, height=height, width=width, encoding="bgr8", step=3 * width, data=flat
        )

    def bgr(self) -> np.ndarray:
        """Pixels of a bgr8 image as (height, width, 3), without a copy if rows are not padded.

        Raises MessageError for any other encoding or for data of the wrong size.
        """
        if self.encoding != "bgr8":
            raise MessageError(f"expected a bgr8 image, got {self.encoding!r}", remedy="connect an image_converter")
        if self.step < 3 * self.width or self.data.size < self.height * self.step or not self.height:
            raise MessageError(
                f"{self.data.size} bytes do not fill {self.width}x{self.height} pixels with step {self.step}"
            )
        rows = self.data[: self.height * self.step].reshape(self.height, self.step)
        return rows[:, : 3 * self.width].reshape(self.height, self.width, 3)


class CompressedImage(Message, frozen=True, kw_only=True):
    """JPEG or PNG image (sensor_msgs/CompressedImage); ``data`` is a flat uint8 array."""

    frame_id: str
    format: str
    data: np.ndarray


class CameraInfo(Message, frozen=True, kw_only=True):
    """Camera intrinsics (sensor_msgs/CameraInfo): ``k`` row by row, ``d`` the distortion.

    ``roi`` is the part of the image that the camera sends: x, y, width and height; all 0 for the whole.
    """

    frame_id: str
    width: int
    height: int
    k: tuple[float, ...]
    d: tuple[float, ...] = ()
    distortion_model: str = "plumb_bob"
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)


class DepthImage(Image, frozen=True, kw_only=True):
    """Depth image (sensor_msgs/Image): 16UC1 or mono16 in mm, or 32FC1 in m, along the optical axis.

    0, NaN and infinity mean that there is no measurement.
    """


class CompressedDepth(CompressedImage, frozen=True, kw_only=True):
    """Depth image of compressed_depth_image_transport, or 16-bit PNG (sensor_msgs/CompressedImage)."""


class DepthInfo(CameraInfo, frozen=True, kw_only=True):
    """Intrinsics of a depth camera (sensor_msgs/CameraInfo)."""


class PointField(msgspec.Struct, frozen=True):
    """Field of the points of a cloud (sensor_msgs/PointField); ``offset`` in bytes, ``datatype`` as in ROS."""

    name: str
    offset: int
    datatype: int
    count: int = 1


class PointCloud(Message, frozen=True, kw_only=True):
    """Points of a lidar or depth camera (sensor_msgs/PointCloud2); ``data`` is a flat uint8 array."""

    frame_id: str
    height: int
    width: int
    fields: tuple[PointField, ...]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: np.ndarray


class Transform(msgspec.Struct, frozen=True, kw_only=True):
    """Pose of the frame ``child`` in the frame ``parent``: x, y, z in m, and a quaternion x, y, z, w."""

    stamp: int
    parent: str
    child: str
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class Transforms(Message, frozen=True, kw_only=True):
    """Transforms on /tf or /tf_static (tf2_msgs/TFMessage)."""

    transforms: tuple[Transform, ...]

    @property
    def newest(self) -> int | None:
        """Newest stamp of a transform, ns; None without transforms."""
        return max((each.stamp for each in self.transforms), default=None)

    def shifted(self, by: int) -> Transforms:
        """The same transforms with all stamps later ``by`` ns."""
        if not by:
            return self
        shifted = tuple(msgspec.structs.replace(each, stamp=each.stamp + by) for each in self.transforms)
        return msgspec.structs.replace(self, transforms=shifted)


class JointTrajectory(Message, frozen=True, kw_only=True):
    """Target of some joints (trajectory_msgs/JointTrajectory with a single point).

    Positions in rad, velocities in rad/s, ``duration_s`` the time to get there.
    """

    joint_names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    duration_s: float


class BoxMarkers(Message, frozen=True, kw_only=True):
    """Boxes drawn over an image (visualization_msgs/ImageMarker, a list of lines)."""

    frame_id: str
    boxes: tuple[tuple[float, float, float, float], ...]


Share = Annotated[float, msgspec.Meta(ge=0.0)]


class RosMessage(Message, frozen=True, kw_only=True):
    """Message of any ROS type; its fields are attributes, as in ROS. `ros_message` makes a subclass for each type.

    ``stamp`` (ns) is that of the header, or else the time of the receipt or publication. ``ros`` is the message itself:
    of rclpy in a ROS process, of rosbags in an inline run, with the same fields.
    """

    ros_type: ClassVar[str] = ""
    ros: Any

    def __getattr__(self, name: str) -> Any:
        if name == "ros" or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.ros, name)

    @classmethod
    def of(cls, ros: Any, now: int) -> RosMessage:
        """Wrap a message of rclpy or rosbags; ``now`` (ns) is the stamp of one without a stamp in its header."""
        header = getattr(ros, "header", None)
        stamp = 0 if header is None else header.stamp.sec * SECOND + header.stamp.nanosec
        return cls(stamp=stamp or now, ros=ros)


def ros_message(kind: str | type) -> type[RosMessage]:
    """Return the message class for a ROS type: a name such as ``std_msgs/msg/Float32``, or a class of rclpy or rosbags.

    Raises:
        GraphError: ``kind`` is no ROS type.
    """
    if not isinstance(kind, str):
        if not isinstance(kind, type) or not is_ros_message(kind):
            what = kind.__name__ if isinstance(kind, type) else kind
            remedy = "give a Message of socialbot, a class of ROS, or its name"
            raise GraphError(f"{what} is no message", remedy=remedy)
        package, *_ = kind.__module__.split(".")
        name = getattr(kind, "__msgtype__", "") or f"{package}/msg/{kind.__name__}"
    else:
        parts = kind.split("/")
        name = "/".join((parts[0], parts[1] if len(parts) == 3 else "msg", parts[-1]))
        if not re.fullmatch(r"[a-z]\w*(/(msg|srv|action))?/[A-Z]\w*", kind):
            raise GraphError(f"{kind!r} is no ROS type", remedy="write it as in std_msgs/msg/Float32")
    return _ros_message(name)


def is_ros_message(value: Any) -> bool:
    """Whether a value is a message of rclpy or rosbags, or the class of one."""
    return hasattr(value, "__msgtype__") or hasattr(value, "get_fields_and_field_types")


@functools.cache
def _ros_message(name: str) -> type[RosMessage]:
    short = name.rpartition("/")[2]
    bases = (RosMessage,)
    made = msgspec.defstruct(short, [], bases=bases, frozen=True, kw_only=True, namespace={"ros_type": name})
    return cast("type[RosMessage]", made)


class Structured(
    Message, frozen=True, kw_only=True, tag_field="schema", tag=lambda name: f"socialbot/{name}/{VERSION}"
):
    """Message without a ROS type: JSON in std_msgs/String."""


def check_fields(message: Structured, *, where: str) -> None:
    """Check the types of all fields. Raises MessageError."""
    try:
        from_builtins(msgspec.to_builtins(message), type(message))
    except (TypeError, msgspec.ValidationError) as error:
        raise MessageError(f"no valid {type(message).__name__}: {error}", where=where) from error


class PictureAck(Structured, frozen=True, kw_only=True):
    """Acknowledgement of an image by its ``stamp``, which ``arrived`` at a time of the receiver's clock (ns).

    It covers all earlier images, too. The receiver repeats the last one as a heartbeat. Both times are 0 at first.
    """

    arrived: Stamp


State = Literal["ok", "paused", "waiting", "degraded", "failed", "ended"]
"""State of a node: "paused" by a person, "waiting" for the first input, or "ended" with its recording."""


class Health(Structured, frozen=True, kw_only=True):
    """Health of a node, published at each change and as a heartbeat.

    ``silent`` lists the inputs that have timed out, ``outputs`` the topics that the node publishes. Together they
    trace a timeout to its source.
    """

    node: str
    state: State
    reason: str = ""
    silent: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()


UpState = Literal["up", "ending", "ended"]


class UpStatus(Structured, frozen=True, kw_only=True):
    """Heartbeat of ``socialbot up`` with the ``graph`` and the ``machine``; the last one reports the end.

    ``run`` is a unique id, ``pid`` the process id, and ``boot`` the boot id of the computer. ``reason`` is the error at
    the end, if any.
    """

    run: str
    graph: str
    machine: str
    boot: str
    pid: Int64
    state: UpState
    reason: str = ""


class DownRequest(Structured, frozen=True, kw_only=True):
    """Request to stop the ``socialbot up`` with the id ``run``."""

    run: str


Command = Literal["believe", "forget", "achieve", "drop", "pause", "resume", "step"]
"""Commands from people to an agent."""


AGENT_COMMANDS, AGENT_ANSWERS = "/agents/commands", "/agents/answers"
"""Topics of agent commands and answers, shared by all agents."""


class AgentCommand(Structured, frozen=True, kw_only=True):
    """Command from a person to ``agent``, with a unique ``id``.

    ``text`` is a belief or goal in the notation of the agent. A paused agent processes messages but neither reasons nor
    acts until "resume"; each "step" runs one reasoning cycle.
    """

    id: str
    agent: str
    command: Command
    text: str = ""


class AgentAnswer(Structured, frozen=True, kw_only=True):
    """Answer to the command with this ``id``: accepted, or rejected with a ``reason``."""

    id: str
    agent: str
    accepted: bool
    reason: str = ""


class PersonDetection(msgspec.Struct, frozen=True, kw_only=True):
    """Person in one frame.

    The box is x, y, w, h in pixels with the origin at the top left. ``bearing_rad`` is positive to the left and
    ``elevation_rad`` upwards, from the camera's forward direction in the horizontal plane (REP-103); both point to the
    head. ``distance_m`` is horizontal, ``distance_std_m`` its standard error. ``track_id`` identifies a person across
    frames; it is empty without a tracker, and for a ``tentative`` detection: a tracker does not know yet whether that
    is a person, or who. With ``unseen_s`` above 0 the box is a prediction of that age.

    ``facing_rad`` is the angle between where the person faces and the direction to the camera: 0 towards the camera,
    pi with the back turned. ``approach_mps`` is the speed towards the camera, negative for a person who moves away.
    ``face`` is the box of the face, empty if none was found in this image. For a person without a distance,
    ``distance_source`` is "unknown".
    """

    x: float
    y: float
    w: Share
    h: Share
    score: float
    track_id: str = ""
    tentative: bool = False
    distance_m: float | None = None
    distance_std_m: Share | None = None
    bearing_rad: float | None = None
    elevation_rad: float | None = None
    unseen_s: Share = 0.0
    face: tuple[float, ...] = ()
    facing_rad: Share | None = None
    approach_mps: float | None = None
    posture: Literal["unknown", "standing", "seated"] = "unknown"
    distance_source: Literal["unknown", "image", "depth", "lidar"] = "unknown"


class PersonDetections(Structured, frozen=True, kw_only=True):
    """People in one frame, with the stamp of the frame. An empty list means no detections.

    ``camera_yaw_rad`` is the direction of the camera from that of the robot's base, positive to the left, if transforms
    tell it; then ``camera_hfov_rad`` is its horizontal field of view. ``camera_height_m`` above the floor and
    ``camera_pitch_rad``, positive downwards, are its pose, if ``camera_pose_source`` is known.

    ``faces`` tells whether faces are searched. Without them, ``facing_rad`` is that of walkers only.
    """

    frame_id: str
    width: int
    height: int
    persons: Annotated[tuple[PersonDetection, ...], msgspec.Meta(max_length=limits.PERSONS)]
    camera_yaw_rad: float | None = None
    camera_hfov_rad: float | None = None
    camera_height_m: float | None = None
    camera_pitch_rad: float | None = None
    camera_pose_source: Literal["unknown", "given", "tf", "floor", "file", "people"] = "unknown"
    faces: bool | None = None

    @property
    def id(self) -> str:
        """Id of this message in the trace."""
        return f"detection-{self.stamp}"

    @property
    def known(self) -> tuple[PersonDetection, ...]:
        """The people without the tentative detections, which agents do not react to."""
        return tuple(person for person in self.persons if not person.tentative)


class ActionRequest(Structured, frozen=True, kw_only=True):
    """Action chosen by an agent: name and arguments, and the trace id of the decision."""

    id: str
    agent: str
    name: str
    arguments: tuple[str | int | float | bool, ...] = ()


class Utterance(Structured, frozen=True, kw_only=True):
    """Sentence for the speaker. It replaces a waiting utterance with the same ``key``.

    ``person`` is the addressee and ``language`` an ISO 639-1 code; each is empty if unknown.
    """

    id: str
    text: Sentence
    key: str = ""
    cause: str = ""
    person: str = ""
    language: str = ""


class SpeechStatus(Structured, frozen=True, kw_only=True):
    """Progress or result of an utterance."""

    utterance_id: str
    state: Literal["waiting", "started", "finished", "replaced", "expired", "failed", "interrupted"]
    text: str
    detail: str = ""


class AudioData(Structured, frozen=True, kw_only=True):
    """Piece of sound, with the stamp of its first sample.

    ``samples`` are signed 16-bit little-endian numbers, with the channels interleaved; ``sample_rate`` is in Hz.
    """

    samples: bytes
    sample_rate: Annotated[int, msgspec.Meta(ge=1)]
    channels: Annotated[int, msgspec.Meta(ge=1)] = 1


class HeardSpeech(Structured, frozen=True, kw_only=True):
    """Recognised speech from ``start`` (ns) to the stamp, its end.

    ``language`` is an ISO 639-1 code, ``person`` the ROS4HRI id of the speaker, and ``voice`` the id of the voice;
    each is empty if unknown. ``alternatives`` are other texts that may have been said, the most likely one first.
    """

    start: Int64
    text: Sentence
    alternatives: Annotated[tuple[Sentence, ...], msgspec.Meta(max_length=limits.ALTERNATIVES)] = ()
    language: str = ""
    confidence: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    person: str = ""
    voice: str = ""

    @property
    def id(self) -> str:
        """Id of this message in the trace."""
        return f"heard-{self.stamp}"


class VoiceActivity(Structured, frozen=True, kw_only=True):
    """Whether a person speaks in the sound up to the stamp.

    ``voice`` is the id of the voice, ``person`` the ROS4HRI id of its speaker, and ``bearing_rad`` their direction in
    the frame of the camera, positive to the left; each is empty or None if unknown.
    """

    active: bool
    voice: str = ""
    person: str = ""
    bearing_rad: float | None = None


class StopSpeech(Structured, frozen=True, kw_only=True):
    """Request to stop the utterance of the speaker and to drop those that wait."""

    reason: str = ""


class HeadCommand(Structured, frozen=True, kw_only=True):
    """Head control mode: follow people, face forward, or look at a pan and tilt (rad)."""

    mode: Literal["track", "centre", "look"]
    pan_rad: float = 0.0
    tilt_rad: float = 0.0
    cause: str = ""


@functools.cache
def _check_detail() -> Callable[[str, Mapping[str, Any]], None]:
    from socialbot.core._trace_details import check_detail  # it needs PersonDetection

    return check_detail


class TraceRecord(Structured, frozen=True, kw_only=True):
    """Step from frame to action: an event at ``source`` (an agent or topic), and the id of its cause.

    ``detail`` has fixed types for the kinds of records of socialbot; others are free.

    Raises:
        ValueError: An entry of ``detail`` has another type; such a message or line of a trace cannot be read.
    """

    id: str
    source: str
    kind: str
    what: str
    cause: str = ""
    detail: dict[str, Any] = {}

    def __post_init__(self) -> None:
        _check_detail()(self.kind, self.detail)


class MindBelief(msgspec.Struct, frozen=True, kw_only=True):
    """Belief as readable text, with its source and the time (ns) of its addition."""

    text: str
    source: str
    since: Stamp


class Mind(Structured, frozen=True, kw_only=True):
    """Beliefs, desires and intentions of an agent at one time."""

    agent: str
    beliefs: tuple[MindBelief, ...]
    desires: tuple[str, ...]
    intentions: tuple[str, ...]


BUILT_IN_MESSAGES: tuple[type[Structured], ...] = (
    PersonDetections, ActionRequest, Utterance, SpeechStatus, HeadCommand, TraceRecord, Mind, PictureAck, Health,
    UpStatus, DownRequest, AgentCommand, AgentAnswer, AudioData, HeardSpeech,
    VoiceActivity, StopSpeech,
)  # fmt: skip
"""Structured messages shared by all agents; `socialbot.core.registry.message_types` returns all."""
