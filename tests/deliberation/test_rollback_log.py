"""Changes of a failed step are undone unless another source changed the same fact later."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from socialbot.deliberation._action_executor import RollbackLog
from socialbot.planning.pddl.formulas import Fluent, Predicate
from tests.deliberation.stage import Stage, fact

LOAD, PAINT = Fluent("load", ("r1",)), Fluent("paint", ())
OPEN = Predicate("open", ("home",))


def start() -> tuple[Stage, RollbackLog]:
    stage = Stage()
    return stage, RollbackLog(stage.facts)


def test_all_that_an_owner_has_changed_is_taken_back():
    stage, rollback_log = start()
    before = stage.facts.facts()
    rollback_log.apply("a", {Predicate("at", ("r1", "home")): False, OPEN: True, PAINT: 7.0}, "")
    rollback_log.apply("a", {PAINT: 9.0}, "")
    assert stage.facts.facts() != before
    rollback_log.undo("a", "")
    assert stage.facts.facts() == before


def test_unchanged_facts_are_not_rolled_back():
    stage, rollback_log = start()
    stage.facts.add(fact("open home"))
    rollback_log.apply("a", {OPEN: True, Predicate("lit"): False}, "")
    rollback_log.undo("a", "")
    assert stage.holds("open home")
    assert not stage.holds("lit")


def test_a_number_that_had_no_value_has_none_again():
    stage, rollback_log = start()
    stage.facts.remove(fact("paint = 0"))
    rollback_log.apply("a", {PAINT: 7.0}, "")
    rollback_log.undo("a", "")
    assert stage.facts.value(PAINT) is None


def test_closed_changes_are_not_rolled_back():
    stage, rollback_log = start()
    rollback_log.apply("a", {OPEN: True}, "")
    rollback_log.close("a")
    rollback_log.undo("a", "")
    assert stage.holds("open home")


def test_later_changes_of_another_owner_are_kept():
    stage, rollback_log = start()
    rollback_log.apply("a", {PAINT: 7.0, OPEN: True}, "")
    rollback_log.apply("b", {PAINT: 8.0, OPEN: False}, "")
    rollback_log.undo("a", "")
    assert stage.holds("paint = 8")
    assert not stage.holds("open home")
    rollback_log.undo("b", "")
    assert stage.holds("paint = 7")
    assert stage.holds("open home")


def test_a_repeated_change_belongs_to_the_first_owner():
    stage, rollback_log = start()
    rollback_log.apply("a", {OPEN: True}, "")
    rollback_log.apply("b", {OPEN: True}, "")
    rollback_log.undo("b", "")
    assert stage.holds("open home")


def test_external_changes_are_kept():
    stage, rollback_log = start()
    rollback_log.apply("a", {OPEN: True, LOAD: 1.0}, "")
    stage.forget("open home")
    stage.believe("load r1 = 5")
    rollback_log.undo("a", "")
    assert not stage.holds("open home")
    assert stage.holds("load r1 = 5")


@given(
    st.permutations("abcd"),
    st.lists(st.sampled_from([-2.0, -1.0, 1.0, 3.0]), min_size=4, max_size=4),
    st.sets(st.sampled_from("abcd")),
)
def test_of_increases_each_is_taken_back_alone(order, amounts, kept):
    stage, rollback_log = start()
    by = dict(zip("abcd", amounts, strict=True))
    for owner in "abcd":
        rollback_log.apply(owner, {LOAD: (stage.facts.value(LOAD) or 0.0) + by[owner]}, "", {LOAD})
    for owner in order:
        (rollback_log.close if owner in kept else lambda owner: rollback_log.undo(owner, ""))(owner)
    assert stage.facts.value(LOAD) == sum(by[owner] for owner in kept)


def test_the_trace_says_why():
    stage, rollback_log = start()
    rollback_log.apply("a", {OPEN: True}, "step-1")
    rollback_log.undo("a", "end-1")
    assert stage.trace.find("belief", "open(home)")[0].cause == "step-1"
    assert stage.trace.find("unbelief", "open(home)")[0].cause == "end-1"
