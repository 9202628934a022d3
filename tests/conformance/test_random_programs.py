"""Random programs print what Jason prints for them, in any order."""

from __future__ import annotations

import pytest

from tests.bdi.mas import Mas
from tests.conformance.random_programs import agents, compared, digest, recorded

ANSWERS = recorded()["answers"]


def printed(number: int) -> list[str]:
    mas = Mas(**agents(number)).until(10)
    return sorted(compared(f"{name[0]} {line[2:]}") for name, line in mas.said if line.startswith("> "))


@pytest.mark.parametrize("number", range(0, len(ANSWERS), 4))
def test_a_random_program_prints_what_jason_prints(number: int):
    assert printed(number) == ANSWERS[number]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(ANSWERS)))
def test_all_random_programs_print_what_jason_prints(number: int):
    assert printed(number) == ANSWERS[number]


def test_the_answers_belong_to_the_programs():
    assert recorded()["programs"] == digest(len(ANSWERS)), "run python -m tests.conformance.random_programs COMMAND"
    assert len(ANSWERS) >= 300
    assert all(ANSWERS)
