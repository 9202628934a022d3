"""Node of the simulated warehouse: executes the commands of crane and carriers, and publishes sensor data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar

from socialbot.agents.warehouse.layout import load_layout
from socialbot.agents.warehouse.messages import (
    BoxPositions,
    GripperPose,
    GripperStatus,
    MoveCommand,
    MoveStatus,
    UnloadCommand,
)
from socialbot.agents.warehouse.physics import PhysicalWarehouse
from socialbot.agents.warehouse.scenario import (
    BOXES,
    CARRIER_NAMES,
    GRIPPER,
    GRIPPER_NAMES,
    Scenario,
    faults_in,
    parse_faults,
    scenario_of,
)
from socialbot.agents.warehouse.world import Warehouse
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Structured
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Input, Output, Parameter

Command = tuple[type[Structured], Callable[[Warehouse, Any], str]]
"""Message of a command, and its execution, which returns the reason of a refusal."""

GRIPPER_COMMANDS: Mapping[str, Command] = {
    "cmd_motors_pose": (MoveCommand, lambda world, command: world.move_crane(command.target)),
    "cmd_gripper_pose": (GripperPose, lambda world, command: world.set_fingers(command.pose)),
    "cmd_gripper_status": (GripperStatus, lambda world, command: world.set_grip(command.status)),
}


def _gripper_ports(gripper: str, prefix: str = "", *, optional: bool = False) -> dict[str, Any]:
    """The ports of a gripper, and their callbacks; their names begin with ``prefix``."""
    return _inputs(gripper, GRIPPER_COMMANDS, prefix, optional) | {
        f"{prefix}motors_move_status": Output(MoveStatus, f"/{gripper}/motors_move_status"),
        f"{prefix}gripper_status": Output(GripperStatus, f"/{gripper}/gripper_status"),
    }


def _carrier_ports(carrier: str, *, optional: bool = False) -> dict[str, Any]:
    """The ports of a carrier, and their callbacks."""
    commands: Mapping[str, Command] = {
        "cmd_target": (MoveCommand, lambda world, command: world.move_carrier(carrier, command.target)),
        "cmd_unload": (UnloadCommand, lambda world, _: world.unload(carrier)),
    }
    status = Output(MoveStatus, f"/{carrier}/move_status")
    return _inputs(carrier, commands, f"{carrier}_", optional) | {f"{carrier}_move_status": status}


def _inputs(robot: str, commands: Mapping[str, Command], prefix: str, optional: bool) -> dict[str, Any]:
    """The inputs for commands to a robot, and their callbacks."""
    found: dict[str, Any] = {}
    for name, (kind, execute) in commands.items():
        port = Input(kind, f"/{robot}/{name}", optional=optional)

        def on_command(node: WarehouseWorld, command: Structured, execute: Any = execute) -> None:
            node.execute(robot, lambda world: execute(world, command))

        on_command.__name__ = f"on_{prefix}{name}"
        found |= {f"{prefix}{name}": port, on_command.__name__: port(on_command)}
    return found


class WarehouseWorld(Node):
    """Simulator of a warehouse; its subclasses have the ports of their grippers and carriers.

    Each carrier adds ``/carrier_x/cmd_target``, ``/carrier_x/cmd_unload`` and ``/carrier_x/move_status``.
    """

    is_simulator = True

    boxes: ClassVar[int] = 6
    carriers: ClassVar[int] = 3

    box_positions = Output(BoxPositions, "/warehouse/boxes")

    seed = Parameter(0, "random seed of speeds and stalls", fixed=True)
    noise = Parameter(0.1, "largest relative deviation of speeds; 0: none", minimum=0.0, maximum=0.5, fixed=True)
    faults = Parameter("", "faults: 30 leaves carrier_c; 40 slips; 50 silent carrier_a 10", fixed=True)
    simulation = Parameter(
        "kinematic", "physics: mass and friction in MuJoCo (extra sim)", choices=("kinematic", "physics"), fixed=True
    )
    period_s = Parameter(0.1, "period of the sensors (s)", minimum=0.01, maximum=10.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for unknown faults and for physics without MuJoCo, and errors of a layout file."""
        super().__init__(name, context, parameters)
        self.worlds = self._new_worlds()
        """The aisle of each gripper."""

    @property
    def world(self) -> Warehouse:
        """The first aisle."""
        return next(iter(self.worlds.values()))

    def _new_worlds(self) -> dict[str, Warehouse]:
        scenarios = self.initial_scenarios()
        faults = parse_faults(self.faults, *scenarios)
        kind = PhysicalWarehouse if self.simulation == "physics" else Warehouse
        return {
            scenario.gripper: kind(
                scenario,
                seed=self.seed,
                noise=self.noise,
                faults=faults_in(scenario, faults),
                start=self.clock.now(),
            )
            for scenario in scenarios
        }

    def initial_scenarios(self) -> tuple[Scenario, ...]:
        """The scenario of each gripper at the start."""
        return (scenario_of(self.boxes, self.carriers),)

    def start(self) -> None:
        self.worlds = self._new_worlds()  # on a simulated clock, the time is not known before
        self.context.call_at(self.clock.now(), self._report)

    def execute(self, robot: str, command: Callable[[Warehouse], str]) -> None:
        """Execute a command to a robot in its aisle at the present time, and log its refusal."""
        world = next((one for name, one in self.worlds.items() if robot == name or robot in one.carriers), None)
        if world is None:
            self.log.warning("refused: the layout has no %s", robot)
            return
        world.advance(self.clock.now())
        if refusal := command(world):
            self.log.warning("refused: %s", refusal)

    def _report(self) -> None:
        now = self.clock.now()
        for gripper, world in self.worlds.items():
            world.advance(now)
            prefix = "" if gripper == GRIPPER else f"{gripper}_"
            if not world.is_silent(gripper):
                getattr(self, f"{prefix}motors_move_status").publish(world.status(gripper))
                fingers = GripperStatus(stamp=now, status="close" if world.is_closed else "open")
                getattr(self, f"{prefix}gripper_status").publish(fingers)
            for carrier in world.scenario.carriers:
                if not world.is_silent(carrier):
                    getattr(self, f"{carrier}_move_status").publish(world.status(carrier))
        if not self.world.is_silent(BOXES):
            boxes = (box for world in self.worlds.values() for box in world.boxes())
            self.box_positions.publish(BoxPositions(stamp=now, boxes=tuple(sorted(boxes, key=lambda box: box.name))))
        self.context.call_at(now + nanoseconds(self.period_s), self._report)


