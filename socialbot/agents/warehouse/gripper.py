"""The gripper: the agent that sorts boxes from stacks onto carriers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from socialbot.agents.base.deliberating import Deliberating
from socialbot.agents.warehouse import gripper_actions
from socialbot.agents.warehouse.messages import (
    BoxPosition,
    BoxPositions,
    GripperPose,
    GripperStatus,
    MoveCommand,
    MoveStatus,
)
from socialbot.agents.warehouse.scenario import (
    FOLDER,
    GRIPPER,
    GRIPPER_DOMAIN,
    SIX,
    Cast,
    cast_of,
    gripper_beliefs,
    gripper_desires,
)
from socialbot.deliberation.messages import Desire, Fact
from socialbot.deliberation.sensing import FactSensor, fluent, predicate
from socialbot.graph.node import Input, Output, Parameter

SILENT_S = 1.0
"""A sensor that says nothing for so long is silent."""
STEADY_M = 0.005
"""Fingers that have moved less than this from one report to the next rest."""


class CarrierStatus(FactSensor):
    """Knows whether one carrier is in its bay or its deposit."""

    deadline_s = SILENT_S

    def __init__(self, carrier: str, bay: str, deposit: str) -> None:
        self.carrier, self.bay, self.deposit = carrier, bay, deposit
        self.prototypes = (  # type: ignore[misc] - each carrier has its own
            predicate("carrier_in_base", carrier, "*"),
            predicate("carrier_in_deposit", carrier, "*"),
        )

    @property
    def name(self) -> str:
        return f"status of {self.carrier}"

    def tell(self, percept: MoveStatus) -> Iterator[Fact]:
        if percept.current_name == "base":
            yield predicate("carrier_in_base", self.carrier, self.bay)
        elif percept.current_name == "deposit":
            yield predicate("carrier_in_deposit", self.carrier, self.deposit)


class Whereabouts(FactSensor):
    """Knows what the gripper is over. The two slots of a bay are in the bay."""

    prototypes = (predicate("upon", "*", "*"),)
    deadline_s = SILENT_S

    def __init__(self, bays: Sequence[str]) -> None:
        self.place = {f"{bay}{slot}": bay for bay in bays for slot in (1, 2)}

    def tell(self, percept: MoveStatus) -> Iterator[Fact]:
        start, target = (self.place.get(name, name) for name in (percept.start_name, percept.target_name))
        if percept.current_name != "moving":
            yield predicate("upon", GRIPPER, self.place.get(percept.current_name, percept.current_name))
        elif start == target:
            yield predicate("upon", GRIPPER, start)


class Boxes(FactSensor):
    """Knows where the boxes are: on which stack, in the gripper, on which carrier, or taken away by it."""

    prototypes = (
        predicate("on", "*", "*", "*"),
        predicate("in", "box_*", "*"),
        predicate("clear", "box_*"),
        predicate("clear", "base_[0-9]*"),
        predicate("holding", "*", "*"),
        predicate("carrier_moving", "*", "*"),
        fluent("holding_boxes", "*"),
        fluent("stacked", "*"),
        fluent("moving_boxes", "*"),
    )
    deadline_s = SILENT_S

    def __init__(self, cast: Cast) -> None:
        self.cast = cast

    def tell(self, percept: BoxPositions) -> Iterator[Fact]:
        held: dict[str, list[BoxPosition]] = {}
        for box in percept.boxes:
            held.setdefault(box.holder, []).append(box)
        yield from (predicate("holding", GRIPPER, box.name) for box in held.get(GRIPPER, ()))
        yield fluent("holding_boxes", GRIPPER, value=len(held.get(GRIPPER, ())))
        for base in (*self.cast.bases, *self.cast.bays):
            yield from self._stack(base, sorted(held.get(base, ()), key=lambda box: box.position.z))
        for carrier, deposit in zip(self.cast.carriers, self.cast.deposits, strict=True):
            riding = held.get(carrier, ())
            yield fluent("moving_boxes", carrier, value=len(riding))
            for box in (*riding, *held.get(deposit, ())):
                yield predicate("carrier_moving", carrier, box.name)

    def _stack(self, base: str, boxes: Sequence[BoxPosition]) -> Iterator[Fact]:
        names = [base, *(box.name for box in boxes)]
        yield fluent("stacked", base, value=len(boxes))
        for below, box in itertools.pairwise(names):
            yield predicate("on", box, below, base)
            yield predicate("in", box, base)
        if base in self.cast.bases or boxes:
            yield predicate("clear", names[-1])


class GripperAgent(Deliberating):
    """The gripper; `gripper_of` makes it for some boxes and carriers."""

    folder = FOLDER
    actions_known = gripper_actions.ACTIONS
    phrases = gripper_actions.PHRASES
    cast: ClassVar[Cast] = SIX

    motors_move_status = Input(MoveStatus, f"/{GRIPPER}/motors_move_status")
    gripper_status = Input(GripperStatus, f"/{GRIPPER}/gripper_status")
    box_positions = Input(BoxPositions, "/warehouse/boxes")
    cmd_motors_pose = Output(MoveCommand, f"/{GRIPPER}/cmd_motors_pose")
    cmd_gripper_pose = Output(GripperPose, f"/{GRIPPER}/cmd_gripper_pose")
    cmd_gripper_status = Output(GripperStatus, f"/{GRIPPER}/cmd_gripper_status")

    pddl_file = Parameter(GRIPPER_DOMAIN.name, "the domain, PDDL 2.1", fixed=True)
    init_reactive_rules_set = Parameter("gripper_rules.yaml", "its rules (YAML)", fixed=True)
    agent_group = Parameter("grippers", "the group it belongs to", fixed=True)
    comp_plan_tries = Parameter(16, "plannings that fail before a desire is dropped", minimum=1, fixed=True)
    exec_plan_tries = Parameter(16, "executions that fail before a desire is dropped", minimum=1, fixed=True)

    motors: MoveStatus | None = None
    fingers = ""
    fingers_rest = False

    def sensors(self) -> Sequence[FactSensor]:
        cast = self.cast
        self.boxes_sensor = Boxes(cast)
        self.whereabouts = Whereabouts(cast.bays)
        self.carriers = {
            carrier: CarrierStatus(carrier, bay, deposit)
            for carrier, bay, deposit in zip(cast.carriers, cast.bays, cast.deposits, strict=True)
        }
        return (self.whereabouts, self.boxes_sensor, *self.carriers.values())

    @motors_move_status
    def on_motors(self, message: MoveStatus) -> None:
        """Notes where the crane is."""
        before = self.motors
        self.fingers_rest = before is not None and abs(before.current_pos.z - message.current_pos.z) < STEADY_M
        self.motors = message
        self.hear(self.whereabouts, message)

    @gripper_status
    def on_gripper_status(self, message: GripperStatus) -> None:
        """Notes whether the fingers are open or closed."""
        self.fingers = message.status

    @box_positions
    def on_boxes(self, message: BoxPositions) -> None:
        """Shows the boxes to their sensor."""
        self.hear(self.boxes_sensor, message)

    def on_carrier(self, carrier: str, message: MoveStatus) -> None:
        """Shows where a carrier is to its sensor."""
        self.hear(self.carriers[carrier], message)

    def boxes_on(self, carrier: str) -> int:
        """How many boxes there are on a carrier, as is believed."""
        held = self.deliberator.facts.current(fluent("moving_boxes", carrier))
        return 0 if held is None else int(held.value)

    def is_at(self, place: str) -> bool:
        """Whether the crane stands at a place."""
        return self.motors is not None and self.motors.current_name == place

    def beliefs_at_first(self) -> Sequence[Fact]:
        return super().beliefs_at_first() if self.init_bset else gripper_beliefs(self.cast)

    def desires_at_first(self) -> Sequence[Desire]:
        return super().desires_at_first() if self.init_dset else gripper_desires(self.cast)


def gripper_of(boxes: int, carriers: int, name: str) -> type[GripperAgent]:
    """The node type, called ``name``, of a gripper for so many boxes and carriers."""
    cast = cast_of(boxes, carriers)
    members: dict[str, Any] = {"cast": cast, "__doc__": GripperAgent.__doc__}
    for carrier in cast.carriers:
        members |= _ears_for(carrier)
    return type(name, (GripperAgent,), members)


def _ears_for(carrier: str) -> Mapping[str, object]:
    """The input that tells of one carrier, and the method that takes it."""
    status = Input(MoveStatus, f"/{carrier}/move_status")

    def heard(node: GripperAgent, message: MoveStatus) -> None:
        node.on_carrier(carrier, message)

    heard.__name__ = f"on_{carrier}"
    return {f"{carrier}_status": status, heard.__name__: status(heard)}


Gripper = gripper_of(6, 3, "Gripper")
"""The demonstration: six boxes and three carriers."""
Gripper12 = gripper_of(12, 3, "Gripper12")
Gripper24 = gripper_of(24, 6, "Gripper24")
