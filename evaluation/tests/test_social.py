"""The rules of `evaluation.social`, on schedules whose score is known."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from evaluation.social import TREE, WALDO, graph_of, main, play
from evaluation.social_policies import GreetOnSight, parties
from evaluation.social_rules import IN_TIME_S, MOST_JERK, Said, Score, score, visits_of
from socialbot.core.clock import SECOND
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.messages import CompressedImage, Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.robots.simulation.node import IMAGE_TOPIC
from socialbot.robots.simulation.people import Crowd, read_script
from socialbot.robots.simulation.place import load_place

SCRIPT = """
place: foyer
people:
  - id: ada
    enter: entrance
    legs:
      - {walk: robot_1, face: robot, aim: help}
      - {stand: 15, face: robot, aim: help}
      - {walk: entrance}
  - id: ben
    enter: office
    start: 30
    legs: [{walk: [3.0, -1.2], aim: company}, {talk: 12, to: eva, aim: company}, {walk: office}]
  - id: eva
    enter: corridor
    start: 30
    legs: [{walk: [3.0, -0.2], aim: company}, {talk: 12, to: ben, aim: company}, {walk: corridor}]
"""
UNTIL_S = 55.0
DETECTIONS = "/humans/bodies/detections"
STILL = np.array([(0.05 * step, 0.0, 0.0) for step in range(1100)])


@pytest.fixture(scope="module")
def crowd() -> Crowd:
    return Crowd(read_script(SCRIPT, where="script"), load_place("foyer"))


def scored(crowd: Crowd, *said: tuple[float, str], head: np.ndarray = STILL) -> Score:
    return score(crowd, [Said(time, key, 0.0) for time, key in said], head, UNTIL_S)


def test_a_visit_begins_near_the_robot_and_ends_with_the_stay(crowd):
    (visit,) = visits_of(crowd, UNTIL_S)
    assert visit.person == "ada"
    assert visit.wants_help
    assert 1.0 < visit.arrival - visit.begin < 4.0
    assert visit.end - visit.arrival == pytest.approx(15.0, abs=0.1)


def test_a_polite_robot_has_no_faults(crowd):
    (visit,) = visits_of(crowd, UNTIL_S)
    found = scored(crowd, (visit.arrival, "greeting"), (visit.arrival + 4, "offer"))
    assert (found.visits, found.in_time, found.twice, found.missed, found.interrupted, found.to_nobody) == (
        1,
        1,
        0,
        0,
        0,
        0,
    )
    assert found.offers_s == [pytest.approx(4.0)]
    assert found.conversations == 1


@pytest.mark.parametrize(
    ("said", "fault"),
    [
        ([(IN_TIME_S + 1, "greeting")], {"in_time": 0, "missed": 0}),
        ([], {"in_time": 0, "missed": 1}),
        ([(0.0, "greeting"), (3.0, "greeting")], {"in_time": 1, "twice": 1}),
        ([(30.0, "greeting")], {"interrupted": 1, "missed": 1}),
        ([(45.0, "greeting")], {"to_nobody": 1}),
        ([(30.0, "greeting"), (45.0, "greeting")], {"interrupted": 1, "to_nobody": 1}),
    ],
    ids=["late", "missed", "twice", "interrupted", "to nobody", "interrupted once"],
)
def test_each_fault_is_counted(crowd, said, fault):
    (visit,) = visits_of(crowd, UNTIL_S)
    found = scored(crowd, *((visit.arrival + after, key) for after, key in said))
    assert {name: getattr(found, name) for name in fault} == fault


def test_a_stare_and_jerks_are_measured(crowd):
    at = crowd.motions["eva"].where(43.0)
    assert at is not None
    staring = STILL.copy()
    staring[:, 1] = np.arctan2(at[1], at[0])
    assert scored(crowd, head=staring).stared_s > 5.0
    shaking = STILL.copy()
    shaking[:, 2] = 0.1 * (-1.0) ** np.arange(len(STILL))
    assert scored(crowd, head=shaking).criteria()["head jerk, rad/s3"] > 50
    assert scored(crowd).criteria()["head jerk, rad/s3"] == 0


@pytest.mark.slow
def test_policies_that_share_a_run_score_as_alone():
    pytest.importorskip("mujoco")
    pytest.importorskip("py_trees")
    together, *_ = parties()
    assert WALDO in together
    assert TREE in together
    shared = play(together, 1003)
    assert [one.policy for one in shared] == list(together)
    assert [one.failures for one in shared] == [0] * len(together)
    for one in shared:
        (alone,) = play((one.policy,), 1003)
        assert alone.score == one.score


def test_policies_meet_people_in_pictures_of_the_given_size():
    pytest.importorskip("mujoco")
    graph, _ = graph_of([WALDO], 1003, "camera", "160x120")
    runner = InlineRunner(graph, start=SECOND)
    shapes: list[tuple[int, ...]] = []

    def look(_: str, message: Message) -> None:
        assert isinstance(message, CompressedImage)
        picture = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        shapes.append(picture.shape)

    runner.tap(IMAGE_TOPIC, look)
    runner.start()
    runner.advance(SECOND + SECOND // 4)
    runner.close()
    assert shapes == [(120, 160, 3)] * 3


def test_a_wrong_size_is_an_error():
    with pytest.raises(ParameterError, match="--size: '640' is no size"):
        main(quick=True, size="640")


def test_a_policy_that_turns_the_head_says_so():
    assert ("random",) in parties()
    node = InlineRunner(Graph("policy", (NodeConfig("policy", GreetOnSight, {}),), inputs=frozenset({DETECTIONS})))
    with pytest.raises(ValueError, match="turns_head"):
        node.nodes["policy"].look("look", 0.5)  # type: ignore[attr-defined]


def test_an_offer_before_the_arrival_has_no_wait(crowd):
    (visit,) = visits_of(crowd, UNTIL_S)
    assert scored(crowd, (visit.begin + 0.2, "offer")).offers_s == [0.0]


@pytest.mark.parametrize(("key", "helped"), [("offer", 1), ("greeting", 0)])
def test_only_an_offer_helps_a_passer_by(key, helped):
    legs = "[{walk: [2.5, 0.0], aim: pass}, {walk: corridor, aim: pass}]"
    script = f"place: foyer\npeople: [{{id: uma, enter: entrance, legs: {legs}}}]"
    passing = Crowd(read_script(script, where="script"), load_place("foyer"))
    there = passing.motions["uma"].episodes[0].end
    found = score(passing, [Said(there, key, 0.0)], STILL, UNTIL_S)
    assert (found.passers, found.helped_passers, found.to_nobody) == (1, helped, 1 - helped)


def test_a_glance_is_no_stare(crowd):
    glances = np.array([(0.05 * step, 0.0 if step % 30 < 15 else 1.5, 0.0) for step in range(1100)])
    assert scored(crowd, head=STILL).stared_s > 0.0
    assert scored(crowd, head=glances).stared_s == 0.0


def test_the_worst_jerk_costs_no_more_than_its_criterion():
    assert Score(jerks=[100 * MOST_JERK]).points() == Score(jerks=[MOST_JERK]).points()


def test_without_py_trees_nothing_is_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "py_trees", None)
    with pytest.raises(InstallationError, match="py_trees is not installed"):
        main(quick=True)
