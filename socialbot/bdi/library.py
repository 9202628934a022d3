"""Plan library: plans by triggering event, inferences and computed beliefs by their conclusions."""

from __future__ import annotations

import functools
import itertools
import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any

from socialbot.bdi._inner_plans import SCOPE, flattened, is_nested
from socialbot.bdi.intentions import GENERATED_FILE
from socialbot.bdi.literals import (
    META,
    SELF,
    Belief,
    Computed,
    Goal,
    Literal,
    Reactor,
    SingletonBelief,
    Structure,
    ground,
)
from socialbot.bdi.plans import (
    Inference,
    Origin,
    Plan,
    beliefs_by_name,
    contents_of,
    flat,
    open_changes,
    unbound_result,
)
from socialbot.bdi.stdlib import looks_at_goals
from socialbot.bdi.steps import Step
from socialbot.bdi.terms import Variable
from socialbot.core.errors import RuleError

Run = Callable[[Any, tuple[Any, ...], tuple[Any, ...], Any], Any]
"""Tries a plan for the arguments and annotations of an event, and its record; None if it does not apply."""

_GIVEN = "p__"
"""Begin of the names of plans without a label, as in Jason."""

BODY = "{body}"
"""Name of the goal whose plan is a value."""

FEW = 1
"""Maximum number of plans that are tried in sequence; more plans are indexed."""


class CompiledPlan:
    """Plan of a library with its code, generated at the first use.

    ``run`` tries the plan for an event, ``run_open`` for a goal with variables, ``modes`` for a goal in which some
    arguments are unbound variables and the others values; ``probe`` counts the conditions that hold. ``lines`` are the
    steps by line of the code, ``texts`` the texts and places of those that failed before.
    """

    __slots__ = ("_shown", "library", "lines", "modes", "plan", "probe", "run", "run_open", "texts")

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
        self.modes: dict[int, Run] = {}
        self.lines: dict[int, Step] = {}
        self.texts: dict[Step, tuple[str, Origin | None]] = {}

    def in_mode(self, mode: int) -> Run:
        """Function for a goal whose arguments are values, except for the unbound variables of a mode."""
        from socialbot.bdi.compiler._plans import compile_plan

        if not isinstance(self.run_open, functools.partial):
            return self.run_open
        self.modes[mode] = run = compile_plan(self, mode=mode)
        return run

    def compile(self, *names: str) -> None:
        """Compile some of the functions ``run``, ``run_open`` and ``probe``, if not done yet; by default ``run``."""
        # Imported here, because the compiler is large.
        from socialbot.bdi.compiler._plans import ANY_MODE, compile_plan, compile_probe

        for name in names or ("run",):
            if isinstance(getattr(self, name), functools.partial):
                mode = ANY_MODE if name == "run_open" else 0
                setattr(self, name, compile_probe(self) if name == "probe" else compile_plan(self, mode=mode))

    def _compile_and_run(self, name: str, *args: Any) -> Any:
        self.compile(name)
        return getattr(self, name)(*args)

    def step_at(self, error: BaseException) -> Step | None:
        """Step whose code raised an exception."""
        found, lines, entry = None, self.lines, error.__traceback__
        while entry is not None:
            if entry.tb_frame.f_code.co_filename.startswith(GENERATED_FILE):
                found = lines.get(entry.tb_lineno, found)
            entry = entry.tb_next
        return found


def record_behind(error: BaseException) -> Any:
    """Trace record of the plan whose code raised an exception, if any."""
    return locals_at(error).get("c")


def locals_at(error: BaseException) -> dict[str, Any]:
    """Local variables of the plan whose code raised an exception."""
    found: dict[str, Any] = {}
    entry = error.__traceback__
    while entry is not None:
        if entry.tb_frame.f_code.co_filename.startswith(GENERATED_FILE):
            found |= entry.tb_frame.f_locals
        entry = entry.tb_next
    return found


