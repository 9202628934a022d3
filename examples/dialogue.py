"""Dialogue: tell a story that questions interrupt, and a request ends."""

from socialbot.bdi import Belief, Engine, Goal, Reactor, action, drop, resume, suspend, variables, wait
from socialbot.testing import ManualClock, run_engine

A, N, Q, T, _ = variables("A N Q T _")

STORY = (
    "Once there was a robot.",
    "It lived in a museum.",
    "At night it talked to the statues.",
    "One night a statue answered.",
)


class heard(Reactor):
    """A person has said this."""


class sentence(Belief):
    """The story has this sentence at this place."""


class answer(Belief):
    """The answer to this question."""


class tell(Goal):
    """Tell the story from this sentence on."""


@action
def say(engine, text):
    print(f"{engine.clock.now() / 1e9:4.1f} s  {text}")


RULES = [
    tell(N) / sentence(N, T) >> [say(T), wait(3), tell(N + 1)],
    tell(_) >> [say("The end.")],
    +heard("Stop!") >> [drop(tell(_)), say("Good night, then.")],
    +heard(Q) / answer(Q, A) >> [suspend(tell(_)), say(A), wait(4), say("Where was I?"), resume(tell(_))],
    +heard(_) >> [say("I will think about that.")],
]


def main():
    robot = Engine("robot", ManualClock())
    robot.add_rules(*RULES)
    for number, text in enumerate(STORY):
        robot.believe(sentence(number, text))
    robot.believe(answer("Which museum?", "The one beside the river."))
    robot.achieve(tell(0))
    run_engine(robot, 4.0)
    robot.believe(heard("Which museum?"))
    run_engine(robot, 6.0)
    robot.believe(heard("Statues cannot talk."))
    run_engine(robot, 1.0)
    robot.believe(heard("Stop!"))
    run_engine(robot, 60.0)


if __name__ == "__main__":
    main()
