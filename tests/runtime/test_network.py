"""A machine whose network starts late or has outages."""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterator
from time import monotonic
from types import SimpleNamespace

import psutil
import pytest

from socialbot.runtime import _network as networks
from socialbot.runtime._network import Network, addresses_of, own_addresses
from tests.system.running import eventually

ADDRESS = "10.77.0.1"


class Cable:
    """Addresses of the machine, as the monitor finds them."""

    def __init__(self) -> None:
        self.addresses: frozenset[str] = frozenset()
        self.looks = 0

    def __call__(self) -> frozenset[str]:
        self.looks += 1
        return self.addresses

    def plug(self, *addresses: str) -> None:
        """Change the addresses, and wait until the monitor has read them."""
        self.addresses, looks = frozenset(addresses), self.looks
        assert eventually(lambda: self.looks > looks + 1)


@pytest.fixture
def cable(monkeypatch) -> Cable:
    cable = Cable()
    monkeypatch.setattr(networks, "POLL_S", 0.01)
    monkeypatch.setattr(networks, "own_addresses", cable)
    return cable


@pytest.fixture
def network(cable) -> Iterator[Network]:
    with Network(ADDRESS) as network:
        cable.plug()
        yield network


def missed(network: Network) -> tuple[float, float]:
    """Interval of the starts that missed the network."""
    found = network.missed()
    assert found is not None
    return found


def test_processes_started_before_the_network_missed_it(cable, network, caplog):
    begun = monotonic()
    cable.plug("127.0.0.1")
    assert network.missed() is None
    cable.plug("127.0.0.1", ADDRESS)
    begin, end = missed(network)
    assert begin < begun < end <= monotonic()
    assert network.missed() is None
    assert [record.getMessage() for record in (*caplog.get_records("setup"), *caplog.records)] == [
        f"{ADDRESS} is down on this machine: other machines are unreachable",
        f"{ADDRESS} is up now",
    ]


def test_processes_started_during_an_outage_missed_the_network(cable, monkeypatch, caplog):
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
    assert "is down" not in caplog.text


def test_processes_started_just_before_an_outage_may_have_missed_the_network(cable, network):
    cable.plug(ADDRESS)
    assert network.missed() is not None
    before = monotonic()
    cable.plug()
    cable.plug(ADDRESS)
    begin, _ = missed(network)
    assert before - networks.UNCERTAIN_S - 1.0 < begin < before


def test_resolves_a_name_until_it_is_known(cable, monkeypatch):
    known: list[frozenset[str]] = [frozenset()]
    monkeypatch.setattr(networks, "addresses_of", lambda _: known[0])
    with Network("robot") as network:
        cable.plug(ADDRESS)
        assert network.missed() is None
        known[0] = frozenset({ADDRESS})
        assert eventually(lambda: network.missed() is not None)


def test_an_error_of_the_addresses_changes_nothing(cable, network, monkeypatch):
    def refuse() -> frozenset[str]:
        looks.append(1)
        raise OSError(24, "Too many open files")

    looks: list[int] = []
    monkeypatch.setattr(networks, "own_addresses", refuse)
    assert eventually(lambda: len(looks) > 1)
    assert network.missed() is None
    monkeypatch.setattr(networks, "own_addresses", cable)
    cable.plug(ADDRESS)
    assert network.missed() is not None


def test_joins_unread_outages(cable, network, monkeypatch):
    monkeypatch.setattr(networks, "UNCERTAIN_S", 0.0)
    begun = monotonic()
    cable.plug(ADDRESS)
    cable.plug()
    between = monotonic()
    cable.plug(ADDRESS)
    begin, end = missed(network)
    assert begin < begun < between < end


def test_the_own_host_name_is_up_with_any_network(cable, monkeypatch):
    """Debian writes such a name into /etc/hosts."""
    monkeypatch.setattr(networks, "addresses_of", lambda _: frozenset({"127.0.1.1"}))
    cable.addresses = frozenset({"127.0.0.1"})
    with Network("robot") as network:
        cable.plug("127.0.0.1")
        assert network.missed() is None
        cable.plug("127.0.0.1", ADDRESS)
        assert network.missed() is not None


def test_a_labelled_address_belongs_to_its_interface(monkeypatch):
    def address(text: str) -> SimpleNamespace:
        return SimpleNamespace(family=socket.AF_INET, address=text)

    interfaces = {
        "eth0": [address("192.0.2.7")],
        "eth0:1": [address(ADDRESS)],
        "eth1:1": [address("192.0.2.8")],
    }
    monkeypatch.setattr(psutil, "net_if_addrs", lambda: interfaces)
    states = {"eth0": SimpleNamespace(flags="up,running"), "eth1": SimpleNamespace(flags="up")}
    monkeypatch.setattr(psutil, "net_if_stats", lambda: states)
    assert own_addresses() == {"192.0.2.7", ADDRESS}


def test_finds_the_addresses_of_this_machine():
    assert "127.0.0.1" in own_addresses()
    assert addresses_of("127.0.0.1") == addresses_of("localhost") == {"127.0.0.1"}
    assert addresses_of("no-such-host.invalid") == frozenset()
