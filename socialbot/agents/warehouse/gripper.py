"""Gripper of the warehouse: its actions, and the agent that sorts boxes onto carriers."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from socialbot.agents.base.deliberating import Deliberating
from socialbot.agents.warehouse.carrier import SILENT_S, MoveAction
from socialbot.agents.warehouse.layout import load_layout
from socialbot.agents.warehouse.messages import (
    BoxPosition,
    BoxPositions,
    GripperPose,
    GripperStatus,
    MoveCommand,
    MoveStatus,
)
from socialbot.agents.warehouse.scenario import (
    CARRIER_NAMES,
    FOLDER,
    GRIPPER_DOMAIN,
    GRIPPER_RULES,
    HIGH_M,
    LOAD,
    SIX,
    Scenario,
    gripper_beliefs,
    gripper_desires,
    scenario_of,
)
from socialbot.bdi import Engine
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.deliberation.actions import PlanAction
from socialbot.deliberation.messages import Desire, Fact, Operation
from socialbot.deliberation.requests import SentRequest
from socialbot.deliberation.sensing import FactSensor, fluent, predicate
from socialbot.graph.ports import Input, Output, Parameter


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


COME_PRIORITY, COME_DEADLINE_S = 0.6, 6.0
TOO_LONG = 0.899  # progress at which the wait for a carrier fails
UP_M = HIGH_M - 0.1


class gripper_move(MoveAction):
    """Move the crane to another stack or bay."""


@dataclass(frozen=True)
class Phase:
    """A command that is sent at least ``ticks`` times, until its effect is reached."""

    command: Callable[[], None]
    reached: Callable[[], bool]
    ticks: int = 3


class PhasedAction(PlanAction):
    """An action in phases: one command after the other."""

    rate_hz = 3.0

    def begin(self, *args: Any, **never: Any) -> None:
        gripper: GripperAgent = self.agent
        self.open = Phase(lambda: gripper.grip("open"), gripper.is_open)
        self.close = Phase(lambda: gripper.grip("close"), gripper.is_closed)
        self.lower = Phase(lambda: gripper.move_fingers("low"), gripper.is_down)
        self.lift = Phase(lambda: gripper.move_fingers("high"), gripper.is_up)
        self.phases = self.plan()
        self.phase = self.tick = 0

    def plan(self) -> tuple[Phase, ...]:
        """The phases of the action."""
        raise NotImplementedError

    def advance(self) -> float:
        phase = self.phases[self.phase]
        if self.tick < phase.ticks:
            phase.command()
            self.tick += 1
        elif phase.reached():
            self.phase, self.tick = self.phase + 1, 0
            if self.phase < len(self.phases):
                self.phases[self.phase].command()
                self.tick = 1
        done = sum(phase.ticks for phase in self.phases[: self.phase]) + self.tick
        return 1.0 if self.phase == len(self.phases) else min(done / sum(one.ticks for one in self.phases), 0.99)

    def stop(self) -> None:
        self.lift.command()
        self.stopped()


class gripper_pickup(PhasedAction):
    """Pick up the top box of a stack."""

    def plan(self) -> tuple[Phase, ...]:
        first = () if self.agent.is_open() else (replace(self.open, ticks=1),)
        return (*first, self.lower, self.close, self.lift)


class gripper_putdown(PhasedAction):
    """Put the box down on a stack."""

    def plan(self) -> tuple[Phase, ...]:
        return (self.lower, self.open, self.lift)


class gripper_put_on_carrier(PhasedAction):
    """Put the box on a carrier, in the first or second slot, and inform the carrier.

    The action starts when the carrier knows that it is being loaded, and so stays.
    """

    rate_hz = 2.0

    def begin(self, gripper: str, box: str, carrier: str, bay: str) -> None:
        super().begin()
        self.loaded = predicate("lb_load_completed", carrier)
        self.load_request = self.inform("del")
        self.report: SentRequest | None = None

    def inform(self, operation: Operation) -> SentRequest:
        return self.agent.ask(self.args[2], operation, belief=self.loaded, cause=self.id)

    def plan(self) -> tuple[Phase, ...]:
        gripper: GripperAgent = self.agent
        slot = f"{self.args[3]}{min(gripper.boxes_on(self.args[2]), 1) + 1}"
        move = Phase(lambda: gripper.go(slot), lambda: gripper.is_at(slot) and self.is_known(self.load_request))
        lift = replace(self.lift, reached=self.has_informed)
        return tuple(replace(phase, ticks=4) for phase in (move, self.lower, self.open, lift))

    def has_informed(self) -> bool:
        """Inform the carrier once the fingers are up; returns whether it has accepted."""
        if not self.agent.is_up():
            return False
        if self.report is None:
            self.report = self.inform("add")
        return self.is_known(self.report)

    def is_known(self, asked: SentRequest) -> bool:
        if asked.state in ("refused", "timeout"):
            self.fail(f"{self.args[2]} does not accept the report of its load: {asked.reason}")
        return asked.accepted


class req_carrier_to_come(PlanAction):
    """Request a carrier to come to its bay, and wait for it."""

    rate_hz = 1.0

    def begin(self, carrier: str, deposit: str, bay: str) -> None:
        desire = Desire(
            name=f"{self.engine.name}_cometo_base",
            value=(Fact(name="in", params=(carrier, "base")),),
            priority=COME_PRIORITY,
            deadline=COME_DEADLINE_S,
        )
        self.asked = self.agent.ask(carrier, "add", desire=desire, monitor=True, cause=self.id)
        self.accepted = False

    def advance(self) -> float:
        match self.asked.state:
            case "fulfilled":
                return 1.0
            case "refused" | "timeout" | "dropped":
                self.fail(f"{self.args[0]} does not come: {self.asked.reason or self.asked.state}")
            case "done" if not self.accepted:
                self.accepted = True
                return self.progress_made + 0.25
        made = self.progress_made + 0.1
        if made >= TOO_LONG:
            self.fail("Too much time waited")
        return made

    def stop(self) -> None:
        self.agent.request_client.forget(self.asked)
        self.stopped()


class carrier_unloading(PlanAction):
    """Wait until a full carrier has unloaded; it leaves by itself."""

    rate_hz = 1.0

    def advance(self) -> float:
        carrier, _, deposit = self.args
        gone = self.agent.deliberator.facts.current(predicate("carrier_in_deposit", carrier, deposit))
        if gone is not None and not self.agent.boxes_on(carrier):
            return 1.0
        return min(self.progress_made + 0.1, 0.9)


PHRASES = {
    "gripper_move": "moves from {1} to {2}",
    "gripper_pickup": "picks {1} up from {3}",
    "gripper_putdown": "puts {1} down on {3}",
    "gripper_put_on_carrier": "puts {1} on {2}",
    "req_carrier_to_come": "has {0} come to {2}",
    "carrier_unloading": "waits for {0} to unload",
}


SEND_OFF_S = 2.5  # unloading takes 2 s
DRIVE_S = 20.0  # a carrier drives 6 s
SEND_OFF_TRIES = 7  # the time between two of them doubles
STEADY_M = 0.005  # largest movement of resting fingers between two reports


@dataclass
class LoadedCarrier:
    """A carrier that stands still with boxes: how often it was asked to unload, and when it is asked next (ns)."""

    place: str
    boxes: int
    due: int
    tries: int = 0
    asked: SentRequest | None = None


class GripperAgent(Deliberating):
    """The gripper agent; `gripper_of` makes a subclass for a number of boxes and carriers."""

    folder = FOLDER
    actions_known = (
        gripper_move, gripper_pickup, gripper_putdown, gripper_put_on_carrier, req_carrier_to_come, carrier_unloading,
    )  # fmt: skip
    phrases = PHRASES
    scenario: Scenario = SIX

    motors_move_status = Input(MoveStatus, "~/motors_move_status")
    gripper_status = Input(GripperStatus, "~/gripper_status")
    box_positions = Input(BoxPositions, "/warehouse/boxes")
    cmd_motors_pose = Output(MoveCommand, "~/cmd_motors_pose")
    cmd_gripper_pose = Output(GripperPose, "~/cmd_gripper_pose")
    cmd_gripper_status = Output(GripperStatus, "~/cmd_gripper_status")

    pddl_file = Parameter(GRIPPER_DOMAIN.name, "the domain, PDDL 2.1", fixed=True)
    init_reactive_rules_set = Parameter(GRIPPER_RULES.name, "its rules (YAML)", fixed=True)
    agent_group = Parameter("grippers", "the group it belongs to", fixed=True)
    belief_ck = Parameter("carriers", "groups that may check its beliefs, separated by commas", fixed=True)
    comp_plan_tries = Parameter(16, "plannings that fail before a desire is dropped", minimum=1, fixed=True)
    partial_desires = Parameter(True, "sort the other boxes when one is missing or out of reach", fixed=True)
    exec_plan_tries = Parameter(16, "executions that fail before a desire is dropped", minimum=1, fixed=True)

    status: MoveStatus | None = None
    fingers = ""
    fingers_rest = False

    def build(self) -> Engine:
        self._loaded: dict[str, LoadedCarrier] = {}
        """Carriers that stand still with boxes and get no more."""
        return super().build()

    def sensors(self) -> Sequence[FactSensor]:
        scenario = self.scenario
        self.boxes_sensor = Boxes(scenario)
        self.whereabouts = Whereabouts(scenario.gripper, scenario.bays)
        self.carriers = {route[0]: CarrierStatus(*route) for route in scenario.routes}
        return (self.whereabouts, self.boxes_sensor, *self.carriers.values())

    @motors_move_status
    def on_motors(self, message: MoveStatus) -> None:
        before, self.status = self.status, message
        self.fingers_rest = before is not None and abs(before.current_pos.z - message.current_pos.z) < STEADY_M
        self.whereabouts.push(message)

    @gripper_status
    def on_gripper_status(self, message: GripperStatus) -> None:
        self.fingers = message.status

    @box_positions
    def on_boxes(self, message: BoxPositions) -> None:
        self.boxes_sensor.push(message)
        self.send_off_carriers()

    def send_off_carriers(self) -> None:
        """Ask loaded carriers that get no more boxes, and have stood still for `SEND_OFF_S`, to unload.

        A carrier leaves by itself after the report of its load. This finds those that missed it, were sent away by
        somebody else, or have a place left for which no box comes. A carrier that stays is asked ever more rarely, and
        given up after `SEND_OFF_TRIES` with a record of its boxes.
        """
        now, coming = self.clock.now(), self._coming()
        for carrier, bay, deposit in self.scenario.routes:
            boxes, place = self.boxes_on(carrier), self._place_of(carrier, bay, deposit)
            gets_more = "RUNNING" in coming.get(carrier, ()) or (boxes < LOAD and carrier in coming)
            if not boxes:
                self._loaded.pop(carrier, None)
                continue
            loaded = self._loaded.get(carrier)
            if gets_more or self.is_over(bay):
                if loaded is not None:
                    loaded.due = max(loaded.due, now + nanoseconds(SEND_OFF_S))
                continue
            if loaded is None or (loaded.place, loaded.boxes) != (place, boxes):
                first_s = SEND_OFF_S if place else DRIVE_S
                self._loaded[carrier] = LoadedCarrier(place, boxes, now + nanoseconds(first_s))
            elif now >= loaded.due and loaded.tries < SEND_OFF_TRIES:
                loaded.tries += 1
                loaded.due = now + nanoseconds(SEND_OFF_S * 2**loaded.tries)
                loaded.asked = self.ask(carrier, "add", belief=predicate("sent_off", carrier))
            elif now >= loaded.due and loaded.asked is not None:
                self._record_stuck(carrier, loaded.asked)
                loaded.asked = None
        full = [name for name, loaded in self._loaded.items() if loaded.tries == 0 or loaded.asked is not None]
        self.deliberator.waits_for = f"{', '.join(full)} with boxes" if full else ""

    def _place_of(self, carrier: str, bay: str, deposit: str) -> str:
        """The place where a carrier stands, as believed; empty on its way."""
        current = self.deliberator.facts.current
        if current(predicate("carrier_in_base", carrier, bay)) is not None:
            return bay
        return deposit if current(predicate("carrier_in_deposit", carrier, deposit)) is not None else ""

    def _record_stuck(self, carrier: str, asked: SentRequest) -> None:
        """Record that boxes stay on a carrier, and why."""
        boxes = ", ".join(self.boxes_sensor.riding[carrier])
        message = f"{carrier} does not unload {boxes}: {asked.reason or 'it was asked, and stays'}"
        self.engine.trace.record(
            "failure", f"unloading of {carrier}", asked.request.id, reason="stuck", message=message
        )

    def _coming(self) -> dict[str, set[str]]:
        """States of the steps to come that put a box on each carrier."""
        found: dict[str, set[str]] = {}
        for step in self.deliberator.plan_executor.info.actions_exec_info:
            if step.name == gripper_put_on_carrier.__name__ and step.status in ("WAITING", "RUNNING"):
                found.setdefault(step.args[2], set()).add(step.status)
        return found

    def is_over(self, bay: str) -> bool:
        """Whether the crane is over a bay with its fingers down."""
        status = self.status
        return status is not None and self.whereabouts.place.get(status.current_name) == bay and not self.is_up()

    def boxes_on(self, carrier: str) -> int:
        """Number of boxes on a carrier, as believed."""
        held = self.deliberator.facts.current(fluent("moving_boxes", carrier))
        return 0 if held is None else int(held.value)

    def is_at(self, place: str) -> bool:
        """Whether the crane stands at a place."""
        return self.status is not None and self.status.current_name == place

    def is_up(self) -> bool:
        return self.status is not None and self.status.current_pos.z > UP_M

    def is_down(self) -> bool:
        """Whether the fingers stand still below."""
        return self.fingers_rest and not self.is_up()

    def is_open(self) -> bool:
        return self.fingers == "open"

    def is_closed(self) -> bool:
        return self.fingers == "close"

    def go(self, place: str) -> None:
        self.cmd_motors_pose.publish(MoveCommand(stamp=self.clock.now(), target=place))

    def move_fingers(self, pose: Literal["high", "low"]) -> None:
        self.cmd_gripper_pose.publish(GripperPose(stamp=self.clock.now(), pose=pose))

    def grip(self, status: Literal["open", "close"]) -> None:
        self.cmd_gripper_status.publish(GripperStatus(stamp=self.clock.now(), status=status))

    def beliefs_at_first(self) -> Sequence[Fact]:
        return super().beliefs_at_first() if self.init_bset else gripper_beliefs(self.scenario)

    def desires_at_first(self) -> Sequence[Desire]:
        return super().desires_at_first() if self.init_dset else gripper_desires(self.scenario)


def gripper_of(boxes: int, carriers: int, name: str) -> type[GripperAgent]:
    """The node type ``name`` of a gripper for a number of boxes and carriers."""
    scenario = scenario_of(boxes, carriers)
    gripper = _with_inputs(name, scenario.carriers)
    gripper.scenario = scenario
    return gripper


def _with_inputs(name: str, carriers: Iterable[str], *, optional: bool = False) -> type[GripperAgent]:
    """A node type with an input for the status of each carrier."""
    inputs = {key: each for carrier in carriers for key, each in _status_input(carrier, optional=optional).items()}
    return type(name, (GripperAgent,), {"__doc__": GripperAgent.__doc__, **inputs})


def _status_input(carrier: str, *, optional: bool) -> dict[str, Any]:
    status = Input(MoveStatus, f"/{carrier}/move_status", optional=optional)

    def on_status(node: GripperAgent, message: MoveStatus) -> None:
        if carrier in node.carriers:  # otherwise it is in the aisle of another gripper
            node.carriers[carrier].push(message)

    on_status.__name__ = f"on_{carrier}"
    return {f"{carrier}_status": status, on_status.__name__: status(on_status)}


Gripper = gripper_of(6, 3, "Gripper")
Gripper12 = gripper_of(12, 3, "Gripper12")
Gripper24 = gripper_of(24, 6, "Gripper24")


class LayoutGripper(_with_inputs("_LayoutInputs", CARRIER_NAMES, optional=True)):
    """A gripper of a layout file, with the name of its node. It has the inputs of all `CARRIER_NAMES`."""

    layout = Parameter("", "layout file (YAML), relative to the working directory", fixed=True)

    def build(self) -> Engine:
        scenarios = {scenario.gripper: scenario for scenario in load_layout(self.layout, where=f"{self.name}.layout")}
        if self.name not in scenarios:
            raise ParameterError(
                f"{self.layout} has no gripper {self.name!r}",
                where=f"{self.name}.layout",
                remedy=f"name the node {' or '.join(scenarios)}",
            )
        self.scenario = scenarios[self.name]
        return super().build()
