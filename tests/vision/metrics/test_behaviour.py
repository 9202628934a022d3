from __future__ import annotations

from dataclasses import replace
from itertools import islice

import msgspec
import pytest

from socialbot.graph.files import load_graph
from socialbot.vision.metrics.behaviour import behaviour, single_node, visits
from socialbot.vision.metrics.frames import BagImages, LabelledFrame
from socialbot.vision.metrics.pipeline import EvaluatedPipeline, PipelineSettings
from socialbot.vision.metrics.truth import TruthPerson
from tests.vision.metrics.scenes import START, TENTH, found, frame, person, seen

WALDO = single_node(load_graph("waldo"), "bdi_engine")


def story(seconds: float, *people):
    """Frames in which people are at a distance from and to a time (s): (who, from, to, distance)."""
    return [
        frame(
            *(person(100 * n, distance=m, id=who) for n, (who, a, b, m) in enumerate(people) if a <= number / 10 < b),
            number=number,
        )
        for number in range(round(10 * seconds))
    ]


def sight(seconds: float, *people):
    """Return detections in the form of `story`."""
    return [
        found(
            *(seen(100 * n, distance=m, track=who) for n, (who, a, b, m) in enumerate(people) if a <= number / 10 < b),
            number=number,
        )
        for number in range(round(10 * seconds))
    ]


def counts(truth, detections, deed):
    count = behaviour(WALDO, truth, detections).count(deed)
    return {outcome: number for outcome, number in count.items() if number}


A = ("a", 5, 20, 3.0)


def test_detector_without_fault():
    truth = story(30, A)
    acted = behaviour(WALDO, truth, sight(30, A))
    assert acted.count("greeting") == {
        "in time": 1, "late": 0, "missed": 0, "nobody": 0, "from afar": 0, "passing": 0, "again": 0,
    }  # fmt: skip
    assert {name: count for name, count in acted.count("offer").items() if count} == {"in time": 1}
    greeting, offer = acted.acts
    assert greeting.delay_s == pytest.approx(0.5, abs=0.3)
    assert (offer.time - START) / 1e9 == pytest.approx(13.5, abs=0.7)


def test_late_detection_gives_a_late_greeting():
    truth = story(30, A)
    assert counts(truth, sight(30, ("a", 8, 20, 3.0)), "greeting") == {"late": 1}


def test_missing_detection_gives_a_missed_greeting():
    truth = story(30, A)
    assert counts(truth, sight(30), "greeting") == {"missed": 1}
    assert counts(truth, sight(30), "offer") == {"missed": 1}


def test_greeting_of_a_false_positive_goes_to_nobody():
    truth = story(40)
    assert counts(truth, sight(40, A), "greeting") == {"nobody": 1}
    assert counts(truth, sight(40, A), "offer") == {"nobody": 1}


def test_false_positive_before_the_visit_gives_an_early_offer():
    truth = story(30, ("a", 10, 28, 3.0))
    # Seen from 4 s on, so that help is offered at 12.5 s, when A has been there for 2.5 s.
    assert counts(truth, sight(30, ("a", 4, 28, 3.0)), "offer")["too early"] == 1


def test_greeting_of_a_distant_person_is_from_afar():
    truth = story(20, ("a", 5, 18, 12.0))
    assert counts(truth, sight(20, ("a", 5, 18, 4.0)), "greeting") == {"from afar": 1}


def test_greeting_during_the_approach_is_in_time():
    truth = story(20, ("a", 5, 7, 6.6), ("a", 7, 18, 5.0))
    assert counts(truth, sight(20, ("a", 5, 18, 5.5)), "greeting") == {"in time": 1}


def test_lost_person_is_greeted_again():
    stays = ("a", 5, 40, 3.0)
    truth = story(40, stays)
    broken = sight(40, ("a", 5, 15, 3.0), ("b", 28, 40, 3.0))
    assert counts(truth, broken, "greeting") == {"in time": 1, "again": 1}


def test_every_visit_is_judged():
    both = (("a", 5, 18, 3.0), ("b", 40, 55, 3.0))
    assert counts(story(60, *both), sight(60, both[0]), "greeting") == {"in time": 1, "missed": 1}
    assert counts(story(60, *both), sight(60, *both), "greeting") == {"in time": 2}


def test_each_of_six_visitors_is_due_a_greeting():
    six = tuple((f"v{n}", 5 + 9 * n, 11 + 9 * n, 3.0) for n in range(6))
    assert counts(story(60, *six), sight(60, *six), "greeting") == {"in time": 6}
    assert counts(story(60, *six), sight(60, *six), "offer") == {}
    # A tracker that takes the six for one person.
    one = tuple(("t1", begin, end, m) for _, begin, end, m in six)
    assert counts(story(60, *six), sight(60, *one), "greeting") == {"in time": 1, "missed": 5}


