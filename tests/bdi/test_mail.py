from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Engine, Goal, message, send
from socialbot.bdi.literals import literal
from socialbot.bdi.trace import Record
from socialbot.core.clock import ManualClock
from tests.bdi.lab import Lab, X, Y, Z, do, go, p
from tests.bdi.mas import Mas


def test_told_belief_has_the_sender_as_source():
    mas = Mas(
        a="!g. +!g <- .send(b, tell, at(home, 1)); .send(b, tell, rain); .send(b, tell, [x(1), x(2)]).", b="x(1)."
    )
    mas.until(1)
    assert mas.beliefs("b") == {"at(home, 1)": ("a",), "rain": ("a",), "x(1)": ("self", "a"), "x(2)": ("a",)}


def test_plans_see_the_source_of_a_told_belief():
    mas = Mas(a="!g. +!g <- .send(b, tell, x(1)).", b="+x(X)[source(S)] <- .print(X, S).")
    assert mas.until(1).said == [("b", "1a")]


@pytest.mark.parametrize("telling", [".send(a, tell, bid(M))", ".broadcast(tell, bid(M))", ".send(a, tell, [bid(M)])"])
def test_plans_for_a_message_see_no_later_ones(telling):
    sender = f"!s. +!s : .my_name(M) <- {telling}."
    senders = {f"p{i}": sender for i in range(5)}
    mas = Mas(a="+bid(_) : .count(bid(_)[source(_)], N) <- .print(N).", **senders).until(1)
    assert [line for name, line in mas.said if name == "a"] == ["1", "2", "3", "4", "5"]


def test_goals_and_beliefs_of_messages_are_handled_in_their_order():
    sender = "!s. +!s : .my_name(M) <- .send(a, achieve, go(M)); .send(a, tell, bid(M))."
    counting = """
        +!go(X) : .count(gone(_), N) <- +gone(X); .print(go(N)).
        +bid(X) : .count(bid(_)[source(_)], 5) <- .print(all).
    """
    mas = Mas(a=counting, **{f"p{i}": sender for i in range(5)}).until(1)
    assert mas.lines == ["go(0)", "go(1)", "go(2)", "go(3)", "go(4)", "all"]


def test_message_keeps_annotations_except_sources():
    mas = Mas(a="!g. +!g <- .send(b, tell, x(1)[sure, source(c)]).", b="+x(X)[sure, source(S)] <- .print(S).").until(1)
    assert mas.lines == ["a"]
    assert mas.beliefs("b") == {"x(1)[sure]": ("a",)}


def test_untell_removes_the_sender_as_source():
    mas = Mas(
        a="!g. +!g <- .send(b, tell, x(1)); .send(b, tell, x(2)); .send(b, untell, x(1)); .send(b, untell, x(9)).",
        b="x(2). -x(X)[source(S)] <- .print(X, S).",
    ).until(1)
    assert mas.lines == ["1a"]
    assert mas.beliefs("b") == {"x(2)": ("self", "a")}


def test_untelling_with_a_variable_takes_the_newest():
    mas = Mas(a="!g. +!g <- .send(b, tell, x(1)); .send(b, tell, x(2)); .send(b, untell, x(_)).", b="").until(1)
    assert mas.beliefs("b") == {"x(1)": ("a",)}


def test_a_goal_that_is_asked_for_is_pursued_in_an_intention_of_its_own():
    mas = Mas(a="!g. +!g <- .send(b, achieve, do(1)); .send(b, achieve, do(X)); .print(sent).",
              b="+!do(X)[source(S)] <- .print(X, S).")  # fmt: skip
    assert sorted(mas.until(1).said) == [("a", "sent"), ("b", "1a"), ("b", "X<no-value>a")]


def test_a_goal_is_given_up_on_request():
    mas = Mas(
        a="!g. +!g <- .wait(100); .send(b, unachieve, work(1)).",
        b="!work(1). !work(2). +!work(X) <- .wait(200); .print(X).",
    )
    assert mas.until(1).lines == ["2"]


