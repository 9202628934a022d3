"""A detector that is slower than the camera looks at the newest picture, and never works through a backlog."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.running import cut, results, socialbot

PICTURES, PERIOD_S, LOOK_S = 30, 0.1, 0.35


@pytest.mark.ros
@pytest.mark.parametrize("hosting", [(), ("--composed",)], ids=["process a node", "composed"])
def test_over_dds_the_newest_picture_wins(corridor: Path, tmp_path: Path, hosting: tuple[str, ...]) -> None:
    bag, graph, looks = cut(corridor, tmp_path / "bag", 0.0, 3.0), tmp_path / "graph.yaml", tmp_path / "looks.jsonl"
    graph.write_text(
        "name: slow\n"
        "inputs: [/camera/image_raw, /camera/image_raw/compressed]\n"
        "nodes:\n"
        "  image_converter: {type: image_converter}\n"
        "  detector: {type: 'tests.system.nodes:SlowDetector', "
        f"parameters: {{look_s: {LOOK_S}, record: '{looks}'}}}}\n"
    )
    out = tmp_path / "run"
    done = socialbot("replay", bag, "--graph", graph, "--out", out, "--no-pace", "--no-video", *hosting)
    assert done.returncode == 0, done.stderr
    looked = [json.loads(line) for line in looks.read_text().splitlines()]
    stamps = [look["stamp"] for look in looked]
    assert stamps == sorted(set(stamps))
    assert 4 <= len(stamps) <= 14
    assert results(out)["nodes"]["detector"]["skipped"] >= PICTURES - 14
    # A backlog would make each picture older than the one before.
    assert max(look["age_s"] for look in looked[2:]) < LOOK_S + PERIOD_S
