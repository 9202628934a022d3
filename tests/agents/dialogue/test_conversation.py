from __future__ import annotations

import time

import pytest

from socialbot.agents.dialogue import (
    Answer,
    Ask,
    Confirm,
    Conversation,
    Converse,
    Intent,
    Policy,
    Question,
    Respond,
    Script,
    conversation_rules,
    heard,
    speaks,
    turn,
)
from socialbot.bdi import Action, Engine, Goal, Record, variables
from socialbot.core.messages import HeardSpeech, SpeechStatus, VoiceActivity
from socialbot.testing import SECOND, ManualClock, run_engine

Who, What, Slots, Place, _ = variables("Who What Slots Place _")
BOTH = {"en": ["yes"], "de": ["ja"]}
PLACES = {
    "library": {"en": ["library"], "de": ["Bibliothek"]},
    "lab": {"en": ["lab"], "de": ["Labor"]},
}
SENTENCES = ("offer", "which", "right", "way", "repair", "way_out", "one_moment", "welcome")
SCRIPT = Script(
    [
        Intent("yes", phrases=BOTH, only_expected=True),
        Intent("no", phrases={"en": ["no"], "de": ["nein"]}, only_expected=True),
        Intent("place", ("place",), {"en": ["[the] {place}"], "de": ["[die|das] {place}"]}, only_expected=True),
        Intent("directions", ("place",), {"en": ["where is [the] {place}"], "de": ["wo ist [die|das] {place}"]}),
        Intent("thanks", phrases={"en": ["thank you"], "de": ["danke"]}),
    ],
    {"place": PLACES},
    [
        Question("offer", ("yes", "no"), tries=1),
        Question("which", ("place", "directions"), tries=2),
        Question("right", ("yes", "no", "place")),
    ],
    {name: dict.fromkeys(("en", "de"), f"{name} {{0}}" if name in ("way", "right") else name) for name in SENTENCES},
)


class go(Goal):  # noqa: N801 - a goal of the tests
    """Run a goal and note what it binds."""


class note(Action):  # noqa: N801 - an action of the tests
    """Note arguments."""

    def execute(self, *what: object) -> None:
        self.engine.robot.notes.append(what)


RULES = (
    Respond(Who, "yes", _) >> [Ask(Who, "which", (), What, Slots), Respond(Who, What, Slots)],
    Respond(Who, "no", _) >> [],
    Respond(Who, "place", (Place,)) >> [Answer(Who, "way", (Place,))],
    Respond(Who, "directions", (Place,)) >> [Answer(Who, "way", (Place,))],
    Respond(Who, "thanks", _) >> [Answer(Who, "welcome", ())],
    go("ask") >> [Ask("ann", "offer", (), What, Slots), note(What, Slots)],
    -go("ask") >> [note("failed")],
    go("confirm") >> [Confirm("ann", "right", ("library",)), note("confirmed")],
    -go("confirm") >> [note("not confirmed")],
)


class Robot:
    """Robot whose utterances take a second."""

    def __init__(self, **policy: float) -> None:
        self.said: list[str] = []
        self.notes: list[tuple[object, ...]] = []
        self.records: list[Record] = []
        self.engine = Engine("robot", ManualClock(), robot=self, sink=self.records.append)
        self.here: list[str] = []
        self.conversation = Conversation(
            self.engine,
            SCRIPT,
            present=lambda: self.here,
            policy=Policy(**policy),  # type: ignore[arg-type]
        )
        self.state = "finished"
        self.engine.add_rules(*RULES, *conversation_rules(self.conversation))

    def utter(self, action, person, situation, text, language):
        self.said.append(f"{person}: {text}" if language == "en" else f"{person} ({language}): {text}")
        identity = f"say-{action.id}"
        self.engine.timers.after(1.0, lambda: self.status(identity))
        return identity

    def status(self, identity: str) -> None:
        self.conversation.note(SpeechStatus(stamp=0, utterance_id=identity, state=self.state, text=""))  # type: ignore[arg-type]

    def hear(
        self, person: str, text: str, language: str = "en", confidence: float = 0.9, alternatives: tuple[str, ...] = ()
    ) -> None:
        now = self.engine.clock.now()
        self.conversation.hear(
            HeardSpeech(
                stamp=now, start=now, text=text, alternatives=alternatives, language=language, confidence=confidence,
                person=person,
            )
        )  # fmt: skip
        self.run(0.1)

    def voice(self, voice: str, active: bool, person: str = "") -> None:
        now = self.engine.clock.now()
        self.conversation.activity(VoiceActivity(stamp=now, active=active, voice=voice, person=person))

    def run(self, seconds: float = 3.0) -> None:
        run_engine(self.engine, seconds)

    def beliefs(self) -> set[str]:
        return {str(one.belief) for one in self.engine.beliefs}


