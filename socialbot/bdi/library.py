"""The plan library: plans found by the event they react to, rules and computed beliefs by what they conclude."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from socialbot.bdi.compiler.runtime import FILENAME
from socialbot.bdi.literals import Belief, Computed, Goal, Literal, Structure, ground
from socialbot.bdi.plans import Inference, Plan, flat
from socialbot.bdi.steps import Step
from socialbot.core.errors import RuleError

Run = Callable[[Any, tuple[Any, ...], tuple[Any, ...], Any], Any]
"""Tries a plan: engine, arguments and annotations of the event, its record. None means that it does not apply."""


FEW = 2
"""So many plans are tried one after the other; from there on an index pays."""


class Ready:
    """A plan in a library, with its code, which is compiled when it is first needed."""

    __slots__ = ("_probes", "_shown", "library", "lines", "plan", "run", "run_open")

    def __init__(self, plan: Plan, library: Library) -> None:
        self.plan = plan
        self.library = library
        self._shown: tuple[str, str] | None = None
        self.reset()

    def shown(self) -> tuple[str, str]:
        """The plan and its event as the trace shows them."""
        if self._shown is None:
            self._shown = (str(self.plan), str(self.plan.event))
        return self._shown

    def fits(self, engine: Any, args: Any, annotations: Any, count: int) -> bool:
        """Whether the event and the first ``count`` conditions fit."""
        from socialbot.bdi.compiler.plans import compile_probe

        probe = self._probes.get(count)
        if probe is None:
            probe = self._probes[count] = compile_probe(self, count)
        return probe(engine, args, annotations)

    def reset(self) -> None:
        """Forgets the code, as what it was compiled against has changed."""
        self.run: Run = self._run
        self.run_open: Run = self._run_open
        self.lines: dict[int, Step] = {}
        self._probes: dict[int, Callable[..., bool]] = {}

    def compile(self) -> None:
        """Compiles it for events without variables. Raises RuleError when it cannot be."""
        # Here and below, as the compiler takes its time to be imported.
        from socialbot.bdi.compiler.plans import compile_plan

        self.run = compile_plan(self, opened=False)

    def _run(self, engine: Any, args: Any, annotations: Any, cause: Any) -> Any:
        self.compile()
        return self.run(engine, args, annotations, cause)

    def _run_open(self, engine: Any, args: Any, annotations: Any, cause: Any) -> Any:
        from socialbot.bdi.compiler.plans import compile_plan

        self.run_open = compile_plan(self, opened=True)
        return self.run_open(engine, args, annotations, cause)

    def step_at(self, error: BaseException) -> Step | None:
        """The step in whose code an exception came up."""
        found = None
        trace = error.__traceback__
        while trace is not None:
            if trace.tb_frame.f_code.co_filename.startswith(FILENAME):
                found = self.lines.get(trace.tb_lineno, found)
            trace = trace.tb_next
        return found


def record_behind(error: BaseException) -> Any:
    """The record of the plan in whose code an exception came up, if it did in one."""
    found = None
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename.startswith(FILENAME):
            found = trace.tb_frame.f_locals.get("c", found)
        trace = trace.tb_next
    return found


class Trigger:
    """The plans for one kind of event, indexed by the argument that tells them apart."""

    __slots__ = ("by", "goal", "key", "plans", "position", "rest")

    def __init__(self, key: str, plans: tuple[Ready, ...] = ()) -> None:
        self.key = key
        self.goal = key[1:2] in ("!", "?")
        self.plans = plans
        self.position: int | None = None
        self.by: dict[Any, tuple[Ready, ...]] = {}
        self.rest = plans
        if plans:
            self._index()

    def candidates(self, args: tuple[Any, ...]) -> tuple[Ready, ...]:
        """The plans that may fit the arguments (without variables), in the order in which they are tried."""
        position = self.position
        return self.plans if position is None else self.by.get(args[position], self.rest)

    def add(self, ready: Ready, *, first: bool = False) -> None:
        """Adds a plan behind those of the same priority, or before all."""
        last = self.plans[-1].plan.priority if self.plans else ready.plan.priority
        position, value = self.position, None
        if position is not None:
            value = ready.plan.event.literal.args[position]
        if first or ready.plan.priority > last or position is None or not _told_apart(value):
            plans = (ready, *self.plans) if first else (*self.plans, ready)
            self.plans = tuple(sorted(plans, key=lambda item: -item.plan.priority))
            self._index()
        else:
            self.plans += (ready,)
            self.by[value] = (*self.by.get(value, self.rest), ready)

    def _index(self) -> None:
        heads = [ready.plan.event.literal.args for ready in self.plans]
        constants = [sum(_told_apart(args[i]) for args in heads) for i in range(len(heads[0]))]
        self.position = constants.index(max(constants)) if len(heads) > FEW and any(constants) else None
        self.by, self.rest = {}, self.plans
        if self.position is None:
            return
        rest: tuple[Ready, ...] = ()
        for ready, args in zip(self.plans, heads, strict=True):
            value = args[self.position]
            if _told_apart(value):
                self.by[value] = (*self.by.get(value, rest), ready)
            else:
                rest = (*rest, ready)
                self.by = {known: (*found, ready) for known, found in self.by.items()}
        self.rest = rest


class Triggers(dict[str, Trigger]):
    """Triggers by key, such as ``+!at/2``; one without plans is made when it is asked for."""

    def __missing__(self, key: str) -> Trigger:
        trigger = self[key] = Trigger(key)
        return trigger


class Library:
    """Plans, inferences and computed beliefs of one agent, or shared by several until one of them changes it."""

    def __init__(self, *rules: Plan | Inference | list[Plan]) -> None:
        self.triggers = Triggers()
        self.inferences: dict[str, list[ReadyInference]] = {}
        self.computed: dict[str, Computed] = {}
        self.kinds: dict[str, type[Belief]] = {}
        self.goals: dict[str, type[Goal]] = {}
        self.users = 0
        self._labels: dict[str, Ready] = {}
        for rule in rules:
            self.add_rule(rule)

    def __iter__(self) -> Iterator[Plan]:
        for trigger in list(self.triggers.values()):
            for ready in trigger.plans:
                yield ready.plan

    def copy(self) -> Library:
        """A library of its own with the same contents."""
        twin = Library()
        for plan in self:
            twin.add(plan)
        for inferences in self.inferences.values():
            for ready in inferences:
                twin.add_inference(ready.inference)
        twin.computed.update(self.computed)
        twin.kinds.update(self.kinds)
        twin.goals.update(self.goals)
        return twin

    def add_rule(self, rule: Plan | Inference | list[Plan]) -> None:
        """Adds an inference, a plan, or a list of plans."""
        if isinstance(rule, Inference):
            self.add_inference(rule)
        else:
            for plan in flat([rule]):
                self.add(plan)

    def add(self, plan: Plan, *, first: bool = False) -> Ready:
        """Adds a plan. Raises RuleError when its label is taken."""
        if plan.label is not None and plan.label in self._labels:
            raise RuleError(
                f"the label {plan.label} is taken", where=str(plan.origin or plan), remedy="choose another label"
            )
        ready = Ready(plan, self)
        for kind in plan.classes():
            self.declare(kind)
        if plan.label is not None:
            self._labels[plan.label] = ready
        self.triggers[plan.event.key].add(ready, first=first)
        return ready

    def remove(self, plan: Plan) -> bool:
        """Removes a plan; False when it is not there."""
        trigger = self.triggers.get(plan.event.key)
        kept = tuple(ready for ready in trigger.plans if ready.plan is not plan) if trigger else ()
        if trigger is None or len(kept) == len(trigger.plans):
            return False
        trigger.plans = trigger.rest = kept
        trigger.by, trigger.position = {}, None
        if kept:
            trigger._index()
        self._labels = {label: ready for label, ready in self._labels.items() if ready.plan is not plan}
        return True

    def labelled(self, label: str) -> Plan | None:
        """The plan with this label."""
        ready = self._labels.get(label)
        return ready.plan if ready else None

    def add_inference(self, inference: Inference) -> None:
        """Adds a rule that beliefs follow from."""
        new = inference.head.key not in self.inferences
        self.inferences.setdefault(inference.head.key, []).append(ReadyInference(inference, self))
        if new:
            self.recompile()

    def declare(self, kind: type[Literal]) -> None:
        """Makes the nature of a class of beliefs known, as singleton, reactor, computed; or a class of goals."""
        if issubclass(kind, Goal):
            self.goals[kind.functor] = kind
        elif issubclass(kind, Belief) and kind is not Structure:
            self.kinds[kind.functor] = kind

    def derives(self, key: str) -> bool:
        """Whether beliefs of this key can follow from others or be computed."""
        return key in self.inferences or self.computes(key) is not None

    def computes(self, key: str) -> type[Computed] | None:
        """The class that computes beliefs of this key."""
        kind = self.kinds.get(key.rpartition("/")[0])
        return kind if kind is not None and issubclass(kind, Computed) else None

    def recompile(self) -> None:
        """Has every plan and rule compiled anew when it is next used."""
        for trigger in self.triggers.values():
            for ready in trigger.plans:
                ready.reset()
        for inferences in self.inferences.values():
            for ready in inferences:
                ready.reset()


def _told_apart(term: object) -> bool:
    """Whether only an equal value can match. A literal with annotations is matched by one that has more of them."""
    if isinstance(term, tuple):
        return all(map(_told_apart, term))
    if isinstance(term, Literal):
        return not term.annotations and _told_apart(term.args)
    return ground(term)


class ReadyInference:
    """A rule in a library, with its code."""

    __slots__ = ("inference", "library", "solve")

    def __init__(self, inference: Inference, library: Library) -> None:
        self.inference = inference
        self.library = library
        self.reset()

    def reset(self) -> None:
        """Forgets the code."""
        self.solve: Callable[..., Iterator[None]] = self._solve

    def _solve(self, *args: Any) -> Iterator[None]:
        from socialbot.bdi.compiler.plans import compile_inference

        self.solve = compile_inference(self)
        return self.solve(*args)
