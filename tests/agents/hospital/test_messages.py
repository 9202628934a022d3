from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.teams.actions import Meeting, Rendezvous
from socialbot.agents.teams.messages import AclMessage, AclSender, Done, Ready, Refusal
from socialbot.core.clock import ManualClock

MEETING = Meeting("mission_1_1", "a_authenticate_nurse", ("spotrobot1", "nurse1"))


class Post:
    """Agents whose messages wait for delivery, those of one sender in their order."""

    def __init__(self, *names: str) -> None:
        self.waiting: dict[str, list[AclMessage]] = {name: [] for name in names}
        self.met: list[str] = []
        self.agents = {name: Rendezvous(AclSender(name, ManualClock(), self.post)) for name in names}

    def post(self, message: AclMessage) -> None:
        self.waiting[message.sender].append(message)

    def arrive(self, name: str, meeting: Meeting = MEETING) -> None:
        partners = [other for other in self.agents if other != name]
        self.agents[name].arrive(meeting, partners, lambda: self.met.append(name))

    def bring(self, sender: str) -> None:
        for message in self.waiting[sender][:1]:
            self.waiting[sender].remove(message)
            content, agent = message.content, self.agents[message.receiver]
            assert isinstance(content, (Ready, Done))
            process = agent.partner_ready if isinstance(content, Ready) else agent.partner_done
            process(sender, Meeting(message.mission, content.action, content.args))

    def bring_all(self) -> None:
        while sender := next((name for name, messages in self.waiting.items() if messages), None):
            self.bring(sender)


def test_first_partner_waits_and_second_answers():
    post = Post("spot", "nurse")
    post.arrive("spot")
    post.bring_all()
    assert post.met == []
    post.arrive("nurse")
    assert post.met == ["nurse"]
    (answer,) = post.waiting["nurse"]
    assert (answer.receiver, answer.content, answer.mission) == ("spot", Done(*MEETING[1:]), MEETING.label)
    post.bring_all()
    assert post.met == ["nurse", "spot"]


def test_simultaneous_partners_meet_once():
    post = Post("spot", "nurse")
    post.arrive("spot")
    post.arrive("nurse")
    post.bring_all()
    assert sorted(post.met) == ["nurse", "spot"]


def test_different_joint_actions_do_not_meet():
    post = Post("spot", "nurse")
    post.arrive("spot")
    post.arrive("nurse", MEETING._replace(action="a_authorize_patrol"))
    post.bring_all()
    assert post.met == []


def test_partner_that_left_is_awaited_again():
    post = Post("spot", "nurse")
    post.arrive("nurse")
    post.agents["nurse"].leave(MEETING)
    post.agents["nurse"].partner_done("spot", MEETING)
    assert post.met == []


def test_announcements_for_other_plans_are_forgotten():
    post = Post("spot", "nurse")
    post.arrive("spot")
    post.bring_all()
    post.agents["nurse"].forget("mission_1_2")
    post.arrive("nurse")
    assert post.met == []


@pytest.mark.parametrize("order", list(itertools.permutations(["spot", "nurse", "uvd"])))
def test_three_partners_start_together(order):
    post = Post("spot", "nurse", "uvd")
    for name in order:
        assert post.met == []
        post.arrive(name)
        post.bring_all()
    assert sorted(post.met) == ["nurse", "spot", "uvd"]


@given(st.lists(st.sampled_from(["spot", "nurse", "uvd"])), st.permutations(["spot", "nurse", "uvd"]))
def test_partners_meet_with_any_delays_and_not_early(delays, order):
    post = Post("spot", "nurse", "uvd")
    for name, sender in itertools.zip_longest(order, delays):
        if name:
            assert post.met == []
            post.arrive(name)
        if sender:
            post.bring(sender)
    post.bring_all()
    assert sorted(post.met) == ["nurse", "spot", "uvd"]


def test_speech_act_has_sender_time_mission_and_reply_id():
    said: list[AclMessage] = []
    AclSender("spotrobot1", ManualClock(5), said.append).send(
        "coordinator", "refuse", Refusal("no"), "mission_1_1", "c-7"
    )
    (message,) = said
    assert (message.sender, message.receiver, message.performative) == ("spotrobot1", "coordinator", "refuse")
    assert (message.stamp, message.mission, message.in_reply_to) == (5, "mission_1_1", "c-7")
    assert message.content == Refusal("no")


def test_ids_are_unique_over_restarts():
    clock = ManualClock(5)
    said: list[AclMessage] = []
    for _ in range(2):
        acl = AclSender("spotrobot1", clock, said.append)
        for _ in range(3):
            acl.send("coordinator", "inform", Refusal(""))
        clock.advance(1)
    assert len({message.id for message in said}) == 6
