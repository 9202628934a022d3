"""The example `reception`: a doctor's practice with its own building, script, plan and telephone."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from socialbot.core.clock import SECOND
from socialbot.graph.files import load_graph
from socialbot.graph.node import NodeConfig
from tests.agents.waldo.hall import Hall

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "reception"
TUESDAY_10 = 1_700_560_800 * SECOND  # 2023-11-21 10:00 UTC, 11:00 in Berlin


@pytest.fixture
def practice(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.chdir(EXAMPLE)
    monkeypatch.syspath_prepend(EXAMPLE)
    spec = importlib.util.spec_from_file_location("practice", EXAMPLE / "practice.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "practice", module)
    spec.loader.exec_module(module)
    return module


def test_the_graph_is_complete(practice: ModuleType):
    graph = load_graph(str(EXAMPLE / "graph.yaml"))
    assert graph.node("bdi_engine").type is practice.PracticeReceptionist


@pytest.mark.parametrize(
    ("sentences", "replies"),
    [
        (["Wo ist das Wartezimmer?"], ["Das Wartezimmer ist die zweite Tür rechts."]),
        (["Ich brauche ein neues Rezept"], ["Rezepte liegen am Empfang bereit."]),
        (["Haben Sie noch geöffnet?"], ["Wir haben heute bis 17:00 geöffnet."]),
        (
            ["Ich habe einen Termin bei Doktor Weber", "Ja, bitte"],
            [
                "Soll ich Frau Doktor Weber rufen?",
                "Ich rufe Frau Doktor Weber.",
                "Frau Doktor Weber kommt. Bitte nehmen Sie Platz.",
            ],
        ),
    ],
)
def test_the_practice_answers_in_german(practice: ModuleType, sentences, replies):
    telephone = NodeConfig("telephone", practice.Telephone, {})
    with Hall(
        practice.PracticeReceptionist,
        telephone,
        start=TUESDAY_10,
        building="building.yaml",
        script="script.yaml",
        language="de",
    ) as hall:
        hall.see(4.0, "t1")
        for sentence in sentences:
            hall.hear("t1", sentence, "de")
            hall.see(8.0, "t1")
    assert hall.said == ["Guten Tag! Willkommen in der Praxis.", *replies]
