"""Warehouse with physics, in MuJoCo (extra ``sim``): gantry, carriers and boxes as bodies with mass and friction.

Actuators drive the crane, its tool, the carriers and their pushers along the motions of the kinematic warehouse.
Boxes are free: they rest on each other, ride on decks by friction, and can slip or topple. The tool holds a box by
suction, a constraint that is active while it is closed. A carrier pushes its boxes onto the shelf of its deposit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from socialbot.agents.base.mujoco import CONTROL_NS, STEP_S, SURROUNDINGS, Physics, look_at, servo
from socialbot.agents.warehouse.messages import Point
from socialbot.agents.warehouse.scenario import (
    BASE_Y,
    BOX_M,
    BOX_WIDTH_M,
    COLUMN_M,
    DECK_M,
    FOOTPRINT,
    HIGH_M,
    START,
    FloorLayout,
    Scenario,
)
from socialbot.agents.warehouse.world import FLOOR, UNLOAD_S, Warehouse
from socialbot.core.clock import nanoseconds

CONTACT_S = 4 * STEP_S
"""Time constant of contacts. At twice the step, MuJoCo's minimum, stacks that nothing touches may jump."""
BOX_KG = 0.8
SUCTION_M = 0.03
"""Largest distance of the tool from the top of a box that it can hold."""
GONE = Point(0.0, 0.0, -20.0)
"""Position of boxes that have vanished, below the floor."""
PUSH_M = 1.02
"""Way of the pusher of a carrier, to the edge of its deck."""
RAIL_Z = 2.1
COLOURS = ("0.85 0.33 0.24 1", "0.23 0.51 0.80 1", "0.30 0.66 0.38 1", "0.90 0.66 0.22 1", "0.55 0.39 0.73 1")