def test_visitor_who_returns_within_a_minute_is_not_due_again():
    truth = story(60, ("a", 5, 12, 3.0), ("a", 30, 40, 3.0))
    same = sight(60, ("t1", 5, 12, 3.0), ("t1", 30, 40, 3.0))
    other = sight(60, ("t1", 5, 12, 3.0), ("t2", 30, 40, 3.0))
    assert counts(truth, same, "greeting") == {"in time": 1}
    assert counts(truth, other, "greeting") == {"in time": 1, "again": 1}


def test_people_together_are_greeted_by_one_sentence():
    both = (("a", 5, 12, 3.0), ("b", 5, 12, 3.0))
    assert counts(story(20, *both), sight(20, *both), "greeting") == {"in time": 2}


def turned(facing_rad: float) -> list[LabelledFrame]:
    """Frames of somebody who stands there from 5 to 15 s and faces in one direction."""
    looks = TruthPerson(x=0, y=0, w=10, h=20, id="a", distance_m=3.0, visible=1.0, facing_rad=facing_rad)
    return [frame(*([looks] if 50 <= number < 150 else []), number=number) for number in range(200)]


def test_person_with_the_back_turned_need_not_be_greeted():
    shown = sight(20, ("t1", 5, 15, 3.0))
    assert counts(turned(0.3), shown, "greeting") == {"in time": 1}
    assert counts(turned(0.3), sight(20), "greeting") == {"missed": 1}
    assert counts(turned(3.0), sight(20), "greeting") == {}
    assert counts(turned(3.0), shown, "greeting") == {"passing": 1}


@pytest.mark.parametrize(
    ("far_mps", "across_mps", "due"), [(-1.2, 0.0, True), (0.0, 0.0, True), (1.2, 0.0, False), (-0.3, 1.2, False)]
)
def test_walking_towards_the_robot_or_standing_is_engaging(far_mps, across_mps, due):
    moves = [
        frame(person(5 * across_mps * number, w=20, h=85, distance=5.0 + far_mps * number / 10), number=number)
        for number in range(20)
    ]
    (visit,) = visits(moves, 9.0, 2.5)
    assert (visit.engages is not None) == due


def test_visits():
    frames = story(20, ("a", 1, 4, 3.0), ("a", 5, 8, 3.0), ("a", 14, 16, 3.0), ("b", 0, 20, 8.0))
    times = [
        (visit.person, (visit.begin - START) // TENTH, (visit.end - START) // TENTH)
        for visit in visits(frames, 6.0, 2.5)
    ]
    assert times == [("a", 10, 79), ("a", 140, 159)]


def test_hardly_visible_people_are_not_present():
    assert visits([frame(person(visible=0.2))], 6.0, 2.5) == []


def test_empty_recording():
    acted = behaviour(WALDO, [], [])
    assert (acted.acts, acted.visits) == ((), ())


def test_the_actions_may_have_another_topic():
    node = replace(WALDO.nodes[0], name="robby", remap={"actions": "/robby/deeds"})
    stays = story(6.0, ("ann", 0.0, 6.0, 3.0)), sight(6.0, ("t1", 0.0, 6.0, 3.0))
    expected = behaviour(WALDO, *stays)
    assert expected.count("greeting")["in time"] == 1
    assert behaviour(replace(WALDO, nodes=(node,)), *stays) == expected


def test_a_person_outside_of_the_view_of_a_head_that_turns_stays():
    """The head looks elsewhere for three seconds while the person waits: the time to the offer goes on."""
    looks = [
        replace(
            found(
                *([] if aside else [msgspec.structs.replace(seen(distance=2.0, track="t1"), bearing_rad=0.0)]),
                number=number,
            ),
            camera_yaw_rad=1.2 if aside else 0.0,
            camera_hfov_rad=1.0,
        )
        for number in range(120)
        for aside in [40 <= number < 70]
    ]
    truth = story(12, ("p", 0, 12, 2.0))
    assert counts(truth, looks, "offer") == {"in time": 1}
    still = [replace(look, camera_yaw_rad=None, camera_hfov_rad=None) for look in looks]
    assert counts(truth, still, "offer") != {"in time": 1}


def test_evaluations_know_the_direction_of_a_camera_that_turns():
    images = BagImages("data/synthetic/turning_tune", "/camera/image_raw/compressed")
    pipeline = EvaluatedPipeline(PipelineSettings("hog"), images, recording=False)
    looks = [pipeline.find(each.bgr(), each) for each in islice(images.read(), 0, 70, 12)]
    yaws = [look.camera_yaw_rad for look in looks]
    assert None not in yaws
    assert len(set(yaws)) > 2
    assert all(look.camera_hfov_rad for look in looks)
