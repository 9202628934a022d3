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
from typing import Annotated, Any, Literal, NoReturn, get_args, get_origin

import msgspec
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from socialbot.core.paths import read_text, replace_file
from socialbot.core.reading import read_bytes
from socialbot.core.yaml import line_of, load_yaml, plain
from socialbot.deliberation._fact_index import FactIndex, near
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


_Text = Annotated[str, msgspec.Meta(min_length=1)]


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


class _File:
    """A YAML file, with the lines of the structs that were read from it."""

    def __init__(self, path: Source) -> None:
        self._path = path
        self._lines: dict[int, int] = {}

    def items(self, kind: Any) -> tuple[Any, ...]:
        try:
            page = load_yaml(YAML(typ="rt"), read_text(Path(self._path), PlanningError))
        except MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            self.fail(f"no valid YAML: {error.problem}", line, 'write names with * or {x} in quotes: "*", "{x}"')
        except YAMLError as error:
            raise PlanningError(f"no valid YAML: {error}", where=str(self._path)) from error
        return self._read(tuple[kind, ...], page, 1, "")

    def fail(self, what: str, line: int, remedy: str | None = None) -> NoReturn:
        raise PlanningError(what, where=f"{self._path}:{line}", remedy=remedy)

    def check(self, part: object, reason: str | None) -> None:
        """Raise PlanningError for a reason that is not None; the part after its ``;`` is the remedy."""
        if reason is not None:
            what, _, hint = reason.partition("; ")
            self.fail(what, self._lines[id(part)], hint or "correct the file or the domain")

    def check_desire(self, desire: Desire, index: FactIndex, objection: Callable[[Fact], str | None]) -> None:
        for part, reason in unfit_parts(desire, index, objection):
            self.check(part, reason)

    def effect(self, effect: _Effect, index: FactIndex) -> RuleEffect:
        kind = Desire if effect.set == "desire" else Fact
        value = self._read(kind, effect.value, self._lines[id(effect)], "value")
        if effect.set == "desire":
            self.check_desire(value, index, index.unfit_pattern)
        found = RuleEffect(operation=effect.operation, **{"desire" if effect.set == "desire" else "fact": value})
        self.check(value, unfit_effect(found, index))
        return found

    def _read(self, kind: Any, value: Any, line: int, key: str) -> Any:
        """Convert a part of the file to a type; ``key`` names it in errors."""
        if get_origin(kind) is tuple:
            if value is None:
                return ()
            if not isinstance(value, CommentedSeq):
                self.fail(f"expected a list, got {_described(value)}", line)
            inner, found = get_args(kind)[0], enumerate(value)
            return tuple(self._read(inner, item, line_of(value, number, line), key) for number, item in found)
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            return self._struct(kind, value, line)
        if kind is Any:
            return value
        if get_origin(kind) is Literal and (isinstance(value, (bool, float)) or value not in get_args(kind)):
            choices = ", ".join(map(str, get_args(kind)))
            self.fail(f"{key!r} must be one of {choices}, got {_described(value)}", line)
        try:
            return msgspec.convert(plain(value), _Text if kind is str else kind)
        except msgspec.ValidationError as error:
            hint = 'write "{x}" in quotes' if kind is str else None
            bound = re.search(r"[<>]= .*", str(error))
            wanted = "a text" if kind is str else f"a number {bound[0]}" if bound else "a number"
            self.fail(f"{key!r} must be {wanted}, got {_described(value)}", line, hint)

    def _struct(self, kind: type[msgspec.Struct], value: Any, line: int) -> Any:
        if value is None and kind is Dnf:
            return Dnf()
        fields = {field.name: field for field in msgspec.structs.fields(kind)}
        if not isinstance(value, CommentedMap):
            self.fail(f"expected names with values, got {_described(value)}", line, f"there may be {', '.join(fields)}")
        for key in value:
            if key not in fields:
                self.fail(f"unknown key {key!r}", line_of(value, key, line), near(str(key), fields))
        given = {}
        for name, field in fields.items():
            if name in value:
                given[name] = self._read(field.type, value[name], line_of(value, name, line, value=True), name)
            elif field.required or _REQUIRED.get(kind) == name:
                self.fail(f"{name!r} is missing", line)
        found = kind(**given)
        if isinstance(found, Fact):
            found = self._fact(found, line)
        self._lines[id(found)] = line
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
    replace_file(path, msgspec.json.encode(saved))


def restore_mind(deliberator: Deliberator, path: Path) -> bool:
    """Restore the beliefs and desires of an agent; return False if there is no file.

    Raises PlanningError, without a change, for an invalid file or one that does not fit the domain.
    """
    remedy = "delete the file to start without it"
    try:
        saved = msgspec.json.decode(read_bytes(path), type=SavedMind)
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
