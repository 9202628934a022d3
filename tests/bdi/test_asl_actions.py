"""Actions of AgentSpeak programs in Python."""

from __future__ import annotations

import asyncio
import inspect
import sys
import threading
import time
from importlib import metadata

import pytest

from socialbot.bdi import Atom, Engine, Failed, asl_action
from socialbot.bdi.agentspeak import parse
from socialbot.bdi.agentspeak.loading import check, needs_of
from socialbot.bdi.stdlib import actions
from socialbot.bdi.stdlib.environment import RawOutput, print_
from socialbot.bdi.unification import Trail
from socialbot.core.clock import ManualClock, WallClock
from socialbot.core.errors import RuleError
from tests.bdi.mas import Mas, does, said

PRICES = {"apple": 3, "pear": 5}


@asl_action
def cost_of(agent, fruit):
    return PRICES.get(str(fruit))


@asl_action
def buy(agent, fruit, count=1):
    return str(fruit) in PRICES


@asl_action
def ends(agent, items):
    return items[0], items[-1]


@asl_action
def flags(agent):
    return [True, False, 1.5, "a", ["b"]]


@asl_action
def crashes(agent):
    raise ValueError("too cold")


@asl_action
def refuses(agent):
    raise Failed("cancelled", "not today")


@asl_action("stall.fruit")
def fruits(agent):
    for name, cost in PRICES.items():
        yield Atom(name), cost


@asl_action("shop.open")
def shop_open(agent, hour):
    return 9 <= hour < 17


@asl_action("shop.next", results=1)
def following(agent, *items):
    for item in items:
        yield item + 1


@asl_action("shop.crash")
def crash(agent):
    raise KeyError("till")


@asl_action("shop.total", results=1)
async def total(agent, *items):
    return sum(items)


CASES = {
    "cost_of(apple, P); .print(P)": ["3"],
    "cost_of(apple, 3); .print(yes); cost_of(apple, 4)": ["yes", "failed action_failed"],
    "cost_of(melon, P)": ["failed action_failed"],
    "cost_of(F, P)": ["failed no_value"],
    "cost_of": ["failed wrong_arguments"],
    "cost_of(apple, P, Q)": ["failed wrong_arguments"],
    "buy(apple); buy(pear, 2); .print(yes); buy(melon)": ["yes", "failed action_failed"],
    "buy(apple, 2, X); .print(X)": ["true"],
    "ends([1, 2, 3], F, L); .print(F, L)": ["13"],
    "ends([1, 2, 3], L); .print(L)": ["[1,3]"],
    "flags(L); .print(L)": ['[true,false,1.5,"a",["b"]]'],
    "crashes": ["failed exception"],
    "refuses": ["failed cancelled"],
    "nobody(X)": ["failed action_failed"],
    "for (stall.fruit(F, P) & P > 3) { .print(F) }": ["pear"],
    "stall.fruit(F, 5); .print(F)": ["pear"],
    "stall.fruit(F, 7)": ["failed ia_failed"],
    ".findall(F, stall.fruit(F, _), L); .print(L)": ["[apple,pear]"],
    "if (shop.open(8) | not shop.open(12)) { .print(no) } else { .print(yes) }": ["yes"],
    "shop.open(12); .print(yes); shop.open(20)": ["yes", "failed ia_failed"],
    ".findall(N, shop.next(1, 5, N), L); .print(L)": ["[2,6]"],
    "shop.next(4, 5); .print(yes); shop.next(4, 6)": ["yes", "failed ia_failed"],
    "shop.crash": ["failed exception"],
    "cost_of(apple, P); cost_of(pear, Q); S = P + Q; .print(S)": ["8"],
    "cost_of(apple, P) |&| cost_of(pear, Q); .print(P, Q)": ["35"],
    "if (X = 1) { cost_of(apple, P) }; .print(P)": ["3"],
}  # fmt: skip


@pytest.mark.parametrize("body", CASES)
def test_result(body):
    assert does(body) == CASES[body]


def test_message_names_the_action():
    text = "!go. +!go <- {}. -!go[error_msg(M)] <- .print(M)."
    assert said(text.format("cost_of(apple, 4)")) == ["the result of cost_of is 3, not 4"]
    assert said(text.format("crashes")) == ["ValueError: too cold"]
    assert said(text.format("cost_of(apple, 1, 2, 3)")) == ["cost_of has 1 results, but 1, 2, 3 takes 3"]


def test_exception_in_a_condition_makes_a_plan_not_applicable():
    assert said("!go. +!go : shop.crash <- .print(no). +!go <- .print(yes).") == ["yes"]


def test_coroutine_binds_its_result_and_lets_other_intentions_run():
    lines = []
    engine = Engine("me", WallClock())
    engine.out = lines.append
    other_ran = threading.Event()

    async def ask(agent):
        while not other_ran.is_set():
            await asyncio.sleep(0.001)
        return 3

    engine.add_action(ask, "ask")
    engine.add_action(lambda agent: other_ran.set(), "release")
    engine.add_text("!go. !other. +!go <- ask(X); .print(X). +!other <- .print(other); release.")
    deadline = time.monotonic() + 60
    while len(lines) < 2 and time.monotonic() < deadline:
        engine.run_until_idle()
    assert lines == ["other", "3"]


def test_coroutine_cannot_be_a_condition():
    assert "cannot be a condition" in str(check("+!go : shop.total(1, X) <- .print(X).")[0])


