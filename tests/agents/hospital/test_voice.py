"""What is said has an id of its own, and says what it answers."""

from __future__ import annotations

from socialbot.agents.hospital.messages import AclMessage, AclSender, Refusal
from socialbot.core.clock import ManualClock


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
