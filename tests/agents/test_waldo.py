from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.agents.waldo.waldo import Manners, PersonSensor
from socialbot.agents.waldo.waldo_node import WaldoNode
from socialbot.clock import SECOND, nanoseconds
from socialbot.errors import ParameterError
from socialbot.graph import Graph, Placement
from socialbot.inline import InlineRunner
from socialbot.messages import ActionRequest, Message, Mind, PersonDetection, PersonDetections, TraceRecord

DETECTIONS = "/humans/bodies/detections"
PERIOD_S = 0.1
GREETING, SEVERAL, OFFER = (
    parameter.default for parameter in (WaldoNode.greeting, WaldoNode.greeting_several, WaldoNode.offer)
)
FAR = WaldoNode.range_m.default + 0.1
"""Too far away (m) to be Waldo's business."""


def person(distance: float | None = 2.0, track: str = "") -> PersonDetection:
    return PersonDetection(x=0, y=0, w=10, h=30, score=1.0, track_id=track, distance_m=distance)


ANNA, BEN, CARL = (person(track=name) for name in ("t1", "t2", "t3"))


class Corridor:
    """Waldo in a corridor, seen ten times a second; what he does, and when (s)."""

    def __init__(self, **parameters: object) -> None:
        placement = Placement("waldo", WaldoNode, {"vanish_s": 1.5, **parameters})
        self.runner = InlineRunner(Graph("test", (placement,), inputs=frozenset({DETECTIONS})))
        self.node = self.runner.nodes["waldo"]
        self.did: list[tuple[float, str]] = []
        self.said: list[str] = []
        self.trace: list[TraceRecord] = []
        self.minds: list[Mind] = []
        self.frame = 0
        self.shown: list[int] = []
        self.runner.tap("/waldo/actions", self._act)
        self.runner.tap("/waldo/trace", lambda _, record: self.trace.append(record))  # type: ignore[arg-type]
        self.runner.tap("/waldo/mind", lambda _, mind: self.minds.append(mind))  # type: ignore[arg-type]
        self.runner.start()

    def _act(self, topic: str, action: Message) -> None:
        assert isinstance(action, ActionRequest)
        self.did.append((action.stamp / SECOND, str(action.arguments[0]) if action.arguments else action.name))
        self.said += [str(sentence) for sentence in action.arguments[1:]]

    def see(self, *persons: PersonDetection, times: int = 1) -> None:
        for _ in range(times):
            stamp = self.frame * nanoseconds(PERIOD_S)
            if any(p.distance_m is None or p.distance_m <= WaldoNode.range_m.default for p in persons):
                self.shown.append(stamp)
            self.runner.feed(
                DETECTIONS,
                PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=persons),
            )
            self.frame += 1

    def until(self, seconds: float, *persons: PersonDetection) -> None:
        """Frames with ``persons`` until ``seconds``, that moment not included."""
        while self.frame * PERIOD_S < seconds - 1e-9:
            self.see(*persons)

    def pattern(self, frames: str) -> None:
        """A frame for each digit: how many people it shows."""
        for digit in frames:
            self.see(*[person()] * int(digit))

    @property
    def faults(self) -> int:
        return self.runner.faults["waldo"].failures


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


# Who is who


def offers(corridor: Corridor) -> list[float]:
    return [when for when, what in corridor.did if what == "offer"]


def test_with_tracks_a_visit_is_the_same():
    corridor = Corridor()
    corridor.until(2)
    corridor.until(20, ANNA)
    corridor.until(30)
    assert corridor.did == [(1.5, "stayIdle"), (2.2, "greeting"), (10.2, "offer"), (21.2, "stayIdle")]


def test_who_joins_does_not_restart_the_time_of_who_is_there():
    corridor = Corridor()
    corridor.until(4, ANNA)
    corridor.until(12, ANNA, BEN)
    assert corridor.did == [(0.5, "greeting"), (8.5, "offer")]


def test_who_joins_is_not_offered_help_for_the_time_that_another_was_there():
    corridor = Corridor()
    corridor.until(4, ANNA)
    corridor.until(5, ANNA, BEN)
    corridor.until(20, BEN)
    assert corridor.did == [(0.5, "greeting"), (12.2, "offer")]


def test_people_who_take_turns_are_offered_no_help():
    corridor = Corridor()
    for number in range(10):
        corridor.until(4 * (number + 1), person(track=f"t{number}"))
    assert corridor.did == [(0.5, "greeting")]
    assert corridor.faults == 0


def test_who_is_there_while_help_is_offered_to_another_has_heard_it():
    corridor = Corridor()
    corridor.until(5, ANNA)
    corridor.until(30, ANNA, BEN)
    assert offers(corridor) == [8.5]


def test_who_comes_after_the_offer_and_stays_is_offered_help_as_well():
    corridor = Corridor()
    corridor.until(10, ANNA)
    corridor.until(12, ANNA, BEN)
    corridor.until(40, BEN)
    assert offers(corridor) == [8.5, 18.2]


