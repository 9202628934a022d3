"""Lines of the distances of people over time."""

from __future__ import annotations

from socialbot.runs.distances import distances_of
from socialbot.runs.history import History
from socialbot.runs.run import RunView
from tests.runs.expectations.traces import frame


def test_a_person_who_was_out_of_view_gets_a_new_line():
    frames = [frame(at_s, t1=5.0) for at_s in (0.0, 0.1, 0.2, 0.3)] + [frame(2.0, t1=3.0), frame(2.1, t1=2.9)]
    found = distances_of(RunView(None, History(frames, start=0), None))
    assert found.tracks == {"t1": [(0.0, 5.0), (0.3, 5.0), (0.3, None), (2.0, 3.0), (2.1, 2.9)]}
