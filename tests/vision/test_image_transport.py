"""The rate of a link is estimated and kept: by quality, then by image rate, without a growing queue."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import CompressedImage, Image, Message, PictureAck
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.vision.image_transport import (
    ALIVE_S,
    ImageLink,
    ImageReceiver,
    ImageSender,
    StaleImageFilter,
    relative_size,
)
from tests.vision.simulated_link import PICTURE, Phase, Trial

RAW, LINK, ACK, RECEIVED = (f"/camera/image_raw{end}" for end in ("", "/link", "/link/ack", "/received"))


@pytest.mark.parametrize("mbit_s", [20.0, 100.0])
@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_link_that_carries_all_gets_all_and_at_its_best(mbit_s: float, loss: float) -> None:
    trial = Trial([Phase(0, mbit_s, loss)], 30)
    assert trial.hz(1, 29) == pytest.approx(30, abs=0.1)
    assert trial.age_s(0, 29) < (0.15 if loss else 0.02)
    assert set(trial.qualities(0, 30)) == {80}
    assert math.isinf(trial.link.budget)


@pytest.mark.parametrize(("delay_s", "jitter_s"), [(0.04, 0.03), (0.1, 0.05), (0.25, 0.05)])
def test_long_way_is_no_full_link(delay_s: float, jitter_s: float) -> None:
    trial = Trial([Phase(0, 20, 0.0, delay_s, jitter_s)], 60)
    assert trial.hz(5, 59) == pytest.approx(30, abs=0.3)
    assert set(trial.qualities(0, 60)) == {80}
    assert trial.age_s(0, 59) < delay_s + jitter_s + 0.05


@pytest.mark.parametrize(("delay_s", "loss", "rate_hz"), [(0.04, 0.05, 29), (0.1, 0.01, 29.7), (0.25, 0.01, 25)])
def test_repairs_on_a_long_way_are_no_full_link(delay_s: float, loss: float, rate_hz: float) -> None:
    trial = Trial([Phase(0, 20, loss, delay_s, 0.03)], 60)
    assert trial.hz(5, 59) > rate_hz
    assert trial.age_s(0, 59, 50) < 2.5 * delay_s + 0.1


@pytest.mark.parametrize("delay_s", [0.1, 0.25])
def test_long_way_that_is_full_gets_its_capacity(delay_s: float) -> None:
    trial = Trial([Phase(0, 100, 0.0, delay_s), Phase(20, 2, 0.0, delay_s), Phase(80, 100, 0.0, delay_s)], 160)
    assert trial.hz(40, 80) > 15
    assert trial.age_s(40, 79, 50) < delay_s + 0.6
    assert trial.hz(145, 160) == pytest.approx(30, abs=0.3)
    assert set(trial.qualities(150, 160)) == {80}


@pytest.mark.parametrize(("mbit_s", "rate_hz", "quality"), [(2.0, 15, 30), (5.0, 29, 50)])
@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_slow_link_gets_its_capacity(mbit_s: float, rate_hz: float, quality: int, loss: float) -> None:
    trial = Trial([Phase(0, mbit_s, loss)], 120)
    assert trial.hz(20, 120) > rate_hz
    assert float(np.mean(trial.qualities(20, 120))) >= quality
    assert trial.age_s(20, 120, 50) < 0.1
    assert trial.age_s(20, 120, 99) < 0.6
    assert max(arrived - taken for taken, arrived, _ in trial.arrived) < 1.35


@pytest.mark.parametrize("mbit_s", [0.3, 5.0, *(pytest.param(mbit_s, marks=pytest.mark.slow) for mbit_s in (1.0, 2.0))])
def test_it_settles(mbit_s: float) -> None:
    """Trials become rare: in the last minute the settings change only a few times."""
    trial = Trial([Phase(0, mbit_s)], 400)
    late = trial.qualities(300, 400)
    assert sum(abs(one - other) >= 5 for one, other in itertools.pairwise(late)) <= 6
    assert trial.age_s(300, 400, 95) < 0.15 + 8e-6 * PICTURE / mbit_s
    full = mbit_s * SECOND / 8e-6 / SECOND
    assert 0.5 * full < trial.link.budget < 1.2 * full


@pytest.mark.parametrize("outage_s", [0.8, 5, 30])
def test_after_an_outage_images_are_back_at_once_and_as_good_as_before(outage_s: float) -> None:
    trial = Trial([Phase(0, 20, 0.05), Phase(20, 0), Phase(20 + outage_s, 20, 0.05)], 60 + outage_s)
    up = 20 + outage_s
    assert min(arrived for taken, arrived, _ in trial.arrived if taken >= up) < up + 0.5
    assert sum(arrived > up and taken < up for taken, arrived, _ in trial.arrived) <= 16
    assert trial.hz(up + 30, up + 40) == pytest.approx(30, abs=0.2)
    assert set(trial.qualities(up + 30, up + 40)) == {80}


def test_link_that_gets_worse_and_better_again_is_followed() -> None:
    trial = Trial([Phase(0, 100), Phase(20, 2), Phase(60, 100)], 90)
    assert trial.hz(25, 60) > 15
    assert trial.age_s(30, 59) < 0.4
    assert trial.hz(75, 90) == pytest.approx(30, abs=0.2)
    assert set(trial.qualities(80, 90)) == {80}


def test_pictures_that_grow_are_made_smaller_not_late() -> None:
    """A camera that turns to a scene full of detail makes the same quality twice as large."""
    trial = Trial([Phase(0, 8)], 60, detail=lambda seconds: 1.0 if seconds < 20 else 2.0)
    assert set(trial.qualities(0, 20)) == {80}
    assert max(trial.qualities(40, 60)) < 80
    assert trial.hz(30, 60) > 25


def test_rate_limit() -> None:
    link, sent = ImageLink(best=80, least=30, most_hz=10.0, now=0), 0
    for number in range(300):
        now = number * SECOND // 30
        if link.takes(now):
            link.sent(now, 1000, now)
            link.answered(now, now + SECOND // 100)
            sent += 1
    assert 98 <= sent <= 102


def test_link_without_answers_counts_as_down() -> None:
    link, sent = ImageLink(best=80, least=30, most_hz=math.inf, now=0), 0
    for number in range(300):
        now = number * SECOND // 30
        if link.takes(now):
            link.sent(now, 1000, now)
            sent += 1
    assert link.silent
    assert sent <= 5
    link.answered(0, 10 * SECOND)
    assert not link.silent
    assert link.takes(10 * SECOND + 1)


def test_clock_that_is_set_back_stops_nothing() -> None:
    link = ImageLink(best=80, least=30, most_hz=math.inf, now=3600 * SECOND)
    for begin in (3600, 10):
        sent = 0
        for number in range(90):
            now = begin * SECOND + number * SECOND // 30
            if link.takes(now):
                link.sent(now, 1000, now)
                sent += 1
                if number < 30:
                    link.answered(now, now + SECOND // 100)
        assert 30 <= sent <= 50
        assert link.silent
        link.answered(0, (begin + 3) * SECOND)


def test_answer_confirms_all_earlier_images() -> None:
    link = ImageLink(best=80, least=30, most_hz=math.inf, now=0)
    now = itertools.count(0, SECOND // 100)

    def send(*stamps: int) -> None:
        for stamp in stamps:
            at = next(now)
            assert link.takes(at)
            link.sent(stamp, 1000, at)

    send(1)
    link.answered(1, next(now))
    send(2, 3, 4, 5, 6)
    assert not link.takes(next(now)), "the first answer made room for one more, and the way takes 10 ms"
    link.answered(2, next(now))
    link.answered(99, next(now))
    send(7, 8)
    assert not link.takes(next(now))
    link.answered(8, next(now))
    send(*range(9, 16))
    assert not link.takes(next(now))


def test_images_on_their_way_do_not_wait_for_room() -> None:
    link = ImageLink(best=80, least=30, most_hz=math.inf, now=0)
    assert link.takes(0)
    link.sent(1, 1000, 0)
    link.answered(1, SECOND)
    for stamp in range(2, 32):
        now = SECOND + stamp * SECOND // 30
        assert link.takes(now)
        link.sent(stamp, 1000, now)


def test_stale_images_are_detected_despite_clock_offsets() -> None:
    backlog, ahead = StaleImageFilter(), 3600 * SECOND
    assert not any(backlog.has_kept(stamp + ahead, stamp) for stamp in range(0, 3 * SECOND, SECOND // 30))
    assert backlog.has_kept(3 * SECOND + ahead, 8 * SECOND)
    assert not backlog.has_kept(8 * SECOND + ahead, 8 * SECOND)


def test_clock_that_is_set_does_not_blind_for_long() -> None:
    backlog = StaleImageFilter()
    assert not any(backlog.has_kept(stamp, stamp) for stamp in range(0, 3 * SECOND, SECOND // 30))
    late = [backlog.has_kept(stamp, stamp + 9 * SECOND) for stamp in range(3 * SECOND, 6 * SECOND, SECOND // 30)]
    assert sum(late) < 35
    assert not any(late[40:])


@pytest.mark.parametrize("quality", [1, 30, 49, 50, 80, 100])
def test_better_image_is_larger(quality: int) -> None:
    assert relative_size(quality, quality) == 1.0
    assert quality == 100 or relative_size(quality + 1, quality) >= 1.0


class Rig:
    """Sender and receiver inline; what the one sends reaches the other by hand of the test."""

    def __init__(self, **parameters: object) -> None:
        graph = Graph(
            "g",
            (
                NodeConfig("picture_sender", ImageSender, parameters, {"link": "/sent", "ack": "/acknowledged"}),
                NodeConfig("picture_receiver", ImageReceiver),
            ),
            inputs=frozenset({RAW, LINK, "/acknowledged"}),
        )
        self.runner = InlineRunner(graph, start=SECOND)
        self.down = False
        self.sent: list[CompressedImage] = []
        self.acks: list[PictureAck] = []
        self.received: list[Image] = []
        self.runner.tap("/sent", self._send)
        self.runner.tap(ACK, self._acknowledge)
        self.runner.tap(RECEIVED, self._receive)
        self.runner.start()

    def show(self, stamp: int, size: tuple[int, int] = (48, 64)) -> None:
        pixels = np.full((*size, 3), stamp % 200, np.uint8)
        self.runner.feed(RAW, Image.from_bgr(pixels, stamp=stamp, frame_id="eye"))

    def film(self, begin_s: float, end_s: float) -> None:
        for number in range(round(begin_s * 30), round(end_s * 30)):
            self.show(number * SECOND // 30)

    def _receive(self, _: str, image: Message) -> None:
        assert isinstance(image, Image)
        self.received.append(image)

    def _send(self, _: str, picture: Message) -> None:
        assert isinstance(picture, CompressedImage)
        self.sent.append(picture)
        if not self.down:
            self.runner.enqueue(LINK, picture)

    def _acknowledge(self, _: str, ack: Message) -> None:
        assert isinstance(ack, PictureAck)
        self.acks.append(ack)
        if not self.down:
            self.runner.enqueue("/acknowledged", ack)


def test_stamp_frame_and_pixels_are_kept() -> None:
    rig = Rig()
    rig.show(2 * SECOND)
    (image,) = rig.received
    assert (image.stamp, image.frame_id, image.width, image.height) == (2 * SECOND, "eye", 64, 48)
    assert image.encoding == "bgr8"
    assert abs(int(image.bgr()[5, 5, 0]) - 2 * SECOND % 200) < 4
    assert PictureAck(stamp=2 * SECOND, arrived=2 * SECOND) in rig.acks


def test_receiver_repeats_its_answer_without_images() -> None:
    rig = Rig()
    rig.runner.advance(SECOND + SECOND)
    assert abs(len(rig.acks) - 1 / ALIVE_S) <= 1
    assert set(rig.acks) == {PictureAck(stamp=0, arrived=0)}


def test_restored_link_has_no_backlog() -> None:
    rig = Rig()
    rig.film(1, 3)
    assert len(rig.received) == 60
    rig.down = True
    rig.film(3, 8)
    kept = rig.sent[60:]
    assert len(kept) <= 16
    rig.down = False
    for picture in kept:  # What reliable DDS delivers first once the link is up.
        rig.runner.feed(LINK, picture, time=8 * SECOND)
    rig.film(8.1, 10)
    stamps = [image.stamp for image in rig.received[60:]]
    assert min(stamps) > 8 * SECOND
    assert len(stamps) >= 56
    assert len(rig.acks) >= len(rig.received) + len(kept)


def test_damaged_images_are_answered_and_skipped() -> None:
    rig = Rig()
    bad = CompressedImage(stamp=2 * SECOND, frame_id="eye", format="jpeg", data=np.zeros(9, np.uint8))
    rig.runner.feed(LINK, bad)
    assert rig.acks[-1].stamp == 2 * SECOND
    assert rig.runner.faults["picture_receiver"].first.startswith("ImageError")
    rig.show(3 * SECOND)
    assert len(rig.received) == 1
    rig.runner.feed(
        RAW, Image(stamp=4 * SECOND, frame_id="e", height=2, width=2, encoding="odd", step=6, data=bad.data)
    )
    assert rig.runner.faults["picture_sender"].failures == 1
    rig.show(5 * SECOND)
    assert len(rig.received) == 2


def test_quality_can_be_changed_while_it_runs() -> None:
    rig = Rig(quality=90)
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 255, (48, 64, 3), np.uint8)
    for stamp, quality in ((2, 90), (3, 40)):
        rig.runner.nodes["picture_sender"].set_parameter("quality", quality)
        rig.runner.feed(RAW, Image.from_bgr(noise, stamp=stamp * SECOND, frame_id="eye"))
    fine, coarse = (picture.data.size for picture in rig.sent)
    assert coarse < fine
