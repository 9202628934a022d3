"""Watching beliefs, and attempting goals, from outside of plans."""

# ruff: noqa: N801 - beliefs, goals and actions are written as in AgentSpeak

from __future__ import annotations

import pytest

from socialbot.bdi import Atom, Belief, Engine, Goal, LongAction, SingletonBelief, Trace, variables
from socialbot.bdi.saving import restore, save
from socialbot.core.clock import ManualClock
from socialbot.deliberation.facts import FactBase
from socialbot.testing import run_engine
from tests.deliberation.domains import YARD, i, n, p

X, Y = variables("X Y")


class at(Belief): ...


class mood(SingletonBelief): ...


class go(Goal): ...


class walk(LongAction):
    def start(self, place):
        self.engine.robot.append(f"walks to {place}")
        self.engine.timers.after(5, self.done)

    def cancel(self):
        self.engine.robot.append("slows down")
        self.engine.timers.after(1, self.cancelled)


@pytest.fixture
def engine():
    return Engine("walker", ManualClock(), robot=[], sink=Trace())


@pytest.fixture
def seen(engine):
    changes = []
    for key in ("at/1", "mood/1"):
        engine.beliefs.watch(key, lambda args, held, cause: changes.append((args, held)))
    return changes


def test_a_watcher_is_notified_of_addition_and_deletion(engine, seen):
    engine.believe(at("home"))
    engine.believe(at("home"))
    engine.forget(at(X))
    engine.run_until_idle()
    assert seen == [(("home",), True), (("home",), False)]


def test_a_watcher_is_notified_of_changes_by_plans(engine, seen):
    engine.add_rules(+at("home") >> [-at("home"), +at("garden")])
    engine.believe(at("home"))
    engine.run_until_idle()
    assert seen == [(("home",), True), (("home",), False), (("garden",), True)]


def test_a_watcher_is_notified_of_replaced_beliefs(engine, seen):
    engine.add_text("at(gate). !go. +!go <- -+at(street).")
    engine.run_until_idle()
    gate, street = (Atom("gate"),), (Atom("street"),)
    assert seen == [(gate, True), (gate, False), (street, True)]


def test_a_watcher_is_notified_of_a_replacement_as_one_change(engine, seen):
    engine.believe(mood("good"))
    engine.believe(mood("bad"))
    engine.run_until_idle()
    assert seen == [(("good",), True), (("good",), False), (("bad",), True)]


def test_a_belief_that_one_source_still_holds_has_not_ended(engine, seen):
    engine.believe(at("home"))
    engine.believe(at("home"), source="bob")
    engine.add_text('+forget(bob) <- -at("home")[source(bob)].')
    engine.add_text("forget(bob).")
    engine.run_until_idle()
    assert seen == [(("home",), True)]


def test_the_cause_is_the_record_of_the_change(engine):
    causes = []
    engine.beliefs.watch("at/1", lambda args, held, cause: causes.append(cause))
    engine.believe(at("home"), cause="camera")
    engine.run_until_idle()
    (record,) = engine.trace.sink.find("belief")
    assert causes == [record.id]


def test_failing_watcher_does_not_stop_others(engine, seen):
    def fail(args, held, cause):
        raise ValueError("no eyes")

    engine.beliefs.watch("at/1", fail)
    engine.add_rules(+at(X) >> [go()])
    engine.believe(at("home"))
    engine.run_until_idle()
    assert seen
    assert "no eyes" in [record.detail.get("message") for record in engine.trace.sink.find("failure")]
    assert engine.trace.sink.find("goal", "go")


def test_watched_beliefs_raise_events(engine, seen):
    engine.add_rules(+at(X) >> [+mood(X)], +at("home").held_for(2) >> [+mood("bored")])
    engine.believe(at("home"))
    run_engine(engine, 3)
    assert sorted(str(held.belief) for held in engine.beliefs) == ['at("home")', 'mood("bored")']


def test_attempt_reports_its_end(engine):
    ends = []
    engine.add_rules(go(X) >> [walk(X)])
    engine.call(lambda: engine.attempt(go("home"), ends.append, cause="me"))
    run_engine(engine, 4)
    assert ends == []
    run_engine(engine, 2)
    assert ends == [None]
    assert engine.trace.sink.find("goal")[0].cause == "me"


def test_an_attempt_without_a_plan_fails(engine):
    ends = []
    engine.call(lambda: engine.attempt(go("home"), ends.append))
    engine.run_until_idle()
    assert ends[0].reason == "no_relevant"


def test_dropped_attempt_reports_when_its_action_has_stopped(engine):
    ends, begun = [], []
    engine.add_rules(go(X) >> [walk(X)])
    engine.call(lambda: begun.append(engine.attempt(go("home"), ends.append)))
    run_engine(engine, 1)
    stopped = []
    engine.call(lambda: engine.intentions.drop(begun[0], lambda: stopped.append(engine.clock.now())))
    run_engine(engine, 0.5)
    assert (stopped, engine.robot) == ([], ["walks to home", "slows down"])
    run_engine(engine, 1)
    assert stopped == [2_000_000_000]
    assert ends[0].reason == "cancelled"


def test_watchers_are_called_for_a_restored_mind(engine, seen):
    engine.believe(at("home"))
    engine.run_until_idle()
    saved = save(engine)
    engine.forget(at("home"))
    engine.believe(at("shop"))
    engine.believe(mood("glad"))
    engine.run_until_idle()
    seen.clear()
    restore(engine, saved)
    assert seen == [(("shop",), False), (("glad",), False), (("home",), True)]
    assert [str(held.belief) for held in engine.beliefs] == ['at("home")']


def test_facts_follow_a_restored_mind():
    clock = ManualClock()
    facts = FactBase(Engine("yard", clock), YARD)
    for fact in (i("box_a", "box"), p("in", "box_a", "base_1"), n("stacked", "base_1", value=1)):
        facts.add(fact)
    held, saved = facts.facts(), save(facts.engine)
    other = FactBase(Engine("yard", clock), YARD)
    other.add(p("in", "box_b", "base_2"))
    restore(other.engine, saved)
    assert other.facts() == held