def test_a_signal_is_an_event_only():
    mas = Mas(a="!g. +!g <- .send(b, signal, hey(1)).", b="+hey(X)[signal, source(S)] <- .print(X, S).").until(1)
    assert mas.lines == ["1a"]
    assert mas.beliefs("b") == {}


# Questions

ANSWERER = """color(red). color(blue)[source(c)]. warm(X) :- color(X) & X = red.
+?sum(A, B, C) <- .wait(10); C = A + B.
+?never(_) <- .fail."""


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (".send(b, askOne, color(X), color(X)); .print(X)", "red"),
        (".send(b, askOne, color(_), A); .print(A)", "color(red)[source(b)]"),
        (".send(b, askOne, color(blue), A); .print(A)", "color(blue)[source(b)[source(c)]]"),
        (".send(b, askOne, color(green), A); .print(A)", "false"),
        (".send(b, askOne, warm(X), A); .print(A)", "warm(red)[source(b)]"),
        (".send(b, askOne, sum(1, 2, X), sum(_, _, Y)); .print(Y)", "3"),
        (".send(b, askOne, never(X), A); .print(A)", "false"),
        (".send(b, askOne, color(X), color(green))", "ask_failed"),
        (".send(b, askAll, color(X), L); .print(L)", "[color(red)[source(b)],color(blue)[source(b)[source(c)]]]"),
        (".send(b, askAll, size(X), L); .print(L)", "[]"),
        (".send([b, c], askOne, color(_), L); .print(L)", "[color(red)[source(b)],false]"),
        (".send([], askOne, color(_), L); .print(L)", "[]"),
        (".send(b, askOne, sum(1, 1, X), A, 5); .print(A)", "timeout"),
        (".send([b, c], askOne, sum(1, 1, X), A, 5); .print(A)", "[false]"),
        (".send(b, askOne, sum(1, 1, X), A, 50); .print(A)", "sum(1,1,2)[source(b)]"),
        (".send(b, askHow, {+?sum(_, _, _)}, L); .length(L, N); .print(N)", "1"),
        (".send(self, askOne, mine(X), mine(X)); .print(X)", "7"),
    ],
)
def test_a_question_is_answered(question, answer):
    text = f"mine(7). !g. +!g <- {question}. -!g[error(E)] <- .print(E)."
    assert Mas(a=text, b=ANSWERER, c="").until(1).lines == [answer]


def test_others_go_on_while_an_answer_is_waited_for():
    mas = Mas(a="!g. !h. +!g <- .send(b, askOne, sum(1, 2, X), sum(_, _, Y)); .print(Y). +!h <- .print(h).", b=ANSWERER)
    assert mas.until(1).lines == ["h", "3"]


def test_answer_without_a_waiting_plan_is_told():
    mas = Mas(a="!g. +!g <- .send(b, askOne, color(_)); .send(b, askOne, sum(1, 2, _)).", b=ANSWERER).until(1)
    assert mas.beliefs("a") == {"color(red)": ("b",), "sum(1, 2, 3)": ("b",)}
    mas = Mas(a="!g. +!g <- .send(b, askAll, color(_)).", b=ANSWERER).until(1)
    assert mas.beliefs("a") == {"color(red)": ("b",), "color(blue)": ("b",)}


def test_negative_answer_is_untold():
    text = (
        "!g. +!g <- .send(b, askOne, color(X)); .wait(10); .send(b, tell, end); .wait(10); .send(b, askOne, color(X))."
    )
    mas = Mas(a=text, b="color(red). +end <- -color(red).").until(1)
    assert mas.beliefs("a") == {}


def test_late_answer_is_ignored():
    text = "!g. +!g <- .send(b, askOne, sum(1, 1, _), A, 5); .print(A); .wait(100); .print(A)."
    assert Mas(a=text, b=ANSWERER).until(1).lines == ["timeout", "timeout"]


# Plans


