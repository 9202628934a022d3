from __future__ import annotations

import itertools
import statistics

import pytest

from evaluation.hospital_record import CONFIGURATIONS, RATES, SEEDS, Configuration, MissionRecord
from evaluation.hospital_runs import NOISE, Moment, Run, graph_for, is_drawn, play
from evaluation.hospital_statistics import binomial
from socialbot.agents.hospital.robot_node import HospitalAgent
from socialbot.agents.hospital.scripted import ScriptedAgent


def without_real_time(record: MissionRecord) -> tuple:
    return (
        record.drawn, record.met, record.completed, record.recoveries, record.plans, record.actions, record.mission_s,
        record.share.acting_s, len(record.recovered),
    )  # fmt: skip


def test_configurations_differ_in_agents_and_policies_and_in_nothing_else():
    graphs = {configuration: graph_for(configuration, 25.0, 7) for configuration in CONFIGURATIONS}
    worlds = [graph.node("world") for graph in graphs.values()]
    assert worlds[0] == worlds[1] == worlds[2]
    assert worlds[0].parameters == {"rate": 25.0, "seed": 7, "noise": NOISE}
    assert graphs["bdi"].node("coordinator").parameters == {"pace": "paper", "policy": "none", "proactive": False}
    assert graphs["bdi+recovery"].node("coordinator").parameters == {
        "pace": "paper",
        "policy": "auto",
        "proactive": False,
    }
    for configuration, kind in (("plain", ScriptedAgent), ("bdi", HospitalAgent), ("bdi+recovery", HospitalAgent)):
        agents = [each for each in graphs[configuration].nodes if issubclass(each.type, kind)]
        assert len(agents) == 3
        assert all(each.parameters.get("recovers", False) is (configuration == "bdi+recovery") for each in agents)


@pytest.mark.parametrize("configuration", CONFIGURATIONS)
def test_a_mission_without_a_problem_is_completed(configuration: Configuration):
    record = play(configuration, 0.0, 3)
    assert record.completed
    assert not record.drawn
    assert not record.met
    assert (record.plans, record.actions, record.recoveries, record.recovered) == (1, 9, 0, ())
    assert record.mission_s == pytest.approx(4.2, abs=0.1)
    assert record.share.acting_s == record.mission_s
    assert min(record.share.reasoning_s, record.share.planning_s, record.share.communication_s) > 0.0
    assert record.wall_s > record.share.reasoning_s + record.share.planning_s


@pytest.mark.parametrize("configuration", ["plain", "bdi"])
def test_without_recovery_a_problem_ends_the_mission(configuration: Configuration):
    record = play(configuration, 100.0, 3)
    assert (record.drawn, record.met, record.completed) == (True, True, False)
    assert (record.plans, record.actions, record.recoveries, record.recovered) == (1, 6, 0, ())
    assert record.mission_s < 2.6


def test_with_recovery_it_is_completed_and_takes_a_little_longer():
    record = play("bdi+recovery", 100.0, 3)
    assert (record.drawn, record.met, record.completed) == (True, True, True)
    assert (record.plans, record.actions, record.recoveries) == (2, 14, 1)
    (recovered,) = record.recovered
    assert recovered.acting_s == 0.0
    assert 0.0 < recovered.planning_s < record.share.planning_s
    assert 0.0 < recovered.reasoning_s < record.share.reasoning_s
    assert record.mission_s / play("bdi+recovery", 0.0, 3).mission_s < 1.08


def test_all_but_real_time_is_the_same_each_time():
    assert without_real_time(play("bdi+recovery", 50.0, 5)) == without_real_time(play("bdi+recovery", 50.0, 5))


def test_durations_differ_from_seed_to_seed_but_little():
    times = [play("plain", 0.0, seed).mission_s for seed in range(10)]
    assert len(set(times)) == 10
    assert 0.001 < statistics.stdev(times) / statistics.fmean(times) < NOISE


def test_durations_depend_on_the_seed_not_on_the_team():
    assert len({play(configuration, 0.0, 4).mission_s for configuration in CONFIGURATIONS}) == 1


@pytest.mark.parametrize("rate", RATES)
def test_as_many_problems_are_drawn_as_are_to_be_expected(rate: int):
    assert sum(is_drawn(rate, seed) for seed in range(SEEDS)) in binomial(rate / 100.0, SEEDS)


def test_a_problem_that_is_drawn_is_drawn_at_all_higher_rates():
    drawn = [{seed for seed in range(SEEDS) if is_drawn(rate, seed)} for rate in RATES]
    assert all(fewer <= more for fewer, more in itertools.pairwise(drawn))


def test_a_mission_that_never_ends_is_not_completed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("evaluation.hospital_runs.LIMIT_S", 2.0)
    record = play("bdi", 0.0, 0)
    assert not record.completed
    assert record.mission_s == pytest.approx(2.0, abs=0.21)


def test_a_node_that_raises_leaves_nothing_to_record():
    run = Run("plain", 0.0, 0)
    run.runner.tap("/hospital/missions", lambda topic, message: run.runner.faults["spotrobot1"].count(KeyError("x")))
    with pytest.raises(RuntimeError, match=r"plain, 0 %, seed 0: .*spotrobot1.*KeyError"):
        run.play()


def test_time_that_no_node_used_counts_as_communication():
    share = Moment(1.0, 0.1, 0.2, 0.3).until(Moment(2.0, 0.2, 0.4, 0.5), acting_s=3.0)
    assert (share.reasoning_s, share.planning_s, share.communication_s) == pytest.approx((0.1, 0.2, 0.5))
    assert share.acting_s == 3.0
