from __future__ import annotations

import pytest

from socialbot.core.errors import GraphError
from socialbot.graph.node import Graph, NodeConfig
from socialbot.runtime.deployment import Deployment, is_address, is_own
from socialbot.vision.camera import Camera
from tests.runtime.deployments import deployment

EYES = Graph("eyes", (NodeConfig("camera", Camera),))


def test_one_machine_stays_by_itself():
    assert Deployment(EYES, {"laptop": "127.0.0.1"}, {"camera": "laptop"}).across("laptop") is None


def test_a_machine_knows_itself_by_its_address():
    here = Deployment(EYES, {"laptop": "127.0.0.1", "robot": "192.0.2.7"}, {"camera": "robot"})
    assert here.this_machine() == "laptop"


@pytest.mark.parametrize(
    ("machines", "words"),
    [
        ({"robot": "192.0.2.7", "desk": "192.0.2.8"}, "none of the addresses: robot .192.0.2.7., desk"),
        ({"robot": "127.0.0.1", "desk": "127.0.0.2"}, "this could be robot or desk"),
    ],
)
def test_a_machine_that_does_not_know_itself_is_told_which_there_are(machines: dict[str, str], words: str):
    with pytest.raises(GraphError, match=words) as caught:
        Deployment(EYES, machines, {"camera": "robot"}).this_machine()
    assert "--machine" in str(caught.value)


def test_a_machine_that_is_not_there_has_no_half():
    with pytest.raises(GraphError, match="did you mean 'robot'"):
        deployment().half("robto")


def test_addresses_are_told_from_other_texts():
    assert all(map(is_address, ("10.0.0.1", "robot", "robot.local", "a-b.example.org")))
    assert not any(
        map(is_address, ("", "10.0.0", "1.2.3.4.5", "::1", "a b", "-a", "a..b", "a;b", "x" * 64, "10.0.0.1\n"))
    )
    assert is_own("127.0.0.1")
    assert not is_own("192.0.2.7")
