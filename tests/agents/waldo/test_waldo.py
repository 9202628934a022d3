from __future__ import annotations

import pytest

from socialbot.agents.waldo.nodes import WaldoNode
from socialbot.agents.waldo.waldo import WaldoConfig
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import ActionRequest, Message
from tests.agents.waldo.corridor import FAR, GREETING, OFFER, SEVERAL, Corridor, person


def test_a_visit_from_beginning_to_end():
    corridor = Corridor()
    corridor.until(2)
    corridor.until(20, person())
    corridor.until(30)
    assert corridor.did == [(1.5, "stayIdle"), (2.2, "greeting"), (10.2, "offer"), (21.2, "stayIdle")]
    assert corridor.said == [GREETING, OFFER]
    assert corridor.faults == 0


def test_who_is_there_from_the_beginning_is_greeted_as_soon_as_that_is_sure():
    corridor = Corridor()
    corridor.until(5, person())
    assert corridor.did == [(0.5, "greeting")]


def test_nobody_is_left_in_peace_once():
    corridor = Corridor()
    corridor.until(30)
    assert corridor.did == [(1.5, "stayIdle")]


@pytest.mark.parametrize("frames", ["1", "11", "1000001", "110000110000", "100100100100"])
def test_a_flicker_is_nobody(frames):
    corridor = Corridor()
    corridor.until(2)
    corridor.pattern(frames)
    corridor.until(30)
    assert corridor.did == [(1.5, "stayIdle")]


def test_a_person_seen_in_every_second_frame_is_somebody():
    corridor = Corridor()
    corridor.until(2)
    corridor.pattern("10" * 100)
    assert [what for _, what in corridor.did] == ["stayIdle", "greeting", "offer"]


def test_detections_that_fail_now_and_then_end_no_visit():
    corridor = Corridor()
    corridor.until(2)
    corridor.pattern("1111100000000" * 20)
    assert [what for _, what in corridor.did] == ["stayIdle", "greeting", "offer"]


def test_help_is_offered_once_to_those_who_stay():
    corridor = Corridor(help_after_s=3.0)
    corridor.until(60, person())
    assert corridor.did == [(0.5, "greeting"), (3.5, "offer")]


def test_who_leaves_in_time_is_not_offered_help():
    corridor = Corridor()
    corridor.until(7.0, person())
    corridor.until(30)
    assert corridor.did == [(0.5, "greeting"), (8.2, "stayIdle")]


def test_who_comes_back_soon_is_not_greeted_again_but_may_need_help():
    corridor = Corridor()
    corridor.until(5, person())
    corridor.until(10)
    corridor.until(25, person())
    assert corridor.did == [(0.5, "greeting"), (6.2, "stayIdle"), (18.2, "offer")]


def test_who_comes_back_after_a_while_is_greeted_anew():
    corridor = Corridor()
    corridor.until(5, person())
    corridor.until(11.5)
    corridor.until(25, person())
    assert corridor.did == [(0.5, "greeting"), (6.2, "stayIdle"), (11.7, "greeting"), (19.7, "offer")]


def test_each_short_absence_counts_by_itself():
    corridor = Corridor()
    for _ in range(4):
        corridor.see(person(), times=30)
        corridor.see(times=40)
    assert [what for _, what in corridor.did] == ["greeting", "stayIdle", "stayIdle", "stayIdle", "stayIdle"]


def test_several_people_are_greeted_together():
    corridor = Corridor()
    corridor.until(20, person(), person(4.0))
    assert corridor.did == [(0.5, "greeting_several"), (8.5, "offer")]
    assert corridor.said == [SEVERAL, OFFER]


def test_a_second_box_that_flickers_makes_no_company():
    corridor = Corridor()
    corridor.pattern("112111")
    assert corridor.said == [GREETING]


def test_who_joins_later_is_not_greeted_again():
    corridor = Corridor()
    corridor.until(3, person())
    corridor.until(6, person(), person())
    assert corridor.did == [(0.5, "greeting")]


def test_people_far_away_are_left_alone_and_not_counted():
    corridor = Corridor()
    corridor.until(5, person(FAR), person(FAR))
    assert corridor.did == [(1.5, "stayIdle")]
    corridor.until(8, person(FAR), person(5.9))
    assert corridor.did[1:] == [(5.2, "greeting")]


