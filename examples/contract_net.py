"""Contract net: a buyer calls for bids, waits until a deadline, and accepts the best one."""

from socialbot.bdi import (
    Belief,
    Engine,
    Goal,
    Library,
    Society,
    action,
    count,
    for_each,
    min_of,
    my_name,
    send,
    source,
    variables,
    wait,
    wait_for,
)
from socialbot.testing import ManualClock, run_engine

B, D, P, S, T, _ = variables("B D P S T _")


class seller(Belief):
    """An agent that may bid."""


class price(Belief):
    """The price of this task, for which this seller would do it after a delay (s)."""


class call(Belief):
    """Call for bids for a task."""


class bid(Belief):
    """A seller would do the task for this price."""


class refusal(Belief):
    """A seller does not do the task."""


class accepted(Belief):
    """The bid for the task is accepted."""


class done(Belief):
    """The task is done."""


class buy(Goal):
    """The task is done by the cheapest seller."""


class collect(Goal):
    """All sellers have answered, or the deadline is over."""


class award(Goal):
    """The best bid is accepted."""


@action
def say(engine, *words):
    print(f"{engine.clock.now() / 1e9:4.1f} s  {engine.name}:", *words)


ANSWERED = count(bid(T, _)[source(_)] | refusal(T)[source(_)])

BUYER = Library(
    buy(T) >> [for_each(seller(S), [send(S, call(T))]), collect(T), award(T)],
    collect(T) >> [wait_for(count(seller(_)) == ANSWERED, 5)],
    -collect(T) >> [say("the deadline for", T, "is over")],
    award(T) / min_of((P, S), bid(T, P)[source(S)], (P, S)) >> [
        say(T, "goes to", S, "for", P),
        send(S, accepted(T)),
        wait_for(done(T)[source(S)]),
        say(T, "is done"),
    ],
    award(T) >> [say("nobody does", T)],
)  # fmt: skip

SELLER = Library(
    +call(T)[source(B)] / price(T, P, D) >> [wait(D), send(B, bid(T, P))],
    +call(T)[source(B)] >> [send(B, refusal(T))],
    +accepted(T)[source(B)] >> [say(my_name(), "does", T), wait(2), send(B, done(T))],
)

PRICES = {
    "ann": [price("painting", 300, 1), price("cleaning", 80, 1)],
    "bob": [price("painting", 250, 2), price("cleaning", 90, 9)],
    "cem": [price("painting", 250, 1)],
}


def main():
    society = Society(ManualClock())
    buyer = society.add(Engine("buyer", society.clock, library=BUYER))
    for name, prices in PRICES.items():
        agent = society.add(Engine(name, society.clock, library=SELLER))
        for belief in prices:
            agent.believe(belief)
        buyer.believe(seller(name))
    for task in ("painting", "cleaning", "gardening"):
        buyer.achieve(buy(task))
        run_engine(society, 20.0)


if __name__ == "__main__":
    main()
