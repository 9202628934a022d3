"""The line between a process and its supervisor."""

from __future__ import annotations

import os

from socialbot.runtime.supervisor_channel import CHANNEL_VARIABLE, SupervisorChannel, channel_pair, own_channel


def test_what_is_said_is_heard_word_by_word():
    ours, end = channel_pair()
    theirs = SupervisorChannel(end)
    assert ours.receive() == []
    theirs.send("head", "starting")
    theirs.send("head", "active")
    assert ours.receive() == [("head", "starting"), ("head", "active")]
    ours.send("head", "deactivate")
    assert theirs.wait() == ("head", "deactivate")
    ours.close()
    theirs.close()


def test_the_line_is_broken_when_the_other_end_is_gone():
    ours, end = channel_pair()
    theirs = SupervisorChannel(end)
    theirs.send("head", "active")
    theirs.close()
    assert ours.receive() == [("head", "active")]
    assert ours.broken
    assert ours.wait() is None
    ours.send("head", "deactivate")
    ours.close()


def test_saying_never_waits_for_somebody_who_does_not_listen():
    ours, end = channel_pair()
    theirs = SupervisorChannel(end)
    for _ in range(20_000):
        theirs.send("head", "active")
    assert not theirs.broken
    assert 0 < len(ours.receive()) < 20_000
    ours.close()
    theirs.close()


def test_a_process_takes_its_line_from_the_environment_and_does_not_hand_it_on():
    ours, end = channel_pair()
    number = os.dup(end.fileno())
    os.set_inheritable(number, True)
    end.close()
    environment = {CHANNEL_VARIABLE: str(number)}
    theirs = own_channel(environment)
    assert theirs is not None
    assert environment == {}
    assert not os.get_inheritable(number)
    theirs.send("head", "active")
    assert ours.receive() == [("head", "active")]
    theirs.close()
    ours.close()


def test_a_process_that_nobody_supervises_has_no_line():
    assert own_channel({}) is None
