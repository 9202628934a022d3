"""The warehouse as it really is: a model of crane, carriers and boxes, the same for the same seed and commands.

The crane's fingers go down until they touch something. What they let go falls straight down and stays where it lands:
on a stack, on a carrier that is there, or on the floor. A carrier stops before a loading bay in which a box stands,
until the box is gone. The crane lifts its fingers before it moves, and lowers them when it rests. A closing gripper
grasps the box that it touches. Commands that make no sense are refused and change nothing.
"""

from __future__ import annotations

import math

from socialbot.agents.base.simulation import SimulatedWorld, WorldFault
from socialbot.agents.warehouse.messages import BoxPosition, Point
from socialbot.agents.warehouse.robots import Drive, RobotPose, WarehouseRobot
from socialbot.agents.warehouse.scenario import (
    BOX_M,
    BOX_WIDTH_M,
    DECK_M,
    GRIPPER,
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

CARRIER_SPEED = 0.72
CARRIER_ACCELERATION = 0.72
"""m/s and m/s2: 5.4 s from bay to deposit, slower over the last 0.36 m."""
CRANE_LONGEST_S = 4.8
CRANE_ACCELERATION = 2.0
"""s for the longest way of the crane, which makes its speed, and m/s2."""
FINGER_SPEED = 2.0
FINGER_ACCELERATION = 8.0
"""m/s and m/s2, up and down: under 0.9 s."""
GRASP_S = 0.3
UNLOAD_S = 1.5

REACH_M = BOX_WIDTH_M
"""What is this near to the middle of a stack or bay touches what stands there, and lands there when it falls."""
TOUCH_M = 0.02
"""Fingers whose tips are this near to the top of a box can grasp it."""
BEFORE_BAY_M = 1.0
"""A carrier stops this far before a bay in which a box stands."""


class Warehouse(SimulatedWorld):
    """The world with its clock: ``advance`` lets time pass, commands act at the time reached, questions are about it.

    ``noise`` is by how much speeds differ from what they should be, at most (0.1 is 10 %); with it, movements stall.
    Times are ns; the world begins at ``start``. Commands return why they are refused, an empty string if they are not.
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
        speed = _speed_for(self.layout.longest_m, CRANE_LONGEST_S, CRANE_ACCELERATION)
        self.crane = WarehouseRobot(
            GRIPPER, self.layout.places, START, speed=speed, acceleration=CRANE_ACCELERATION, noise=noise, seed=seed
        )
        self.carriers = {
            carrier: WarehouseRobot(
                carrier,
                {"base": self.layout.bays[bay], "deposit": self.layout.deposits[deposit]},
                "deposit",
                speed=CARRIER_SPEED,
                acceleration=CARRIER_ACCELERATION,
                noise=noise,
                seed=seed,
            )
            for carrier, bay, deposit in zip(scenario.carriers, scenario.bays, scenario.deposits, strict=True)
        }
        self.load: dict[str, list[str]] = {
            base: [] for base in (START, *scenario.bases, *scenario.bays, *scenario.deposits)
        }
        """What bears which boxes, from bottom to top or in the order in which they came."""
        self.load |= {robot: [] for robot in (GRIPPER, *scenario.carriers, FLOOR)}
        for base, stack in zip(scenario.bases, scenario.stacks, strict=True):
            self.load[base] += stack
        self._spots: dict[str, Point] = {}
        """Where boxes on carriers are, from the carrier's middle; and where those on the floor are."""
        self._fingers = Drive(Point(0.0, 0.0, HIGH_M))
        self._closed = False
        self._lowering = 0
        """Counts orders to the fingers, so that one that waits knows whether it still counts."""
        self._unloading: dict[str, int] = {}
        """When carriers that unload have done so."""
        self._slips = 0
        self._silence: dict[str, int] = {}
        for fault in faults:
            self._after(fault.time_s, lambda fault=fault: self._go_wrong(fault))

    # Commands

    def move_crane(self, target: str) -> str:
        """Sends the crane to one of the layout's places."""
        if target not in self.layout.places:
            return f"there is no place {target!r}"
        self._lift()
        self.crane.go(self.now, target, begin=self._fingers.arrival)
        return ""

    def set_fingers(self, pose: str) -> str:
        """Lifts the fingers (``high``), or lowers them until they touch something (``low``)."""
        if pose not in ("high", "low"):
            return f"{pose!r} is neither high nor low"
        if pose == "high":
            self._lift()
        else:
            self._lowering = order = self._lowering + 1
            self._at(max(self.now, self.crane.drive.arrival), lambda: self._lower(order))
        return ""

    def set_grip(self, status: str) -> str:
        """Opens or closes the fingers (``open``, ``close``), which takes `GRASP_S`."""
        if status not in ("open", "close"):
            return f"{status!r} is neither open nor close"
        self._after(GRASP_S, self._let_go if status == "open" else self._grasp)
        return ""

    def move_carrier(self, carrier: str, target: str) -> str:
        """Sends a carrier to its ``base`` or ``deposit``."""
        if carrier not in self.carriers:
            return f"there is no {carrier!r}"
        if target not in ("base", "deposit"):
            return f"{target!r} is neither base nor deposit"
        self._send(carrier, target)
        return ""

    def unload(self, carrier: str) -> str:
        """Makes a carrier that rests at its deposit put down its boxes there, which takes `UNLOAD_S`."""
        if carrier not in self.carriers:
            return f"there is no {carrier!r}"
        if self.pose(carrier).current_name != "deposit":
            return f"{carrier} is not at its deposit"
        if carrier not in self._unloading:
            self._unloading[carrier] = due = self.now + nanoseconds(UNLOAD_S)
            self._at(due, lambda: self._put_into_deposit(carrier, due))
        return ""

    # Questions

    def pose(self, robot: str) -> RobotPose:
        """Where the crane or a carrier is and where it goes. Raises KeyError for one that is not there."""
        return (self.crane if robot == GRIPPER else self.carriers[robot]).pose(self.now)

    def is_silent(self, sensor: str) -> bool:
        """Whether the sensor of a robot, or `faults.BOXES`, says nothing now."""
        return self.now < self._silence.get(sensor, self.now)

    @property
    def finger_z(self) -> float:
        """How high the tips of the fingers are, m; a held box hangs below them."""
        return self._fingers.position(self.now).z

    @property
    def is_closed(self) -> bool:
        """Whether the fingers are closed."""
        return self._closed

    @property
    def held(self) -> str:
        """The box in the gripper, if any."""
        return next(iter(self.load[GRIPPER]), "")

    def boxes(self) -> tuple[BoxPosition, ...]:
        """Where all boxes are, sorted by name."""
        found = [
            BoxPosition(name=box, position=self._position(box, holder, number), holder=holder)
            for holder, boxes in self.load.items()
            for number, box in enumerate(boxes)
        ]
        return tuple(sorted(found, key=lambda box: box.name))

    def _position(self, box: str, holder: str, number: int) -> Point:
        if holder == GRIPPER:
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

    # What happens

    def _lift(self) -> None:
        self._lowering += 1
        self._move_fingers(HIGH_M)

    def _lower(self, order: int) -> None:
        """Lowers the fingers, unless they were told otherwise or the crane was sent on since."""
        if order != self._lowering:
            return
        if not self.crane.rests(self.now):
            self._at(self.crane.drive.arrival, lambda: self._lower(order))
            return
        touched = self._surface(self.crane.drive.position(self.now))[0]
        self._move_fingers(min(touched + (BOX_M if self.held else 0.0), HIGH_M))

    def _move_fingers(self, height: float) -> None:
        target = Point(0.0, 0.0, height)
        if target != self._fingers.target:
            speed = FINGER_SPEED * self.crane.factor()
            self._fingers.go(self.now, target, speed=speed, acceleration=FINGER_ACCELERATION)

    def _grasp(self) -> None:
        if self._closed:
            return
        self._closed = True
        height, box, holder = self._surface(self.crane.drive.position(self.now))
        if not box or not self.crane.rests(self.now) or abs(self.finger_z - height) > TOUCH_M:
            return
        if self._slips:
            self._slips -= 1
            return
        self.load[holder].remove(box)
        self._spots.pop(box, None)
        self.load[GRIPPER].append(box)
        self._clear_way(holder)

    def _let_go(self) -> None:
        self._closed = False
        if not self.held:
            return
        box = self.load[GRIPPER].pop()
        at = self.crane.drive.position(self.now)
        carrier = self._carrier_at(at)
        stack = self._stack_at(at)
        if carrier:
            middle = self.carriers[carrier].drive.position(self.now)
            self._spots[box] = Point(at.x - middle.x, at.y - middle.y, self._landing(at, carrier) + BOX_M / 2)
            self.load[carrier].append(box)
        elif stack:
            self.load[stack].append(box)
            self._clear_way(stack)
        else:
            self._spots[box] = Point(at.x, at.y, self._landing(at, FLOOR) + BOX_M / 2)
            self.load[FLOOR].append(box)

    def _landing(self, at: Point, holder: str) -> float:
        """How high what falls there comes to rest: on the deck or the floor, or on boxes that it overlaps."""
        tops = [
            box.position.z + BOX_M / 2
            for box in self.boxes()
            if box.holder == holder and _overlap(box.position, at, BOX_WIDTH_M)
        ]
        return max(tops, default=0.0 if holder == FLOOR else DECK_M)

    def _surface(self, at: Point) -> tuple[float, str, str]:
        """What the fingers touch when they come down there: how high, which box that is, if any, and what bears it."""
        carrier, place = self._carrier_at(at), self._stack_at(at)
        if place and not carrier:
            stack = self.load[place]
            return len(stack) * BOX_M, stack[-1] if stack else "", place
        holder = carrier or FLOOR
        beneath = [box for box in self.boxes() if box.holder == holder and _overlap(box.position, at, BOX_WIDTH_M / 2)]
        if not beneath:
            return (0.0 if holder == FLOOR else DECK_M), "", holder
        top = max(beneath, key=lambda box: box.position.z)
        free = not any(
            box.holder == holder
            and box.position.z > top.position.z
            and _overlap(box.position, top.position, BOX_WIDTH_M)
            for box in self.boxes()
        )
        return top.position.z + BOX_M / 2, top.name if free else "", holder

    def _carrier_at(self, at: Point) -> str:
        return next((name for name, robot in self.carriers.items() if is_over(robot.drive.position(self.now), at)), "")

    def _stack_at(self, at: Point) -> str:
        places = (START, *self.scenario.bases, *self.scenario.bays)
        return next((name for name in places if flat_distance(self.layout.places[name], at) <= REACH_M), "")

    def _send(self, carrier: str, target: str) -> None:
        """Sends a carrier as far as the boxes in its bay let it."""
        self._unloading.pop(carrier, None)
        bay = self.scenario.bays[self.scenario.carriers.index(carrier)]
        place = self.layout.bays[bay]
        blocked = target == "base" and self.load[bay]
        stop = Point(place.x, place.y + BEFORE_BAY_M, place.z) if blocked else None
        self.carriers[carrier].go(self.now, target, stop=stop)

    def _clear_way(self, place: str) -> None:
        """Lets the carrier of a bay know that a box was put there or taken away."""
        if place in self.scenario.bays:
            carrier = self.scenario.carriers[self.scenario.bays.index(place)]
            if self.carriers[carrier].target_name == "base":
                self._send(carrier, "base")

    def _put_into_deposit(self, carrier: str, due: int) -> None:
        if self._unloading.get(carrier) != due:
            return
        del self._unloading[carrier]
        boxes = self.load[carrier]
        for box in boxes:
            del self._spots[box]
        self.load[self.scenario.deposits[self.scenario.carriers.index(carrier)]] += boxes
        self.load[carrier] = []

    def _go_wrong(self, fault: WorldFault) -> None:
        seconds = fault.duration_s or 0.0
        match fault.kind:
            case "leaves":
                self._send(fault.target, "deposit")
            case "slips":
                self._slips += 1
            case "silent":
                until = self.now + nanoseconds(seconds)
                self._silence[fault.target] = max(until, self._silence.get(fault.target, 0))
            case "stalls" if fault.target == GRIPPER:
                self.crane.drive.pause(self.now, seconds)
                self._fingers.pause(self.now, seconds)
            case _:
                self.carriers[fault.target].drive.pause(self.now, seconds)


def _overlap(a: Point, b: Point, width: float) -> bool:
    return abs(a.x - b.x) < width and abs(a.y - b.y) < width


def _speed_for(way: float, seconds: float, acceleration: float) -> float:
    """The top speed (m/s) at which a ``way`` (m) takes so many ``seconds``, or the fastest there is."""
    return acceleration / 2 * (seconds - math.sqrt(max(seconds**2 - 4 * way / acceleration, 0.0)))
