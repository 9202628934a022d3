from __future__ import annotations

from typing import Any

import msgspec
import pytest

from socialbot.core.errors import ParameterError
from socialbot.deliberation.messages import AgentReply, AgentRequest, Desire, Fact, FactCondition
from socialbot.deliberation.requests import Permission, Policies, RequestServer
from tests.deliberation.domains import dnf, i, n, p
from tests.deliberation.office import Office, job

ALL = Policies(
    belief_ck=("friends", "readers"),
    belief_w=("friends",),
    desire_ck=("friends", "readers"),
    desire_w=("friends", "late"),
    desire_pr=(0.6,),
)
READY = dnf([("T", p("ready"))])


class Desk:
    """Test bench of a request server."""

    def __init__(self, **more) -> None:
        self.office = Office(**more)
        self.replies: list[AgentReply] = []
        self.reception = RequestServer(self.office.deliberator, ALL, self.replies.append)
        self.count = 0

    def ask(self, operation, about: Fact | Desire, group="friends", receiver="clerk", **more) -> AgentReply | None:
        self.count += 1
        what = {"belief": about} if isinstance(about, Fact) else {"desire": about}
        known = {"id": f"r-{self.count}", "sender": "boss", "group": group, "receiver": receiver}
        return self.send(AgentRequest(stamp=0, operation=operation, **{**known, **what, **more}))

    def send(self, request: AgentRequest) -> AgentReply | None:
        before = len(self.replies)
        self.office.run(lambda: self.reception.handle(request))
        return self.replies[before] if len(self.replies) > before else None


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_beliefs_are_checked_added_and_deleted(desk):
    assert not desk.ask("check", p("lit")).found
    assert desk.ask("add", p("lit")).accepted
    assert desk.ask("check", p("lit"), group="readers").found
    assert desk.ask("add", n("level", "a", value=3)).accepted
    assert desk.ask("check", n("level", "a", value=3)).found
    assert not desk.ask("check", n("level", "a", value=4)).found
    assert desk.ask("check", i("a", "job")).found
    assert desk.ask("del", p("lit")).accepted
    assert not desk.ask("check", p("lit")).found


def test_a_belief_keeps_its_sender_and_the_request_id(desk):
    reply = desk.ask("add", p("lit"))
    (asked,) = desk.office.found("asked")
    (belief,) = desk.office.found("belief", "lit")
    assert asked.cause == belief.cause == reply.id
    assert belief.detail["source"] == "boss"


@pytest.mark.parametrize(
    ("operation", "about", "group", "why"),
    [
        ("add", p("lit"), "readers", "group 'readers' may not add beliefs; these may: friends"),
        ("del", p("lit"), "late", "may not delete beliefs"),
        ("check", p("lit"), "strangers", "may not check beliefs"),
        ("add", job("a"), "readers", "may not add desires"),
        ("check", job("a"), "late", "may not check desires"),
        ("add", p("raedy"), "friends", "there is no predicate 'raedy'"),
        ("check", p("level", "a"), "friends", "is a function"),
        ("add", job("a", value=(p("raedy"),)), "friends", "there is no predicate 'raedy'"),
        ("add", job("a", value=()), "friends", "it wants nothing"),
    ],
)
def test_forbidden_and_invalid_requests_are_refused_on_the_trace(desk, operation, about, group, why):
    reply = desk.ask(operation, about, group)
    assert (reply.accepted, reply.state) == (False, "refused")
    assert why in reply.reason
    (record,) = desk.office.found("refused")
    assert (record.cause, record.detail["reason"]) == (reply.id, reply.reason)
    assert p("lit") not in desk.office.facts.facts()
    assert desk.office.wants == []


@pytest.mark.parametrize("name", ["self", "percept"])
def test_nobody_speaks_as_the_agent_itself_or_as_its_percepts(desk, name):
    reply = desk.ask("add", p("lit"), sender=name)
    assert (reply.accepted, reply.reason) == (False, f"no agent can be named {name}")
    assert not desk.ask("check", p("lit")).found


def test_a_request_has_to_name_one_thing(desk):
    for what in ({}, {"belief": p("lit"), "desire": job("a")}):
        request = AgentRequest(
            stamp=0, id=f"r{len(what)}", sender="boss", group="friends", receiver="clerk", operation="add", **what
        )
        assert "has to name" in desk.send(request).reason


def test_requests_for_other_agents_are_left_alone(desk):
    assert desk.ask("add", p("lit"), receiver="somebody") is None
    assert desk.office.found("asked") == []


def test_a_desire_is_adopted_with_a_priority_that_its_group_may_give(desk):
    reply = desk.ask("add", job("a", 0.9))
    assert (reply.accepted, reply.priority) == (True, 0.6)
    assert next(iter(desk.office.deliberator.desires)).desire.priority == 0.6
    assert desk.ask("add", job("b", 0.2)).priority == 0.2
    assert desk.ask("add", job("c", 0.9), group="late").priority == 0.0
    assert desk.office.found("desire", "a")[0].cause == reply.id
    assert desk.ask("check", job("b")).found
    assert not desk.ask("check", job("d")).found