class Trigger:
    """Plans for one kind of event, indexed by the most selective argument.

    ``failure`` is the trigger of the failure plans of a goal, once it was needed; ``annotated`` tells whether a plan
    requires annotations of its event.
    """

    __slots__ = ("annotated", "by", "failure", "goal", "key", "plans", "position", "rest")

    def __init__(self, key: str, plans: tuple[CompiledPlan, ...] = ()) -> None:
        self.key = key
        self.failure: Trigger | None = None
        self.goal = key[:2] in ("+!", "-!", "+?", "-?")
        self.plans = self.rest = plans
        self.annotated = False
        self.position: int | None = None
        self.by: dict[Any, tuple[CompiledPlan, ...]] = {}
        if plans:
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
            self.annotated = self.annotated or bool(compiled.plan.event.literal.annotations)
            self.by[value] = (*self.by.get(value, self.rest), compiled)

    def index(self) -> None:
        heads = [compiled.plan.event.literal.args for compiled in self.plans]
        self.annotated = any(compiled.plan.event.literal.annotations for compiled in self.plans)
        constants = [sum(map(_is_constant, column)) for column in zip(*heads, strict=True)]
        indexed = len(heads) > FEW and any(constants) and self.key[:1] != "^"  # meta-events may have variables
        self.position = constants.index(max(constants)) if indexed else None
        self.by = {}
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
    """Triggers by key, such as ``+!at/2``; a missing trigger is created, with the plans for any trigger."""

    def __init__(self, library: Library) -> None:
        super().__init__()
        self._library = library

    def __missing__(self, key: str) -> Trigger:
        key = sys.intern(key)
        trigger = self[key] = Trigger(key)
        for plan in self._library.general:
            self._library.specialise(plan, trigger)
        return trigger


