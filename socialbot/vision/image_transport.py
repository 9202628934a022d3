"""Send images over a network link that carries less than the camera takes, and receive them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import CompressedImage, Image, PictureAck
from socialbot.graph.health import SILENT_S
from socialbot.graph.node import Context, Node, Timer
from socialbot.graph.ports import FRESH_S, Delivery, Input, Output, Parameter
from socialbot.vision.images import bgr_from_compressed, bgr_from_image, encode_jpeg

PATIENCE_S = 0.4  # No image is sent while an earlier one is unanswered for longer than this and its way and a repair,
LEAST_PATIENCE_S = 0.1  # or for longer than answers take, with their deviation, but at least this and a repair.
LOST_S = 1.0  # Without an answer for this long, and a way and a repair, the link counts as down.
FIRST_FLIGHTS, MOST_FLIGHTS = 4, 16  # Images in flight for longer than the way: at first, and at most.
WAY_S = 20.0  # The way is the shortest time to an answer in this long, and in as long before.
MEASURE_S = 1.0  # Period of one measurement.
SETTLING_S = 0.2  # Pause after a change before the next measurement.
LATE_S = 0.15  # A link is full when its median delay is larger, beyond a way and a repair,
REFUSED_SHARE = 0.1  # or when it refuses more than this share of the images.
CARRIED_SHARE = 0.8  # A full link gets this share of what it carried.
TRIED_SHARE = 1.2  # Factor of a trial increase.
LEAP_SHARE = 1.5  # Factor of an increase for which single images prove the capacity.
FIRST_TRIAL_S, LAST_TRIAL_S = 1.0, 64.0  # Pause between trials: at first, and after many failures.
LEAST_BYTES_S = 4000.0
LEAST_RATE_HZ = 1.0
_ANY_HZ = 1e6
QUALITY_STEP = 5  # Smallest increase of the quality, since every change is visible.
SIZE_EXPONENT = 0.5  # JPEG size over the coarseness of the quantisation, measured on indoor images.
STALE_S = 1.0
REMEMBERED = 32
ALIVE_S = 0.25  # Period of repeated answers while no image arrives.


class InFlightImage(NamedTuple):
    """Unanswered image: stamp, bytes, time of sending, and whether the link was idle then."""

    stamp: int
    size: int
    sent: int
    alone: bool


class AnswerTimes:
    """Times (ns) from an image to its answer: the shortest one of late, and how long to wait (RFC 6298)."""

    def __init__(self) -> None:
        self._begin, self._before, self._shortest = 0, math.inf, math.inf
        self._mean = self._deviation = 0.0

    @property
    def is_known(self) -> bool:
        """Whether an answer came."""
        return not math.isinf(min(self._before, self._shortest))

    @property
    def way(self) -> float:
        """Time to an answer without a queue; 0 until an answer came."""
        return min(self._before, self._shortest) if self.is_known else 0

    @property
    def repaired(self) -> float:
        """Time to the answer if a packet is lost: the receiver asks for it, which takes another way."""
        return 2 * self.way

    @property
    def patience(self) -> float:
        """Time after which an answer is overdue."""
        longest = PATIENCE_S * SECOND + self.repaired
        if not self.is_known:
            return longest
        return min(longest, max(LEAST_PATIENCE_S * SECOND + self.repaired, self._mean + 4 * self._deviation))

    def answered(self, after: int, now: int) -> None:
        """Take the time to an answer that comes ``now``."""
        if now - self._begin > WAY_S * SECOND:
            self._begin, self._before, self._shortest = now, self._shortest, math.inf
        if self.is_known:
            self._deviation += (abs(after - self._mean) - self._deviation) / 4
            self._mean += (after - self._mean) / 8
        else:
            self._mean, self._deviation = after, after / 2
        self._shortest = min(self._shortest, after)


class SendWindow:
    """Images in flight. Without answers for a while the link is ``silent``, and nothing is sent.

    Attributes:
        has_results: Whether it is known of an image that it arrived, or that it did not.
    """

    def __init__(self) -> None:
        self.times = AnswerTimes()
        self.silent = self.has_results = False
        self._flights: deque[InFlightImage] = deque()
        self._limit = FIRST_FLIGHTS
        self._waits_since = math.inf  # ns: the first image since the last answer
        self._lowered = 0  # ns

    @property
    def oldest(self) -> float:
        """Send time (ns) of the oldest unanswered image; infinite without any."""
        return self._flights[0].sent if self._flights else math.inf

    def is_open(self, now: int) -> bool:
        """Whether another image may be sent. Detects a dead link and then drops all images in flight."""
        if now - self._waits_since > LOST_S * SECOND + self.times.repaired:
            self._flights.clear()
            self.silent = True
        if self.silent:
            return False
        overdue = sum(now - flight.sent >= self.times.way for flight in self._flights)
        return overdue < self._limit and now - self.oldest <= self.times.patience

    def give_up(self, now: int) -> int:
        """Drop the images that DDS has given up, and return their number."""
        count = 0
        while self._flights and now - self.oldest > (FRESH_S + LATE_S) * SECOND + self.times.repaired:
            self._flights.popleft()
            self._limit, self._lowered, self.has_results = 1, now, True
            count += 1
        return count

    def stalls(self, now: int) -> bool:
        """Whether answers are overdue."""
        return now - self._waits_since > self.times.patience

    def send(self, stamp: int, size: int, now: int) -> None:
        self._waits_since = min(self._waits_since, now)
        self._flights.append(InFlightImage(stamp, size, now, alone=not self._flights))

    def answer(self, stamp: int, now: int) -> list[InFlightImage]:
        """The images that an answer for ``stamp`` confirms: that image and all earlier ones.

        Any answer proves that the link is up.
        """
        if self.silent:
            self.silent, self._limit = False, 1
        self._waits_since = math.inf
        count = next((number for number, flight in enumerate(self._flights, 1) if flight.stamp == stamp), 0)
        if not count:
            return []
        arrived = [self._flights.popleft() for _ in range(count)]
        last, self.has_results = arrived[-1].sent, True
        self.times.answered(now - last, now)
        if now - last <= LATE_S * SECOND + self.times.repaired:
            self._limit = min(self._limit + 1, MOST_FLIGHTS)
        elif last >= self._lowered:
            self._limit, self._lowered = max(1, self._limit // 2), now
        return arrived


@dataclass
class LinkStatistics:
    """Counts of a link since ``begin`` (ns); ``offered`` images were allowed by the rate limit."""

    begin: int
    images: int = 0
    offered: int = 0
    refused: int = 0
    given_up: int = 0
    sent_bytes: int = 0
    arrived_bytes: int = 0
    waits_s: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)

    def arrive(self, flight: InFlightImage, now: int, repaired: float = 0.0) -> None:
        """Add a delivered image. Its delay beyond ``repaired`` (ns) counts as a wait, unless it was alone."""
        delay_s = max(1, now - flight.sent) / SECOND
        self.arrived_bytes += flight.size
        self.waits_s.append(0.0 if flight.alone else delay_s - repaired / SECOND)
        if flight.alone:
            self.speeds.append(flight.size / delay_s)

    @property
    def speed(self) -> float:
        """Lower bound of the capacity, bytes/s, from images that were alone on the link; 0 without any."""
        return median(self.speeds or [0.0])

    @property
    def is_full(self) -> bool:
        """Whether the load exceeded the capacity."""
        late = median(self.waits_s or [0.0]) > LATE_S
        return late or max(self.refused, self.given_up) > REFUSED_SHARE * self.offered


class BitrateControl:
    """Send rate ``budget`` in bytes/s; infinite until the link has been full."""

    def __init__(self) -> None:
        self.budget = math.inf
        self._good = math.inf
        self._failed = math.inf
        self._on_trial = False
        self._trial_s = FIRST_TRIAL_S
        self.changed = 0  # ns

    def judge(self, measure: LinkStatistics, now: int, *, wants_more: bool) -> bool:
        """Update the budget from a measurement that ends ``now``; True if it changed."""
        seconds = (now - measure.begin) / SECOND
        if measure.is_full:
            self._lower(measure.arrived_bytes / seconds, measure.sent_bytes / seconds, stalled=measure.given_up > 0)
        elif math.isinf(self.budget) or not wants_more:
            self._good = min(self.budget, measure.arrived_bytes / seconds)
            return False
        elif LEAP_SHARE * self.budget <= CARRIED_SHARE * measure.speed:
            self._raise(LEAP_SHARE, on_trial=False)
        elif now - self.changed >= self._trial_s * SECOND:
            self._raise(TRIED_SHARE, on_trial=True)
        else:
            return False
        self.changed = now
        return True

    def _lower(self, arrived: float, sent: float, *, stalled: bool) -> None:
        """Reduce the budget to the rate that ``arrived``, but not below the last good rate.

        An overloaded link carries less than its capacity. If the last good rate is too high as well, it is halved. If
        images ``stalled`` until they were given up, the last good rate tells nothing.
        """
        if self._on_trial:
            self._failed = self.budget
            self._trial_s = min(2 * self._trial_s, LAST_TRIAL_S)
        known = min(self.budget, max(sent, arrived)) if math.isinf(self._good) else self._good
        least = 0.0 if stalled else CARRIED_SHARE * known if self._on_trial else known / 2
        self.budget = self._good = max(CARRIED_SHARE * arrived, least, LEAST_BYTES_S)
        self._on_trial = False

    def _raise(self, share: float, *, on_trial: bool) -> None:
        if self.budget > self._failed:
            self._trial_s, self._failed = FIRST_TRIAL_S, math.inf
        self._good = self.budget
        self.budget *= share
        self._on_trial = on_trial


class ImageLink:
    """Decides for each image whether to send it, and at which JPEG ``quality``.

    Args:
        best: Highest quality.
        least: Lowest quality; below it the rate is reduced.
        most_hz: Highest rate, images/s; may be infinite.
        now: Time of the sender's clock, ns.
    """

    def __init__(self, *, best: int, least: int, most_hz: float, now: int) -> None:
        self.quality = best
        self.rate_hz = most_hz
        self._best, self._least, self._most_hz = best, min(least, best), most_hz
        self._window = SendWindow()
        self._throttle = BitrateControl()
        self._measure = _begun_soon(now)
        self._credit = 1.0
        self._asked = now
        self._changed = -1
        self._size_at_best = 0.0
        self._images_hz = 0.0

    @property
    def silent(self) -> bool:
        """Whether the link counts as down."""
        return self._window.silent

    @property
    def budget(self) -> float:
        """Send rate, bytes/s; infinite until the link has been full."""
        return self._throttle.budget

    def bound(self, *, best: int, least: int, most_hz: float) -> None:
        """Set other limits."""
        self._size_at_best *= relative_size(best, self._best)
        self._best, self._least, self._most_hz = best, min(least, best), most_hz
        self._choose()

    def takes(self, now: int) -> bool:
        """Whether to send an image taken now."""
        if now < self._asked:  # the clock was set back: forget all times
            self._window, self._measure, self._changed = SendWindow(), _begun_soon(now), -1
            self._throttle.changed = now
        # The rate limit has credit for two images, since cameras are not punctual.
        since_s, self._asked = max(0, now - self._asked) / SECOND, now
        self._credit = min(2.0, self._credit + since_s * min(self.rate_hz, _ANY_HZ))
        allowed = self._credit > 0.99
        given_up = self._window.give_up(now)
        is_open = self._window.is_open(now)
        if self.silent or not self._window.has_results or self._window.oldest <= self._changed:
            self._measure = _begun_soon(now)
        if now >= self._measure.begin:
            self._measure.images += 1
            self._measure.offered += allowed
            self._measure.given_up += given_up
            self._measure.refused += allowed and not is_open
        if now - self._measure.begin >= MEASURE_S * SECOND and not self._window.stalls(now):
            self._judge(now)
        return allowed and is_open

    def sent(self, stamp: int, size: int, now: int) -> None:
        """Record that the image of ``stamp`` was sent as ``size`` bytes."""
        self._window.send(stamp, size, now)
        self._credit -= 1.0
        if now >= self._measure.begin:
            self._measure.sent_bytes += size
        at_best = size / relative_size(self.quality, self._best)
        self._size_at_best += (at_best - self._size_at_best) * (0.2 if self._size_at_best else 1.0)

    def answered(self, stamp: int, now: int) -> None:
        """Record an answer: the receiver has the image of ``stamp``."""
        for flight in self._window.answer(stamp, now):
            if now >= self._measure.begin:
                self._measure.arrive(flight, now, self._window.times.repaired)

    def _judge(self, now: int) -> None:
        measure, self._measure = self._measure, LinkStatistics(now)
        self._images_hz = measure.images * SECOND / (now - measure.begin)
        if self._throttle.judge(measure, now, wants_more=(self.quality, self.rate_hz) != (self._best, self._most_hz)):
            self._changed, self._measure = now, _begun_soon(now)
        self._choose()

    def _choose(self) -> None:
        """Choose the best quality at the full rate; reduce the rate only at the lowest quality."""
        rate = min(self._most_hz, self._images_hz)
        most_bytes = self.budget / rate if rate else math.inf
        choices = range(self._best, self._least, -1)
        fitting = next((each for each in choices if self._size(each) <= most_bytes), self._least)
        if fitting < self.quality or fitting >= self.quality + QUALITY_STEP or fitting == self._best:
            self.quality = fitting
        needed = self._size(self._least)
        self.rate_hz = self._most_hz if needed <= most_bytes else max(LEAST_RATE_HZ, self.budget / needed)

    def _size(self, quality: int) -> float:
        return self._size_at_best * relative_size(quality, self._best)


def _begun_soon(now: int) -> LinkStatistics:
    return LinkStatistics(now + nanoseconds(SETTLING_S))


class StaleImageFilter:
    """Detects images that waited for a dead link.

    The clocks of the two machines may differ, so the age of an image is compared with the smallest recent one.
    If all images are late, a clock was set.
    """

    def __init__(self) -> None:
        self._ages_s: deque[float] = deque(maxlen=REMEMBERED)

    def has_kept(self, stamp: int, now: int) -> bool:
        """Whether the image of ``stamp`` (ns) that arrives ``now`` is stale."""
        age_s = (now - stamp) / SECOND
        self._ages_s.append(age_s)
        return age_s > min(self._ages_s) + STALE_S


def relative_size(quality: int, other: int) -> float:
    """Estimated JPEG size at ``quality`` relative to the same image at quality ``other``."""
    return (_coarseness(other) / _coarseness(quality)) ** SIZE_EXPONENT


def _coarseness(quality: int) -> float:
    """Factor of libjpeg's quantisation table."""
    return 50.0 / max(1, quality) if quality < 50 else max(0.02, 2.0 - quality / 50.0)