def test_those_who_come_late_together_are_offered_help_once():
    corridor = Corridor()
    corridor.until(10, ANNA)
    corridor.until(11, ANNA, BEN)
    corridor.until(40, ANNA, BEN, CARL)
    assert offers(corridor) == [8.5, 18.2]


def test_who_comes_late_and_leaves_is_not_offered_help():
    corridor = Corridor()
    corridor.until(10, ANNA)
    corridor.until(15, ANNA, BEN)
    corridor.until(40, ANNA)
    assert offers(corridor) == [8.5]


def test_who_comes_when_another_leaves_is_nobody_new_to_greet():
    corridor = Corridor()
    corridor.until(5, ANNA)
    corridor.until(12, BEN)
    assert corridor.did == [(0.5, "greeting")]
    corridor.until(14, BEN)
    assert corridor.did[1:] == [(13.2, "offer")]


def test_tracks_that_last_a_moment_are_nobody():
    corridor = Corridor()
    corridor.until(2)
    for number in range(100):
        corridor.see(person(track=f"t{number}"))
    assert corridor.did == [(1.5, "stayIdle")]


def test_people_with_tracks_are_greeted_together():
    corridor = Corridor()
    corridor.until(3, ANNA, BEN)
    assert corridor.did == [(0.5, "greeting_several")]


def test_who_is_near_is_greeted_and_who_is_far_is_not_waited_for():
    corridor = Corridor()
    corridor.until(9, ANNA, person(FAR, "t2"))
    assert corridor.did == [(0.5, "greeting"), (8.5, "offer")]
    corridor.until(12, person(FAR, "t1"), person(2.0, "t2"))
    assert len(corridor.did) == 2


def test_a_recording_that_begins_anew_is_another_visit_of_other_people():
    sensor = PersonSensor(Manners(vanish_s=1.5))
    told: list[str] = []
    for begin, name in ((50, "t1"), (0, "t2")):
        for tenth in range(40):
            frame = PersonDetections(
                stamp=begin * SECOND + tenth * SECOND // 10, frame_id="c", width=9, height=9,
                persons=(person(track=name),),
            )  # fmt: skip
            sensed = sensor.sense(frame)
            told += map(str, sensed if isinstance(sensed, list) else ())
    assert told == ['+present("t1")', "+people(1)", '+personDetected("Yes")', '+present("t2")', '-present("t1")']


def test_what_is_kept_of_people_does_not_pile_up():
    sensor = PersonSensor(Manners())
    for tenth in range(3000):
        frame = PersonDetections(
            stamp=tenth * SECOND // 10, frame_id="c", width=9, height=9, persons=(person(track=f"t{tenth // 10}"),)
        )
        sensor.sense(frame)
    assert len(sensor._changed) < 20


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
    assert vars(Manners()).items() <= defaults.items()


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


# Whatever comes


SCENES = st.lists(
    st.tuples(
        st.lists(st.sampled_from((1.0, 5.9, FAR, None)), max_size=3),  # who is there
        st.integers(1, 60),  # for how many frames
        st.integers(1, 4),  # of which every so many-eth shows them
    ),
    max_size=8,
)
MANNERS = st.fixed_dictionaries(
    {
        "appear_s": st.sampled_from((0.0, 0.3, 0.5)),
        "vanish_s": st.sampled_from((0.5, 1.5)),
        "help_after_s": st.sampled_from((0.5, 2.0, 8.0)),
        "regreet_after_s": st.sampled_from((0.0, 1.0, 5.0)),
    }
)


def played(scenes, manners) -> Corridor:
    corridor = Corridor(**manners)
    for distances, frames, visible in scenes:
        for number in range(frames):
            corridor.see(*(map(person, distances) if number % visible == 0 else ()))
    return corridor


