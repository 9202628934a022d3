"""Societies: communicating agents in one process.

The thread that runs the society executes all agents with pending work; any thread may post items to them.
"""

from __future__ import annotations

import functools
import heapq
import itertools
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from socialbot.bdi._messaging import deliver
from socialbot.bdi.engine import Engine
from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import literal_from_key, source
from socialbot.bdi.terms import Atom
from socialbot.core.clock import SECOND, Clock
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi._timers import Wakeup

TURNS = 4
"""Number of turns of an agent before the next agent runs."""

VISITS = 16
"""Number of agent visits between checks for `Society.stop`."""

LISTENING = "+message/3"
"""Trigger of message events; agents without plans for it receive beliefs on a faster path."""


class Society:
    """Agents by name. Any thread may call ``wake``, after an item was posted to an agent."""

    def __init__(self, clock: Clock, *, wake: Callable[[], object] | None = None) -> None:
        self.clock = clock
        self.wake = wake
        self.agents: dict[str, Engine] = {}
        self._ready: deque[Engine] = deque()
        self._timers: list[tuple[int, int, Engine]] = []
        self._due: dict[Engine, int] = {}
        self._sequence = itertools.count()
        self._sources: dict[str, tuple[object, ...]] = {}
        self._bell: Wakeup | None = None
        self.stopping = False

    def add(self, agent: Engine | str) -> Engine:
        """Add an agent, or create one by name. Raises RuleError for a duplicate name."""
        if isinstance(agent, str):
            agent = Engine(agent, self.clock)
        if agent.name in self.agents:
            raise RuleError(f"there are two agents {agent.name}", remedy="give each agent a name of its own")
        if agent.messaging.society is not None:
            raise RuleError(f"{agent.name} is in another society", remedy="remove it there first")
        self.agents[agent.name] = agent
        agent.messaging.society = self
        agent.wake = functools.partial(self._woken, agent)
        agent.interpreter.signalled = True
        self._ready.append(agent)
        return agent

    def remove(self, name: str) -> Engine | None:
        """Remove an agent; later messages to it fail."""
        agent = self.agents.pop(name, None)
        if agent is not None:
            agent.messaging.society = agent.wake = None
        return agent

    def find(self, receiver: Any) -> Engine:
        """Find an agent by name (an atom or a string). Raises Failed for an unknown name."""
        name = receiver.name if receiver.__class__ is Atom else receiver
        agent = self.agents.get(name) if isinstance(name, str) else None
        if agent is None:
            raise self._unknown(name)
        return agent

    def tell(self, sender: Engine, receiver: Any, key: str, args: tuple[Any, ...], cause: Any) -> None:
        """Send a belief to agents, given as atom, string or tuple. Raises Failed for an unknown agent."""
        if receiver.__class__ is Atom:
            receiver = receiver.name
        agent = self.agents.get(receiver) if receiver.__class__ is str else None
        if agent is None or agent is sender:
            sender.messaging.send(receiver, "tell", literal_from_key(key, args), cause)
            return
        ag = agent.interpreter
        if ag.messaging.accepts is not None or LISTENING in ag.triggers:
            deliver(sender, agent, "tell", agent.beliefs.relation(key).literal(args), cause)
            return
        notes = self._sources.get(sender.name) or self.source_of(sender.name)
        relation = ag.relations.get(key) or ag.beliefs.relation(key)
        ag.inbox.append((relation, args, notes, cause, None))
        if not ag.signalled:
            ag.signalled = True
            self._ready.append(agent)

    def source_of(self, name: str) -> tuple[object, ...]:
        """Annotations of the messages of an agent."""
        return self._sources.setdefault(name, (source(Atom(name)),))

    # Running

    def run_until_idle(self, budget: int = 1_000_000, turns: int = TURNS) -> bool:
        """Run ready agents for ``turns`` turns each, at most ``budget`` visits; return whether work remains."""
        ready, timers = self._ready, self._timers
        while budget > 0:
            if timers and timers[0][0] <= self.clock.now():
                self._ring()
            if not ready:
                return False
            budget -= 1
            agent = ready.popleft()
            if agent.run_until_idle(turns) and not agent.interpreter.signalled:
                agent.interpreter.signalled = True
                ready.append(agent)
            due = agent.next_wakeup()
            if due is not None and due < self._due.get(agent, due + 1):
                self._due[agent] = due
                heapq.heappush(timers, (due, next(self._sequence), agent))
        return bool(ready)

    def next_wakeup(self) -> int | None:
        """Time (ns) of the next timer of an agent; None without timers."""
        return self._timers[0][0] if self._timers else None

    def run(self, *, linger: bool = True, seconds: float | None = None) -> None:
        """Run until `stop`, at most ``seconds``, and sleep while no work is pending.

        The clock must advance by itself. With ``linger=False`` it returns once no work and no timers remain.
        """
        from socialbot.bdi._timers import Wakeup

        end = None if seconds is None else self.clock.now() + round(seconds * SECOND)
        bell = self._bell = Wakeup()
        try:
            while not self.stopping:
                busy = self.run_until_idle(VISITS)
                left = None if end is None else end - self.clock.now()
                if left is not None and left <= 0:
                    return
                if not busy and not self.stopping:
                    due = self.next_wakeup()
                    if (
                        due is None
                        and not linger
                        and not any(agent.interpreter.inbox for agent in self.agents.values())
                    ):
                        return
                    waits = [
                        time for time in (left, None if due is None else due - self.clock.now()) if time is not None
                    ]
                    bell.wait(min(waits) / SECOND if waits else None)
        finally:
            self._bell = None
            self.stopping = False

    def stop(self) -> None:
        """End `run`, from any thread."""
        self.stopping = True
        self._ring_bell()

    def _woken(self, agent: Engine) -> None:
        self._ready.append(agent)
        self._ring_bell()

    def _ring_bell(self) -> None:
        bell = self._bell
        if bell is not None:
            bell.ring()
        if self.wake is not None:
            self.wake()

    def _ring(self) -> None:
        """Queue the agents with due timers."""
        timers, now = self._timers, self.clock.now()
        while timers and timers[0][0] <= now:
            due, _, agent = heapq.heappop(timers)
            if self._due.get(agent) == due:
                del self._due[agent]
                if not agent.interpreter.signalled and agent.messaging.society is self:
                    agent.interpreter.signalled = True
                    self._ready.append(agent)

    def _unknown(self, name: Any) -> Failed:
        from difflib import get_close_matches

        near = get_close_matches(str(name), self.agents, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        return Failed("action_failed", f"there is no agent {name}{hint}")
