from __future__ import annotations

import pytest

from socialbot.runs.tracks import forget, latest


@pytest.mark.parametrize(("stamp", "kept"), [(5, "abc"), (10, "abc"), (19, "abc"), (20, "bc"), (25, "bc"), (99, "c")])
def test_forget_keeps_the_current_value(stamp, kept):
    track = [(10, "a"), (20, "b"), (30, "c")]
    before = latest(track, stamp)
    forget(track, stamp)
    assert "".join(what for _, what in track) == kept
    assert latest(track, stamp) == before
