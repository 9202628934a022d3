"""Environment of a society: one class with the percepts and the actions of the world."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi.engine import Engine, MindChange
from socialbot.bdi.literals import PERCEPT, Literal, distinct, literal_from_key
from socialbot.bdi.stdlib.actions import import_module
from socialbot.bdi.stdlib.registry import opened
from socialbot.bdi.unification import Trail, undo, unify
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.society import Society

EVERYONE = ""
"""Key of the percepts of all agents."""


class Environment:
    """World of the agents of a society: subclass it, and write each action as a method.

    A public method ``move(self, agent, x)`` of the subclass is the action ``move(X)`` of all agents; ``agent`` is the
    `Engine` that acts. Results and failures are those of `asl_action`: arguments that the method does not take are
    bound to its result, and False or an exception fails the action. All other actions call `execute`, if overridden.

    Percepts are beliefs with ``source(percept)``, of all agents or of one. They may change from any thread, and before
    the agents exist.

    Attributes:
        society: The society; None before `attach`.
        lingers: Whether `socialbot asl run` continues while all agents are idle, because percepts may come from other
            threads; set it in a subclass.
    """

    lingers: ClassVar[bool] = False
    society: Society | None
    _percepts: dict[str, dict[Literal, None]]
    _lock: threading.RLock

    def __new__(cls, *args: Any, **named: Any) -> Any:
        made = super().__new__(cls)
        made.society = None
        made._percepts = {}
        made._lock = threading.RLock()
        return made

    # For subclasses to override

    def start(self) -> None:
        """Prepare the world; called once, at the begin of `attach`."""

    def stop(self) -> None:
        """End the world; called after the agents have stopped."""

    def execute(self, agent: Engine, action: Literal) -> Any:
        """Execute an action that is no method of this class; the result False reports a failure."""
        raise NotImplementedError

    # Percepts

    def percepts(self, agent: Engine | str | None = None) -> tuple[Literal, ...]:
        """Percepts of one agent, or those of all agents; without those of one."""
        return tuple(self._percepts.get(_name(agent), ()))

    def add_percept(self, percept: Literal | str, agent: Engine | str | None = None) -> None:
        """Add a percept; an existing one changes nothing.

        Args:
            percept: Belief without variables, or its AgentSpeak text.
            agent: The agent that perceives it, or its name; by default all agents do.

        Raises:
            RuleError: The percept has a variable.
            AgentSpeakError: The text is not a belief.
        """
        belief = _belief(percept)
        belief.check()
        with self._lock:
            held = self._percepts.setdefault(_name(agent), {})
            if belief in held:
                return
            held[belief] = None
            for each in self._perceiving(agent):
                _believe(each, belief)

    def remove_percept(self, percept: Literal | str, agent: Engine | str | None = None) -> int:
        """Remove the matching percepts of one agent, or of those of all agents; variables match anything.

        Returns:
            The number of removed percepts.
        """
        pattern = _belief(percept)
        with self._lock:
            found = [held for held in self.percepts(agent) if _matches(pattern, held)]
            self._remove(found, agent)
        return len(found)

    def clear_percepts(self, agent: Engine | str | None = None) -> None:
        """Remove all percepts of one agent, or those of all agents."""
        with self._lock:
            self._remove(list(self.percepts(agent)), agent)

    def set_percepts(self, percepts: list[Literal | str], agent: Engine | str | None = None) -> None:
        """Replace all percepts of one agent, or those of all agents; common ones cause no events."""
        beliefs = [_belief(percept) for percept in percepts]
        with self._lock:
            self._remove([held for held in self.percepts(agent) if held not in beliefs], agent)
            for belief in beliefs:
                self.add_percept(belief, agent)

    def _remove(self, found: list[Literal], agent: Engine | str | None) -> None:
        for belief in found:
            del self._percepts[_name(agent)][belief]
            for each in self._perceiving(agent):
                both = (EVERYONE, each.name)
                if not any(belief in self._percepts.get(name, ()) for name in both):
                    each.interpreter.post(MindChange(_forget, each, belief))

    def _perceiving(self, agent: Engine | str | None) -> list[Engine]:
        agents = {} if self.society is None else dict(self.society.agents)
        name = _name(agent)
        return list(agents.values()) if name == EVERYONE else [agents[name]] if name in agents else []

    # For the society

    def attach(self, society: Society) -> None:
        """Become the environment of a society, whose agents get the percepts."""
        self.start()
        self.society = society
        society.environment = self
        for agent in list(society.agents.values()):
            self.joined(agent)

    def joined(self, agent: Engine) -> None:
        """Send the percepts to a new agent."""
        with self._lock:
            for belief in {**self._percepts.get(EVERYONE, {}), **self._percepts.get(agent.name, {})}:
                _believe(agent, belief)

    def action(self, name: str) -> Callable[..., Any] | None:
        """Function of an action: a public method of the subclass, or else `execute`, if overridden."""
        if name[0] != "_" and not hasattr(Environment, name):
            method = getattr(self, name, None)
            if callable(method):
                return method
        if type(self).execute is Environment.execute:
            return None
        return functools.partial(self._execute, name)

    def _execute(self, name: str, agent: Engine, *args: Any) -> Any:
        return self.execute(agent, literal_from_key(f"{name}/{len(args)}", args))


def load_environment(reference: str, args: tuple[Any, ...] = (), folder: Path | None = None) -> Environment:
    """Create an environment from its class.

    Args:
        reference: The class as ``module:Class``; the module may be the path of a Python file.
        args: The arguments of the class.
        folder: A folder with modules, searched first; by default the current one.

    Raises:
        RuleError: The class cannot be imported, is no `Environment`, or raises an exception.
    """
    module, colon, name = reference.partition(":")
    if not colon or not module or not name:
        raise RuleError(f"{reference!r} is not a class", remedy="write module:Class, such as house:House")
    found = getattr(import_module(module, folder), name, None)
    if not isinstance(found, type) or not issubclass(found, Environment):
        raise RuleError(
            f"{reference} is not a subclass of socialbot.bdi.Environment", remedy="derive it from this class"
        )
    try:
        return found(*args)
    except Exception as problem:
        raise RuleError(
            f"the environment {reference} cannot be created: {type(problem).__name__}: {problem}",
            remedy="check its arguments",
        ) from problem


def _name(agent: Engine | str | None) -> str:
    return EVERYONE if agent is None else agent.name if isinstance(agent, Engine) else str(agent)


def _belief(percept: Literal | str) -> Literal:
    if not isinstance(percept, str):
        return percept
    from socialbot.bdi.agentspeak.parser import parse_literal  # the parser is large

    return parse_literal(percept, "<percept>")


def _matches(pattern: Literal, belief: Literal) -> bool:
    trail: Trail = []
    fits = pattern.key == belief.key and unify(opened(pattern.args), belief.args, trail)
    undo(trail, 0)
    return fits


def _believe(agent: Engine, belief: Literal) -> None:
    relation, args, *_ = agent.interpreter.admit(belief)
    agent.interpreter.post((relation, args, distinct(belief.annotations + PERCEPT), "", None))


def _forget(agent: Engine, belief: Literal) -> None:
    agent.beliefs.remove(agent.beliefs.relation(belief.key), belief.args, PERCEPT, "", here=False)
