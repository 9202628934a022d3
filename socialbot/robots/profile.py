"""Robot profiles: what a robot has, under which names, and within which limits. One YAML file per robot.

::

    name: tiago
    title: TIAGo of PAL Robotics
    tested: none
    camera: {image: /head_front_camera/rgb/image_raw, info: /head_front_camera/rgb/camera_info, on_head: true}
    head:
      type: ros2_control
      trajectory: /head_controller/joint_trajectory
      pan: {joint: head_1_joint, lower_rad: -1.24, upper_rad: 1.24, speed_rad_s: 1.0}
      tilt: {joint: head_2_joint, lower_rad: -0.98, upper_rad: 0.72, speed_rad_s: 1.0}
    speech: {type: tts, action: /tts_engine/tts, locale: en_US}

An agent package names its profiles in its declaration: ``AgentPackage(robots={"tiago": "tiago.yaml"})``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from socialbot.core import paths, registry
from socialbot.core.errors import GraphError, suggestion
from socialbot.core.foreign_files import foreign_text
from socialbot.core.yaml import YamlSection, expect_own, read_page
from socialbot.graph.node import NODE_NAME
from socialbot.graph.ports import TOPIC_NAME
from socialbot.robots.limits import WIDEST_RAD

Tested = Literal["hardware", "simulation", "none"]
"""How a profile was tested."""

_Angle = Annotated[float, msgspec.Meta(ge=-WIDEST_RAD, le=WIDEST_RAD)]
_Speed = Annotated[float, msgspec.Meta(ge=0.01, le=10.0)]
_Name = Annotated[
    str,
    msgspec.Meta(
        pattern=f"({TOPIC_NAME.pattern})?",
        description="a full name of a topic or action; begin with /, and use letters, digits and _",
    ),
]


@dataclass(frozen=True)
class JointProfile:
    """Joint of a head with its limits, in the direction of the joint.

    Attributes:
        joint: Name of the joint.
        lower_rad: Least position.
        upper_rad: Greatest position.
        speed_rad_s: Highest speed.
        sign: 1 if the joint is positive to the left or up (REP-103), else -1.
        straight_rad: Position at which the head looks straight on.
    """

    joint: str
    lower_rad: _Angle
    upper_rad: _Angle
    speed_rad_s: _Speed
    sign: Literal[1, -1] = 1
    straight_rad: _Angle = 0.0

    @property
    def reach_rad(self) -> float:
        """Largest angle to which the joint can turn in both directions."""
        return max(0.0, min(self.straight_rad - self.lower_rad, self.upper_rad - self.straight_rad))


USUAL_HFOV_RAD = 1.09
"""Horizontal field of view of a camera whose profile tells none."""


@dataclass(frozen=True)
class CameraProfile:
    """Camera of a robot: its topics, or the device that this computer opens.

    Attributes:
        image: Topic of raw images; empty if there is none.
        compressed: Topic of compressed images.
        info: Topic of the intrinsics.
        device: Camera index or device file, in place of the topics.
        type: Node type that opens the device; empty: the camera of the graph.
        on_head: Whether the camera turns with the head.
        height_m: Height above the floor; 0: from the robot's transforms, or estimated.
        pitch_rad: Downward tilt; 2: not known.
        hfov_rad: Horizontal field of view, if the intrinsics do not tell it.
    """

    image: _Name = ""
    compressed: _Name = ""
    info: _Name = ""
    device: str = ""
    type: str = ""
    on_head: bool = False
    height_m: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    pitch_rad: Annotated[float, msgspec.Meta(ge=-1.5, le=2.0)] = 2.0
    hfov_rad: Annotated[float, msgspec.Meta(ge=0.1, le=3.0)] = USUAL_HFOV_RAD


@dataclass(frozen=True)
class Part:
    """Part of a robot that a node drives: head, base, speech or people.

    Attributes:
        type: How the part is driven, such as ``ros2_control``; or a node type of your own.
        names: Topics and actions of the robot by key, such as ``trajectory``.
        settings: Other values by key, such as ``locale``.
        parameters: Parameters of the node, by name.
    """

    type: str
    names: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)


NO_JOINT = JointProfile("", 0.0, 0.0, 10.0)
"""Joint of a head that does not turn about this axis."""


@dataclass(frozen=True)
class HeadProfile(Part):
    """Head of a robot with one or two joints; the other one is `NO_JOINT`."""

    pan: JointProfile = JointProfile("head_pan_joint", -1.2, 1.2, 1.0)
    tilt: JointProfile = JointProfile("head_tilt_joint", -0.5, 0.5, 1.0)


@dataclass(frozen=True)
class RobotProfile:
    """Robot: its parts, and where the profile comes from. A part that is None is absent.

    Attributes:
        name: Name for ``--robot``.
        title: Name for people.
        tested: How the profile was tested.
        hint: How to start the drivers of the robot, for ``socialbot doctor``.
        url: Address of the robot's daemon, if it has one.
        namespace: Namespace of the robot's topics and actions, before each name of the profile, and before
            `STANDARD_TOPICS`.
        where: File of the profile.
    """

    name: str
    title: str = ""
    tested: Tested = "none"
    hint: str = ""
    url: str = ""
    namespace: str = ""
    camera: CameraProfile | None = None
    head: HeadProfile | None = None
    base: Part | None = None
    speech: Part | None = None
    people: Part | None = None
    where: str = ""

    @property
    def resolved(self) -> RobotProfile:
        """The profile with full names, without a namespace."""
        if not self.namespace:
            return self

        def full(name: str) -> str:
            return self.namespace + name if name else ""

        changed: dict[str, Any] = {"namespace": ""}
        if (camera := self.camera) is not None:
            names = {key: full(getattr(camera, key)) for key in ("image", "compressed", "info")}
            changed["camera"] = replace(camera, **names)
        for key in NAMES:
            if (part := getattr(self, key)) is not None:
                changed[key] = replace(part, names={port: full(name) for port, name in part.names.items()})
        return replace(self, **changed)


STANDARD_TOPICS = ("/tf", "/tf_static", "/joint_states")
"""Topics of a robot that a profile need not name."""

_PROFILE_KEYS = ("name", "title", "tested", "hint", "url", "namespace", "camera", "head", "base", "speech", "people")

NAMES: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "head": {
        "ros2_control": ("trajectory", "action", "joint_states"),
        "naoqi": ("angles", "joint_states"),
        "reachy_mini": (),
    },
    "base": {"nav2": ("action",)},
    "speech": {"tts": ("action",), "say_skill": ("action",), "topic": ("topic",), "speaker": (), "reachy_mini": ()},
    "people": {"detector": (), "ros4hri": ("bodies",)},
}
"""Types of each part, and the keys of their topics and actions."""

SETTINGS: Mapping[str, Mapping[str, tuple[type, Any]]] = {
    "nav2": {"frame": (str, "map"), "robot_frame": (str, "base_link")},
    "tts": {"locale": (str, ""), "tts_voice": (str, "")},
    "ros4hri": {"robot_frame": (str, "base_link")},
}
"""Settings by type of a part: their kind and default."""

_NEEDED: Mapping[str, tuple[str, ...]] = {
    "naoqi": ("angles",), "nav2": ("action",), "tts": ("action",), "say_skill": ("action",), "topic": ("topic",),
}  # fmt: skip
_USUAL: Mapping[str, Mapping[str, str]] = {"ros4hri": {"bodies": "/humans/bodies/tracked"}}


def robot_names() -> list[str]:
    """Return the names of the profiles of all installed packages."""
    return sorted(registry.robot_files())


def load_profile(name: str, *, folder: Path = Path(), changed_by: tuple[str, ...] = ()) -> RobotProfile:
    """Load the profile of a registered robot by its name, or from a file by its path. Raises GraphError.

    A relative path starts at ``folder``. ``changed_by`` are the profiles that change this one by ``like``.
    """
    text, where = _text_of(name, folder)
    if where in changed_by:
        raise GraphError("the profile changes itself", where=where, remedy="name another one with 'like'")
    return parse_profile(text, where, folder=Path(where).parent, changed_by=changed_by)


def _text_of(name: str, folder: Path = Path()) -> tuple[str, str]:
    known = registry.robot_files()
    path = folder / known.get(name, name)
    if name not in known and path.suffix not in (".yaml", ".yml", ".rviz"):
        if os.path.isfile(path):
            expect_own(foreign_text(paths.read_text(path, GraphError)), str(path))
            remedy = "write the robot's topics and joints into a YAML file, such as my_robot.yaml"
            raise GraphError("is no robot profile", where=str(path), remedy=remedy)
        raise GraphError(
            f"no robot {name!r}",
            where="robot",
            remedy=f"{suggestion(name, known)}; or the path of a profile, such as my_robot.yaml",
        )
    return paths.read_text(path, GraphError, remedy=suggestion(name, known)), str(path)


def parse_profile(text: str, where: str, *, folder: Path = Path(), changed_by: tuple[str, ...] = ()) -> RobotProfile:
    """Parse a profile from YAML. Errors name the source ``where`` and the line. Raises GraphError."""
    return read_profile(read_page(text, where=where), where=where, folder=folder, changed_by=changed_by)


def read_profile(
    root: YamlSection,
    *,
    where: str,
    name: str | None = None,
    folder: Path = Path(),
    changed_by: tuple[str, ...] = (),
) -> RobotProfile:
    """Read a profile from a section of a file. ``like`` names the profile that it changes, or its file in ``folder``.

    Raises:
        GraphError: A key is unknown, or a value is missing or invalid.
    """
    root.only(*_PROFILE_KEYS, "like")
    if "like" in root.page:
        base = load_profile(root.value("like", str), folder=folder, changed_by=(*changed_by, where))
    else:
        base = RobotProfile(name=root.value("name", str, msgspec.NODEFAULT if name is None else name))
    if not NODE_NAME.fullmatch(base.name):
        raise GraphError(
            f"{base.name!r} is no name of a robot", where=root.line("name"), remedy="use letters, digits and _"
        )
    given: dict[str, Any] = {
        key: root.value(key, Tested if key == "tested" else str)
        for key in ("name", "title", "hint", "tested", "url")
        if key in root.page
    }
    if "namespace" in root.page:
        given["namespace"] = root.value("namespace", _Name)
    if "camera" in root.page:
        given["camera"] = _camera(root.section("camera"), base.camera)
    for part in NAMES:
        if part in root.page:
            given[part] = _part(part, root.section(part), getattr(base, part))
    return replace(base, where=where, **given)


def _camera(section: YamlSection, base: CameraProfile | None) -> CameraProfile:
    camera = section.read(CameraProfile, vars(base) if base else {})
    if bool(camera.device) == bool(camera.image or camera.compressed):
        raise GraphError(
            "a camera needs topics or a device, not both" if camera.device else "the camera has no images",
            where=section.where,
            remedy="give 'image' or 'compressed', the topic of its driver, or 'device', such as \"0\"",
        )
    if not (camera.device or camera.info or camera.hfov_rad != USUAL_HFOV_RAD):
        remedy = "give 'info', the topic of its CameraInfo; or 'hfov_rad', the horizontal field of view"
        raise GraphError("the camera has no intrinsics", where=section.where, remedy=remedy)
    return camera


def _part(kind: str, section: YamlSection, base: Part | None) -> Part:
    if "type" not in section.page and base is None:
        raise GraphError(
            f"{kind} has no type", where=section.where, remedy=f"write type: one of {', '.join(NAMES[kind])}"
        )
    chosen = section.value("type", str, base.type if base else msgspec.NODEFAULT)
    known = NAMES[kind]
    own = ":" in chosen or (chosen not in known and registry.node_reference(chosen) is not None)
    if chosen not in known and not own:
        raise GraphError(
            f"unknown type of {kind}: {chosen!r}",
            where=section.line("type"),
            remedy=f"{suggestion(chosen, known)}; or a node type of your own, package.module:Class",
        )
    usual = base if base is not None and base.type == chosen else None
    names, settings = known.get(chosen, ()), SETTINGS.get(chosen, {})
    joints = ("pan", "tilt") if kind == "head" else ()
    extra = ("remap",) if own else ()
    section.only("type", "parameters", *names, *settings, *joints, *extra)
    before = usual.names if usual else _USUAL.get(chosen, {})
    found = {key: section.value(key, _Name, before.get(key, "")) for key in names}
    if own:
        found = {**before, **section.value("remap", dict[str, str], {})}
    for key in _NEEDED.get(chosen, ()):
        if not found[key]:
            raise GraphError(f"{key!r} is missing", where=section.where, remedy=f"give the {key} of the robot's driver")
    if chosen == "ros2_control" and not (found["trajectory"] or found["action"]):
        raise GraphError(
            "a head of type ros2_control needs 'trajectory' or 'action'",
            where=section.where,
            remedy="give the topic of its controller, such as /head_controller/joint_trajectory",
        )
    values: dict[str, Any] = {
        "type": chosen,
        "names": {key: name for key, name in found.items() if name},
        "settings": {
            key: section.value(key, form, usual.settings[key] if usual else default)
            for key, (form, default) in settings.items()
        },
        "parameters": {
            **(usual.parameters if usual else {}),
            **section.value("parameters", dict[str, Any], {}),
        },
    }
    if kind != "head":
        return Part(**values)
    known_head = usual if isinstance(usual, HeadProfile) else None
    for joint in joints:
        values[joint] = _joint(section, joint, getattr(known_head, joint, NO_JOINT))
    if not (values["pan"].joint or values["tilt"].joint):
        remedy = "give 'pan', 'tilt' or both, each with joint, lower_rad, upper_rad and speed_rad_s"
        raise GraphError("the head has no joint", where=section.where, remedy=remedy)
    if values["pan"].joint == values["tilt"].joint:
        raise GraphError(
            f"pan and tilt are the same joint {values['pan'].joint!r}",
            where=section.where,
            remedy="name the two joints of the neck",
        )
    return HeadProfile(**values)


def _joint(head: YamlSection, key: str, base: JointProfile) -> JointProfile:
    if key not in head.page:
        return base
    section = head.section(key)
    joint = section.read(JointProfile, {} if base is NO_JOINT else vars(base))
    if not joint.lower_rad <= joint.straight_rad <= joint.upper_rad:
        what = f"{joint.straight_rad:g} is not between lower_rad and upper_rad"
        remedy = "write limits around the straight pose; straight_rad is its position, if that is not 0"
        raise GraphError(what, where=section.where, remedy=remedy)
    return joint
