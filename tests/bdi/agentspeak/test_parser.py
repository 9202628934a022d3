from __future__ import annotations

import pytest

from socialbot.bdi.agentspeak import parse, parse_condition, parse_event, parse_literal, parse_plan, parse_term
from socialbot.bdi.literals import Change, Event, Literal, literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, For, Fork, If, Update, While
from socialbot.bdi.terms import (
    NOTHING,
    Atom,
    Call,
    Comparison,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    Negation,
    Truth,
    Variable,
    conjunction,
)
from tests.bdi.agentspeak.shape import shape

X, Y, Z = map(Variable, "XYZ")
a, b, c, d = map(literal, "abcd")
A, B, C, D = map(Do, (a, b, c, d))


def all_of(*conditions):
    return Conjunction(conditions)


TERMS = {
    "1": 1,
    "1.5": 1.5,
    ".5": 0.5,
    "1e3": 1000.0,
    "2.5E-1": 0.25,
    "-3": -3,
    "- 2.5": -2.5,
    '"x"': "x",
    r'"a\n\t\"\\"': 'a\n\t"\\',
    "yes": Atom("yes"),
    "true": Atom("true"),
    "'two words'": Atom("two words"),
    r"'it\'s'": Atom("it's"),
    "X": X,
    "_": Variable("_"),
    "_X": Variable("_X"),
    "éa": Atom("éa"),
    "Éa": Variable("Éa"),
    "[]": (),
    "[a, 1, [X]]": (Atom("a"), 1, (X,)),
    "[X|Y]": Cons((X,), Y),
    "[X,1|Y]": Cons((X, 1), Y),
    "[X|[1]]": (X, 1),
    "[X|[1|Y]]": Cons((X, 1), Y),
    "f(a, X)": literal("f", (Atom("a"), X)),
    "f(a)[source(bob), s]": literal("f", (Atom("a"),), (literal("source", (Atom("bob"),)), Atom("s"))),
    "a[s]": literal("a", (), (Atom("s"),)),
    "~a": literal("a", negated=True),
    "~f(1)[s]": literal("f", (1,), (Atom("s"),), negated=True),
    "f(lib.g(1))": literal("f", (literal("lib.g", (1,)),)),
    "X + 1": Expression("+", X, 1),
    "1 + 2": Expression("+", 1, 2),
    "X - Y - Z": Expression("-", Expression("-", X, Y), Z),
    "X - (Y - Z)": Expression("-", X, Expression("-", Y, Z)),
    "X + Y * Z": Expression("+", X, Expression("*", Y, Z)),
    "(X + Y) * Z": Expression("*", Expression("+", X, Y), Z),
    "X div 2 mod 3 / 4": Expression("/", Expression("mod", Expression("div", X, 2), 3), 4),
    "X ** Y ** Z": Expression("**", X, Expression("**", Y, Z)),
    "-X": Expression("-", 0, X),
    "-X ** 2": Expression("**", Expression("-", 0, X), 2),
    "X - -1": Expression("-", X, -1),
    "X-1": Expression("-", X, 1),
    "+X": X,
    "math.max(X, 2)": Call("math.max", X, 2),
    "math.pi": Call("math.pi"),
    "'math.pi'": Atom("math.pi"),
    ".length(X)": Call(".length", X),
    ".count(b(_))": Call(".count", literal("b", (Variable("_"),))),
    ".count(b(X) & X > 1) + 1": Expression(
        "+", Call(".count", all_of(literal("b", (X,)), Comparison(">", X, 1))), 1
    ),
    "distance(X) * 2": Expression("*", Call("distance", X), 2),
    "{+b}": Event(Change.ADDED, b),
    "{-!b[s]}": Event(Change.FAILED, literal("b", (), (Atom("s"),))),
    "{+b : c <- d}": Plan(Event(Change.ADDED, b), all_of(c), (D,)),
    "{@l +b}": Plan(Event(Change.ADDED, b), NOTHING, (), "l"),
}  # fmt: skip


@pytest.mark.parametrize("text", TERMS)
def test_a_term(text):
    assert shape(parse_term(text)) == shape(TERMS[text])


