"""The monitor: it reports each violation once, as soon as it is certain."""

from __future__ import annotations

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Health, PersonDetection, PersonDetections, State
from socialbot.runs.expectations import monitor as monitor_module
from socialbot.runs.expectations.monitor import LATE_S, BehaviourMonitor
from socialbot.testing import always, at_all_times, expect, health, never, person, said
from tests.runs.expectations.traces import record, says

START_S = 1000.0


def monitor(**expectations) -> BehaviourMonitor:
    return BehaviourMonitor([found.named(name) for name, found in expectations.items()])


def show(
    watched: BehaviourMonitor, at_s: float, *records, distance_m: float | None = None
) -> list[tuple[str, str, float]]:
    """New violations after a frame at ``at_s`` with a person, and other records."""
    stamp = nanoseconds(START_S + at_s)
    persons = (
        ()
        if distance_m is None
        else (PersonDetection(x=0, y=0, w=1, h=1, score=1, track_id="t1", distance_m=distance_m),)
    )
    frame = PersonDetections(stamp=stamp, frame_id="camera", width=9, height=9, persons=persons)
    watched.observe("/humans/bodies/detections", frame)
    for each in records:
        watched.observe("/trace", each)
    found = watched.poll(stamp + nanoseconds(LATE_S))
    return [(each.verdict.name, each.instance.text, round(each.instance.at_s, 3)) for each in found]


def test_a_late_response_is_reported_once_when_its_time_is_over():
    watched = monitor(greets=expect(said("hello")).within(2).after(person(nearer_than=6)))
    assert show(watched, 0.0) == []
    assert show(watched, 1.0, distance_m=5.0) == []
    assert show(watched, 2.9, distance_m=5.0) == []
    assert show(watched, 3.1, distance_m=5.0) == [("greets", "person t1", 1.0)]
    assert show(watched, 3.2, distance_m=5.0) == []
    assert watched.states["greets"].violations == 1
    assert watched.is_violated("greets", nanoseconds(START_S + 10))
    assert not watched.is_violated("greets", nanoseconds(START_S + 70))


def test_a_response_in_time_is_no_violation():
    watched = monitor(greets=expect(said("hello")).within(2).after(person(nearer_than=6, gap_s=2)))
    show(watched, 0.0)
    show(watched, 1.0, distance_m=5.0)
    assert show(watched, 2.0, *says(START_S + 1.5, "hello"), distance_m=5.0) == []
    assert show(watched, 9.0) == []


def test_events_of_more_than_an_hour_ago_are_forgotten():
    watched = monitor(in_turn=expect(said("hello")).before(said("bye")))
    show(watched, 0.0)
    assert show(watched, 1.0, *says(START_S + 0.5, "hello")) == []
    assert show(watched, 3500.0, *says(START_S + 3499.0, "bye")) == []
    show(watched, 3700.0)
    assert show(watched, 3701.0, *says(START_S + 3700.5, "bye")) == [("in_turn", "", 3700.5)]


def test_forgotten_events_are_no_violations_later():
    watched = monitor(
        waits=never(said("bye")).until(said("hello")),
        is_well=at_all_times(health("camera", "ok")).throughout(),
    )
    states: list[tuple[float, State]] = [(0.0, "ok"), (10.0, "failed"), (12.0, "ok")]
    for at_s, state in states:
        watched.observe("/camera/health", Health(stamp=nanoseconds(START_S + at_s), node="camera", state=state))
    assert show(watched, 20.0, *says(START_S + 19.0, "hello")) == [("is_well", "", 10.0)]
    assert show(watched, 3700.0) == []
    assert show(watched, 3701.0, *says(START_S + 3700.5, "bye")) == []


def test_what_has_no_time_limit_is_not_expected_before_the_end():
    watched = monitor(greets=expect(said("hello")).in_total(), calm=never(said("la*")).throughout())
    show(watched, 0.0)
    assert show(watched, 100.0) == []
    assert show(watched, 101.0, *says(START_S + 100.5, "lala")) == [("calm", "", 100.5)]


def test_health_of_nodes():
    watched = monitor(well=always_expectation())
    show(watched, 0.0)
    watched.observe("/health", Health(stamp=nanoseconds(START_S + 2), node="camera", state="failed"))
    assert show(watched, 3.0) == [("well", "", 2.0)]


def always_expectation():
    from socialbot.runs.expectations.expectations import as_expectation

    found = as_expectation(always(~health("camera", "failed")), "well")
    assert found is not None
    return found


def test_simulated_time_is_that_of_the_messages():
    watched = monitor(greets=expect(said("hello")).within(2).after(person(nearer_than=6)))
    show(watched, 0.0)
    show(watched, 1.0, distance_m=5.0)
    assert watched.poll(nanoseconds(1.7e9)) == []


def test_older_half_of_too_long_records_is_discarded(monkeypatch):
    monkeypatch.setattr(monitor_module, "MOST_BYTES", 1_000_000)
    watched = monitor(greets=expect(said("hello")).within(2).after(person(nearer_than=6)))
    sizes = []
    for number in range(500):
        show(watched, number, record(START_S + number, "belief", "x" * 10_000))
        sizes.append(sum(len(each.what) for each in watched.history))
    assert max(sizes) <= 1_000_000
    assert min(sizes[200:]) >= 400_000
    assert show(watched, 500.0, distance_m=5.0) == []
    assert show(watched, 502.1, distance_m=5.0) == [("greets", "person t1", 500.0)], "it still judges"


def test_messages_that_arrive_during_a_poll_wait_for_the_next_one(monkeypatch):
    watched = monitor(greets=expect(said("hello")).within(2).after(person(nearer_than=6)))
    taken = []

    def flooded(topic, message):
        taken.append(message)
        watched.observe(topic, message)

    monkeypatch.setattr(monitor_module, "trace_record", flooded)
    watched.observe("/trace", record(START_S, "belief", "a"))
    for _ in range(5):
        watched.poll(nanoseconds(START_S + 1))
    assert len(taken) == 5
