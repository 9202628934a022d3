"""Talking Waldo: hears what people say, and answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from socialbot.agents.dialogue import (
    SOMEBODY,
    Answer,
    Ask,
    Conversation,
    Converse,
    Reading,
    Respond,
    Script,
    Turn,
    asked,
    conversation_rules,
    heard,
    load_script,
    replied,
    talks,
    tell_again,
    turn,
    waits,
)
from socialbot.agents.dialogue.conversation import Telling, tell
from socialbot.agents.waldo.nodes import Listener, WaldoNode
from socialbot.agents.waldo.waldo import (
    DoNothing,
    GreetPeople,
    OfferHelp,
    SilentAction,
    engages,
    gone,
    greeted,
    offered,
    personDetected,
    present,
    several,
    ungreeted,
    unoffered,
)
from socialbot.bdi import (
    ANYTHING,
    Action,
    Belief,
    Engine,
    Goal,
    Inference,
    Plan,
    Record,
    SingletonBelief,
    apart,
    compute,
    drop,
    for_each,
    variables,
    wait_for,
)
from socialbot.core import paths
from socialbot.core.errors import ParameterError
from socialbot.core.messages import (
    HeardSpeech,
    Message,
    PersonDetections,
    SpeechStatus,
    StopSpeech,
    Utterance,
    VoiceActivity,
)
from socialbot.graph.node import Graph, NodeConfig
from socialbot.graph.ports import Input, Output, Parameter
from socialbot.runs.asking import Answer as Answered
from socialbot.runs.asking import answer, answer_heard, asking_back, chosen_option, is_asked, words_of_names
from socialbot.runs.run import LiveRun


class asleep(SingletonBelief):
    """Waldo sleeps, "alone" or since he was "told" to: the head is down until somebody arrives or wakes him."""


class Sleep(Goal):
    """Sleep(Reason): go to sleep."""


class WakeUp(Goal):
    """Wake up."""


class fallAsleep(SilentAction):
    """Lower the head."""


class wakeUp(SilentAction):
    """Raise the head and follow people."""


class Warn(Goal):
    """Warn(Person, Emergency): say what to do in an emergency."""


class Clarified(Goal):
    """Clarified(Person, Intent, Slots): answer a question after the reply to which reading is meant."""


class explain(Telling):
    """explain(Person[, Reading]): answer the last question of a person about what Waldo sees, did, or will do.

    Reading is the one that the person chose, such as "why I greeted you".
    """

    def start(self, person: str, reading: str = "") -> None:
        self.engine.robot.explain(self, person, reading)


READ_EVERY = 200
"""Number of messages after which the run of the past is read, which drops old ones."""

QUESTION = "ask_why"
"""Intent of questions about what the robot sees, did, or will do."""

UNCLEAR = "unclear"
"""Intent of such a question that is not understood surely. Its slots are the closest readings."""

CHOICE = "choice"
"""Intent of the reply that chooses one of them."""

WAKING = ("wake", "hello", "help")
"""Intents that wake Waldo."""


@cache
def small_talk() -> Script:
    """Return what Waldo understands and says in every place."""
    emergencies = load_script(Path(__file__).with_name("emergencies.yaml"))
    return load_script(Path(__file__).with_name("small_talk.yaml"), base=emergencies)


class TalkingWaldo(WaldoNode):
    """Agent node of Waldo in conversation: greets, asks whether he can help, and responds to what people say.

    Speech becomes beliefs ``heard(Person, Intent, Slots)``. Replies are goals (see docs/howto/dialogue.md).
    """

    speech = Input(HeardSpeech, "/humans/voices/speech", optional=True)
    speech_status = Input(SpeechStatus, "/speech/status", optional=True)

    language = Parameter("en", "language of people who have not spoken yet (ISO 639-1)", fixed=True)
    script = Parameter("", "YAML file with more intents, questions and sentences; empty: none", fixed=True)
    voice_activity = Input(VoiceActivity, "/humans/voices/activity", optional=True)

    stop_speech = Output(StopSpeech, "/speech/stop")

    emergency_number = Parameter("112", "telephone number that people are told to call in an emergency")
    sleep_after_s = Parameter(300.0, "time without people until Waldo sleeps, s", minimum=1.0, maximum=86400.0)

    def build(self) -> Engine:
        config = NodeConfig(self.name, type(self))
        self._past = LiveRun(Graph(self.name, (config,), inputs=frozenset(topic for topic, _ in config.subscriptions)))
        self._unread = 0
        engine = super().build()
        script = self.make_script()
        if self.language not in script.languages:
            remedy = f"choose one of: {', '.join(script.languages)}"
            raise ParameterError(f"no script in {self.language!r}", where=f"{self.name}.language", remedy=remedy)
        self.conversation = Conversation(
            engine,
            script,
            self.language,
            present=lambda: self._people(present),
            attends=self._attends,
            interpret=self.interpret,
        )
        # The first plan that applies is chosen; each rule goes before those already there.
        engine.add_rules(*reversed([*self.rules(), *talking_rules(self)]), first=True)
        engine.add_rules(*conversation_rules(self.conversation))
        return engine

    def on_recalled(self) -> None:
        """Conversations of before a restart are over."""
        super().on_recalled()
        for belief in (
            turn(ANYTHING),
            asked(ANYTHING, ANYTHING),
            replied(ANYTHING, ANYTHING, ANYTHING),
            waits(ANYTHING, ANYTHING, ANYTHING),
            talks(ANYTHING),
        ):
            self.engine.forget(belief)

    def make_script(self) -> Script:
        """Return the script of the conversation; subclasses may extend it. Raises GraphError or RuleError."""
        if not self.script:
            return small_talk()
        path = paths.in_workspace(self.script, where=f"{self.name}.script")
        return load_script(path, base=small_talk())

    def rules(self) -> list[Plan | Inference | list[Plan]]:
        """Return further plans, which come before those of Waldo; subclasses may override it."""
        return []

    @WaldoNode.detections
    def on_detections(self, message: PersonDetections) -> None:
        super().on_detections(message)
        self._remember(WaldoNode.detections.topic, message)

    @speech
    def on_speech(self, message: HeardSpeech) -> None:
        self.conversation.hear(message)
        self._remember(TalkingWaldo.speech.topic, message)

    @voice_activity
    def on_voice_activity(self, activity: VoiceActivity) -> None:
        """Waldo waits with a sentence while somebody is speaking."""
        self.conversation.activity(activity)

    @speech_status
    def on_speech_status(self, status: SpeechStatus) -> None:
        self.conversation.note(status)

    def utter(self, action: Action, person: str, situation: str, text: str, language: str) -> str:
        """Request an utterance; return its id. One in an emergency interrupts the utterance that sounds."""
        if self.conversation.is_urgent(situation):
            self.stop_speech.publish(StopSpeech(stamp=self.clock.now(), reason="an emergency"))
        if language == "en" and situation in ("greeting", "greeting_several", "offer"):
            text = self.sentence(situation)
        self.act(action, situation, person, text, language)
        said = Utterance(
            stamp=self.engine.clock.now(),
            id=f"say-{action.id}",
            text=text,
            cause=action.id,
            person=person,
            language=language,
        )
        self._remember(Listener.say.topic, said)
        return said.id

    def interpret(self, message: HeardSpeech, reading: Reading, text: str, person: str) -> tuple[Reading, str]:
        """Read a sentence as a reply to a question back, or as a question about this run.

        Questions need no phrase. If the answer is not sure, the intent is `UNCLEAR`, and its slots are the two closest
        readings.
        """
        language = reading.language
        texts = (text, *(one for one in message.alternatives if one != text))
        if self._answers(person) and self.conversation.believed(asked, person, "clarify"):
            options = list(self._answers(person))
            for each in texts:
                if number := chosen_option(options, each):
                    return Reading(CHOICE, (options[number - 1],), language), each
        if reading and reading.intent != QUESTION:
            return reading, text
        questions = [each for each in texts if reading or is_asked(each, language)]
        if not questions:
            return reading, text
        heard_text, found = answer_heard(
            questions, self._answering(person, language, message.id), words_of_names(self._past)
        )
        if found.known:
            return replace(reading, intent=QUESTION, slots=()), heard_text
        if found.options:
            self.conversation.understood[person] = {one.question: one for one in found.options}
            return Reading(UNCLEAR, tuple(self._answers(person)), language), heard_text
        return reading, text

    def _answers(self, person: str) -> Mapping[str, Answered]:
        """Return the answers to the readings of the last unclear question of a person."""
        return self.conversation.understood.get(person, {})

    def _answering(self, person: str, language: str, asked_as: str) -> Callable[[str], Answered]:
        """Return what answers a person's question about what happened so far."""
        return partial(
            answer,
            self._past,
            language=language,
            speaker=person,
            agent=self.name,
            spoken=True,
            asked_as=asked_as,
        )

    def explain(self, action: explain, person: str, reading: str = "") -> None:
        """Say the answer to the last question of a person, or to a reading of it; record it with its records."""
        heard = self.conversation.last_heard[person]
        question = reading or heard.text
        found = self._answers(person).get(reading)
        if found is None:
            language = self.conversation.language_of(person)
            found = self._answering(person, language, heard.id)(question)
        self.engine.trace.record(
            "answer",
            found.text,
            action.id,
            question=question,
            known=found.known,
            clauses=[{"text": clause.text, "records": list(clause.records)} for clause in found.clauses],
        )
        self.conversation.say(action, person, "explanation", found.text, found.language)

    def record(self, record: Record) -> None:
        super().record(record)
        self._remember(WaldoNode.trace.topic, self.trace_message(record))

    def _remember(self, topic: str, message: Message) -> None:
        """Keep a message for answers to questions; the run drops old ones when it is read."""
        self._past.observe(topic, message)
        self._unread += 1
        if self._unread >= READ_EVERY:
            self._unread = 0
            _ = self._past.history

    def _people(self, kind: type[Belief]) -> list[str]:
        return [str(one.args[0]) for one in self.conversation.believed(kind)]

    def _attends(self, person: str) -> bool:
        """Whether a sentence that is not understood was meant for Waldo: its speaker engages or has talked to him."""
        talk = self.conversation
        engaged = self._people(engages)
        known = bool(talk.believed(turn, person) or talk.last_said(person))
        return known or person in engaged or (person == SOMEBODY and bool(engaged))


