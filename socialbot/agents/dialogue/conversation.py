"""Conversation of an agent: what is heard becomes beliefs, and replies are goals.

Beliefs name people by their id. The plans of `conversation_rules` handle turns, repair and waiting people; the plans of
the agent achieve `Respond`, and use `Answer`, `Ask`, `Confirm` and `Converse`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import msgspec

from socialbot.agents.dialogue.intents import UNKNOWN, Reading, negations_in
from socialbot.agents.dialogue.script import ANY, Question, Script
from socialbot.bdi import (
    Action,
    Belief,
    Engine,
    Goal,
    Inference,
    LongAction,
    Plan,
    Sensed,
    Sensor,
    atomic,
    compute,
    drop,
    error_msg,
    fail,
    for_each,
    variables,
    wait_for,
)
from socialbot.core.limits import READ_ALTERNATIVES
from socialbot.core.messages import HeardSpeech, SpeechStatus, VoiceActivity

SOMEBODY = "somebody"
"""Person of speech whose speaker is unknown."""

SILENCE = "silence"
"""Reply to a question that nobody answered."""

SAID = ("finished", "interrupted")
FAILED = ("replaced", "expired", "failed")
"""Final states of utterances."""


class heard(Belief):
    """This person has said a sentence with this intent and these slots; the last one of each person is kept."""


class speaks(Belief):
    """This person speaks this language (ISO 639-1)."""


class talks(Belief):
    """This person is speaking now."""


class turn(Belief):
    """The agent is in a conversation with this person; others wait."""


class asked(Belief):
    """This question to this person is open."""


class replied(Belief):
    """This person has answered the open question with this intent and these slots."""


class waits(Belief):
    """This person has said this during the turn of another person, and gets a response afterwards."""


class misheard(Belief):
    """So many sentences of this person in a row were not understood."""


class Respond(Goal):
    """Respond(Person, Intent, Slots): respond to what a person has said. The plans of the agent achieve it."""


class Answer(Goal):
    """Answer(Person, Situation, Arguments): say the sentence for a situation, once nobody is speaking, to its end."""


class Ask(Goal):
    """Ask(Person, Question, Arguments, Intent, Slots): ask a question; the last two are bound to the reply."""


class Confirm(Goal):
    """Confirm(Person, Question, Arguments): achieved by "yes", or by a reply with the same arguments.

    Another reply fails it; a correction is responded to.
    """


class Converse(Goal):
    """Converse(Person, Question, Arguments): ask a question and respond to the reply, in one turn."""


class Turn(Goal):
    """Turn(Person, Intent, Slots): take the turn of a person and respond."""


class Repair(Goal):
    """Repair(Person): react to a sentence that was not understood."""


class Pose(Goal):
    """Pose(Person, Question, Arguments, Try, Intent, Slots): one try of `Ask`."""


class Listen(Goal):
    """Listen(Person, Question, Intent, Slots): wait for the reply."""


class Judge(Goal):
    """Judge(Person, Question, Arguments, Try, Reply, Its slots, Intent, Slots): accept the reply or try again."""


class Verdict(Goal):
    """Verdict(Person, Arguments, Intent, Slots): judge the reply to `Confirm`; a repetition of them confirms."""


class Telling(LongAction):
    """Action that ends with its utterance."""

    def cancel(self) -> None:
        self.engine.robot.conversation.forget(self)
        self.cancelled()


class tell(Telling):
    """tell(Situation, Person, Arguments): say the sentence for a situation; ends with its utterance."""

    def start(self, situation: str, person: str, arguments: tuple[object, ...] = ()) -> None:
        self.engine.robot.conversation.tell(self, person, situation, arguments)


class tell_again(Telling):
    """tell_again(Person): repeat the last sentence to a person."""

    def start(self, person: str) -> None:
        talk = self.engine.robot.conversation
        last = talk.last_said(person)
        if last is None:
            self.failed(f"nothing was said to {person}")
        else:
            talk.tell(self, person, *last)


class forget_person(Action):
    """forget_person(Person): drop what the conversation keeps about a person beside the beliefs."""

    def execute(self, person: str) -> None:
        self.engine.robot.conversation.forget_person(person)


class Policy(NamedTuple):
    """Limits of a conversation: durations in s, and numbers of tries."""

    repairs: int = 2
    """Repairs in a row until the way out."""
    polite_s: float = 15.0
    """Longest wait until nobody is speaking."""
    speech_s: float = 30.0
    """Longest duration of an utterance, with its wait in the queue of the speaker."""
    waiting_s: float = 30.0
    """Time after which a waiting person is given up."""
    longest_speech_s: float = 30.0
    """Time after which nobody is believed to be still speaking: the end was lost, or it is no speech."""
    longest_turn_s: float = 120.0
    """Time after which a turn ends in any case."""
    forget_s: float = 600.0
    """Time after the last sentence of a person after which the conversation forgets the person."""
    sure_confidence: float = 0.4
    """Recognized speech below this confidence is only understood if it has nothing but a phrase and courtesies."""


class SpeechSensor(Sensor):
    """Sensor of speech: reads the intent of a sentence."""

    def __init__(self, conversation: Conversation) -> None:
        self._conversation = conversation

    def sense(self, percept: HeardSpeech) -> Sensed:
        talk = self._conversation
        person = talk.speaker(percept)
        reading, text = talk.read(percept, person)
        talk.last_heard[person] = msgspec.structs.replace(percept, text=text)
        by = f"{percept.text!r}, recognized with a confidence of {percept.confidence:.2f}"
        if text != percept.text:
            by += f", or {text!r}"
        if reading and not reading.phrase:
            why = f"{by}, is understood as {reading.intent}"
        elif reading:
            why = f"{by}, matches {reading.phrase!r} in {reading.language} by {reading.score:.0%}".replace("%", " %")
        else:
            why = f"{by}, matches no phrase"
        if reading.rejected:
            why += f"; it excludes {', '.join(reading.rejected)}"
        changes = [(-old).because(why) for old in talk.believed(heard, person)]
        if reading:
            changes += [(-old).because(f"{person} is understood") for old in talk.believed(misheard, person)]
            spoken = talk.believed(speaks, person)
            if not any(one.args[1] == reading.language for one in spoken):
                changes += [(-old).because(why) for old in spoken]
                changes.append((+speaks(person, reading.language)).because(why))
        elif reading.language != talk.language_of(person):  # to be answered in their language
            changes.append((+speaks(person, reading.language)).because(why))
        return [*changes, (+heard(person, reading.intent, reading.slots)).because(why)]


class Conversation:
    """Part of an agent node: hears sentences, says sentences, and keeps the language of each person.

    Args:
        engine: The engine of the agent. Its robot has this object as ``conversation`` and a method
            ``utter(action, person, situation, text, language)``, which returns the id of the utterance whose status
            `note` gets, or "" for one that is over.
        script: Intents, questions and sentences.
        language: Language of people who have not spoken yet.
        present: Returns the people who may have said something.
        attends: Whether sentences of a person that are not understood are repaired.
        interpret: Gets a sentence, its reading, the text that is read and the speaker; returns a better reading and
            text, or the same.
        policy: Limits.
    """

    def __init__(
        self,
        engine: Engine,
        script: Script,
        language: str = "en",
        *,
        present: Callable[[], Collection[str]] = lambda: (),
        attends: Callable[[str], bool] = lambda _: True,
        interpret: Callable[[HeardSpeech, Reading, str, str], tuple[Reading, str]] = lambda _, reading, text, __: (
            reading,
            text,
        ),
        policy: Policy | None = None,
    ) -> None:
        self.engine, self.script, self.language = engine, script, language
        self.present, self.attends, self.policy = present, attends, policy or Policy()
        self.interpret = interpret
        self._voices: dict[str, str] = {}  # persons who are speaking, by voice
        self.last_heard: dict[str, HeardSpeech] = {}
        """Last sentence of each person."""
        self.understood: dict[str, Mapping[str, Any]] = {}
        """What ``interpret`` keeps about the last sentence of each person."""
        self._telling: dict[str, LongAction] = {}
        self._last: dict[str, tuple[str, tuple[object, ...]]] = {}
        self.sensor = SpeechSensor(self)
        engine.add_sensor(self.sensor)

    # What is heard

    def hear(self, message: HeardSpeech) -> None:
        """Turn recognized speech into beliefs."""
        if message.text.strip():
            message = msgspec.structs.replace(message, alternatives=message.alternatives[:READ_ALTERNATIVES])
            since = min(message.stamp, self.engine.clock.now())
            self.engine.perceive(self.sensor, message, cause=message.id, since=since)

    def activity(self, message: VoiceActivity) -> None:
        """Note that a person begins or ends to speak; an end without a voice is that of all."""
        cause, before = f"voice-{message.stamp}", set(self._voices.values())
        if message.active:
            known = self._voices.get(message.voice, SOMEBODY)
            self._voices[message.voice] = message.person or known
        elif message.voice:
            self._voices.pop(message.voice, None)
        else:
            self._voices.clear()
        now = set(self._voices.values())
        for person in sorted(now - before):
            self.engine.believe(talks(person), source="speech", cause=cause)
        for person in sorted(before - now):
            self.engine.forget(talks(person), cause=cause)

    def speaker(self, message: HeardSpeech) -> str:
        """The person who spoke: as recognized, or who was asked, or the only one present, or `SOMEBODY`."""
        if message.person:
            return message.person
        for candidates in ([str(one.args[0]) for one in self.believed(asked)], list(self.present())):
            if len(candidates) == 1:
                return candidates[0]
        return SOMEBODY

    def read(self, message: HeardSpeech, person: str) -> tuple[Reading, str]:
        """Interpret a sentence in the language of the person, or the recognized one if that fits better.

        Returns:
            The reading and the text that it reads: the recognized one, or the first alternative that is understood.
        """
        known = self.script.languages
        candidates = [self.language_of(person), message.language]
        if message.language not in known:
            candidates += known
        languages = [one for one in dict.fromkeys(candidates) if one in known] or [self.language]
        is_sure = not message.confidence or message.confidence >= self.policy.sure_confidence
        heard_in = message.language if message.language in known and is_sure else languages[0]
        spoken = languages[0] if self.believed(speaks, person) else heard_in
        questions = [self.script.questions[str(one.args[1])] for one in self.believed(asked, person)]
        expected = {intent for question in questions for intent in question.expects if intent != ANY}
        found: list[tuple[Reading, str]] = []
        denied = negations_in(message.text, languages[0])
        texts = [one for one in message.alternatives if negations_in(one, languages[0]) == denied]
        for text in (message.text, *texts):
            readings = [self.script.grammar.read(text, language, expected) for language in languages]
            reading = max(readings, key=lambda each: (self.is_urgent(each.intent), each.words, each.score))
            if reading and (is_sure or not reading.left):
                found.append((reading, text))
        unknown = Reading(UNKNOWN, language=spoken), message.text
        if urgent := next((each for each in found if self.is_urgent(each[0].intent)), None):
            return urgent
        known = (each for each in found if not self.script.grammar.intents[each[0].intent].fallback)
        best = next(known, found[0] if found else unknown)
        return self.interpret(message, *best, person) if is_sure else best

    def is_urgent(self, intent: str) -> bool:
        """Whether an intent gets its response at once."""
        return self.script.grammar.is_urgent(intent)

    def believed(self, kind: type[Belief], *arguments: object) -> list[Belief]:
        """Current beliefs of a kind whose first arguments are these: the person, and others."""
        found = (one.belief for one in self.engine.beliefs if type(one.belief) is kind)
        return [belief for belief in found if tuple(belief.args[: len(arguments)]) == arguments]

    def language_of(self, person: str) -> str:
        """Language in which to speak to a person."""
        return next((str(one.args[1]) for one in self.believed(speaks, person)), self.language)

    # What is said

    def tell(self, action: LongAction, person: str, situation: str, arguments: tuple[object, ...]) -> None:
        """Say the sentence for a situation in the language of a person; `note` ends the action."""
        text, language = self.script.sentence(situation, arguments, self.language_of(person))
        self._last[person] = (situation, arguments)
        self.say(action, person, situation, text, language)

    def say(self, action: LongAction, person: str, situation: str, text: str, language: str) -> None:
        """Say a text; `note` ends the action."""
        if utterance := self.engine.robot.utter(action, person, situation, text, language):
            self._telling[utterance] = action
        else:
            action.done()

    def last_said(self, person: str) -> tuple[str, tuple[object, ...]] | None:
        """Situation and arguments of the last sentence to a person."""
        return self._last.get(person)

    def note(self, status: SpeechStatus) -> None:
        """End the action of an utterance that is over."""
        if status.state not in (*SAID, *FAILED):
            return
        action = self._telling.pop(status.utterance_id, None)
        if action is not None:
            if status.state in SAID:
                action.done()
            else:
                action.failed(f"the utterance is {status.state}: {status.detail}".rstrip(": "))

    def forget_person(self, person: str) -> None:
        """Drop the last sentences of and to a person."""
        self.last_heard.pop(person, None)
        self.understood.pop(person, None)
        self._last.pop(person, None)

    def forget(self, action: LongAction) -> None:
        """Stop to wait for the end of an utterance."""
        self._telling = {key: other for key, other in self._telling.items() if other is not action}

    # Questions

    def question(self, name: str) -> Question:
        """The declared question, or one with the default limits."""
        return self.script.questions.get(name) or Question(name, ())

    def expects(self, name: str, intent: str) -> bool:
        """Whether an intent answers a question; a sentence that is not understood is a reply, too."""
        if intent == UNKNOWN:
            return True
        expected = self.question(name).expects
        return intent in expected or (ANY in expected and not self.script.grammar.intents[intent].only_expected)


def conversation_rules(talk: Conversation) -> list[Plan | Inference | list[Plan]]:
    """Return the plans of a conversation; the agent adds its own for `Respond`."""
    Who, Other, What, Slots, Reply, Given, T, Q, A, N, M, _ = variables("Who Other What Slots Reply Given T Q A N M _")  # noqa: N806
    policy = talk.policy
    patience = compute(lambda Q: talk.question(Q).patience_s)  # noqa: N803
    return [
        # An emergency ends all turns.
        +heard(Who, What, Slots) / (lambda What: talk.is_urgent(What))  # noqa: N803
        >> [
            drop(Converse(_, _, _)),
            drop(Turn(_, _, _)),
            for_each(waits(Other, _, _), [-waits(Other, _, _)]),
            for_each(asked(Other, Q), [-asked(Other, Q)]),
            for_each(turn(Other), [-turn(Other)]),
            Turn(Who, What, Slots),
        ],
        # Who is asked, answers. Others wait for their turn.
        atomic(
            +heard(Who, What, Slots) / (asked(Who, Q) & (lambda Q, What: talk.expects(Q, What)))  # noqa: N803
            >> [-replied(Who, _, _), +replied(Who, What, Slots)],
        ),
        +heard(Who, UNKNOWN, Slots) / (lambda Who: not talk.attends(Who)) >> [],  # noqa: N803
        +heard(Who, UNKNOWN, Slots) / (turn(Other) & (Other != Who)) >> [],
        +heard(Who, UNKNOWN, Slots) >> [Repair(Who)],
        +heard(Who, What, Slots) / turn(Who) >> [Respond(Who, What, Slots)],
        +heard(Who, What, Slots) / (turn(Other) & waits(Who, _, _)) >> [-waits(Who, _, _), +waits(Who, What, Slots)],
        +heard(Who, What, Slots) / turn(Other) >> [+waits(Who, What, Slots), Answer(Who, "one_moment", ())],
        +heard(Who, What, Slots) >> [Turn(Who, What, Slots)],
        -turn(_) / (waits(Who, What, Slots) & ~turn(_)) >> [-waits(Who, What, Slots), Turn(Who, What, Slots)],
        +waits(Who, What, Slots).held_for(policy.waiting_s) >> [-waits(Who, What, Slots)],
        +talks(Who).held_for(policy.longest_speech_s) >> [-talks(Who)],
        +heard(Who, What, Slots).held_for(policy.forget_s)
        >> [-heard(Who, _, _), -speaks(Who, _), -misheard(Who, _), forget_person(Who)],
        +turn(Who).held_for(policy.longest_turn_s) >> [-asked(Who, _), -turn(Who)],
        # A turn ends with its response, whatever comes of it.
        Turn(Who, What, Slots) >> [wait_for(~turn(_)), +turn(Who), Respond(Who, What, Slots), -turn(Who)],
        -Turn(Who, What, Slots) >> [-turn(Who)],
        Converse(Who, Q, A)
        >> [wait_for(~turn(_)), +turn(Who), Ask(Who, Q, A, What, Slots), Respond(Who, What, Slots), -turn(Who)],
        -Converse(Who, Q, A)[error_msg(M)] >> [-turn(Who), fail(M)],
        # Sentences
        Answer(Who, T, A) >> [wait_for(~talks(_), policy.polite_s), tell(T, Who, A).within(policy.speech_s)],
        # Questions
        Ask(Who, Q, A, What, Slots) >> [Pose(Who, Q, A, 1, What, Slots)],
        Pose(Who, Q, A, N, What, Slots)
        >> [
            -replied(Who, _, _),
            +asked(Who, Q),
            Answer(Who, Q, A),
            Listen(Who, Q, Reply, Given),
            -asked(Who, Q),
            Judge(Who, Q, A, N, Reply, Given, What, Slots),
        ],
        -Pose(Who, Q, A, N, What, Slots)[error_msg(M)] >> [-asked(Who, Q), fail(M)],
        Listen(Who, Q, What, Slots) >> [wait_for(replied(Who, What, Slots), patience), -replied(Who, What, Slots)],
        -Listen(Who, Q, What, Slots) / talks(_) >> [Listen(Who, Q, What, Slots)],
        -Listen(Who, Q, SILENCE, ()) >> [],
        Judge(Who, Q, A, N, SILENCE, _, What, Slots) / (lambda Q, N: talk.question(Q).tries > N)  # noqa: N803
        >> [Pose(Who, Q, A, N + 1, What, Slots)],
        Judge(Who, Q, A, N, SILENCE, _, What, Slots) >> [fail("nobody answers")],
        Judge(Who, Q, A, N, UNKNOWN, _, What, Slots) / (policy.repairs >= N)
        >> [Answer(Who, "repair", ()), Pose(Who, Q, A, N + 1, What, Slots)],
        Judge(Who, Q, A, N, UNKNOWN, _, What, Slots)
        >> [Answer(Who, "way_out", ()), fail("the reply is not understood")],
        Judge(Who, Q, A, N, What, Slots, What, Slots) >> [],
        Confirm(Who, Q, A) >> [Ask(Who, Q, A, What, Slots), Verdict(Who, A, What, Slots)],
        Verdict(Who, _, "yes", Slots) >> [],
        Verdict(Who, _, "no", Slots) >> [fail("the person says no")],
        Verdict(Who, A, What, Slots) / (lambda A, Slots: bool(Slots) and tuple(Slots) == tuple(A)) >> [],  # noqa: N803
        Verdict(Who, _, What, Slots) >> [Respond(Who, What, Slots), fail("the person corrects it")],
        # Sentences that are not understood
        Repair(Who) / ~misheard(Who, _) >> [+misheard(Who, 1), Answer(Who, "repair", ())],
        Repair(Who) / (misheard(Who, N) & (policy.repairs > N))
        >> [-misheard(Who, N), +misheard(Who, N + 1), Answer(Who, "repair", ())],
        Repair(Who) / misheard(Who, policy.repairs)
        >> [-misheard(Who, _), +misheard(Who, policy.repairs + 1), Answer(Who, "way_out", ())],
        Repair(Who) >> [],
    ]