def test_a_desire_is_deleted_by_its_name(desk):
    desk.ask("add", job("a"))
    assert desk.ask("del", job("a")).found
    assert not desk.ask("del", job("a")).found
    assert desk.office.found("desire_dropped", "a")[0].detail["reason"] == "boss asked for it"


REQUEST = AgentRequest(
    stamp=0,
    id="r",
    sender="boss",
    group="friends",
    receiver="clerk",
    operation="add",
    desire=job("a"),
    monitor=True,
)


def test_a_request_that_comes_twice_is_carried_out_once_and_answered_twice(desk):
    first = desk.send(REQUEST)
    desk.office.run(lambda: desk.office.deliberator.drop("a"))
    ended = desk.replies[-1]
    assert (ended.state, ended.id) == ("dropped", "r")
    assert desk.send(REQUEST) == ended, "what has become of it"
    assert desk.office.wants == []
    assert first.state == "done"
    assert len(desk.office.found("asked")) == 1
    other = desk.send(msgspec.structs.replace(REQUEST, sender="other"))
    assert other.state == "done", "another sender's request of the same id is another one"


def test_a_restarted_receiver_answers_a_repeated_request(desk):
    desk.send(REQUEST)
    anew: Any = Desk()
    assert anew.send(REQUEST).state == "done"
    assert anew.office.wants == ["a"]
    done: Any = Desk()
    done.office.believe("done a")
    assert done.send(REQUEST).state == "fulfilled"
    kept: Any = Desk()
    kept.office.want(job("a", 0.2))
    assert kept.send(REQUEST).state == "done"
    kept.office.until(20)
    assert kept.replies[-1].state == "fulfilled"


def test_a_repeated_desire_takes_the_new_priority_and_deadline(desk):
    assert desk.ask("add", job("a", 0.2, 50)).priority == 0.2
    desk.office.want(job("c", 0.3))
    assert desk.ask("add", job("a", 0.9, 5)).priority == 0.6, "not more than it may give"
    state = desk.office.deliberator.desires.get("a")
    assert (state.desire.priority, state.desire.deadline) == (0.6, 5)
    assert desk.office.wants == ["a", "c"]


def test_a_negated_condition_about_an_unknown_object_is_not_fulfilled(desk):
    typo = job("typo", value=(), conditions=(FactCondition(check="F", condition_to_check=p("done", "aa")),))
    assert desk.ask("add", typo, monitor=True).state == "done"
    desk.office.until(40)
    assert desk.replies[-1].state == "dropped"
    assert "there is no object 'aa'" in desk.replies[-1].reason


def test_a_deletion_reports_whether_the_belief_was_held(desk):
    desk.office.believe("lit")
    assert desk.ask("del", p("lit")).found
    reply = desk.ask("del", p("lit"))
    assert (reply.accepted, reply.found) == (True, False)


@pytest.mark.parametrize("deadline", [float("inf"), float("nan"), 1e300, -1.0])
def test_a_deadline_out_of_range_is_refused(desk, deadline):
    assert "the deadline" in desk.ask("add", job("a", deadline=deadline)).reason


def test_the_end_of_a_monitored_desire_is_reported(desk):
    desk.ask("add", job("a"), monitor=True)
    desk.ask("add", job("b"))
    desk.office.until(20)
    done, ended = [reply for reply in desk.replies if reply.id == "r-1"]
    assert (done.state, ended.state, ended.found) == ("done", "fulfilled", True)
    assert [reply.state for reply in desk.replies if reply.id == "r-2"] == ["done"]


def test_the_failure_of_a_monitored_desire_is_reported_with_its_reason():
    desk = Desk(comp_plan_tries=1)
    desk.ask("add", job("a", deadline=1.0), monitor=True)
    desk.office.until(20)
    done, ended = desk.replies
    assert (done.state, ended.state, ended.found) == ("done", "dropped", False)
    assert "longer than the 1 s there are" in ended.reason


def test_a_desire_that_holds_already_is_fulfilled_at_once(desk):
    desk.office.believe("done a")
    reply = desk.ask("add", job("a"), monitor=True)
    assert (reply.state, reply.accepted, reply.found) == ("fulfilled", True, True)
    assert len(desk.replies) == 1


def test_another_desire_of_the_same_name_is_refused(desk):
    desk.ask("add", job("a"))
    reply = desk.ask("add", job("a", value=(p("lit"),)))
    assert (reply.accepted, reply.reason) == (False, "another desire has the name a")


def test_an_unsent_answer_does_not_stop_the_agent():
    desk = Desk()
    desk.reception = RequestServer(desk.office.deliberator, ALL, lambda reply: 1 / 0)
    desk.ask("add", job("a"), monitor=True)
    desk.office.want(job("b"))
    desk.office.until(20)
    assert ("b", "fulfilled", "") in desk.office.ends
    assert desk.office.wants == []


BOOK = Policies.parse(
    belief_ck="grippers, guests",
    belief_w="grippers",
    desire_ck="grippers",
    desire_w="grippers, bosses, guests",
    desire_pr="0.6, 1",
)


