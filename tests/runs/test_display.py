"""Terminal display of a run."""

from __future__ import annotations

import io
import itertools
import math
from typing import Any

import pytest
from rich.console import Console

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import (
    ActionRequest,
    HeadCommand,
    Health,
    HeardSpeech,
    JointTrajectory,
    Message,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    State,
    TraceRecord,
    Utterance,
)
from socialbot.deliberation.messages import ActionExecutionInfo, Desire, PlanExecutionInfo
from socialbot.graph.node import Graph, NodeConfig
from socialbot.runs.console import Display, people_text
from socialbot.speech.hearing import Hearing
from socialbot.speech.microphone import Microphone
from socialbot.speech.speaker import Speaker
from tests.runs.deliberating_runs import DETOUR, GRAPH

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


def shown(
    *messages: Message, terminal: bool = False, details: bool = True, health_of: Graph | None = None
) -> list[str]:
    """Return the lines of the display, by default with details."""
    out = io.StringIO()
    console = Console(file=out, width=100, force_terminal=terminal, color_system=None)
    with Display(console, start=START, until=at(20.0), details=details, health_of=health_of) as display:
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
        (HeardSpeech(stamp=at(3), start=at(2), text="Hi!"), '   3.00 s  hears    "Hi!"'),
        (HeardSpeech(stamp=at(3), start=at(2), text="Hi!", person="t1"), '   3.00 s  hears    t1: "Hi!"'),
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
def test_display_prints_a_line_per_event(message, line):
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
def test_display_omits_redundant_events(message):
    assert shown(message) == []


EARS = Graph(
    "ears",
    tuple(NodeConfig(kind.__name__.lower(), kind) for kind in (Microphone, Hearing, Speaker)),
    inputs=frozenset({"/speech/say"}),
)


def health(seconds: float, node: str, state: State, reason: str = "", *silent: str) -> Health:
    return Health(stamp=at(seconds), node=node, state=state, reason=reason, silent=silent)


def test_display_prints_what_a_node_of_a_live_graph_lacks():
    messages = [
        health(0.5, "hearing", "waiting", "unconnected: /audio"),
        health(1.0, "microphone", "failed", "no microphone; plug one in"),
        health(1.0, "speaker", "ok", "no sound device; connect one"),
        health(1.3, "microphone", "failed", "no microphone; plug one in"),
        health(2.0, "speaker", "ok"),
        health(3.0, "hearing", "waiting", "no message on /audio yet", "/audio"),
        health(3.0, "stranger", "failed", "nothing works"),
        health(4.0, "microphone", "ok"),
        health(5.0, "hearing", "degraded", "the microphone sends only zeros; unmute it"),
        health(6.0, "hearing", "ok", "a remark"),
        health(7.0, "speaker", "degraded", "no message on /x since 9:00", "/x"),
        health(8.0, "speaker", "failed", "unconnected: its cable"),
    ]
    assert shown(*messages, health_of=EARS) == [
        "   1.00 s  fails    microphone: no microphone; plug one in",
        "   1.00 s  notes    speaker: no sound device; connect one",
        "   4.00 s  works    microphone again",
        "   5.00 s  fails    hearing: the microphone sends only zeros; unmute it",
        "   6.00 s  works    hearing again",
        "   7.00 s  fails    speaker: no message on /x since 9:00",
        "   8.00 s  fails    speaker: unconnected: its cable",
    ]
    assert shown(*messages) == []


def test_times_count_from_the_first_line_until_there_is_a_record():
    out = io.StringIO()
    with Display(Console(file=out, width=100), health_of=EARS) as display:
        display.show("/health", health(1.0, "microphone", "failed", "no microphone"))
        display.show("/health", health(3.5, "microphone", "ok"))
        display.show("/trace", record(4.0, "goal", "GreetPeople()"))
    assert [line[:10] for line in out.getvalue().splitlines()] == ["   0.00 s ", "   2.50 s ", "   0.00 s "]


def test_display_prints_what_agents_do_and_no_more_without_details():
    moves = head(1.0, 15, 0), HeadCommand(stamp=at(2), mode="track"), seen(3.0, person(2.0))
    fails = record(4.0, "failure", "go()", reason="no applicable plan")
    assert shown(*moves, fails, details=False) == shown(fails)
    text = "\n".join(shown(*moves, terminal=True, details=False))
    assert "turns to" not in text
    assert "1 person: 2.0 m ahead   head 15°, 0°" in text


def test_display_prints_changes_of_the_person_count_at_most_once_a_second():
    flickering = [seen(tenth / 10, *[person(2.0)] * (tenth % 2)) for tenth in range(31)]
    told = [float(line.split()[0]) for line in shown(*flickering)]
    assert 2 <= len(told) <= 4
    assert all(later - earlier >= 0.99 for earlier, later in itertools.pairwise(told))
    assert len(shown(*(seen(tenth / 10, person(2.0)) for tenth in range(50)))) == 1