def test_what_is_heard_becomes_a_belief_with_its_cause():
    robot = Robot()
    robot.run(5.0)
    robot.hear("ann", "Where's the libary?")
    assert heard("ann", "directions", ("library",)) in robot.engine.beliefs
    assert speaks("ann", "en") in robot.engine.beliefs
    percepts = [one for one in robot.records if one.kind == "percept"]
    assert percepts[0].cause == f"heard-{5 * SECOND}"
    assert "recognized with a confidence of 0.90, matches 'where is [the] {place}' in en by 96 %" in percepts[0].what
    robot.hear("ann", "Thank you!")
    assert [one for one in robot.beliefs() if one.startswith("heard")] == ['heard("ann", "thanks", [])']
    robot.run()
    assert robot.said == ["ann: way library", "ann: welcome"]


def test_the_same_sentence_twice_is_heard_twice():
    robot = Robot()
    for _ in range(2):
        robot.hear("ann", "Thank you")
        robot.run()
    assert robot.said == ["ann: welcome"] * 2


def test_each_person_is_answered_in_their_language():
    robot = Robot()
    robot.hear("ann", "Where is the library?")
    robot.run()
    robot.hear("bob", "Wo ist die Bibliothek?", "de")
    robot.run()
    robot.hear("bob", "Danke", "en")  # the recognizer errs, but Bob speaks German
    assert 'speaks("bob", "de")' in robot.beliefs()
    assert 'heard("bob", "thanks", [])' in robot.beliefs()
    robot.run()
    assert robot.said == ["ann: way library", "bob (de): way Bibliothek", "bob (de): welcome"]


def test_a_language_that_is_not_declared_is_tried_in_all():
    robot = Robot()
    robot.hear("ann", "Wo ist das Labor?", "nl")
    assert 'heard("ann", "directions", ["lab"])' in robot.beliefs()


def test_ask_binds_the_reply():
    robot = Robot()
    robot.engine.achieve(go("ask"))
    robot.run(2.0)
    assert robot.said == ["ann: offer"]
    robot.hear("ann", "Yes")
    assert robot.notes == [("yes", ())]
    assert not {one for one in robot.beliefs() if one.startswith(("asked", "replied"))}


def test_ask_fails_after_a_silence_and_asks_as_often_as_declared():
    robot = Robot()
    robot.engine.achieve(go("ask"))
    robot.run(20.0)
    assert robot.said == ["ann: offer"]
    assert robot.notes == [("failed",)]
    robot.engine.achieve(Converse("ann", "which", ()))
    robot.run(40.0)
    assert robot.said[1:] == ["ann: which"] * 2
    assert not {one for one in robot.beliefs() if one.startswith(("asked", "turn"))}


def test_a_reply_that_is_not_understood_is_repaired_until_the_way_out():
    robot = Robot(repairs=2)
    robot.engine.achieve(go("ask"))
    for _ in range(3):
        robot.run(4.0)
        robot.hear("ann", "Purple elephants")
    robot.run(4.0)
    assert robot.said == ["ann: offer", "ann: repair", "ann: offer", "ann: repair", "ann: offer", "ann: way_out"]
    assert robot.notes == [("failed",)]


def test_a_repaired_question_can_be_answered():
    robot = Robot()
    robot.engine.achieve(go("ask"))
    robot.run(2.0)
    robot.hear("ann", "Purple elephants")
    robot.run(4.0)
    robot.hear("ann", "no")
    assert robot.notes == [("no", ())]