class Library:
    """Plans, inferences and computed beliefs of one agent; agents share a library until one changes it."""

    def __init__(self, *rules: Plan | Inference | list[Plan]) -> None:
        self.triggers = Triggers(self)
        self.general: dict[Plan, list[Plan]] = {}
        self.inferences: dict[str, list[CompiledInference]] = {}
        self.computed: dict[str, Computed] = {}
        self.kinds: dict[str, type[Belief]] = {}
        self.goals: dict[str, type[Goal]] = {}
        self.requested: set[tuple[str, int]] = set()  # goals of compiled plans, with their modes
        self.namespaces: dict[str, dict[Any, Any]] = {}  # properties of namespaces, by name
        self.users = 0
        self._labels: dict[str, CompiledPlan] = {}
        self._numbers: dict[Plan, int] = {}
        self._last_number = 0
        self._scopes = itertools.count(1)
        self._open: set[str] = set()
        self._patterns: dict[str, list[Belief]] | None = None
        self.keeps_goals = False  # a last goal does not replace that of its plan, because plans look for goals
        self.watches_goals = False  # plans handle meta-events
        for rule in rules:
            self.add_rule(rule)

    def __iter__(self) -> Iterator[Plan]:
        special = {id(plan) for plans in self.general.values() for plan in plans}
        for trigger in list(self.triggers.values()):
            for compiled in trigger.plans:
                if id(compiled.plan) not in special:
                    yield compiled.plan
        yield from self.general

    def copy(self) -> Library:
        twin = Library()
        for trigger in self.triggers.values():
            copied = twin.triggers[trigger.key]
            copied.plans = tuple(CompiledPlan(compiled.plan, twin) for compiled in trigger.plans)
            copied.index()
        twin.general = {plan: list(special) for plan, special in self.general.items()}
        twin._labels = {label: CompiledPlan(compiled.plan, twin) for label, compiled in self._labels.items()}
        for inferences in self.inferences.values():
            for compiled in inferences:
                twin.add_inference(compiled.inference)
        twin.computed.update(self.computed)
        twin.kinds.update(self.kinds)
        twin.goals.update(self.goals)
        twin.namespaces = {name: dict(properties) for name, properties in self.namespaces.items()}
        twin._numbers, twin._last_number = dict(self._numbers), self._last_number
        twin.keeps_goals, twin.watches_goals = self.keeps_goals, self.watches_goals
        return twin

    def add_rule(self, rule: Plan | Inference | list[Plan]) -> None:
        if isinstance(rule, Inference):
            self.add_inference(rule)
        else:
            for plan in flat([rule]):
                self.add(plan)

    def add(self, plan: Plan, *, first: bool = False) -> CompiledPlan:
        """Add a plan. Raises RuleError for a duplicate label."""
        if is_nested(plan):
            return self._add_nested(plan, first=first)
        if plan.label is not None and plan.label in self._labels:
            raise RuleError(f"the label {plan.label} is already used", where=plan.place, remedy="choose another label")
        self._patterns = None
        compiled = CompiledPlan(plan, self)
        watches = plan.event.change in META
        contents = contents_of(plan)
        if (watches and not self.watches_goals) or (not self.keeps_goals and looks_at_goals(contents.internal)):
            self.keeps_goals = True
            self.watches_goals = self.watches_goals or watches
            self.recompile()
        for kind in contents.kinds:
            self.declare(kind)
        self._expect_keys((*contents.rules, *(change.key for change in open_changes(plan))))
        if plan.label is not None:
            self._labels[plan.label] = compiled
        else:
            self._last_number += 1
            self._numbers[plan] = self._last_number
        if isinstance(plan.event.literal, Literal):
            self.triggers[plan.event.key].add(compiled, first=first)
            return compiled
        self.general[plan] = []
        for trigger in list(self.triggers.values()):
            self.specialise(plan, trigger, first=first)
        return compiled

    def _add_nested(self, plan: Plan, *, first: bool) -> CompiledPlan:
        """Add a plan with its inner plans, which are tried before all others for their events."""
        outer, *inner = flattened(plan, (f"{SCOPE}{next(self._scopes)}" for _ in itertools.count()))
        compiled = self.add(outer, first=first)
        for each in inner:
            self.add(each, first=True)
        self.general[plan] = [outer, *inner]
        if outer in self._numbers:
            self._numbers[plan] = self._numbers[outer]
        return compiled

    def written(self, plan: Plan) -> Plan:
        """Return a plan as it was written: with its inner plans and its goal condition, if it has some."""
        return next((whole for whole, parts in self.general.items() if is_nested(whole) and plan in parts), plan)

    def specialise(self, plan: Plan, trigger: Trigger, *, first: bool = False) -> None:
        """Add a plan whose trigger is a variable to a trigger of its kind."""
        if is_nested(plan):
            return
        sign = plan.event.change.value
        name = trigger.key.removeprefix(sign)
        if name == trigger.key or name[:1] in "!?" or BODY in name:
            return
        from socialbot.bdi.compiler._dynamic import specialised

        found = specialised(plan, trigger.key)
        if found is None:
            return
        self.general[plan].append(found)
        trigger.add(CompiledPlan(found, self), first=first)

    def remove(self, plan: Plan) -> bool:
        """Remove a plan; return whether it existed."""
        plan = self.written(plan)
        if plan in self.general:
            for special in self.general.pop(plan):
                self.remove(special)
        else:
            trigger = self.triggers.get(plan.event.key)
            kept = tuple(compiled for compiled in trigger.plans if compiled.plan is not plan) if trigger else ()
            if trigger is None or len(kept) == len(trigger.plans):
                return False
            trigger.plans = kept
            trigger.index()
        self._labels = {label: compiled for label, compiled in self._labels.items() if compiled.plan is not plan}
        self._numbers.pop(plan, None)
        return True

    def labelled(self, label: str) -> Plan | None:
        compiled = self._labels.get(label)
        if compiled is not None or not label.startswith(_GIVEN):
            return compiled.plan if compiled else None
        return next((plan for plan, number in self._numbers.items() if label == f"{_GIVEN}{number}"), None)

    def given_label(self, plan: Plan) -> str:
        """Name of a plan without a label, by its place in the program."""
        general = next((each for each, special in self.general.items() if plan in special), plan)
        return general.label or f"{_GIVEN}{self._numbers.get(general, 0)}"

    def replace(self, compiled: CompiledPlan, plan: Plan) -> None:
        """Replace a plan by a copy with other annotations."""
        number = self._numbers.pop(compiled.plan, None)
        if number is not None:
            self._numbers[plan] = number
        compiled.plan = plan

    def _expect_keys(self, keys: Iterable[str]) -> None:
        """Compile queries of these beliefs so that rules for them may be added while they run."""
        new = [key for key in keys if key not in self.inferences]
        if new:
            self.inferences.update({key: [] for key in new})
            self.recompile()

    def add_inference(self, inference: Inference, *, first: bool = False) -> None:
        contents = contents_of(inference)
        for kind in contents.kinds:
            self.declare(kind)
        if not self.keeps_goals and looks_at_goals(contents.internal):
            self.keeps_goals = True
            self.recompile()
        self._patterns = None
        new = inference.head.key not in self.inferences
        rules = self.inferences.setdefault(inference.head.key, [])
        rules.insert(0 if first else len(rules), CompiledInference(inference, self))
        if self._find_open() or new:
            self.recompile()

    def remove_inference(self, inference: Inference) -> bool:
        """Remove an equal inference; return whether it existed."""
        rules = self.inferences.get(inference.head.key, [])
        wanted = _canonical(inference)
        found = next((rule for rule in rules if _canonical(rule.inference) == wanted), None)
        if found is None:
            return False
        rules.remove(found)
        return True

    def _find_open(self) -> bool:
        """Find the beliefs that may follow with unbound variables; return whether there are new ones."""
        before = len(self._open)
        while True:
            known = len(self._open)
            for key, rules in self.inferences.items():
                if key not in self._open and any(unbound_result(rule.inference, self._open) for rule in rules):
                    self._open.add(key)
            if len(self._open) == known:
                return known > before

    def is_open(self, key: str) -> bool:
        """Whether beliefs of this key may follow with unbound variables."""
        return key in self._open

    def declare(self, kind: type[Literal]) -> None:
        if issubclass(kind, Goal):
            self.goals[kind.functor] = kind
        elif issubclass(kind, Belief) and kind is not Structure:
            known = self.kinds.get(kind.functor)
            if known is not None and known is not kind and _nature(known) is not _nature(kind):
                raise RuleError(
                    f"{kind.functor} is a {_nature(known).__name__} and a {_nature(kind).__name__}",
                    where=f"{known.__module__} and {kind.__module__}",
                    remedy="give each class of beliefs a name of its own",
                )
            self.kinds[kind.functor] = kind

    def patterns(self, functor: str) -> list[Belief]:
        """Beliefs of a name in the plans and inferences."""
        if self._patterns is None:
            inferences = itertools.chain(*list(self.inferences.values()))
            self._patterns = beliefs_by_name((*self, *(compiled.inference for compiled in inferences)))
        return self._patterns.get(functor, [])

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
                compiled.compile("run", "probe")
        while self.requested:
            key, mode = self.requested.pop()
            for compiled in self.triggers[key].plans:
                if mode not in compiled.modes:
                    compiled.in_mode(mode)
        for trigger in list(self.triggers.values()):
            for compiled in trigger.plans:
                if trigger.goal and compiled.plan.event.literal.args:
                    compiled.compile("run_open")
        for inferences in self.inferences.values():
            for rule in inferences:
                rule.compile()
        self.patterns("")  # collected now, not at the first belief

    def recompile(self) -> None:
        """Discard the code of every plan and inference."""
        plans = (compiled for trigger in self.triggers.values() for compiled in trigger.plans)
        for compiled in itertools.chain(plans, *self.inferences.values()):
            compiled.reset()


