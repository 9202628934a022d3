"""Sensors that are silent: what they told last may be wrong by now, and nothing new is begun."""

from __future__ import annotations

from dataclasses import dataclass

from socialbot.bdi import Engine
from socialbot.errors import PlanningError


@dataclass(slots=True)
class _Gap:
    """``since`` (ns) something is waited for; perhaps for the ``first`` time, perhaps for too long already."""

    since: int
    first: bool
    overdue: bool = False


class Silence:
    """The sensors that are silent now, in the order in which they fell silent."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._gaps: dict[str, _Gap] = {}

    def __bool__(self) -> bool:
        return bool(self._gaps)

    def expect(self, sensor: str) -> None:
        """A sensor has just been added, and has told nothing yet. Raises PlanningError for one of the same name."""
        if sensor in self._gaps:
            raise PlanningError(
                "there is another sensor of this name", where=f"sensor {sensor}", remedy="override its name"
            )
        self._gaps[sensor] = _Gap(self._engine.clock.now(), True)

    def begin(self, sensor: str) -> bool:
        """A sensor should have told something by now; False when that is known."""
        gap = self._gaps.setdefault(sensor, _Gap(self._engine.clock.now(), False))
        if gap.overdue:
            return False
        gap.overdue = True
        self._engine.record("silent", sensor, "")
        return True

    def end(self, sensor: str, cause: str) -> bool:
        """A sensor has told something; False when it was not silent. ``cause`` is the percept."""
        gap = self._gaps.pop(sensor, None)
        if gap is not None and gap.overdue:
            self._engine.record("heard", sensor, cause)
        return gap is not None

    @property
    def is_first(self) -> bool:
        """Whether there is a sensor of which nothing was ever heard."""
        return any(gap.first for gap in self._gaps.values())

    @property
    def since(self) -> int:
        """Since when (ns) it has been silent that has been longest; only while there is one."""
        return min(gap.since for gap in self._gaps.values())

    def __str__(self) -> str:
        return ", ".join(f"sensor {sensor} is silent" for sensor in self._gaps)