def test_tell_how_adds_and_untell_how_removes_plans():
    text = """!g. +!g <- .send(b, tellHow, {@l +!h(X) <- .print(h, X)}); .send(b, achieve, h(1)); .wait(10);
        .send(b, untellHow, l); .send(b, achieve, h(2))."""
    assert Mas(a=text, b="").until(1).lines == ["h1"]
    assert Mas(a=text.replace("{@l +!h(X) <- .print(h, X)}", '"@l +!h(X) <- .print(h, X)."'), b="").until(1).lines == [
        "h1"
    ]


def test_untell_how_keeps_plans_of_other_sources():
    mas = Mas(a="!g. +!g <- .send(b, untellHow, l); .send(b, achieve, h).", b="@l +!h <- .print(h).")
    assert mas.until(1).lines == ["h"]


def test_how_something_is_done_can_be_asked_and_learned():
    text = "!g. +!g <- .send(b, askHow, {+!h(_)}); .wait(10); !h(2)."
    assert Mas(a=text, b="+!h(X) <- .print(h, X).").until(1).said == [("a", "h2")]


def test_plans_that_are_asked_for_have_their_label_and_their_source():
    text = """!g.
    +!g <- .send(b, askHow, {+!h(_)}, L); .print(L); .add_plan(L); .list_plans({+!h(_)})."""
    mas = Mas(a=text, b="@l[n] +!h(X) : X > 1 <- .print(h, X).").until(1)
    assert [re.sub(r"_\d+", "_", line) for line in mas.lines] == [
        '[{ @l[n,source(b),url("file:b.asl")] +!h(_) : (_ > 1) <- .print(h,_) }]',
        '@l[n,source(b),source(self),url("file:b.asl")] +!h(_) : (_ > 1) <- .print(h,_).',
    ]


# Refusals and listeners


def test_an_agent_may_refuse_messages():
    mas = Mas(
        a="!g. +!g <- .send(b, tell, x(1)); .send(b, tell, y(1)); .send(b, askOne, x(_), A); .print(A).", b="x(2)."
    )
    mas.b.messaging.accepts = lambda sender, performative, content: (
        (sender, performative) == ("a", "tell") and content.functor == "y"
    )
    mas.until(1)
    assert mas.beliefs("b") == {"x(2)": ("self",), "y(1)": ("a",)}
    assert mas.lines == ["false"]


def test_message_is_an_event():
    text = '+message(S, P, C) <- .print(S, " ", P, " ", C). +x(X) <- .print(x).'
    mas = Mas(a="!g. +!g <- .send(b, tell, x(1)); .send(b, achieve, do(Z)); .send(b, tell, [x(2)]).", b=text).until(1)
    assert [line for line in mas.lines if line != "x"] == ["a tell x(1)", "a achieve do('_')", "a tell [x(2)]"]
    assert mas.lines.count("x") == 2
    assert set(mas.beliefs("b")) == {"x(1)", "x(2)"}


def test_python_rules_send_and_listen():
    mas = Mas(b="")
    mas.b.add_rules(+message(X, Y, Z) >> [do(Y)])
    lab = Lab(go() >> [send("b", p(1)), send("b", deed(), "achieve")], name="a")
    mas.b.robot = lab
    mas.society.add(lab.engine)
    lab.engine.achieve(go())
    mas.until(1)
    assert lab.done == ["tell", "achieve"]
    assert mas.beliefs("b") == {"p(1)": ("a",)}


class deed(Goal):  # noqa: N801
    pass


