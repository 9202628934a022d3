"""Find the nearest change of an agent's parameter with which a failed expectation passes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from socialbot.core.errors import SocialbotError
from socialbot.graph.node import check_parameters
from socialbot.runs.expectations import Expectation, Verdict, evaluate
from socialbot.runtime.trials import Trial

FACTORS = (1.1, 1.2, 1.3, 1.5, 1.75, 2.0, 3.0)
"""A parameter is changed by these factors, up and down, until the expectation passes."""

HALVINGS = 4
MOST_RUNS = 120


@dataclass(frozen=True)
class _Setting:
    """Numeric parameter of an agent with its value and limits."""

    node: str
    name: str
    value: float
    minimum: float
    maximum: float
    is_whole: bool

    def text(self, value: float) -> str:
        return f"{self.node}.{self.name}={round(value) if self.is_whole else round(value, 4):g}"

    def steps(self) -> Iterator[list[float]]:
        """Yield the values upwards and downwards, each in growing distance."""
        for up in (True, False):
            raw = [self.value * each if up else self.value / each for each in FACTORS]
            if not self.value:
                raw = [0.5, 1.0, 2.0, 5.0] if up else []
            kept = [min(max(each, self.minimum), self.maximum) for each in raw]
            kept = [float(round(each)) for each in kept] if self.is_whole else kept
            yield [each for each in dict.fromkeys(kept) if each != self.value]


def nearest_changes(
    expectations: Sequence[Expectation], trial: Trial, progress: Callable[[int], None] = lambda runs: None
) -> dict[str, str]:
    """Return for each failed expectation the change that passes and differs least, as ``NODE.PARAMETER=VALUE``.

    The difference is relative to the value. Only numeric parameters of agents are changed, one at a time.

    Args:
        expectations: Those that failed.
        trial: The trial that failed; it runs again for each value.
        progress: Called with the number of runs so far.
    """
    again = trial.changed(())
    if again is None:
        return {}
    with tempfile.TemporaryDirectory() as folder:
        search = _Search(expectations, again, Path(folder), progress)
        return search.found()


class _Search:
    def __init__(
        self, expectations: Sequence[Expectation], trial: Trial, folder: Path, progress: Callable[[int], None]
    ) -> None:
        self._expectations, self._trial, self._folder, self._progress = expectations, trial, folder, progress
        self._runs = 0
        self._best: dict[str, tuple[float, str]] = {}

    def found(self) -> dict[str, str]:
        for setting in self._settings():
            for values in setting.steps():
                self._walk(setting, values)
        return {name: f"--set {text}" for name, (_, text) in self._best.items()}

    def _settings(self) -> list[_Setting]:
        found = []
        for config in self._trial.loaded().nodes:
            if not config.type.is_agent:
                continue
            values = check_parameters(config.type, config.parameters, where=config.name)
            for name, parameter in config.type.parameters().items():
                value = values[name]
                if isinstance(value, bool) or not isinstance(value, (int, float)):
                    continue
                low = -float("inf") if parameter.minimum is None else float(parameter.minimum)
                high = float("inf") if parameter.maximum is None else float(parameter.maximum)
                found.append(_Setting(config.name, name, float(value), low, high, isinstance(value, int)))
        return found

    def _walk(self, setting: _Setting, values: Sequence[float]) -> None:
        """Try values in growing distance until each expectation passes, then look closer between the last two."""
        before = setting.value
        for value in values:
            if all(self._is_beaten(each, setting, value) for each in self._expectations):
                return
            passed = self._passed(setting, value)
            for expectation in self._expectations:
                if expectation.name in passed and not self._is_beaten(expectation, setting, value):
                    self._note(expectation, setting, self._closest(expectation, setting, before, value))
            before = value

    def _closest(self, expectation: Expectation, setting: _Setting, fails: float, passes: float) -> float:
        for _ in range(HALVINGS):
            middle = (fails + passes) / 2
            middle = float(round(middle)) if setting.is_whole else middle
            if middle in (fails, passes):
                break
            if expectation.name in self._passed(setting, middle):
                passes = middle
            else:
                fails = middle
        for digits in (1, 2):  # a short number, if it passes, too
            short = round(passes, digits)
            if abs(short - setting.value) >= abs(passes - setting.value) and (
                short == passes or expectation.name in self._passed(setting, short)
            ):
                return short
        return passes

    def _is_beaten(self, expectation: Expectation, setting: _Setting, value: float) -> bool:
        best = self._best.get(expectation.name)
        return best is not None and best[0] <= _difference(setting, value)

    def _note(self, expectation: Expectation, setting: _Setting, value: float) -> None:
        if not self._is_beaten(expectation, setting, value):
            self._best[expectation.name] = _difference(setting, value), setting.text(value)

    def _passed(self, setting: _Setting, value: float) -> set[str]:
        """Return the names of the expectations that do not fail with a value, and are put to the test."""
        if self._runs >= MOST_RUNS:
            return set()
        self._runs += 1
        self._progress(self._runs)
        trial = self._trial.changed([setting.text(value)])
        assert trial is not None
        try:
            verdicts: list[Verdict] = evaluate(self._expectations, trial.obtain(self._folder / str(self._runs)))
        except SocialbotError:  # a value that the node refuses
            return set()
        return {each.name for each in verdicts if each.outcome in ("passed", "open")}


def _difference(setting: _Setting, value: float) -> float:
    return abs(value - setting.value) / (abs(setting.value) or 1.0)