def test_sentences_that_are_not_understood_are_repaired_then_ignored_until_one_is():
    robot = Robot(repairs=2)
    for _ in range(5):
        robot.hear("ann", "Purple elephants")
        robot.run()
    assert robot.said == ["ann: repair", "ann: repair", "ann: way_out"]
    robot.hear("ann", "Thank you")
    robot.run()
    robot.hear("ann", "Purple elephants")
    robot.run()
    assert robot.said[3:] == ["ann: welcome", "ann: repair"]


@pytest.mark.parametrize(
    ("text", "reply"),
    [
        ("Thank you", "welcome"), ("Oh, thank you.", "welcome"), ("Thank you for the purple elephants", "repair"),
        ("elephants", "repair"),
    ],
)  # fmt: skip
def test_speech_of_low_confidence_is_only_understood_as_a_whole(text, reply):
    robot = Robot()
    robot.hear("ann", text, confidence=0.2)
    robot.run()
    assert robot.said == [f"ann: {reply}"]


def test_no_alternative_is_read_that_lacks_a_negation():
    robot = Robot()
    robot.hear("ann", "Don't go to the library", alternatives=("Go to the library", "Where is the library?"))
    robot.run()
    assert robot.said == ["ann: repair"]


def test_an_alternative_is_read_if_the_text_is_not_understood():
    robot = Robot()
    robot.hear("ann", "wears the library", alternatives=("Purple elephants", "Where is the library?", "Thank you"))
    robot.run()
    assert robot.said == ["ann: way library"]
    reasons = [each.what for each in robot.records if each.kind == "percept"]
    assert "'wears the library', recognized with a confidence of 0.90, or 'Where is the library?'" in reasons[0]
    robot.hear("ann", "Thank you", alternatives=("Where is the library?",))
    robot.run()
    assert robot.said[-1] == "ann: welcome"


def test_the_reply_belongs_to_the_person_who_was_asked():
    robot = Robot()
    robot.engine.achieve(Converse("ann", "offer", ()))
    robot.run(2.0)
    robot.hear("bob", "Where is the lab?")
    robot.run(2.0)
    assert robot.said == ["ann: offer", "bob: one_moment"]
    robot.hear("bob", "Yes")  # not asked, so it is no reply
    robot.run(1.0)
    robot.hear("ann", "No")
    robot.run()
    assert robot.said == ["ann: offer", "bob: one_moment", "bob: way lab"]


def test_a_waiting_person_is_served_with_the_last_request_and_acknowledged_once():
    robot = Robot()
    robot.engine.achieve(Converse("ann", "offer", ()))
    robot.run(2.0)
    robot.hear("bob", "Where is the lab?")
    robot.hear("bob", "Where is the library?")
    robot.run(2.0)
    robot.hear("ann", "No")
    robot.run()
    assert robot.said == ["ann: offer", "bob: one_moment", "bob: way library"]


def test_a_question_does_not_forbid_another_topic():
    robot = Robot()
    robot.engine.achieve(Converse("ann", "which", ()))
    robot.run(2.0)
    robot.hear("ann", "Thank you")
    robot.run(2.0)
    robot.hear("ann", "the lab")
    robot.run(2.0)
    assert robot.said == ["ann: which", "ann: welcome", "ann: way lab"]


def test_the_agent_never_speaks_over_a_person():
    robot = Robot()
    robot.voice("v1", True, "bob")
    robot.hear("ann", "Thank you")
    robot.run(5.0)
    assert robot.said == []
    robot.voice("v1", False)
    robot.run(0.1)
    assert robot.said == ["ann: welcome"]


def test_a_voice_without_an_end_does_not_silence_the_agent():
    robot = Robot(longest_speech_s=5.0)
    robot.voice("v1", True)
    robot.hear("ann", "Thank you")
    robot.run(4.0)
    assert robot.said == []
    robot.run(2.0)
    assert robot.said == ["ann: welcome"]


