"""A machine whose network comes late, goes, and comes again."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from time import monotonic

import pytest

from socialbot.deployment import network as networks
from socialbot.deployment.network import Network, addresses_of, own_addresses
from tests.system.running import eventually

ADDRESS = "10.77.0.1"


class Cable:
    """What the machine finds out about its addresses."""

    def __init__(self) -> None:
        self.addresses: frozenset[str] = frozenset()
        self.looks = 0

    def __call__(self) -> frozenset[str]:
        self.looks += 1
        return self.addresses

    def plug(self, *addresses: str) -> None:
        """Changes them, and waits until that was seen."""
        self.addresses, looks = frozenset(addresses), self.looks
        assert eventually(lambda: self.looks > looks + 1, 10)


@pytest.fixture
def cable(monkeypatch) -> Cable:
    cable = Cable()
    monkeypatch.setattr(networks, "LOOK_AGAIN_S", 0.01)
    monkeypatch.setattr(networks, "own_addresses", cable)
    return cable


@pytest.fixture
def network(cable) -> Iterator[Network]:
    with Network(ADDRESS) as network:
        cable.plug()
        yield network


def missed(network: Network) -> tuple[float, float]:
    """The times between which somebody who started has missed it."""
    found = network.missed()
    assert found is not None
    return found


def test_who_started_before_it_came_has_missed_it_and_that_is_told_once(cable, network, caplog):
    begun = monotonic()
    cable.plug("127.0.0.1")
    assert network.missed() is None
    cable.plug("127.0.0.1", ADDRESS)
    begin, end = missed(network)
    assert begin < begun < end <= monotonic()
    assert network.missed() is None
    assert [record.getMessage() for record in (*caplog.get_records("setup"), *caplog.records)] == [
        f"{ADDRESS} is not up on this machine: others cannot be reached without",
        f"{ADDRESS} is up now",
    ]


def test_who_started_while_it_was_away_has_missed_it_but_not_who_started_long_before(cable, monkeypatch, caplog):
    monkeypatch.setattr(networks, "UNCERTAIN_S", 0.0)
    cable.addresses = frozenset({ADDRESS})
    with Network(ADDRESS) as network, caplog.at_level(logging.WARNING):
        cable.plug(ADDRESS)
        before = monotonic()
        cable.plug(ADDRESS)
        assert network.missed() is None
        cable.plug()
        between = monotonic()
        cable.plug(ADDRESS)
        begin, end = missed(network)
    assert before < begin < between < end
    assert "is not up" not in caplog.text


def test_who_started_just_before_it_went_may_have_missed_it(cable, network):
    cable.plug(ADDRESS)
    assert network.missed() is not None
    before = monotonic()
    cable.plug()
    cable.plug(ADDRESS)
    begin, _ = missed(network)
    assert before - networks.UNCERTAIN_S - 1.0 < begin < before


def test_a_name_is_looked_up_until_it_is_known(cable, monkeypatch):
    known: list[frozenset[str]] = [frozenset()]
    monkeypatch.setattr(networks, "addresses_of", lambda _: known[0])
    with Network("robot") as network:
        cable.plug(ADDRESS)
        assert network.missed() is None
        known[0] = frozenset({ADDRESS})
        assert eventually(lambda: network.missed() is not None, 10)


def test_the_addresses_of_this_machine_are_found():
    assert "127.0.0.1" in own_addresses()
    assert addresses_of("127.0.0.1") == addresses_of("localhost") == {"127.0.0.1"}
    assert addresses_of("no-such-host.invalid") == frozenset()
