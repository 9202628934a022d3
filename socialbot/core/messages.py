"""What flows along the connections of a graph.

Every message is an immutable struct with the stamp (ns) of the moment it speaks
of: a detection carries the stamp of its frame. ``bridge/codec.py`` says which ROS
type each becomes. A `Structured` message has no ROS type of its own and travels as JSON
with its schema name and version inside (``docs/schemas``).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from socialbot.core.errors import MessageError

VERSION = 1


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """The base of everything that flows: a stamp in nanoseconds."""

    stamp: int


class Image(Message, frozen=True, kw_only=True):
    """A picture as a camera driver publishes it (sensor_msgs/Image).

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
        """A bgr8 image from pixels of shape (height, width, 3), uint8."""
        height, width = pixels.shape[:2]
        flat = np.ascontiguousarray(pixels).reshape(-1)
        return cls(
            stamp=stamp, frame_id=frame_id, height=height, width=width, encoding="bgr8", step=3 * width, data=flat
        )

    def bgr(self) -> np.ndarray:
        """The pixels of a bgr8 image as (height, width, 3), without a copy where rows are not padded.

        Raises MessageError for any other encoding or when the data does not fill the image.
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
    """A JPEG or PNG picture (sensor_msgs/CompressedImage); ``data`` is a flat uint8 array."""

    frame_id: str
    format: str
    data: np.ndarray


class CameraInfo(Message, frozen=True, kw_only=True):
    """The intrinsics of a camera (sensor_msgs/CameraInfo): ``k`` row by row, ``d`` the distortion."""

    frame_id: str
    width: int
    height: int
    k: tuple[float, ...]
    d: tuple[float, ...] = ()
    distortion_model: str = "plumb_bob"


class JointTrajectory(Message, frozen=True, kw_only=True):
    """One target for some joints (trajectory_msgs/JointTrajectory with a single point).

    Positions in rad, velocities in rad/s, ``duration_s`` the time to get there.
    """

    joint_names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    duration_s: float


class BoxMarkers(Message, frozen=True, kw_only=True):
    """Boxes to draw over an image (visualization_msgs/ImageMarker, a list of lines)."""

    frame_id: str
    boxes: tuple[tuple[float, float, float, float], ...]


Share = Annotated[float, msgspec.Meta(ge=0.0)]


class Structured(
    Message, frozen=True, kw_only=True, tag_field="schema", tag=lambda name: f"socialbot/{name}/{VERSION}"
):
    """A message without a ROS type: JSON in std_msgs/String."""


class PictureAck(Structured, frozen=True, kw_only=True):
    """That a picture has come over a link: its own ``stamp``, and when (ns, by the receiver's clock) it ``arrived``.

    It also stands for all pictures sent before. The last one is said again while none comes, as a sign of life; both
    are 0 before the first.
    """

    arrived: int


State = Literal["ok", "paused", "waiting", "degraded", "failed", "ended"]
"""How a node is: "paused" by a person, "waiting" for what has never come yet, "ended" of a recording that has been
played."""


class Health(Structured, frozen=True, kw_only=True):
    """How a node is, and why; said at each change, and again and again as a sign of life.

    ``silent`` are the topics from which nothing comes that should, ``outputs`` those that the node publishes. So
    whoever hears of all nodes can follow a silence to where it begins.
    """

    node: str
    state: State
    reason: str = ""
    silent: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()


UpState = Literal["up", "ending", "ended"]


class UpStatus(Structured, frozen=True, kw_only=True):
    """That ``socialbot up`` runs the nodes of ``graph`` on ``machine``, said again and again, and how it ends.

    ``run`` is an id of its own, ``pid`` that of its process, and ``boot`` that of the start of the computer, by which
    others on the same computer know that. ``reason`` is the error that it has ended with, if any.
    """

    run: str
    graph: str
    machine: str
    boot: str
    pid: int
    state: UpState
    reason: str = ""


class DownRequest(Structured, frozen=True, kw_only=True):
    """Asks the ``socialbot up`` whose ``run`` has this id to end."""

    run: str


Command = Literal["believe", "forget", "achieve", "drop", "pause", "resume", "step"]
"""What a person may ask of an agent."""


AGENT_COMMANDS, AGENT_ANSWERS = "/agents/commands", "/agents/answers"
"""Topics for commands from people to agents, and for the agents' answers; all agents share them."""


class AgentCommand(Structured, frozen=True, kw_only=True):
    """What a person asks of ``agent``, under an ``id`` of its own.

    ``text`` is what to believe, forget, achieve or drop, as the agent writes it. An agent that pauses takes in what
    comes, but neither thinks nor acts until it is to resume; meanwhile each step is one turn of its reasoning.
    """

    id: str
    agent: str
    command: Command
    text: str = ""


class AgentAnswer(Structured, frozen=True, kw_only=True):
    """Whether an agent does what the command with this ``id`` asks for; the ``reason`` if not."""

    id: str
    agent: str
    accepted: bool
    reason: str = ""


class PersonDetection(msgspec.Struct, frozen=True, kw_only=True):
    """One person in one frame.

    The box is x, y, w, h in pixels with the origin at the top left. ``bearing_rad`` counts to the
    left and ``elevation_rad`` up, from the camera's forward direction in the horizontal plane
    (REP-103); they point to the person's head. ``distance_m`` is horizontal, ``distance_std_m`` its
    standard error. A person keeps their ``track_id`` from frame to frame; it is empty where nobody tracks.
    With ``unseen_s`` above 0 the detector last saw this person so long ago, and the box is a prediction.
    """

    x: float
    y: float
    w: Share
    h: Share
    score: float
    track_id: str = ""
    distance_m: float | None = None
    distance_std_m: Share | None = None
    bearing_rad: float | None = None
    elevation_rad: float | None = None
    unseen_s: Share = 0.0


class PersonDetections(Structured, frozen=True, kw_only=True):
    """The people in one frame; ``stamp`` is the frame's. An empty list says that nobody was found."""

    frame_id: str
    width: int
    height: int
    persons: tuple[PersonDetection, ...]

    @property
    def id(self) -> str:
        """The id by which the trace refers to this."""
        return f"detection-{self.stamp}"


class ActionRequest(Structured, frozen=True, kw_only=True):
    """What the agent has decided to do: an action's name and arguments, and the trace id it stems from."""

    id: str
    agent: str
    name: str
    arguments: tuple[str | int | float | bool, ...] = ()


class Utterance(Structured, frozen=True, kw_only=True):
    """A sentence to say. A waiting utterance of the same ``key`` is replaced by a newer one."""

    id: str
    text: str
    key: str = ""
    cause: str = ""


class SpeechStatus(Structured, frozen=True, kw_only=True):
    """What became of an utterance."""

    utterance_id: str
    state: Literal["waiting", "started", "finished", "replaced", "expired", "failed"]
    text: str
    detail: str = ""


class HeadCommand(Structured, frozen=True, kw_only=True):
    """How to hold the head: follow people, look straight on, or look at a pan and tilt (rad)."""

    mode: Literal["track", "centre", "look"]
    pan_rad: float = 0.0
    tilt_rad: float = 0.0
    cause: str = ""


class TraceRecord(Structured, frozen=True, kw_only=True):
    """One step from frame to action: what happened at ``source`` (an agent or topic), and the id of what caused it."""

    id: str
    source: str
    kind: str
    what: str
    cause: str = ""
    detail: dict[str, Any] = {}


class MindBelief(msgspec.Struct, frozen=True, kw_only=True):
    """One belief as a person would read it, its source and since when (ns) it has been held."""

    text: str
    source: str
    since: int


class Mind(Structured, frozen=True, kw_only=True):
    """What an agent believes, desires and intends at this moment."""

    agent: str
    beliefs: tuple[MindBelief, ...]
    desires: tuple[str, ...]
    intentions: tuple[str, ...]


BUILT_IN_MESSAGES: tuple[type[Structured], ...] = (
    PersonDetections, ActionRequest, Utterance, SpeechStatus, HeadCommand, TraceRecord, Mind, PictureAck, Health,
    UpStatus, DownRequest, AgentCommand, AgentAnswer,
)  # fmt: skip
"""Structured messages of no agent in particular; `socialbot.core.registry.message_types` lists all."""