# What cannot be said


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (".send(nobody, tell, x)", "there is no agent nobody"),
        (".send(bo, tell, x(1))", "did you mean bob"),
        (".send([bob, nobody], tell, x)", "there is no agent nobody"),
        (".send(bob, tel, x)", "expects 'tell', or a performative that is not almost"),
        (".broadcast(askone, x)", "expects 'askOne'"),
        (".send(bob, askOne, [x])", "askOne expects a literal"),
        (".send(bob, tellHow, 7)", "tellHow expects a plan"),
        (".send(bob, askHow, x)", "askHow expects an event"),
        (".send(7, tell, x)", "there is no agent 7"),
        (".send(R, tell, x)", "the name of an agent"),
    ],
)
def test_invalid_message_fails_the_step(step, message):
    mas = Mas(a=f"!g. +!g <- {step}; .print(sent). -!g[error_msg(M)] <- .print(M).", bob="").until(1)
    (line,) = mas.lines
    assert message in line


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (".send(bob, tell, 7)", "tell expects a literal, not 7"),
        (".send(bob, tell, X)", "tell expects a literal, but X has no value"),
        (".send(bob, tell, [x(Y)])", "in a list, beliefs need values"),
        (".send(bob, achieve, [1])", "achieve expects a literal"),
        (".broadcast(tell, 7)", "tell expects a literal"),
    ],
)
def test_a_content_without_meaning_is_a_failure_of_the_receiver(step, message):
    mas = Mas(a=f"!g. +!g <- {step}; .print(sent). -!g[error_msg(M)] <- .print(M).", bob="")
    records: list[Record] = []
    mas.bob.trace.sink = records.append
    mas.until(1)
    assert mas.lines == ["sent"]
    (failure,) = [record for record in records if record.kind == "failure"]
    assert message in str(failure.detail["message"])


def test_message_to_a_list_with_an_unknown_agent_is_not_sent():
    mas = Mas(a="!g. +!g <- .send([bob, nobody], tell, x).", bob="").until(1)
    assert mas.beliefs("bob") == {}


def test_an_agent_alone_may_talk_to_itself():
    engine, lines = Engine("me", ManualClock()), []
    engine.out = lines.append
    engine.add_text("""!g. +!g <- .send(me, tell, x(1)); .send(self, achieve, h); .broadcast(tell, y); .all_names(L);
        .print(L); .send(you, tell, x(2)). +!h <- .print(h). -!g[error_msg(M)] <- .print(M).
        +x(X)[source(S)] <- .print(X, S).""")
    engine.run_until_idle()
    assert sorted(lines) == ["1self", "[me]", "h", "there is no agent you: me is in no society"]


def test_a_broadcast_reaches_all_others():
    mas = Mas(a="!g. +!g <- .broadcast(tell, x(1)).", b="", c="").until(1)
    assert [mas.beliefs(name) for name in "abc"] == [{}, {"x(1)": ("a",)}, {"x(1)": ("a",)}]


def test_a_broadcast_belief_meets_the_checks_of_each_receiver():
    mas = Mas(
        a="!g. +!g <- .broadcast(tell, [x(1)[sure], y]).",
        b="+x(X)[sure, source(S)] <- .print(X, S).",
        c="+message(S, P, C) <- .print(S, P, C).",
        d="",
    )
    mas.d.messaging.accepts = lambda sender, performative, content: False
    mas.until(1)
    assert mas.said == [("b", "1a"), ("c", "atell[x(1)[sure],y]")]
    expected = {"x(1)[sure]": ("a",), "y": ("a",)}
    assert mas.beliefs("b") == expected
    assert expected.items() <= mas.beliefs("c").items()
    assert mas.beliefs("d") == {}


def test_receivers_of_a_broadcast_share_no_collection():
    mas = Mas(
        a="!g. +!g <- .set.create(S); .set.add(S, 1); .broadcast(tell, s(S)).",
        b="+s(S) <- .set.add(S, 2).",
        c="+s(S) <- .wait(1); .print(S).",
    )
    assert mas.until(1).said == [("c", "{1}")]


def test_each_agent_has_variables_of_its_own():
    mas = Mas(
        a="!g. +!g <- .send([b, c], achieve, do(X)).",
        b="+!do(X) <- X = 1; .print(X).",
        c="+!do(X) <- X = 2; .print(X).",
    )
    assert sorted(mas.until(1).said) == [("b", "1"), ("c", "2")]


