"""Programs of several files: includes, namespaces and registered functions."""

from __future__ import annotations

import pytest

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import AgentSpeakError, IncludePaths, parse, read_program
from socialbot.bdi.agentspeak.loading import check, load
from socialbot.core.clock import ManualClock
from tests.bdi.mas import said


@pytest.fixture
def written(tmp_path):
    """Write files; return the first."""

    def write(**texts):
        for name, text in texts.items():
            file = tmp_path / f"{name.replace('__', '/')}.asl"
            file.parent.mkdir(exist_ok=True)
            file.write_text(text)
        return tmp_path / f"{next(iter(texts)).replace('__', '/')}.asl"

    return write


def said_by(file, **paths):
    engine, lines = Engine("me", ManualClock()), []
    engine.out = lines.append
    load(engine, file.read_text(), str(file), IncludePaths(**paths))
    engine.run_until_idle()
    return lines


def mistake(file, **paths):
    with pytest.raises(AgentSpeakError) as caught:
        read_program(file, IncludePaths(**paths))
    return str(caught.value)


# Includes


def test_includes_a_file_next_to_the_program(written):
    main = written(main='{ include("parts/a.asl") } !go.', parts__a='{ include("b.asl") } b(1).',
                   parts__b="+!go : b(X) <- .print(X).")  # fmt: skip
    assert said_by(main) == ["1"]


def test_an_included_file_keeps_its_name_and_lines(written):
    main = written(main='{ include("a.asl") }\n+!h.', a="\n+!go.")
    program = read_program(main)
    origins = [str(plan.origin) for plan in program.plans]
    assert [origin.rpartition("/")[2] for origin in origins] == ["a.asl:2", "main.asl:2"]


def test_an_error_of_an_included_file_names_that_file(written):
    main = written(main='{ include("a.asl") }', a="b.\n+!go <- .prnt(1).")
    (problem,) = check(main.read_text(), str(main), IncludePaths())
    assert str(problem.where).endswith("a.asl:2:9")


def test_finds_included_files_in_further_folders(written, tmp_path):
    main = written(main='{ include("a.asl") } !go.', lib__a="+!go <- .print(a).")
    assert said_by(main, folders=(tmp_path / "lib",)) == ["a"]
    assert "the included file a.asl does not exist" in mistake(main)


def test_finds_included_files_below_a_configured_root(written, tmp_path):
    main = written(main='{ include("$libJar/inc/a.asl") } !go.', inc__a="+!go <- .print(a).")
    assert said_by(main, roots={"libJar": tmp_path}) == ["a"]
    message = mistake(main)
    assert "the root $libJar of the included file $libJar/inc/a.asl is not configured" in message
    assert "--root libJar=FOLDER" in message


def test_refuses_a_cycle_of_includes(written):
    main = written(main='{ include("a.asl") }', a='{ include("b.asl") }', b='b.\n{ include("a.asl") }')
    assert "b.asl:2:3: the file includes itself: a.asl -> b.asl -> a.asl" in mistake(main)


def test_includes_a_labelled_plan_once(written):
    main = written(main='{ include("a.asl") } { include("b.asl") }', a='{ include("c.asl") }', b='{ include("c.asl") }',
                   c="@l +!go.")  # fmt: skip
    assert len(read_program(main).plans) == 1


def test_the_same_plan_may_be_written_twice(written):
    plan = "@l[atomic] +!g(X) : b(X) <- .print(X)."
    assert len(read_program(written(main=f"{plan}\n{plan.replace(' : ', '  :  ')}")).plans) == 1


def test_refuses_the_label_of_another_file(written):
    main = written(main='@l +!g.\n{ include("a.asl") }', a="@l +!h.")
    assert "a.asl:1:1: the label 'l' is already used in " in mistake(main)


def test_a_text_without_a_place_reads_no_file():
    with pytest.raises(AgentSpeakError, match="an include in a text without a place"):
        parse('{ include("/etc/passwd") }')


# Namespaces


def test_a_namespace_holds_the_names_of_an_included_file(written):
    main = written(
        main='{ include("counter.asl", first) } { include("counter.asl", second) }\n'
        "!go. +!go <- !first::add; !first::add; !second::add; ?first::count(X); ?second::count(Y); .print(X, Y).",
        counter="count(0). +!add : count(X) <- -+count(X + 1); .print(this).",
    )
    assert said_by(main) == ["this", "this", "this", "21"]


