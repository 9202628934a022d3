"""Deliberating agents as nodes: what comes in, what goes out, and how they are made."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from socialbot.agents.base.deliberating import Deliberating
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError, PlanningError
from socialbot.core.messages import Structured, TraceRecord
from socialbot.deliberation.actions import PlanAction
from socialbot.deliberation.messages import (
    Belief,
    BeliefSet,
    DesireItem,
    Fact,
)
from socialbot.deliberation.requests import RequestServer
from socialbot.deliberation.sensing import FactSensor
from socialbot.graph.node import Graph, NodeConfig
from socialbot.graph.ports import Input, Parameter
from tests.deliberation.domains import i, n, p
from tests.deliberation.office import JOBS, job
from tests.inline import InlineRun

BELIEFS = """\
- {name: a, pddl_type: 1, type: job}
- {name: b, pddl_type: 1, type: job}
"""
DESIRES = """\
- name: do_a
  priority: 0.7
  deadline: 20.0
  value:
    - {name: done, pddl_type: 2, params: [a]}
"""
RULES = """\
- name: call
  condition:
    clauses:
      - literals:
          - {check: T, condition_to_check: {name: begun, pddl_type: 2, params: ["{x}"]}}
  reactive_rules:
    - {set: belief, operation: ADD, value: {name: told, pddl_type: 2, params: []}}
