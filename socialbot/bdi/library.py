"""Plan library: plans by triggering event, inferences and computed beliefs by their conclusions."""

from __future__ import annotations

import functools
import itertools
import traceback
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

from socialbot.bdi.intentions import GENERATED_FILE
from socialbot.bdi.literals import Belief, Computed, Goal, Literal, Structure, ground
from socialbot.bdi.plans import Inference, Plan, flat
from socialbot.bdi.steps import Step
from socialbot.core.errors import RuleError

Run = Callable[[Any, tuple[Any, ...], tuple[Any, ...], Any], Any]
"""Tries a plan for the arguments and annotations of an event, and its record; None if it does not apply."""

FEW = 2
"""Maximum number of plans that are tried in sequence; more plans are indexed."""


class CompiledPlan:
    """Plan of a library with its code, generated at the first use.

    ``run`` tries the plan for an event, ``run_open`` for a goal with variables; ``probe`` counts the conditions that
    hold. ``lines`` are the steps by line of the code.
    """

    __slots__ = ("_shown", "library", "lines", "plan", "probe", "run", "run_open")

    def __init__(self, plan: Plan, library: Library) -> None:
        self.plan = plan
        self.library = library
        self._shown: tuple[str, str] | None = None
        self.reset()

    def shown(self) -> tuple[str, str]:
        """Texts of the plan and of its event in the trace."""
        if self._shown is None:
            self._shown = (str(self.plan), str(self.plan.event))
        return self._shown

    def reset(self) -> None:
        self.run: Run = functools.partial(self._compile_and_run, "run")
        self.run_open: Run = functools.partial(self._compile_and_run, "run_open")
        self.probe: Callable[..., None] = functools.partial(self._compile_and_run, "probe")
        self.lines: dict[int, Step] = {}

    def compile(self, *names: str) -> None:
        """Compile some of the functions ``run``, ``run_open`` and ``probe``, if not done yet; by default ``run``."""
        # Imported here, because the compiler is large.
        from socialbot.bdi.compiler._plans import compile_plan, compile_probe

        for name in names or ("run",):
            if isinstance(getattr(self, name), functools.partial):
                probe = name == "probe"
                setattr(self, name, compile_probe(self) if probe else compile_plan(self, opened=name == "run_open"))

    def _compile_and_run(self, name: str, *args: Any) -> Any:
        self.compile(name)
        return getattr(self, name)(*args)

    def step_at(self, error: BaseException) -> Step | None:
        """Step whose code raised an exception."""
        found = None
        for _, line in _generated_frames(error):
            found = self.lines.get(line, found)
        return found


def record_behind(error: BaseException) -> Any:
    """Trace record of the plan whose code raised an exception, if any."""
    found = None
    for frame, _ in _generated_frames(error):
        found = frame.f_locals.get("c", found)
    return found


def _generated_frames(error: BaseException) -> Iterator[tuple[FrameType, int]]:
    for frame, line in traceback.walk_tb(error.__traceback__):
        if frame.f_code.co_filename.startswith(GENERATED_FILE):
            yield frame, line


class Trigger:
    """Plans for one kind of event, indexed by the most selective argument."""

    __slots__ = ("by", "goal", "key", "plans", "position", "rest")

    def __init__(self, key: str, plans: tuple[CompiledPlan, ...] = ()) -> None:
        self.key = key
        self.goal = key[1:2] in ("!", "?")
        self.plans = plans
        self.index()

    def candidates(self, args: tuple[Any, ...]) -> tuple[CompiledPlan, ...]:
        """Plans that may match the arguments (without variables), in the order of trial."""
        position = self.position
        return self.plans if position is None else self.by.get(args[position], self.rest)

    def add(self, compiled: CompiledPlan, *, first: bool = False) -> None:
        """Add a plan after those of the same priority, or before all others."""
        last = self.plans[-1].plan.priority if self.plans else compiled.plan.priority
        position, value = self.position, None
        if position is not None:
            value = compiled.plan.event.literal.args[position]
        if first or compiled.plan.priority > last or position is None or not _is_constant(value):
            plans = (compiled, *self.plans) if first else (*self.plans, compiled)
            self.plans = tuple(sorted(plans, key=lambda item: -item.plan.priority))
            self.index()
        else:
            self.plans += (compiled,)
            self.by[value] = (*self.by.get(value, self.rest), compiled)

    def index(self) -> None:
        heads = [compiled.plan.event.literal.args for compiled in self.plans]
        constants = [sum(map(_is_constant, column)) for column in zip(*heads, strict=True)]
        self.position = constants.index(max(constants)) if len(heads) > FEW and any(constants) else None
        self.by: dict[Any, tuple[CompiledPlan, ...]] = {}
        self.rest = self.plans
        if self.position is None:
            return
        rest: tuple[CompiledPlan, ...] = ()
        for compiled, args in zip(self.plans, heads, strict=True):
            value = args[self.position]
            if _is_constant(value):
                self.by[value] = (*self.by.get(value, rest), compiled)
            else:
                rest = (*rest, compiled)
                self.by = {known: (*found, compiled) for known, found in self.by.items()}
        self.rest = rest


