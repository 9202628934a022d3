from __future__ import annotations

import re
from pathlib import Path

import pytest

from socialbot.agents.reception import demo
from socialbot.bags.reader import open_bag
from socialbot.core.clock import SECOND
from socialbot.core.messages import AudioData, HeardSpeech
from socialbot.runs.asking import answer
from socialbot.runs.folder import open_run
from tests.system.running import socialbot

ANSWER = "23 seconds ago I greeted you because you paid attention to me; 24 seconds ago nobody was near me."
SAID = [
    "Hello! Nice to see you.",
    "Can I help you with anything?",
    "The library is on the second floor. Take the lift and turn left.",
    ANSWER,
    "You are welcome.",
]


def test_the_bag_has_pictures_sound_and_recognized_speech():
    graph, path = demo.reception("recorded")
    assert "/humans/voices/speech" in graph.inputs
    assert sum(file.stat().st_size for file in path.iterdir()) < 1_000_000
    with open_bag(path) as bag:
        assert {name: bag.topic(name).count for name in ("/camera/image_raw/compressed", "/audio")} == {
            "/camera/image_raw/compressed": 230,
            "/audio": 230,
        }
        topics = {name: name for name in ("/audio", "/humans/voices/speech")}
        messages = [message for _, message in bag.messages(topics)]
    sound = [one for one in messages if isinstance(one, AudioData)]
    speech = [one for one in messages if isinstance(one, HeardSpeech)]
    assert [one.text for one in speech] == [
        "Yes, please. Where is the library?",
        "Why did you greet me?",
        "Thank you very much.",
    ]
    loud = [one.stamp for one in sound if any(one.samples)]
    assert all(any(one.start <= stamp <= one.stamp for stamp in loud) for one in speech)
    assert all(any(one.start - SECOND // 5 <= stamp <= one.stamp for one in speech) for stamp in loud)


def test_speech_is_recognized_live_if_that_is_installed(monkeypatch):
    monkeypatch.setattr(demo, "can_hear", lambda: True)
    graph, _ = demo.reception()
    assert "hearing" in [node.name for node in graph.nodes]
    assert graph.inputs >= {"/audio"}
    assert "/humans/voices/speech" not in graph.inputs
    monkeypatch.setattr(demo, "can_hear", lambda: False)
    assert demo.reception()[0] == demo.reception("recorded")[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        ("--recognition", "recorded"),
        ("--recognition", "recorded", "--runner", "ros"),
        pytest.param(
            ("--recognition", "live"),
            marks=pytest.mark.skipif(not demo.can_hear(), reason="needs speech recognition (make hear)"),
        ),
        pytest.param(
            ("--recognition", "live", "--runner", "ros"),
            marks=pytest.mark.skipif(not demo.can_hear(), reason="needs speech recognition (make hear)"),
        ),
    ],
    ids=" ".join,
)
def test_the_demo_decides_the_same_inline_over_dds_and_with_recognition(options, tmp_path: Path):
    folder = tmp_path / "run"
    printed = socialbot("demo", "reception", "--no-video", "--no-cache", "--out", str(folder), *options)
    run = open_run(folder)
    dialogue = [record for record in run.history if record.kind in ("hearing", "utterance")]
    shown = printed.stdout.partition("The dialogue:\n")[2].splitlines()
    assert [line.partition(" s  ")[2].split(maxsplit=1) for line in shown[: len(dialogue)]] == [
        [record.detail.get("person") or "person" if record.kind == "hearing" else "robot", record.what]
        for record in dialogue
    ]
    asked = next(line for line in shown if line.startswith("Ask about it: "))
    assert answer(run, asked.split('"')[1]).known
    actions = [record for record in run.history if record.kind == "action"]
    assert [record.what for record in actions] == [
        "stayIdle()",
        'tell("greeting", "t1", [])',
        'tell("offer", "t1", [])',
        'tell("way_library", "t1", [])',
        'explain("t1")',
        'tell("welcome", "t1", [])',
        "stayIdle()",
    ]
    said = [record.what for record in run.history if record.kind == "utterance"]
    if "ros" in options:  # The question may be answered later: the ages in the answer are those of its own run.
        now, ages = actions[4].stamp, re.findall(r"\d+", said[3])
        since = [(now - actions[index].stamp) / SECOND for index in (1, 0)]
        assert [int(age) for age in ages] == pytest.approx(since, abs=0.75)  # rounded, and of the frame before
        said[3] = ANSWER if re.sub(r"\d+", "", said[3]) == re.sub(r"\d+", "", ANSWER) else said[3]
    assert said == SAID
    heard = [record for record in run.history if record.kind == "hearing"]
    assert len(heard) == 3
    assert all(run.sound(f"{record.id}.wav") for record in heard)
