from __future__ import annotations

from pathlib import Path

import pytest

from socialbot.bdi import Atom, Belief, Engine, Goal
from socialbot.bdi.agentspeak import AgentSpeakError, parse, read_program
from socialbot.bdi.agentspeak.loading import check, load, problems_of, warnings_of
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import literal
from socialbot.core.clock import ManualClock
from tests.bdi.mas import Mas, said

PRINTED = {
    "beliefs are found in the order of the text and newer ones before them":
        ("b(1). b(2). b(3). !g. +!g <- +b(0); .findall(X, b(X), L); .print(L).", ["[0,1,2,3]"]),
    "the events of beliefs come from last to first and before goals":
        ("!g(1). b(1). b(2). !g(2). +b(X) <- .print(b, X). +!g(X) <- .print(g, X).", ["b2", "b1", "g1", "g2"]),
    "goals may have variables":
        ("!g(X, X, _, [Y | T]). +!g(A, B, C, [1, 2]) <- A = 3; .print(B, C).", ["3_<no-value>"]),
    "goals without a plan fail": ("!g(1). -!g(X)[error(E)] <- .print(E).", ["no_relevant"]),
    "rules hold before the plans that use them are compiled":
        ("!g. +!g : c(X) <- .print(X). b(1). c(X) :- b(X).", ["1"]),
}  # fmt: skip


@pytest.mark.parametrize("name", PRINTED)
def test_prints(name):
    text, lines = PRINTED[name]
    assert said(text) == lines


def test_beliefs_and_goals_are_computed():
    text = "b(1 + 2, [2 * 3], f(7 mod 4)). c(math.max(1, 2), .length([a])). !g(2 ** 3). +!g(X) <- .print(X)."
    mas = Mas(me=text).until(0)
    assert mas.beliefs("me") == {"b(3, [6], f(3))": ("self",), "c(2, 1)": ("self",)}
    assert mas.lines == ["8"]


def test_beliefs_have_the_sources_that_they_are_given():
    mas = Mas(me="a. b[source(bob)]. c[sure]. ~d.").until(0)
    assert mas.beliefs("me") == {"a": ("self",), "b": ("bob",), "c[sure]": ("self",), "~d": ("self",)}


def test_texts_add_up():
    engine, lines = Engine("me", ManualClock()), []
    engine.out = lines.append
    engine.add_text("+!g : c(X) <- .print(c, X). +!g <- .print(none).")
    engine.achieve(literal("g"))
    engine.run_until_idle()
    engine.add_text("c(X) :- b(X). b(1).")
    engine.achieve(literal("g"))
    engine.run_until_idle()
    assert lines == ["none", "c1"]


class at(Belief): ...  # noqa: N801


class walk(Goal): ...  # noqa: N801


def test_text_and_python_share_beliefs_and_goals():
    engine, lines = Engine("me", ManualClock()), []
    engine.out = lines.append
    engine.add_text("+at(X) <- .print(at, X). +!walk(X) <- +at(X).")
    engine.believe(at(1))
    engine.achieve(walk(2))
    engine.run_until_idle()
    assert lines == ["at1", "at2"]


def test_registered_actions_are_called_with_values():
    engine, calls = Engine("me", ManualClock()), []
    engine.add_action(lambda engine, *args: calls.append(args), "move")
    engine.add_text('!g. +!g <- X = 2; move(left, X + 1, [a, "b"]); stop.')
    engine.run_until_idle()
    assert calls == [(Atom("left"), 3, (Atom("a"), "b"))]


# Mistakes: what is shown of them

MISTAKES = {
    "+!g <- .prnt(1).": ("1:8", "there is no internal action .prnt"),
    "+!g : .prnt(1).": ("1:7", "there is no internal action .prnt"),
    "+!g : .wait(1).": ("1:7", ".wait cannot be a condition"),
    "+!g <-\n  .print(a);\n  .length(1).": ("3:3", ".length takes 2 arguments"),
    "b(1).\n\n+!g <- X = math.foo(1).": ("3:12", "there is no function math.foo"),
    "+!g <- X = foo(1) + 2.": ("1:12", "there is no function foo"),
    "+!g <- .prnt(Y).": ("1:8", "there is no internal action .prnt"),
    "a(X) :- .foo(X).": ("1:9", "there is no internal action .foo"),
    "+b(X + 1).": ("1:4", "computes in its arguments"),
    "+!g <- .add_plan({+!h <- .foo}).": ("1:26", "there is no internal action .foo"),
    "+!g <- if (true) { for (b(X)) { .add_plan({+!h <- .foo}) } }.": ("1:51", "there is no internal action .foo"),
    "+!g <- .count(1, N).": ("1:8", "arguments of .count(1, N) are wrong"),
    "b(1": ("1:4", "expected ',' or ')'"),
    "b(math.foo(1)).": (None, "there is no function math.foo"),
    "b(math.sqrt(-1)).": (None, "cannot be computed"),
    "b(1 / 0).": (None, "cannot be computed"),
    "b(9 ** 9 ** 9 ** 9).": (None, "cannot be computed: a power of more than 1048576 bits"),
    "b((0 - 2) ** 0.5).": (None, "cannot be computed: -2 ** 0.5 is no real number"),
}


