"""Replacement of subscriptions that miss messages, without DDS."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import pytest

from socialbot.bridge import dds_threads
from socialbot.bridge.detached_seals import LOST_MATCHED_S, LOST_MESSAGES, MISSING_S, MessageWatch
from socialbot.bridge.stream_watch import (
    CHECK_S,
    COPIES_S,
    FOREIGN_PAUSE_S,
    KNOWN_S,
    LOST_S,
    MAX_PAUSE_S,
    MAX_SAMPLES,
    MAX_STREAMS,
    OVERLAP_S,
    SILENT_S,
    Backoff,
    Note,
    StreamWatch,
    WatchedSubscription,
    replace_faulty,
)
from tests.bridge.dds_threads import busy_dds_thread
from tests.system.running import eventually

ROBOT, OTHER = ("robot", "1"), ("robot", "2")


class Time:
    """A clock that is set."""

    now = 100.0

    def __call__(self) -> float:
        return self.now

    def passes(self, seconds: float) -> None:
        self.now += seconds


class Ros:
    """Keeps the subscriptions that exist."""

    def __init__(self) -> None:
        self.present: list[SimpleNamespace] = []
        self.publishers = 1

    def create(self, note: Note, topic: str = "/said") -> SimpleNamespace:
        made = SimpleNamespace(topic_name=topic, get_publisher_count=lambda: self.publishers, arrives=note)
        self.present.append(made)
        return made

    def destroy_subscription(self, subscription: SimpleNamespace) -> None:
        self.present.remove(subscription)


@pytest.fixture
def time() -> Time:
    return Time()


@pytest.fixture
def ros() -> Ros:
    return Ros()


@pytest.fixture
def watch(time) -> StreamWatch:
    return StreamWatch(clock=time)


@pytest.fixture
def subscription(ros, watch, time) -> WatchedSubscription:
    return WatchedSubscription(ros, ros.create, watch, time)


def faults(subscription: WatchedSubscription, time: Time, seconds: float) -> list[float]:
    """Times from now when the subscription is replaced."""
    begun, found = time.now, []
    while time.now < begun + seconds:
        time.passes(CHECK_S)
        if replace_faulty([subscription]):
            found.append(time.now - begun)
    return found


class TestStreamWatch:
    def test_each_publisher_has_to_be_heard(self, watch, time):
        watch.note(ROBOT, 1, is_beacon=False)
        assert watch.fault(1) == ""
        assert watch.fault(2) == "1 of 2 publishers are silent"
        watch.note(OTHER, 0, is_beacon=True)
        assert watch.fault(2) == ""
        time.passes(SILENT_S)
        assert watch.fault(2) == ""
        time.passes(0.1)
        assert watch.fault(2) == "2 of 2 publishers are silent"

    def test_a_beacon_shows_lost_messages(self, watch):
        watch.note(ROBOT, 1, is_beacon=False)
        watch.note(ROBOT, 1, is_beacon=True)
        assert watch.fault(1) == ""
        watch.note(ROBOT, 3, is_beacon=True)
        assert watch.fault(1) == "2 messages did not arrive"
        watch.note(ROBOT, 4, is_beacon=False)
        assert watch.fault(1) == "2 messages did not arrive"
        watch.begin_again()
        watch.note(ROBOT, 9, is_beacon=True)
        assert watch.fault(1) == ""

    def test_lost_messages_of_a_best_effort_subscription_are_no_fault(self, watch):
        watch.expects_all = False
        watch.note(ROBOT, 1, is_beacon=False)
        watch.note(ROBOT, 3, is_beacon=True)
        assert watch.fault(1) == ""

    def test_messages_lost_for_a_time_are_a_fault(self, watch, time):
        for number in range(0, 100, 2):
            watch.note(ROBOT, number, is_beacon=False)
            assert (watch.fault(1) != "") == (number * 0.5 > 1 + SILENT_S), number
            time.passes(1.0)
        assert watch.fault(1) == "messages are lost for 48 s"
        watch.begin_again()
        watch.note(ROBOT, 200, is_beacon=False)
        assert watch.fault(1) == ""

    def test_messages_lost_at_once_are_no_fault(self, watch, time):
        """Such as those of an outage that did not fit into the queue of the publisher."""
        for number in (1, 2, 103, 104):
            watch.note(ROBOT, number, is_beacon=False)
            time.passes(0.1)
        for number in range(105, 150):
            watch.note(ROBOT, number, is_beacon=False)
            assert watch.fault(1) == ""
            time.passes(1.0)
        watch.note(ROBOT, 200, is_beacon=False)
        assert watch.fault(1) == ""

    def test_messages_that_a_short_queue_drops_are_no_fault(self, watch, time):
        watch.keeps_all = False
        for number in range(0, 100, 2):
            watch.note(ROBOT, number, is_beacon=False)
            time.passes(1.0)
        assert watch.fault(1) == ""

    def test_publishers_without_keys_are_no_fault_where_there_are_some(self, watch, time):
        watch.has_foreign = True
        assert watch.fault(3) == ""
        watch.note(ROBOT, 1, is_beacon=False)
        watch.note(OTHER, 1, is_beacon=False)
        assert watch.fault(3) == ""
        time.passes(SILENT_S)
        watch.note(ROBOT, 2, is_beacon=False)
        time.passes(0.1)
        assert watch.fault(3) == "1 of 3 publishers are silent"
        watch.begin_again()
        assert watch.fault(3) == "2 of 3 publishers are silent"
        watch.note(ROBOT, 3, is_beacon=False)
        assert watch.fault(2) == ""

    def test_a_restarted_publisher_is_one_publisher(self, watch, time):
        watch.has_foreign = True
        watch.note(ROBOT, 1, is_beacon=False)
        watch.note(OTHER, 1, is_beacon=False)
        assert watch.fault(1) == ""
        time.passes(SILENT_S)
        watch.note(OTHER, 2, is_beacon=False)
        time.passes(0.1)
        assert watch.fault(1) == ""

    def test_a_publisher_that_a_replacement_does_not_bring_back_is_lost(self, watch, time):
        watch.note(ROBOT, 1, is_beacon=False)
        watch.note(OTHER, 1, is_beacon=False)
        assert watch.lost(2, 2) == 0
        lost = []
        for second in range(30):
            watch.note(ROBOT, 2 + second, is_beacon=False)
            if second == 7:
                watch.begin_again()
                assert watch.lost(2, 2) == 0
                watch.note(ROBOT, 2 + second, is_beacon=False)
            lost.append(watch.lost(1, 2))
            time.passes(1.0)
        assert lost == 15 * [0] + 15 * [1]
        watch.note(OTHER, 2, is_beacon=True)
        assert watch.lost(1, 2) == 0

    def test_a_publisher_that_was_never_heard_is_lost(self, watch, time):
        assert (watch.lost(0, 0), watch.lost(0, 1)) == (0, 0)
        time.passes(LOST_S)
        assert watch.lost(0, 1) == 1

    def test_more_publishers_than_wanted_are_no_loss(self, watch, time):
        watch.note(ROBOT, 1, is_beacon=False)
        assert watch.lost(1, 0) == 0
        time.passes(LOST_S)
        assert watch.lost(1, 0) == 0

    def test_only_publishers_that_were_heard_are_surely_missed(self, watch, time):
        watch.fault(1)
        assert not watch.is_sure
        watch.note(ROBOT, 1, is_beacon=False)
        watch.fault(2)
        assert not watch.is_sure
        time.passes(SILENT_S + 0.1)
        watch.fault(2)
        assert watch.is_sure
        watch.begin_again()
        watch.fault(2)
        assert watch.is_sure
        watch.note(ROBOT, 2, is_beacon=False)
        watch.fault(2)
        assert not watch.is_sure
        watch.note(ROBOT, 4, is_beacon=True)
        watch.fault(2)
        assert watch.is_sure

    @pytest.mark.parametrize("has_foreign", [False, True])
    def test_a_publisher_that_left_as_another_one_came_is_forgotten(self, watch, time, has_foreign):
        """A stranger may hide that a publisher has left, as their number stays the same."""
        watch.has_foreign = has_foreign
        watch.note(ROBOT, 1, is_beacon=False)
        for _ in range(round(SILENT_S + KNOWN_S)):
            watch.fault(1)
            time.passes(1.0)
        assert watch.fault(1)
        assert watch.is_sure
        time.passes(2.0)
        assert bool(watch.fault(1)) != has_foreign
        assert not watch.is_sure

    def test_memory_is_bounded(self, watch):
        for number in range(2 * MAX_STREAMS):
            watch.note(("robot", str(number)), 1, is_beacon=False)
        assert len(watch._heard) == MAX_STREAMS
        assert watch.fault(MAX_STREAMS) == ""
        assert ("robot", str(2 * MAX_STREAMS - 1)) in watch._heard


class TestMessageWatch:
    def test_seals_without_messages_are_a_fault(self, time):
        watch = MessageWatch(time)
        watch.expect(ROBOT)
        time.passes(MISSING_S)
        assert watch.fault(1) == ""
        time.passes(0.1)
        watch.expect(ROBOT)
        assert watch.fault(1) == "messages of 1 publishers do not arrive, but their seals do"
        watch.note(OTHER)
        assert watch.fault(1)
        watch.note(ROBOT)
        assert watch.fault(1) == ""
        watch.expect(ROBOT)
        watch.begin_again()
        time.passes(2 * MISSING_S)
        assert watch.fault(1) == ""

    @pytest.mark.parametrize(("publishers", "least_s"), [(0, LOST_S), (1, LOST_MATCHED_S)])
    def test_a_publisher_whose_seals_alone_arrive_is_lost(self, time, publishers, least_s):
        watch = MessageWatch(time)
        for _ in range(round(least_s)):
            watch.expect(ROBOT)
            time.passes(1.0)
            assert watch.lost(publishers, 1) == 0
        watch.begin_again()
        watch.expect(ROBOT)
        assert watch.lost(publishers, 1) == 1
        watch.note(ROBOT)
        assert watch.lost(publishers, 1) == 0

    def test_single_messages_of_long_ago_are_no_loss(self, time):
        watch = MessageWatch(time)
        for _ in range(LOST_MESSAGES - 1):
            watch.expect(ROBOT)
            assert watch.lost(1, 1) == 0
            time.passes(3600.0)
        watch.expect(ROBOT)
        time.passes(LOST_S)
        assert watch.lost(1, 1) == 0

    def test_memory_is_bounded(self, time):
        watch = MessageWatch(time)
        for number in range(2 * MAX_STREAMS):
            watch.expect(("robot", str(number)))
        assert len(watch._missed) == MAX_STREAMS


class TestBackoff:
    def test_each_pause_is_twice_as_long_as_the_one_before(self, time):
        backoff, pauses = Backoff(time), []
        for _ in range(7):
            assert backoff.is_over
            backoff.begin()
            begun = time.now
            while not backoff.is_over:
                time.passes(1.0)
            pauses.append(time.now - begun)
        assert pauses == [12.0, 24.0, 48.0, 96.0, 192.0, FOREIGN_PAUSE_S, FOREIGN_PAUSE_S]

    @pytest.mark.parametrize(("quiet_s", "pause_s"), [(FOREIGN_PAUSE_S, 96.0), (FOREIGN_PAUSE_S + 1.0, 12.0)])
    def test_begins_anew_after_a_quiet_time(self, time, quiet_s, pause_s):
        backoff = Backoff(time)
        for _ in range(3):
            backoff.begin()
            time.passes(48.0)
        time.passes(quiet_s)
        backoff.begin()
        time.passes(pause_s - 1.0)
        assert not backoff.is_over
        time.passes(1.0)
        assert backoff.is_over

    def test_faults_at_once_count_once(self, time):
        backoff = Backoff(time)
        backoff.begin()
        backoff.begin()
        time.passes(12.0)
        assert backoff.is_over


class TestWatchedSubscription:
    def test_a_subscription_is_not_replaced_while_dds_is_busy(self, subscription, watch, time):
        """It would wait for the lock of discovery, and keep Python's lock meanwhile."""
        with busy_dds_thread():
            assert eventually(dds_threads.is_busy)
            assert faults(subscription, time, SILENT_S + 2 * CHECK_S) == []
        assert faults(subscription, time, CHECK_S) == [CHECK_S]

    def test_a_heard_publisher_that_is_silent_replaces_it_every_12_s(self, subscription, watch, time):
        watch.note(ROBOT, 1, is_beacon=False)
        first, second, third, fourth = faults(subscription, time, 60.0)[:4]
        assert first == SILENT_S + CHECK_S
        assert second - first == MAX_PAUSE_S
        assert third - second == fourth - third == MAX_PAUSE_S

    def test_a_publisher_that_never_sends_a_seal_replaces_it_ever_more_seldom(self, subscription, ros, watch, time):
        """It may be a stranger, who shall not keep the node busy."""
        ros.publishers, number, replaced = 2, 0, []
        for second in range(3600):
            watch.note(ROBOT, number := number + 1, is_beacon=False)
            if faults(subscription, time, CHECK_S):
                replaced.append(second)
        pauses = [later - before for before, later in itertools.pairwise(replaced)]
        assert replaced[0] <= SILENT_S + CHECK_S
        assert pauses[:5] == sorted(pauses[:5])
        assert all(FOREIGN_PAUSE_S <= pause <= FOREIGN_PAUSE_S + CHECK_S for pause in pauses[5:])
        assert len(replaced) <= 6 + 3600 / FOREIGN_PAUSE_S

    @pytest.mark.parametrize("period_s", [3, 10, 13, 30, 100])
    @pytest.mark.parametrize("gap", [1, 4])
    def test_a_stranger_who_comes_and_goes_does_not_keep_the_node_busy(self, ros, time, period_s, gap):
        """On one topic after the other."""
        backoff, watches = Backoff(time), [StreamWatch(clock=time) for _ in range(4)]
        strangers = [0, 0, 0, 0]

        def made(place):
            def create(note):
                made = ros.create(note, f"/topic{place}")
                made.get_publisher_count = lambda: 1 + strangers[place]
                return made

            return WatchedSubscription(ros, create, watches[place], time, backoff)

        subscriptions, replaced = [made(place) for place in range(4)], 0
        for second in range(3600):
            strangers[:] = [second // period_s % (4 * gap) == gap * place for place in range(4)]
            for watch in watches:
                watch.note(ROBOT, second, is_beacon=False)
            replaced += bool(replace_faulty(subscriptions))
            time.passes(CHECK_S)
        assert replaced <= 6 + 3600 / FOREIGN_PAUSE_S

    @pytest.mark.parametrize("period_s", [0, 3, 10])
    def test_a_loss_is_mended_as_soon_beside_a_stranger(self, subscription, ros, watch, time, period_s):
        for number in range(900):
            ros.publishers = 2 if not period_s else 2 + number // period_s % 2
            watch.note(ROBOT, number, is_beacon=False)
            faults(subscription, time, CHECK_S)
        replaced = []
        for second in range(40):
            ros.publishers = 2 if not period_s else 2 + second // period_s % 2
            if faults(subscription, time, CHECK_S):
                replaced.append(second + 1)
        assert replaced[0] <= SILENT_S + CHECK_S
        assert replaced[1] - replaced[0] <= MAX_PAUSE_S + CHECK_S

    def test_is_not_replaced_while_messages_arrive(self, subscription, watch, time):
        for number in range(30):
            watch.note(ROBOT, number, is_beacon=False)
            assert faults(subscription, time, 1.0) == []

    def test_a_recovered_subscription_is_replaced_as_soon_as_before(self, subscription, watch, time):
        watch.note(ROBOT, 1, is_beacon=False)
        assert faults(subscription, time, 21.0) == [7.0, 19.0]
        watch.note(ROBOT, 1, is_beacon=False)
        assert faults(subscription, time, 10.0) == [SILENT_S + CHECK_S]

    def test_a_subscription_that_matches_none_of_its_publishers_is_replaced_again(self, subscription, ros, time):
        """As after a change of the quality of service: the old one, which heard, has ended."""
        subscription.replace(may_fail=False)
        ros.publishers = 0
        replaced = []
        for second in range(40):
            time.passes(CHECK_S)
            if subscription.fault(expects_publishers=True):
                subscription.replace()
                replaced.append(second + 1)
        assert replaced == [MAX_PAUSE_S, 2 * MAX_PAUSE_S]
        assert subscription.fault() == ""

    def test_without_publishers_silence_is_no_fault(self, subscription, ros, time):
        ros.publishers = 0
        assert faults(subscription, time, 30.0) == []

    def test_a_new_publisher_has_time_to_be_heard(self, subscription, ros, watch, time):
        for number in range(10):
            watch.note(ROBOT, number, is_beacon=False)
            faults(subscription, time, 1.0)
        ros.publishers = 2
        for number in range(10, 10 + round(SILENT_S)):
            watch.note(ROBOT, number, is_beacon=False)
            assert faults(subscription, time, 1.0) == []

    def test_a_publisher_that_leaves_delays_nothing(self, subscription, ros, time):
        ros.publishers = 2
        assert faults(subscription, time, 4.0) == []
        ros.publishers = 1
        assert faults(subscription, time, 5.0) == [SILENT_S + CHECK_S - 4.0]

    def test_both_receive_until_the_new_one_hears_what_the_old_one_hears(self, subscription, ros, time):
        """The new one has matched long before its publishers know it."""
        subscription.replace()
        old, new = ros.present
        for number in range(8):
            old.arrives((number, ROBOT))
            old.arrives((number, OTHER))
            if number >= 2:
                new.arrives((number, ROBOT))
            time.passes(CHECK_S)
            subscription.fault()
            assert ros.present == [old, new]
        checks = 0
        while len(ros.present) == 2:
            for each in (old, new):
                each.arrives((checks, "robot and other"))
            time.passes(CHECK_S)
            subscription.fault()
            checks += 1
        assert checks == (CHECK_S + OVERLAP_S) / CHECK_S
        assert ros.present == [new]

    def test_a_new_one_that_hears_less_is_given_up(self, subscription, ros, time):
        subscription.replace()
        old, new = ros.present
        for number in range(round(MAX_PAUSE_S / CHECK_S)):
            assert ros.present == [old, new]
            old.arrives((number, 1))
            time.passes(CHECK_S)
            subscription.fault()
        assert ros.present == [old]
        subscription.replace()
        assert len(ros.present) == 2

    def test_what_arrives_on_both_is_a_copy_the_second_time(self, subscription, ros, watch, time):
        (old,) = ros.present

        def is_copy(on: SimpleNamespace, sample: tuple[int, int]) -> bool:
            on.arrives(sample)
            return watch.is_copy

        assert not is_copy(old, (1, 1))
        assert not is_copy(old, (1, 1)), "not of another subscription"
        subscription.replace()
        _, new = ros.present
        assert is_copy(new, (1, 1)), "a latched message arrives again"
        assert not is_copy(new, (2, 2))
        assert is_copy(old, (2, 2))
        assert not is_copy(old, (3, 2)), "the same number of another publisher"
        assert not is_copy(old, (2, 3)), "the same time of another publisher"
        for number in range(10, 20):
            assert not is_copy(old, (number, number))
            assert is_copy(new, (number, number))
            time.passes(CHECK_S)
            subscription.fault()
            if ros.present == [new]:
                break
        assert ros.present == [new]
        old.arrives((30, 30))  # from its queue
        assert is_copy(new, (30, 30))
        old.arrives((31, 31))
        time.passes(COPIES_S)
        assert not is_copy(new, (31, 31))

    def test_only_so_many_messages_are_known_again(self, subscription, ros, watch):
        (old,) = ros.present
        for number in range(MAX_SAMPLES + 1):
            old.arrives((number, number))
        subscription.replace()
        _, new = ros.present
        found = []
        for number in range(MAX_SAMPLES + 1):
            new.arrives((number, number))
            found.append(watch.is_copy)
        assert found == [False] + MAX_SAMPLES * [True]

    def test_a_new_one_of_another_quality_of_service_is_kept_although_it_hears_less(self, subscription, ros, time):
        """A best-effort subscription loses messages that a reliable one gets, but alone matches all publishers."""
        subscription.replace(may_fail=False)
        old, new = ros.present
        for number in range(round(MAX_PAUSE_S / CHECK_S)):
            assert ros.present == [old, new]
            old.arrives((number, 1))
            if number % 2:
                new.arrives((number, 1))
            time.passes(CHECK_S)
            subscription.fault()
        assert ros.present == [new]

    def test_an_old_one_that_hears_nothing_ends_once_the_new_one_hears(self, subscription, ros, time):
        subscription.replace()
        old, new = ros.present
        for number in range(3):
            assert ros.present == [old, new]
            new.arrives((number, 1))
            time.passes(CHECK_S)
            subscription.fault()
        assert ros.present == [new]

    def test_of_two_that_hear_nothing_the_new_one_is_kept(self, subscription, ros, time):
        subscription.replace()
        old, new = ros.present
        time.passes(MAX_PAUSE_S - 0.1)
        subscription.fault()
        assert ros.present == [old, new]
        time.passes(CHECK_S)
        subscription.fault()
        assert ros.present == [new]

    def test_a_destroyed_one_leaves_none(self, subscription, ros, time):
        subscription.replace()
        subscription.destroy()
        assert ros.present == []
        assert faults(subscription, time, 30.0) == []
        subscription.replace()
        assert ros.present == []

    def test_the_new_one_counts_the_publishers_of_the_old_one_until_it_matches_them(self, subscription, ros):
        old = ros.present[0]
        subscription.replace()
        old.get_publisher_count, ros.publishers = lambda: 2, 0
        assert subscription.get_publisher_count() == 2

    def test_two_replacements_at_once_are_one(self, subscription, ros, time):
        subscription.replace()
        subscription.replace()
        assert len(ros.present) == 2
        time.passes(MAX_PAUSE_S)
        subscription.fault()
        assert len(ros.present) == 1

    def test_a_fault_replaces_all_subscriptions_of_the_node(self, subscription, ros, time):
        heard = StreamWatch(clock=time)
        heard.note(ROBOT, 1, is_beacon=False)
        other = WatchedSubscription(ros, lambda note: ros.create(note, "/other"), heard, time)
        time.passes(CHECK_S)
        assert replace_faulty([subscription, other]) == {}
        time.passes(SILENT_S)
        heard.note(ROBOT, 2, is_beacon=False)
        assert replace_faulty([other, subscription]) == {"/said": "1 of 1 publishers are silent"}
        assert [each.topic_name for each in ros.present] == ["/said", "/other", "/other", "/said"]
