"""Waldo's graph: identical inline runs, and the same decisions at the same times over ROS."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.running import actions, cut, results, socialbot, socialbot_here

FRAME_PERIOD_S = 0.3
ROUNDING_S = 0.001
OPTIONS = ("--set", "bdi_engine.help_after_s=2", "--no-video")


@pytest.fixture(scope="module")
def visit(corridor: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A person comes and stays: 8 s of the corridor with a third of its images."""
    return cut(corridor, tmp_path_factory.mktemp("bag") / "visit", 4.0, 12.0, every=3)


@pytest.fixture(scope="module")
def inline(visit: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inline") / "run"
    done = socialbot("replay", visit, "--runner", "inline", "--out", folder, *OPTIONS)
    assert done.returncode == 0, done.stderr
    return folder


def test_waldo_greets_and_offers_help(inline: Path) -> None:
    assert [(name, arguments[:1]) for _, name, arguments in actions(inline)] == [
        ("stayIdle", ()),
        ("speak", ("greeting",)),
        ("speak", ("offer",)),
    ]
    assert len(list((inline / "speech").glob("*.wav"))) == 2


def test_inline_traces_are_the_same_to_the_byte(visit: Path, inline: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"  # in this process, whose hash seed is another one
    assert socialbot_here("replay", visit, "--runner", "inline", "--out", again, *OPTIONS).returncode == 0
    assert (again / "trace.jsonl").read_bytes() == (inline / "trace.jsonl").read_bytes()


@pytest.mark.ros
@pytest.mark.parametrize(
    "hosting",
    [pytest.param((), id="process a node", marks=pytest.mark.slow), pytest.param(("--composed",), id="composed")],
)
def test_ros_does_the_same_within_a_frame_period(
    visit: Path, inline: Path, tmp_path: Path, hosting: tuple[str, ...]
) -> None:
    folder = tmp_path / "ros"
    done = socialbot_here("replay", visit, "--runner", "ros", "--rate", 2, "--out", folder, *OPTIONS, *hosting)
    assert done.returncode == 0, done.stderr
    expected, found = actions(inline), actions(folder)
    assert [action[1:] for action in found] == [action[1:] for action in expected]
    for (there, *_), (here, *_) in zip(found, expected, strict=True):
        assert abs(there - here) <= FRAME_PERIOD_S + ROUNDING_S
    assert results(folder)["frames"] == results(inline)["frames"]
    assert len(list((folder / "speech").glob("*.wav"))) == 2
