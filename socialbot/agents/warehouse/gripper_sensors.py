"""Sensors of the gripper of the warehouse: places of carriers, gripper and boxes as facts."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from socialbot.agents.warehouse.carrier import SILENT_S
from socialbot.agents.warehouse.messages import BoxPosition, BoxPositions, MoveStatus
from socialbot.agents.warehouse.scenario import Scenario
from socialbot.deliberation.messages import Fact
from socialbot.deliberation.sensing import FactSensor, fluent, predicate


class CarrierStatus(FactSensor):
    """Place of a carrier: its bay or its deposit."""

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
    """Place of the gripper. Both slots of a bay count as the bay."""

    prototypes = (predicate("upon", "*", "*"),)
    deadline_s = SILENT_S

    def __init__(self, gripper: str, bays: Sequence[str]) -> None:
        self.gripper = gripper
        self.place = {f"{bay}{slot}": bay for bay in bays for slot in (1, 2)}

    def tell(self, percept: MoveStatus) -> Iterator[Fact]:
        start, target = (self.place.get(name, name) for name in (percept.start_name, percept.target_name))
        if percept.current_name != "moving":
            yield predicate("upon", self.gripper, self.place.get(percept.current_name, percept.current_name))
        elif start == target:
            yield predicate("upon", self.gripper, start)


class Boxes(FactSensor):
    """Places of the boxes: on a stack, in the gripper, on a carrier, or taken away by it."""

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

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.riding: dict[str, tuple[str, ...]] = {}
        """Boxes on each carrier."""

    def tell(self, percept: BoxPositions) -> Iterator[Fact]:
        held: dict[str, list[BoxPosition]] = {}
        for box in percept.boxes:
            held.setdefault(box.holder, []).append(box)
        gripper = self.scenario.gripper
        in_fingers = held.get(gripper, ())
        yield from (predicate("holding", gripper, box.name) for box in in_fingers)
        yield fluent("holding_boxes", gripper, value=len(in_fingers))
        for base in (*self.scenario.bases, *self.scenario.bays):
            yield from self._stack(base, sorted(held.get(base, ()), key=lambda box: box.position.z))
        for carrier, _, deposit in self.scenario.routes:
            riding = held.get(carrier, ())
            self.riding[carrier] = tuple(box.name for box in riding)
            yield fluent("moving_boxes", carrier, value=len(riding))
            for box in (*riding, *held.get(deposit, ())):
                yield predicate("carrier_moving", carrier, box.name)

    def _stack(self, base: str, boxes: Sequence[BoxPosition]) -> Iterator[Fact]:
        names = [base, *(box.name for box in boxes)]
        yield fluent("stacked", base, value=len(boxes))
        for below, box in itertools.pairwise(names):
            yield predicate("on", box, below, base)
            yield predicate("in", box, base)
        if base in self.scenario.bases or boxes:
            yield predicate("clear", names[-1])