class Triggers(dict[str, Trigger]):
    """Triggers by key, such as ``+!at/2``; a missing trigger is created."""

    def __missing__(self, key: str) -> Trigger:
        trigger = self[key] = Trigger(key)
        return trigger


class Library:
    """Plans, inferences and computed beliefs of one agent; agents share a library until one changes it."""

    def __init__(self, *rules: Plan | Inference | list[Plan]) -> None:
        self.triggers = Triggers()
        self.inferences: dict[str, list[CompiledInference]] = {}
        self.computed: dict[str, Computed] = {}
        self.kinds: dict[str, type[Belief]] = {}
        self.goals: dict[str, type[Goal]] = {}
        self.users = 0
        self._labels: dict[str, CompiledPlan] = {}
        for rule in rules:
            self.add_rule(rule)

    def __iter__(self) -> Iterator[Plan]:
        for trigger in list(self.triggers.values()):
            for compiled in trigger.plans:
                yield compiled.plan

    def copy(self) -> Library:
        twin = Library()
        for plan in self:
            twin.add(plan)
        for inferences in self.inferences.values():
            for compiled in inferences:
                twin.add_inference(compiled.inference)
        twin.computed.update(self.computed)
        twin.kinds.update(self.kinds)
        twin.goals.update(self.goals)
        return twin

    def add_rule(self, rule: Plan | Inference | list[Plan]) -> None:
        if isinstance(rule, Inference):
            self.add_inference(rule)
        else:
            for plan in flat([rule]):
                self.add(plan)

    def add(self, plan: Plan, *, first: bool = False) -> CompiledPlan:
        """Add a plan. Raises RuleError for a duplicate label."""
        if plan.label is not None and plan.label in self._labels:
            raise RuleError(
                f"the label {plan.label} is already used", where=str(plan.origin or plan), remedy="choose another label"
            )
        compiled = CompiledPlan(plan, self)
        for kind in plan.classes():
            self.declare(kind)
        if plan.label is not None:
            self._labels[plan.label] = compiled
        self.triggers[plan.event.key].add(compiled, first=first)
        return compiled

    def remove(self, plan: Plan) -> bool:
        """Remove a plan; return whether it existed."""
        trigger = self.triggers.get(plan.event.key)
        kept = tuple(compiled for compiled in trigger.plans if compiled.plan is not plan) if trigger else ()
        if trigger is None or len(kept) == len(trigger.plans):
            return False
        trigger.plans = kept
        trigger.index()
        self._labels = {label: compiled for label, compiled in self._labels.items() if compiled.plan is not plan}
        return True

    def labelled(self, label: str) -> Plan | None:
        compiled = self._labels.get(label)
        return compiled.plan if compiled else None

    def add_inference(self, inference: Inference) -> None:
        for kind in inference.classes():
            self.declare(kind)
        new = inference.head.key not in self.inferences
        self.inferences.setdefault(inference.head.key, []).append(CompiledInference(inference, self))
        if new:
            self.recompile()

    def declare(self, kind: type[Literal]) -> None:
        if issubclass(kind, Goal):
            self.goals[kind.functor] = kind
        elif issubclass(kind, Belief) and kind is not Structure:
            self.kinds[kind.functor] = kind

    def derives(self, key: str) -> bool:
        """Whether beliefs of this key can be inferred or computed."""
        return key in self.inferences or self.computes(key) is not None

    def computes(self, key: str) -> type[Computed] | None:
        """Class that computes beliefs of this key."""
        kind = self.kinds.get(key.rpartition("/")[0])
        return kind if kind is not None and issubclass(kind, Computed) else None

    def compile(self) -> None:
        """Compile all plans and inferences, for all kinds of events and for the trace."""
        for trigger in list(self.triggers.values()):
            for compiled in trigger.plans:
                opened = ["run_open"] if trigger.goal and compiled.plan.event.literal.args else []
                compiled.compile("run", "probe", *opened)
        for inferences in self.inferences.values():
            for rule in inferences:
                rule.compile()

    def recompile(self) -> None:
        """Discard the code of every plan and inference."""
        plans = (compiled for trigger in self.triggers.values() for compiled in trigger.plans)
        for compiled in itertools.chain(plans, *self.inferences.values()):
            compiled.reset()


def _is_constant(term: object) -> bool:
    if isinstance(term, tuple):
        return all(map(_is_constant, term))
    if isinstance(term, Literal):
        return not term.annotations and _is_constant(term.args)
    return ground(term)


class CompiledInference:
    """Inference of a library with its code."""

    __slots__ = ("inference", "library", "solve")

    def __init__(self, inference: Inference, library: Library) -> None:
        self.inference = inference
        self.library = library
        self.reset()

    def reset(self) -> None:
        self.solve: Callable[..., Iterator[None]] = self._solve

    def compile(self) -> None:
        from socialbot.bdi.compiler._plans import compile_inference

        if self.solve == self._solve:
            self.solve = compile_inference(self)

    def _solve(self, *args: Any) -> Iterator[None]:
        self.compile()
        return self.solve(*args)
