"""Patrol: visit places in a circle, charge in time, and skip a place that is blocked."""

from socialbot.bdi import (
    Belief,
    Engine,
    Goal,
    LongAction,
    SingletonBelief,
    action,
    compute,
    count,
    error,
    priority,
    variables,
    wait,
)
from socialbot.testing import ManualClock, run_engine

C, N, P, X = variables("C N P X")

DISTANCES = {"hall": 4, "stairs": 5, "garden": 30, "dock": 6}
"""Distance of each place in metres; the robot drives 1 m/s and uses 5 % of the battery per metre."""


class place(Belief):
    """The place with this number."""


class battery(SingletonBelief):
    """Charge of the battery (%)."""


class blocked(Belief):
    """The way to this place is blocked."""


class patrol(Goal):
    """The places are visited from this number on, for ever."""


class visit(Goal):
    """The robot is at this place."""


class charge(Goal):
    """The battery is full."""


class drive(LongAction):
    """Drive to a place."""

    def start(self, target):
        self.engine.timers.after(DISTANCES[target], self.done)


@action
def use(engine, target):
    (found,) = engine.query(battery(C))
    engine.believe(battery(max(0, found["C"] - 5 * DISTANCES[target])))


@action
def say(engine, *words):
    print(f"{engine.clock.now() / 1e9:5.1f} s ", *words)


RULES = [
    priority(1, patrol(N) / (battery(C) & (C < 50)) >> [charge(), patrol(N)]),
    patrol(N) / (place(N, P) & blocked(P)) >> [say("skips", P), patrol(N + 1)],
    patrol(N) / place(N, P) >> [visit(P), patrol(N + 1)],
    patrol(N) / (count(place(X, P)) == N) >> [say("starts again"), patrol(0)],
    visit(P) >> [drive(P).within(10), use(P), say("is at", P)],
    -visit(P)[error("timeout")] >> [say("the way to", P, "is blocked"), +blocked(P)],
    charge() / battery(C) >> [
        say(compute(lambda C: f"charges at {C:.0f} %")),
        drive("dock"),
        wait(compute(lambda C: (100 - C) / 5)),
        +battery(100),
        say("is charged"),
    ],
]  # fmt: skip


def main():
    robot = Engine("robot", ManualClock())
    robot.add_rules(*RULES)
    for number, name in enumerate(("hall", "garden", "stairs")):
        robot.believe(place(number, name))
    robot.believe(battery(80))
    robot.achieve(patrol(0))
    run_engine(robot, 60.0)


if __name__ == "__main__":
    main()
