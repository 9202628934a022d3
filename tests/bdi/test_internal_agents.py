"""Internal actions on agents, services, files and collections."""

from __future__ import annotations

import pytest

from socialbot.bdi import Engine
from tests.bdi.mas import Mas, does, said

MAKER = '!go. +!go <- .create_agent(bob, "bob.asl"); .wait(50); .all_names(L); .print(L).'


def starting(mas, **texts):
    """Let the society load agents from texts."""

    def start(name, file, creator):
        engine = Engine(name, mas.clock)
        engine.out = lambda text: mas.hear(name, text)
        if file is not None:
            engine.add_text(texts[file.removesuffix(".asl")], file)
        return engine

    mas.society.starter = start
    return mas


def test_an_agent_is_created_from_a_file():
    mas = starting(Mas(ann=MAKER), bob="!hello. +!hello <- .print(hello).").until(1)
    assert mas.said == [("bob", "hello"), ("ann", "[ann,bob]")]


def test_a_name_that_is_taken_gets_a_number():
    mas = starting(Mas(ann="!go. +!go <- .create_agent(bob); .create_agent(bob); .create_agent(X); .print(X)."))
    mas.until(1)
    assert list(mas.society.agents) == ["ann", "bob", "bob_1", "x"]
    assert mas.lines == ["x"]


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        ('.create_agent(bob, "bob.asl")', "action_failed"),
        (".create_agent(bob, bob)", "wrong_arguments"),
        ('.create_agent(bob, "bob.asl", [agentClass("a.B")])', "wrong_arguments"),
        (".kill_agent(nobody)", "ia_failed"),
    ],
)
def test_failures(call, reason):
    assert said(f"!go. +!go <- {call}. -!go[error(E)] <- .print(E).") == [reason]


def test_an_engine_alone_has_no_other_agents():
    lines = []
    mas = Mas()
    engine = Engine("me", mas.clock)
    engine.out = lines.append
    engine.add_text("!go. +!go <- .create_agent(bob). -!go[error_msg(M)] <- .print(M).")
    engine.run_until_idle()
    assert lines == [".create_agent: me is in no society"]


def test_a_killed_agent_does_nothing_more():
    mas = Mas(
        ann="!go. +!go <- .wait(50); .kill_agent(bob); .wait(500); .all_names(L); .print(L).",
        bob="!tick. +!tick <- .wait(20); .print(tick); !tick.",
    ).until(5)
    assert mas.said == [("bob", "tick"), ("bob", "tick"), ("ann", "[ann]")]


def test_an_agent_can_kill_itself():
    mas = Mas(ann="!go. +!go <- .print(a); .kill_agent(ann); .print(b).").until(1)
    assert mas.society.agents == {}
    assert mas.lines[0] == "a"


def test_a_killed_agent_can_be_told_before():
    mas = Mas(
        ann="!go. +!go <- .kill_agent(bob, 100); .wait(50); !all; .wait(100); !all. +!all <- .all_names(L); .print(L).",
        bob="+jag_shutting_down(T) <- .print(soon, T).",
    ).until(5)
    assert mas.said == [("bob", "soon100"), ("ann", "[ann,bob]"), ("ann", "[ann]")]


def test_a_clone_has_plans_rules_and_beliefs_but_no_intentions():
    mas = Mas(
        ann="""b(1). c(X) :- b(X). !go.
        +!go <- +b(2); .clone(twin); .wait(20); .send(twin, achieve, tell); .wait(100); .print(end).
        +!tell <- .my_name(N); .findall(X, c(X), L); .sort(L, S); .print(N, S)."""
    ).until(1)
    assert mas.lines == ["end"] or "end" in mas.lines
    assert mas.beliefs("twin") == {"b(1)": ("self",), "b(2)": ("self",)}


def test_subscribers_learn_of_present_and_later_providers():
    mas = Mas(
        ann="""!go. +!go <- .wait(20); .df_subscribe("tea"); .wait(100); .df_search("tea", L); .print(L).
        +provider(A, S)[source(F)] <- .print(A, S, F).""",
        bob='!go. +!go <- .df_register("tea").',
        cid='!go. +!go <- .wait(50); .df_register("tea", "drinks"); .wait(200); .df_deregister("tea").',
    ).until(1)
    assert mas.lines == ["bobteadf", "cidteadf", "[bob,cid]"]
    assert mas.society.services == {"tea": {"bob": None}}
    mas.society.kill("bob")
    assert mas.society.services == {"tea": {}}


