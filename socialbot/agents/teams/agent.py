"""Nodes of the agents of a team: plans arrive as messages, actions go to the world."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from socialbot.agents.base.agent_node import AgentNode
from socialbot.agents.teams import messages as acl
from socialbot.agents.teams.actions import (
    OF_A_MISSION,
    Meeting,
    RemoteSociety,
    Rendezvous,
    WorldAction,
    again,
    as_literal,
    by_myself,
    end,
    problem,
)
from socialbot.bdi import Engine
from socialbot.bdi.agentspeak.parser import parse_literal, parse_plan
from socialbot.bdi.library import CompiledPlan
from socialbot.bdi.literals import literal
from socialbot.bdi.plans import Plan
from socialbot.core.errors import GraphError, SocialbotError
from socialbot.core.messages import ActionRequest, Mind, TraceRecord
from socialbot.core.paths import read_text
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter

REGISTER_S = 0.25
"""Time until another registration, if neither an answer nor plans arrive."""
COMPILE_DELAY_S = 0.1
"""Delay of the compilation of plans. It leaves the processor to agents that start at once."""
CANCEL_DELAY_S = 0.2
"""Time until an unwanted action is cancelled; the next plan may start with the same action."""


class TeamMember(Node):
    """Member of a team: it registers with the coordinator, and commands actions to the world."""

    heard = Input(acl.AclMessage, acl.MESSAGES, addressed_by="receiver")
    private = Input(acl.AclMessage, acl.OWN_MESSAGES, optional=True)
    results = Input(acl.ActionResult, acl.RESULTS, addressed_by="robot")
    said = Output(acl.AclMessage, acl.MESSAGES)
    commands = Output(acl.ActionCommand, acl.COMMANDS)
    cancels = Output(acl.ActionCancel, acl.CANCELS)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        self._sender = acl.AclSender(name, context.clock, self.said.publish)
        self._registered = False
        super().__init__(name, context, parameters)

    def registration(self) -> acl.Register:
        """The kind of the agent and its actions."""
        raise NotImplementedError

    def register(self, in_reply_to: str = "") -> None:
        """Register, again and again until an answer arrives."""
        if in_reply_to or not self._registered:
            self._sender.send(acl.COORDINATOR, "request", self.registration(), in_reply_to=in_reply_to)
            if not in_reply_to:
                self.call_after(REGISTER_S, self.register)

    def next_command(self) -> str:
        """An id for a command."""
        return f"{self.name}-action-{self._sender.next_id()}"

    def command(self, id: str, action: str, args: tuple[str, ...]) -> None:
        """Command an action."""
        self.commands.publish(
            acl.ActionCommand(stamp=self.clock.now(), id=id, robot=self.name, action=action, args=args)
        )

    def cancel(self, id: str) -> None:
        """Cancel the action of a command."""
        self.cancels.publish(acl.ActionCancel(stamp=self.clock.now(), id=id))


class TeamAgent(TeamMember, AgentNode):
    """Agent that executes plans of the coordinator; its name is that of the node.

    Its AgentSpeak program has plans for ``+failure(Action, Reason)``: with ``again(Action)`` it tries once more, with
    ``by_myself(Action)`` it does something else first, and with ``problem(Action, Reason)`` it asks the coordinator for
    another plan. The default program tries each action twice.
    """

    keeps_mind = False
    kind: ClassVar[str] = "agent"
    can: ClassVar[tuple[str, ...]] = ()
    """Actions that it can do in the world."""
    program: ClassVar[Path] = Path(__file__).with_name("agent.asl")
    """File of its AgentSpeak program."""
    joint_actions: ClassVar[frozenset[str]] = frozenset()
    """Actions that start when all agents in their arguments are ready."""

    actions = Output(ActionRequest, "~/actions")
    mind = Output(Mind, "~/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "~/trace")

    patience_s = Parameter(1.0, "time before it repeats a failed action (s)", minimum=0.0, maximum=3600.0, fixed=True)
    recovers = Parameter(True, "whether it tries to recover by itself before it reports a problem", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        self.label = ""
        """Label of its plans."""
        self._labels: list[str] = []
        self._early_messages: list[acl.AclMessage] = []
        self._uncompiled: list[CompiledPlan] = []
        self._plan_message: acl.AclMessage | None = None
        """Message with its latest plans."""
        self._in_progress: dict[str, WorldAction] = {}
        self._to_cancel: dict[tuple[str, tuple[str, ...]], str] = {}
        super().__init__(name, context, parameters)
        self._rendezvous = Rendezvous(self._sender)

    def build(self) -> Engine:
        engine = Engine(self.name, self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.messaging.society = RemoteSociety(self.clock, self._tell)
        for action in self.can:
            engine.add_action(type(action, (WorldAction,), {}))
        for action in (again, by_myself, problem, end):
            engine.add_action(action)
        engine.add_text(read_text(self.program, GraphError), self.program.name)
        engine.believe(literal("patience", (round(1000 * self.patience_s),)))
        engine.believe(literal("idle"))
        if not self.recovers:
            for label in [plan.label for plan in engine.library if plan.label and plan.label != "tells"]:
                engine.remove_plan(label)
        engine.compile_plans()
        return engine

    def start(self) -> None:
        self.engine.run_until_idle()
        super().start()
        self.register()

    def registration(self) -> acl.Register:
        return acl.Register(self.kind, self.can)

    # Messages

    @TeamMember.heard
    @TeamMember.private
    def on_heard(self, message: acl.AclMessage) -> None:
        """Process a message, and refuse an invalid one."""
        if message.receiver not in (self.name, acl.EVERYBODY) or message.sender == self.name:
            return
        if violation := self._protocol_error(message):
            if message.receiver == self.name:
                self._refuse(message, violation)
            return
        match message.content:
            case acl.Register():
                if message.performative == "query":
                    self.register(message.id)
                else:
                    self._registered = True
            case acl.Plan() as content:
                self._take_plan(message, content)
            case acl.Start() | acl.Belief() | acl.Ready() | acl.Done():
                self._take_mission_message(message)
            case acl.Stop() | acl.End():
                if message.mission == self.label:
                    self._give_up()
            case acl.Refusal() as content:
                self.log.warning("%s refuses: %s", message.sender, content.reason)
            case other:
                if message.receiver == self.name and message.performative not in ("agree", "inform"):
                    self._refuse(message, f"{self.kind} does not handle {type(other).__name__}")

    def _protocol_error(self, message: acl.AclMessage) -> str:
        """The violation of the protocol or of authority by a message; an empty string for a valid one."""
        if message.sender != acl.COORDINATOR and isinstance(message.content, (acl.Plan, acl.Start, acl.Stop, acl.End)):
            return f"only the coordinator sends this, not {message.sender}"
        return acl.protocol_error(message)

    def _take_plan(self, message: acl.AclMessage, content: acl.Plan) -> None:
        if self._plan_message is not None and message.id == self._plan_message.id:
            return
        # Another registration would count as a restart.
        self._registered = True
        try:
            plans = [parse_plan(text, content.label) for text in content.plans]
        except SocialbotError as error:
            self._refuse(message, str(error))
            return
        if any(plan.label is None or not plan.label.startswith(f"{content.label}_") for plan in plans):
            self._refuse(message, f"the label of a plan does not start with {content.label}_")
            return
        self._clear()
        self.label, self._plan_message = content.label, message
        self._labels = [plan.label for plan in plans if plan.label]
        self._rendezvous.forget(self.label)
        self.engine.forget(literal("idle"))
        self.engine.call(lambda: self._install(plans))
        early, self._early_messages = self._early_messages, []
        for waiting in early:
            self._take_mission_message(waiting)

    def _install(self, plans: list[Plan]) -> None:
        library = self.engine.library
        try:
            for plan in plans:
                self.engine.add_rules(plan)
            new = (compiled for trigger in library.triggers.values() for compiled in trigger.plans)
            self._uncompiled = [compiled for compiled in new if compiled.plan in plans]
        except SocialbotError as error:
            self._refuse_plans(error)
        else:
            self.call_after(COMPILE_DELAY_S, self._compile_one)

    def _compile_one(self) -> None:
        """Compile one plan while the agent is idle."""
        if self._uncompiled:
            try:
                self._uncompiled.pop(0).compile()
            except SocialbotError as error:
                self._refuse_plans(error)
            else:
                self.context.call_soon(self._compile_one)

    def _refuse_plans(self, error: SocialbotError) -> None:
        """Refuse plans that cannot be used."""
        self._give_up()
        if self._plan_message is not None:
            self._refuse(self._plan_message, str(error))

    def _take_mission_message(self, message: acl.AclMessage) -> None:
        """Process a message about a mission; one that arrives before the plans waits for them."""
        if message.mission != self.label:
            if message.mission and message.sender != acl.COORDINATOR:
                self._early_messages = [*self._early_messages[-31:], message]
            return
        match message.content:
            case acl.Start(arguments=arguments):
                self.engine.believe(as_literal("start", arguments), source=message.sender, cause=message.id)  # type: ignore[arg-type]
            case acl.Belief(literal=text):
                try:
                    belief = parse_literal(text)
                    self.engine.believe(belief, source=message.sender, cause=message.id)  # type: ignore[arg-type]
                except SocialbotError as error:
                    self._refuse(message, str(error))
            case acl.Ready(action=action, args=args):
                self._rendezvous.partner_ready(message.sender, Meeting(message.mission, action, args))
            case acl.Done(action=action, args=args):
                self._rendezvous.partner_done(message.sender, Meeting(message.mission, action, args))
            case _:
                pass

    def _tell(self, receiver: str, belief: str) -> None:
        self._sender.send(receiver, "inform", acl.Belief(belief), self.label)

    def report_problem(self, action: str, args: tuple[str, ...], reason: str) -> None:
        if self.label:
            self._sender.send(acl.COORDINATOR, "inform", acl.Problem(reason, args, action), self.label)

    def finish(self) -> None:
        """Report the end of its part, and forget the mission."""
        self._sender.send(acl.COORDINATOR, "request", acl.Finished(), self.label)
        self.engine.call(self._give_up)

    def _refuse(self, message: acl.AclMessage, reason: str) -> None:
        if message.performative not in ("refuse", "failure"):
            self.log.warning("refused a message of %s: %s", message.sender, reason)
            self._sender.send(message.sender, "refuse", acl.Refusal(reason), message.mission, message.id)

    # Mission

    def _clear(self) -> None:
        """Drop intentions, plans and beliefs of the mission."""
        labels, self._labels, self.label, self._uncompiled = self._labels, [], "", []
        self.engine.call(lambda: self._clear_mind(labels))

    def _clear_mind(self, labels: list[str]) -> None:
        engine = self.engine
        for intention in list(engine.intentions):
            engine.intentions.drop(intention)
        for label in labels:
            engine.remove_plan(label)
        for held in list(engine.beliefs):
            if held.belief.functor.startswith(OF_A_MISSION):
                engine.beliefs.forget_all(engine.beliefs.relation(held.belief.key), held.belief.args, (), "")

    def _give_up(self) -> None:
        self._clear()
        self._rendezvous.forget("")
        self.engine.believe(literal("idle"))

    # Actions

    def begin(self, world_action: WorldAction) -> None:
        """Command an action to the world; a joint action waits for all partners."""
        if world_action.action not in self.joint_actions:
            self._command(world_action)
            return
        meeting = Meeting(self.label, world_action.action, world_action.arguments)
        partners = [name for name in world_action.arguments if name != self.name]
        self._rendezvous.arrive(meeting, partners, lambda: self._command(world_action))

    def _command(self, world_action: WorldAction) -> None:
        id = self._to_cancel.pop(world_action.key, "")
        for other in list(self._to_cancel.values()):
            self._cancel(other)
        self._to_cancel.clear()
        id = id or self.next_command()
        known = id in self._in_progress
        self._in_progress[id] = world_action
        if not known:
            self.command(id, world_action.action, world_action.arguments)

    def cancel_later(self, world_action: WorldAction) -> None:
        """Cancel an action after a short time, unless it is wanted again."""
        self._rendezvous.leave(Meeting(self.label, world_action.action, world_action.arguments))
        for id, other in self._in_progress.items():
            if other is world_action:
                self._to_cancel[world_action.key] = id
                self.call_after(CANCEL_DELAY_S, lambda id=id: self._cancel_unless_wanted(id))

    def _cancel_unless_wanted(self, id: str) -> None:
        if id in self._to_cancel.values():
            self._to_cancel = {key: other for key, other in self._to_cancel.items() if other != id}
            self._cancel(id)

    def _cancel(self, id: str) -> None:
        if self._in_progress.pop(id, None) is not None:
            self.cancel(id)

    @TeamMember.results
    def on_result(self, message: acl.ActionResult) -> None:
        world_action = self._in_progress.pop(message.id, None)
        if message.robot != self.name or world_action is None:
            return
        self._to_cancel.pop(world_action.key, None)
        self._sender.send(
            acl.COORDINATOR,
            "inform",
            acl.Report(message.outcome, message.action, message.args, message.reason),
            "" if world_action.own else self.label,
        )
        if message.outcome == "success":
            world_action.succeed()
        else:
            world_action.fail(message.reason)