def scene_xml(scenario: Scenario) -> str:
    """Return the scene of a scenario in MuJoCo's format, with all boxes at their first places."""
    layout = FloorLayout(scenario)
    start = layout.places[START]
    left, right = start.x - 0.4, max(place.x for place in layout.places.values()) + 0.7
    low, high = min(place.y for place in layout.places.values()) - 0.5, BASE_Y + 0.7
    middle, half = (left + right) / 2, (right - left) / 2
    half_x, half_y = FOOTPRINT[0] / 2, FOOTPRINT[1] / 2
    bodies = [f'<geom class="frame" size="{half} 0.04 0.05" pos="{middle} {y} {RAIL_Z}"/>' for y in (low, high)] + [
        f'<geom class="frame" size="0.05 0.05 {RAIL_Z / 2}" pos="{x} {y} {RAIL_Z / 2}"/>'
        for x in (left, right)
        for y in (low, high)
    ]
    bodies += [
        f'<geom class="mark" size="0.2 0.2 0.001" pos="{layout.places[base].x} {layout.places[base].y} 0.001"/>'
        for base in (START, *scenario.bases)
    ]
    bodies.append(
        f'<body name="bridge" pos="{start.x} 0 {RAIL_Z}"><joint name="x" type="slide" axis="1 0 0"/>'
        f'<geom class="frame" size="0.06 {(high - low) / 2} 0.06" pos="0 {(low + high) / 2} 0" mass="8"/>'
        f'<body name="trolley" pos="0 {start.y} 0"><joint name="y" type="slide" axis="0 1 0"/>'
        '<geom class="machine" size="0.12 0.12 0.09" mass="3"/>'
        f'<body name="tool" pos="0 0 {HIGH_M - RAIL_Z}"><joint name="z" type="slide" axis="0 0 1"/>'
        '<geom class="frame" type="cylinder" size="0.025 0.5" pos="0 0 0.55" mass="0.5"/>'
        '<geom name="pad" class="pad" type="cylinder" size="0.07 0.02" pos="0 0 0.02" mass="1"/></body></body></body>'
    )
    actuators = [servo("x", 4000, 9), servo("y", 2500, 4), servo("z", 2500, 3)]
    for number, (carrier, bay, deposit) in enumerate(scenario.routes):
        bay_at, stop = layout.bays[bay], layout.deposits[deposit]
        colour = COLOURS[number % len(COLOURS)]
        shelf = max(len(scenario.loads[number]), 2) * 0.16 + 0.25
        shelf_y = stop.y + half_y + 0.02 + shelf
        bodies += [
            f'<geom class="lane" size="0.02 {(stop.y - bay_at.y) / 2 + 0.5} 0.004" '
            f'pos="{bay_at.x + side} {(stop.y + bay_at.y) / 2} 0.004"/>'
            for side in (-0.2, 0.2)
        ]
        bodies.append(
            f'<body name="{carrier}" pos="{stop.x} {stop.y} 0">'
            f'<joint name="{carrier}" type="slide" axis="0 1 0"/>'
            f'<geom class="deck" size="{half_x} {half_y} 0.03" pos="0 0 {DECK_M - 0.03}" mass="12"/>'
            f'<geom class="machine" size="{half_x - 0.05} {half_y - 0.08} 0.06" pos="0 0 {DECK_M - 0.12}" mass="8"/>'
            + "".join(
                f'<geom class="wheel" size="0.07 0.03" pos="{x} {y} 0.07" euler="0 1.5708 0"/>'
                for x in (-half_x + 0.05, half_x - 0.05)
                for y in (-0.34, 0.34)
            )
            + f'<geom class="mark" size="{half_x} 0.02 0.05" pos="0 {half_y} {DECK_M - 0.06}" rgba="{colour}"/>'
            + f'<body name="{carrier} pusher" pos="0 {-half_y + 0.03} {DECK_M + 0.07}">'
            f'<joint name="{carrier} pusher" type="slide" axis="0 1 0"/>'
            f'<geom class="pusher" size="{half_x - 0.03} 0.02 0.06" rgba="{colour}" mass="1.5"/></body></body>'
        )
        bodies += [
            f'<geom class="shelf" size="{half_x} {shelf} 0.02" pos="{stop.x} {shelf_y} {DECK_M - 0.03}"/>',
            f'<geom class="shelf" size="0.01 {shelf} 0.06" pos="{stop.x - half_x} {shelf_y} {DECK_M + 0.03}"/>',
            f'<geom class="shelf" size="0.01 {shelf} 0.06" pos="{stop.x + half_x} {shelf_y} {DECK_M + 0.03}"/>',
            f'<geom class="mark" size="{half_x} 0.02 0.09" pos="{stop.x} {shelf_y + shelf} {DECK_M}" rgba="{colour}"/>',
        ]
        actuators += [servo(carrier, 9000, 24), servo(f"{carrier} pusher", 900, 2)]
    owner = {box: number for number, load in enumerate(scenario.loads) for box in load}
    for base, stack in zip(scenario.bases, scenario.stacks, strict=True):
        at = layout.places[base]
        bodies += [
            f'<body name="{box}" pos="{at.x} {at.y} {(level + 0.5) * BOX_M}"><freejoint name="{box}"/>'
            f'<geom class="box" rgba="{COLOURS[owner[box] % len(COLOURS)]}"/></body>'
            for level, box in enumerate(stack)
        ]
    welds = "".join(
        f'<weld name="{box}" body1="tool" body2="{box}" active="false" solref="0.01 1"/>' for box in scenario.boxes
    )
    cross = COLUMN_M * max(len(scenario.carriers), 3)
    return f"""<mujoco model="warehouse">
  {SURROUNDINGS}
  <statistic center="{middle} 1.8 0.5" extent="14"/>
  <default>
    <geom type="box" friction="0.8 0.01 0.001"/>
    <default class="frame"><geom contype="0" conaffinity="0" rgba="0.95 0.72 0.15 1"/></default>
    <default class="machine"><geom contype="0" conaffinity="0" rgba="0.25 0.28 0.33 1"/></default>
    <default class="mark"><geom contype="0" conaffinity="0" rgba="0.30 0.36 0.45 1"/></default>
    <default class="lane"><geom contype="0" conaffinity="0" rgba="0.55 0.58 0.62 1"/></default>
    <default class="wheel"><geom type="cylinder" contype="0" conaffinity="0" rgba="0.1 0.1 0.1 1" mass="0.5"/></default>
    <default class="pad"><geom contype="0" conaffinity="0" rgba="0.15 0.15 0.18 1"/></default>
    <default class="deck"><geom contype="2" conaffinity="1" rgba="0.42 0.46 0.52 1" friction="0.9"/></default>
    <default class="shelf"><geom contype="2" conaffinity="1" rgba="0.72 0.60 0.44 1" friction="0.3"/></default>
    <default class="pusher"><geom contype="2" conaffinity="1" friction="0.2"/></default>
    <default class="box"><geom size="{BOX_WIDTH_M / 2} {BOX_WIDTH_M / 2} {BOX_M / 2}" mass="{BOX_KG}" contype="1"
      conaffinity="3" friction="0.6 0.01 0.001" solref="{CONTACT_S} 1"/></default>
  </default>
  <worldbody>
    <light type="directional" pos="{middle} 1.5 8" dir="-0.35 0.3 -1" diffuse="0.55 0.55 0.52" castshadow="true"/>
    <geom name="floor" type="plane" size="{cross + 6} 12 0.1" material="floor" contype="2" conaffinity="1"/>
    <camera name="film" fovy="42" {look_at((middle + 0.9 * cross + 1.0, -3.3, 3.9), (middle - 0.1, 1.7, 0.3))}/>
    {"".join(bodies)}
  </worldbody>
  <equality>{welds}</equality>
  <actuator>{"".join(actuators)}</actuator>
</mujoco>"""


