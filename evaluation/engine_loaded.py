"""Workloads of beliefs, waits, rules and messages with many items: the cost must not grow with their number."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence

from evaluation import engine_programs as programs
from evaluation.engine_hand import Body, Fact, Guard, Hand, forget_and_count
from evaluation.engine_rows import Job, Row
from evaluation.engine_workloads import Scale, post, timed
from socialbot.bdi import Atom, Belief, Engine
from socialbot.bdi.literals import literal
from socialbot.bdi.society import Society
from socialbot.core.clock import WallClock

NESTED_TEXT = "+ev(K) : at(box(K), pos(X, Y)) & zone(pos(X, Y), Z) & lit(room(Z), on) <- -ev(K); tick."
HALF_TEXT = "+ev(K) : at(box(B), pos(K, Y)) & Y > 0 <- -ev(K); tick."
CONDITION_TEXT = "ready(yes). +ev(K) : ready(yes) <- -ev(K); tick. +!w(I) <- .wait(open(I) & not shut(I)); tick."
CHANGE_TEXT = "+!w(I) <- .wait(open(I)); -open(I); tick; !!w(I)."
EVENT_TEXT = "+!w(I) <- .wait({+open(I)}); -open(I); tick; !!w(I)."
RULE_TEXT = """
free(X) :- slot(X, _) & not busy(X).
load(N) :- .count(busy(_), N).
weight(S) :- .findall(W, slot(_, W), L) & S = math.sum(L).
+ev(K) : free(K) & load(N) & N < 150 & weight(S) & S > 10 <- -ev(K); tick.
"""
TOLD_TEXT = "+m(A, N)[source(S)] <- -m(A, N)[source(S)]; tick."
SOURCES_TEXT = "+hot(X)[source(S)] <- tick."


def settled(text: str, beliefs: Iterable[Belief], goals: Iterable[Belief] = ()) -> Engine:
    """Return an idle agent with plans in AgentSpeak, beliefs and goals."""
    engine = programs.agent(text=text)
    for belief in beliefs:
        engine.believe(belief)
    for goal in goals:
        engine.achieve(goal)
    while engine.run_until_idle():
        pass
    return engine


def term(functor: str, *args: object) -> Belief:
    """Return a literal without a class."""
    return literal(functor, args)


def reaction(scale: Scale, engine: Engine, agent: Hand, number: int, functor: str = "ev") -> Job:
    """Return the job to react to events with ``number`` different arguments, one by one."""
    events = [term(functor, i % number) for i in range(number)]
    facts = [(functor, i) for i in range(number)]
    order = [i % number for i in range(scale.events)]

    def react() -> None:
        before = agent.count
        for i in order:
            agent.add(facts[i])
            agent.run()
        assert agent.count == before + len(order)

    return Job(len(order), lambda: post(engine, [events[i] for i in order]), lambda: timed(react))


def deciding(guard: Guard, indexed: tuple[str, ...] = (), facts: Sequence[Fact] = ()) -> Hand:
    """Return a hand-written agent with one plan, for ``ev``."""
    agent = Hand(indexed=indexed)
    for fact in facts:
        agent.add(fact)
    agent.queue.clear()
    agent.plans = {("+", "ev", None): [(guard, forget_and_count)]}
    return agent


# Beliefs


def nested(number: int) -> Callable[[Scale], Job]:
    """Join of three kinds of beliefs with nested terms."""

    def job(scale: Scale) -> Job:
        boxes = range(number // 3)
        beliefs = [
            belief
            for i in boxes
            for belief in (
                term("at", term("box", i), term("pos", i, i + 1)),
                term("zone", term("pos", i, i + 1), f"z{i}"),
                term("lit", term("room", f"z{i}"), Atom("on")),
            )
        ]
        facts: list[Fact] = []
        for i in boxes:
            place = ("pos", i, i + 1)
            facts += [("at", ("box", i), place), ("zone", place, f"z{i}"), ("lit", ("room", f"z{i}"), "on")]

        def lit(agent: Hand, fact: Fact) -> Fact | None:
            for at in agent.index.get(("at", ("box", fact[1])), ()):
                for zone in agent.index.get(("zone", at[2]), ()):
                    if ("lit", ("room", zone[2]), "on") in agent.beliefs:
                        return fact
            return None

        return reaction(scale, settled(NESTED_TEXT, beliefs), deciding(lit, ("at", "zone"), facts), len(boxes))

    return job


def half_known(number: int) -> Callable[[Scale], Job]:
    """Belief with a nested term of which one argument is known."""

    def job(scale: Scale) -> Job:
        beliefs = [term("at", term("box", i), term("pos", i, i + 1)) for i in range(number)]
        places = {i: [("at", ("box", i), ("pos", i, i + 1))] for i in range(number)}

        def known(_agent: Hand, fact: Fact) -> Fact | None:
            for at in places.get(fact[1], ()):
                if at[2][2] > 0:
                    return fact
            return None

        return reaction(scale, settled(HALF_TEXT, beliefs), deciding(known), number)

    return job


def rules(scale: Scale) -> Job:
    """Rules with negation and aggregates over 200 beliefs."""
    slots, busy = range(100), range(100, 200)
    weights = [("slot", i, i) for i in slots]
    loads = {("busy", i) for i in busy}

    def fits(agent: Hand, fact: Fact) -> Fact | None:
        for _ in agent.index.get(("slot", fact[1]), ()):
            if ("busy", fact[1]) not in loads and len(loads) < 150 and sum(slot[2] for slot in weights) > 10:
                return fact
        return None

    beliefs = [*(term("slot", i, i) for i in slots), *(term("busy", i) for i in busy)]
    return reaction(scale, settled(RULE_TEXT, beliefs), deciding(fits, ("slot",), weights), 100)


# Waits


def events_beside(waiting: int) -> Callable[[Scale], Job]:
    """Events while intentions wait for conditions on other beliefs."""

    def job(scale: Scale) -> Job:
        engine = settled(CONDITION_TEXT, (), (term("w", i) for i in range(waiting)))
        ready = deciding(
            lambda agent, fact: fact if ("ready", "yes") in agent.beliefs else None, (), [("ready", "yes")]
        )
        return reaction(scale, engine, ready, 100)

    return job


class WaitingHand(Hand):
    """Hand-written agent whose continuations wait for one fact each."""

    __slots__ = ("waits",)

    def __init__(self, number: int) -> None:
        super().__init__()
        self.waits: dict[Fact, list[Callable[[Fact], None]]] = {("open", i): [self.go_on] for i in range(number)}

    def go_on(self, fact: Fact) -> None:
        forget_and_count(self, fact)
        self.waits.setdefault(fact, []).append(self.go_on)

    def run(self) -> None:
        queue = self.queue
        while queue:
            _, fact = queue.popleft()
            for go_on in self.waits.pop(fact, ()):
                go_on(fact)


def waking(text: str, waiting: int) -> Callable[[Scale], Job]:
    """Events each of which continues one of the waiting intentions, which then waits again."""

    def job(scale: Scale) -> Job:
        engine = settled(text, (), (term("w", i) for i in range(waiting)))
        return reaction(scale, engine, WaitingHand(waiting), waiting, "open")

    return job


# Messages


class Mailboxes:
    """Hand-written agents that are run in the order in which they got messages."""

    def __init__(self, number: int, name: str, body: Body) -> None:
        self.agents = [Hand(f"a{i}") for i in range(number)]
        self.ready: deque[Hand] = deque()
        for agent in self.agents:
            agent.plans = {("+", name, None): [(lambda _agent, fact: fact, body)]}

    def send(self, sender: str, receiver: Hand, fact: Fact) -> None:
        receiver.mail.append((sender, fact))
        self.ready.append(receiver)

    def run(self) -> None:
        while self.ready:
            agent = self.ready.popleft()
            sender, fact = agent.mail.popleft()
            agent.add((*fact, sender))
            agent.run()


def _settle(society: Society) -> None:
    while society.run_until_idle():
        pass


def tell_one(scale: Scale) -> Job:
    """100 agents send a belief each to one agent."""
    rounds = max(1, scale.events // 1_000)
    society, model = Society(WallClock()), programs.agent(text="+!go(A, N) <- .send(hub, tell, m(A, N)).")
    hub = society.add(programs.agent(text=TOLD_TEXT, name="hub"))
    agents = [society.add(Engine(f"a{i}", society.clock, library=model.library)) for i in range(100)]
    _settle(society)
    goals = [[term("go", i, k) for i in range(100)] for k in range(rounds)]
    hand_hub = Hand("hub")
    hand_hub.plans = {("+", "m", None): [(lambda _agent, fact: fact, forget_and_count)]}

    def hand_on(agent: Hand, fact: Fact) -> None:
        agent.remove(fact)
        mailboxes.send(agent.name, hand_hub, ("m", fact[1], fact[2]))

    mailboxes = Mailboxes(100, "go", hand_on)

    def tell() -> None:
        before = hub.robot.count
        for row in goals:
            for agent, goal in zip(agents, row, strict=True):
                agent.achieve(goal)
            _settle(society)
        assert hub.robot.count == before + 100 * rounds

    def tell_by_hand() -> None:
        before = hand_hub.count
        for k in range(rounds):
            for i, agent in enumerate(mailboxes.agents):
                mailboxes.send("env", agent, ("go", i, k))
            mailboxes.run()
        assert hand_hub.count == before + 100 * rounds

    return Job(100 * rounds, lambda: timed(tell), lambda: timed(tell_by_hand))


def broadcast(scale: Scale) -> Job:
    """One agent sends a belief to 1,000 agents."""
    rounds = max(1, scale.events // 20_000)
    society, robot = Society(WallClock()), programs.Counter()
    model = programs.agent(text="+m(N)[source(S)] <- -m(N)[source(S)]; tick.")
    sender = society.add(programs.agent(text="+!go(N) <- .broadcast(tell, m(N)).", name="sender"))
    for i in range(1_000):
        agent = society.add(Engine(f"a{i}", society.clock, library=model.library, robot=robot))
        agent.add_action(programs.tick)
    _settle(society)
    mailboxes = Mailboxes(1_000, "m", forget_and_count)

    def send() -> None:
        before = robot.count
        for k in range(rounds):
            sender.achieve(term("go", k))
            _settle(society)
        assert robot.count == before + 1_000 * rounds

    def send_by_hand() -> None:
        for k in range(rounds):
            for agent in mailboxes.agents:
                mailboxes.send("sender", agent, ("m", k))
            mailboxes.run()

    return Job(1_000 * rounds, lambda: timed(send), lambda: timed(send_by_hand))


def sources(scale: Scale) -> Job:
    """500 agents are the sources of one belief."""
    rounds = max(1, scale.events // 25_000)
    engine, names, hot = programs.agent(text=SOURCES_TEXT), [f"s{i}" for i in range(500)], term("hot", 1)

    def tell() -> None:
        before = engine.robot.count
        for _ in range(rounds):
            for name in names:
                engine.believe(hot, source=name)
                engine.run_until_idle()
            engine.forget(hot)
            engine.run_until_idle()
        assert engine.robot.count == before + 500 * rounds

    def tell_by_hand() -> None:
        held: dict[Fact, set[str]] = {}
        queue: deque[tuple[Fact, str]] = deque()
        count, fact = 0, ("hot", 1)
        for _ in range(rounds):
            for name in names:
                known = held.setdefault(fact, set())
                if name not in known:
                    known.add(name)
                    queue.append((fact, name))
                while queue:
                    queue.popleft()
                    count += 1
            del held[fact]
        assert count == 500 * rounds

    return Job(500 * rounds, lambda: timed(tell), lambda: timed(tell_by_hand))


LOADED: dict[str, tuple[Row, ...]] = {
    "nested": tuple(
        Row(f"nested_{number}", f"join of 3 beliefs with nested terms, {number} beliefs", nested(number), 0.30, 0.6)
        for number in (20, 20_000)
    ),
    "half": (
        Row("half_20", "half-known nested term, 20 beliefs", half_known(20), 0.20, 0.4),
        Row("half_5000", "half-known nested term, 5000 beliefs", half_known(5_000), 0.20, 0.4, "half_20", 0.6),
    ),
    "rules": (Row("rules", "rules with negation and aggregates, 200 beliefs", rules, 0.10, 0.3),),
    "conditions": tuple(
        Row(
            f"conditions_{number}", f"events while {number} intentions wait for conditions", events_beside(number),
            0.25, 0.4, "conditions_0" if number else None,
        )
        for number in (0, 10, 1_000)
    ),
    "waits": (
        Row("waits_500", "500 intentions, each waits for its event", waking(EVENT_TEXT, 500), 0.15, 0.3),
        Row(
            "waits_5000", "5000 intentions, each waits for its event", waking(EVENT_TEXT, 5_000),
            0.15, 0.3, "waits_500",
        ),
        Row("changes_1000", "1000 intentions, each waits for its condition", waking(CHANGE_TEXT, 1_000)),
    ),
    "messages": (
        Row("tell_one", "100 agents tell one", tell_one, 0.15, 0.3),
        Row("broadcast", "broadcast to 1000 agents", broadcast, 0.15, 0.3),
        Row("sources", "500 sources of one belief", sources, 0.15, 0.3),
    ),
}  # fmt: skip
"""Rows by the name of their workload on the command line."""