def test_action_of_the_engine_takes_precedence_and_has_results():
    lines = []
    engine = Engine("me", WallClock())
    engine.out = lines.append
    engine.add_action(lambda agent, name: f"{agent.name} {name}", "cost_of")
    engine.add_text("!go. +!go <- cost_of(apple, X); .print(X).")
    engine.run_until_idle()
    assert lines == ["me apple"]


@pytest.mark.parametrize("name", ["Big", "", "a..b", "a b", ".print"])
def test_invalid_name(name):
    with pytest.raises(RuleError, match="cannot be the name of an action"):
        asl_action(name or "9")(lambda agent: None)


def test_name_of_another_action_is_refused():
    with pytest.raises(RuleError, match="the action cost_of is already registered by tests"):
        asl_action("cost_of")(lambda agent: None)


def test_unknown_internal_action_of_a_library_is_needed_from_outside():
    text = "+!go <- zoo.feed(1); open(2); close; .print(zoo.dist(1, 2) + 1). +!go : zoo.empty."
    assert check(text) == []
    assert needs_of(parse(text)) == ("close/0", "open/1", "zoo.dist/2", "zoo.empty/0", "zoo.feed/1")
    asl_action("zoo.feed")(lambda agent, x: None)
    assert "zoo.feed/1" not in needs_of(parse(text))


@pytest.fixture
def entry_point(monkeypatch, tmp_path):
    """Makes an installed distribution with an entry point."""

    def install(text, value):
        (tmp_path / "farm_actions.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        point = metadata.EntryPoint("farm.cows", value, actions.ENTRY_POINTS)
        monkeypatch.setattr(metadata, "entry_points", lambda group: [point])
        actions.load_entry_points.cache_clear()

    yield install
    sys.modules.pop("farm_actions", None)
    for registry in (actions.INTERNALS, actions._functions):
        registry.pop("farm.cows", None)


@pytest.mark.parametrize("value", ["farm_actions:cows", "farm_actions"])
def test_entry_point(entry_point, value):
    text = "from socialbot.bdi import asl_action\n@asl_action('farm.cows')\ndef cows(agent): return 7\n"
    entry_point(text if value == "farm_actions" else "def cows(agent): return 7\n", value)
    assert does("farm.cows(N); .print(N)") == ["7"]


def test_entry_point_that_cannot_be_imported(entry_point):
    entry_point("import nothing_like_this", "farm_actions")
    assert "entry point 'farm.cows'" in str(check("+!go <- farm.cows(N).")[0])


def test_a_result_remains_when_its_action_wakes_another_intention():
    text = "!sleep. +!sleep <- .suspend; .print(awake). +b(N) <- wake(N, R); .print(R); .print(R)."
    mas = Mas(me=text).until(1)

    def wake(agent, number):
        for intention in agent.intentions:
            if intention.suspended:
                intention.suspended = False
                agent.interpreter.ready.append(intention)
        return number + 6

    mas.me.add_action(wake)
    mas.me.add_text("b(1).")
    assert sorted(mas.until(1).lines) == ["7", "7", "awake"]


def test_output_has_no_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever a person or a message said may be printed."""
    engine = Engine("a", ManualClock(0))
    print_(engine, ("one\x1b[2J\r\u202etwo\nthree",), Trail())
    engine.out = RawOutput()
    print_(engine, ("\x9b2Jfour",), Trail())
    assert capsys.readouterr().out == "[a] one?[2J??two\nthree\n?2Jfour"


depths: list[int] = []
"""Depth of the stack when `watched` is closed."""


@asl_action("shop.watched", results=1)
def watched(agent):
    try:
        yield 1
    finally:
        depths.append(len(inspect.stack(0)))


@pytest.mark.parametrize("question", ["deep(400)", "not deep(400)"])
def test_deep_solutions_that_are_not_needed_are_closed_one_after_the_other(question):
    """Nested calls of C would end the process in Python 3.12."""
    depths.clear()
    text = f"deep(0) :- shop.watched(_).\ndeep(N) :- N > 0 & deep(N - 1).\n!go.\n+!go : {question} <- .print(yes).\n"
    assert said(text + "+!go <- .print(no).") == ["yes" if question[0] == "d" else "no"]
    [depth] = depths
    assert depth < 200


@pytest.fixture
def dotted():
    """Internal actions whose names begin with a dot, for one test."""

    @asl_action(".turn")
    async def turn(agent, angle):
        await asyncio.sleep(0)

    @asl_action(".shelf.of")
    def shelf_of(agent, fruit):
        yield from ("top", "low") if str(fruit) == "apple" else ("low",)

    yield
    for registry in (actions.INTERNALS, actions._functions):
        for name in (".turn", ".shelf.of"):
            registry.pop(name)


def test_an_internal_action_of_ones_own_may_begin_with_a_dot(dotted):
    text = (
        "!go. +!go <- .turn(90); for (.shelf.of(apple, S)) { .print(S) }; if (not .shelf.of(pear, top)) { .print(no) }."
    )
    assert check(text) == []
    engine, lines = Engine("me", WallClock()), []
    engine.out = lines.append
    engine.add_text(text)
    threading.Timer(0.5, engine.stop).start()
    engine.run()
    assert lines == ["top", "low", "no"]


def test_its_number_of_arguments_is_checked(dotted):
    (problem,) = check("+!go <- .turn.")
    assert problem.what.startswith(".turn takes 1 to 100 arguments")


@pytest.mark.parametrize("name", [".print", ".set.add"])
def test_internal_actions_of_agentspeak_are_not_replaced(name):
    with pytest.raises(RuleError, match=f"'{name}' cannot be the name of an action: AgentSpeak has it"):
        asl_action(name)(lambda agent: None)
