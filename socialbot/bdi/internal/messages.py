"""Internal actions that speak to other agents, and of them."""

from __future__ import annotations

from typing import Any

from socialbot.bdi.intentions import Pause
from socialbot.bdi.internal.arguments import gives, name_of, number_of
from socialbot.bdi.internals import internal
from socialbot.bdi.terms import Atom
from socialbot.bdi.unification import Trail, resolve

Args = tuple[Any, ...]


@internal(".send", 3, 5, pauses=True)
def send(engine: Any, args: Args, trail: Trail) -> Pause | None:
    """``.send(To, Performative, Content, Answer, Timeout)``: says something to an agent or a list of them.

    With an answer to be, the intention rests until it has come, or for so many ms, after which it is ``timeout``.
    """
    from socialbot.bdi.mail import send as say

    receiver, performative, content, *rest = args
    receiver, performative, content = map(resolve, (receiver, performative, content))
    performative = name_of(".send", performative)
    if not rest:
        return say(engine, receiver, performative, content, engine.cause)
    limit_s = number_of(".send", rest[1]) / 1000 if len(rest) > 1 else None
    return say(engine, receiver, performative, content, engine.cause, answer=rest[0], limit_s=limit_s)


@internal(".broadcast", 2)
def broadcast(engine: Any, args: Args, trail: Trail) -> None:
    """``.broadcast(Performative, Content)``: says something to all other agents."""
    from socialbot.bdi.mail import broadcast as say

    say(engine, name_of(".broadcast", args[0]), resolve(args[1]), engine.cause)


@internal(".my_name", 1, binds=True)
def my_name(engine: Any, args: Args, trail: Trail) -> bool:
    """``.my_name(N)``: the name of this agent, an atom."""
    return gives(args[0], Atom(engine.name), trail)


@internal(".all_names", 1, binds=True)
def all_names(engine: Any, args: Args, trail: Trail) -> bool:
    """``.all_names(L)``: the names of all agents, this one among them."""
    names = [engine.name] if engine.society is None else engine.society.agents
    return gives(args[0], tuple(map(Atom, names)), trail)


@internal(".stopMAS", 0, 1)
def stop_all(engine: Any, args: Args, trail: Trail) -> None:
    """Ends the running of all agents; with ms, after so long."""
    society = engine.society or engine
    if args:
        engine.at_in(number_of(".stopMAS", args[0]) / 1000, society.stop)
    else:
        society.stop()


internal(".stop", 0, 1)(stop_all)
