"""Lift: serve the calls of floors on the way up, then on the way down."""

from socialbot.bdi import Belief, Engine, Goal, LongAction, SingletonBelief, action, variables, wait
from socialbot.testing import ManualClock, run_engine

F, N, _ = variables("F N _")


class call(Belief):
    """Somebody waits at this floor, or wants to leave the lift there."""


class at(SingletonBelief):
    """The floor of the lift."""


class heading(SingletonBelief):
    """The direction: up or down."""


class busy(Belief):
    """Calls are being served."""


class serve(Goal):
    """Idle: no call is left."""


class move(LongAction):
    """Drive by one floor, which takes 2 s."""

    def start(self, floors):
        self.engine.timers.after(2.0, self.done)


@action
def show(engine, *words):
    print(f"{engine.clock.now() / 1e9:4.1f} s ", *words)


RULES = [
    +call(_) / ~busy() >> [+busy(), serve(), -busy()],
    serve() / (at(F) & call(F)) >> [show("opens at", F), wait(3), -call(F), serve()],
    serve() / (heading("up") & at(F) & call(N) & (N > F)) >> [move(1), +at(F + 1), serve()],
    serve() / (heading("down") & at(F) & call(N) & (N < F)) >> [move(-1), +at(F - 1), serve()],
    serve() / (heading("up") & call(_)) >> [+heading("down"), serve()],
    serve() / (heading("down") & call(_)) >> [+heading("up"), serve()],
    serve() / at(F) >> [show("waits at", F)],
]


def main():
    lift = Engine("lift", ManualClock())
    lift.add_rules(*RULES)
    for belief in (at(0), heading("up"), call(3)):
        lift.believe(belief)
    run_engine(lift, 1.0)
    lift.believe(call(1))  # on the way up
    run_engine(lift, 5.0)
    lift.believe(call(0))  # behind the lift: on the way down
    lift.believe(call(2))
    run_engine(lift, 60.0)


if __name__ == "__main__":
    main()