def _with_ports(name: str, grippers: Iterable[str], carriers: Iterable[str], *, optional: bool) -> type[WarehouseWorld]:
    """A node type with the ports of `GRIPPER`, and of more grippers and carriers, which may be ``optional``."""
    ports = _gripper_ports(GRIPPER)
    for gripper in grippers:
        ports |= _gripper_ports(gripper, f"{gripper}_", optional=optional)
    for carrier in carriers:
        ports |= _carrier_ports(carrier, optional=optional)
    return type(name, (WarehouseWorld,), {"__doc__": WarehouseWorld.__doc__, **ports})


def world_of(boxes: int, carriers: int, name: str) -> type[WarehouseWorld]:
    """The node type ``name`` of a world with a number of boxes and carriers."""
    world = _with_ports(name, (), scenario_of(boxes, carriers).carriers, optional=False)
    world.boxes, world.carriers = boxes, carriers
    return world


World = world_of(6, 3, "World")
World12 = world_of(12, 3, "World12")
World24 = world_of(24, 6, "World24")


class LayoutWorld(_with_ports("_LayoutPorts", GRIPPER_NAMES[1:], CARRIER_NAMES, optional=True)):
    """Simulator of the warehouse of a layout file. It has the ports of all `GRIPPER_NAMES` and `CARRIER_NAMES`."""

    layout = Parameter("", "layout file (YAML), relative to the working directory", fixed=True)

    def initial_scenarios(self) -> tuple[Scenario, ...]:
        return load_layout(self.layout, where=f"{self.name}.layout")