def test_messages_are_on_the_trace():
    mas = Mas(a="!g. +!g <- .send(b, tell, x(1)); .send(b, achieve, h).", b="+!h.")
    trace = []
    for engine in mas.society.agents.values():
        engine.trace.sink = trace.append
    mas.until(1)
    assert [record.what for record in trace if record.kind == "message"] == [
        "tell b: x(1)", "achieve b: h", "achieve from a: h",
    ]  # fmt: skip
    known = {record.id for record in trace}
    assert all(record.cause in known or record.cause == "" for record in trace)


# Against a model

NAMES = ("a", "b", "c")
MESSAGES = st.tuples(
    st.sampled_from(NAMES), st.sampled_from(NAMES), st.sampled_from(("tell", "untell")), st.integers(0, 3)
)


@settings(deadline=None)
@given(st.lists(MESSAGES, max_size=30), st.booleans())
def test_random_tells_and_untells(messages, at_once):
    mas = Mas(**dict.fromkeys(NAMES, ""))
    model: dict[str, dict[int, list[str]]] = {name: {} for name in NAMES}
    for sender, receiver, performative, value in messages:
        mas.society.agents[sender].messaging.send(receiver, performative, literal("x", (value,)))
        sources = model[receiver].setdefault(value, [])
        who = "self" if sender == receiver else sender
        if performative == "tell" and who not in sources:
            sources.append(who)
        elif performative == "untell" and who in sources:
            sources.remove(who)
        if not at_once:
            mas.until(0)
    mas.until(0)
    for name in NAMES:
        expected = {f"x({value})": tuple(sources) for value, sources in model[name].items() if sources}
        assert mas.beliefs(name) == expected


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from(NAMES), st.integers(0, 3)), max_size=20))
def test_broadcast_belief_reaches_all_others(messages):
    mas = Mas(**dict.fromkeys(NAMES, ""))
    for sender, value in messages:
        mas.society.agents[sender].messaging.broadcast("tell", literal("x", (value,)))
    mas.until(0)
    for name in NAMES:
        told = {f"x({value})" for sender, value in messages if sender != name}
        assert set(mas.beliefs(name)) == told


def test_the_sources_of_a_told_belief_become_those_of_its_sender():
    teller = "!go. +!go <- .send(b, tell, p(1)[source(x), k]); .wait(10); .send(b, untell, p(1)[source(x)])."
    hearer = "+p(X)[source(S)] <- ?p(X)[source(S)[source(T)]]; .print(S, T). -p(X)[source(S)] <- .print(gone(S))."
    assert Mas(a=teller, b=hearer).until(1).lines == ["ax", "gone(a)"]


def test_removing_a_source_removes_those_below_it():
    text = "p(1)[source(bob)[source(x)]]. p(1)[source(ann)]. !go."
    steps = "+!go <- -p(1)[source(bob)]; ?p(1)[source(S)]; .print(S)."
    assert Mas(a=f"{text} {steps}").until(1).lines == ["ann"]


RECEIVER = """
price(5)[x].
+!kqml_received(S, tell, secret(X), Id) <- .print("ignored ", X, " of ", S).
+!kqml_received(S, propose, C, _) <- .print(S, " proposes ", C); .send(S, accept, C).
+!kqml_received(S, askOne, discount(_), Id) <- .wait(10); .send(S, tell, discount(7), Id).
+!kqml_received(S, askOne, secret(_), Id) <- .send(S, untell, secret(_), Id).
+!kqml_received(S, askAll, all(_), Id) <- .send(S, tell, [all(1), all(2)], Id).
+!kqml_received(S, bad, _, _) <- .fail.
-!kqml_received(S, bad, C, _)[error(E)] <- .print(C, " ", E).
+b(X)[source(S)] <- .print(b, X, S).
"""
"""Agent with plans for messages, as in Jason."""


