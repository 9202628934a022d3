"""Simulated warehouse with crane, carriers and boxes, the same for the same seed and commands.

Lowered fingers stop at the first surface. A released box falls straight down: onto a stack, a carrier or the floor. A
carrier stops before a loading bay with a box until that is gone. The crane lifts its fingers before it moves, and
lowers them when it stands still. Closing fingers grasp the box that they touch. Invalid commands have no effect.
"""

from __future__ import annotations

import math

from msgspec.structs import replace

from socialbot.agents.base._simulation import SimulatedWorld, WorldFault
from socialbot.agents.warehouse._robots import Drive, WarehouseRobot
from socialbot.agents.warehouse.messages import BoxPosition, MoveStatus, Point
from socialbot.agents.warehouse.scenario import (
    BOX_M,
    BOX_WIDTH_M,
    DECK_M,
    HIGH_M,
    SIX,
    START,
    FloorLayout,
    Scenario,
    flat_distance,
    is_over,
)
from socialbot.core.clock import nanoseconds

FLOOR = "floor"

# Speeds in m/s, accelerations in m/s2.
CARRIER_SPEED = 0.72  # 5.4 s from bay to deposit, slower over the last 0.36 m
CARRIER_ACCELERATION = 0.72
CRANE_LONGEST_S = 4.8  # time for the longest path of the crane, which gives its speed
CRANE_ACCELERATION = 2.0
FINGER_SPEED = 2.0  # up or down in less than 0.9 s
FINGER_ACCELERATION = 8.0
GRASP_S = 0.3
UNLOAD_S = 1.5

REACH_M = BOX_WIDTH_M  # radius of a stack or bay: the crane touches its top box, and boxes land there
TOUCH_M = 0.02  # largest distance of the fingers from the top of a box that they can grasp
BEFORE_BAY_M = 1.0  # distance from a blocked bay at which a carrier stops