def test_display_escapes_markup():
    assert shown(record(0.0, "action", 'speak("[bold]hi[/bold] [/red]")'))[0].endswith(
        'speak("[bold]hi[/bold] [/red]")'
    )


def test_display_keeps_long_texts_on_one_line():
    assert len(shown(record(0.0, "action", "x" * 300))) == 1


def test_terminal_shows_persons_and_head_in_the_status_line():
    text = "\n".join(shown(seen(5.0, person(2.0, -30)), head(10.0, 15, 0), terminal=True))
    assert "sees     1 person: 2.0 m 30° right" in text
    assert "head 15°, 0°" in text
    assert "━━━━━━━━━━━━╌╌╌╌╌╌╌╌╌╌╌╌" in text


def test_people_text_lists_the_nearest_first():
    assert people_text([]) == "nobody"
    assert people_text([person(2.04)]) == "1 person: 2.0 m ahead"
    assert people_text([person(None, None), person(5, -10), person(2, 0.4)]) == (
        "3 people: 2.0 m ahead, 5.0 m 10° right, somewhere ahead"
    )


# Agents that deliberate


def story_shown(*messages: Message, terminal: bool = False) -> str:
    out = io.StringIO()
    console = Console(file=out, width=120, force_terminal=terminal, color_system=None, highlight=False)
    with Display(console, GRAPH) as display:
        for message in messages:
            display.show("/topic", message)
    return out.getvalue()


def info(seconds: float, agent: str, current: float, estimated: float, **more: Any) -> PlanExecutionInfo:
    return PlanExecutionInfo(
        stamp=nanoseconds(100.0 + seconds),
        agent_id=agent,
        target=Desire(name="be_home"),
        actions_exec_info=(ActionExecutionInfo(index=0, name="go", args=()),),
        current_time=current,
        estimated_deadline=estimated,
        **more,
    )


def test_display_prints_a_line_per_sentence_of_the_story():
    lines = story_shown(*DETOUR).splitlines()
    assert lines[0].split() == ["0.00", "s", "ann", "◆", "wants", "be_home", "within", "20", "s", "(desires.yaml)"]
    assert "   3.00 s  ann  ✗ gives up plan 1 for be_home" in lines
    assert "   7.00 s  ann  ✓ has reached be_home after 7.0 s" in lines
    assert len(lines) == 13


def test_terminal_shows_progress_and_current_steps():
    present = story_shown(*DETOUR[:9], info(3.0, "ann", 3.0, 6.0), terminal=True)
    assert "ann asks bob to help" in present
    assert "━" * 12 + "╌" * 12 in present


def test_display_ignores_other_messages():
    assert story_shown(Utterance(stamp=1, id="a", text="hello")) == ""
    assert story_shown(info(0.0, "ann", 0.0, 5.0)) == ""


def test_zero_is_the_first_record_of_the_run():
    out = io.StringIO()
    with Display(Console(file=out, width=100), details=True) as display:
        display.show("/health", Health(stamp=at(-9.0), node="camera", state="ok"))
        display.show("/seen", seen(0.0, person(2.0)))
        display.show("/trace", record(1.0, "belief", "visitor()"))
    assert [line.split()[0] for line in out.getvalue().splitlines()] == ["0.00", "1.00"]


def test_speech_is_shown_behind_its_action_in_whatever_order_topics_arrive():
    acts = record(1.0, "action", 'say("Hi!")')
    utterance = Utterance(stamp=at(1.0), id="say-1", text="Hi!", cause=acts.id)
    begun = SpeechStatus(stamp=at(1.01), utterance_id="say-1", state="started", text="Hi!")
    in_order = ['   1.00 s  does     say("Hi!")', '   1.01 s  says     "Hi!"']
    for messages in itertools.permutations((acts, utterance, begun)):
        assert shown(*messages) == in_order
    assert shown(begun, utterance) == in_order[1:]
    assert shown(begun, record(9.0, "belief", "b()"))[0] == in_order[1]


def test_exception_of_a_step_is_shown_with_its_kind_once_and_its_line():
    failed = record(1.0, "failure", "go()", reason="exception", message="KeyError: 'x'", where="agent.py:7")
    assert shown(failed) == ["   1.00 s  fails    go(): KeyError: 'x' (agent.py:7)"]


def test_equal_failures_in_a_row_are_counted():
    fails = [
        record(second, "failure", "Eyes", reason="TypeError", message="no distance", where="agent.py:7")
        for second in range(1, 9)
    ]
    later = record(9.0, "belief", "b()")
    assert shown(*fails, later) == [
        "   1.00 s  fails    Eyes: TypeError: no distance (agent.py:7)",
        "   8.00 s  fails    ... 7 more times",
        "   9.00 s  believes b()",
    ]
    assert shown(*fails) == shown(*fails, later)[:2]