def test_the_person_of_a_voice_may_become_known_while_it_speaks():
    robot = Robot()
    robot.voice("v1", True)
    robot.voice("v2", True, "bob")
    robot.voice("v1", True, "ann")
    robot.run(0.1)
    assert {one for one in robot.beliefs() if one.startswith("talks")} == {'talks("ann")', 'talks("bob")'}
    robot.voice("v1", False)
    robot.voice("v2", False)
    robot.run(0.1)
    assert not {one for one in robot.beliefs() if one.startswith("talks")}


def test_an_end_without_a_voice_ends_all_voices():
    robot = Robot()
    robot.voice("v1", True, "ann")
    robot.voice("v2", True, "bob")
    robot.voice("", False)
    robot.run(0.1)
    assert not {one for one in robot.beliefs() if one.startswith("talks")}


def test_a_question_waits_while_the_person_is_speaking():
    robot = Robot()
    robot.engine.achieve(go("ask"))
    robot.run(8.5)
    robot.voice("v1", True)
    robot.run(4.0)
    robot.voice("v1", False, "ann")
    robot.hear("ann", "yes")
    assert robot.notes == [("yes", ())]


@pytest.mark.parametrize(
    ("reply", "notes", "more"),
    [
        ("yes", [("confirmed",)], []),
        ("no", [("not confirmed",)], []),
        ("no, not the library", [("not confirmed",)], []),
        ("no, the lab", [("not confirmed",)], ["ann: way lab"]),
    ],
)
def test_confirm(reply, notes, more):
    robot = Robot()
    robot.engine.achieve(go("confirm"))
    robot.run(2.0)
    robot.hear("ann", reply)
    robot.run(2.0)
    assert robot.said == ["ann: right library", *more]
    assert robot.notes == notes


@pytest.mark.parametrize("state", ["failed", "expired", "replaced"])
def test_an_utterance_that_is_not_spoken_fails_its_goal(state):
    robot = Robot()
    robot.state = state
    robot.engine.achieve(go("ask"))
    robot.run(3.0)
    assert robot.notes == [("failed",)]
    assert not {one for one in robot.beliefs() if one.startswith("asked")}


def test_people_are_forgotten_after_a_while():
    robot = Robot(forget_s=30.0)
    for number in range(5):
        robot.hear(f"p{number}", "Thank you")
        robot.run(10.0)
    robot.run(40.0)
    assert robot.beliefs() == set()
    assert robot.conversation.last_heard == {}
    assert robot.conversation.last_said("p0") is None


def test_a_turn_ends_in_any_case():
    robot = Robot(longest_turn_s=20.0)
    robot.engine.believe(turn("ann"))
    robot.hear("bob", "Thank you")
    robot.run(10.0)
    assert robot.said == ["bob: one_moment"]
    robot.run(15.0)
    assert robot.said == ["bob: one_moment", "bob: welcome"]


def test_the_speaker_is_who_was_asked_or_the_only_person_present():
    robot = Robot()
    robot.here = ["ann"]
    robot.hear("", "Thank you")
    robot.run()
    robot.here = ["ann", "bob"]
    robot.hear("", "Thank you")
    robot.run()
    robot.engine.achieve(go("ask"))
    robot.run(2.0)
    robot.hear("", "yes")
    assert robot.said == ["ann: welcome", "somebody: welcome", "ann: offer"]
    assert robot.notes == [("yes", ())]


LONG = ("a. " * 3333, "where is the " * 769, "x" * 10_000, "no " * 3333, "library " * 1250)


@pytest.mark.parametrize("text", LONG)
def test_the_longest_sentence_with_all_alternatives_is_read_in_time(text):
    robot = Robot()
    alternatives = tuple(f"{number} {text}"[:10_000] for number in range(100))
    begun = time.process_time()
    robot.hear("ann", text[:10_000], "xx", alternatives=alternatives)
    run_engine(robot.engine, 1.0)
    assert time.process_time() - begun < 3.0


def test_a_likely_alternative_of_a_long_sentence_is_read():
    robot = Robot()
    robot.hear("ann", "where is the " * 769, alternatives=("where is the library", *("no " * 3333,) * 99))
    run_engine(robot.engine, 3.0)
    assert robot.said == ["ann: way library"]
