"""Commands of users to an agent: each is checked at once and executed later."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import AgentSpeakError, parse_literal
from socialbot.bdi.literals import Computed, Literal, ground, literal
from socialbot.bdi.stdlib.goals import desire as pursued
from socialbot.bdi.stdlib.goals import drop_goal
from socialbot.bdi.stdlib.registry import opened
from socialbot.core.errors import RuleError, SocialbotError
from socialbot.core.messages import NO_JSON
from socialbot.deliberation import parse_fact, parse_facts
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.messages import Desire

PERSON = "person"
"""Source of beliefs that users add."""


class RefusedError(SocialbotError):
    """Command that an agent refuses."""

    exit_code = 4


Change = Callable[[str], object]
"""Accepted command; its argument is the id of the causing trace record."""


class EngineCommands:
    """Commands to an engine. Beliefs and goals are AgentSpeak literals. Methods raise RefusedError."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def believe(self, text: str) -> Change:
        """Add a belief with the source `PERSON`."""
        belief = _closed(text)
        kind = self._engine.beliefs.relation(belief.key).kind
        if kind is not None and issubclass(kind, Computed):
            raise RefusedError(f"{belief} is computed: it cannot be added")
        return lambda cause: self._engine.believe(belief, source=PERSON, cause=cause)  # type: ignore[arg-type]

    def forget(self, text: str) -> Change:
        """Remove a belief of any source; variables match anything."""
        belief = parse(text)
        relation = self._engine.beliefs.relations.get(belief.key)
        if relation is None or not relation.facts:
            raise RefusedError(f"it believes nothing like {belief}")
        if ground(belief) and belief.args not in relation.facts:
            raise RefusedError(f"it does not believe {belief}")
        return lambda cause: self._engine.forget(belief, cause=cause)  # type: ignore[arg-type]

    def achieve(self, text: str) -> Change:
        """Adopt a goal that has plans."""
        goal = _closed(text)
        triggers = self._engine.library.triggers.items()
        known = {key[2:] for key, trigger in triggers if key.startswith("+!") and trigger.plans}
        if goal.key not in known:
            has = f"it has some for {', '.join(sorted(known))}" if known else "it has none for any goal"
            raise RefusedError(f"it has no plan for {goal}; {has}")
        return lambda cause: self._engine.achieve(goal, cause=cause)

    def drop(self, text: str) -> Change:
        """Drop a goal."""
        goal = parse(text)
        goal = goal.with_(args=opened(goal.args, {}))
        if next(pursued(self._engine, (goal,), []), 0) == 0:
            raise RefusedError(f"it does not want {text.strip()}")
        return lambda cause: self._engine.call(lambda: drop_goal(self._engine, goal))


class DeliberatorCommands:
    """Commands to a deliberator. Beliefs are facts of its domain, goals are desires. Methods raise SocialbotError."""

    def __init__(self, deliberator: Deliberator) -> None:
        self._deliberator = deliberator
        self._facts = deliberator.facts

    def believe(self, text: str) -> Change:
        """Add a fact of the domain."""
        fact = parse_fact(text)
        _refuse(self._facts.unfit(fact))
        return self._call(lambda cause: self._facts.add(fact, source=PERSON, cause=cause))

    def forget(self, text: str) -> Change:
        """Remove a fact; wildcards match anything."""
        fact = parse_fact(text)
        _refuse(self._facts.unfit_pattern(fact))
        if "*" not in fact.params and self._facts.current(fact) is None:
            raise RefusedError(f"it does not believe {fact}")
        return self._call(lambda cause: self._facts.remove(fact, cause))

    def achieve(self, text: str) -> Change:
        """Adopt a desire, given as JSON or as its target facts."""
        desire = _desire(text)
        _refuse(self._deliberator.objection(desire))
        if self._facts.fulfilled(desire):
            raise RefusedError("its target holds already")
        return self._call(lambda cause: self._deliberator.desire(desire, cause=cause))

    def drop(self, text: str) -> Change:
        """Drop the desire of this name."""
        desires, name = self._deliberator.desires, text.strip()
        if name not in desires:
            names = ", ".join(state.name for state in desires)
            raise RefusedError(f"it has no desire {name!r}; {f'it has {names}' if names else 'it desires nothing'}")
        return self._call(lambda cause: self._deliberator.drop(name, "a person asked for it", cause=cause))

    def _call(self, change: Change) -> Change:
        return lambda cause: self._deliberator.engine.call(lambda: change(cause))


def _refuse(reason: str | None) -> None:
    if reason:
        raise RefusedError(reason)


def parse(text: str) -> Literal:
    """Parse an AgentSpeak literal that may start with a capital, as class names do. Raises RefusedError."""
    text = text.strip().removesuffix("()")
    capital = text[:1].isupper()
    try:
        found = parse_literal(text[:1].lower() + text[1:] if capital else text, "command")
    except AgentSpeakError as error:
        raise RefusedError(error.what.partition("\n")[0]) from error
    except RuleError as error:
        raise RefusedError(error.what) from error
    return literal(text[:1] + found.functor[1:], found.args) if capital else found


def _closed(text: str) -> Literal:
    found = parse(text)
    if not ground(found):
        raise RefusedError(f"{found} has a variable or a computed value: write values")
    return found


def _desire(text: str) -> Desire:
    text = text.strip()
    if not text.startswith("{"):
        return Desire(name=text.lower(), value=parse_facts(text))
    try:
        return msgspec.json.decode(text, type=Desire)
    except NO_JSON as error:
        raise RefusedError(f"invalid desire: {error}") from error
