"""Blur and noise of the simulated camera."""

from __future__ import annotations

import numpy as np
import pytest

from socialbot.robots.simulation.node import ImageSensor


def grey(level: int) -> np.ndarray:
    return np.full((120, 160, 3), level, np.uint8)


def step() -> np.ndarray:
    picture = grey(40)
    picture[:, 80:] = 200
    return picture


@pytest.mark.parametrize("noise", [2.0, 8.0])
def test_noise_has_the_given_size_at_mid_grey_and_adds_no_light(noise):
    picture = ImageSensor(noise=noise, blur_px=0.0).expose(grey(128), 0)
    assert picture.std() == pytest.approx(noise, rel=0.05)
    assert picture.mean() == pytest.approx(128, abs=0.1)


def test_noise_differs_between_pixels_channels_and_times():
    sensor = ImageSensor(noise=4.0, blur_px=0.0)
    first, second = (sensor.expose(grey(128), time).astype(float) - 128 for time in (0, 100_000_000))
    pairs = [(first, second), (first[..., 0], first[..., 2]), (first[:, 1:], first[:, :-1]), (first[1:], first[:-1])]
    for one, other in pairs:
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.03


def test_a_picture_depends_on_seed_and_time_alone():
    def expose(seed: int, time: int) -> bytes:
        return ImageSensor(noise=2.0, blur_px=0.5, seed=seed).expose(step(), time).tobytes()

    assert expose(3, 7) == expose(3, 7)
    assert len({expose(3, 7), expose(-3, 7), expose(3, 8)}) == 3


def test_dark_pixels_have_more_noise_than_bright_ones():
    sensor = ImageSensor(noise=2.0, blur_px=0.0)
    sizes = [float(sensor.expose(grey(level), 0).std()) for level in (20, 60, 128, 230)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] < 2 * sizes[-1]


def test_blur_widens_an_edge():
    assert np.unique(ImageSensor(noise=0.0, blur_px=0.0).expose(step(), 0)).tolist() == [40, 200]
    blurred = ImageSensor(noise=0.0, blur_px=0.5).expose(step(), 0)
    assert 40 < blurred[0, 79, 0] < 80
    assert blurred[0, 79, 0] + blurred[0, 80, 0] == pytest.approx(240, abs=1)
    assert blurred[0, 75, 0] == 40
