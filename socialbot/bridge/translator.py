"""Republish people, speech, voices and the head pose of a running graph as standard ROS messages.

They are for RViz, rqt and ROS4HRI. Types of missing packages are skipped. See docs/ros-installation.md.
"""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import RclpyTypes, Sender, message_class, open_transport
from socialbot.core.clock import SECOND
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.messages import (
    HeardSpeech,
    JointTrajectory,
    Message,
    PersonDetections,
    Utterance,
    VoiceActivity,
)
from socialbot.graph.node import Graph
from socialbot.graph.ports import Delivery
from socialbot.runs.standard_messages import (
    AHEAD,
    ANONYMOUS,
    HEAD_HZ,
    HeadPose,
    Joints,
    Neck,
    StandardMessages,
    body_id,
    fits_time,
    mounting_of,
    neck_of,
    topic_id,
)

log = logging.getLogger("socialbot.translator")
NOT_FOUND = "it is not installed, or its libraries are not found; docs/ros-installation.md says how to install it"

TF, TF_STATIC, JOINTS = "/tf", "/tf_static", "/joint_states"
MARKERS, BOXES, TRACKED = "/humans/bodies/markers", "/humans/bodies/boxes", "/humans/bodies/tracked"
FACES = "/humans/faces/tracked"
REGION, FACE_REGION = "/humans/bodies/{}/roi", "/humans/faces/{}/roi"
SPEECH = "/speech/text"
PERSONS, ENGAGEMENT = "/humans/persons/tracked", "/humans/persons/{}/engagement_status"
VOICES, VOICE_SPEECH, IS_SPEAKING = (
    "/humans/voices/tracked",
    "/humans/voices/{}/speech",
    "/humans/voices/{}/is_speaking",
)
VOICE_OF_PERSON = "/humans/persons/{}/voice_id"

TYPES: Mapping[str, str] = {
    TF: "tf2_msgs/msg/TFMessage",
    MARKERS: "visualization_msgs/msg/MarkerArray",
    BOXES: "vision_msgs/msg/Detection2DArray",
    TRACKED: "hri_msgs/msg/IdsList",
    FACES: "hri_msgs/msg/IdsList",
    PERSONS: "hri_msgs/msg/IdsList",
    VOICES: "hri_msgs/msg/IdsList",
    SPEECH: "std_msgs/msg/String",
}
HEAD_TYPES: Mapping[str, str] = {TF_STATIC: "tf2_msgs/msg/TFMessage", JOINTS: "sensor_msgs/msg/JointState"}
_REGION_TYPE = "hri_msgs/msg/NormalizedRegionOfInterest2D"
PERSON_TYPES: Mapping[str, str] = {
    REGION: _REGION_TYPE,
    FACE_REGION: _REGION_TYPE,
    ENGAGEMENT: "hri_msgs/msg/EngagementLevel",
}
"""Types of the topics of one person."""
VOICE_TYPES: Mapping[str, str] = {
    VOICE_SPEECH: "hri_msgs/msg/LiveSpeech",
    IS_SPEAKING: "std_msgs/msg/Bool",
    VOICE_OF_PERSON: "std_msgs/msg/String",
}
"""Types of the topics of one voice, and of the voice of one person."""
_EACH_TYPES = {**PERSON_TYPES, **VOICE_TYPES}
_LIST_OF = {TRACKED: PERSON_TYPES, VOICES: VOICE_TYPES}
"""Topics of one person or voice, by the topic that lists them."""
_FACE_KEPT_S = 1.0  # A face is listed for this long after it was last found: not every image is searched.
_VOICE_KEPT_S = 10.0  # A voice is listed for this long after it was last heard.


def translated_topics(graph: Graph) -> dict[str, type[Message]]:
    """Topics of ``graph`` for a `Translator`."""
    kinds = (PersonDetections, JointTrajectory, Utterance, HeardSpeech, VoiceActivity)
    return {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, kinds)}


