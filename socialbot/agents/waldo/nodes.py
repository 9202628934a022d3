"""Nodes of Waldo: the agent, and the listener that sends its actions to the actuators."""

from __future__ import annotations

from functools import partial
from typing import Any

import msgspec

from socialbot.agents.base.agent_node import AgentNode
from socialbot.agents.waldo.waldo import OVERTAKEN_S, PersonSensor, WaldoConfig, silent, waldo
from socialbot.bdi import ANYTHING, Engine
from socialbot.core.clock import SteadyStamps, nanoseconds
from socialbot.core.errors import MessageError
from socialbot.core.messages import ActionRequest, HeadCommand, Health, Mind, PersonDetections, TraceRecord, Utterance
from socialbot.graph.health import HEALTH_TOPIC, SILENT_S, FaultSource, HealthReports
from socialbot.graph.node import Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter

SETTLE_S = 0.05  # delay (s) before Waldo believes a silence, for health messages of other nodes to arrive
REVISE_S = 0.5  # delay (s) before Waldo changes the source of a silence: nodes recover one after the other
ASLEEP_RAD = -0.5  # tilt of the head of a sleeping robot
LATE_S = 10.0  # maximum age of detections whose stamp counts as the start of a belief


class WaldoNode(AgentNode):
    """Agent node of Waldo: decides from detections when to greet people and when to offer help.

    When detections stop, or their node reports silent inputs, Waldo believes which node is silent.
    """

    display_name = "Waldo"

    detections = Input(PersonDetections, "/humans/bodies/detections", deadline_s=SILENT_S)
    health = Input(Health, HEALTH_TOPIC, optional=True)
    actions = Output(ActionRequest, "/waldo/actions")
    mind = Output(Mind, "/waldo/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "/waldo/trace")

    range_m = Parameter(WaldoConfig.range_m, "largest distance of people, m", minimum=0.5, maximum=50.0)
    engage_m = Parameter(WaldoConfig.engage_m, "largest distance of people who engage, m", minimum=0.5, maximum=50.0)
    appear_s = Parameter(WaldoConfig.appear_s, "time to detect an arrival, s", minimum=0.0, maximum=10.0)
    vanish_s = Parameter(WaldoConfig.vanish_s, "time to detect a departure, s", minimum=0.0, maximum=60.0)
    help_after_s = Parameter(WaldoConfig.help_after_s, "time until help is offered, s", minimum=0.5, maximum=600.0)
    together_s = Parameter(
        WaldoConfig.together_s, "who joins so soon after a greeting has heard it, s", minimum=0.1, maximum=10.0
    )
    regreet_after_s = Parameter(
        WaldoConfig.regreet_after_s,
        "without a tracker: absence until people are greeted again, s",
        minimum=0.0,
        maximum=86400.0,
    )
    forget_after_s = Parameter(
        WaldoConfig.forget_after_s, "absence until a person counts as new, s", minimum=0.0, maximum=86400.0
    )
    silent_after_s = Parameter(
        SILENT_S, "timeout of detections, s; at least 2.5 periods of a slow detector", minimum=0.1, maximum=60.0
    )
    greeting = Parameter("Hello! Nice to see you.", "sentence for one person")
    greeting_several = Parameter("Hello everybody!", "sentence for several people who engage together")
    offer = Parameter("Can I help you with anything?", "sentence for a person who stays")

    def build(self) -> Engine:
        self._config = WaldoConfig()
        for name in self.parameter_values:
            self.on_parameter(name)
        self._sensor = PersonSensor(self._config)
        self._stamps = SteadyStamps(OVERTAKEN_S)
        self._healths = HealthReports()
        self._has_seen = False
        self._silent = False
        self._settling: str | None = None
        self._blame: FaultSource | None = None
        return waldo(self.name, self.clock, self._config, robot=self, sink=self.record, wake=self.wake)

    def on_recalled(self) -> None:
        self._sensor.recall(self.engine)
        self.engine.forget(silent(ANYTHING))

    @detections
    def on_detections(self, message: PersonDetections) -> None:
        """Pass detections to the sensor; ignore late ones while no images arrive."""
        if self._blame is not None:
            return
        now = self.clock.now()
        self._has_seen = True
        self._healths.goes_on(now)
        # A wrong camera clock must not date beliefs in the future or in the distant past.
        since = message.stamp if 0 <= now - message.stamp <= nanoseconds(LATE_S) else now
        percept = msgspec.structs.replace(message, stamp=self._stamps.at(message.stamp, now))
        self.engine.perceive(self._sensor, percept, cause=message.id, since=since)

    @health
    def on_health(self, health: Health) -> None:
        self._healths.note(health, self.clock.now())
        self._look_up()

    def deadline_s(self, port: Input[Any]) -> float:
        return self.silent_after_s if port.deadline_s and not self._healths.over else 0.0

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self._silent = True
        self._look_up()

    def on_return(self, port: Input[Any]) -> None:
        self._silent = False
        self._look_up()

    def _look_up(self) -> None:
        """Check whether images arrive; wait a moment before blaming a node."""
        blame = self._find()
        if blame is None or blame == self._blame:
            self._settling = None
            self._take(blame)
        elif self._settling != blame.who:
            self._settling = blame.who
            self.call_after(SETTLE_S if self._blame is None else REVISE_S, partial(self._settle, blame.who))

    def _settle(self, name: str) -> None:
        if self._settling == name:
            self._settling = None
            self._take(self._find())

    def _find(self) -> FaultSource | None:
        """The source of a silence; None if there is no silence or no fault."""
        topic = self.context.health_monitor.topic(WaldoNode.detections)
        if self._healths.over or not (self._silent or self._healths.is_upstream_silent(topic)):
            return None
        return self._healths.blame(topic, self.clock.now(), source=self.name)

    def _take(self, blame: FaultSource | None) -> None:
        before, self._blame = self._blame, blame
        if blame == before:
            return
        if blame is None:
            self.engine.forget(silent(ANYTHING))
            self.report_health("ok")
            return
        cause = f"health-{blame.source}"
        if before is None or before.who != blame.who:
            self.engine.believe(silent(blame.who), source=blame.source, cause=cause)
        if before is None:
            self.engine.perceive(self._sensor, None, cause=cause)
        reason = f" ({blame.source}: {blame.reason})" if blame.reason else ""
        state = "degraded" if self._has_seen else "waiting"
        self.report_health(state, f"sees nothing: {blame.who} is silent{reason}")

    def on_parameter(self, name: str) -> None:
        if hasattr(self._config, name):
            setattr(self._config, name, self.parameter_values[name])

    def sentence(self, situation: str) -> str:
        """The current sentence for a situation."""
        return str(self.parameter_values[situation])


class Listener(Node):
    """Listener of Waldo's actions: publishes utterances and head commands.

    ``speak`` and ``tell`` publish an utterance and make the head follow people, ``attend`` only the latter.
    ``stayIdle`` centres the head, ``fallAsleep`` lowers it.
    """

    actions = Input(ActionRequest, "/waldo/actions")
    say = Output(Utterance, "/speech/say")
    head = Output(HeadCommand, "/head/command")

    @actions
    def on_action(self, action: ActionRequest) -> None:
        """Publish the commands of one action. Raises MessageError for an unknown action."""
        match action.name, action.arguments:
            case "speak", (str(situation), str(text)):
                self._say(action, text, key=situation)
            case "tell" | "tell_again" | "explain", (str(), str(person), str(text), str(language)):
                self._say(action, text, person=person, language=language)
            case "attend" | "wakeUp", ():
                self._look("track", action)
            case "fallAsleep", ():
                self.head.publish(HeadCommand(stamp=action.stamp, mode="look", tilt_rad=ASLEEP_RAD, cause=action.id))
            case "stayIdle", ():
                self._look("centre", action)
            case _:
                what = f"unknown action {action.name}{action.arguments}"
                remedy = "send speak(situation, sentence), tell(situation, person, sentence, language), or stayIdle()"
                raise MessageError(what, where=self.name, remedy=remedy)

    def _say(self, action: ActionRequest, text: str, **about: str) -> None:
        self._look("track", action)
        self.say.publish(Utterance(stamp=action.stamp, id=f"say-{action.id}", text=text, cause=action.id, **about))

    def _look(self, mode: str, action: ActionRequest) -> None:
        self.head.publish(HeadCommand(stamp=action.stamp, mode=mode, cause=action.id))  # type: ignore[arg-type]
