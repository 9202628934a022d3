"""Forged messages: no node raises, and the mission completes."""

from __future__ import annotations

import dataclasses
import logging
from operator import itemgetter
from typing import get_args

from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.agents.hospital.demo import WORLD, hospital
from socialbot.agents.hospital.robot_node import ACTIONS
from socialbot.agents.hospital.ward.messages import MESSAGES
from socialbot.agents.teams.messages import (
    COORDINATOR,
    EVERYBODY,
    AclMessage,
    Belief,
    Done,
    End,
    Finished,
    InitialTrigger,
    Performative,
    Plan,
    Problem,
    Ready,
    Refusal,
    Register,
    Report,
    Start,
    Stop,
)
from socialbot.core.clock import SECOND
from socialbot.graph.inline import InlineRunner

logging.getLogger("socialbot.coordinator").setLevel(logging.CRITICAL)

TEAM = ("nurse_disinfected1", "room1", "spotrobot1", "uvdrobot1")
WORDS = st.sampled_from([*TEAM, COORDINATOR, EVERYBODY, "", "Big", "it's", 'a"b', "a,b", "x(", "\n", "Ünï"]) | st.text(
    max_size=5
)
STRANGERS = st.sampled_from(["", "desk", "Big Name", 'a"b', "room1", "nurse_disinfected2"])
LABELS = st.sampled_from(["", "mission_1_1", "mission_1_1", "mission_1_2", "mission_2_1"])
ARGS = st.lists(WORDS, max_size=4).map(tuple) | st.just(TEAM)
DEEDS = st.sampled_from([*ACTIONS, "", "x("])
LITERALS = st.sampled_from(
    [
        "milestone5",
        "foo(X)",
        "~foo",
        "X",
        "((",
        "f(" * 400 + "a" + ")" * 400,
        "foo(1/0)",
        "not a",
        "[a|b]",
        "1e999",
        "a.b",
    ]
) | st.text(max_size=10)
PLANS = st.sampled_from(
    ["@mission_1_1_0 +start(A,B,C,D) <- a_navigate_to(X,Y).", "@mission_1_1_0 +!x <- .no(x).", "", "("]
)
CONTENTS = st.one_of(
    st.builds(Register, WORDS, ARGS),
    st.builds(Plan, LABELS, st.lists(PLANS, max_size=2).map(tuple)),
    st.builds(Belief, LITERALS),
    st.builds(Start, ARGS),
    st.builds(Stop, WORDS),
    st.just(End()),
    st.builds(Ready, DEEDS, ARGS),
    st.builds(Done, DEEDS, ARGS),
    st.builds(Report, st.sampled_from(["success", "failure"]), DEEDS, ARGS, WORDS),
    st.builds(Problem, WORDS, ARGS, DEEDS),
    st.just(Finished()),
    st.builds(InitialTrigger, st.sampled_from(["disinfect", "urgent", "tea"]), ARGS),
    st.builds(Refusal, WORDS),
)
SPEECH_ACTS = st.builds(
    AclMessage,
    stamp=st.just(0),
    id=WORDS,
    sender=STRANGERS,
    receiver=st.sampled_from([COORDINATOR, EVERYBODY, "spotrobot1", "uvdrobot1", "nurse_disinfected1"]),
    performative=st.sampled_from(get_args(Performative)),
    content=CONTENTS,
    in_reply_to=WORDS,
    mission=LABELS,
)


TIMES = st.sampled_from([round(0.1 * number * SECOND) for number in range(30)])
SAID = st.lists(st.tuples(TIMES, SPEECH_ACTS), min_size=10, max_size=20).map(
    lambda said: sorted(said, key=itemgetter(0))
)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([0.0, 100.0]), SAID)
def test_forged_messages_raise_nothing_and_the_mission_completes(rate, said):
    logging.disable(logging.CRITICAL)
    try:
        run = InlineRunner(dataclasses.replace(hospital(rate=rate), inputs=frozenset({MESSAGES})))
        run.start()
        for time, message in said:
            run.feed(MESSAGES, message, time=time)
        run.advance(15 * SECOND)
    finally:
        logging.disable(logging.NOTSET)
    assert [(name, fault.first) for name, fault in run.faults.items() if fault.failures] == []
    assert run.nodes[WORLD].world.rooms["room1"].disinfected  # type: ignore[attr-defined]
