from __future__ import annotations

import contextlib
import re
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import (
    AgentSpeakError,
    agentspeak,
    parse,
    parse_condition,
    parse_event,
    parse_literal,
    parse_plan,
    parse_term,
    rules,
)  # fmt: skip
from socialbot.core.clock import ManualClock
from socialbot.core.errors import RuleError
from tests.bdi.agentspeak.programs import SLOW
from tests.bdi.agentspeak.shape import shape
from tests.bdi.mas import said


def message(text, read=parse):
    with pytest.raises(AgentSpeakError) as caught:
        read(text, "p.asl")
    return str(caught.value)


def test_a_mistake_is_shown_in_its_line():
    assert message("+!stop.\n\n+!go <- move !stop.") == (
        "p.asl:3:14: expected '.' or ';' after a step, found '!'\n    +!go <- move !stop.\n                 ^"
    )


def test_the_place_is_known_to_programs_too():
    with pytest.raises(AgentSpeakError) as caught:
        parse("+!go\n  <- 1.")
    assert (caught.value.line, caught.value.column, caught.value.exit_code) == (2, 6, 4)


def test_the_caret_stays_below_its_word_after_tabs_and_comments():
    assert message("/* a\nb */ +b\n\t<-\ta /* c */ b.").splitlines()[1:] == [
        "    \t<-\ta /* c */ b.",
        "    \t  \t          ^",
    ]


def test_the_end_of_the_text_is_shown_after_the_last_word():
    assert message("+b <- a; b  \n\n") == (
        "p.asl:1:11: expected '.' or ';' after a step, found the end of the text\n    +b <- a; b\n              ^"
    )


def test_a_remedy_is_named():
    assert message("+b <- a\n+!c.") == (
        "p.asl:2:1: expected '.' or ';' after a step, found '+'\n    +!c.\n    ^\n"
        "  remedy: write '.' at the end of the plan before"
    )