@settings(deadline=None, max_examples=60)
@given(SCENES, MANNERS)
def test_whatever_comes_waldo_keeps_his_manners(scenes, manners):
    corridor = played(scenes, manners)
    assert corridor.faults == 0
    assert not [record for record in corridor.trace if record.kind in ("failure", "dropped")]
    stamps = [frame * nanoseconds(PERIOD_S) for frame in range(corridor.frame)]
    believed = [
        (record.stamp, record.what.split('"')[1])
        for record in corridor.trace
        if record.kind == "belief" and record.what.startswith("personDetected")
    ]
    for (_, before), (_, after) in itertools.pairwise(believed):
        assert after in {"No": ("Yes",), "Yes": ("No", "Next"), "Next": ("No",)}[before]
    came = [stamp for stamp, what in believed if what == "Yes"]
    left = [stamp for stamp, what in believed if what == "No"]
    at = {
        what: [round(when * SECOND) for when, did in corridor.did if did.startswith(what)]
        for what in ("stayIdle", "greeting", "offer")
    }
    patience, rest = (nanoseconds(manners[name]) for name in ("help_after_s", "regreet_after_s"))

    def rested(since: int, until: int) -> bool:
        """Whether nobody was there for so long that who comes then is greeted anew."""
        return any(
            since <= gone and gone + rest <= until and not any(gone <= coming < gone + rest for coming in came)
            for gone in left
        )

    assert at["stayIdle"] == left
    for coming in came:
        earlier = [greeting for greeting in at["greeting"] if greeting < coming]
        assert (coming in at["greeting"]) == (not earlier or rested(earlier[-1], coming))
        leaving = next((gone for gone in left if gone > coming), corridor.runner.clock.now() + 1)
        recent = nanoseconds(manners["appear_s"])
        due = [
            stamp
            for stamp in stamps
            if coming + patience <= stamp < leaving and coming + recent <= stamp
            if any(stamp - recent <= when <= stamp for when in corridor.shown)
        ]
        assert [offer for offer in at["offer"] if coming <= offer < leaving] == due[:1]
    assert len(at["offer"]) == len({stamp for stamp, what in believed if what == "Next"})
    assert set(at["greeting"]) <= set(came)


@settings(deadline=None, max_examples=20)
@given(SCENES, MANNERS)
def test_the_same_frames_lead_to_the_same_trace(scenes, manners):
    first, second = played(scenes, manners), played(scenes, manners)
    assert first.trace == second.trace
    assert first.did == second.did


VISITORS = st.lists(
    st.tuples(st.lists(st.sampled_from(("t1", "t2", "t3")), max_size=3, unique=True), st.integers(1, 60)), max_size=10
)


@settings(deadline=None, max_examples=60)
@given(VISITORS, st.sampled_from((1.0, 4.0)))
def test_whoever_stays_is_offered_help_and_nobody_else(scenes, help_after_s):
    corridor = Corridor(help_after_s=help_after_s)
    for names, frames in scenes:
        corridor.see(*(person(track=name) for name in names), times=frames)
    assert corridor.faults == 0
    assert not [record for record in corridor.trace if record.kind in ("failure", "dropped")]
    patience, end = nanoseconds(help_after_s), corridor.runner.clock.now()
    came: dict[str, int] = {}
    visits: list[tuple[int, int]] = []
    for record in corridor.trace:
        if record.kind in ("belief", "unbelief") and record.what.startswith("present"):
            name = record.what.split('"')[1]
            if record.kind == "belief":
                came[name] = record.stamp
            else:
                visits.append((came.pop(name), record.stamp))
    visits += [(since, end + 1) for since in came.values()]
    offered = [round(when * SECOND) for when in offers(corridor)]
    for at in offered:
        assert any(since + patience <= at < until for since, until in visits)
    # The longest that somebody can be there without being seen.
    unseen = nanoseconds(1.5)
    for since, until in visits:
        if since + patience + unseen < min(until, end):
            assert any(since <= at <= since + patience + unseen for at in offered)


@settings(deadline=None, max_examples=150)
@given(
    st.lists(st.tuples(st.integers(1, 9), st.sampled_from(("0", "1", "10", "100", "2"))), max_size=12),
    st.sampled_from((0.0, 0.3, 0.5, 2.0)),
    st.sampled_from((0.5, 1.5)),
)
def test_coming_and_going_are_told_by_the_shares_of_the_frames(scenes, appear_s, vanish_s):
    counts = [int(digit) for repeats, digits in scenes for digit in digits * repeats]
    sensor = PersonSensor(Manners(appear_s=appear_s, vanish_s=vanish_s, help_after_s=600.0))
    present, changed = None, 0
    for newest, count in enumerate(counts):
        frame = PersonDetections(
            stamp=newest * SECOND // 10, frame_id="c", width=9, height=9, persons=(person(),) * count
        )
        sensed = sensor.sense(frame)
        told = str(sensed[-1] if isinstance(sensed, list) else sensed)
        shows = {
            seconds: [count > 0 for count in counts[max(0, newest - round(10 * seconds)) : newest + 1]]
            for seconds in (appear_s, vanish_s)
        }
        somebody = any(shows[appear_s]) and 2 * sum(shows[appear_s]) >= len(shows[appear_s])
        nobody = 4 * sum(shows[vanish_s]) < len(shows[vanish_s])
        if told == '+personDetected("Yes")':
            assert somebody
            assert not present
            assert present is None or any(counts[changed + 1 : newest + 1]), "nobody was seen since the last one left"
            present, changed = True, newest
        elif told == '+personDetected("No")':
            assert nobody
            assert present is not False
            assert present is None or newest - changed >= 10 * vanish_s - 1e-9, "has only just come"
            present, changed = False, newest
        else:
            assert sensed is None
            # What has been so for the whole time since the last change has to be told.
            assert not (somebody and not present and newest - changed > 10 * appear_s)
            assert not (nobody and present is not False and newest - changed > 10 * vanish_s)