class Translator:
    """Thread-safe translator of messages of ``graph``, which publishes through the spinning node ``ros``.

    With ``head`` it publishes the commanded head pose, too; on a robot the drivers publish it. Raises ParameterError if
    the graph has no head. ``missing`` are the packages that are not installed, or lack their libraries.
    """

    def __init__(self, ros: Any, graph: Graph, *, head: bool) -> None:
        neck = neck_of(graph)
        if head and neck is None:
            raise ParameterError(f"no node of {graph.name} turns a head", where="--head", remedy="leave it out")
        self._ros = ros
        self._messages = StandardMessages(RclpyTypes())
        self._neck = neck or Neck("", "")
        self._mounting = mounting_of(graph)
        self._joints = Joints((self._neck.pan, self._neck.tilt))
        self._transport = open_transport()
        self._of_each: dict[str, dict[str, Sender]] = {topic: {} for topic in _EACH_TYPES}
        self._faces: dict[str, int] = {}
        self._voices: dict[str, int] = {}
        self._voice_of: dict[str, str] = {}
        self._lock = threading.Lock()
        self.missing: set[str] = set()
        self._publishers: dict[str, Sender] = {}
        for topic, kind in (*TYPES.items(), *(HEAD_TYPES.items() if head else ())):
            self._create_publisher(topic, kind, Delivery.LATCHED if topic == TF_STATIC else Delivery.EVERY)
        if head:
            self._publish_camera()
            ros.create_timer(1 / HEAD_HZ, self._publish_head)

    @property
    def topics(self) -> list[str]:
        """Published topics, each with its type."""
        offered = {**TYPES, **HEAD_TYPES}
        topics = [f"{topic}  {offered[topic]}" for topic in self._publishers]
        for listed, types in _LIST_OF.items():
            if listed in self._publishers:
                topics += [f"{topic.format('<id>')}  {kind}" for topic, kind in types.items()]
        return topics

    def take(self, topic: str, message: Message) -> None:
        """Convert and publish a message, unless its stamp does not fit a ROS Time."""
        if not fits_time(message.stamp):
            return
        with self._lock:
            if isinstance(message, JointTrajectory):
                self._joints.take(message)
            elif isinstance(message, PersonDetections):
                self._publish_people(message)
            elif isinstance(message, Utterance):
                self._publish(SPEECH, lambda: self._messages.make("std_msgs/msg/String", [message.text]))
            elif isinstance(message, HeardSpeech | VoiceActivity) and VOICES in self._publishers:
                self._publish_voice(message)

    def _publish_people(self, found: PersonDetections) -> None:
        head = self._pose(found.stamp) if self._mounting.on_head else AHEAD
        mounting = self._mounting.updated(found, head)
        if mounting != self._mounting:
            self._mounting = mounting
            self._publish_camera()
        if found.persons:
            self._publish(TF, lambda: self._messages.bodies(found, head))
        self._publish(MARKERS, lambda: self._messages.markers(found, head))
        self._publish(BOXES, lambda: self._messages.boxes(found))
        if TRACKED in self._publishers:
            self._publish_ros4hri(found)

    def _publish_ros4hri(self, found: PersonDetections) -> None:
        """Publish bodies, faces and persons. One person has the same id in all three."""
        there = {body_id(person): person for person in found.persons if person.track_id}
        self._faces |= {name: found.stamp for name, person in there.items() if person.face}
        oldest = found.stamp - round(_FACE_KEPT_S * SECOND)
        self._faces = {name: stamp for name, stamp in self._faces.items() if name in there and stamp >= oldest}
        make = self._messages
        regions, faces = {}, {}
        if found.width and found.height:
            for name, person in there.items():
                box = (person.x, person.y, person.w, person.h)
                regions[name] = make.region(found, box, person.score)
                if person.face:
                    faces[name] = make.region(found, person.face, person.score)
        self._publish_each(REGION, there, regions)
        self._publish_each(FACE_REGION, self._faces, faces)
        self._publish_each(ENGAGEMENT, there, {name: make.engagement(found, each) for name, each in there.items()})
        for topic, names in ((TRACKED, there), (FACES, self._faces), (PERSONS, there)):
            self._publish(topic, functools.partial(make.ids, found.stamp, found.frame_id, list(names)))

    def _publish_voice(self, message: HeardSpeech | VoiceActivity) -> None:
        """Publish a voice as ROS4HRI does; one without an id is that of the anonymous speaker."""
        make, name = self._messages, topic_id(message.voice, "v") if message.voice else ANONYMOUS
        self._voices[name] = message.stamp
        oldest = message.stamp - round(_VOICE_KEPT_S * SECOND)
        self._voices = {voice: stamp for voice, stamp in self._voices.items() if stamp >= oldest}
        if message.person:
            self._voice_of[topic_id(message.person, "b")] = name
        self._voice_of = {person: voice for person, voice in self._voice_of.items() if voice in self._voices}
        self._publish(VOICES, functools.partial(make.ids, message.stamp, "", list(self._voices)))
        voices = {person: make.make("std_msgs/msg/String", [voice]) for person, voice in self._voice_of.items()}
        self._publish_each(VOICE_OF_PERSON, voices, voices)
        speaks = isinstance(message, VoiceActivity) and message.active
        self._publish_each(IS_SPEAKING, self._voices, {name: make.make("std_msgs/msg/Bool", [speaks])})
        speech = {name: make.live_speech(message)} if isinstance(message, HeardSpeech) else {}
        # Its topic exists from the first sound of the voice, so that subscribers do not miss the first sentence.
        self._publish_each(VOICE_SPEECH, self._voices, speech, Delivery.EVERY, known=(name,))

    def _publish_each(
        self,
        topic: str,
        there: Collection[str],
        messages: Mapping[str, Any],
        delivery: Delivery = Delivery.LATCHED,
        known: Collection[str] = (),
    ) -> None:
        """Publish ``messages`` by id, one topic for each of those who are ``there``, and remove the others.

        The state is latched, so that late subscribers get it. ``known`` get a topic before their first message.
        """
        publishers = self._of_each[topic]
        for gone in publishers.keys() - set(there):
            publishers.pop(gone).destroy(self._ros)
        for name in dict.fromkeys((*known, *messages)):
            if name not in publishers:
                publishers[name] = self._transport.advertise_class(
                    self._ros, topic.format(name), message_class(_EACH_TYPES[topic]), delivery, standard=True
                )
        for name, message in messages.items():
            publishers[name].publish_encoded(message)

    def _publish_camera(self) -> None:
        self._publish(TF_STATIC, lambda: self._messages.camera(self._now(), self._mounting))
        if TF_STATIC in self._publishers:
            self._ros.get_logger().info(f"{TF_STATIC}: camera {self._mounting}")

    def _publish_head(self) -> None:
        with self._lock:
            now = self._now()
            pose = self._pose(now)
        self._publish(JOINTS, lambda: self._messages.joints(now, self._joints.names, pose))
        self._publish(TF, lambda: self._messages.head(now, pose, self._mounting.height_m))

    def _publish(self, topic: str, make: Callable[[], Any]) -> None:
        """Publish a message if the type of ``topic`` is installed."""
        publisher = self._publishers.get(topic)
        if publisher is not None:
            publisher.publish_encoded(make())

    def _pose(self, stamp: int) -> HeadPose:
        return HeadPose(self._joints.at(self._neck.pan, stamp), self._joints.at(self._neck.tilt, stamp))

    def _now(self) -> int:
        return self._ros.get_clock().now().nanoseconds

    def _create_publisher(self, topic: str, kind: str, delivery: Delivery) -> None:
        from rosidl_generator_py.import_type_support_impl import UnsupportedTypeSupport

        try:
            found = message_class(kind)
            for each in _LIST_OF.get(topic, {}).values():
                message_class(each)
            self._publishers[topic] = self._transport.advertise_class(self._ros, topic, found, delivery, standard=True)
        except (InstallationError, UnsupportedTypeSupport):
            # UnsupportedTypeSupport: the libraries of the package are not found.
            self.missing.add(kind.partition("/")[0])


@contextmanager
def with_standard_types(
    graph: Graph, observe: Callable[[str, Message], None], nodes: Collection[str] | None = None
) -> Iterator[Callable[[str, Message], None]]:
    """Wrap ``observe`` for the block: if the graph asks for standard types, its messages are published in them, too.

    ``nodes`` limits this to messages of these nodes, for one machine of several.
    """
    if not graph.standard:
        yield observe
        return
    own = [config for config in graph.nodes if nodes is None or config.name in nodes]
    topics = translated_topics(graph).keys() & {topic for config in own for topic, _ in config.publications}
    with spinning_node("translator") as ros:
        translator = Translator(ros, graph, head=False)
        for package in sorted(translator.missing):
            log.warning("no messages of %s: %s", package, NOT_FOUND)

        def note(topic: str, message: Message) -> None:
            observe(topic, message)
            if topic in topics:
                translator.take(topic, message)

        yield note