@pytest.mark.parametrize(
    ("step", "answer"),
    [
        (".send(b, askOne, discount(_), A)", "discount(7)[source(b)]"),
        (".send(b, askOne, secret(_), A)", "false"),
        (".send(b, askAll, all(_), A)", "[all(1)[source(b)],all(2)[source(b)]]"),
        (".send(b, askOne, price(_), A)", "price(5)[source(b),x]"),
    ],
)
def test_a_plan_for_messages_may_answer_a_question(step, answer):
    assert Mas(a=f"!go. +!go <- {step}; .print(A).", b=RECEIVER).until(1).lines == [answer]


@pytest.mark.parametrize(
    ("step", "printed"),
    [
        (".send(b, tell, secret(1))", ["ignored 1 of a"]),
        (".send(b, tell, b(1))", ["b1a"]),
        (".broadcast(tell, secret(1))", ["ignored 1 of a"]),
        (".send(b, propose, deal(3))", ["a proposes deal(3)", "accepted deal(3)"]),
        (".send(b, propose, f(_))", ["a proposes f(_)", "accepted f(_)"]),
        (".broadcast(propose, all)", ["a proposes all", "accepted all"]),
        (".send(b, bad, x)", ["x ia_failed"]),
    ],
)
def test_plans_for_messages_come_before_their_usual_effect(step, printed):
    sender = f'!go. +!go <- {step}. +!kqml_received(_, accept, C, _) <- .print("accepted ", C).'
    assert Mas(a=sender, b=RECEIVER).until(1).lines == printed


def test_a_told_belief_keeps_its_sources_below_the_sender_and_an_answer_all_but_self():
    sender = """!go.
        +!go <- .send(b, tell, c(1)[source(self), x]); .send(b, tell, c(2)[source(ann), source(self)]); .wait(10);
            .send(b, askAll, c(_), L); .print(L); .send(b, askOne, d, A); .print(A)."""
    receiver = "d[source(self), source(ann)]. +c(X)[source(S)] <- .findall(A, c(X)[A], L); .print(L)."
    assert Mas(a=sender, b=receiver).until(1).lines == [
        "[source(a)[source(self)],x]",
        "[source(a)[source(ann),source(self)]]",
        "[c(2)[source(b)[source(a)[source(ann),source(self)]]],c(1)[source(b)[source(a)[source(self)]],x]]",
        "d[source(b)[source(ann)]]",
    ]


def test_a_message_without_a_meaning_is_recorded(caplog):
    Mas(a="!go. +!go <- .send(b, order, f(1)).", b=RECEIVER).until(1)
    assert "no plan for the message order from a: f(1)" in caplog.text


def test_the_sender_goes_on_when_a_receiver_has_no_plan_for_a_message(caplog):
    text = "!go. +!go <- .send([b, c], cfp, 1); .send(c, askIf, x, A); .print(A)."
    assert Mas(a=text, b=RECEIVER, c="").until(1).lines == ["false"]
    assert caplog.text.count("no plan for the message cfp from a: 1") == 2


@pytest.mark.parametrize(
    ("asks", "answer"),
    [
        (".send(you, tell, a(2)); .send(you, askOne, b(_), R)", "b(14)"),
        (".send(you, tell, a(2)); .send(you, tell, a(3)); .send(you, askAll, b(_), L); .length(L, R)", "2"),
        (".send(you, tell, a(2)); .send(you, untell, a(2)); .wait(1); .send(you, askOne, b(_), R)", "b(14)"),
        (".send(you, tell, a(2)); .send(you, achieve, g); .wait(1); .send(you, askOne, last(_), R)", "last(g)"),
        (".send(you, achieve, g); .send(you, tell, a(2)); .wait(1); .send(you, askOne, last(_), R)", "last(a)"),
    ],
    ids=["a question", "a question after two", "a removal", "a goal", "a belief"],
)  # fmt: skip
def test_a_message_is_read_after_the_events_of_those_before_it(asks, answer):
    you = "+a(V) : a(V) <- +b(V * 7); -+last(a). +!g <- -+last(g)."
    (said,) = Mas(me=f"!go. +!go <- {asks}; .print(R).", you=you).until(2).lines
    assert said.removesuffix("[source(you)]") == answer