MISTAKES = {
    "+b <- a(X) + c(X) <- d.": "p.asl:1:7: expected a step, found arithmetic",
    "+b <- a\n+c.": "p.asl:1:7: expected a number, a variable or a function as operand of '+', found 'a'",
    "b(1) c.": "p.asl:1:6: expected '.' or ':-' after a belief, found 'c'",
    "b(1).c(2).": "p.asl:1:5: expected '.' or ':-' after a belief, found '.c'",
    "b :- a": "p.asl:1:7: expected '.', '&' or '|' after a condition, found the end of the text",
    "b :- .": "p.asl:1:6: expected a term, found '.'",
    "b :- 1.": "p.asl:1:6: expected a condition, found a term",
    "b :- c + 1.": "p.asl:1:6: expected a number, a variable or a function as operand of '+', found 'c'",
    "b :- X < Y < Z.": "p.asl:1:12: expected one comparison, found '<'",
    "!g": "p.asl:1:3: expected '.' after a goal, found the end of the text",
    "!g[within(5)].": "p.asl:1:2: an initial goal has no limit",
    "+b c": "p.asl:1:4: expected ':', '<-' or '.' after the trigger, found 'c'",
    "+b : c d.": "p.asl:1:8: expected '<-', '.', '&' or '|' after the context, found 'd'",
    "+b <- .": "p.asl:1:7: expected a step, found '.'",
    "+b <- a;; c.": "p.asl:1:9: expected a term, found ';'",
    "+b <- 1.": "p.asl:1:7: expected a condition, found a term",
    "+b <- ~a.": "p.asl:1:7: an action has no '~'",
    "+b <- X is 1.": "p.asl:1:9: expected an operator, found 'is'",
    "+b <- !1.": "p.asl:1:8: expected a goal, found '1'",
    "+b <- !.print.": "p.asl:1:8: expected a goal, found '.print'",
    "+b <- !true.": "p.asl:1:8: expected a goal, found 'true'",
    "+b <- !g[within(1, 2)].": "p.asl:1:8: expected one argument of within(...)",
    "+b <- if a {b}.": "p.asl:1:10: expected '(' after 'if', found 'a'",
    "+b <- if (a) b.": "p.asl:1:14: expected '{' before the steps, found 'b'",
    "+b <- if (a) {b} else if (c) {d}.": "p.asl:1:23: expected '{' after 'else', found 'if'",
    "+b <- while (a; b) {}.": "p.asl:1:15: expected an operator or ')' after a condition, found ';'",
    "+b <- {a; b": "p.asl:1:12: expected ';' or '}' after a step, found the end of the text",
    "+b <- (a; b}.": "p.asl:1:12: expected ';' or ')' after a step, found '}'",
    "+b <- a |&| if (c) {d}.": "p.asl:1:13: expected a step, found 'if'",
    "+b <- while (c) {d} ||| a.": "p.asl:1:21: expected a step, found '|||'",
    "+b <- .f({+c <- d.}).": "p.asl:1:18: expected '}' or ';' after a step, found '.'",
    "+b <- !g[witin(3)].": "p.asl:1:8: the annotation 'witin' has no meaning",
    "+b <- a(1)[hard_dedline(3)].": "p.asl:1:7: the annotation 'hard_dedline' has no meaning",
    "@p[atomc] +b <- a.": "p.asl:1:3: the annotation 'atomc' has no meaning",
    "@p[pirority(3)] +b <- a.": "p.asl:1:3: the annotation 'pirority' has no meaning",
    "+b[hold_for(3)] <- a.": "p.asl:1:1: the annotation 'hold_for' has no meaning",
    "+b <- a([X > 1]).": "p.asl:1:12: expected ',', '|' or ']' in a list, found '>'",
    "+b <- a([(X > 1)]).": "p.asl:1:10: expected a term, found '('",
    "+b <- a().": "p.asl:1:9: expected an argument of 'a', found ')'",
    "+b <- a(1, ).": "p.asl:1:12: expected a term, found ')'",
    "+b <- a([1, 2).": "p.asl:1:14: expected ',', '|' or ']' in a list, found ')'",
    "+b <- a([1|2]).": "p.asl:1:12: expected a variable or a list after '|', found '2'",
    "+b <- a([X|Y, Z]).": "p.asl:1:13: expected ']' after the tail of a list, found ','",
    "+b <- a[x": "p.asl:1:10: expected ',', '|' or ']' after an annotation, found the end of the text",
    "+b <- a[x|1].": "p.asl:1:11: expected a variable, of letters, digits and _, found '1'",
    "+b <- -+{+!g}.": "p.asl:1:9: '-+' cannot change a plan or rule",
    "+b <- +{a; c}.": "p.asl:1:8: '+' cannot change a plan or rule",
    "+b <- .f({a c}).": "p.asl:1:13: expected ';' or '}' after a step, found 'c'",
    "+b <- .f({c :- d; e}).": "p.asl:1:17: expected '}', '&' or '|' after a condition, found ';'",
    "{ include(x) }": "p.asl:1:3: expected the name of a file",
    "{ include }": "p.asl:1:3: the directive 'include' takes 1 to 2 arguments",
    '{ include("x.asl" }': "p.asl:1:19: expected ',' or ')', found '}'",
    "{ namespace(1) }": "p.asl:1:3: expected a namespace",
    "{ namespace(a, b) }": "p.asl:1:3: expected a namespace",
    "{ begin namespace(a) } b.": "p.asl:1:26: expected '{ end }' of a namespace, found the end of the text",
    "b. { end }": "p.asl:1:4: expected a directive before '{ end }', found '{'",
    "{ begin register_function(1) } b. { end }": "p.asl:1:9: the directive 'register_function' has no content",
    "{ register_function(f) }": "p.asl:1:3: expected the name of a function, with a dot",
    '{ register_function("math.f") }': "p.asl:1:3: expected the name of a function, with a dot",
    '{ register_function("a.f", x, y) }': "p.asl:1:3: expected the name, the number of arguments and the rule",
    '+b <- a("x).': "p.asl:1:9: expected a term, found '\"'",
    '+b <- a("\\x").': "p.asl:1:9: unknown escape '\\x'",
    "+b <- a($).": "p.asl:1:9: expected a term, found '$'",
    "+b <- a /* x": "p.asl:1:9: expected '.' or ';' after a step, found '/*'",
    "+b <- a(X && Y).": "p.asl:1:11: expected ',' or ')', found '&&'",
    "+b : a || c.": "p.asl:1:8: expected '<-', '.', '&' or '|' after the context, found '||'",
    "+b : X != 1.": "p.asl:1:8: expected an operator, found '!='",
    "+if.": "p.asl:1:2: expected a name, found 'if'",
    "~~a.": "p.asl:1:2: expected a name after '~', found '~'",
    "+.": "p.asl:1:2: expected a belief, or '!' or '?' and a goal, found '.'",
    "+!(a).": "p.asl:1:3: expected a goal, found '('",
    "+b(1e999).": "p.asl:1:4: this number is too large",
    f"+b({'9' * 5000}).": "p.asl:1:4: this number is too large",
    "+b[held_for(X)].": "p.asl:1:1: expected a number of seconds in held_for(...)",
    "@l[priority(x)] +b.": "p.asl:1:3: expected an integer, as in priority(3)",
    "@l[stage(1)] +b.": "p.asl:1:3: expected a name, as in stage(night)",
    "@l +b. @k +b.\n@l +c.": "p.asl:2:1: the label 'l' is already used in line 1",
    "@l b.": "p.asl:1:4: expected '+' or '-' and a trigger, found 'b'",
    "9.": "p.asl:1:1: expected a belief, a goal or a plan, found '9'",
    "+b(" + "(" * 5000: "p.asl:1:",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake(text):
    expected = MISTAKES[text]
    assert message(text).startswith(f"{expected}\n" if expected[-1] != ":" else expected)


UNSUPPORTED = {
    '{ include("x.asl") }': "an include in a text without a place is not supported",
    "{ begin x(1) } b. { end }": "the directive 'x' is not supported",
    "{ x }": "the directive 'x' is not supported",
    "+b <- -<c.": "'-<' is not supported",
    "+b <- a(X(1)).": "a variable with arguments is not supported",
    "+b <- a(`x).": "a backquote is not supported",
    "+b : .python(near, X).": "a Python function in a condition has no counterpart in AgentSpeak",
}  # fmt: skip


@pytest.mark.parametrize("text", UNSUPPORTED)
def test_unsupported_constructs_are_named(text):
    first = message(text).splitlines()[0]
    assert re.fullmatch(r"p\.asl:1:\d+: " + re.escape(UNSUPPORTED[text]), first)


@pytest.mark.parametrize(
    ("read", "text"),
    [(parse_plan, "+b. +c."), (parse_literal, "b c"), (parse_term, "a, b"), (parse_term, ""), (parse_literal, "X"),
     (parse_condition, "a b"), (parse_event, "+b : c"), (parse_event, "b"), (parse_plan, "b")],
)  # fmt: skip
def test_no_text_is_left_over(read, text):
    assert "expected" in message(text, read)


VOCABULARY = r"""
a b X _ _Y 1 2.5 .5 1e3 "s" 'q' " ' \ + - * / ** div mod ++ -- -+ +< = == \== =.. < <= > >= ! !! ? ~ not & | |&| |||
( ) [ ] { } , ; . : :: :- <- <: @ @l atomic priority(1) stage(x) if elif else while for true false .print .length
math.max f( a( .f( g(X) within(5) held_for(5) source(X) // # /* */ $ ` ^ é ² 9 !g ?b +b -b +!g(X) <-a; {+b} [X|Y] (a)
"""
WORDS = st.sampled_from(("\n", "\t", *VOCABULARY.split()))
TEXTS = st.lists(WORDS, max_size=25).flatmap(lambda words: st.sampled_from(("", " ")).map(lambda gap: gap.join(words)))
LIKELY = st.lists(WORDS, max_size=8).map(" ".join)


def listed(text):
    """The text as a list: plans and events are in braces only where they are terms among others."""
    return parse_term(text if text[:1] == "[" else f"[{text}]")


@SLOW
@given(TEXTS | st.text() | LIKELY.map(lambda text: f"+b : c <- {text}.") | LIKELY.map(lambda text: f"+b : {text}."))
def test_any_text_is_read_and_printed_back_or_refused(text):
    for read in (parse_plan, parse_literal, listed, parse_condition, parse_event):
        try:
            found = read(text)
        except AgentSpeakError:
            continue
        assert shape(read(agentspeak(found))) == shape(found)
    try:
        program = parse(text)
    except AgentSpeakError:
        return
    for plan in program.plans:
        assert shape(parse_plan(agentspeak(plan))) == shape(plan)
        assert rules(plan)


@pytest.mark.parametrize("unit", [" ", "\n", "/* ", "// x\n", '"', "'", "(", "a.b."])
def test_a_long_text_is_read_or_refused_soon(unit):
    begun = time.process_time()
    with contextlib.suppress(AgentSpeakError):
        parse("+b <- a." + unit * 20_000)
    assert time.process_time() - begun < 2.0


@pytest.mark.parametrize(
    "text",
    [
        "!a. +!a <- X = " + "1 + " * 5000 + "1.",
        "!a. +!a : " + "p & " * 5000 + "p <- .print(x).",
        "q :- " + "p & " * 5000 + "p.",
        "q :- " + "not p & " * 5000 + "p.",
        "q :- a(" + "1 * " * 5000 + "1).",
    ],
)
def test_a_chain_of_operators_without_end_is_refused(text):
    assert "more than 100 operands" in message(text)


def compile_plans(text):
    engine = Engine("me", ManualClock())
    engine.add_text(text)
    engine.compile_plans()


@pytest.mark.parametrize("depth", [101, 5000])
@pytest.mark.parametrize(
    "text",
    [
        lambda depth: f"!a. +!a : {'not ' * depth}p <- .print(x).",
        lambda depth: f"q :- {'(p | ' * depth}p{')' * depth}.",
        lambda depth: f"!a. +!a <- X = 1{' ** 1' * depth}.",
        lambda depth: f"!a. +!a <- if (p) {{ .print(a) }}{' elif (p) { .print(b) }' * depth}.",
        lambda depth: f"!a. +!a <- {'for (p) { ' * depth}.print(b){' }' * depth}.",
        lambda depth: f"!a. +!a <- {'+{ +!b <- ' * depth}.print(b){' }' * depth}.",
    ],
)
def test_parts_in_each_other_without_end_are_refused(text, depth):
    begun = time.process_time()
    with pytest.raises(AgentSpeakError, match="more than 100 parts in each other"):
        compile_plans(text(depth))
    assert time.process_time() - begun < 2.0


@pytest.mark.parametrize(
    "body",
    [
        "for (p) { " * 30 + ".print(a)" + " }" * 30,
        "if (p) { .print(a) }" + " elif (p) { .print(b) }" * 99,
        "?" + ".findall(Y, " * 60 + "p(Y)" + ", L)" * 60,
    ],
)
def test_parts_in_each_other_that_python_cannot_compile_are_refused(body):
    with pytest.raises(RuleError, match=r"more than 50 conditions in each other|nested too deeply"):
        compile_plans(f"+!a <- {body}.")


def test_the_longest_chain_of_operators_runs():
    assert said("!a. +!a <- X = " + "1 + " * 99 + "1; .print(X).") == ["100"]
    assert said("p. q :- " + "p & " * 99 + "p. !a. +!a : q & " + "p & " * 98 + "p <- .print(yes).") == ["yes"]
    assert said("p. q :- " + "z | " * 500 + "p. !a. +!a : q <- .print(yes).") == ["yes"]


def test_rules_that_choose_among_plans_are_refused():
    engine = Engine("me", ManualClock())
    with pytest.raises(AgentSpeakError, match=r"(?s)choose among plans have no effect.*priority"):
        engine.add_text("select__option(E, I, P, U) :- true.")
