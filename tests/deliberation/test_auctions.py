"""Auctions of the couriers example: bids, awards, and winners that are lost, stuck or not permitted."""

from __future__ import annotations

import math
from types import ModuleType

import pytest

from socialbot.agents.base.deliberating import Deliberating
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message, TraceRecord
from socialbot.deliberation import predicate
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from tests.example_modules import load_example


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return load_example("couriers")


class Town:
    """Run of the example with its trace."""

    def __init__(self, example: ModuleType, graph: Graph | None = None) -> None:
        self.example, self.records = example, list[TraceRecord]()
        self.runner = InlineRunner(graph or example.town())
        for name in (*example.COURIERS, "office"):
            self.runner.tap(f"/{name}/trace", self._take)
        self.runner.start()

    def _take(self, topic: str, record: Message) -> None:
        assert isinstance(record, TraceRecord)
        self.records.append(record)

    def until(self, seconds: float) -> Town:
        self.runner.advance(nanoseconds(seconds))
        return self

    def found(self, kind: str, what: str = "", source: str = "") -> list[TraceRecord]:
        return [one for one in self.records if one.kind == kind and what in one.what and source in one.source]

    @property
    def delivered(self) -> dict[str, list[str]]:
        """Couriers that have delivered each parcel."""
        ended = [one for one in self.found("step_end", "deliver ") if one.detail["outcome"] == "successful"]
        return {
            parcel: [one.source for one in ended if parcel in one.what and one.source != "office"]
            for parcel in self.example.PARCELS
        }


@pytest.fixture(scope="module")
def town(example) -> Town:
    """The run without faults."""
    return Town(example).until(12)


def test_each_parcel_goes_to_the_best_bid(example, town):
    for auction in town.found("auction"):
        bids = auction.detail["bids"]
        assert set(bids) == set(example.COURIERS)
        assert auction.detail["winner"] == min(bids, key=bids.get)
        parcel = auction.what.removeprefix("deliver_")
        assert town.delivered[parcel] == [auction.detail["winner"]]
    assert len(town.found("auction")) == len(example.PARCELS)
    assert town.found("desire_fulfilled", "all_delivered")


def test_a_bid_is_close_to_the_actual_time(town):
    for auction in town.found("auction"):
        winner = auction.detail["winner"]
        (end,) = town.found("desire_fulfilled", auction.what, winner)
        actual_s = (end.stamp - auction.stamp) / SECOND
        assert math.isclose(actual_s, auction.detail["bids"][winner], abs_tol=2.0)


def test_a_busy_courier_bids_for_the_time_after_its_work(town):
    first, later = (town.found("auction", f"deliver_{parcel}")[0].detail["bids"] for parcel in ("books", "fish"))
    assert first["ann"] == pytest.approx(6.0, abs=0.1)
    # The rest of the way to the market, the parcel there, and the way to the harbour.
    assert later["ann"] > 13.0


def test_a_courier_that_knows_a_parcel_to_be_delivered_bids_no_time_and_wins(example):
    town = Town(example)
    node = town.runner.nodes["ben"]
    assert isinstance(node, Deliberating)
    ben = node.deliberator
    ben.engine.call(lambda: ben.facts.add(predicate("delivered", "books")))
    town.until(4)
    (auction,) = town.found("auction", "deliver_books")
    assert auction.detail["bids"]["ben"] == 0.0
    assert auction.detail["winner"] == "ben"
    (end,) = town.found("step_end", "dispatch books")
    assert end.detail["outcome"] == "successful"


@pytest.mark.slow
def test_the_next_best_courier_replaces_a_dead_one(example):
    town = Town(example).until(2)
    town.runner.kill("ann")
    town.until(100)
    assert [len(by) for by in town.delivered.values()] == [1] * len(example.PARCELS)
    again = town.found("auction", "deliver_books")[1]
    assert set(again.detail["bids"]) == {"ben", "cem"}
    assert town.found("desire_fulfilled", "all_delivered")


@pytest.mark.slow
def test_a_courier_that_hangs_is_replaced_and_drops_the_parcel(example, monkeypatch):
    move = example.drive.advance
    monkeypatch.setattr(example.drive, "advance", lambda one: 0.5 if one.engine.name == "ann" else move(one))
    town = Town(example).until(200)
    assert all("ann" not in by and len(by) == 1 for by in town.delivered.values())
    (dropped,) = town.found("desire_dropped", "deliver_books", "ann")
    assert dropped.detail["reason"] == "office asked for it"


@pytest.mark.slow
def test_a_courier_that_joins_late_does_not_delay_the_others(example):
    town = Town(example)
    town.runner.kill("cem")
    town.until(5)
    assert town.found("auction")[0].detail["bids"]["cem"] == "no answer from cem in 2 s"
    town.runner.restart("cem")
    town.until(30)
    assert town.found("desire_fulfilled", "all_delivered")


def test_without_permission_nobody_bids_and_the_reason_says_so(example):
    couriers = (NodeConfig(name, example.Courier, {"desire_w": "others"}) for name in example.COURIERS)
    office = NodeConfig("office", example.Dispatcher, {"exec_plan_tries": 2})
    town = Town(example, Graph("town", (*couriers, office))).until(10)
    (dropped,) = town.found("desire_dropped", "all_delivered")
    assert "group 'dispatchers' may not bid for desires; these may: others" in dropped.detail["reason"]
    assert not any(town.delivered.values())


def test_a_withdrawn_auction_withdraws_the_desire_of_the_winner(example):
    town = Town(example).until(2)
    node = town.runner.nodes["office"]
    assert isinstance(node, Deliberating)
    office = node.deliberator
    office.engine.call(lambda: office.drop("all_delivered"))
    town.until(8)
    assert {one.detail["reason"] for one in town.found("desire_dropped", "deliver_books")} == {"office asked for it"}
    assert town.delivered["books"] == []
