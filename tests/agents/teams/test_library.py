"""The recovery experiment of the library, with both planners."""

from __future__ import annotations

import re

import pytest

from socialbot.agents.teams import Mission, TeamAgent
from socialbot.agents.teams.messages import COORDINATOR, EVERYBODY, MESSAGES, AclMessage, Plan
from socialbot.planning.htn import TaskDomain
from tests.agents.teams.library import EXAMPLE, LibraryRun
from tests.example_modules import EXAMPLES

PLANNERS = pytest.mark.parametrize("planner", ["htn", "pddl"])
QUICK_PLANNER = pytest.mark.parametrize("planner", ["htn", pytest.param("pddl", marks=pytest.mark.slow)])
ALL = set(EXAMPLE.BOOKS)


def test_the_mission_is_written_in_less_than_200_lines():
    assert len((EXAMPLES / "library.py").read_text("utf-8").splitlines()) < 200


@pytest.fixture(scope="module", params=["htn", "pddl"])
def undisturbed(request: pytest.FixtureRequest) -> LibraryRun:
    return LibraryRun(request.param).until(100.0)


def test_all_books_are_fetched(undisturbed: LibraryRun):
    run = undisturbed
    assert run.delivered() == ALL
    assert {(view.status, view.recoveries) for view in run.views.values()} == {("finished", 0)}


@QUICK_PLANNER
def test_book_of_a_dead_runner_is_taken_from_its_hands(planner: str):
    run = LibraryRun(planner).until(9.0)
    run.runner.kill("runner1")
    assert run.until(200.0).delivered() == ALL
    assert "runner1 does not answer" in run.problems


@QUICK_PLANNER
def test_porter_that_hangs_is_replaced(planner: str):
    run = LibraryRun(planner, "3 stalls porter1 100000").until(300.0)
    assert run.delivered() == ALL
    assert any("porter1 is stuck" in problem for problem in run.problems)


@QUICK_PLANNER
def test_agent_that_joins_late_is_used(planner: str):
    run = LibraryRun(planner, late=("porter1", "porter2")).until(30.0)
    assert {view.status for view in run.views.values()} == {"waiting"}
    assert {view.problem for view in run.views.values()} == {"nobody for Porter (no such agent is registered)"}
    run.runner.restart("porter2")
    assert run.until(150.0).delivered() == ALL


@QUICK_PLANNER
def test_vanished_book_costs_only_that_book(planner: str):
    run = LibraryRun(planner, "9 vanishes atlas").until(150.0)
    assert run.delivered() == ALL - {"atlas"}
    assert (run.views["atlas"].status, run.views["atlas"].problem) == ("failed", "atlas is gone")


@QUICK_PLANNER
def test_missions_that_fail_again_and_again_do_not_hold_up_others(planner: str, monkeypatch: pytest.MonkeyPatch):
    heavy = TaskDomain("library whose first two books are too heavy")
    heavy.declare_actions(*(each.function for name, each in EXAMPLE.LIBRARY.actions.items() if name != "a_take"))

    @heavy.action
    def a_take(state, runner, book, place):
        return None if book in ("atlas", "bible") else EXAMPLE.a_take(state, runner, book, place)

    monkeypatch.setattr(EXAMPLE.LibraryWorld, "domain", heavy)
    run = LibraryRun(planner, late=("runner2", "runner3", "porter2")).until(400.0)
    assert run.delivered() == {"comic", "diary"}


def test_silent_sensors_only_delay_missions():
    run = LibraryRun(faults="0 silent runner1 30; 5 silent state 20").until(200.0)
    assert run.delivered() == ALL


def test_each_agent_gets_the_plans_of_its_own_actions_only(undisturbed: LibraryRun):
    sent = [message for message in undisturbed.heard if isinstance(message.content, Plan)]
    assert sent
    for message in sent:
        able = EXAMPLE.Runner.can if message.receiver.startswith("runner") else EXAMPLE.Porter.can
        assert isinstance(message.content, Plan)
        actions = {re.search(r"a_\w+", text.partition(":")[0])[0] for text in message.content.plans}  # type: ignore[index]
        assert actions <= set(able)


def test_messages_of_the_coordinator_reach_their_receiver_only(monkeypatch: pytest.MonkeyPatch):
    got: dict[str, list[AclMessage]] = {}
    take = TeamAgent.on_heard

    def on_heard(agent: TeamAgent, message: AclMessage) -> None:
        got.setdefault(agent.name, []).append(message)
        take(agent, message)

    monkeypatch.setattr(TeamAgent, "on_heard", on_heard)
    run = LibraryRun().until(100.0)
    for name in (*EXAMPLE.RUNNERS, *EXAMPLE.PORTERS):
        mail = [message for message in got[name] if message.receiver != EVERYBODY]
        assert any(isinstance(message.content, Plan) for message in mail), name
        assert {message.receiver for message in mail} == {name}
    shared = run.messages(MESSAGES)
    assert {message.receiver for message in shared if message.sender == COORDINATOR} == {EVERYBODY}


def test_planner_may_differ_by_kind_of_mission():
    domain = EXAMPLE.Library()
    domain.planners = {"urgent": EXAMPLE.Library(htn=False).planner}
    kinds = {kind: domain.planner_of(Mission(1, kind, "atlas")) for kind in domain.kinds}
    assert kinds == {"fetch": domain.planner, "urgent": domain.planners["urgent"]}
