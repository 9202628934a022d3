"""Check the expectations of a behaviour file on a run: verdicts with their instances and reasons."""

from __future__ import annotations

import importlib.util
import inspect
import itertools
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from socialbot.core.clock import SECOND
from socialbot.core.errors import PACKAGE, RuleError, SocialbotError, described, place_of, suggestion
from socialbot.core.registry import behaviours_file, behaviours_names
from socialbot.runs.expectations._observation import Observation, observe_run
from socialbot.runs.expectations.expectations import Expectation, ExpectationClause, as_expectation
from socialbot.runs.expectations.formulas import (
    Binding,
    Counted,
    Eventually,
    Negation,
    Occurrence,
    TemporalFormula,
    Until,
)

if TYPE_CHECKING:
    from socialbot.core.messages import TraceRecord
    from socialbot.runs.folder import RecordedRun

VerdictOutcome = Literal["passed", "failed", "open", "untested"]
MOST_INSTANCES = 100_000
_WORST_FIRST: tuple[VerdictOutcome, ...] = ("failed", "open", "passed", "untested")


@dataclass(frozen=True)
class Instance:
    """One case of an expectation.

    Args:
        outcome: "open" means that the run ended before it was decided.
        binding: Values of the variables.
        at: The moment (ns from the start): that of the trigger, or else of the first violation.
        record: Record that shows the moment, if there is one.
        came: When the expected event came after all (ns from the start), for one that came too late.
    """

    outcome: VerdictOutcome
    binding: Binding
    at: int
    record: TraceRecord | None = None
    came: int | None = None

    @property
    def at_s(self) -> float:
        return round(self.at / SECOND, 6)

    @property
    def text(self) -> str:
        """The values of the variables, such as ``person t2``."""
        return ", ".join(f"{name} {value}" for name, value in sorted(self.binding.items()))


@dataclass(frozen=True)
class Verdict:
    """Result of one expectation on one run.

    Args:
        name: Name of the expectation.
        outcome: "failed" if an instance failed; else "open" if one is undecided; "untested" without any instance.
        instances: All instances, in order of time.
        expectation: The expectation.
    """

    name: str
    outcome: VerdictOutcome
    instances: Sequence[Instance]
    expectation: Expectation

    @property
    def passed(self) -> bool:
        """Whether no instance failed."""
        return self.outcome != "failed"

    @property
    def failures(self) -> list[Instance]:
        return [each for each in self.instances if each.outcome == "failed"]

    @property
    def instance(self) -> str:
        """The variables of the first failed instance, such as ``person t2``; empty without variables or failures."""
        return self.failures[0].text if self.failures else ""

    @property
    def time(self) -> float | None:
        """The moment (s from the start) of the first failed instance; None if none failed."""
        return self.failures[0].at_s if self.failures else None


_REMEDY = "give a Python file with expectations, such as greets = expect(said('greeting')).in_total()"


def behaviours_path(behaviours: Path | str) -> Path:
    """Return the path of a behaviour file, or of that of an agent package. Raises RuleError if there is none."""
    path = Path(behaviours_file(str(behaviours)) or behaviours)
    if not path.is_file():
        known = ", ".join(behaviours_names())
        raise RuleError("there is no such file", where=str(path), remedy=f"{_REMEDY}, or one of {known}")
    return path


def load_behaviours(path: Path | str) -> list[Expectation]:
    """Return the expectations at the top level of a Python file, in order, named by their variables.

    Args:
        path: The file, or the name of an agent package that has one.

    Raises:
        RuleError: The file cannot be read or run, or has no expectation.
    """
    path = behaviours_path(path)
    spec = importlib.util.spec_from_file_location(f"behaviours_{path.stem}_{next(_NUMBERS)}", path)
    if spec is None or spec.loader is None:
        raise RuleError("this is no Python file", where=str(path), remedy=_REMEDY)
    module = importlib.util.module_from_spec(spec)
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    except RuleError as error:
        place = place_of(error, PACKAGE) or path.name
        where = f"{path.parent / place}: {error.where}" if error.where else str(path.parent / place)
        raise RuleError(error.what, where=where, remedy=error.remedy) from error
    except SocialbotError:
        raise
    except Exception as error:
        what = f"cannot be run: {described(error, str(Path(__file__).parent))}"
        raise RuleError(what, where=str(path), remedy=_remedy(error)) from error
    finally:
        sys.path.remove(folder)
    found = []
    for name, value in vars(module).items():
        try:
            found.append(None if name.startswith("_") else as_expectation(value, name))
        except RuleError as error:
            raise RuleError(error.what, where=f"{path}: {name}", remedy=error.remedy) from error
    found = [each for each in found if each is not None]
    if not found:
        raise RuleError("there is no expectation", where=str(path), remedy=_REMEDY)
    return found