def request(group, operation, *, desire=False):
    return AgentRequest(
        stamp=0,
        id="1",
        sender="gripper_a",
        group=group,
        receiver="carrier_a",
        operation=operation,
        belief=None if desire else p("loaded"),
        desire=Desire(name="go", priority=0.9) if desire else None,
    )


def test_a_group_that_is_listed_may():
    assert BOOK.may(request("grippers", "check")) == Permission(True)
    assert BOOK.may(request("grippers", "add")) == BOOK.may(request("grippers", "del")) == Permission(True)
    assert BOOK.may(request("guests", "check")).granted
    assert BOOK.may(request("grippers", "check", desire=True)) == Permission(True)


@pytest.mark.parametrize(
    ("group", "operation", "desire", "reason"),
    [
        ("guests", "add", False, "group 'guests' may not add beliefs; these may: grippers"),
        ("guests", "del", False, "group 'guests' may not delete beliefs; these may: grippers"),
        ("strangers", "check", True, "group 'strangers' may not check desires; these may: grippers"),
        ("strangers", "add", True, "group 'strangers' may not add desires; these may: grippers, bosses, guests"),
        ("", "check", False, "group '' may not check beliefs; these may: grippers, guests"),
    ],
)
def test_others_are_refused_with_the_reason(group, operation, desire, reason):
    assert BOOK.may(request(group, operation, desire=desire)) == Permission(False, reason)


def test_an_agent_without_policies_refuses_all_groups():
    assert Policies().may(request("grippers", "add", desire=True)).reason.endswith("no group may")


@pytest.mark.parametrize(("group", "most"), [("grippers", 0.6), ("bosses", 1.0), ("guests", 0.0)])
def test_each_group_that_may_write_desires_has_its_highest_priority(group, most):
    assert BOOK.may(request(group, "add", desire=True)).max_priority == most


@pytest.mark.parametrize("priorities", ["high", "1.5", "-0.1", "nan", "0.5, 0.6"])
def test_priorities_that_make_no_sense_are_refused(priorities):
    with pytest.raises(ParameterError, match="desire_pr") as caught:
        Policies.parse(desire_w="grippers", desire_pr=priorities, where="carrier_a")
    assert caught.value.where == "carrier_a"


def test_a_bid_is_the_time_of_the_plan_and_changes_nothing(desk):
    reply = desk.ask("bid", job("a"))
    assert (reply.accepted, reply.found, reply.bid) == (True, True, 6.0)
    assert desk.office.wants == []


def test_a_bid_counts_the_rest_of_the_plan_and_the_desires_before_it(desk):
    desk.ask("add", job("a", priority=0.6))
    desk.office.until(2)
    desk.ask("add", job("b", priority=0.6))
    assert desk.ask("bid", job("c", priority=0.5)).bid == pytest.approx(4 + 6 + 6, abs=0.1)


def test_a_bid_leaves_out_less_urgent_desires(desk):
    desk.ask("add", job("a", priority=0.6))
    desk.office.until(2)
    desk.ask("add", job("b", priority=0.3))
    assert desk.ask("bid", job("c", priority=0.5)).bid == pytest.approx(4 + 6, abs=0.1)


def test_a_bid_counts_at_most_the_priority_that_the_group_may_give(desk):
    desk.ask("add", job("a", priority=0.6))
    desk.office.until(2)
    desk.ask("add", job("b", priority=0.6))
    assert desk.ask("bid", job("c", priority=0.9)).bid == pytest.approx(4 + 6 + 6, abs=0.1)


def test_a_bid_for_a_desire_that_preempts_does_not_wait_for_the_plan():
    desk = Desk(reschedule_policy="PREEMPT")
    desk.ask("add", job("a", priority=0.4))
    desk.office.until(2)
    reply = desk.ask("bid", job("c", priority=0.6))
    assert reply is not None
    assert reply.bid == pytest.approx(6, abs=0.1)


@pytest.mark.parametrize(
    ("about", "group", "accepted", "why"),
    [
        (job("a"), "readers", False, "group 'readers' may not bid for desires; these may: friends, late"),
        (job("a", value=(p("raedy"),)), "friends", False, "there is no predicate 'raedy'"),
        (job("a", deadline=5.0), "friends", True, "the plan lasts 6 s, longer than the 5 s there are"),
        (job("a", value=(p("told"),)), "friends", True, "nothing brings about (told)"),
        (job("a", value=(p("done", "z"),)), "friends", True, "there is no object 'z'"),
        (job("a", precondition=READY), "friends", True, "its precondition or context does not hold"),
        (job("a", context=READY), "friends", True, "its precondition or context does not hold"),
        (p("lit"), "friends", False, "only a desire can be offered"),
    ],
)
def test_no_bid_for_what_is_forbidden_or_impossible(desk, about, group, accepted, why):
    reply = desk.ask("bid", about, group)
    assert (reply.accepted, reply.bid) == (accepted, None)
    assert why in reply.reason


def test_a_bid_for_a_fulfilled_desire_is_zero(desk):
    desk.ask("add", p("done", "a"))
    assert desk.ask("bid", job("a")).bid == 0.0
