import logging

import pytest

from evaluation.report import Report
from evaluation.soak import Minute, NodeThread, growth, p99_drift, soak, verdict


def minute(p99_us):
    return Minute(60.0, 1, 50.0, 0.5, 100.0, p99_us, 900.0, 0)


def test_memory_that_only_grew_in_the_beginning_is_flat():
    assert growth([50.0] * 30 + [60.0] * 60) == pytest.approx(0, abs=1e-9)


def test_growth_is_that_of_a_line_through_the_last_two_thirds():
    assert growth([0.0] * 10 + [100.0 + i for i in range(21)]) == pytest.approx(0.2)
    assert growth([100.0, 99.0, 101.0, 99.0, 101.0, 100.0] * 20) < 0.01
    assert growth([1.0]) == 0


def test_one_bad_minute_is_no_drift():
    assert p99_drift([minute(100), minute(110), minute(100), minute(100), minute(9000), minute(110)]) > 1.5
    assert p99_drift([minute(100)] * 8 + [minute(9000)]) == 1
    assert p99_drift([minute(100)] * 6 + [minute(200)] * 3) == 2


@pytest.mark.slow
def test_a_short_run_has_all_events_and_loses_none(caplog):
    caplog.set_level(logging.ERROR, "socialbot.bdi")
    life, told = NodeThread(rate=4_000), []
    minutes, memory = soak(life, seconds=1.5, period_s=0.5, tell=told.append)
    while life.society.run_until_idle():
        pass
    report = Report("soak", quick=True)
    verdict(report, life, minutes, memory)
    content = report.content()
    assert len(minutes) == len(told) == 3
    assert content["events"] == life.events == sum(part.events for part in minutes)
    assert life.events == pytest.approx(6_000, rel=0.3)
    assert life.deeds.posted == {}, "every probe was acted upon"
    for what in ("greeted", "not_greeted", "fetched", "recovered", "dark", "left", "answered", "rested"):
        assert content[what] > 0, what
    assert all(part.p50_us <= part.p99_us <= part.max_us for part in minutes)
    assert len(life.records) > 1_000


def test_agents_learn_and_unlearn_plans_in_the_course_of_a_life():
    life = NodeThread(rate=1)
    for number in range(3 * 50):
        life._teach(number)
        life.society.run_until_idle()
    taught = [plan.label for plan in life.agent.library if plan.label]
    assert 20 < len(taught) <= 26
    assert len(set(taught)) == len(taught)
