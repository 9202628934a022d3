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

from socialbot.bdi._messaging import RECEIVED, TOLD, deliver, told_beliefs
from socialbot.bdi._rule_checks import check_running
from socialbot.bdi._timers import Wakeup
from socialbot.bdi.engine import Engine
from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Change, Event, known_notes, literal_from_key, source_notes
from socialbot.bdi.terms import Atom
from socialbot.core.clock import SECOND, Clock
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.agentspeak.programs import IncludePaths
    from socialbot.bdi.environment import Environment

SLEEPING, AWAKING = (Event(Change.ADDED, literal_from_key(f"{name}/0", ())) for name in ("jag_sleeping", "jag_awaking"))
"""Events of an agent that becomes idle, and of one that a message or an event wakes."""

SLEEPING_KEY, AWAKING_KEY = SLEEPING.key, AWAKING.key

START_TURNS = 8
"""Turns of each agent, one at a time, with which `Society.run` begins, so that no agent is far ahead of the others."""

VISITS = 8
"""Number of agent visits between checks for `Society.stop`."""


class Society:
    """Agents by name. Any thread may call ``wake``, after an item was posted to an agent.

    Attributes:
        agents: The agents by name.
        environment: The world of the agents, if any.
        starter: Makes the agent of `.create_agent` from its name, its file (or None) and the agent that creates it;
            without a starter, an agent without a file can be created only.
        include_paths: Places of the files of `.include`; None refuses it.
        services: Agents that offer a service, by its name (`.df_register`).
        subscribers: Agents that want to know who offers a service, by its name.
    """

    def __init__(self, clock: Clock, *, wake: Callable[[], object] | None = None) -> None:
        self.clock = clock
        self.wake = wake
        self.agents: dict[str, Engine] = {}
        self.environment: Environment | None = None
        self.starter: Callable[[str, str | None, Engine], Engine] | None = None
        self.include_paths: IncludePaths | None = None
        self.services: dict[str, dict[str, None]] = {}
        self.subscribers: dict[str, dict[str, None]] = {}
        self._ready: deque[Engine] = deque()
        self._timers: list[tuple[int, int, Engine]] = []
        self._due: dict[Engine, int] = {}
        self._sequence = itertools.count()
        self._asleep: set[Engine] = set()  # agents that were told that they are idle
        self._wakeup: Wakeup | None = None
        self.stopping = False

    def add(self, agent: Engine | str) -> Engine:
        """Add an agent, or create one by name. Raises RuleError for a duplicate name."""
        if isinstance(agent, str):
            agent = Engine(agent, self.clock)
        if agent.name in self.agents:
            raise RuleError(f"agent name {agent.name} is already taken", remedy="give each agent a name of its own")
        if agent.messaging.society is not None:
            raise RuleError(f"{agent.name} is in another society", remedy="remove it there first")
        self.agents[agent.name] = agent
        agent.messaging.society = self
        agent.wake = functools.partial(self._woken, agent)
        agent.interpreter.peers = self._ready
        agent.interpreter.signalled = True
        self._ready.append(agent)
        if self.environment is not None:
            self.environment.joined(agent)
        return agent

    def remove(self, name: str) -> Engine | None:
        """Remove an agent; later messages to it fail."""
        agent = self.agents.pop(name, None)
        if agent is not None:
            agent.messaging.society = agent.wake = None
            agent.interpreter.peers = []
            self._asleep.discard(agent)
            for names in (*self.services.values(), *self.subscribers.values()):
                names.pop(name, None)
        return agent

    def create(self, name: str, file: str | None, creator: Engine) -> Engine:
        """Start an agent at the request of another one. Raises a SocialbotError if it cannot be made."""
        if self.starter is not None:
            agent = self.starter(name, file, creator)
        elif file is None:
            agent = Engine(name, self.clock, sink=creator.trace.sink)
        else:
            raise RuleError(f"{file} cannot be loaded", remedy="set Society.starter, which loads the files of agents")
        return self.add(agent)

    def kill(self, name: str) -> None:
        """Remove an agent, and end its intentions and timers."""
        agent = self.remove(name)
        if agent is not None:
            agent.interpreter.events.clear()
            agent.interpreter.inbox.clear()
            for intention in agent.intentions:
                agent.intentions.drop(intention)
            agent.timers.remove(lambda _: True)

    def find(self, receiver: Any) -> Engine:
        """Find an agent by name (an atom or a string). Raises Failed for an unknown name."""
        name = receiver.name if receiver.__class__ is Atom else receiver
        agent = self.agents.get(name) if isinstance(name, str) else None
        if agent is None:
            from difflib import get_close_matches  # rarely needed

            near = get_close_matches(str(name), self.agents, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise Failed("receiver_not_found", f"there is no agent {name}{hint}")
        return agent

    def tell(self, sender: Engine, receiver: Any, key: str, args: tuple[Any, ...], cause: Any) -> None:
        """Send a belief to agents, given as atom, string or tuple. Raises Failed for an unknown agent."""
        if receiver.__class__ is Atom:
            receiver = receiver.name
        agent = self.agents.get(receiver) if isinstance(receiver, str) else None
        if agent is None or agent is sender:
            sender.messaging.send(receiver, "tell", literal_from_key(key, args), cause)
            return
        ag = agent.interpreter
        if ag.messaging.accepts is not None or "+message/3" in ag.triggers or RECEIVED in ag.triggers:
            deliver(sender, agent, "tell", agent.beliefs.relation(key).literal(args), cause)
            return
        relation = ag.relations.get(key) or ag.beliefs.relation(key)
        said_by = known_notes(sender.name) or source_notes(sender.name)
        ag.inbox.append((relation, args, said_by, cause, TOLD))
        if not ag.signalled:
            ag.signalled = True
            self._ready.append(agent)

    def tell_all(self, sender: Engine, receivers: list[Engine], content: Any, cause: Any) -> None:
        """Send beliefs to agents, which share the terms in them."""
        beliefs = told_beliefs(sender, content)
        for agent in receivers:
            if not agent.messaging.takes_beliefs:
                deliver(sender, agent, "tell", content, cause)
                continue
            ag = agent.interpreter
            for key, args, notes in beliefs:
                relation = ag.relations.get(key) or ag.beliefs.relation(key)
                ag.inbox.append((relation, args, notes, cause, TOLD))
            if not ag.signalled:
                ag.signalled = True
                self._ready.append(agent)
        self._ring()

    # Running

    def run_until_idle(self, budget: int = 1_000_000, turns: int = 4) -> bool:
        """Run ready agents for ``turns`` turns each, at most ``budget`` visits; return whether work remains."""
        ready, timers, asleep = self._ready, self._timers, self._asleep
        while budget > 0 and not (self.stopping and self._wakeup is not None):
            if timers and timers[0][0] <= self.clock.now():
                self._queue_due()
            if not ready:
                return False
            budget -= 1
            agent = ready.popleft()
            if agent.messaging.society is not self:
                continue
            if asleep and agent in asleep:
                busy = self._awaken(agent, turns)
            else:
                busy = agent.run_until_idle(turns)
            triggers = agent.interpreter.triggers
            if not busy and (SLEEPING_KEY in triggers or AWAKING_KEY in triggers) and agent not in asleep:
                asleep.add(agent)
                agent.interpreter.raise_event(SLEEPING, "")
                busy = agent.run_until_idle(turns)
            if busy and not agent.interpreter.signalled:
                agent.interpreter.signalled = True
                ready.append(agent)
            due = agent.next_wakeup()
            if due is not None and due < self._due.get(agent, due + 1):
                self._due[agent] = due
                heapq.heappush(timers, (due, next(self._sequence), agent))
        return bool(ready)

    def _awaken(self, agent: Engine, turns: int) -> bool:
        """Run an idle agent; a new event or message wakes it."""
        if agent.interpreter.inbox or agent.interpreter.events:
            self._asleep.discard(agent)
            agent.interpreter.raise_event(AWAKING, "")
        return agent.run_until_idle(turns)

    def next_wakeup(self) -> int | None:
        """Time (ns) of the next timer of an agent; None without timers."""
        return self._timers[0][0] if self._timers else None

    def run(self, *, linger: bool = True, seconds: float | None = None) -> bool:
        """Run until `stop`, at most ``seconds``, and sleep while no work is pending; return whether `stop` ended it.

        The clock must advance by itself. With ``linger=False`` it returns once no work and no timers remain.
        """
        end = None if seconds is None else self.clock.now() + round(seconds * SECOND)
        wakeup = self._wakeup = Wakeup()
        try:
            self.run_until_idle(START_TURNS * len(self.agents), turns=1)
            while not self.stopping:
                busy = self.run_until_idle(VISITS)
                if end is not None and self.clock.now() >= end:
                    return self.stopping
                if busy or self.stopping:
                    continue
                due = self.next_wakeup()
                if due is not None:
                    check_running(self.clock, "the society")
                if due is None and not linger and not any(agent.interpreter.inbox for agent in self.agents.values()):
                    return False
                times = [time for time in (end, due) if time is not None]
                wakeup.wait((min(times) - self.clock.now()) / SECOND if times else None)
            return True
        finally:
            self._wakeup = None
            self.stopping = False

    def stop(self) -> None:
        """End `run`, from any thread, after the current steps of the agents."""
        self.stopping = True
        self._ready.extend(list(self.agents.values())[:1])  # ends the turn of a looping agent
        self._ring()

    def _woken(self, agent: Engine) -> None:
        self._ready.append(agent)
        self._ring()

    def _ring(self) -> None:
        wakeup = self._wakeup
        if wakeup is not None:
            wakeup.ring()
        if self.wake is not None:
            self.wake()

    def _queue_due(self) -> None:
        """Queue the agents with due timers."""
        timers, now = self._timers, self.clock.now()
        while timers and timers[0][0] <= now:
            due, _, agent = heapq.heappop(timers)
            if self._due.get(agent) == due:
                del self._due[agent]
                if not agent.interpreter.signalled and agent.messaging.society is self:
                    agent.interpreter.signalled = True
                    self._ready.append(agent)
