"""Couriers: a dispatcher offers each parcel to three couriers, and the best bid gets it.

A bid is the time until a courier would have delivered the parcel, after the parcels that it has already. A courier that
is lost or gives up is replaced by the next best one.
"""

from pathlib import Path

from socialbot import (
    SECOND,
    Deliberating,
    Graph,
    InlineRunner,
    NodeConfig,
    Parameter,
    PlanAction,
    fluent,
    instance,
    predicate,
)
from socialbot.deliberation import AuctionAction, Desire

COURIERS = {"ann": "north", "ben": "harbour", "cem": "south"}
PLACES = {"north": 0.0, "market": 4.0, "harbour": 10.0, "south": 16.0}
PARCELS = {"books": "market", "fish": "harbour", "soap": "south", "tea": "market"}


class drive(PlanAction):
    """Drive for as long as the distance takes."""

    rate_hz = 1.0

    def begin(self, courier, start, target):
        self.due = self.engine.clock.now() + round(SECOND * abs(PLACES[start] - PLACES[target]))

    def advance(self):
        return 1.0 if self.engine.clock.now() >= self.due else 0.5


class deliver(PlanAction):
    """Hand a parcel over."""

    rate_hz = 1.0

    def advance(self):
        return self.progress_made + 0.5


class Courier(Deliberating):
    """Courier with the name of its node. It bids, as dispatchers may change its desires."""

    folder = Path(__file__).parent
    actions_known = (drive, deliver)
    pddl_file = Parameter("courier.pddl", "the domain", fixed=True)
    desire_w = Parameter("dispatchers", "groups that may change its desires", fixed=True)
    desire_pr = Parameter("0.6", "the highest priority that each group of desire_w may give", fixed=True)

    def beliefs_at_first(self):
        yield instance(self.name, "courier")
        yield from (instance(place, "place") for place in PLACES)
        yield from (fluent("drive_s", a, b, value=abs(PLACES[a] - PLACES[b])) for a in PLACES for b in PLACES)
        yield from (instance(parcel, "parcel") for parcel in PARCELS)
        yield from (predicate("waits", *pair) for pair in PARCELS.items())
        yield predicate("at", self.name, COURIERS[self.name])


class dispatch(AuctionAction):
    """Let the courier with the best bid deliver a parcel."""

    def bidders(self):
        return tuple(COURIERS)

    def offer(self):
        return Desire(name=f"deliver_{self.args[0]}", value=(predicate("delivered", self.args[0]),), priority=0.6)


class Dispatcher(Deliberating):
    """Dispatcher that wants all parcels delivered."""

    folder = Path(__file__).parent
    actions_known = (dispatch,)
    pddl_file = Parameter("dispatcher.pddl", "the domain", fixed=True)
    agent_group = Parameter("dispatchers", "the group it belongs to", fixed=True)

    def beliefs_at_first(self):
        return [instance(parcel, "parcel") for parcel in PARCELS]

    def desires_at_first(self):
        yield Desire(name="all_delivered", value=tuple(predicate("delivered", one) for one in PARCELS), deadline=120)


def town() -> Graph:
    """The graph of the dispatcher and its couriers."""
    return Graph("town", (*(NodeConfig(name, Courier) for name in COURIERS), NodeConfig("office", Dispatcher)))


def main() -> None:
    runner = InlineRunner(town())

    def tell(topic, record):
        if record.kind == "auction":
            bids = ", ".join(f"{name} {bid:.0f} s" for name, bid in record.detail["bids"].items())
            print(f"{record.stamp / SECOND:4.1f} s  {record.what}: {bids}; {record.detail['winner']} gets it")
        elif record.kind == "desire_fulfilled":
            print(f"{record.stamp / SECOND:4.1f} s  {record.source}: {record.what} is done")

    for name in (*COURIERS, "office"):
        runner.tap(f"/{name}/trace", tell)
    runner.start()
    runner.advance(10 * SECOND)


if __name__ == "__main__":
    main()
