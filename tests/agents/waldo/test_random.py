"""Random detections: Waldo keeps his rules of behaviour."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from socialbot.agents.waldo.waldo import PersonSensor, WaldoConfig
from socialbot.bdi import sensors
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import PersonDetections
from tests.agents.waldo.corridor import FAR, PERIOD_S, Corridor, offers, person

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


@example(  # somebody comes in the very frame in which the last visit is forgotten
    [([1.0], 1, 1), ([], 1, 1), ([], 53, 1), ([1.0], 1, 1)],
    {"appear_s": 0.0, "vanish_s": 0.5, "help_after_s": 0.5, "regreet_after_s": 5.0},
)
@settings(deadline=None, max_examples=60)
@given(SCENES, MANNERS)
def test_any_detections_cause_polite_actions(scenes, manners):
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
        offers_before = [offer for offer in at["offer"] if offer < coming]
        expected = due[:1] if not offers_before or rested(offers_before[-1], coming) else []
        assert [offer for offer in at["offer"] if coming <= offer < leaving] == expected
    assert set(at["offer"]) <= {stamp for stamp, what in believed if what == "Next"}
    assert set(at["greeting"]) <= set(came)


@pytest.mark.slow
@settings(deadline=None, max_examples=20)
@given(SCENES, MANNERS)
def test_same_frames_give_the_same_trace(scenes, manners):
    first, second = played(scenes, manners), played(scenes, manners)
    assert first.trace == second.trace
    assert first.did == second.did


VISITORS = st.lists(
    st.tuples(st.lists(st.sampled_from(("t1", "t2", "t3")), max_size=3, unique=True), st.integers(1, 60)), max_size=10
)


@settings(deadline=None, max_examples=60)
@given(VISITORS, st.sampled_from((1.0, 4.0)))
def test_help_is_offered_only_to_people_who_stay(scenes, help_after_s):
    corridor = Corridor(help_after_s=help_after_s)
    for names, frames in scenes:
        corridor.see(*(person(track=name) for name in names), times=frames)
    assert corridor.faults == 0
    assert not [record for record in corridor.trace if record.kind in ("failure", "dropped")]
    patience, end = nanoseconds(help_after_s), corridor.runner.clock.now()
    came: dict[str, int] = {}
    visits: list[tuple[str, int, int]] = []
    for record in corridor.trace:
        if record.kind in ("belief", "unbelief") and record.what.startswith("present"):
            name = record.what.split('"')[1]
            if record.kind == "belief":
                came[name] = record.stamp
            else:
                visits.append((name, came.pop(name), record.stamp))
    visits += [(name, since, end + 1) for name, since in came.items()]
    offered = [round(when * SECOND) for when in offers(corridor)]
    for at in offered:
        assert any(since + patience <= at < until for _, since, until in visits)
    # The longest that somebody can be there without being seen.
    unseen = nanoseconds(1.5)
    for name, since, until in visits:
        if since + patience + unseen < min(until, end):
            heard = [one for one in visits if one[0] == name and one[1] <= since]
            assert any(
                begin <= at < until and at <= since + patience + unseen for _, begin, until in heard for at in offered
            )


@example([(1, "1"), (2, "0"), (9, "0"), (2, "100")], 0.0, 1.5)  # few frames show somebody, but the newest one does
@settings(deadline=None, max_examples=150)
@given(
    st.lists(st.tuples(st.integers(1, 9), st.sampled_from(("0", "1", "10", "100", "2"))), max_size=12),
    st.sampled_from((0.0, 0.3, 0.5, 2.0)),
    st.sampled_from((0.5, 1.5)),
)
def test_arrival_and_departure_depend_on_shares_of_frames(scenes, appear_s, vanish_s):
    counts = [int(digit) for repeats, digits in scenes for digit in digits * repeats]
    sensor = PersonSensor(WaldoConfig(appear_s=appear_s, vanish_s=vanish_s, help_after_s=600.0))
    present, changed = None, 0
    for newest, count in enumerate(counts):
        frame = PersonDetections(
            stamp=newest * SECOND // 10, frame_id="c", width=9, height=9, persons=(person(),) * count
        )
        sensed = sensors.changes(sensor.sense(frame))
        changes = [str(change) for change in sensed if change.literal.functor == "personDetected"]
        shows = {
            seconds: [count > 0 for count in counts[max(0, newest - round(10 * seconds)) : newest + 1]]
            for seconds in (appear_s, vanish_s)
        }
        back = 2 * sum(shows[min(appear_s, vanish_s)]) >= len(shows[min(appear_s, vanish_s)])
        somebody = any(shows[appear_s]) and 2 * sum(shows[appear_s]) >= len(shows[appear_s])
        nobody = 4 * sum(shows[vanish_s]) < len(shows[vanish_s])
        if changes == ['+personDetected("Yes")']:
            assert somebody
            assert not present
            assert present is None or any(counts[changed + 1 : newest + 1]), "nobody was seen since the last one left"
            present, changed = True, newest
        elif changes == ['+personDetected("No")']:
            assert nobody
            assert not back, "who is back does not leave"
            assert present is not False
            assert present is None or newest - changed >= 10 * vanish_s - 1e-9, "has only just come"
            present, changed = False, newest
        else:
            assert changes == []
            # What has been so for the whole time since the last change has to be told.
            assert not (somebody and not present and newest - changed > 10 * appear_s)
            assert not (nobody and not back and present is not False and newest - changed > 10 * vanish_s)