_NUMBERS = itertools.count()
_NO_ARGUMENT = re.compile(r"([\w.]+)\(\) got an unexpected keyword argument '(\w+)'")


def _remedy(error: Exception) -> str:
    """Return how to mend a file that cannot be run: the closest name of those that are known."""
    from socialbot.runs import expectations

    if isinstance(error, NameError) and error.name:
        if error.name in expectations.__all__:
            return f"import it: from socialbot.testing import {error.name}"
        close = suggestion(error.name, expectations.__all__).partition(" known: ")[0]
        return f"define it, or import it from another module{f'; {close}' if close.startswith('did') else ''}"
    if isinstance(error, AttributeError) and error.name and error.obj is not None:
        return suggestion(error.name, [name for name in dir(error.obj) if not name.startswith("_")])
    if isinstance(error, ImportError) and error.name in sys.modules:
        wanted = str(error).partition("name '")[2].partition("'")[0]
        module = sys.modules[error.name]
        known = getattr(module, "__all__", None) or [name for name in dir(module) if not name.startswith("_")]
        return f"a belief, goal or action can also be a text: 'greeted(Who)'; {suggestion(wanted, known)}"
    found = _NO_ARGUMENT.search(str(error)) if isinstance(error, TypeError) else None
    function = None if found is None else _function(found[1])
    if found is not None and function is not None:
        return suggestion(found[2], [name for name in inspect.signature(function).parameters if name != "self"])
    return "correct the Python code" if isinstance(error, (SyntaxError, TypeError)) else _REMEDY


def _function(name: str) -> Callable[..., object] | None:
    """Return the function or method of expectations with a qualified name; None for another one."""
    from socialbot.runs.expectations import atoms, expectations

    for module in (atoms, expectations):
        owner, _, method = name.rpartition(".")
        found = getattr(getattr(module, owner, None), method, None) if owner else getattr(module, name, None)
        if callable(found):
            return found
    return None


def evaluate(
    behaviours: Path | str | Iterable[Expectation | ExpectationClause], run: Path | str | RecordedRun
) -> list[Verdict]:
    """Check expectations on a recorded run.

    Args:
        behaviours: A behaviour file, or expectations.
        run: Folder of a run, or an open run.

    Raises:
        RuleError: The file or an expectation cannot be used.
        RunError: The folder holds no run.
    """
    from socialbot.runs.folder import open_run

    expectations = load_behaviours(behaviours) if isinstance(behaviours, (str, Path)) else _completed(behaviours)
    opened = open_run(Path(run)) if isinstance(run, (str, Path)) else run
    observation = observe_run(opened, [each.formula for each in expectations])
    return [judge(each, observation) for each in expectations]


def _completed(behaviours: Iterable[object]) -> list[Expectation]:
    """Return expectations as a behaviour file has them: ``never(said("a"))`` needs no end. Raises RuleError."""
    found = []
    for number, each in enumerate(behaviours, 1):
        expectation = as_expectation(each, "")
        if expectation is None:
            raise RuleError(f"{each!r} is no expectation", where=f"expectation {number}", remedy=_REMEDY)
        found.append(expectation)
    return found


def judge(expectation: Expectation, trace: Observation) -> Verdict:
    """Check an expectation on the observed part of a run."""
    found = [each for binding in _bindings(expectation, trace) for each in _instances(expectation, trace, binding)]
    found.sort(key=lambda each: (each.at, each.text))
    outcomes: set[VerdictOutcome] = {"untested", *(each.outcome for each in found)}
    outcome = min(outcomes, key=_WORST_FIRST.index)
    return Verdict(str(expectation), outcome, tuple(found), expectation)


