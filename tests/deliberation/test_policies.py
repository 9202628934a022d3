"""Who may ask for what."""

from __future__ import annotations

import pytest

from socialbot.core.errors import ParameterError
from socialbot.deliberation.messages import AgentRequest, Desire
from socialbot.deliberation.requests import Permission, Policies
from tests.deliberation.domains import p

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
    assert Policies().may(request("grippers", "add", desire=True)).reason.endswith("nobody may")


@pytest.mark.parametrize(("group", "most"), [("grippers", 0.6), ("bosses", 1.0), ("guests", 0.0)])
def test_each_group_that_may_write_desires_has_its_highest_priority(group, most):
    assert BOOK.may(request(group, "add", desire=True)).max_priority == most


@pytest.mark.parametrize("priorities", ["high", "1.5", "-0.1", "nan", "0.5, 0.6"])
def test_priorities_that_make_no_sense_are_refused(priorities):
    with pytest.raises(ParameterError, match="desire_pr") as caught:
        Policies.parse(desire_w="grippers", desire_pr=priorities, where="carrier_a")
    assert caught.value.where == "carrier_a"
