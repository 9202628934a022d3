"""Files of beliefs, desires and rules, in the YAML of ROS2-BDI; and the mind file of an agent, in JSON.

Beliefs, a list of::

    - {name: box_a, pddl_type: 1, type: box}                                # an instance
    - {name: in, pddl_type: 2, params: [box_a, base_1]}                     # a predicate
    - {name: stacked, pddl_type: 3, params: [base_1], value: 1}             # a fluent; 0 without value

Desires, a list of::

    - name: tidy_up
      priority: 0.4                                                         # 0 to 1
      deadline: 60                                                          # s
      value: [{name: in, pddl_type: 2, params: [box_a, base_2]}]
      conditions: [{check: LEQ, condition_to_check: {name: stacked, pddl_type: 3, params: [base_1], value: 1}}]
      precondition: {clauses: [{literals: [{check: T, condition_to_check: {name: ready, pddl_type: 2}}]}]}
      context: {clauses: []}
      rollback_belief_add: []
      rollback_belief_del: []

Rules, a list of::

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

import os
import re
from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeVar, get_args

import msgspec
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from socialbot.core.yaml import line_of, load_yaml
from socialbot.deliberation._fact_index import FactIndex, near
from socialbot.deliberation._matching import mismatch, unfit_condition
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import (
    FLUENT,
    INSTANCE,
    LONGEST_S,
    PREDICATE,
    Check,
    Desire,
    Dnf,
    Fact,
    FactCondition,
    FactConjunction,
)
from socialbot.deliberation.rules import ReactiveRule, RuleEffect, misfit, unfit_effect
from socialbot.planning.pddl.domain import PddlDomain

T = TypeVar("T")

Source = str | PathLike[str]


def load_beliefs(path: Source, domain: PddlDomain) -> tuple[Fact, ...]:
    """Read the facts of a file, instances first. Raises PlanningError with file and line."""
    found = [(node, _fact(node)) for node in _document(path).items()]
    found.sort(key=lambda item: item[1].pddl_type != INSTANCE)
    facts = FactBase(Engine("file", ManualClock()), domain)
    for node, fact in found:
        _check(node, facts.unfit(fact))
        before = facts.current(fact)
        if before is not None and before.value != fact.value:
            node.fail(f"{before} was given before", "give one value")
        facts.add(fact)
    return tuple(fact for _, fact in found)


def load_desires(path: Source, domain: PddlDomain) -> tuple[Desire, ...]:
    """Read the desires of a file. Raises PlanningError with file and line."""
    index, found = FactIndex(domain), {}
    for node in _document(path).items():
        desire = _desire(node, index, index.unfit)
        if desire.name in found:
            node.fail(f"there is another desire called {desire.name!r}", "choose another name", at="name")
        found[desire.name] = desire
    return tuple(found.values())


def load_rules(path: Source, domain: PddlDomain) -> tuple[ReactiveRule, ...]:
    """Read the rules of a file. Raises PlanningError with file and line."""
    index, found = FactIndex(domain), {}
    for number, node in enumerate(_document(path).items(), 1):
        node.only("name", "condition", "reactive_rules")
        if "condition" not in node.value:
            node.fail("a rule without condition", "for one that always holds write condition: {clauses: []}")
        name = node.text("name", f"rule_{number}")
        condition = _dnf(node.at("condition"), index)
        effects = tuple(_effect(effect, index) for effect in node.at("reactive_rules").items())
        if not effects:
            node.fail("a rule without effects", "give it reactive_rules", at="reactive_rules")
        rule = ReactiveRule(name, condition, effects)
        _check(node, misfit(rule, index))
        if name in found:
            node.fail(f"there is another rule called {name!r}", "choose another name", at="name")
        found[name] = rule
    return tuple(found.values())


class _Node:
    """A part of a file with its position."""

    def __init__(self, value: Any, file: str, line: int) -> None:
        self.value = value
        self.file = file
        self.line = line

    def fail(self, what: str, remedy: str | None = None, *, at: str = "") -> NoReturn:
        """Raise PlanningError with the line of the part, or of its key ``at``."""
        line = self.line
        if isinstance(self.value, CommentedMap) and at in self.value:
            line = line_of(self.value, at, line)
        raise PlanningError(what, where=f"{self.file}:{line}", remedy=remedy)

    def items(self) -> Iterator[_Node]:
        if self.value is None:
            return
        if not isinstance(self.value, CommentedSeq):
            self.fail(f"expected a list, got {_described(self.value)}")
        for number, item in enumerate(self.value):
            yield _Node(item, self.file, line_of(self.value, number, self.line))

    def at(self, key: str) -> _Node:
        return _Node(self.value.get(key), self.file, line_of(self.value, key, self.line, value=True))

    def only(self, *known: str) -> None:
        """Raise PlanningError unless it is a mapping with these keys."""
        if not isinstance(self.value, CommentedMap):
            self.fail(f"expected names with values, got {_described(self.value)}", f"there may be {', '.join(known)}")
        for key in self.value:
            if key not in known:
                self.fail(f"unknown key {key!r}", near(str(key), known), at=key)

    def text(self, key: str, default: str | None = None) -> str:
        value = self.value.get(key, default)
        if value is None:
            self.fail(f"{key!r} is missing")
        if not isinstance(value, str) or not value:
            self.fail(f"{key!r} has to be a text, got {_described(value)}", 'write "{x}" in quotes', at=key)
        return str(value)

    def number(self, key: str, default: float) -> float:
        value = self.value.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.fail(f"{key!r} has to be a number, got {_described(value)}", at=key)
        return float(value)

    def one_of(self, key: str, known: Mapping[Any, T]) -> T:
        value = self.value.get(key)
        if value is None:
            self.fail(f"{key!r} is missing", f"it is one of {', '.join(map(str, known))}")
        if isinstance(value, bool) or not isinstance(value, (str, int)) or value not in known:
            self.fail(f"{key!r} has to be one of {', '.join(map(str, known))}, got {_described(value)}", at=key)
        return known[value]


def _document(path: Source) -> _Node:
    try:
        text = Path(path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise PlanningError(f"cannot read it: {error}", where=str(path)) from error
    try:
        return _Node(load_yaml(YAML(typ="rt"), text), str(path), 1)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        remedy = 'write names with * or {x} in quotes: "*", "{x}"'
        raise PlanningError(f"no valid YAML: {error.problem}", where=f"{path}:{line}", remedy=remedy) from error
    except YAMLError as error:
        raise PlanningError(f"no valid YAML: {error}", where=str(path)) from error


_TYPES: Mapping[int, Literal[1, 2, 3]] = {INSTANCE: INSTANCE, PREDICATE: PREDICATE, FLUENT: FLUENT}
_CHECKS: Mapping[str, Check] = {check: check for check in get_args(Check)}
_SETS: Mapping[str, str] = {"belief": "belief", "desire": "desire"}
_OPERATIONS: Mapping[str, Literal["ADD", "DEL"]] = {"ADD": "ADD", "DEL": "DEL"}


def _fact(node: _Node) -> Fact:
    node.only("name", "pddl_type", "type", "params", "value")
    pddl_type = node.one_of("pddl_type", _TYPES)
    params = tuple(_param(item) for item in node.at("params").items())
    if pddl_type == INSTANCE:
        if len(params) > ("type" not in node.value):
            node.fail("an instance has no parameters", "give its type; predicates have pddl_type 2", at="params")
        kind = node.text("type") if "type" in node.value else "".join(params)
        return Fact(name=_lower(node.text("name")), pddl_type=INSTANCE, type=_lower(kind))
    value = node.number("value", 0.0)
    value = value if pddl_type == FLUENT else 0.0
    return Fact(name=_lower(node.text("name")), pddl_type=pddl_type, params=params, value=value)


def _param(node: _Node) -> str:
    if not isinstance(node.value, str):
        node.fail(f"expected the name of an object, got {_described(node.value)}", 'write "{x}" in quotes')
    return _lower(node.value)


def _desire(node: _Node, index: FactIndex, objection: Callable[[Fact], str | None]) -> Desire:
    node.only(
        "name", "value", "conditions", "priority", "deadline", "precondition", "context", "rollback_belief_add",
        "rollback_belief_del", "parent",
    )  # fmt: skip
    defaults = Desire(name="defaults")
    priority, deadline = node.number("priority", defaults.priority), node.number("deadline", defaults.deadline)
    if not 0.0 <= priority <= 1.0:
        node.fail(f"the priority {priority:g} is out of range", "give a number from 0 to 1", at="priority")
    if not 0.0 <= deadline <= LONGEST_S:
        node.fail(f"the deadline {deadline:g} is out of range", f"give seconds from 0 to {LONGEST_S:g}", at="deadline")
    conditions = []
    for item in node.at("conditions").items():
        condition = _condition(item)
        _check(item, mismatch(condition) or objection(condition.condition_to_check))
        conditions.append(condition)
    return Desire(
        name=node.text("name"),
        value=_facts(node.at("value"), objection),
        conditions=tuple(conditions),
        priority=priority,
        deadline=deadline,
        precondition=_dnf(node.at("precondition"), index),
        context=_dnf(node.at("context"), index),
        rollback_belief_add=_facts(node.at("rollback_belief_add"), objection),
        rollback_belief_del=_facts(node.at("rollback_belief_del"), index.unfit_pattern),
        parent=node.text("parent") if "parent" in node.value else "",
    )


def _facts(node: _Node, objection: Callable[[Fact], str | None]) -> tuple[Fact, ...]:
    found = []
    for item in node.items():
        fact = _fact(item)
        _check(item, objection(fact))
        found.append(fact)
    return tuple(found)


def _dnf(node: _Node, index: FactIndex) -> Dnf:
    if node.value is None:
        return Dnf()
    node.only("clauses")
    return Dnf(clauses=tuple(_conjunction(clause, index) for clause in node.at("clauses").items()))


def _conjunction(node: _Node, index: FactIndex) -> FactConjunction:
    node.only("literals")
    literals = []
    for item in node.at("literals").items():
        literals.append(_condition(item))
        _check(item, unfit_condition(literals[-1], index))
    return FactConjunction(literals=tuple(literals))


def _condition(node: _Node) -> FactCondition:
    node.only("check", "condition_to_check")
    fact = _fact(node.at("condition_to_check"))
    return FactCondition(check=node.one_of("check", _CHECKS), condition_to_check=fact)


def _effect(node: _Node, index: FactIndex) -> RuleEffect:
    node.only("set", "operation", "value")
    operation, value = node.one_of("operation", _OPERATIONS), node.at("value")
    if node.one_of("set", _SETS) == "desire":
        effect = RuleEffect(operation=operation, desire=_desire(value, index, index.unfit_pattern))
    else:
        effect = RuleEffect(operation=operation, fact=_fact(value))
    _check(value, unfit_effect(effect, index))
    return effect


def _check(node: _Node, reason: str | None) -> None:
    """Raise PlanningError for a reason that is not None; the part after its ``;`` is the remedy."""
    if reason is not None:
        what, _, hint = reason.partition("; ")
        node.fail(what, hint or "correct the file or the domain")


def _lower(name: str) -> str:
    parts = re.split(r"(\{\w+\})", name)
    return "".join(part if part.startswith("{") else part.lower() for part in parts)


def _described(value: object) -> str:
    if isinstance(value, Mapping):
        return "names with values"
    return "a list" if isinstance(value, list) else "nothing" if value is None else repr(value)


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
    new = path.with_name(f"{path.name}.new")
    new.write_bytes(msgspec.json.encode(saved))
    os.replace(new, path)


def restore_mind(deliberator: Deliberator, path: Path) -> bool:
    """Restore the beliefs and desires of an agent; return False if there is no file.

    Raises PlanningError, without a change, for an invalid file or one that does not fit the domain.
    """
    remedy = "delete the file to begin anew"
    try:
        saved = msgspec.json.decode(path.read_bytes(), type=SavedMind)
    except FileNotFoundError:
        return False
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise PlanningError(f"no kept mind: {error}", where=str(path), remedy=remedy) from error
    if saved.domain != deliberator.domain.name:
        raise PlanningError(f"it was kept by an agent of the domain {saved.domain}", where=str(path), remedy=remedy)
    index = FactIndex(deliberator.domain, (fact for fact in saved.facts if fact.pddl_type == INSTANCE))
    for fact in saved.facts:
        reason = index.unknown(fact)
        if reason is not None:
            raise PlanningError(f"the domain is not what it was: {reason}", where=str(path), remedy=remedy)
    for fact in saved.facts:
        deliberator.facts.add(fact, cause="kept")
    for item in saved.desires:
        deliberator.desire(item.desire, cause="kept")
        state = deliberator.desires.get(item.desire.name)
        if state is not None:
            state.failed_planning, state.failed_execution = item.failed_planning, item.failed_execution
    return True