def _bindings(expectation: Expectation, trace: Observation) -> Iterator[Binding]:
    values = trace.values(expectation.formula.atoms())
    unbound = expectation.variables - values.keys()
    if unbound:
        name = min(unbound)
        remedy = f"use {name} in an atom that finds its values, such as person(...) or believed(...)"
        raise RuleError(f"the variable {name} has no values", where=str(expectation), remedy=remedy)
    if math.prod(len(each) for each in values.values()) > MOST_INSTANCES:
        what = f"the variables {', '.join(sorted(values))} have more than {MOST_INSTANCES} combinations of values"
        raise RuleError(what, where=str(expectation), remedy="use fewer variables, or _ for any value")
    names = sorted(values)
    for chosen in itertools.product(*(sorted(values[name]) for name in names)):
        yield dict(zip(names, chosen, strict=True))


def _instances(expectation: Expectation, trace: Observation, binding: Binding) -> Iterator[Instance]:
    must, may = expectation.holds.truth(trace, binding)
    trigger = expectation.trigger
    if expectation.when == "each" and trigger is not None:
        for at in dict.fromkeys(trigger.onsets(trace, binding)):
            if at > trace.end:
                continue
            outcome: VerdictOutcome = "passed" if at in must else "open" if at in may else "failed"
            failed = _failed_response(expectation, trigger, trace, binding, at) if outcome == "failed" else None
            yield failed or Instance(outcome, binding, at)
    elif expectation.when == "throughout":
        at_all = None if trigger is None else trigger.truth(trace, binding)
        wrong = may.complement(trace.last) if at_all is None else at_all.must.without(may, trace.last)
        unsure = must.complement(trace.last) if at_all is None else at_all.may.without(must, trace.last)
        wrong, unsure = wrong.clipped(0, trace.end), unsure.clipped(0, trace.end)
        for begin in wrong.starts():
            yield Instance("failed", binding, begin, _shown(expectation.subject, trace, binding, begin))
        if not wrong:
            for begin in unsure.starts()[:1]:
                yield Instance("open", binding, begin)
            if not unsure and (trigger is None or trigger.onsets(trace, binding)):
                yield Instance("passed", binding, 0)
    elif 0 in must or 0 in may:
        yield Instance("passed" if 0 in must else "open", binding, 0)
    else:
        at = _violation(expectation, trace, binding)
        yield Instance("failed", binding, at, _shown(expectation.subject, trace, binding, at))


def _failed_response(
    expectation: Expectation, trigger: TemporalFormula, trace: Observation, binding: Binding, at: int
) -> Instance:
    """Return the failed instance of a trigger; a forbidden event is its moment, not the trigger."""
    shown, came, subject = _shown(trigger, trace, binding, at), None, expectation.subject
    onsets = [each for each in subject.onsets(trace, binding) if at <= each <= trace.end] if subject is not None else []
    if isinstance(expectation.holds, Eventually):
        came = min(onsets, default=None)
    elif isinstance(expectation.holds, Negation) and (later := [each for each in onsets if each > at]):
        return Instance("failed", binding, later[0], _shown(subject, trace, binding, later[0]) or shown)
    return Instance("failed", binding, at, shown, came)


def _violation(expectation: Expectation, trace: Observation, binding: Binding) -> int:
    """Return the moment at which an expectation about the whole run is first violated, as far as one is to blame."""
    holds, subject = expectation.holds, expectation.subject
    onsets = [each for each in subject.onsets(trace, binding) if each <= trace.end] if subject is not None else []
    if isinstance(holds, Counted):
        too_many = holds.high is not None and len(onsets) > holds.high
        return onsets[holds.high or 0] if too_many else trace.end
    if isinstance(holds, Until):
        left = holds.left.truth(trace, binding).may.complement(trace.last).clipped(0, trace.end)
        return next(iter(left.starts()), trace.end)
    if isinstance(holds, Eventually):
        return trace.end
    return onsets[0] if onsets else 0


def _shown(formula: TemporalFormula | None, trace: Observation, binding: Binding, at: int) -> TraceRecord | None:
    """Return the record of an atom of ``formula`` that shows a moment: that of the latest occurrence."""
    found: list[Occurrence] = []
    for atom in formula.atoms() if formula is not None else ():
        occurred = trace.occurrences(atom, binding)
        found += [each for each in occurred if each.record is not None and each.begin <= at <= each.end]
    return max(found, key=lambda each: each.begin).record if found else None
