"""Minds that are saved and compared."""

from __future__ import annotations

import json
from typing import Any

from socialbot.bdi import Engine
from socialbot.bdi.saving import restore, save
from tests.bdi.lab import Lab


def again(lab: Lab, *rules: Any, later: float = 0.0) -> Lab:
    """The lab of a process that was started anew with what was saved, some seconds later."""
    data = json.loads(json.dumps(save(lab.engine)))
    twin = Lab(*rules, start=lab.clock.now() / 1e9 + later)
    restore(twin.engine, data)
    twin.timeline = list(lab.timeline)
    return twin


def mind(engine: Engine) -> tuple[object, ...]:
    """Return the state of an engine in a form that can be compared."""
    facts = {
        key: [(args, since, set(map(str, notes))) for args, (since, notes, _) in relation.facts.items()]
        for key, relation in sorted(engine.beliefs.relations.items())
        if relation.facts
    }
    return facts, engine.interpreter.stage, engine.random.getstate(), list(map(str, engine.mind().desires))
