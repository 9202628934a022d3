"""Files of beliefs, desires and rules, in the YAML of ROS2-BDI; and the mind file of an agent, in JSON.

Each YAML file is a list of `Fact`, of `Desire`, or of rules::

    - {name: stacked, pddl_type: 3, params: [base_1], value: 1}             # a fluent; 0 without value

    - name: tidy_up
      priority: 0.4                                                         # 0 to 1
      deadline: 60                                                          # s
      value: [{name: in, pddl_type: 2, params: [box_a, base_2]}]
      precondition: {clauses: [{literals: [{check: T, condition_to_check: {name: ready, pddl_type: 2}}]}]}

    - name: tidy                                                            # rule_1, rule_2, ... without
      condition:
        clauses:
          - literals: [{check: T, condition_to_check: {name: in, pddl_type: 2, params: ["{x}", "*"]}}]
      reactive_rules:
        - {set: belief, operation: ADD, value: {name: clear, pddl_type: 2, params: ["{x}"]}}

ROS2-BDI has neither ``conditions`` of desires nor names of rules. In its older files the type of an instance is the
only parameter. Names of the domain are converted to lower case; missing lists are empty. All entries are checked
against the domain: mistakes are PlanningErrors with file and line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import msgspec

from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.core.decoding import from_json
from socialbot.core.errors import PlanningError
from socialbot.core.paths import read_text, replace_file
from socialbot.core.reading import read_bytes
from socialbot.core.yaml import YamlFile, YamlSection
from socialbot.deliberation._fact_index import FactIndex
from socialbot.deliberation._matching import unfit_condition
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import FLUENT, INSTANCE, Desire, Dnf, Fact, FactCondition
from socialbot.deliberation.rules import ReactiveRule, RuleEffect, conditions_in, unbound, unfit_effect, unfit_parts
from socialbot.planning.pddl.domain import PddlDomain

Source = str | PathLike[str]


def load_beliefs(path: Source, domain: PddlDomain) -> tuple[Fact, ...]:
    """Read the facts of a file, instances first. Raises PlanningError with file and line."""
    file = _File(path)
    found = sorted(file.items(Fact), key=lambda fact: fact.pddl_type != INSTANCE)
    facts = FactBase(Engine("file", ManualClock()), domain)
    for fact in found:
        file.check(fact, facts.unfit(fact))
        before = facts.current(fact)
        if before is not None and before.value != fact.value:
            file.check(fact, f"{before} has another value above; give one value")
        facts.add(fact)
    return tuple(found)


def load_desires(path: Source, domain: PddlDomain) -> tuple[Desire, ...]:
    """Read the desires of a file. Raises PlanningError with file and line."""
    file, index, found = _File(path), FactIndex(domain), {}
    for desire in file.items(Desire):
        file.check_desire(desire, index, index.unfit)
        if desire.name in found:
            file.check(desire, f"another desire has the name {desire.name!r}; choose another name")
        found[desire.name] = desire
    return tuple(found.values())


def load_rules(path: Source, domain: PddlDomain) -> tuple[ReactiveRule, ...]:
    """Read the rules of a file. Raises PlanningError with file and line."""
    file, index, found = _File(path), FactIndex(domain), {}
    for number, read in enumerate(file.items(_Rule), 1):
        for condition in conditions_in(read.condition):
            file.check(condition, unfit_condition(condition, index))
        if not read.reactive_rules:
            file.check(read, "a rule without effects; give it reactive_rules")
        effects = tuple(file.effect(effect, index) for effect in read.reactive_rules)
        rule = ReactiveRule(read.name or f"rule_{number}", read.condition, effects)
        file.check(read, unbound(rule, domain))
        if rule.name in found:
            file.check(read, f"another rule has the name {rule.name!r}; choose another name")
        found[rule.name] = rule
    return tuple(found.values())


class _Effect(msgspec.Struct, frozen=True, kw_only=True):
    set: Literal["belief", "desire"]
    operation: Literal["ADD", "DEL"]
    value: Any


class _Rule(msgspec.Struct, frozen=True, kw_only=True):
    name: str = ""
    condition: Dnf
    reactive_rules: tuple[_Effect, ...] = ()


_REQUIRED: Mapping[type, str] = {Fact: "pddl_type", FactCondition: "check"}
"""Fields that have a default in messages and none in files."""


class _File(YamlFile):
    """A YAML file, with the lines of the structs that were read from it."""

    def __init__(self, path: Source) -> None:
        super().__init__(str(path), PlanningError)
        self._lines: dict[int, int] = {}

    def items(self, kind: type) -> tuple[Any, ...]:
        """Read the list of the file."""
        page = self.parse(read_text(Path(self.where), PlanningError))
        return self.convert(msgspec.inspect.type_info(tuple[kind, ...]), page, 1)

    def check(self, part: object, reason: str | None) -> None:
        """Raise PlanningError for a reason that is not None; the part after its ``;`` is the remedy."""
        if reason is not None:
            what, _, hint = reason.partition("; ")
            self.fail(what, self._lines[id(part)], hint or "correct the file or the domain")

    def check_desire(self, desire: Desire, index: FactIndex, objection: Callable[[Fact], str | None]) -> None:
        for part, reason in unfit_parts(desire, index, objection):
            self.check(part, reason)

    def effect(self, effect: _Effect, index: FactIndex) -> RuleEffect:
        key, kind = ("desire", Desire) if effect.set == "desire" else ("fact", Fact)
        value = self.convert(msgspec.inspect.type_info(kind), effect.value, self._lines[id(effect)])
        if effect.set == "desire":
            self.check_desire(value, index, index.unfit_pattern)
        found = RuleEffect(operation=effect.operation, **{key: value})
        self.check(value, unfit_effect(found, index))
        return found

    def made(self, found: Any, section: YamlSection) -> Any:
        """Check and complete a struct that was read, and keep its line."""
        needed = _REQUIRED.get(type(found))
        if needed and needed not in section.page:
            self.fail(f"{needed!r} is missing", section.start)
        if isinstance(found, Fact):
            found = self._fact(found, section.start)
        self._lines[id(found)] = section.start
        return found

    def _fact(self, fact: Fact, line: int) -> Fact:
        params, name = tuple(map(_lower, fact.params)), _lower(fact.name)
        if fact.pddl_type != INSTANCE:
            value = fact.value if fact.pddl_type == FLUENT else 0.0
            return Fact(name=name, pddl_type=fact.pddl_type, params=params, value=value)
        if len(params) > (not fact.type):
            self.fail("an instance has no parameters", line, "give its type; predicates have pddl_type 2")
        return Fact(name=name, pddl_type=INSTANCE, type=_lower(fact.type) or "".join(params))


def _lower(name: str) -> str:
    """Return a name in lower case, except its variables."""
    return re.sub(r"\{\w+\}|[^{]+|\{", lambda part: part[0] if part[0][0] == "{" else part[0].lower(), name)


class SavedDesire(msgspec.Struct, frozen=True, kw_only=True):
    """A desire with its failures."""

    desire: Desire
    failed_planning: int = 0
    failed_execution: int = 0


class SavedMind(msgspec.Struct, frozen=True, kw_only=True, tag_field="schema", tag="socialbot/Kept/1"):
    """Content of a mind file: beliefs and desires, from which an agent continues after a restart."""

    domain: str
    facts: tuple[Fact, ...]
    desires: tuple[SavedDesire, ...]


def save_mind(deliberator: Deliberator, path: Path) -> None:
    """Write the beliefs and desires of an agent atomically. A running plan is saved as if it had been aborted."""
    saved = SavedMind(
        domain=deliberator.domain.name,
        facts=deliberator.plan_executor.beliefs_if_aborted(),
        desires=tuple(
            SavedDesire(
                desire=state.desire, failed_planning=state.failed_planning, failed_execution=state.failed_execution
            )
            for state in deliberator.desires
        ),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, msgspec.json.encode(saved), durable=True)


def restore_mind(deliberator: Deliberator, path: Path) -> bool:
    """Restore the beliefs and desires of an agent; return False if there is no file.

    Raises PlanningError, without a change, for an invalid file or one that does not fit the domain.
    """
    remedy = "delete the file to start without it"
    try:
        saved = from_json(read_bytes(path), SavedMind)
    except FileNotFoundError:
        return False
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise PlanningError(f"invalid mind file: {error}", where=str(path), remedy=remedy) from error
    if saved.domain != deliberator.domain.name:
        raise PlanningError(f"it belongs to the domain {saved.domain}", where=str(path), remedy=remedy)
    index = FactIndex(deliberator.domain, (fact for fact in saved.facts if fact.pddl_type == INSTANCE))
    for fact in saved.facts:
        reason = index.unknown(fact)
        if reason is not None:
            raise PlanningError(f"the domain has changed: {reason}", where=str(path), remedy=remedy)
    for fact in saved.facts:
        deliberator.facts.add(fact, cause="kept")
    for item in saved.desires:
        deliberator.desire(item.desire, cause="kept")
        state = deliberator.desires.get(item.desire.name)
        if state is not None:
            state.failed_planning, state.failed_execution = item.failed_planning, item.failed_execution
    return True
