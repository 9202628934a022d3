from __future__ import annotations

from dataclasses import replace

from evaluation.faults_deaths import PASS_S, Judged, Kill, Pass, Witness, deeds, judge, passes
from socialbot.core.clock import SECOND
from socialbot.core.messages import ActionRequest, CameraInfo, Health, PersonDetections

LENGTH = round(PASS_S * SECOND)
USUAL = ["greeting", "offer", "stayIdle"]


def act(at_s: float, what: str) -> ActionRequest:
    name, arguments = ("speak", (what, "...")) if what in ("greeting", "offer") else (what, ())
    return ActionRequest(stamp=round(at_s * SECOND), id="i", agent="waldo", name=name, arguments=arguments)


def witness(*deeds: tuple[float, str]) -> Witness:
    return Witness(actions=[act(*deed) for deed in deeds])


def test_a_camera_that_starts_again_breaks_a_pass_off():
    found = passes([0, 3 * LENGTH // 2], 3 * LENGTH)
    assert [(one.begin, one.whole) for one in found] == [
        (0, True), (LENGTH, False), (3 * LENGTH // 2, True), (5 * LENGTH // 2, False),
    ]  # fmt: skip


def test_actions_of_a_pass_are_listed_in_order():
    assert deeds(witness((1, "greeting"), (4, "offer"), (9, "stayIdle"), (20, "greeting")).actions, 0, LENGTH) == USUAL


def judged(did: list[tuple[float, str]], *kills: Kill, whole: bool = True) -> Judged:
    return replace(judge([Pass(0, LENGTH, whole)], witness(*did), kills, USUAL), odd=())


def test_differences_between_passes_are_reported():
    found = judge([Pass(0, LENGTH, True)], witness((1.0, "greeting"), (2.0, "attend")), [KILL], ["stayIdle"])
    assert found.odd == ()
    found = judge([Pass(0, LENGTH, True)], witness((1.0, "attend")), [KILL], USUAL)
    assert found.odd == ("attend (killed: person_detector)",)


KILL = Kill("person_detector", 2 * SECOND, 3 * SECOND)


def test_passes_without_a_gap_must_be_equal():
    usual = [(1.0, "greeting"), (4.0, "offer"), (9.0, "stayIdle")]
    assert judged(usual) == Judged(passes=1, clear=1)
    assert judged([*usual, (10.0, "attend")]) == Judged(passes=1, clear=1, changed=1)
    assert judged(usual[1:]) == Judged(passes=1, clear=1, changed=1, not_greeted=1)


def test_missing_messages_without_detections_are_no_gap():
    usual = [(1.0, "greeting"), (4.0, "offer"), (9.0, "stayIdle")]
    for node in ("speech", "head", "listener"):
        assert judged(usual[:2], Kill(node, 2 * SECOND, 3 * SECOND)) == Judged(passes=1, clear=1, changed=1)


def test_a_gap_may_add_idling_or_remove_an_offer_but_not_repeat_actions():
    rests = [(1.0, "greeting"), (2.4, "stayIdle"), (3.2, "attend"), (9.0, "stayIdle")]
    assert judged(rests, KILL) == Judged(passes=1)
    assert judged([*rests, (5.0, "greeting")], KILL) == Judged(passes=1, changed=1, greeted_twice=1)
    assert judged([*rests, (5.0, "offer"), (6.0, "offer")], KILL) == Judged(passes=1, changed=1, asked_twice=1)
    assert judged(rests[1:], KILL) == Judged(passes=1, changed=1, not_greeted=1)


def test_an_interrupted_pass_counts_only_for_repeated_actions():
    assert judged([], KILL, whole=False) == Judged()
    assert judged([(1.0, "greeting"), (2.0, "greeting")], KILL, whole=False) == Judged(greeted_twice=1)


def test_a_greeting_that_is_said_twice_counts_although_it_was_decided_once():
    seen = witness((1.0, "greeting"), (4.0, "offer"), (9.0, "stayIdle"))
    seen.greetings = [SECOND, 2 * SECOND]
    assert judge([Pass(0, LENGTH, True)], seen, [], USUAL).greeted_twice == 1


def test_a_node_is_back_when_it_is_well_and_does_its_work():
    seen = Witness()
    seen.note("/health", Health(stamp=5, node="person_detector", state="ok"))
    seen.note("/humans/bodies/detections", PersonDetections(stamp=4, frame_id="c", width=1, height=1, persons=()))
    assert not seen.is_back("person_detector", 4)
    seen.note("/humans/bodies/detections", PersonDetections(stamp=6, frame_id="c", width=1, height=1, persons=()))
    assert seen.is_back("person_detector", 4)
    assert not seen.is_back("person_detector", 5)
    assert not seen.is_back("head", 0)
    seen.note("/health", Health(stamp=7, node="head", state="failed"))
    assert not seen.is_back("head", 0)
    seen.note("/health", Health(stamp=8, node="head", state="degraded"))
    assert seen.is_back("head", 7)


def test_a_kill_affects_frames_until_the_belief_is_restored():
    assert KILL.took_s == 1.0
    assert KILL.touches(4 * SECOND, 5 * SECOND)
    assert not KILL.touches(5 * SECOND, 6 * SECOND)
    assert not KILL.touches(0, 2 * SECOND)
    assert Kill("head", 0, None).touches(10**15, 10**16)


def test_a_camera_is_noted_once():
    seen = Witness()
    for stamp in (1, 1, 2):
        seen.note("/camera/camera_info", CameraInfo(stamp=stamp, frame_id="c", width=1, height=1, k=(0.0,) * 9))
    assert seen.begun == [1, 2]
