from __future__ import annotations

from socialbot.bridge.bags import open_bag
from socialbot.graph import Graph
from socialbot.replay import Replay, find_truth
from tests.evaluate.scenes import drawn_bag


def test_the_truth_of_a_folder_lies_beside_it_under_the_folders_whole_name(tmp_path):
    drawn_bag(tmp_path, "run", frames=3)
    with open_bag(drawn_bag(tmp_path, "run.1", frames=2)) as bag:
        truth = find_truth(Replay(bag, Graph("g", ())))
    assert truth is not None
    assert len(truth.frames) == 2
