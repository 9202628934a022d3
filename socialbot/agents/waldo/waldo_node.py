"""Waldo's mind as a node: detections in, actions out."""

from __future__ import annotations

from socialbot.agents.agent_node import AgentNode
from socialbot.agents.waldo.waldo import Manners, PersonSensor, waldo
from socialbot.bdi import Engine
from socialbot.clock import nanoseconds
from socialbot.graph import Delivery, Input, Output, Parameter
from socialbot.messages import ActionRequest, Mind, PersonDetections, TraceRecord

LATE_S = 10.0
"""Detections that are older say nothing of when something began."""


class WaldoNode(AgentNode):
    """Believes what the detector sees, and decides when to greet and when to offer help."""

    detections = Input(PersonDetections, "/humans/bodies/detections")
    actions = Output(ActionRequest, "/waldo/actions")
    mind = Output(Mind, "/waldo/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "/waldo/trace")

    range_m = Parameter(Manners.range_m, "people farther away (m) are left alone", minimum=0.5, maximum=50.0)
    appear_s = Parameter(
        Manners.appear_s,
        "somebody is there when half of the frames of this time (s) show somebody",
        minimum=0.0,
        maximum=10.0,
    )
    vanish_s = Parameter(
        Manners.vanish_s,
        "nobody is there when under a quarter of the frames of this time (s) show somebody",
        minimum=0.0,
        maximum=60.0,
    )
    help_after_s = Parameter(
        Manners.help_after_s, "who has been there this long (s) is offered help", minimum=0.5, maximum=600.0
    )
    regreet_after_s = Parameter(
        Manners.regreet_after_s, "people are greeted anew after nobody was there (s)", minimum=0.0, maximum=86400.0
    )
    greeting = Parameter("Hello! Nice to see you.", "what to say to one person who comes")
    greeting_several = Parameter("Hello everybody!", "what to say to several people who come together")
    offer = Parameter("Can I help you with anything?", "what to say to somebody who stays")

    def build(self) -> Engine:
        self._manners = Manners()
        for name in self.parameter_values:
            self.on_parameter(name)
        self._sensor = PersonSensor(self._manners)
        return waldo(self.name, self.clock, self._manners, robot=self, sink=self.record, wake=self.wake)

    @detections
    def on_detections(self, message: PersonDetections) -> None:
        """Shows the detections to Waldo's sensor."""
        now = self.clock.now()
        # A camera with a clock of its own must not make beliefs of the future or of long ago.
        since = message.stamp if 0 <= now - message.stamp <= nanoseconds(LATE_S) else now
        self.engine.perceive(self._sensor, message, cause=message.id, since=since)

    def on_parameter(self, name: str) -> None:
        if hasattr(self._manners, name):
            setattr(self._manners, name, self.parameter_values[name])

    def sentence(self, situation: str) -> str:
        """The sentence for a situation, as the parameters have it now."""
        return str(self.parameter_values[situation])
