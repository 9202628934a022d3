from __future__ import annotations

import pickle

import pytest

from socialbot.bdi.agentspeak import parse
from socialbot.core import errors


@pytest.mark.parametrize("name", [name for name in errors.__all__ if name != "suggestion"])
def test_an_error_travels_between_processes(name):
    kind = getattr(errors, name)
    error = kind("it is broken", where="here", remedy="mend it")
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind
    assert str(again) == str(error) == "here: it is broken\n  remedy: mend it"


def test_an_error_with_a_place_in_a_text_travels_too():
    with pytest.raises(errors.SocialbotError) as caught:
        parse("+!go <- .\n", "mind.asl")
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)
    assert vars(again) == vars(caught.value)