@pytest.mark.parametrize("text", MISTAKES)
def test_reports_an_error_with_its_position(text):
    place, what = MISTAKES[text]
    (problem,) = check(text, "me.asl")
    assert what in problem.what
    if place is not None:
        assert problem.where == f"me.asl:{place}"
        line, column = map(int, place.split(":"))
        shown, under = problem.what.split("\n")[-2:]
        assert shown == f"    {text.splitlines()[line - 1]}"
        assert under == f"    {' ' * (column - 1)}^"


WARNINGS = {
    "b.\n+!g : Y > 1 <- .print(Y).": ("2:7", "Y has no value in Y > 1"),
    "+!g <- +b(Y).": ("1:11", "Y has no value in +b(Y)"),
    "a(X) :- Y > X.": ("1:9", "Y has no value in Y > X"),
}


@pytest.mark.parametrize("text", WARNINGS)
def test_warns_of_a_variable_without_a_value(text):
    place, what = WARNINGS[text]
    program = parse(text, "me.asl")
    assert problems_of(program) == []
    (warning,) = warnings_of(program)
    assert what in warning.what
    assert warning.where == f"me.asl:{place}"


@pytest.mark.parametrize("read", [check, lambda text, file: _refused(text, file)], ids=["check", "load"])
@pytest.mark.parametrize(
    ("step", "column"),
    [(".nth(0, [a])", 4), ("if (b(X)) { .nth(0, [a]) }", 16), ("for (b(X)) { .nth(0, [a]) }", 17)],
)
def test_an_error_names_the_line_of_its_step(read, step: str, column: int) -> None:
    (problem,) = read(f"+!g\n <- .nth(0, [a], X);\n   .print(X);\n   {step};\n   .nth(0, [a], Y).", "me.asl")
    assert problem.where == f"me.asl:4:{column}"


def _refused(text: str, file: str) -> list[AgentSpeakError]:
    with pytest.raises(AgentSpeakError) as caught:
        load(Engine("me", ManualClock()), text, file)
    return [caught.value]


@pytest.mark.parametrize(
    ("step", "remedy"),
    [
        (".nth(0, [a])", "`.nth(I, L, X)`: X is the item"),
        (
            ".leng([a], N)",
            'did you mean .length? Otherwise, register one of your own in Python, with @asl_action(".leng")',
        ),
        (".zzz(1)", 'register one of your own in Python, with @asl_action(".zzz")'),
    ],
)
def test_a_wrong_internal_action_comes_with_its_usage(step: str, remedy: str) -> None:
    (problem,) = check(f"+!g <- {step}.")
    assert str(problem.remedy).startswith(remedy)


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("+!g(X) <-\n X > 2 & X < 5;\n  X > 2 | X == 1.", ["2:2", "3:3"]),
        ("+!g <-\n .print(end);\n +a(Y);\n -+b(Y).", ["3:5", "4:6"]),
        ("+!g <-\n !a;\n // !b\n if (true) {\n  !b\n }.", ["2:2", "5:3"]),
    ],
    ids=["condition", "variable", "goal"],
)
def test_a_warning_names_the_line_of_its_step(text: str, places: list[str]) -> None:
    assert [warning.where for warning in warnings_of(parse(text, "me.asl"))] == [f"me.asl:{place}" for place in places]


@pytest.mark.parametrize("step", ["+b(Y + 1)", "X = Y + 1", "Y + 1 > 1", "?b(Y + 1)"])
def test_a_step_with_a_variable_without_a_value_fails(step):
    engine, lines = Engine("me", ManualClock()), []
    engine.out = lines.append
    engine.add_text(f"!g. +!g <- {step}; .print(on). -!g[error(E)] <- .print(E).")
    engine.run_until_idle()
    assert lines == ["no_value"]


