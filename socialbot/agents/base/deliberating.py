"""Deliberating agent node: desires, plans and requests of other agents on topics of its namespace.

An agent is a class with parameters::

    class Cleaner(Deliberating):
        folder = Path(__file__).parent
        actions_known = (movetoward, doclean, recharge)

        position = Input(Position, "/cleaner/position")

        def sensors(self):
            self.whereabouts = Whereabouts()
            return (self.whereabouts,)

        @position
        def on_position(self, message):
            self.whereabouts.push(message)

Parameters and topics have the names of ROS2-BDI.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar

from socialbot.agents.base.agent_node import AgentNode, DeliberatorCommands
from socialbot.agents.base.state_file import StateFile
from socialbot.bdi import Engine
from socialbot.core import paths
from socialbot.core.errors import PlanningError, suggestion
from socialbot.core.messages import ActionRequest, Mind, TraceRecord
from socialbot.deliberation.actions import PlanAction, register
from socialbot.deliberation.auctions import Auction
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.files import load_beliefs, load_desires, load_rules, restore_mind, save_mind
from socialbot.deliberation.messages import (
    AgentReply,
    AgentRequest,
    Belief,
    BeliefSet,
    CurrentIntentions,
    Desire,
    DesireItem,
    DesireSet,
    Fact,
    LifecycleStatus,
    PlanExecutionInfo,
)
from socialbot.deliberation.options import DeliberationOptions, option_infos
from socialbot.deliberation.requests import Policies, RequestClient, RequestServer
from socialbot.deliberation.sensing import FactSensor, sensed_by
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.planning.pddl.domain import PddlDomain
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.engines import make_planner

POLICIES = ("belief_ck", "belief_w", "desire_ck", "desire_w", "desire_pr")
"""Parameters with the groups that may access beliefs and desires."""


class Deliberating(AgentNode):
    """Agent node with beliefs, desires, reactive rules and a planner."""

    folder: ClassVar[Path | None] = None
    """Folder of relative file names; None for the current folder."""
    actions_known: ClassVar[Sequence[type[PlanAction]]] = ()
    """Executors of the actions of the domain. The engine may instead have plans for goals of these names.

    The class of an action has its name, with ``_`` for each hyphen."""
    deliberates = True

    actions = Output(ActionRequest, "~/actions")
    mind = Output(Mind, "~/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "~/trace")
    belief_set = Output(BeliefSet, "~/belief_set", Delivery.LATCHED)
    desire_set = Output(DesireSet, "~/desire_set", Delivery.LATCHED)
    plan_execution_info = Output(PlanExecutionInfo, "~/plan_execution_info")
    current_intentions = Output(CurrentIntentions, "~/current_intentions", Delivery.LATCHED)
    lifecycle_status = Output(LifecycleStatus, "~/lifecycle_status", Delivery.LATCHED)
    requests_out = Output(AgentRequest, "/agents/requests")
    replies_out = Output(AgentReply, "/agents/replies")

    add_belief = Input(Belief, "~/add_belief", optional=True)
    del_belief = Input(Belief, "~/del_belief", optional=True)
    add_belief_set = Input(BeliefSet, "~/add_belief_set", optional=True)
    del_belief_set = Input(BeliefSet, "~/del_belief_set", optional=True)
    add_desire = Input(DesireItem, "~/add_desire", optional=True)
    del_desire = Input(DesireItem, "~/del_desire", optional=True)
    requests_in = Input(AgentRequest, "/agents/requests")
    replies_in = Input(AgentReply, "/agents/replies")

    pddl_file = Parameter("", "domain (PDDL 2.1)", fixed=True)
    init_bset = Parameter("", "initial beliefs (YAML)", fixed=True)
    init_dset = Parameter("", "initial desires (YAML)", fixed=True)
    init_reactive_rules_set = Parameter("", "reactive rules (YAML)", fixed=True)
    agent_group = Parameter("group0", "group of the agent", fixed=True)
    belief_ck = Parameter("", "groups that may check its beliefs, separated by commas", fixed=True)
    belief_w = Parameter("", "groups that may change its beliefs", fixed=True)
    desire_ck = Parameter("", "groups that may check its desires", fixed=True)
    desire_w = Parameter("", "groups that may change its desires", fixed=True)
    desire_pr = Parameter("", "highest priority that each group of desire_w may give", fixed=True)
    planner = Parameter("kairos", "kairos, popf, or up:ENGINE", fixed=True)
    vars().update(
        (name, Parameter(getattr(DeliberationOptions, name), fixed=True, **asdict(info)))
        for name, info in option_infos().items()
        if info.doc
    )
    request_timeout_s = Parameter(2.0, "time to wait for the reply of another agent (s)", minimum=0.1, fixed=True)
    mind_file = Parameter("", "file of beliefs and desires, to continue after a restart; empty: none", fixed=True)

    _mind_kept: StateFile | None = None

    def build(self) -> Engine:
        engine = Engine(self.name, self.clock, robot=self, sink=self.record, wake=self.wake)
        domain, values = self._domain(), self.parameter_values
        for action in self.actions_known:
            name = self._pddl_name(action, domain)
            register(engine, action, len(domain.actions[name].parameters), name)
        sensors = tuple(self.sensors())
        self.deliberator = Deliberator(
            engine,
            domain,
            make_planner(self.planner),
            self.context.run_in_background,
            options=DeliberationOptions(**{name: values[name] for name in option_infos() if name in values}),
            is_sensed=sensed_by(sensors),
            observer=self,
        )
        policies = Policies.parse(**{name: str(values[name]) for name in POLICIES}, where=self.name)
        self.request_client = RequestClient(engine, self.agent_group, self.requests_out.publish, self.request_timeout_s)
        self.ask = self.request_client.ask
        self.auctions: list[Auction] = []
        """Auctions of the agent that wait for bids."""
        self._request_server = RequestServer(self.deliberator, policies, self.replies_out.publish)
        for sensor in sensors:
            sensor.join(self.deliberator)
        return engine

    def _pddl_name(self, action: type[PlanAction], domain: PddlDomain) -> str:
        """Name of the action of the domain that a class executes: its own, or one with hyphens for underscores."""
        hyphened = (name for name in domain.actions if name.replace("-", "_") == action.functor)
        name = action.functor if action.functor in domain.actions else next(hyphened, None)
        if name is None:
            classes = [known.replace("-", "_") for known in domain.actions]
            raise PlanningError(
                f"there is no action {action.functor}",
                where=domain.where or domain.name,
                remedy=f"rename the class: {suggestion(action.functor, classes)}",
            )
        return name

    def start(self) -> None:
        # Only now the trace has subscribers, and the clock a time.
        self._load()
        self._report_unhandled_actions()
        super().start()

    def recall(self) -> None:
        """Nothing to do: `start` restores the state, and each change saves it."""

    def think(self) -> None:
        super().think()
        if self._mind_kept is not None:
            self._mind_kept.look()

    def _report_unhandled_actions(self) -> None:
        """Report the domain actions without a `PlanAction` or a plan."""
        deliberator = self.deliberator
        idle = ", ".join(deliberator.pursuit.without_handler(deliberator.domain.actions))
        if idle:
            message = f"no plan executes {idle}; desires that need it are dropped"
            self.log.warning(message)
            self.engine.trace.record("failure", "actions", "", reason="nobody", message=message)

    def sensors(self) -> Sequence[FactSensor]:
        """Create the sensors of the agent. Its inputs pass messages to them by `FactSensor.push`."""
        return ()

    def stop(self) -> None:
        self.deliberator.stop()

    def command_handler(self) -> DeliberatorCommands:
        return DeliberatorCommands(self.deliberator)

    # Configuration

    def path(self, parameter: str) -> Path:
        """The file that a parameter names; relative names are in `folder`.

        Raises ParameterError if it is outside of `folder` and the workspace.
        """
        name = str(self.parameter_values[parameter])
        folders = (self.folder or Path.cwd(), *paths.workspace())
        return paths.within(name, folders, where=f"{self.name}.{parameter}")

    def _domain(self) -> PddlDomain:
        if not self.pddl_file:
            raise PlanningError("the agent has no domain", where=self.name, remedy="set its parameter pddl_file")
        path = self.path("pddl_file")
        remedy = "set pddl_file of the agent to its domain"
        return read_domain(paths.read_text(path, PlanningError, remedy=remedy), where=str(path))

    def beliefs_at_first(self) -> Sequence[Fact]:
        """Initial beliefs; by default from the file ``init_bset``."""
        return load_beliefs(self.path("init_bset"), self.deliberator.domain) if self.init_bset else ()

    def desires_at_first(self) -> Sequence[Desire]:
        """Initial desires; by default from the file ``init_dset``."""
        return load_desires(self.path("init_dset"), self.deliberator.domain) if self.init_dset else ()

    def _load(self) -> None:
        """Load the rules, and the saved state or else the initial beliefs and desires."""
        deliberator = self.deliberator
        if self.init_reactive_rules_set:
            for rule in load_rules(self.path("init_reactive_rules_set"), deliberator.domain):
                deliberator.rules.add(rule)
        if self.mind_file:
            path = paths.in_workspace(self.mind_file, where=f"{self.name}.mind_file")
            self._mind_kept = StateFile(self, path, lambda: save_mind(deliberator, path))
            if restore_mind(deliberator, path):
                return
        for fact in self.beliefs_at_first():
            deliberator.facts.add(fact, cause=self.init_bset or "at first")
        for desire in self.desires_at_first():
            deliberator.desire(desire, cause=self.init_dset or "at first")

    # Inputs

    @add_belief
    def on_add_belief(self, message: Belief) -> None:
        self._change((message.belief,), held=True)

    @del_belief
    def on_del_belief(self, message: Belief) -> None:
        self._change((message.belief,), held=False)

    @add_belief_set
    def on_add_belief_set(self, message: BeliefSet) -> None:
        self._change(message.value, held=True, agent=message.agent_id)

    @del_belief_set
    def on_del_belief_set(self, message: BeliefSet) -> None:
        self._change(message.value, held=False, agent=message.agent_id)

    @add_desire
    def on_add_desire(self, message: DesireItem) -> None:
        self.engine.call(lambda: self.deliberator.desire(message.desire, cause="add_desire"))

    @del_desire
    def on_del_desire(self, message: DesireItem) -> None:
        self.engine.call(lambda: self.deliberator.drop(message.desire.name, cause="del_desire"))

    @requests_in
    def on_request(self, message: AgentRequest) -> None:
        if message.receiver == self.name:
            self.engine.call(lambda: self._request_server.handle(message))

    @replies_in
    def on_reply(self, message: AgentReply) -> None:
        if message.receiver == self.name:
            self.engine.call(lambda: self.request_client.handle(message))

    def _change(self, facts: Sequence[Fact], *, held: bool, agent: str | None = None) -> None:
        """Add or remove facts; record those for another agent, and those that the domain does not have, as refused."""
        record, known, cause = self.engine.trace.record, self.deliberator.facts, "add_belief" if held else "del_belief"

        def change() -> None:
            if agent not in (None, self.name):
                record("refused", "a belief set", "", reason=f"it is for the agent {agent!r}")
                return
            for fact in facts:
                reason = known.unfit(fact) if held else known.unfit_pattern(fact)
                if reason is not None:
                    record("refused", str(fact), cause, reason=reason)
                elif held:
                    known.add(fact, cause=cause)
                else:
                    known.remove(fact, cause)

        self.engine.call(change)

    # Outputs, as an observer of the deliberator

    def beliefs_changed(self) -> None:
        """Publish and save the beliefs."""
        facts = self.deliberator.facts.facts()
        self.belief_set.publish(BeliefSet(stamp=self.clock.now(), agent_id=self.name, value=facts))
        self._keep()

    def desires_changed(self) -> None:
        """Publish and save the desires."""
        desires = tuple(state.desire for state in self.deliberator.desires)
        self.desire_set.publish(DesireSet(stamp=self.clock.now(), agent_id=self.name, value=desires))
        self._keep()

    def plan_changed(self, info: PlanExecutionInfo) -> None:
        """Publish the progress of the plan."""
        self.plan_execution_info.publish(info)
        target = info.target.value if info.target is not None and info.status == "RUNNING" else ()
        self.current_intentions.publish(
            CurrentIntentions(
                stamp=info.stamp,
                agent_id=self.name,
                target_value=target,
                actions=tuple(step for step in info.actions_exec_info if step.status in ("RUNNING", "WAITING")),
            )
        )

    def status_changed(self, status: Any, reason: str) -> None:
        """Publish the lifecycle status of the agent."""
        self.lifecycle_status.publish(
            LifecycleStatus(stamp=self.clock.now(), agent_id=self.name, status=status, reason=reason)
        )

    def _keep(self) -> None:
        if self._mind_kept is not None:
            self._mind_kept.changed()
