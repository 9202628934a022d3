"""Door guard: check badges and a door that is left open, with deadlines."""

from socialbot.bdi import (
    Belief,
    Engine,
    Goal,
    Reactor,
    action,
    error,
    error_msg,
    fail,
    variables,
    wait_for,
)
from socialbot.testing import ManualClock, run_engine

E, M, W = variables("E M W")


class bell(Reactor):
    """Somebody rings."""


class badge(Reactor):
    """The badge of this person is shown."""


class known(Belief):
    """This person may enter."""


class door_open(Belief):
    """The door is open, as its sensor says."""


class admit(Goal):
    """The person at the door is admitted, or sent away."""


class check(Goal):
    """This person may enter."""


class closed(Goal):
    """The door is closed."""


@action
def say(engine, *words):
    print(f"{engine.clock.now() / 1e9:4.1f} s ", *words)


RULES = [
    +bell() >> [admit().within(10)],
    admit() >> [say("Your badge, please."), wait_for(+badge(W)), check(W), say("Come in,", W)],
    -admit()[error("timeout")] >> [say("Nobody is there.")],
    -admit()[error_msg(M)] >> [say("You stay outside:", M)],
    check(W) / known(W) >> [],
    check(W) >> [fail("the badge is unknown")],
    +door_open().held_for(5) >> [closed()],
    closed() >> [say("Please close the door."), wait_for(~door_open(), 10), say("Thank you.")],
    -closed()[error("wait_timeout")] >> [say("Alarm: the door stays open!")],
]


def main():
    guard = Engine("guard", ManualClock())
    guard.add_rules(*RULES)
    guard.believe(known("Ann"))
    for name in ("Ann", "Bob", None):
        guard.believe(bell())
        run_engine(guard, 3.0)
        if name is not None:
            guard.believe(badge(name))
        run_engine(guard, 17.0)
    for seconds in (8.0, 30.0):
        guard.believe(door_open())
        run_engine(guard, seconds)
        guard.forget(door_open())
        run_engine(guard, 10.0)


if __name__ == "__main__":
    main()