def test_reports_all_errors_in_source_order():
    text = "+!g <- .a.\na(X) :- .b(X).\n+!h <- .print(1).\n+!i <- .c."
    assert [problem.line for problem in check(text)] == [1, 2, 4]


@pytest.mark.parametrize("text", list(MISTAKES))
def test_adds_nothing_from_a_text_with_an_error(text):
    engine = Engine("me", ManualClock())
    with pytest.raises(AgentSpeakError):
        load(engine, f"ok(1). !start. c(X) :- ok(X). @l +!start <- .print(start).\n{text}")
    engine.run_until_idle()
    assert list(engine.library) == []
    assert not engine.library.inferences
    assert len(engine.beliefs) == 0
    load(engine, "@l +!start.")


def test_refuses_a_duplicate_label():
    engine = Engine("me", ManualClock())
    engine.add_text("@l +!g.")
    with pytest.raises(AgentSpeakError, match="the label l is taken") as caught:
        engine.add_text("@k +!g.\n@l +!h.")
    assert caught.value.line == 2
    assert [plan.label for plan in engine.library] == ["l"]


def test_checks_a_text_against_the_library():
    engine = Engine("me", ManualClock())
    engine.add_text("b(X) :- c(X).")
    text = "+!g : b(X) & X > 1 <- .print(X)."
    assert problems_of(parse(text), engine.library) == []


def test_a_text_without_mistakes_has_none():
    assert check("b(1). a(X) :- b(X). !g. +!g : a(X) <- .print(X).") == []


def test_the_caret_follows_tabs():
    (problem,) = check("+!g\n\t<- .print(a); .foo.")
    assert problem.what.split("\n")[-2:] == ["    \t<- .print(a); .foo.", "    \t              ^"]


@pytest.mark.parametrize("before", ["// .nothing(1)\n", "/* .nothing */ ", '.print(".nothing(1)"); ', "# .nothing\n"])
def test_an_error_about_a_name_stands_at_a_step_not_in_a_comment_or_a_string(before):
    text = f"+!g <- a; {before}.nothing(2)."
    with pytest.raises(AgentSpeakError) as caught:
        Engine("a", ManualClock()).add_text(text)
    line, column = caught.value.line, caught.value.column
    assert text.splitlines()[line - 1][column - 1 :] == ".nothing(2)."


LINES = """+!g(X) <-
   .print(a)
   ?b(Y)
   !sub(Y) // of b
   if (Y > 1) { .print(c)
                act }
   Z = 2
   for (b(W)) { .print(W) }
   .print(Z)."""


def test_a_step_in_a_line_of_its_own_needs_no_semicolon_before_it() -> None:
    steps = ".print(a); ?b(Y); !sub(Y); if (Y > 1) { .print(c); act } Z = 2; for (b(W)) { .print(W) } .print(Z)"
    program, written = parse(LINES, "me.asl"), parse(f"+!g(X) <- {steps}.")
    assert agentspeak(program.plans[0]) == agentspeak(written.plans[0])
    assert problems_of(program) == []
    warned = [warning for warning in warnings_of(program) if warning.what.startswith("there is no ';'")]
    assert [warning.where for warning in warned] == [
        f"me.asl:{place}" for place in ("3:4", "4:4", "5:4", "6:17", "8:4")
    ]
    assert not [warning for warning in warnings_of(written) if warning.what.startswith("there is no ';'")]


@pytest.mark.parametrize("step", ["+q(1)", "-q(1)", "{ b }", "and", "@l +!h", "not q(1)", "else { b }"])
def test_other_words_in_a_line_of_their_own_are_no_step(step: str) -> None:
    assert len(check(f"+!g <- a\n {step}.")) == 1


def test_check_warns_of_missing_semicolons_in_included_files(tmp_path: Path) -> None:
    (tmp_path / "inner.asl").write_text("+!g <- .print(a)\n .print(b).")
    (tmp_path / "outer.asl").write_text('{ include("inner.asl") } !g.')
    (warning,) = warnings_of(read_program(tmp_path / "outer.asl"))
    assert (warning.where, warning.what.splitlines()[0]) == (
        f"{tmp_path / 'inner.asl'}:2:2",
        "there is no ';' before this step",
    )