def test_plans_and_rules_are_printed():
    text = """c(X) :- b(X) & X > 1.
    @one +!x(1) <- .print(1).
    +!y <- b.
    !go. +!go <- .list_rules; .list_plans({+!x(_)})."""
    assert said(text) == [
        "c(X)[source(self)] :- (b(X) & (X > 1))",
        '@one[source(self),url("file:me.asl")] +!x(1) <- .print(1).',
    ]


def test_all_plans_are_listed_by_file():
    text = "@one +!x(X) <- .print(X). !go. +!go <- .add_plan({@two +!y}); .list_plans."
    (listed,) = said(text)
    plain = '@one[source(self),url("file:me.asl")] +!x(X) <- .print(X).\n'
    rest = '@p__1[source(self),url("file:me.asl")] +!go <- .add_plan({ @two +!y }); .list_plans.\n'
    assert listed == f'\n\n// plans from file:me.asl\n\n{plain}{rest}@two[source(self),url("file:me.asl")] +!y.\n\n'


def test_files_are_listed(tmp_path):
    (tmp_path / "sub").mkdir()
    for name in ("b.asl", "sub/a.asl", "c.txt"):
        (tmp_path / name).write_text("")
    body = f'.list_files("{tmp_path}", ".*[.]asl", L); .print(L)'
    assert does(body) == [f'["{tmp_path}/b.asl","{tmp_path}/sub/a.asl"]']


def test_formats():
    assert does('.printf("%s: %5.1f%n", a, 2.25)') == ["a:   2.2"]
    assert does('.printf("%d", a)') == ["failed wrong_arguments"]
    assert does('X = 5; .puts("a #{X} #{f(X)} #{")') == ["a 5 #{f(X)} #{"]  # only names are replaced


def test_a_message_carries_a_copy_of_a_set():
    mas = Mas(
        ann="!go. +!go <- .set.create(S); .set.add(S, 1); .send(bob, tell, s(S)); .set.add(S, 2); .print(S).",
        bob="+s(S) <- .wait(20); .print(S).",
    ).until(1)
    assert sorted(mas.said) == [("ann", "{1,2}"), ("bob", "{1}")]


@pytest.mark.parametrize(
    "body",
    [".set.add([], 1)", ".set.create(S); .set.add(S, X)", ".map.create(M); .map.put(M, X, 1)", ".queue.head(5, X)"],
)
def test_wrong_collections(body):
    assert does(body)[-1] in ("failed wrong_arguments", "failed no_value")


def test_a_goal_replaced_by_the_last_step_of_its_plan_is_found_by_programs_that_look_for_goals():
    text = "!a. !stop. +!a <- !b. +!b <- !c. +!c <- .wait(100); .print(never). +!stop <- .wait(10); .drop_intention(b)."
    assert said(text) == []


def test_recursion_in_the_last_step_stays_flat_in_programs_that_look_for_goals():
    mas = Mas(me="!count(20000). +!count(0) <- .print(end). +!count(N) : not .intend(never) <- !count(N - 1).")
    depths = [0]
    while mas.society.run_until_idle(1, turns=1):
        depths += [len(intention.frames) for intention in mas.me.intentions]
    assert max(depths) < 5
    assert mas.lines == ["end"]


def test_idle_agents_are_told():
    mas = Mas(
        bob="+jag_sleeping <- .print(idle); .wait(10). +jag_awaking <- .print(awake). +hi <- .print(hi).",
        ann="!go. +!go <- .wait(1000); .send(bob, signal, hi).",
    )
    assert mas.until(5).lines == ["idle", "awake", "hi", "idle"]


def test_all_agents_are_told_before_the_system_stops():
    mas = Mas(
        bob="+jag_shutting_down(T) <- .print(bob, T).",
        ann="!go. +!go <- .stopMAS(100). +jag_shutting_down(T) <- .print(ann, T).",
    )
    assert sorted(mas.until(0.05).lines) == ["ann100", "bob100"]
