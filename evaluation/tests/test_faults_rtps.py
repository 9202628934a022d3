import random

import pytest

from evaluation.faults_rtps import _longest
from evaluation.rtps_attack import ATTACKS, HEADER, ports

KNOWN = bytes(range(16))


@pytest.mark.parametrize("name", ATTACKS)
def test_packets_are_those_of_the_seed_and_fit_into_one_frame(name):
    first, again = ([ATTACKS[name](random.Random(seed), KNOWN) for seed in range(200)] for _ in range(2))
    assert first == again
    assert len(set(first)) > 150
    assert max(map(len, first)) <= 1500
    assert name == "noise" or all(packet.startswith(HEADER) for packet in first)


def test_false_messages_have_the_id_of_the_publisher():
    for name in ("heartbeats", "gaps", "endless_gap"):
        packet = ATTACKS[name](random.Random(1), KNOWN)
        assert packet[8:20] == KNOWN[:12]
        assert packet[28:32] == KNOWN[12:]
        assert len(packet) == 24 + int.from_bytes(packet[22:24], "little")


def test_ports_are_those_of_the_domain():
    assert ports(43)[:3] == [18150, 18160, 18161]


def test_the_longest_gap_includes_both_ends():
    assert _longest([0.0, 1.5, 2.0, 9.0], 1.0, 5.0) == 3.0
    assert _longest([], 1.0, 5.0) == 4.0