def test_a_person_whose_distance_is_unknown_counts():
    corridor = Corridor()
    corridor.until(1, person(None))
    assert corridor.did == [(0.5, "greeting")]


def test_the_range_belongs_to_it():
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


def test_a_new_time_for_help_counts_from_the_next_visit_on():
    corridor = Corridor(regreet_after_s=1.0)
    corridor.until(1, person())
    corridor.node.set_parameter("help_after_s", 2.0)
    corridor.until(9, person())
    corridor.until(14)
    corridor.until(18, person())
    assert corridor.did == [
        (0.5, "greeting"), (8.5, "offer"), (10.2, "stayIdle"), (14.2, "greeting"), (16.2, "offer"),
    ]  # fmt: skip


def test_a_new_range_counts_at_once():
    corridor = Corridor()
    corridor.until(3, person(FAR))
    corridor.node.set_parameter("range_m", 10.0)
    corridor.until(4, person(FAR))
    assert [what for _, what in corridor.did] == ["stayIdle", "greeting"]
    assert 3.0 <= corridor.did[1][0] <= 3.5


def test_new_times_for_coming_and_going_count_at_once():
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


def test_who_has_just_come_has_not_left_because_of_one_frame():
    corridor = Corridor()
    corridor.until(2)
    corridor.pattern("1110" + "1" * 20)
    assert [what for _, what in corridor.did] == ["stayIdle", "greeting"]


def test_a_slow_coming_is_not_confused_with_a_quick_going():
    # With a long memory for who comes, those who have left must not be taken for those who come.
    corridor = Corridor(appear_s=5.0, vanish_s=1.0)
    corridor.until(10, person())
    corridor.until(20)
    assert [what for _, what in corridor.did] == ["greeting", "stayIdle"]


@pytest.mark.parametrize(
    ("name", "value"), [("help_after_s", 0.0), ("range_m", "far"), ("greeting", 3), ("appear", 1.0)]
)
def test_manners_that_are_none_are_refused(name, value):
    with pytest.raises(ParameterError):
        Corridor(**{name: value})
    with pytest.raises(ParameterError):
        Corridor().node.set_parameter(name, value)


def test_the_node_has_a_parameter_for_each_of_the_manners():
    defaults = {name: parameter.default for name, parameter in WaldoNode.parameters().items()}
    assert vars(WaldoConfig()).items() <= defaults.items()


def test_the_same_alarm_is_not_set_again_with_each_frame(monkeypatch):
    # Cancelled alarms wait until they are due: with a long regreet_after_s they would pile up for hours.
    corridor = Corridor(regreet_after_s=86400.0)
    corridor.until(3)
    alarms, call_at = [], corridor.runner.call_at
    monkeypatch.setattr(corridor.runner, "call_at", lambda *args: alarms.append(args) or call_at(*args))
    corridor.until(30)
    assert len(alarms) <= 1


# Reasons


def test_a_greeting_is_led_back_to_the_frame():
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
        '+personDetected("Yes")',
        'personDetected("Yes")',
    ]
    assert record.cause == f"detection-{SECOND // 2}"
    assert {record.source for record in corridor.trace} == {"waldo"}


def test_an_action_carries_the_id_of_its_record():
    corridor = Corridor()
    actions: list[Message] = []
    corridor.runner.tap("/waldo/actions", lambda _, message: actions.append(message))
    corridor.until(1, person())
    (action,) = actions
    assert isinstance(action, ActionRequest)
    assert (action.agent, action.name, action.arguments) == ("waldo", "speak", ("greeting", GREETING))
    assert [record.what for record in corridor.trace if record.id == action.id] == ['speak("greeting")']


def test_the_mind_is_shown_when_it_changes_and_not_otherwise():
    corridor = Corridor()
    corridor.until(5, person())
    assert [[belief.text for belief in mind.beliefs] for mind in corridor.minds] == [
        [], ['personDetected("Yes")', 'present("somebody")', "people(1)", "greeted()"],
    ]  # fmt: skip
    assert [belief.since for belief in corridor.minds[-1].beliefs] == [SECOND // 2] * 4
