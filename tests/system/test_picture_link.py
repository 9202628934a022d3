"""Pictures from a robot to a workstation over real DDS: all of them, in time, and back at once after an outage."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from evaluation.picture_links import Film, adaptive_link
from socialbot.core.clock import SECOND
from tests.system.two_hosts import TwoHosts, idle_processors, two_hosts

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Film[TwoHosts]]:
    with two_hosts() as hosts, idle_processors(), adaptive_link(hosts, tmp_path_factory.mktemp("film")) as film:
        yield film


@pytest.fixture(autouse=True)
def clear(film: Film[TwoHosts]) -> None:
    film.hosts.clear()
    time.sleep(2.0)


def test_a_good_link_delivers_every_image_with_few_bytes(film: Film[TwoHosts]) -> None:
    before, begin = film.cpu_s(), time.monotonic()
    share, late_s = film.judge(6.0)
    load = (film.cpu_s() - before) / (time.monotonic() - begin)
    assert share >= 0.99
    assert late_s < 0.25
    assert load < 0.3


def test_a_slow_and_lossy_link_delivers_most_images(film: Film[TwoHosts]) -> None:
    film.hosts.limit(20)
    film.hosts.lose(5)
    share, late_s = film.judge(10.0)
    assert share >= 0.95
    assert late_s <= 0.25


@pytest.mark.parametrize(("mbit_s", "least"), [(5.0, 0.1), (1.0, 0.01)])
def test_a_narrow_link_delivers_new_images_soon(film: Film[TwoHosts], mbit_s: float, least: float) -> None:
    """Images of the first moment fill the link many times over; their repairs must not go on for long."""
    film.hosts.limit(mbit_s, queue_ms=200)
    time.sleep(5.0)
    share, late_s = film.judge(10.0)
    assert share >= least
    assert late_s <= 1.0


@pytest.mark.parametrize(("down_s", "back_s"), [(5.0, 1.0), (30.0, 3.0)])
def test_images_resume_soon_after_an_outage(film: Film, down_s: float, back_s: float) -> None:
    film.hosts.cut()
    time.sleep(down_s)
    film.hosts.mend()
    up = time.time_ns()
    time.sleep(back_s + 1.0)
    after = [(stamp, when) for stamp, when in film.arrivals() if when > up]
    assert after
    assert after[0][1] - up < back_s * SECOND
    assert all(when - stamp < SECOND for stamp, when in after)


def test_discovery_uses_little_of_the_link(film: Film[TwoHosts]) -> None:
    """The workstation sends only acknowledgements and announcements."""
    before = film.hosts.sent_bytes()[1]
    time.sleep(3.0)
    assert (film.hosts.sent_bytes()[1] - before) * 8 / 3.0 < 600e3
