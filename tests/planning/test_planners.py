from __future__ import annotations

import pytest

from socialbot.core.errors import ParameterError
from socialbot.planning.planners import engines as unified
from socialbot.planning.planners.engines import make_planner


def test_the_default_is_kairos():
    pytest.importorskip("kairos", reason="kairos-planner is not installed")
    assert make_planner().name == make_planner("kairos").name == "kairos"


def test_popf_may_be_given_with_its_path(tmp_path):
    program = tmp_path / "anything"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    assert make_planner(f"popf:{program}").name == "popf"


def test_the_engines_of_unified_planning_have_names_of_their_own(monkeypatch):
    monkeypatch.setattr(unified, "find_spec", lambda _: object())
    assert make_planner("up:aries").name == "up:aries"


@pytest.mark.parametrize("name", ["", "lpg", "up", "up:", "kairos:2", "Kairos"])
def test_other_names_are_an_error_that_lists_those_there_are(name):
    with pytest.raises(ParameterError, match="there are kairos, popf, popf:PATH and up:ENGINE"):
        make_planner(name)
