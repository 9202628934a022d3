from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.base.simulation import WorldFault
from socialbot.agents.warehouse.scenario import SIX, parse_faults, random_faults
from socialbot.core.errors import ParameterError


def test_faults_are_parsed_in_order():
    assert parse_faults("30 leaves carrier_c; 40.5 slips ; 50 silent boxes 10; 60 stalls gripper_a 3;", SIX) == (
        WorldFault(30.0, "leaves", "carrier_c"),
        WorldFault(40.5, "slips"),
        WorldFault(50.0, "silent", "boxes", 10.0),
        WorldFault(60.0, "stalls", "gripper_a", 3.0),
    )
    assert parse_faults("", SIX) == ()


@pytest.mark.parametrize(
    "text",
    ["30", "leaves carrier_c", "30 leaves carrier_d", "30 leaves gripper_a", "x slips", "-1 slips", "nan slips",
     "30 silent boxes", "30 silent box 3", "30 stalls boxes 3", "30 explodes", "30 stalls carrier_a inf"],
)  # fmt: skip
def test_invalid_fault_is_rejected_with_remedy(text):
    with pytest.raises(ParameterError, match="remedy: write faults as"):
        parse_faults(text, SIX)


@given(st.text("0123456789 ;silentcarrier_abgpoxes", max_size=40))
def test_any_text_is_parsed_or_rejected_and_formats_back(text):
    try:
        faults = parse_faults(text, SIX)
    except ParameterError:
        return
    assert parse_faults("; ".join(map(str, faults)), SIX) == faults


@pytest.mark.parametrize(
    "fault",
    [
        WorldFault(50.0, "silent", "boxes", 0.0),
        WorldFault(123456.789012, "slips"),
        WorldFault(0.1, "stalls", "carrier_a", 1e-7),
    ],
)
def test_formatted_fault_parses_to_itself(fault):
    assert parse_faults(str(fault), SIX) == (fault,)


def test_random_faults_depend_only_on_seed_and_format_back():
    kinds = set()
    for seed in range(50):
        faults = random_faults(seed, SIX)
        assert 1 <= len(faults) <= 4
        assert faults == random_faults(seed, SIX) == parse_faults("; ".join(map(str, faults)), SIX)
        assert [fault.time_s for fault in faults] == sorted(fault.time_s for fault in faults)
        kinds |= {fault.kind for fault in faults}
    assert kinds == {"leaves", "slips", "silent", "stalls"}