class Warehouse(SimulatedWorld):
    """Simulated warehouse. Commands take effect at the time that `advance` reached.

    Commands return the reason of a refusal, or an empty string.

    Args:
        scenario: Boxes and carriers.
        seed: Seed of speeds and stalls.
        noise: Largest relative deviation of speeds; 0.1 is 10 %. With noise, movements stall.
        faults: Faults of the run.
        start: Start time, ns.
    """

    def __init__(
        self,
        scenario: Scenario = SIX,
        *,
        seed: int = 0,
        noise: float = 0.1,
        faults: tuple[WorldFault, ...] = (),
        start: int = 0,
    ) -> None:
        super().__init__(start)
        self.scenario = scenario
        self.layout = FloorLayout(scenario)
        speed = scenario.speeds.crane * _speed_for(self.layout.longest_m, CRANE_LONGEST_S, CRANE_ACCELERATION)
        self.crane = WarehouseRobot(
            scenario.gripper,
            self.layout.places,
            START,
            speed=speed,
            acceleration=CRANE_ACCELERATION,
            noise=noise,
            seed=seed,
        )
        self.carriers = {
            carrier: WarehouseRobot(
                carrier,
                {"base": self.layout.bays[bay], "deposit": self.layout.deposits[deposit]},
                "deposit",
                speed=CARRIER_SPEED * scenario.speeds.carriers,
                acceleration=CARRIER_ACCELERATION,
                noise=noise,
                seed=seed,
            )
            for carrier, bay, deposit in scenario.routes
        }
        places = (START, *scenario.bases, *scenario.bays, *scenario.deposits)
        holders = (*places, scenario.gripper, *scenario.carriers, FLOOR)
        self.load: dict[str, list[str]] = {holder: [] for holder in holders}
        """Boxes by holder, from bottom to top or in the order of their arrival."""
        for base, stack in zip(scenario.bases, scenario.stacks, strict=True):
            self.load[base] += stack
        self._spots: dict[str, Point] = {}
        """Positions of boxes: on carriers relative to the carrier, on the floor absolute."""
        self._fingers = Drive(Point(0.0, 0.0, HIGH_M))
        self.is_closed = False
        self._lowering = 0
        """Number of the latest finger command; earlier ones are void."""
        self._unloading: dict[str, int] = {}
        """End times of unloading, by carrier."""
        self._slips = 0
        self._silence: dict[str, int] = {}
        for fault in faults:
            self.after(fault.time_s, lambda fault=fault: self._apply_fault(fault))

    # Commands

    def move_crane(self, target: str) -> str:
        """Move the crane to a place of the layout."""
        if target not in self.layout.places:
            return f"there is no place {target!r}"
        self._lift()
        self.crane.go(self.now, target, begin=self._fingers.arrival)
        return ""

    def set_fingers(self, pose: str) -> str:
        """Lift the fingers (``high``), or lower them until they touch something (``low``)."""
        if pose not in ("high", "low"):
            return f"{pose!r} is neither high nor low"
        if pose == "high":
            self._lift()
        else:
            self._lowering = order = self._lowering + 1
            self.at(max(self.now, self.crane.drive.arrival), lambda: self._lower(order))
        return ""

    def set_grip(self, status: str) -> str:
        """Open or close the fingers within `GRASP_S`."""
        if status not in ("open", "close"):
            return f"{status!r} is neither open nor close"
        self.after(GRASP_S, self._release_box if status == "open" else self._grasp)
        return ""

    def move_carrier(self, carrier: str, target: str) -> str:
        """Move a carrier to its ``base`` or ``deposit``."""
        if carrier not in self.carriers:
            return f"there is no {carrier!r}"
        if target not in ("base", "deposit"):
            return f"{target!r} is neither base nor deposit"
        self._send(carrier, target)
        return ""

    def unload(self, carrier: str) -> str:
        """Unload a carrier at its deposit within `UNLOAD_S`."""
        if carrier not in self.carriers:
            return f"there is no {carrier!r}"
        if self.status(carrier).current_name != "deposit":
            return f"{carrier} is not at its deposit"
        if carrier not in self._unloading:
            self._unloading[carrier] = due = self.now + nanoseconds(UNLOAD_S)
            self.at(due, lambda: self._put_into_deposit(carrier, due))
        return ""

    # State

    def status(self, robot: str) -> MoveStatus:
        """Place and movement of the crane or a carrier. Raises KeyError for an unknown name."""
        if robot != self.scenario.gripper:
            return self.carriers[robot].status(self.now)
        status = self.crane.status(self.now)
        return replace(status, current_pos=Point(status.current_pos.x, status.current_pos.y, self.finger_z))

    def stands_until(self, robot: str) -> int:
        """End (ns) of the present stall of a robot; now if it does not stall."""
        if robot != self.scenario.gripper:
            return self.carriers[robot].drive.paused_until(self.now)
        return max(self.crane.drive.paused_until(self.now), self._fingers.paused_until(self.now))

    def is_silent(self, sensor: str) -> bool:
        """Whether the sensor of a robot, or `BOXES`, is silent."""
        return self.now < self._silence.get(sensor, self.now)

    @property
    def finger_z(self) -> float:
        """Height of the tips of the fingers, m; a held box hangs below them."""
        return self._fingers.position(self.now).z

    @property
    def held(self) -> str:
        """The box in the gripper, or an empty string."""
        return next(iter(self.load[self.scenario.gripper]), "")

    def boxes(self) -> tuple[BoxPosition, ...]:
        """Positions of all boxes, sorted by name."""
        found = [
            BoxPosition(name=box, position=self._position(box, holder, number), holder=holder)
            for holder, boxes in self.load.items()
            for number, box in enumerate(boxes)
        ]
        return tuple(sorted(found, key=lambda box: box.name))

    def _position(self, box: str, holder: str, number: int) -> Point:
        if holder == self.scenario.gripper:
            at = self.crane.drive.position(self.now)
            return Point(at.x, at.y, self.finger_z - BOX_M / 2)
        if holder in self.carriers:
            at, spot = self.carriers[holder].drive.position(self.now), self._spots[box]
            return Point(at.x + spot.x, at.y + spot.y, spot.z)
        if holder in self.layout.deposits:
            return self.layout.stored(holder, number)
        if holder == FLOOR:
            return self._spots[box]
        at = self.layout.places[holder]
        return Point(at.x, at.y, (number + 0.5) * BOX_M)

    # Events

    def _lift(self) -> None:
        self._lowering += 1
        self._move_fingers(HIGH_M)

    def _lower(self, order: int) -> None:
        """Lower the fingers, unless a newer command or a movement of the crane prevents it."""
        if order != self._lowering:
            return
        if not self.crane.rests(self.now):
            self.at(self.crane.drive.arrival, lambda: self._lower(order))
            return
        touched = self._surface(self.crane.drive.position(self.now))[0]
        self._move_fingers(min(touched + (BOX_M if self.held else 0.0), HIGH_M))

    def _move_fingers(self, height: float) -> None:
        target = Point(0.0, 0.0, height)
        if target != self._fingers.target:
            speed = FINGER_SPEED * self.crane.factor()
            self._fingers.go(self.now, target, speed=speed, acceleration=FINGER_ACCELERATION)

    def _grasp(self) -> None:
        if self.is_closed:
            return
        self.is_closed = True
        height, box, holder = self._surface(self.crane.drive.position(self.now))
        if not box or not self.crane.rests(self.now) or not self._touches(height):
            return
        if self._slips:
            self._slips -= 1
            return
        self._attach(box, holder)
        self._update_carrier(holder)

    def _release_box(self) -> None:
        self.is_closed = False
        if box := self.held:
            self._update_carrier(self._detach(box))

    def _touches(self, height: float) -> bool:
        """Whether the fingers can grasp a box whose top is at ``height``."""
        return abs(self.finger_z - height) <= TOUCH_M

    def _attach(self, box: str, holder: str) -> None:
        """Move a box from its holder to the gripper."""
        self.load[holder].remove(box)
        self._spots.pop(box, None)
        self.load[self.scenario.gripper].append(box)

    def _detach(self, box: str) -> str:
        """Drop the box in the gripper, and return its new holder."""
        self.load[self.scenario.gripper].remove(box)
        at = self.crane.drive.position(self.now)
        carrier, stack = self._carrier_at(at), self._stack_at(at)
        holder = carrier or stack or FLOOR
        if carrier or not stack:
            middle = self.carriers[carrier].drive.position(self.now) if carrier else Point(0.0, 0.0, 0.0)
            landing = max((top for top, _ in self._below(at, holder, BOX_WIDTH_M)), default=_ground(holder))
            self._spots[box] = Point(at.x - middle.x, at.y - middle.y, landing + BOX_M / 2)
        self.load[holder].append(box)
        return holder

    def _below(self, at: Point, holder: str, width: float) -> list[tuple[float, BoxPosition]]:
        """Boxes of a carrier or the floor that overlap ``at`` by less than ``width``, with the height of their tops."""
        return [
            (box.position.z + BOX_M / 2, box)
            for box in self.boxes()
            if box.holder == holder and abs(box.position.x - at.x) < width and abs(box.position.y - at.y) < width
        ]

    def _surface(self, at: Point) -> tuple[float, str, str]:
        """Surface below the crane: height, its free box if any, and its holder."""
        carrier, place = self._carrier_at(at), self._stack_at(at)
        if place and not carrier:
            stack = self.load[place]
            return len(stack) * BOX_M, stack[-1] if stack else "", place
        holder = carrier or FLOOR
        below = self._below(at, holder, BOX_WIDTH_M / 2)
        if not below:
            return _ground(holder), "", holder
        height, top = max(below, key=lambda each: each[0])
        free = all(other <= height for other, _ in self._below(top.position, holder, BOX_WIDTH_M))
        return height, top.name if free else "", holder

    def _carrier_at(self, at: Point) -> str:
        return next((name for name in self.carriers if is_over(self._deck(name), at)), "")

    def _deck(self, carrier: str) -> Point:
        """Position of the deck of a carrier, m."""
        return self.carriers[carrier].drive.position(self.now)

    def _stack_at(self, at: Point) -> str:
        places = (START, *self.scenario.bases, *self.scenario.bays)
        return next((name for name in places if flat_distance(self.layout.places[name], at) <= REACH_M), "")

    def _send(self, carrier: str, target: str) -> None:
        """Move a carrier as far as the boxes in its bay permit."""
        self._unloading.pop(carrier, None)
        bay = self.scenario.bays[self.scenario.carriers.index(carrier)]
        place = self.layout.bays[bay]
        blocked = target == "base" and self.load[bay]
        stop = Point(place.x, place.y + BEFORE_BAY_M, place.z) if blocked else None
        self.carriers[carrier].go(self.now, target, stop=stop)

    def _update_carrier(self, place: str) -> None:
        """Update the carrier of a bay after a change of its boxes."""
        if place in self.scenario.bays:
            carrier = self.scenario.carriers[self.scenario.bays.index(place)]
            if self.carriers[carrier].target_name == "base":
                self._send(carrier, "base")

    def _put_into_deposit(self, carrier: str, due: int) -> None:
        if self._unloading.get(carrier) != due:
            return
        del self._unloading[carrier]
        self._store(carrier)

    def _store(self, carrier: str) -> None:
        """Move the boxes of a carrier to its deposit."""
        boxes = self.load[carrier]
        for box in boxes:
            del self._spots[box]
        self.load[self.scenario.deposits[self.scenario.carriers.index(carrier)]] += boxes
        self.load[carrier] = []

    def _remove(self, box: str) -> None:
        """Take a box out of the warehouse."""
        for holder, boxes in self.load.items():
            if box in boxes:
                boxes.remove(box)
                self._spots.pop(box, None)
                self._update_carrier(holder)

    def _apply_fault(self, fault: WorldFault) -> None:
        seconds = fault.duration_s or 0.0
        match fault.kind:
            case "leaves":
                self._send(fault.target, "deposit")
            case "slips":
                self._slips += 1
            case "vanishes":
                self._remove(fault.target)
            case "silent":
                until = self.now + nanoseconds(seconds)
                self._silence[fault.target] = max(until, self._silence.get(fault.target, 0))
            case "stalls" if fault.target == self.scenario.gripper:
                self.crane.drive.pause(self.now, seconds)
                self._fingers.pause(self.now, seconds)
            case _:
                self.carriers[fault.target].drive.pause(self.now, seconds)


def _ground(holder: str) -> float:
    return 0.0 if holder == FLOOR else DECK_M


def _speed_for(way: float, seconds: float, acceleration: float) -> float:
    """Top speed (m/s) for a path (m) in the given time, or the highest possible."""
    return acceleration / 2 * (seconds - math.sqrt(max(seconds**2 - 4 * way / acceleration, 0.0)))
