"""The camera as geometry: where a pixel points to.

Directions are in the horizontal robot frame of REP-103: x forward, y left, z up. A pixel (u, v) is the
ray ((u - cx) / fx, (v - cy) / fy, 1) of the camera, to the right, down and forward; tilting it by the pitch gives
its direction in the robot frame. Lens distortion is not taken out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from socialbot.core.errors import MessageError, ParameterError
from socialbot.core.messages import CameraInfo

__all__ = ["Box", "CameraModel"]

Box = Sequence[float]
"""x, y, w, h in pixels."""


@dataclass(frozen=True)
class CameraModel:
    """A pinhole camera at ``mount_height_m`` above the floor, looking down by ``pitch_rad``.

    ``fx``, ``fy``, ``cx``, ``cy`` in pixels of a picture of ``width`` x ``height``. Raises ParameterError when
    a focal length, a size or the mount height is not above zero.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    mount_height_m: float = 1.62
    pitch_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "width", "height", "mount_height_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ParameterError(f"{value!r} is not above zero", where=f"camera model: {name}")

    @classmethod
    def from_info(cls, info: CameraInfo, *, mount_height_m: float = 1.62, pitch_rad: float = 0.0) -> CameraModel:
        """The camera of ``info``. Raises MessageError when it is not calibrated (focal length or size 0)."""
        where = f"camera_info of {info.frame_id or 'a camera without a frame'}"
        if len(info.k) != 9:
            raise MessageError(f"k has {len(info.k)} numbers, not 9", where=where)
        fx, _, cx, _, fy, cy = info.k[:6]
        if not all(math.isfinite(value) and value > 0 for value in (fx, fy, info.width, info.height)):
            raise MessageError(
                f"focal lengths {fx:g}, {fy:g} for {info.width}x{info.height} pixels",
                where=where,
                remedy="calibrate the camera, or let it publish no camera_info and set hfov_rad",
            )
        return cls(fx, fy, cx, cy, info.width, info.height, mount_height_m, pitch_rad)

    @classmethod
    def from_field_of_view(
        cls, width: int, height: int, hfov_rad: float, *, mount_height_m: float = 1.62, pitch_rad: float = 0.0
    ) -> CameraModel:
        """A camera with square pixels, its axis in the middle, that sees ``hfov_rad`` from left to right.

        Raises ParameterError when ``hfov_rad`` is not between 0 and pi.
        """
        if not 0 < hfov_rad < math.pi:
            raise ParameterError(f"{hfov_rad!r} rad is no field of view", where="hfov_rad", remedy="0 < hfov_rad < pi")
        focal = width / 2 / math.tan(hfov_rad / 2)
        return cls(focal, focal, width / 2, height / 2, width, height, mount_height_m, pitch_rad)

    def scaled(self, width: int, height: int) -> CameraModel:
        """The same camera with its picture made ``width`` x ``height`` pixels large."""
        across, down = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * across,
            cx=self.cx * across,
            fy=self.fy * down,
            cy=self.cy * down,
            width=width,
            height=height,
        )

    def direction(self, u: float, v: float) -> tuple[float, float]:
        """Bearing (rad, left positive) and elevation (rad, up positive) of the pixel at ``u``, ``v``."""
        right, down = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        forward = math.cos(self.pitch_rad) - down * math.sin(self.pitch_rad)
        up = -math.sin(self.pitch_rad) - down * math.cos(self.pitch_rad)
        return math.atan2(-right, forward), math.atan2(up, math.hypot(right, forward))

    @property
    def horizon(self) -> float:
        """Where the horizon runs, as a share of the picture's height: 0 at the top, 1 at the bottom, or beyond."""
        return (self.cy - self.fy * math.tan(self.pitch_rad)) / self.height
