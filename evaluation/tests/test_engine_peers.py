import pytest

from evaluation.engine_peers import AgentSpeak, Trees, peers, rate
from evaluation.tests.test_engine import TINY


def test_a_rate_is_taken_over_as_many_units_as_fit():
    done: list[int] = []
    assert rate(done.append, most=10) > 0
    assert done == [10, 10, 10, 10]
    assert rate(done.append, most=3, least=5) > 0
    assert done[-1] == 5


@pytest.mark.parametrize(("module", "peer"), [("agentspeak", AgentSpeak), ("py_trees", Trees)])
def test_a_peer_that_is_installed_runs_the_workloads_it_can(module, peer):
    pytest.importorskip(module)
    assert set(peers()) >= {module}
    workloads = peer().workloads()
    for name in workloads.keys() - {"W4", "W6"}:
        assert all(value > 0 for value in workloads[name](TINY).values()), name


def test_the_other_engine_hands_tokens_on():
    pytest.importorskip("agentspeak")
    assert AgentSpeak().hand_on(size=3, tokens=2, hops=5) > 0
