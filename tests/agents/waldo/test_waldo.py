from __future__ import annotations

from typing import Any

import pytest

from socialbot.agents.waldo.nodes import WaldoNode
from socialbot.agents.waldo.waldo import WaldoConfig
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import ActionRequest, Message
from tests.agents.waldo.corridor import FAR, GREETING, OFFER, SEVERAL, Corridor, person

SOMEBODY = person()
VISITS = {
    "whole visit": (
        [(2,), (20, SOMEBODY), (30,)],
        [(1.5, "stayIdle"), (2.2, "greeting"), (10.2, "offer"), (21.2, "stayIdle")],
    ),
    "present from the beginning": ([(5, SOMEBODY)], [(0.5, "greeting")]),
    "empty corridor": ([(30,)], [(1.5, "stayIdle")]),
    "one offer during a long visit": ([(60, SOMEBODY)], [(0.5, "greeting"), (8.5, "offer")]),
    "leaves before the offer": ([(7.0, SOMEBODY), (30,)], [(0.5, "greeting"), (8.2, "stayIdle")]),
    "returns soon: no greeting, but an offer": (
        [(5, SOMEBODY), (10,), (25, SOMEBODY)],
        [(0.5, "greeting"), (6.2, "stayIdle"), (18.2, "offer")],
    ),
    "returns after a while: new greeting": (
        [(5, SOMEBODY), (11.5,), (25, SOMEBODY)],
        [(0.5, "greeting"), (6.2, "stayIdle"), (11.7, "greeting"), (19.7, "offer")],
    ),
    "several people": ([(20, SOMEBODY, person(4.0))], [(0.5, "greeting_several"), (8.5, "offer")]),
    "second person joins later": ([(3, SOMEBODY), (6, SOMEBODY, SOMEBODY)], [(0.5, "greeting")]),
    "people beyond the range": (
        [(5, person(FAR), person(FAR)), (8, person(FAR), person(5.9))],
        [(1.5, "stayIdle"), (5.2, "greeting")],
    ),
    "unknown distance": ([(1, person(None))], [(0.5, "greeting")]),
}


@pytest.mark.parametrize(("scenes", "did"), VISITS.values(), ids=list(VISITS))
def test_acts_on_arrivals_and_departures(scenes, did):
    corridor = Corridor()
    for until, *persons in scenes:
        corridor.until(until, *persons)
    assert corridor.did == did
    sentences = {"greeting": GREETING, "greeting_several": SEVERAL, "offer": OFFER}
    assert corridor.said == [sentences[what] for _, what in did if what in sentences]
    assert corridor.faults == 0


@pytest.mark.parametrize("leap_s", [-3600.0, -1.5, 3600.0])
def test_a_camera_whose_clock_is_set_changes_nothing(leap_s):
    corridor = Corridor()
    corridor.until(3, person(track="t1"))
    corridor.camera_ahead_s = leap_s
    corridor.until(6, person(track="t1"))
    corridor.until(20)
    corridor.until(40, person(track="t1"))
    assert corridor.did == [(0.5, "greeting"), (7.2, "stayIdle"), (28.2, "offer")]
    assert corridor.faults == 0


@pytest.mark.parametrize(
    ("frames", "did"),
    [
        *((flicker, ["stayIdle"]) for flicker in ("1", "11", "1000001", "110000110000", "100100100100")),
        ("10" * 100, ["stayIdle", "greeting", "offer"]),
        ("1111100000000" * 20, ["stayIdle", "greeting", "offer"]),
        ("1110" + "1" * 20, ["stayIdle", "greeting"]),
    ],
)
def test_filters_flickering_detections(frames, did):
    corridor = Corridor()
    corridor.until(2)
    corridor.pattern(frames)
    if len(did) == 1:
        corridor.until(30)
    assert [what for _, what in corridor.did] == did


def test_short_absences_do_not_add_up():
    corridor = Corridor()
    for _ in range(4):
        corridor.see(person(), times=30)
        corridor.see(times=40)
    assert [what for _, what in corridor.did] == ["greeting", "stayIdle", "stayIdle", "stayIdle", "stayIdle"]


def test_ignores_a_second_box_in_one_frame():
    corridor = Corridor()
    corridor.pattern("112111")
    assert corridor.said == [GREETING]


def test_people_at_the_range_limit_count():
    corridor = Corridor(range_m=3.0)
    corridor.until(1, person(3.0))
    assert corridor.did == [(0.5, "greeting")]


# Parameters


def test_sentences_are_parameters_and_change_while_running():
    corridor = Corridor(greeting="Buongiorno!", help_after_s=2.0)
    corridor.until(1, person())
    corridor.node.set_parameter("offer", "Serve aiuto?")
    corridor.until(4, person())
    assert corridor.said == ["Buongiorno!", "Serve aiuto?"]


