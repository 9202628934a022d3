"""Dialogue: help a user whose computer hangs, on request and unasked, after Table A1 of Waldo's paper."""

from socialbot.agents.dialogue import (
    Answer,
    Ask,
    Conversation,
    Converse,
    Intent,
    Question,
    Respond,
    Script,
    conversation_rules,
)
from socialbot.bdi import Belief, Engine, variables
from socialbot.core.messages import HeardSpeech
from socialbot.testing import SECOND, ManualClock, run_engine

What, Slots, Who, _ = variables("What Slots Who _")

SCRIPT = Script(
    [
        Intent("help", phrases={"en": ["(can|could) you help [me]", "help me"]}),
        Intent("hangs", phrases={"en": ["[my] computer (is not responding|hangs)"]}),
        Intent("restart", phrases={"en": ["(will|will not) that restart [my computer]"]}),
        Intent("nothing", phrases={"en": ["it is not doing anything", "nothing happens"]}),
        Intent("now", phrases={"en": ["[ok] and now", "what now"]}),
        Intent("lost", phrases={"en": ["[I] (lost|lose) my work"]}),
        Intent("backup", phrases={"en": ["(where|how) [can I find] (is|a) [my] backup"]}),
        Intent("ok", phrases={"en": ["ok", "okay", "done"]}),
        Intent("yes", phrases={"en": ["yes", "I do"]}, only_expected=True),
        Intent("no", phrases={"en": ["no", "not sure"]}, only_expected=True),
    ],
    questions=[
        Question("what_is_wrong", expects=("hangs",)),
        Question("it_hangs", expects=("help", "ok"), tries=1),
        Question("have_backup", expects=("yes", "no")),
    ],
    sentences={
        "what_is_wrong": {"en": "Of course. What is wrong?"},
        "it_hangs": {"en": "Your computer does not seem to respond. Can I do anything?"},
        "end_process": {"en": "Press Alt, Control and Delete to end the process."},
        "only_ends": {"en": "No, it only ends the process."},
        "together": {"en": "Press the three keys together."},
        "then_end": {"en": "Now you can end the process."},
        "have_backup": {"en": "Do you have a backup?"},
        "five_minutes": {"en": "Your computer saves your work every five minutes."},
        "open_file": {"en": "Open the program again and choose the file."},
        "repair": {"en": "Sorry, I did not understand."},
        "way_out": {"en": "I am sorry, please call the help desk."},
    },
)


class hangs(Belief):
    """The computer of this person does not respond."""


RULES = [
    # Proactive: the robot sees the problem, and asks before the user does.
    +hangs(Who) >> [Converse(Who, "it_hangs", ())],
    Respond(Who, "help", _) / hangs(Who) >> [Answer(Who, "end_process", ())],
    # Reactive: the user must explain.
    Respond(Who, "help", _) >> [Ask(Who, "what_is_wrong", (), What, Slots), Respond(Who, What, Slots)],
    Respond(Who, "hangs", _) >> [Answer(Who, "end_process", ())],
    # Both
    Respond(Who, "restart", _) >> [Answer(Who, "only_ends", ())],
    Respond(Who, "nothing", _) >> [Answer(Who, "together", ())],
    Respond(Who, "ok", _) / hangs(Who)
    >> [
        Answer(Who, "together", ()),
        Answer(Who, "then_end", ()),
        Ask(Who, "have_backup", (), What, Slots),
        Respond(Who, What, Slots),
    ],
    Respond(Who, "now", _) >> [Answer(Who, "then_end", ())],
    Respond(Who, "lost", _) >> [Answer(Who, "five_minutes", ())],
    Respond(Who, "no", _) >> [Answer(Who, "five_minutes", ())],
    Respond(Who, "backup", _) >> [Answer(Who, "open_file", ())],
    Respond(_, _, _) >> [],
]

REACTIVE = """
    Could you help me?
    It seems like my computer is not responding.
    Won't that restart my computer?
    Hmm, it's not doing anything.
    OK, and now?
    But then I lost my work!
    How can I find a backup?
"""
PROACTIVE = """
    Could you help me?
    Won't that restart my computer?
    OK.
    I'm not sure.
    Where is my backup?
"""


class Robot:
    """Robot that prints what it says."""

    conversation: Conversation

    def utter(self, action, person, situation, text, language):
        print(f"    robot  {text}")
        return ""


def talk(title, sentences, *beliefs):
    print(title)
    robot = Robot()
    engine = Engine("robot", ManualClock(), robot=robot)
    robot.conversation = Conversation(engine, SCRIPT)
    engine.add_rules(*RULES, *conversation_rules(robot.conversation))
    for belief in beliefs:
        engine.believe(belief)
    run_engine(engine, 1.0)
    for sentence in sentences.strip().splitlines():
        print(f"    user   {sentence.strip()}")
        now = engine.clock.now()
        robot.conversation.hear(
            HeardSpeech(stamp=now, start=now - SECOND, text=sentence.strip(), confidence=0.9, person="user")
        )
        run_engine(engine, 2.0)


def main():
    talk("reactive", REACTIVE)
    talk("proactive", PROACTIVE, hangs("user"))


if __name__ == "__main__":
    main()
