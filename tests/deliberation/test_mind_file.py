from __future__ import annotations

import json

import pytest

from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from socialbot.deliberation.files import restore_mind, save_mind
from socialbot.planning.pddl.reader import read_domain
from tests.deliberation.domains import dnf, n, p
from tests.deliberation.office import JOBS, Office, job
from tests.deliberation.stage import WORKSHOP, Behaviour, Stage, facts


@pytest.fixture
def path(tmp_path):
    return tmp_path / "mind" / "clerk.json"


def revived(path, **more) -> Office:
    """Another process, some seconds later."""
    office = Office(beliefs="", clock=ManualClock(50_000_000_000), **more)
    office.run(lambda: restore_mind(office.deliberator, path))
    return office


def test_beliefs_and_desires_outlive_the_agent(path):
    office = Office()
    office.believe("level a = 2.5; lit")
    wanted = job("x", 0.7, 33.0, precondition=dnf([("T", p("ready"))]), rollback_belief_del=(p("done", "*"),))
    office.want(wanted, job("a"))
    office.until(1)
    save_mind(office.deliberator, path)
    later = revived(path)
    assert n("level", "a", value=2.5) in later.facts.facts()
    assert [state.desire for state in later.deliberator.desires if state.name == "x"] == [wanted]
    assert later.pursued == "a"
    later.until(60)
    assert later.wants == ["x"]


def test_without_a_file_no_state_is_restored(path):
    office = Office(beliefs="")
    assert not restore_mind(office.deliberator, path)
    assert office.facts.facts() == ()


def test_failures_are_restored(path):
    office = Office(exec_plan_tries=3)
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.want(job("a"))
    office.until(2.5)
    save_mind(office.deliberator, path)
    later = Office(beliefs="", exec_plan_tries=3)
    later.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    restore_mind(later.deliberator, path)
    later.until(60)
    assert later.begun() == [(0.0, "(do a)")]
    assert later.found("desire_dropped", "a")


def test_start_effects_and_desires_are_rolled_back_in_the_file(path):
    office = Office()
    office.believe("told", "quiet")
    office.want(job("a", rollback_belief_add=(p("lit"),), rollback_belief_del=(p("to*"), p("told"))))
    office.until(2)
    assert p("begun", "a") in office.facts.facts()
    save_mind(office.deliberator, path)
    later = Office(beliefs="")
    restore_mind(later.deliberator, path)
    held = later.facts.facts()
    assert p("begun", "a") not in held
    assert p("lit") in held
    assert p("told") not in held
    assert p("quiet") in held
    assert p("begun", "a") in office.facts.facts(), "to keep changes nothing"


def test_numbers_that_steps_have_changed_as_they_began_are_taken_back():
    stage = Stage()
    stage.execute("0: (pick r1 b1 home) [3]\n0: (move r2 yard shop) [5]", wanted="holding r1 b1; at r2 shop")
    stage.until(1)
    assert stage.holds("load r1 = 1")
    kept = stage.plan_executor.beliefs_if_aborted()
    assert n("load", "r1", value=0) in kept
    assert p("at", "r2", "yard") in kept
    stage.run(lambda: stage.plan_executor.abort("to compare"))
    assert kept == stage.facts.facts()


@pytest.mark.parametrize("content", ["", "{", "[]", '{"schema": "socialbot/Kept/9"}', '{"schema": "socialbot/Kept/1"}'])
def test_a_damaged_file_is_an_error_that_names_it(path, content):
    path.parent.mkdir()
    path.write_text(content)
    with pytest.raises(PlanningError, match="invalid mind file") as error:
        restore_mind(Office().deliberator, path)
    assert error.value.where == str(path)
    assert "delete the file" in str(error.value.remedy)


def test_the_saved_rollback_deletes_before_it_adds():
    stage = Stage()
    stage.execute(
        "0: (move r2 yard shop) [5]",
        wanted="at r2 shop",
        rollback_belief_del=tuple(facts("open *")),
        rollback_belief_add=tuple(facts("open home")),
    )
    stage.until(1)
    kept = stage.plan_executor.beliefs_if_aborted()
    stage.run(lambda: stage.plan_executor.abort("to compare"))
    assert p("open", "home") in kept
    assert kept == stage.facts.facts()


def test_the_mind_of_an_agent_with_another_domain_is_refused(path):
    save_mind(Office().deliberator, path)
    other = Office(beliefs="", domain=WORKSHOP)
    with pytest.raises(PlanningError, match="domain jobs"):
        restore_mind(other.deliberator, path)


def test_a_mind_that_does_not_fit_the_domain_any_more_is_refused_as_a_whole(path):
    office = Office()
    office.believe("lit; quiet")
    save_mind(office.deliberator, path)
    changed = read_domain(JOBS.text.replace("(quiet)", "(silent)"), where="jobs")
    other = Office(beliefs="", domain=changed)
    with pytest.raises(PlanningError, match="there is no predicate 'quiet'"):
        restore_mind(other.deliberator, path)
    assert other.facts.facts() == ()


def test_the_file_is_the_old_one_until_it_is_the_new_one(path, monkeypatch):
    office = Office()
    save_mind(office.deliberator, path)
    before = path.read_text()
    office.believe("lit")

    def fail(*names):
        raise OSError("no space left")

    monkeypatch.setattr("pathlib.Path.replace", fail)
    with pytest.raises(OSError, match="no space"):
        save_mind(office.deliberator, path)
    assert path.read_text() == before
    assert json.loads(before)["domain"] == "jobs"


@pytest.mark.parametrize("content", [b'{"schema": "\xff"}', b'{"a":' * 10_000, b""])
def test_a_file_that_holds_no_mind_is_refused(path, content):
    path.parent.mkdir()
    path.write_bytes(content)
    with pytest.raises(PlanningError, match="invalid mind file"):
        restore_mind(Office(beliefs="").deliberator, path)
