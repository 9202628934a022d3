"""Scheduling and memory of the process of a node: real-time priority, niceness, processor cores, memory limit."""

from __future__ import annotations

import contextlib
import json
import os
import resource
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass

from socialbot.core.errors import ParameterError

PROCESS_VARIABLE = "SOCIALBOT_PROCESS"
"""Variable with the settings of a process as JSON."""

MIN_MEMORY_MB = 200  # what a node needs at least


@dataclass(frozen=True)
class ProcessSettings:
    """Settings that a process gives itself before it starts threads, which inherit them. None keeps the present value.

    Attributes:
        priority: Real-time priority, 1 to 99 (SCHED_FIFO): the process runs before all without one.
        nice: Niceness, -20 (first) to 19 (last).
        cpus: Numbers of the processor cores that it may use.
        memory_mb: Most private memory (MB). Beyond it, allocations fail, and the process is restarted.
    """

    priority: int | None = None
    nice: int | None = None
    cpus: tuple[int, ...] | None = None
    memory_mb: int | None = None

    def check(self, where: str) -> None:
        """Raise ParameterError for a value that no machine has."""
        for name, value, least, most in (
            ("priority", self.priority, 1, 99),
            ("nice", self.nice, -20, 19),
            ("memory_mb", self.memory_mb, MIN_MEMORY_MB, 2**40),
        ):
            if value is not None and not least <= value <= most:
                raise ParameterError(f"{name!r} must be from {least} to {most}, got {value}", where=where)
        if self.cpus is not None and (not self.cpus or min(self.cpus) < 0):
            raise ParameterError("'cpus' must name cores", where=where, remedy="write cpus: [0, 1]")

    def variables(self) -> dict[str, str]:
        """The environment of a process with these settings."""
        values = {name: value for name, value in asdict(self).items() if value is not None}
        return {PROCESS_VARIABLE: json.dumps(values)}

    def apply(self) -> None:
        """Apply the settings to this process.

        Raises:
            ParameterError: This user may not, or the machine has no such core.
        """
        if self.cpus is not None:
            with _named("cpus", f"this machine has the cores {_cores()}"):
                os.sched_setaffinity(0, self.cpus)
        if self.nice is not None:
            with _named("nice", "allow it: `@USER - nice -20` in /etc/security/limits.conf, or LimitNICE= in systemd"):
                os.setpriority(os.PRIO_PROCESS, 0, self.nice)
        if self.priority is not None:
            remedy = "allow it: `@USER - rtprio 99` in /etc/security/limits.conf, or LimitRTPRIO= in systemd"
            with _named("priority", remedy):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self.priority))
        if self.memory_mb is not None:
            with _named("memory_mb", "raise the limit of this user: ulimit -d"):
                limit = self.memory_mb * 1_000_000
                resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def apply_settings(environment: Mapping[str, str] = os.environ) -> None:
    """Apply the settings of `PROCESS_VARIABLE`, if it is set. Raises ParameterError as `ProcessSettings.apply` does."""
    text = environment.get(PROCESS_VARIABLE)
    if not text:
        return
    try:
        values = json.loads(text)
        cpus = values.pop("cpus", None)
        settings = ProcessSettings(**values, cpus=None if cpus is None else tuple(cpus))
        settings.check(PROCESS_VARIABLE)
    except (ValueError, TypeError, AttributeError) as error:
        raise ParameterError(f"not valid settings: {error}", where=PROCESS_VARIABLE) from error
    settings.apply()


@contextlib.contextmanager
def _named(setting: str, remedy: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ParameterError(f"cannot be set: {reason}", where=f"processes: {setting}", remedy=remedy) from error


def _cores() -> str:
    return ", ".join(map(str, sorted(os.sched_getaffinity(0))))