class ImageSender(Node):
    """Publishes images as JPEG for an `ImageReceiver` on another machine; stamps are kept.

    While the link is down nothing is sent. The first answer resumes with the newest image. An image that cannot be
    converted raises ImageError and is skipped.
    """

    image = Input(Image, "/camera/image_raw", Delivery.NEWEST)
    link = Output(CompressedImage, "/camera/image_raw/link", Delivery.FRESH)
    ack = Input(PictureAck, "/camera/image_raw/link/ack")

    quality = Parameter(80, "JPEG quality on a link that carries it", minimum=1, maximum=100)
    least_quality = Parameter(30, "JPEG quality below which images are skipped instead", minimum=1, maximum=100)
    rate_hz = Parameter(0.0, "maximum images per second; 0: every image", minimum=0.0, maximum=1000.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self.image_link = ImageLink(
            best=self.quality, least=self.least_quality, most_hz=self._most_hz, now=self.clock.now()
        )

    def on_parameter(self, name: str) -> None:
        self.image_link.bound(best=self.quality, least=self.least_quality, most_hz=self._most_hz)

    @image
    def on_image(self, image: Image) -> None:
        was_silent = self.image_link.silent
        if not self.image_link.takes(self.clock.now()):
            if self.image_link.silent and not was_silent:
                self.log.warning("the link is silent: no answer from the receiver of %s", image.frame_id)
                self.report_health("degraded", f"no answer from the receiver of {image.frame_id}")
            return
        jpeg = encode_jpeg(bgr_from_image(image), self.image_link.quality)
        self.image_link.sent(image.stamp, jpeg.size, self.clock.now())
        kind = "bgr8; jpeg compressed bgr8"
        self.link.publish(CompressedImage(stamp=image.stamp, frame_id=image.frame_id, format=kind, data=jpeg))

    @ack
    def on_ack(self, ack: PictureAck) -> None:
        if self.image_link.silent:
            self.log.info("the link answers")
            self.report_health("ok")
        self.image_link.answered(ack.stamp, self.clock.now())

    @property
    def _most_hz(self) -> float:
        return self.rate_hz or math.inf


class ImageReceiver(Node):
    """Publishes the images of an `ImageSender` as bgr8, with their stamps.

    Stale and damaged images are answered and dropped; a damaged one raises ImageError.
    """

    link = Input(CompressedImage, "/camera/image_raw/link", Delivery.NEWEST, deadline_s=SILENT_S)
    ack = Output(PictureAck, "/camera/image_raw/link/ack")
    image = Output(Image, "/camera/image_raw/received", Delivery.NEWEST)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._last = PictureAck(stamp=0, arrived=0)
        self._answered_at = 0
        self._backlog = StaleImageFilter()
        self._timer: Timer | None = None

    def start(self) -> None:
        self._keep_alive()

    def stop(self) -> None:
        if self._timer:
            self._timer.cancel()

    @link
    def on_compressed(self, image: CompressedImage) -> None:
        now = self.clock.now()
        self._answer(PictureAck(stamp=image.stamp, arrived=now))
        if not self._backlog.has_kept(image.stamp, now):
            pixels = bgr_from_compressed(image)
            self.image.publish(Image.from_bgr(pixels, stamp=image.stamp, frame_id=image.frame_id))

    def _keep_alive(self) -> None:
        self._timer = self.call_after(ALIVE_S, self._keep_alive)
        if self.clock.now() - self._answered_at >= ALIVE_S * SECOND:
            self._answer(self._last)

    def _answer(self, ack: PictureAck) -> None:
        self._last, self._answered_at = ack, self.clock.now()
        self.ack.publish(ack)