def _canonical(rule: Inference) -> str:
    """Text of a rule that does not depend on the names of its variables."""
    from socialbot.bdi.compiler._dynamic import substituted, variables_of

    names = {name: Variable(f"V{number}") for number, name in enumerate(variables_of(rule))}
    plain = substituted(rule, names)
    return f"{plain.head!s} << {plain.condition!s}"


def _nature(kind: type[Belief]) -> type[Belief]:
    """Base class that says how beliefs of a class are held."""
    return next(base for base in (Reactor, Computed, SingletonBelief, Belief) if issubclass(kind, base))


def _is_constant(term: object) -> bool:
    if isinstance(term, tuple):
        return all(map(_is_constant, term))
    if isinstance(term, Literal):
        return not term.annotations and _is_constant(term.args)
    return ground(term)


class CompiledInference:
    """Inference of a library with its code."""

    __slots__ = ("_beliefs", "annotations", "inference", "library", "solve")

    def __init__(self, inference: Inference, library: Library) -> None:
        self.inference = inference
        notes = inference.head.annotations
        if not ground(notes):
            raise RuleError(
                f"an annotation of {inference.head} has a variable",
                where=str(inference.origin or inference),
                remedy="make it an argument of the rule",
            )
        sourced = any(isinstance(note, Literal) and note.functor == "source" for note in notes)
        self.annotations = notes if sourced else notes + SELF
        self.library = library
        self._beliefs: tuple[str, ...] | None = ()
        self.reset()

    @property
    def beliefs(self) -> tuple[str, ...] | None:
        """Keys of the beliefs in the condition; None if it depends on other things, such as the time."""
        if self._beliefs == ():
            from socialbot.bdi.compiler._conditions import beliefs_in

            named = beliefs_in(self.inference.condition)
            self._beliefs = None if named is None else tuple(literal.key for literal in named)
        return self._beliefs

    def reset(self) -> None:
        self.solve: Callable[..., Generator[None, None, None]] = self._solve

    def compile(self) -> None:
        from socialbot.bdi.compiler._plans import compile_inference

        if self.solve == self._solve:
            self.solve = compile_inference(self)

    def _solve(self, *args: Any) -> Generator[None, None, None]:
        self.compile()
        return self.solve(*args)