def talking_rules(node: TalkingWaldo) -> list[Plan | Inference | list[Plan]]:
    """Return the plans of small talk, of offers that lead somewhere, and of sleep."""
    Who, What, Slots, Reply, Q, _ = variables("Who What Slots Reply Q _")  # noqa: N806
    is_urgent = node.conversation.is_urgent
    number = compute(lambda: (" ".join(node.emergency_number),))
    return [
        # Emergencies: a fixed answer, also while somebody is speaking. It is said again if it could not be spoken.
        Respond(Who, What, _) / (lambda What: is_urgent(What))  # noqa: N803
        >> [Warn(Who, What), tell("no_help_called", Who).within(30)],
        Warn(Who, What) >> [tell(What, Who, number).within(30)],
        -Warn(Who, What) >> [tell(What, Who, number).within(30)],
        # Sleep
        +personDetected("No").held_for(lambda: node.sleep_after_s) / ~asleep(_) >> [Sleep("alone")],
        +personDetected("No") / asleep("told") >> [+asleep("alone"), DoNothing()],
        +personDetected("Yes") / asleep(_) >> [WakeUp()],
        +heard(Who, What, Slots) / (asleep(_) & (lambda What: not (What in WAKING or is_urgent(What)))) >> [],  # noqa: N803
        +heard(Who, What, Slots) / asleep(_) >> [WakeUp(), apart(Turn(Who, What, Slots))],
        Sleep(What) >> [+asleep(What), fallAsleep()],
        WakeUp() >> [-asleep(_), wakeUp()],
        GreetPeople() / asleep("told") >> [],
        OfferHelp() / asleep("told") >> [],
        # Greetings and offers begin conversations. Who has talked with Waldo needs no offer.
        GreetPeople() / several()
        >> [for_each(ungreeted(Who), [+greeted(Who)]), apart(Answer(SOMEBODY, "greeting_several", ()))],
        GreetPeople() / ungreeted(Who) >> [+greeted(Who), apart(Answer(Who, "greeting", ()))],
        OfferHelp() / (unoffered(Who) & heard(Who, _, _)) >> [+offered(Who)],
        OfferHelp() / unoffered(Who)
        >> [for_each(present(Who) & ~offered(Who), [+offered(Who)]), apart(Converse(Who, "offer", ()))],
        # Who leaves ends the conversation.
        +gone(Who) / asked(Who, Q) >> [-asked(Who, Q), drop(Converse(Who, _, _)), drop(Turn(Who, _, _)), -turn(Who)],
        # Small talk
        Respond(Who, "hello", _) / greeted(Who) >> [Answer(Who, "hello_again", ())],
        Respond(Who, "hello", _) >> [+greeted(Who), Answer(Who, "greeting", ())],
        Respond(Who, "help", _) >> [Ask(Who, "what_help", (), What, Slots), Respond(Who, What, Slots)],
        Respond(Who, "yes", _) >> [Ask(Who, "what_help", (), What, Slots), Respond(Who, What, Slots)],
        Respond(Who, "no", _) >> [Answer(Who, "no_help", ())],
        Respond(Who, "thanks", _) >> [Answer(Who, "welcome", ())],
        Respond(Who, "abilities", _) >> [Answer(Who, "abilities", ())],
        Respond(Who, "how_are_you", _) >> [Answer(Who, "how_are_you", ())],
        Respond(Who, "languages", _) >> [Answer(Who, "languages", ())],
        Respond(Who, "sleep", _) >> [Answer(Who, "sleeping", ()), Sleep("told")],
        Respond(Who, "wake", _) >> [Answer(Who, "awake", ())],
        Respond(Who, "ask_why", _) >> [wait_for(~talks(_), 15), explain(Who).within(30)],
        Respond(Who, UNCLEAR, Slots)
        >> [
            Ask(Who, "clarify", compute(lambda Slots: (asking_back(Slots),)), What, Reply),  # noqa: N803
            Clarified(Who, What, Reply),
        ],
        Clarified(Who, CHOICE, (Q,)) >> [wait_for(~talks(_), 15), explain(Who, Q).within(30)],
        Clarified(Who, What, Reply) >> [Respond(Who, What, Reply)],
        Respond(Who, "repeat", _) >> [wait_for(~talks(_), 15), tell_again(Who).within(30)],
        # Who ends the conversation says no to an open question.
        Respond(Who, "goodbye", _) / asked(Who, _) >> [+replied(Who, "no", ()), Answer(Who, "goodbye", ())],
        Respond(Who, "goodbye", _) >> [Answer(Who, "goodbye", ())],
        Respond(Who, "stop", _) / asked(Who, _) >> [+replied(Who, "no", ())],
        Respond(Who, "stop", _) >> [Answer(Who, "no_help", ())],
    ]
