from __future__ import annotations

import io
import itertools
import math

import pytest
from rich.console import Console

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import (
    ActionRequest,
    HeadCommand,
    JointTrajectory,
    Message,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    TraceRecord,
)
from socialbot.runs.console import Display, people_text

START = nanoseconds(100.0)


def at(seconds: float) -> int:
    return START + nanoseconds(seconds)


def person(distance: float | None, degrees: float | None = 0.0) -> PersonDetection:
    bearing = None if degrees is None else math.radians(degrees)
    return PersonDetection(x=0, y=0, w=1, h=1, score=1.0, distance_m=distance, bearing_rad=bearing)


def seen(seconds: float, *persons: PersonDetection) -> PersonDetections:
    return PersonDetections(stamp=at(seconds), frame_id="camera", width=640, height=480, persons=persons)


def record(seconds: float, kind: str, what: str, **detail: object) -> TraceRecord:
    return TraceRecord(stamp=at(seconds), id="1", source="waldo", kind=kind, what=what, detail=dict(detail))


def head(seconds: float, pan: float, tilt: float) -> JointTrajectory:
    return JointTrajectory(
        stamp=at(seconds),
        joint_names=("pan", "tilt"),
        positions=(math.radians(pan), math.radians(tilt)),
        velocities=(0.0, 0.0),
        duration_s=0.54,
    )


def shown(*messages: Message, terminal: bool = False) -> list[str]:
    """What the display prints, line by line."""
    out = io.StringIO()
    console = Console(file=out, width=100, force_terminal=terminal, color_system=None)
    with Display(console, start=START, until=at(20.0)) as display:
        for message in messages:
            display.show("/topic", message)
    return out.getvalue().splitlines()


@pytest.mark.parametrize(
    ("message", "line"),
    [
        (seen(1.25, person(3.1, 4), person(1.0)), "   1.25 s  sees     2 people: 1.0 m ahead, 3.1 m 4° left"),
        (record(2.0, "belief", 'personDetected("Yes")'), '   2.00 s  believes personDetected("Yes")'),
        (record(2.0, "goal", "GreetPeople()"), "   2.00 s  wants    GreetPeople()"),
        (record(2.0, "action", 'speak("greeting")'), '   2.00 s  does     speak("greeting")'),
        (record(2.0, "failure", "go()", reason="no applicable plan"), "   2.00 s  fails    go(): no applicable plan"),
        (record(2.0, "failure", "go()", reason="failed", message="no cup"), "   2.00 s  fails    go(): no cup"),
        (SpeechStatus(stamp=at(3), utterance_id="1", state="started", text="Hi!"), '   3.00 s  says     "Hi!"'),
        (
            SpeechStatus(stamp=at(3), utterance_id="1", state="failed", text="Hi!", detail="no voice"),
            '   3.00 s  fails    to say "Hi!": failed no voice',
        ),
        (HeadCommand(stamp=at(4), mode="track"), "   4.00 s  head     follows people"),
        (HeadCommand(stamp=at(4), mode="centre"), "   4.00 s  head     looks straight on"),
        (HeadCommand(stamp=at(4), mode="look", pan_rad=0.5, tilt_rad=-0.1), "   4.00 s  head     looks at 29°, -6°"),
        (head(123.4, 20, -0.2), " 123.40 s  head     turns to 20°, 0° in 0.5 s"),
    ],
)
def test_each_thing_that_happens_is_a_line(message, line):
    assert shown(message) == [line]


@pytest.mark.parametrize(
    "message",
    [
        record(1.0, "plan", "+p()"),
        record(1.0, "achieved", "go()"),
        SpeechStatus(stamp=at(1), utterance_id="1", state="finished", text="Hi!"),
        SpeechStatus(stamp=at(1), utterance_id="1", state="waiting", text="Hi!"),
        ActionRequest(stamp=at(1), id="1", agent="waldo", name="speak"),
    ],
)
def test_what_would_be_said_twice_or_interests_nobody_is_left_out(message):
    assert shown(message) == []


def test_who_is_seen_is_told_when_the_number_changes_but_at_most_once_a_second():
    flickering = [seen(tenth / 10, *[person(2.0)] * (tenth % 2)) for tenth in range(31)]
    told = [float(line.split()[0]) for line in shown(*flickering)]
    assert 2 <= len(told) <= 4
    assert all(later - earlier >= 0.99 for earlier, later in itertools.pairwise(told))
    assert len(shown(*(seen(tenth / 10, person(2.0)) for tenth in range(50)))) == 1


def test_markup_in_a_text_is_no_markup():
    assert shown(record(0.0, "action", 'speak("[bold]hi[/bold] [/red]")'))[0].endswith(
        'speak("[bold]hi[/bold] [/red]")'
    )


def test_a_long_text_stays_on_one_line():
    assert len(shown(record(0.0, "action", "x" * 300))) == 1


def test_a_terminal_shows_the_present_moment_as_well():
    text = "\n".join(shown(seen(5.0, person(2.0, -30)), head(10.0, 15, 0), terminal=True))
    assert "sees     1 person: 2.0 m 30° right" in text
    assert "head 15°, 0°" in text
    assert "━━━━━━━━━━╌╌╌╌╌╌╌╌╌╌" in text


def test_people_are_named_from_near_to_far():
    assert people_text([]) == "nobody"
    assert people_text([person(2.04)]) == "1 person: 2.0 m ahead"
    assert people_text([person(None, None), person(5, -10), person(2, 0.4)]) == (
        "3 people: 2.0 m ahead, 5.0 m 10° right, somewhere ahead"
    )
