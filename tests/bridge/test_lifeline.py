"""The line between a process and its supervisor."""

from __future__ import annotations

import os

from socialbot.bridge.supervisor_channel import LIFELINE_VARIABLE, SupervisorChannel, lifelines, own_lifeline


def test_what_is_said_is_heard_word_by_word():
    ours, end = lifelines()
    theirs = SupervisorChannel(end)
    assert ours.hear() == []
    theirs.say("head", "starting")
    theirs.say("head", "active")
    assert ours.hear() == [("head", "starting"), ("head", "active")]
    ours.say("head", "deactivate")
    assert theirs.wait() == ("head", "deactivate")
    ours.close()
    theirs.close()


def test_the_line_is_broken_when_the_other_end_is_gone():
    ours, end = lifelines()
    theirs = SupervisorChannel(end)
    theirs.say("head", "active")
    theirs.close()
    assert ours.hear() == [("head", "active")]
    assert ours.broken
    assert ours.wait() is None
    ours.say("head", "deactivate")
    ours.close()


def test_saying_never_waits_for_somebody_who_does_not_listen():
    ours, end = lifelines()
    theirs = SupervisorChannel(end)
    for _ in range(20_000):
        theirs.say("head", "active")
    assert not theirs.broken
    assert 0 < len(ours.hear()) < 20_000
    ours.close()
    theirs.close()


def test_a_process_takes_its_line_from_the_environment_and_does_not_hand_it_on():
    ours, end = lifelines()
    number = os.dup(end.fileno())
    os.set_inheritable(number, True)
    end.close()
    environment = {LIFELINE_VARIABLE: str(number)}
    theirs = own_lifeline(environment)
    assert theirs is not None
    assert environment == {}
    assert not os.get_inheritable(number)
    theirs.say("head", "active")
    assert ours.hear() == [("head", "active")]
    theirs.close()
    ours.close()


def test_a_process_that_nobody_supervises_has_no_line():
    assert own_lifeline({}) is None
