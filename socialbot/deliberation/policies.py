"""Who may ask an agent for what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from socialbot.agent_messages import AgentRequest
from socialbot.errors import ParameterError

_DEEDS: Mapping[str, str] = {"check": "check", "add": "add", "del": "delete"}


@dataclass(frozen=True, slots=True)
class Permission:
    """Whether a request is granted, or the reason why not; and which priority a desire may have at most."""

    granted: bool
    reason: str = ""
    max_priority: float = 0.0


@dataclass(frozen=True)
class Policies:
    """The groups of agents that may check (``ck``) or write (``w``) beliefs and desires.

    ``desire_pr`` is the highest priority, 0 to 1, that each group of ``desire_w`` may give, in the same order; it is
    0 for those that it does not reach.
    """

    belief_ck: tuple[str, ...] = ()
    belief_w: tuple[str, ...] = ()
    desire_ck: tuple[str, ...] = ()
    desire_w: tuple[str, ...] = ()
    desire_pr: tuple[float, ...] = ()

    @classmethod
    def parse(
        cls,
        *,
        belief_ck: str = "",
        belief_w: str = "",
        desire_ck: str = "",
        desire_w: str = "",
        desire_pr: str = "",
        where: str = "policies",
    ) -> Policies:
        """Policies from lists separated by commas, as parameters have them.

        Raises ParameterError for a priority that is none, and for more priorities than groups.
        """
        writers = _words(desire_w)
        priorities = tuple(_priority(word, where) for word in _words(desire_pr))
        if len(priorities) > len(writers):
            raise ParameterError(
                f"desire_pr has {len(priorities)} priorities for {len(writers)} groups of desire_w",
                where=where,
                remedy="give each group of desire_w one priority, in the same order",
            )
        return cls(_words(belief_ck), _words(belief_w), _words(desire_ck), writers, priorities)

    def may(self, request: AgentRequest) -> Permission:
        """Whether the sender's group may have this done."""
        kind = "belief" if request.belief is not None else "desire"
        checks = request.operation == "check"
        if kind == "belief":
            groups = self.belief_ck if checks else self.belief_w
        else:
            groups = self.desire_ck if checks else self.desire_w
        if request.group not in groups:
            allowed = f"these may: {', '.join(groups)}" if groups else "nobody may"
            return Permission(False, f"group {request.group!r} may not {_DEEDS[request.operation]} {kind}s; {allowed}")
        if kind == "belief" or checks:
            return Permission(True)
        number = self.desire_w.index(request.group)
        return Permission(True, max_priority=self.desire_pr[number] if number < len(self.desire_pr) else 0.0)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _priority(word: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise ParameterError(f"desire_pr: {word!r} is no priority", where=where, remedy="give numbers from 0 to 1")
    return value