def test_names_of_terms_and_internal_actions_have_no_namespace():
    text = """
    { begin namespace(n) }
    b(a, f(1)).
    !go.
    +!go : b(X, f(Y)) & X = a & X == a <- .print(X, Y); +c(X); ?n::c(Z); .findall(W, ::c(W), L); .print(Z, L).
    { end }
    b(x, f(2)).
    """
    assert said(text) == ["a1", "a[a]"]


def test_a_namespace_ends_at_its_end():
    text = "{ begin namespace(n) } b. { end } !go. +!go : b <- .print(in). +!go : n::b & not b <- .print(out)."
    assert said(text) == ["out"]


def test_the_default_namespace_and_that_of_the_text_have_names():
    text = "{ begin namespace(n) } b(1). !go. +!go <- ?this_ns::b(X); ?default::b(Y); .print(X, Y). { end } b(2)."
    assert said(text) == ["12"]


def test_a_local_namespace_is_not_that_of_other_texts():
    engine, lines = Engine("me", ManualClock()), []
    engine.out = lines.append
    engine.add_text("{ begin namespace(n, local) } b(1). { end } n::b(2). +!first <- ?n::b(X); .print(X).")
    engine.add_text("+!second : n::b(X) <- .print(X). +!second <- .print(none). !first. !second.")
    engine.run_until_idle()
    assert lines == ["1", "none"]


def test_actions_have_no_namespace():
    engine, calls = Engine("me", ManualClock()), []
    engine.add_action(lambda engine, x: calls.append(x), "move")
    engine.add_text("{ begin namespace(n) } !go. +!go <- move(1); other::move(2). { end }")
    engine.run_until_idle()
    assert calls == [1, 2]


def test_a_literal_is_printed_with_its_namespace():
    assert said("!go. +!go <- X = n::b(1); .print(X); +n::c; .print({+n::c}).") == ["n::b(1)", "{ +n::c }"]


def test_an_event_has_the_namespace_of_its_belief():
    text = "!go. +!go <- +n::b(1); +b(2). +n::b(X) <- .print(n, X). +b(X) <- .print(X)."
    assert said(text) == ["n1", "2"]


def test_a_namespace_may_be_a_variable():
    text = """one::b(1). two::b(2). b(3).
    !go.
    +!go <- !see(one); !see(two); !see(default); +new::c(4); !name(b(X)).
    +!see(N) : N::b(X) <- .print(N, X); +N::seen(X); ?N::seen(Y); !N::end(Y); -N::seen(_).
    +!N::end(X) : N::seen(X) <- .print("end ", N, X).
    -N::seen(X) <- .print("no longer ", N, X).
    +N::c(X) <- .print(N, X).
    +!name(B) <- .findall(N, N::b(2), L); .print(L)."""
    assert said(text) == [
        "one1", "end one1", "no longer one1", "two2", "end two2", "no longer two2", "default3", "end default3",
        "no longer default3", "new4", "[two]",
    ]  # fmt: skip


# Functions


def test_a_registered_function_is_computed_by_its_rule():
    text = """{ register_function("my.twice", 1, "twice") }
    twice(X, Y) :- Y = 2 * X.
    !go. +!go : 6 == my.twice(3) <- X = my.twice(5) + 1; .print(X, " ", my.twice(my.twice(1)))."""
    assert said(text) == ["11 4"]


def test_a_function_without_a_solution_fails_its_step():
    text = '{ register_function("my.f", 1, "f") } !go. +!go <- X = my.f(1) + 1. -!go[error(E)] <- .print(E).'
    assert said(text) == ["wrong_arguments"]


def test_an_unknown_function_with_a_library_fails_its_step():
    assert said("!go. +!go <- X = jia.dist(1, 2) + 1. -!go[error_msg(M)] <- .print(M).") == [
        "there is no function jia.dist/2; register it in Python"
    ]


# Goals that a program needs from outside


def test_an_unknown_internal_action_of_a_library_fails_where_it_is_used():
    text = "!a. !b. +!a <- ia.edge(1). -!a[error(E)] <- .print(E). +!b : ia.edge(1, X). +!b <- .print(b)."
    assert said(text) == ["action_failed", "b"]
