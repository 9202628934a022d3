"""Internal actions on the agents of the society, and on its directory of services."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from socialbot.bdi.agentspeak._spelling import plain as said
from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Change, Event, Literal, literal_from_key, source
from socialbot.bdi.stdlib.registry import Args, gives, internal, items_of, name_of, number_of, wrong
from socialbot.bdi.terms import Atom
from socialbot.bdi.unification import Trail, Var, resolve
from socialbot.core.errors import SocialbotError


@internal(".my_name", 1, binds=True)
def my_name(engine: Any, args: Args, trail: Trail) -> bool:
    """``.my_name(N)``: the name of this agent, an atom."""
    return gives(args[0], Atom(engine.name), trail)


@internal(".all_names", 1, binds=True)
def all_names(engine: Any, args: Args, trail: Trail) -> bool:
    """``.all_names(L)``: the names of all agents, including this one."""
    society = engine.messaging.society
    names = [engine.name] if society is None else society.agents
    return gives(args[0], tuple(map(Atom, names)), trail)


@internal(".stopMAS", 0, 2)
def stop_all(engine: Any, args: Args, trail: Trail) -> None:
    """``.stopMAS(Ms, Code)``: stop all agents, optionally after Ms that begin with ``+jag_shutting_down(Ms)``.

    The exit code is ignored.
    """
    society = engine.messaging.society or engine
    delay = number_of(".stopMAS", args[0]) if args else 0
    if delay > 0:
        for agent in getattr(society, "agents", {engine.name: engine}).values():
            _announce_end(agent, delay)
        engine.timers.after(delay / 1000, society.stop)
    else:
        society.stop()


def _announce_end(agent: Any, delay: float) -> None:
    notice = Event(Change.ADDED, literal_from_key("jag_shutting_down/1", (delay,)))
    agent.call(lambda: agent.interpreter.raise_event(notice, ""))


internal(".stop", 0, 1)(stop_all)


def _society(engine: Any, name: str) -> Any:
    if engine.messaging.society is None:
        raise Failed("action_failed", f"{name}: {engine.name} is in no society")
    return engine.messaging.society


def free_name(wanted: str, taken: Collection[str]) -> str:
    """Return the wanted name of an agent, or ``wanted_1`` and so on if it is taken."""
    found, number = wanted, 0
    while found in taken:
        number += 1
        found = f"{wanted}_{number}"
    return found


@internal(".create_agent", 1, 3)
def create_agent(engine: Any, args: Args, trail: Trail) -> bool:
    """``.create_agent(Name, "file.asl", Options)``: start an agent; an unbound Name gets a new name, a string.

    The file is searched where the program was loaded from. Options of Jason, which name Java classes, are refused.
    """
    name, *rest = map(resolve, args)
    society = _society(engine, ".create_agent")
    if len(rest) > 1 and items_of(".create_agent", rest[1]):
        raise Failed("wrong_arguments", ".create_agent: classes of Java are not supported; use an environment")
    file = None
    if rest:
        if not isinstance(rest[0], str):
            raise wrong(".create_agent", rest[0], "the name of a file, a string")
        file = rest[0]
    wanted = name.name[:1].lower() + name.name[1:] if name.__class__ is Var else name_of(".create_agent", name)
    found = free_name(wanted, society.agents)
    try:
        society.create(found, file, engine)
    except SocialbotError as problem:
        raise Failed("action_failed", f".create_agent({found}): {problem}") from problem
    return name.__class__ is not Var or gives(name, found, trail)


@internal(".kill_agent", 1, 2)
def kill_agent(engine: Any, args: Args, trail: Trail) -> bool:
    """``.kill_agent(Name, Ms)``: end an agent, optionally after Ms that begin with ``+jag_shutting_down(Ms)``."""
    name, society = name_of(".kill_agent", args[0]), _society(engine, ".kill_agent")
    agent = society.agents.get(name)
    if agent is None:
        return False
    if len(args) == 1:
        society.kill(name)
        return True
    delay = number_of(".kill_agent", args[1])
    _announce_end(agent, delay)
    engine.timers.after(delay / 1000, lambda: society.kill(name))
    return True


@internal(".clone", 1)
def clone(engine: Any, args: Args, trail: Trail) -> None:
    """``.clone(Name)``: start an agent with the plans, rules and beliefs of this one, without its intentions."""
    name, society = name_of(".clone", args[0]), _society(engine, ".clone")
    try:
        twin = society.create(name, None, engine)
    except SocialbotError as problem:
        raise Failed("action_failed", f".clone({name}): {problem}") from problem
    library = engine.library
    for plan in library:
        twin.add_rules(plan)
    for inferences in library.inferences.values():
        for compiled in inferences:
            twin.add_rules(compiled.inference)
    for relation in engine.beliefs.relations.values():
        for facts, (since, notes, _) in relation.facts.items():
            twin.interpreter.post((twin.beliefs.relation(relation.key), facts, tuple(notes), "", since))


# The directory of services


def _service(args: Args) -> str:
    return said(resolve(args[0]))


@internal(".df_register", 1, 2)
def df_register(engine: Any, args: Args, trail: Trail) -> None:
    """``.df_register(Service, Type)``: offer a service in the directory of the society; the type is ignored."""
    society, service = _society(engine, ".df_register"), _service(args)
    providers = society.services.setdefault(service, {})
    if engine.name in providers:
        return
    providers[engine.name] = None
    for name in society.subscribers.get(service, ()):
        _tell_provider(society, name, service, engine.name)


@internal(".df_deregister", 1, 2)
def df_deregister(engine: Any, args: Args, trail: Trail) -> None:
    """``.df_deregister(Service, Type)``: withdraw a service from the directory."""
    society = _society(engine, ".df_deregister")
    society.services.get(_service(args), {}).pop(engine.name, None)


@internal(".df_search", 2, 3, binds=True)
def df_search(engine: Any, args: Args, trail: Trail) -> bool:
    """``.df_search(Service, Type, Agents)``: Agents are those that offer a service, whatever its type."""
    found = _society(engine, ".df_search").services.get(_service(args), {})
    return gives(args[-1], tuple(map(Atom, found)), trail)


@internal(".df_subscribe", 1, 2)
def df_subscribe(engine: Any, args: Args, trail: Trail) -> None:
    """``.df_subscribe(Service, Type)``: believe ``provider(Agent, Service)`` of each present and later provider."""
    society, service = _society(engine, ".df_subscribe"), _service(args)
    society.subscribers.setdefault(service, {})[engine.name] = None
    for provider in society.services.get(service, {}):
        _tell_provider(society, engine.name, service, provider)


def _tell_provider(society: Any, subscriber: str, service: str, provider: str) -> None:
    agent = society.agents.get(subscriber)
    if agent is None:
        return
    belief: Literal = literal_from_key("provider/2", (Atom(provider), service))
    agent.interpreter.post((agent.beliefs.relation(belief.key), belief.args, (source(Atom("df")),), "", None))
