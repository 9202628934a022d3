from __future__ import annotations

import re
from xml.etree import ElementTree

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.report_gantt import Gantt
from socialbot.runs.story import Story, story_of
from tests.runs.deliberating_runs import DETOUR, PHRASES, desire, plan, plan_end, record, step

SVG = "{http://www.w3.org/2000/svg}"


def drawn(story: Story) -> ElementTree.Element:
    return ElementTree.fromstring(Gantt(story).svg())


def of_class(picture: ElementTree.Element, kind: str) -> list[ElementTree.Element]:
    return [group for group in picture.iter(f"{SVG}g") if kind in group.attrib.get("class", "").split()]


def title(group: ElementTree.Element) -> str:
    return group.findtext(f"{SVG}title") or ""


def test_every_plan_step_and_request_is_drawn():
    story = story_of(DETOUR, PHRASES)
    picture = drawn(story)
    assert len(of_class(picture, "plan")) == len(story.plans)
    assert len(of_class(picture, "step")) == len(story.steps)
    assert len(of_class(picture, "request")) == 2  # the arrow, and the news that it was reached


def test_bars_lie_where_their_times_are():
    gantt = Gantt(story_of(DETOUR, PHRASES))
    first = of_class(ElementTree.fromstring(gantt.svg()), "step")[0]
    assert (float(first.attrib["data-from"]), float(first.attrib["data-to"])) == (0.0, 2.5)
    bar = first.find(f"{SVG}rect")
    assert bar is not None
    assert float(bar.attrib["x"]) == 0.0
    assert abs(float(bar.attrib["width"]) - 2.5 * gantt.scale) < 2.0


def test_what_was_given_up_is_marked():
    picture = drawn(story_of(DETOUR, PHRASES))
    (given_up,) = of_class(picture, "failed")[:1]
    assert "the door is locked" in title(given_up)
    assert [line.attrib["class"] for line in picture.iter(f"{SVG}line")].count("turn") == 1


def test_bars_tell_what_was_planned():
    picture = drawn(story_of(DETOUR, PHRASES))
    assert "planned from 0.0 s to 2.0 s" in title(of_class(picture, "step")[0])


def test_steps_side_by_side_do_not_cover_each_other():
    calls = [f"(go ann a{number} b)" for number in range(3)]
    records = [
        plan(0, "ann", "x", 1, *(f"0.000: {call} [2.000]" for call in calls)),
        *(step(0, "ann", c) for c in calls),
    ]
    bars = [group.find(f"{SVG}rect") for group in of_class(drawn(story_of([*records, desire(5, "ann", "y")])), "step")]
    assert len({bar.attrib["y"] for bar in bars if bar is not None}) == 3


def test_the_lanes_of_those_who_want_something_of_their_own_come_first():
    asked = [msgspec.structs.replace(each, source="al") if each.source == "bob" else each for each in DETOUR]
    assert [name for name, _ in Gantt(story_of(asked)).names] == ["ann", "al"]
    assert [name for name, _ in Gantt(story_of((desire(0.0, "aa", "rest"), *DETOUR))).names] == ["ann", "aa", "bob"]


def test_names_and_reasons_are_text():
    awkward = story_of((plan(0, "a<b", "x&y", 1),))
    assert "x&y" in title(of_class(drawn(awkward), "plan")[0])


def test_an_empty_run_has_an_empty_chart():
    assert not re.search('class="(plan|step|request)', Gantt(story_of([])).svg())


def test_plans_side_by_side_do_not_cover_each_other():
    def begun(seconds: float, number: int) -> TraceRecord:
        return record(
            seconds, "boss", "plan_start", f"room{number}", plan=number, steps=[], makespan_s=None, beside=True
        )

    story = story_of((begun(0, 1), begun(1, 2), plan_end(2, "boss", "room1", 1, "succeeded"), begun(3, 3)))
    assert [each.outcome for each in story.plans] == ["succeeded", "", ""], "none is taken to be lost"
    bands = [band.find(f"{SVG}rect") for band in of_class(drawn(story), "plan")]
    ys = [float(band.attrib["y"]) for band in bands if band is not None]
    assert len(ys) == 3
    assert len(set(ys)) == 2, "the third one follows the first"
    assert "planned" not in title(of_class(drawn(story), "plan")[0])


def test_words_of_weight_are_arrows():
    def said(weight: str, receiver: str) -> TraceRecord:
        detail = {"receiver": receiver, "performative": "inform", "content": "Plan", "mission": "", "weight": weight}
        return msgspec.structs.replace(record(1, "ann", "said", "speaks"), detail=detail)

    told = (desire(0, "ann", "x"), desire(0, "bob", "y"), *(said(*each) for each in (("plan", "bob"), ("", "bob"))))
    story = story_of((*told, said("problem", "nobody")))
    assert [word.weight for word in story.words] == ["plan", "", "problem"]
    [arrow] = of_class(drawn(story), "request")
    assert title(arrow) == "ann speaks"


def test_lanes_are_in_the_order_of_their_numbers():
    story = story_of(desire(0, f"robot_{number}", "x") for number in (10, 9, 1))
    assert Gantt(story).agents == ["robot_1", "robot_9", "robot_10"]