CONDITIONS = {
    "a": all_of(a),
    "true": all_of(Truth(True)),
    "false & true": all_of(Truth(False), Truth(True)),
    "~a": all_of(literal("a", negated=True)),
    "not a": all_of(Negation(a)),
    "not ~a(X)": all_of(Negation(literal("a", (X,), negated=True))),
    "not a & b": all_of(Negation(a), b),
    "not X > 1 & b": all_of(Negation(Comparison(">", X, 1)), b),
    "not (a & b)": all_of(Negation(all_of(a, b))),
    "a & b & c": all_of(a, b, c),
    "a & (b & c)": all_of(a, b, c),
    "a & b | c": all_of(Disjunction((all_of(a, b), all_of(c)))),
    "a | b | c": all_of(Disjunction((all_of(a), all_of(b), all_of(c)))),
    "a & (b | c)": all_of(a, Disjunction((all_of(b), all_of(c)))),
    "(a | b) & c": all_of(Disjunction((all_of(a), all_of(b))), c),
    "a(X)[source(Y)]": all_of(literal("a", (X,), (literal("source", (Y,)),))),
    "X + 1 > Y * 2 & a": all_of(Comparison(">", Expression("+", X, 1), Expression("*", Y, 2)), a),
    "X == yes": all_of(Comparison("==", X, Atom("yes"))),
    r"X \== Y": all_of(Comparison("!=", X, Y)),
    "X >= 1 & X <= 2 & X < 3": all_of(Comparison(">=", X, 1), Comparison("<=", X, 2), Comparison("<", X, 3)),
    "X = f(Y)": all_of(Comparison("=", X, literal("f", (Y,)))),
    "X =.. [Y|Z]": all_of(Comparison("=..", X, Cons((Y,), Z))),
    "X = lib.f(Y)": all_of(Comparison("=", X, Call("lib.f", Y))),
    ".length(X) > 2": all_of(Comparison(">", Call(".length", X), 2)),
    ".member(X, Y)": all_of(literal(".member", (X, Y))),
    ".length(X)": all_of(literal(".length", (X,))),
    ".count(a(X) & b, Y)": all_of(literal(".count", (all_of(literal("a", (X,)), b), Y))),
}  # fmt: skip


@pytest.mark.parametrize("text", CONDITIONS)
def test_a_condition(text):
    assert shape(parse_condition(text)) == shape(CONDITIONS[text])


EVENTS = {
    "+b": Event(Change.ADDED, b),
    "-b(X)": Event(Change.REMOVED, literal("b", (X,))),
    "+!b": Event(Change.WANTED, b),
    "-!b[error(X)]": Event(Change.FAILED, literal("b", (), (literal("error", (X,)),))),
    "+?b": Event(Change.ASKED, b),
    "-?b": Event(Change.UNANSWERED, b),
    "+~b": Event(Change.ADDED, literal("b", negated=True)),
    "+b[s, held_for(2.5)]": Event(Change.HELD, literal("b", (), (Atom("s"),)), 2.5),
    "+!b[held_for(5)]": Event(Change.WANTED, literal("b", (), (literal("held_for", (5,)),))),
}


@pytest.mark.parametrize("text", EVENTS)
def test_an_event(text):
    assert shape(parse_event(text)) == shape(EVENTS[text])


def together(*branches):
    return Fork(branches, every=True)


def first_of(*branches):
    return Fork(branches, every=False)