"""


class Light(Structured, frozen=True, kw_only=True):
    """Whether the light is on."""

    on: bool


class Timed(PlanAction):
    """Takes its time; ``lasts_s`` s."""

    rate_hz = 1.0
    lasts_s = 6.0

    def begin(self, *args: str) -> None:
        self.begun = self.engine.clock.now()

    def advance(self) -> float:
        return (self.engine.clock.now() - self.begun) / SECOND / self.lasts_s


class do(Timed):  # noqa: N801
    pass


class delegate(PlanAction):  # noqa: N801
    """Has the worker do a job."""

    rate_hz = 1.0

    def begin(self, job_name: str) -> None:
        self.asked = self.agent.ask("worker", "add", desire=job(job_name, 0.9), monitor=True, cause=self.id)

    def advance(self) -> float:
        if self.asked.state == "fulfilled":
            return 1.0
        if self.asked.state not in ("waiting", "done"):
            self.fail(f"the worker does not: {self.asked.reason}")
        return 0.5


class Eye(FactSensor):
    prototypes = (p("lit"),)
    deadline_s = 2.0

    def tell(self, percept: Light) -> Iterator[Fact]:
        if percept.on:
            yield p("lit")


class Worker(Deliberating):
    actions_known = (do,)
    light = Input(Light, "/light")
    desire_w = Parameter("bosses", "groups that may change its desires", fixed=True)
    desire_pr = Parameter("0.6", "priorities", fixed=True)

    def sensors(self):
        self.eye = Eye()
        return (self.eye,)

    @light
    def on_light(self, message: Light) -> None:
        self.eye.push(message)


class Boss(Deliberating):
    actions_known = (delegate,)
    agent_group = Parameter("bosses", "the group it belongs to", fixed=True)


class Hall(InlineRun):
    """An inline run of nodes, in a light."""

    def __init__(self, *configs: NodeConfig) -> None:
        super().__init__(Graph("hall", configs, frozenset({"/light", "/agents/requests", "/agents/replies"})))

    def until(self, second: float, *, lit: bool | None = True) -> Hall:
        """Lets time pass; the light is seen each second, unless nobody looks."""
        while self.seconds < second:
            if lit is not None:
                self.send("/light", Light(stamp=self.clock.now(), on=lit))
            self.runner.advance(min(self.clock.now() + SECOND, round(second * SECOND)))
        return self

    def trace(self, agent: str, kind: str) -> list[TraceRecord]:
        return [record for record in self.messages(f"/{agent}/trace") if record.kind == kind]

    def facts(self, agent: str) -> tuple[Fact, ...]:
        return self.messages(f"/{agent}/belief_set")[-1].value

    def desires(self, agent: str) -> list[str]:
        return [desire.name for desire in self.messages(f"/{agent}/desire_set")[-1].value]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    for name, text in (("jobs.pddl", JOBS.text), ("b.yaml", BELIEFS), ("d.yaml", DESIRES), ("r.yaml", RULES)):
        (tmp_path / name).write_text(text)
    delegating = JOBS.text.replace("(:durative-action do ", "(:durative-action delegate ")
    (tmp_path / "boss.pddl").write_text(delegating)
    return tmp_path


def worker(files: Path, **more) -> NodeConfig:
    known = {"pddl_file": str(files / "jobs.pddl"), "init_bset": str(files / "b.yaml"), **more}
    return NodeConfig("worker", Worker, known)


def boss(files: Path, **more) -> NodeConfig:
    known = {"pddl_file": str(files / "boss.pddl"), "init_bset": str(files / "b.yaml"), **more}
    return NodeConfig("boss", Boss, known)


def now(message: type, hall: Hall, **about):
    return message(stamp=hall.clock.now(), **about)


class tidy_up(Timed):  # noqa: N801
    """Executes ``tidy-up``: names with hyphens are usual in PDDL, and cannot be classes."""


class Tidier(Worker):
    actions_known = (tidy_up,)


def test_class_executes_the_action_with_hyphens_for_its_underscores(files):
    (files / "jobs.pddl").write_text(JOBS.text.replace("(:durative-action do ", "(:durative-action tidy-up "))
    known = {"pddl_file": str(files / "jobs.pddl"), "init_bset": str(files / "b.yaml")}
    hall = Hall(NodeConfig("worker", Tidier, {**known, "init_dset": str(files / "d.yaml")}))
    hall.until(10)
    assert [record.what for record in hall.trace("worker", "step")] == ["(tidy-up a)"]
    assert p("done", "a") in hall.facts("worker")


def test_class_without_an_action_names_the_nearest_class(files):
    (files / "jobs.pddl").write_text(JOBS.text.replace("(:durative-action do ", "(:durative-action tidy-ups "))
    with pytest.raises(PlanningError, match="there is no action tidy_up") as error:
        Hall(NodeConfig("worker", Tidier, {"pddl_file": str(files / "jobs.pddl")}))
    assert str(error.value.remedy).startswith("rename the class: did you mean 'tidy_ups'?")


def test_agent_loads_its_files_and_fulfils_its_desires(files):
    hall = Hall(worker(files, init_dset=str(files / "d.yaml"), init_reactive_rules_set=str(files / "r.yaml")))
    hall.until(10)
    assert {p("done", "a"), p("told"), p("lit"), i("a", "job")} <= set(hall.facts("worker"))
    assert hall.desires("worker") == []
    assert hall.trace("worker", "desire")[0].cause == str(files / "d.yaml")
    assert [record.what for record in hall.trace("worker", "desire_fulfilled")] == ["do_a"]
    assert hall.runner.faults["worker"].failures == 0


def test_agent_publishes_status_plan_and_intentions(files):
    hall = Hall(worker(files, init_dset=str(files / "d.yaml")))
    hall.until(10)
    statuses = [status.status for status in hall.messages("/worker/lifecycle_status")]
    assert statuses == ["BOOTING", "PLANNING", "EXECUTING", "SCHEDULING"]
    infos = hall.messages("/worker/plan_execution_info")
    assert infos[0].status == "RUNNING"
    assert [step.name for step in infos[0].actions_exec_info] == ["do"]
    assert infos[-1].target is None
    intentions = hall.messages("/worker/current_intentions")
    assert intentions[0].target_value == (p("done", "a"),)
    assert intentions[-1].actions == ()
    assert hall.messages("/worker/mind")[-1].intentions == ()


def test_unchanged_state_is_not_published_again(files):
    hall = Hall(worker(files))
    hall.until(3)
    before = len(hall.said)
    hall.until(20)
    assert len(hall.said) == before


def test_agent_plans_only_after_its_first_percept(files):
    hall = Hall(worker(files, init_dset=str(files / "d.yaml")))
    hall.until(5, lit=None)
    assert hall.trace("worker", "planning") == []
    assert [status.status for status in hall.messages("/worker/lifecycle_status")] == ["BOOTING"]
    hall.until(12)
    assert hall.trace("worker", "desire_fulfilled")


def test_beliefs_and_desires_are_changed_by_topics(files):
    hall = Hall(worker(files))
    hall.send("/worker/add_belief", now(Belief, hall, belief=n("level", "a", value=3)))
    hall.send("/worker/add_belief_set", now(BeliefSet, hall, agent_id="worker", value=(p("ready"), p("quiet"))))
    hall.send("/worker/del_belief", now(Belief, hall, belief=p("quiet")))
    assert {n("level", "a", value=3), p("ready")} <= set(hall.facts("worker"))
    assert p("quiet") not in hall.facts("worker")
    hall.send("/worker/del_belief_set", now(BeliefSet, hall, agent_id="worker", value=(p("ready"), n("level", "*"))))
    assert set(hall.facts("worker")) == {i("a", "job"), i("b", "job")}
    hall.send("/worker/add_desire", now(DesireItem, hall, desire=job("a")))
    assert hall.desires("worker") == ["a"]
    hall.send("/worker/del_desire", now(DesireItem, hall, desire=job("a")))
    assert hall.desires("worker") == []


def test_unknown_facts_and_messages_for_other_agents_are_refused(files):
    hall = Hall(worker(files))
    values = (p("raedy"), n("level", "a"), p("done", "a", "b"), p("ready"))
    hall.send("/worker/add_belief_set", now(BeliefSet, hall, agent_id="worker", value=values))
    hall.send("/worker/add_belief_set", now(BeliefSet, hall, agent_id="boss", value=(p("quiet"),)))
    hall.send("/worker/add_desire", now(DesireItem, hall, desire=job("x", value=(p("raedy"),))))
    hall.send("/worker/del_belief", now(Belief, hall, belief=p("raedy", "*")))
    assert p("ready") in hall.facts("worker")
    assert p("quiet") not in hall.facts("worker")
    refused = [(record.what, str(record.detail["reason"])) for record in hall.trace("worker", "refused")]
    assert [what for what, _ in refused] == ["(raedy)", "(done a b)", "a belief set", "(raedy *)"]
    assert "no predicate 'raedy'" in refused[0][1]
    assert refused[2][1] == "it is for the agent 'boss'"
    assert hall.trace("worker", "desire_refused")
    assert hall.runner.faults["worker"].failures == 0


def test_actions_without_executor_are_reported_at_start(files, caplog):
    hall = Hall(worker(files))
    hall.until(1)
    (failure,) = hall.trace("worker", "failure")
    assert failure.detail["reason"] == "nobody"
    assert str(failure.detail["message"]).startswith("no plan executes prepare, hush, light, report;")
    assert "worker" in caplog.records[0].name
    assert "no plan executes prepare" in caplog.text


def test_options_of_the_executor_are_parameters(files):
    given = {
        "patience_s": 1.5,
        "tolerance_s": 0.25,
        "overrun_factor": 3.0,
        "overrun_s": 7.0,
        "rtc_deadline": 4.0,
        "stop_s": 2.5,
        "retry_s": 0.75,
    }
    hall = Hall(worker(files, **given))
    deliberator = hall.node("worker").deliberator
    assert {name: getattr(deliberator.options, name) for name in given} == given
    with pytest.raises(ParameterError, match="out of range"):
        Hall(worker(files, overrun_factor=0.5))


# Agents among each other


def test_agent_requests_a_desire_of_another_agent(files):
    hall = Hall(worker(files), boss(files, init_dset=str(files / "d.yaml")))
    hall.until(15)
    assert [record.what for record in hall.trace("boss", "desire_fulfilled")] == ["do_a"]
    assert [record.what for record in hall.trace("worker", "desire_fulfilled")] == ["a"]
    requests = hall.messages("/agents/requests")
    request = requests[0]
    assert [again.id for again in requests] == [request.id] * 2, "asked again once, after 5 s, as it monitors"
    (asking,) = hall.trace("boss", "request")
    (asked,) = hall.trace("worker", "asked")
    (adopted,) = hall.trace("worker", "desire")
    assert asking.detail["id"] == asked.cause == adopted.cause == request.id
    assert adopted.detail["priority"] == 0.6, "it asked for 0.9"
    assert [reply.state for reply in hall.messages("/agents/replies")] == ["done", "done", "fulfilled"]
    assert [record.cause for record in hall.trace("boss", "reply")] == [request.id] * 2


def test_restarted_agent_gets_a_monitored_desire_again(files):
    hall = Hall(worker(files), boss(files))
    asked = hall.node("boss").ask("worker", "add", desire=job("a", deadline=30.0), monitor=True)
    hall.until(1)
    assert asked.state == "done"
    forgetful = hall.node("worker")
    forgetful._request_server = RequestServer(
        forgetful.deliberator, forgetful._request_server._policies, forgetful.replies_out.publish
    )
    for state in forgetful.deliberator.desires:
        state.listeners.clear()
    hall.until(8)
    assert asked.state == "fulfilled"


def test_request_of_a_group_without_rights_is_refused(files):
    hall = Hall(worker(files, desire_w="friends"), boss(files, init_dset=str(files / "d.yaml"), exec_plan_tries=2))
    hall.until(15)
    (dropped,) = hall.trace("boss", "desire_dropped")
    assert "group 'bosses' may not add desires; these may: friends" in str(dropped.detail["reason"])
    assert len(hall.trace("worker", "refused")) == 2
    assert hall.trace("worker", "desire") == []


def test_missing_reply_drops_one_desire(files):
    hall = Hall(boss(files, init_dset=str(files / "d.yaml"), exec_plan_tries=1))
    hall.until(15)
    (dropped,) = hall.trace("boss", "desire_dropped")
    assert "no answer from worker in 2 s" in str(dropped.detail["reason"])
    assert len(hall.messages("/agents/requests")) == 4


def test_runs_are_repeatable(files):
    def run() -> list[tuple[str, Any]]:
        hall = Hall(worker(files), boss(files, init_dset=str(files / "d.yaml")))
        hall.until(12)
        return hall.said

    assert run() == run()


# Going on after the end


def test_agent_continues_from_its_mind_file(files):
    mind = files / "mind.json"
    hall = Hall(worker(files, init_dset=str(files / "d.yaml"), mind_file=str(mind)))
    hall.send("/worker/add_desire", now(DesireItem, hall, desire=job("b")))
    hall.until(8)
    assert hall.desires("worker") == ["b"]
    again = Hall(worker(files, init_dset=str(files / "d.yaml"), mind_file=str(mind)))
    assert again.desires("worker") == ["b"], "and not what it desired at first"
    again.until(10)
    assert {p("done", "a"), p("done", "b")} <= set(again.facts("worker"))


def test_agent_goes_on_while_its_mind_file_cannot_be_written_and_saves_it_later(files):
    folder = files / "minds"
    hall = Hall(worker(files, init_dset=str(files / "d.yaml"), mind_file=str(folder / "mind.json")))
    shutil.rmtree(folder)
    folder.write_text("")
    hall.send("/worker/add_desire", now(DesireItem, hall, desire=job("b")))
    hall.until(20)
    assert {p("done", "a"), p("done", "b")} <= set(hall.facts("worker"))
    folder.unlink()
    hall.send("/worker/add_belief", now(Belief, hall, belief=p("done", "a")))  # nothing new
    hall.until(21)
    again = Hall(worker(files, init_dset=str(files / "d.yaml"), mind_file=str(folder / "mind.json")))
    assert {p("done", "a"), p("done", "b")} <= set(again.facts("worker"))


def test_damaged_mind_file_is_an_error(files):
    (files / "mind.json").write_text("{")
    with pytest.raises(PlanningError, match="invalid mind file"):
        Hall(worker(files, mind_file=str(files / "mind.json")))


# What is wrong with files and parameters is one clear error before anything runs


@pytest.mark.parametrize(
    ("file", "old", "new", "where", "what"),
    [
        ("jobs.pddl", "(lit)", "(lit", "jobs.pddl:", ""),
        ("jobs.pddl", "(:durative-action do ", "(:durative-action work ", "jobs.pddl", "there is no action do"),
        ("b.yaml", "type: job}", "type: jop}", "b.yaml:1", "there is no type 'jop'"),
        ("b.yaml", "- {name: a,", "- {nmae: a,", "b.yaml:1", "nmae"),
        ("d.yaml", "deadline: 20.0", "deadline: soon", "d.yaml:3", "deadline"),
        ("d.yaml", "name: done", "name: doen", "d.yaml:5", "there is no predicate 'doen'"),
        ("r.yaml", "name: told", "name: tlod", "r.yaml:", "there is no predicate 'tlod'"),
        ("r.yaml", "clauses:", "clauses: [", "r.yaml:", ""),
    ],
)
def test_invalid_files_are_errors_with_file_and_line(files, file, old, new, where, what):
    path = files / file
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(PlanningError) as error:
        Hall(worker(files, init_dset=str(files / "d.yaml"), init_reactive_rules_set=str(files / "r.yaml")))
    assert where in str(error.value.where)
    assert what in error.value.what


@pytest.mark.parametrize(
    ("parameters", "error", "what"),
    [
        ({"pddl_file": ""}, PlanningError, "no domain"),
        ({"pddl_file": "nowhere.pddl"}, PlanningError, "cannot be read"),
        ({"init_dset": "nowhere.yaml"}, PlanningError, "nowhere.yaml"),
        ({"desire_pr": "0.6, 0.7"}, ParameterError, "2 priorities for 1 groups"),
        ({"desire_pr": "high"}, ParameterError, "'high' is no priority"),
        ({"reschedule_policy": "SOMETIMES"}, ParameterError, "unknown choice"),
        ({"rtc_deadline": 0.5}, ParameterError, "out of range"),
        ({"comp_plan_tries": 0}, ParameterError, "out of range"),
        ({"autosub_cont": True}, ParameterError, "no parameter 'autosub_cont'"),
        ({"planner": "guesswork"}, Exception, "guesswork"),
    ],
)
def test_invalid_parameters_are_errors(files, parameters, error, what):
    with pytest.raises(error, match=what):
        Hall(worker(files, **parameters))


def test_sensor_of_an_unknown_predicate_is_an_error(files):
    (files / "jobs.pddl").write_text(JOBS.text.replace("(lit)", "(bright)"))
    with pytest.raises(PlanningError, match="there is no predicate 'lit'"):
        Hall(worker(files))
