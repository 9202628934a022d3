"""The account of where time goes in a mission on ROS, and one such mission."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.hospital_record import Share
from evaluation.hospital_ros import Account, Notes, Said, Seen, Work, length, name_of, run_ros, union, without
from socialbot.agents.teams.messages import AclMessage, ActionCommand, ActionResult, Belief, Problem
from socialbot.core.errors import NodeError

MS = 1_000_000
SPOT, NURSE, ROOM = "spotrobot1", "nurse_disinfected1", "room1"
PATROL = ("a_patrol_room", (SPOT, ROOM))
ADAPT = ("a_adapt_room", (NURSE, ROOM))

FAILED = ActionResult(
    stamp=1999 * MS, id="1", robot=SPOT, action=PATROL[0], args=PATROL[1], outcome="failure", reason="dirty room",
    duration_s=0.06,
)  # fmt: skip
DONE = ActionResult(
    stamp=2113 * MS, id="2", robot=NURSE, action=ADAPT[0], args=ADAPT[1], outcome="success", duration_s=0.1
)
COMMAND = ActionCommand(stamp=2011 * MS, id="2", robot=NURSE, action=ADAPT[0], args=ADAPT[1])


def said(id: str, sender: str, receiver: str, content: Problem | Belief) -> AclMessage:
    return AclMessage(stamp=0, id=id, sender=sender, receiver=receiver, performative="inform", content=content)


PROBLEM = said("p", SPOT, "coordinator", Problem("dirty room", PATROL[1], PATROL[0]))
TRIGGER = said("t", "coordinator", NURSE, Belief("initial_trigger"))


def work(begun: float, ended: float, taken: str = "", plans: int = 0) -> Work:
    return Work(round(begun * MS), round(ended * MS), taken, plans)


def account() -> Account:
    """A patrol fails and is reported, the coordinator replans, the nurse tidies the room."""
    notes = {
        "world": Notes(
            works=[work(2000, 2000.5), work(2013, 2013.5, name_of(COMMAND)), work(2114, 2115)],
            said=[Said(2000 * MS, name_of(FAILED)), Said(2114 * MS, name_of(DONE))],
        ),
        SPOT: Notes(works=[work(2001, 2003, name_of(FAILED))], said=[Said(2002 * MS, name_of(PROBLEM))]),
        "coordinator": Notes(
            works=[work(1100, 1110, plans=1), work(1200, 1201, plans=1), work(2004, 2010, name_of(PROBLEM), plans=2)],
            said=[Said(2008 * MS, name_of(TRIGGER))],
        ),
        NURSE: Notes(
            works=[work(2009, 2012, name_of(TRIGGER)), work(2116, 2117, name_of(DONE))],
            said=[Said(2011 * MS, name_of(COMMAND))],
        ),
    }
    return Account(notes, Seen(said=[PROBLEM, TRIGGER], commands=[COMMAND], results=[FAILED, DONE]))


def ms(share: Share) -> tuple[float, ...]:
    seconds = share.reasoning_s, share.planning_s, share.communication_s, share.acting_s
    return tuple(round(1000 * each, 3) for each in seconds)


def test_a_recovery_goes_from_the_failed_result_to_the_first_command_of_the_new_plan():
    (recovery,) = account().recoveries()
    assert ms(recovery) == (2 + 2, 6, 3, 0)


def test_results_of_another_hospital_in_the_domain_are_an_error():
    notes = {name: Notes() for name in ("world", "coordinator")}
    with pytest.raises(NodeError, match="without a message of the ward"):
        list(Account(notes, Seen(results=[FAILED])).recoveries())


def test_time_with_an_action_counts_as_acting():
    assert ms(account().share(0, 1105 * MS)) == (0, 5, 0, 1000)
    assert ms(account().share(1939 * MS, 1999 * MS)) == (0, 0, 0, 60)


def test_remaining_time_belongs_to_no_category():
    late = account().share(2113 * MS, 2117 * MS)
    assert ms(late) == (1, 0, 2, 0), "the ward ends the action 1 ms late"


def test_a_joint_action_begins_when_the_last_partner_is_there():
    together = [
        ActionResult(
            stamp=3000 * MS, id=robot, robot=robot, action="a_authorize_patrol", args=(SPOT, NURSE), outcome="success",
            duration_s=duration_s,
        )
        for robot, duration_s in ((SPOT, 0.9), (NURSE, 0.04))
    ]  # fmt: skip
    empty = {name: Notes() for name in ("world", "coordinator")}
    assert ms(Account(empty, Seen(results=together)).share(2000 * MS, 3000 * MS)) == (0, 0, 0, 40)


SPANS = st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)).map(lambda pair: (min(pair), max(pair))))


@given(SPANS, SPANS)
def test_spans_are_like_sets_of_moments(first: list[tuple[int, int]], second: list[tuple[int, int]]):
    def moments(spans: list[tuple[int, int]]) -> set[int]:
        return {moment for begin, end in spans for moment in range(begin, end)}

    left = without(union(first), union(second))
    assert moments(left) == moments(first) - moments(second)
    assert length(left) == len(moments(left))


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.xdist_group("hospital over DDS")
def test_a_mission_on_ros_is_recorded(tmp_path: Path):
    record = run_ros("bdi+recovery", 100.0, 0, tmp_path)
    assert (record.runner, record.drawn, record.met, record.completed) == ("ros", True, True, True)
    assert (record.recoveries, record.plans, len(record.recovered)) == (1, 2, 1)
    share = record.share
    known_s = share.reasoning_s + share.planning_s + share.communication_s + share.acting_s
    assert 4.4 < share.acting_s < known_s <= record.mission_s < record.wall_s
    assert record.recovered[0].planning_s > 0.0