ABOVE = Comparison(">", X, 3)
BODIES = {
    "a": (A,),
    "a; b;": (A, B),
    "a(X, [1])[s]": (Do(literal("a", (X, (1,)), (Atom("s"),))),),
    "a[within(5), s]": (Do(literal("a", (), (Atom("s"),)), 5),),
    '.print("x", X)': (Do(literal(".print", ("x", X))),),
    ".fail": (Do(literal(".fail")),),
    "lib.act(1)": (Do(literal("lib.act", (1,))),),
    ".length(X)": (Do(literal(".length", (X,))),),
    "!a; !!b(X)": (Achieve(a), Achieve(literal("b", (X,)), apart=True)),
    "!a[within(X)]; !!a[within(2.5)]": (Achieve(a, limit_s=X), Achieve(a, apart=True, limit_s=2.5)),
    "!X; !!X; ?X; +X; -X": (Achieve(X), Achieve(X, apart=True), Ask(X), Update("+", X), Update("-", X)),
    "?a(X); ?(a & not b); ?X > 3": (Ask(literal("a", (X,))), Ask(all_of(a, Negation(b))), Ask(ABOVE)),
    "+a; -b; -+c; ++d; --a": tuple(map(Update, ("+", "-", "-+", "++", "--"), (a, b, c, d, a))),
    "+~a": (Update("+", literal("a", negated=True)),),
    "X > 3; X = Y + 1": (
        Constrain(all_of(ABOVE)), Constrain(all_of(Comparison("=", X, Expression("+", Y, 1))))
    ),
    "true; false": (Do(Truth(False)),),
    "b; true": (B, Do(Truth(True))),
    "not a": (Do(Negation(a)),),
    "(a & b) & c": (Do(Conjunction((all_of(a, b), c))),),
    "(X > 3); (X + 1) > 3": (
        Constrain(all_of(ABOVE)), Constrain(all_of(Comparison(">", Expression("+", X, 1), 3)))
    ),
    "(-X > 3)": (Constrain(all_of(Comparison(">", Expression("-", 0, X), 3))),),
    "(a | b) & c": (Do(all_of(Disjunction((all_of(a), all_of(b))), c)),),
    "if (a) { b }": (If(all_of(a), (B,)),),
    "if (a & X > 3) { } else { b; c }": (If(all_of(a, ABOVE), (), (B, C)),),
    "if (a) {b} elif (b) {c;} else {d} a": (If(all_of(a), (B,), (If(all_of(b), (C,), (D,)),)), A),
    "while (a) { b }; c": (While(all_of(a), (B,)), C),
    "for (.member(X, [1])) { a(X) } c": (For(all_of(literal(".member", (X, (1,)))), (Do(literal("a", (X,))),)), C),
    "a |&| b; c": (together((A,), (B,)), C),
    "a ||| b |&| c ||| d": (first_of((A,), (together((B,), (C,)),), (D,)),),
    "{ a; b } |&| { !c } |&| (+c; d)": (together((A, B), (Achieve(c),), (Update("+", c), D)),),
    "(a) ||| (?b)": (first_of((A,), (Ask(b),)),),
    "{ a; b }; c": (A, B, C),
    ".findall(X, a(X) & X > 3, Y)": (Do(literal(".findall", (X, all_of(literal("a", (X,)), ABOVE), Y))),),
    ".findall(X, X > 3, Y)": (Do(literal(".findall", (X, ABOVE, Y))),),
    ".findall(X, a(X), Y)": (Do(literal(".findall", (X, literal("a", (X,)), Y))),),
    ".findall(X, (not a(X)) , Y)": (Do(literal(".findall", (X, Negation(literal("a", (X,))), Y))),),
    ".wait({+b(X)}, 100)": (Do(literal(".wait", (Event(Change.ADDED, literal("b", (X,))), 100))),),
    ".add_plan({+b : c <- d})": (Do(literal(".add_plan", (Plan(Event(Change.ADDED, b), all_of(c), (D,)),))),),
    ".f({+b <- if (a) {b} c; {d} ||| a})": (
        Do(literal(".f", (Plan(Event(Change.ADDED, b), NOTHING, (If(all_of(a), (B,)), C, first_of((D,), (A,)))),))),
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", BODIES)
def test_a_body(text):
    plan = parse_plan(f"+!g <- {text}.")
    assert shape(plan) == shape(Plan(Event(Change.WANTED, literal("g")), NOTHING, BODIES[text]))


def test_a_label_with_known_and_unknown_annotations():
    plan = parse_plan("@l[atomic, x(1), priority(-3), stage(night), y] +b : c <- a.")
    assert (plan.label, plan.atomic, plan.priority, plan.stage) == ("l", True, -3, "night")
    assert shape(plan.annotations) == shape((literal("x", (1,)), Atom("y")))
    assert shape((plan.event, plan.condition, plan.body)) == shape((Event(Change.ADDED, b), conjunction(c), (A,)))


def test_a_plan_without_label_context_and_body():
    assert shape(parse_plan("+b.")) == shape(Plan(Event(Change.ADDED, b), NOTHING, ()))
    assert parse_plan('@[stage("late shift")] +b').stage == "late shift"


PROGRAM = """\
// beliefs
b(1)[source(x)].   # a remark
~b. /* more
than a line */ url("http://a#b", 'x//y').
near(X) :- at(X, D) & D < 2.
!g(1). !h.

@p +!g(X) : b(X)  // why
   <- a("1.5.");
      !h .
+!h.
"""


def test_a_program():
    program = parse(PROGRAM, "cat.asl")
    assert [str(item) for item in program.beliefs] == ["b(1)[source(x)]", "~b", 'url("http://a#b", x//y)']
    assert [str(item) for item in program.goals] == ["g(1)", "h"]
    assert [str(item.origin) for item in program.inferences] == ["cat.asl:5"]
    assert program.inferences[0].text == "near(X) :- at(X, D) & D < 2"
    assert [str(item.origin) for item in program.plans] == ["cat.asl:8", "cat.asl:11"]
    assert program.plans[0].text == '@p +!g(X) : b(X)  // why\n   <- a("1.5.");\n      !h'


def test_the_text_of_a_plan_reads_as_the_plan():
    first = parse(PROGRAM).plans[0]
    assert first.text is not None
    assert shape(parse_plan(first.text)) == shape(first)


def test_a_nested_plan_has_its_line_and_text():
    outer = parse("\n+b\n<- .add_plan(\n{ +c <- d }).").plans[0].body[0]
    assert isinstance(outer, Do)
    assert isinstance(outer.action, Literal)
    inner = outer.action.args[0]
    assert isinstance(inner, Plan)
    assert (str(inner.origin), inner.text) == ("<text>:4", "+c <- d")


def test_a_text_may_be_empty():
    program = parse(" // nothing\n")
    assert (program.beliefs, program.inferences, program.goals, program.plans) == ((), (), (), ())


def test_a_literal_may_have_variables():
    assert shape(parse_literal("b(X)[s]")) == shape(literal("b", (X,), (Atom("s"),)))


def test_an_atom_is_no_string():
    assert parse_term("yes") is Atom("yes")
    assert parse_term('"yes"') == "yes"