class PhysicalWarehouse(Warehouse):
    """Warehouse whose boxes obey physics. Commands, states and faults are those of `Warehouse`.

    Raises InstallationError without MuJoCo.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.physics = Physics(scene_xml(self.scenario), self.now)
        self._body = {box: self.physics.model.body(box).id for box in self.scenario.boxes}
        self._weld = {box: self.physics.model.equality(box).id for box in self.scenario.boxes}
        self._gone: set[str] = set()
        self._gripped = ""
        self._refresh()

    def advance(self, time: int) -> None:
        """Run events and physics until ``time``."""
        while self.now < time:
            super().advance(min(self.now + CONTROL_NS, time))
            self._step()
        super().advance(time)

    def box_at(self, box: str) -> Point:
        """Position of the middle of a box, m."""
        x, y, z = self.physics.data.xpos[self._body[box]]
        return Point(float(x), float(y), float(z))

    @property
    def tool_z(self) -> float:
        """Height of the tool, m."""
        return self.physics.position("tool")[2]

    def _position(self, box: str, holder: str, number: int) -> Point:
        return self.box_at(box)

    def _step(self) -> None:
        """Set the targets of all actuators, and let the physics follow up to the present time."""
        crane, start = self.crane.drive.position(self.now), self.layout.places[START]
        control = {"x": crane.x - start.x, "y": crane.y - start.y, "z": self.finger_z - HIGH_M}
        for carrier, _, deposit in self.scenario.routes:
            at = self.carriers[carrier].drive.position(self.now)
            control[carrier] = at.y - self.layout.deposits[deposit].y
            control[f"{carrier} pusher"] = self._push(carrier)
        for name, value in control.items():
            self.physics.aim(name, value)
        self.physics.advance(self.now)
        self._refresh()

    def _push(self, carrier: str) -> float:
        """Position of the pusher of a carrier, m: out for most of the unloading, then back."""
        due = self._unloading.get(carrier)
        if due is None:
            return 0.0
        share = 1.0 - (due - self.now) / nanoseconds(UNLOAD_S)
        return PUSH_M * min(max(share, 0.0) / 0.75, 1.0)

    def _refresh(self) -> None:
        """Sort the boxes to their holders, by their positions."""
        tops = sorted((self.box_at(box).z, box) for box in self._body if box not in self._gone)
        for boxes in self.load.values():
            boxes.clear()
        for _, box in tops:
            self.load[self._holder(box)].append(box)

    def _holder(self, box: str) -> str:
        at = self.box_at(box)
        if box == self._gripped:
            return self.scenario.gripper
        carrier = self._carrier_at(at)
        if carrier and at.z > DECK_M:
            return carrier
        for deposit, stop in self.layout.deposits.items():
            if abs(at.x - stop.x) <= COLUMN_M / 2 and at.y > stop.y + FOOTPRINT[1] / 2:
                return deposit
        return self._stack_at(at) or FLOOR

    def _deck(self, carrier: str) -> Point:
        x, y, _ = self.physics.position(carrier)
        return Point(x, y, 0.0)

    def _surface(self, at: Point) -> tuple[float, str, str]:
        below = [
            (box.position.z + BOX_M / 2, box.name, box.holder)
            for box in self.boxes()
            if box.name != self._gripped
            and abs(box.position.x - at.x) < BOX_WIDTH_M / 2
            and abs(box.position.y - at.y) < BOX_WIDTH_M / 2
        ]
        if below:
            return max(below)
        carrier = self._carrier_at(at)
        return (DECK_M, "", carrier) if carrier else (0.0, "", FLOOR)

    def _touches(self, height: float) -> bool:
        return abs(self.tool_z - height) <= SUCTION_M

    def _attach(self, box: str, holder: str) -> None:
        # The constraint holds the box where it is relative to the tool.
        mujoco, model, data = self.physics.mujoco, self.physics.model, self.physics.data
        weld, tool, body = self._weld[box], data.body("tool"), data.body(box)
        inverse, turn, offset = np.zeros(4), np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(inverse, tool.xquat)
        mujoco.mju_mulQuat(turn, inverse, body.xquat)
        mujoco.mju_rotVecQuat(offset, body.xpos - tool.xpos, inverse)
        model.eq_data[weld][:3] = 0.0
        model.eq_data[weld][3:6] = offset
        model.eq_data[weld][6:10] = turn
        data.eq_active[weld] = 1
        self._gripped = box
        self._refresh()

    def _detach(self, box: str) -> str:
        self._gripped = ""
        self.physics.data.eq_active[self._weld[box]] = 0
        self._refresh()
        return self._holder(box)

    def _store(self, carrier: str) -> None:
        """The boxes lie on the shelf already; the pusher goes back."""

    def _remove(self, box: str) -> None:
        place = self._holder(box)
        self._gone.add(box)
        if self._gripped == box:
            self._detach(box)
        self.physics.put(box, GONE.x + len(self._gone), GONE.y, GONE.z)
        self._refresh()
        self._update_carrier(place)
