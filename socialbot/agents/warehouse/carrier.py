"""Carrier of the warehouse: the agent that takes boxes from its loading bay to its deposit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from socialbot.agents.base.deliberating import Deliberating
from socialbot.agents.warehouse.messages import OBEYED_NS, BoxPositions, MoveCommand, MoveStatus, UnloadCommand
from socialbot.agents.warehouse.scenario import CARRIER_DOMAIN, CARRIER_RULES, FOLDER, carrier_beliefs, is_carried
from socialbot.core.clock import nanoseconds
from socialbot.deliberation.actions import PlanAction
from socialbot.deliberation.messages import AgentRequest, Fact
from socialbot.deliberation.requests import SentRequest
from socialbot.deliberation.sensing import FactSensor, fluent, predicate
from socialbot.graph.ports import Input, Output, Parameter

SILENT_S = 1.0
GRIPPER_SILENT_S = 120.0  # time with the same boxes in the bay until the carrier asks whether the gripper is there
ASK_AGAIN_S = 10.0
GRIPPER_TRIES = 3  # questions without an answer after which it leaves


class Place(FactSensor):
    """Place of the carrier: its bay or its deposit."""

    prototypes = (predicate("in", "*", "*"),)
    deadline_s = SILENT_S

    def tell(self, percept: MoveStatus) -> Iterator[Fact]:
        if percept.current_name in ("base", "deposit"):
            yield predicate("in", percept.robot, percept.current_name)


class Load(FactSensor):
    """Number of boxes on the deck of the carrier."""

    prototypes = (fluent("moving_boxes", "*"),)
    deadline_s = SILENT_S

    def __init__(self, carrier: str) -> None:
        self.carrier = carrier
        self.boxes = 0
        self.status: MoveStatus | None = None

    def tell(self, percept: BoxPositions) -> Iterator[Fact] | None:
        status = self.status
        if status is None:
            return None
        self.boxes = sum(is_carried(status.current_pos, box.position) for box in percept.boxes)
        return iter([fluent("moving_boxes", self.carrier, value=self.boxes)])


class MoveAction(PlanAction):
    """Move the robot of the agent to its third object, a place, by ``agent.go``."""

    def begin(self, robot: str, start: str, target: str) -> None:
        self.sent_at = self.engine.clock.now()
        self.agent.go(target)

    def advance(self) -> float:
        status: MoveStatus | None = self.agent.status
        target = self.args[2]
        if status is None or status.stamp <= self.sent_at:
            return self.progress_made
        if status.target_name != target:
            if status.stamp - self.sent_at > OBEYED_NS:
                self.fail(f"another command has sent {status.robot} to {status.target_name}")
            return self.progress_made
        # The start of the path may be any position, so only the place is reliable.
        return 1.0 if status.current_name == target else min(status.progress, 0.99)


class carrier_move(MoveAction):
    """Move to the bay or to the deposit."""


class carrier_unload(PlanAction):
    """Put all boxes into the deposit."""

    def begin(self, carrier: str, deposit: str) -> None:
        self.agent.cmd_unload.publish(UnloadCommand(stamp=self.engine.clock.now()))

    def advance(self) -> float:
        return self.progress_made + 0.25


PHRASES = {"carrier_move": "drives from {1} to {2}", "carrier_unload": "unloads"}


class Carrier(Deliberating):
    """A carrier agent with the name of its node. It comes at the request of a gripper, and unloads by itself."""

    folder = FOLDER
    actions_known = (carrier_move, carrier_unload)
    phrases = PHRASES

    move_status = Input(MoveStatus, "~/move_status")
    box_positions = Input(BoxPositions, "/warehouse/boxes")
    cmd_target = Output(MoveCommand, "~/cmd_target")
    cmd_unload = Output(UnloadCommand, "~/cmd_unload")

    pddl_file = Parameter(CARRIER_DOMAIN.name, "the domain, PDDL 2.1", fixed=True)
    init_reactive_rules_set = Parameter(CARRIER_RULES.name, "its rules (YAML)", fixed=True)
    agent_group = Parameter("carriers", "the group it belongs to", fixed=True)
    belief_ck = Parameter("grippers", "groups that may check its beliefs, separated by commas", fixed=True)
    belief_w = Parameter("grippers", "groups that may change its beliefs", fixed=True)
    desire_ck = Parameter("grippers", "groups that may check its desires", fixed=True)
    desire_w = Parameter("grippers", "groups that may change its desires", fixed=True)
    desire_pr = Parameter("0.6", "the highest priority that each group of desire_w may give", fixed=True)

    status: MoveStatus | None = None
    gripper = ""
    """The gripper that has asked last."""
    _asked: SentRequest | None = None
    _boxes = 0
    _unanswered = 0
    _ask_at = 0

    def sensors(self) -> Sequence[FactSensor]:
        self.place, self.load_sensor = Place(), Load(self.name)
        return (self.place, self.load_sensor)

    @move_status
    def on_move_status(self, message: MoveStatus) -> None:
        self.status = self.load_sensor.status = message
        self.place.push(message)

    @box_positions
    def on_boxes(self, message: BoxPositions) -> None:
        self.load_sensor.push(message)
        self.leave_without_gripper()

    def on_request(self, message: AgentRequest) -> None:
        if message.receiver == self.name:
            self.gripper = message.sender
        super().on_request(message)

    def leave_without_gripper(self) -> None:
        """Leave the bay with the boxes that are there, if the gripper does not answer any more."""
        now, boxes = self.clock.now(), self.load_sensor.boxes
        if boxes != self._boxes or not boxes or self.status is None or self.status.current_name != "base":
            self._boxes, self._ask_at = boxes, now + nanoseconds(GRIPPER_SILENT_S)
            self._asked, self._unanswered = None, 0
            return
        if now < self._ask_at or not self.gripper:
            return
        self._ask_at = now + nanoseconds(ASK_AGAIN_S)
        asked = self._asked
        if asked is not None:
            self._unanswered = self._unanswered + 1 if asked.state == "timeout" else 0
        if asked is not None and self._unanswered == GRIPPER_TRIES:
            self.deliberator.facts.add(predicate("sent_off", self.name), cause=asked.request.id)
            self._unanswered = 0
        else:
            load = fluent("moving_boxes", self.name, value=boxes)
            self._asked = self.ask(self.gripper, "check", belief=load)

    def go(self, place: str) -> None:
        self.cmd_target.publish(MoveCommand(stamp=self.clock.now(), target=place))

    def beliefs_at_first(self) -> Sequence[Fact]:
        return super().beliefs_at_first() if self.init_bset else carrier_beliefs(self.name)