def test_new_help_time_applies_from_the_next_visit():
    corridor = Corridor(regreet_after_s=1.0)
    corridor.until(1, person())
    corridor.node.set_parameter("help_after_s", 2.0)
    corridor.until(9, person())
    corridor.until(14)
    corridor.until(18, person())
    assert corridor.did == [
        (0.5, "greeting"), (8.5, "offer"), (10.2, "stayIdle"), (14.2, "greeting"), (16.2, "offer"),
    ]  # fmt: skip


def test_new_range_applies_at_once():
    corridor = Corridor()
    corridor.until(3, person(FAR))
    corridor.node.set_parameter("range_m", 10.0)
    corridor.until(4, person(FAR))
    assert [what for _, what in corridor.did] == ["stayIdle", "greeting"]
    assert 3.0 <= corridor.did[1][0] <= 3.5


def test_new_arrival_and_departure_times_apply_at_once():
    corridor = Corridor(appear_s=0.0, vanish_s=0.0)
    corridor.see(person())
    corridor.see()
    assert corridor.did == [(0.0, "greeting"), (0.1, "stayIdle")]
    corridor.node.set_parameter("vanish_s", 1.0)
    corridor.node.set_parameter("regreet_after_s", 0.0)
    corridor.see(person())
    corridor.until(3)
    assert corridor.did[-1][1] == "stayIdle"
    assert 0.9 <= corridor.did[-1][0] <= 1.3


def test_slow_arrival_does_not_delay_fast_departure():
    # With a long memory for who comes, those who have left must not be taken for those who come.
    corridor = Corridor(appear_s=5.0, vanish_s=1.0)
    corridor.until(10, person())
    corridor.until(20)
    assert [what for _, what in corridor.did] == ["greeting", "stayIdle"]


@pytest.mark.parametrize(
    ("name", "value"), [("help_after_s", 0.0), ("range_m", "far"), ("greeting", 3), ("appear", 1.0)]
)
def test_refuses_invalid_parameters(name, value):
    with pytest.raises(ParameterError):
        Corridor(**{name: value})
    with pytest.raises(ParameterError):
        Corridor().node.set_parameter(name, value)


def test_each_configuration_value_is_a_parameter():
    defaults = {name: parameter.default for name, parameter in WaldoNode.parameters().items()}
    assert vars(WaldoConfig()).items() <= defaults.items()


def test_timers_are_not_set_again_with_each_frame(monkeypatch):
    # Cancelled alarms wait until they are due: with a long regreet_after_s they would pile up for hours.
    corridor = Corridor(regreet_after_s=86400.0)
    corridor.until(3)
    kind: Any = type(corridor.node.context)
    alarms, call_at = [], kind.call_at
    monkeypatch.setattr(kind, "call_at", lambda *args: alarms.append(args) or call_at(*args))
    corridor.until(30)
    assert len(alarms) <= 1


# Reasons


def test_trace_links_greeting_to_frame():
    corridor = Corridor()
    corridor.until(1, person())
    by_id = {record.id: record for record in corridor.trace}
    record = next(record for record in corridor.trace if record.kind == "action")
    steps = [record.what]
    while record.cause in by_id:
        record = by_id[record.cause]
        steps.append(record.what)
    assert steps == [
        'speak("greeting")',
        "GreetPeople()",
        "GreetPeople()",
        "+engages(Who)",
        'engages("somebody")',
        "somebody does not turn away (100 % of 6 frames)",
    ]
    assert record.cause == f"detection-{SECOND // 2}"
    assert {record.source for record in corridor.trace} == {"waldo"}


def test_action_has_the_id_of_its_trace_record():
    corridor = Corridor()
    actions: list[Message] = []
    corridor.runner.tap("/waldo/actions", lambda _, message: actions.append(message))
    corridor.until(1, person())
    (action,) = actions
    assert isinstance(action, ActionRequest)
    assert (action.agent, action.name, action.arguments) == ("waldo", "speak", ("greeting", GREETING))
    assert [record.what for record in corridor.trace if record.id == action.id] == ['speak("greeting")']


def test_publishes_mind_only_when_it_changes():
    corridor = Corridor()
    corridor.until(5, person())
    assert [[belief.text for belief in mind.beliefs] for mind in corridor.minds] == [
        [],
        [
            'personDetected("Yes")', 'present("somebody")', "people(1)", 'engages("somebody")', 'greeted("somebody")',
        ],
    ]  # fmt: skip
    assert [belief.since for belief in corridor.minds[-1].beliefs] == [SECOND // 2] * 5
