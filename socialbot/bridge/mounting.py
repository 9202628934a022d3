"""Where head and camera sit on a robot without a URDF, as far as its graph tells, and where people stand by that.

Frames are those of REP-105, axes those of REP-103.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from socialbot.graph import Graph, check_parameters
from socialbot.messages import Image, PersonDetection

BASE, PAN, TILT, CAMERA = "base_link", "head_pan_link", "head_tilt_link", "camera_link"
OPTICAL = "camera_color_optical_frame"
"""Frames, from the foot of the robot to its camera; the last looks along z, and is that of most drivers' pictures."""

HEIGHT_M = 1.2
"""The height of a head whose camera nobody looks through to tell distances."""

Vector = tuple[float, float, float]


class HeadPose(NamedTuple):
    """Where a head points, rad: pan to the left, tilt up."""

    pan: float
    tilt: float


AHEAD = HeadPose(0.0, 0.0)


@dataclass(frozen=True)
class Mounting:
    """A head and a camera ``height_m`` above the floor; the camera looks down by ``pitch_rad``.

    It is fixed to the base or, with ``on_head``, to the head; its pictures are in the frame ``optical``.
    """

    height_m: float = HEIGHT_M
    pitch_rad: float = 0.0
    on_head: bool = False
    optical: str = OPTICAL


def mounting_of(graph: Graph) -> Mounting:
    """How the camera of ``graph`` sits: as its detector takes it to, which tells distances by that."""
    seeing = parameters_of(graph, "mount_height_m", "pitch_rad")
    turning = parameters_of(graph, "camera_on_head")
    return Mounting(
        float(seeing.get("mount_height_m", HEIGHT_M)),
        float(seeing.get("pitch_rad", 0.0)),
        bool(turning.get("camera_on_head")),
        _camera_frame(graph),
    )


def parameters_of(graph: Graph, *names: str) -> Mapping[str, Any]:
    """The parameters of the first node of ``graph`` that has those called ``names``; empty when there is none."""
    for placement in graph.placements:
        if placement.type.parameters().keys() >= set(names):
            return check_parameters(placement.type, placement.parameters, where=placement.place(graph.name))
    return {}


def _camera_frame(graph: Graph) -> str:
    """The frame of the pictures of the first camera of ``graph`` that names one, else that of most drivers."""
    for placement in graph.placements:
        if "frame_id" in placement.type.parameters() and Image in (
            port.message_type for _, port in placement.publications
        ):
            values = check_parameters(placement.type, placement.parameters, where=placement.place(graph.name))
            return str(values["frame_id"])
    return OPTICAL


def place_of(person: PersonDetection, head: HeadPose = AHEAD) -> Vector | None:
    """Where somebody stands (m) in the robot's base, seen by a camera that is turned as ``head`` is."""
    if person.distance_m is None or person.bearing_rad is None:
        return None
    bearing = head.pan + _levelled(person.bearing_rad, person.elevation_rad, head.tilt)
    return person.distance_m * math.cos(bearing), person.distance_m * math.sin(bearing), 0.0


def _levelled(bearing: float, elevation: float | None, tilt: float) -> float:
    """The bearing in the level plane of a direction that is told from a head tilted up by ``tilt`` (all in rad)."""
    if elevation is None or not tilt:
        return bearing
    ahead, left, up = (
        math.cos(elevation) * math.cos(bearing),
        math.cos(elevation) * math.sin(bearing),
        math.sin(elevation),
    )
    return math.atan2(left, ahead * math.cos(tilt) - up * math.sin(tilt))
