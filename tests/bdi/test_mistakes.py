"""Mistakes in rules and calls: each is refused at once, with a remedy."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from socialbot.bdi import (
    Action,
    Atom,
    Belief,
    Computed,
    Engine,
    LongAction,
    SingletonBelief,
    Society,
    Variable,
    action,
    apart,
    as_long_as,
    ask,
    asl,
    compute,
    count,
    drop,
    enter,
    error,
    findall,
    for_each,
    labelled,
    message,
    min_of,
    my_name,
    priority,
    saving,
    send,
    source,
    stage,
    sum_of,
    together,
    variables,
    wait,
    wait_for,
    when,
)
from socialbot.bdi import test as check
from socialbot.bdi.agentspeak import agentspeak
from socialbot.bdi.plans import Plan
from socialbot.core.clock import ManualClock
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, S, X, Y, Z, _, do, go, mood, p, ping, q, sub


class two(Action):  # noqa: N801
    def execute(self, a: object, b: object = None) -> None: ...


class walk(LongAction):  # noqa: N801
    def start(self, steps: int) -> None:
        self.done()


class far(Computed):  # noqa: N801
    def solutions(self, x: object) -> bool:
        return True


@action
def turn(engine: Engine, degrees: float) -> None: ...


def refused(make: Callable[[], object], *words: str) -> None:
    with pytest.raises(RuleError) as caught:
        make()
    assert caught.value.remedy
    assert [word for word in words if word not in str(caught.value)] == []


TRUTH = {
    "and": lambda: go() / (p(X) and q(X)) >> [],
    "or": lambda: go() / (p(X) or q(X)) >> [],
    "not": lambda: go() / (not p(1)) >> [],
    "not inside": lambda: go() / (p(X) & (not q(X))) >> [],
    "and of values": lambda: go(X) >> [do(X and 1)],
    "and of comparisons": lambda: go(X) / ((X > 1) and (X < 3)) >> [],
    "if on a belief": lambda: go() >> [do("a") if p(1) else do("b")],
    "if on a variable": lambda: go(X) >> [do("a") if X else do("b")],
    "if on a comparison": lambda: go(X) >> [do("a") if X == 1 else do("b")],
    "and of goals": lambda: (go() and sub()) >> [],
    "and of events": lambda: (+p(1) and +q(1)) >> [],
    "in": lambda: go(X) / (X in (1, 2)) >> [],
    "max": lambda: go(X, Y) >> [do(max(X, Y))],
    "equality of beliefs": lambda: go(X) / (p(X) == p(1)) >> [],
}


@pytest.mark.parametrize("name", TRUTH)
def test_and_or_not_and_if_on_parts_of_rules_are_refused(name: str):
    refused(TRUTH[name], "no truth value", "& (and)", "| (or)", "~ (not)", "when(")


FORMATTED = {
    "f-string": lambda: go(X) >> [do(f"hello {X}")],
    "expression": lambda: go(X) >> [do(f"hello {X + 1}")],
    "with a format": lambda: go(X) >> [do(f"{X:.2f}")],
    "format": lambda: go(X) >> [do("hello {}".format(X))],  # noqa: UP032
}


@pytest.mark.parametrize("name", FORMATTED)
def test_a_variable_in_a_text_is_refused(name: str):
    refused(FORMATTED[name], "X", "has no value when the text is formatted", "compute(lambda")


def test_compute_makes_a_text_of_variables():
    lab = Lab(go(X) >> [do(compute(lambda X: f"hello {X}"))])  # noqa: N803
    lab.tell(go("ann"))
    assert lab.done == ["hello ann"]


def test_one_name_makes_one_variable_and_several_make_a_tuple():
    alone = variables("K")
    (unpacked,) = variables("K")
    assert isinstance(alone, Variable)
    assert isinstance(unpacked, Variable)
    assert [each.name for each in variables("A B")] == ["A", "B"]
    assert [each.name for each in variables("A", "B")] == ["A", "B"]
    assert [*unpacked, *unpacked] == [unpacked, unpacked], "code that makes rules may unpack one variable like several"
    refused(lambda: [do(each) for each in X], "for_each")


@pytest.mark.parametrize("names", ["X X", "X, Y", "3D"])
def test_names_of_variables_are_checked(names: str):
    refused(lambda: variables(names))


ARITY = {
    "too few": (lambda: go() >> [two()], "two(a, b=None)"),
    "too many": (lambda: go() >> [two(1, 2, 3)], "3 arguments"),
    "function": (lambda: go() >> [turn(1, 2)], "turn(degrees)"),
    "long action": (lambda: go() >> [walk()], "walk(steps)"),
    "nested": (lambda: go() >> [when(p(1), [for_each(q(X), [two()])])], "two(a, b=None)"),
    "wait": (lambda: go() >> [wait()], "wait(seconds)"),
    "send": (lambda: go() >> [send("bob")], "receiver, content"),
    "computed belief": (lambda: go() / far(1, 2) >> [], "far(x)"),
    "internal action": (lambda: go() >> [asl(".my_name", X, Y)], "takes 1 arguments"),
}


@pytest.mark.parametrize("name", ARITY)
def test_the_number_of_arguments_is_checked_when_the_rule_is_made(name: str):
    make, word = ARITY[name]
    refused(make, word)


MESSAGES = {
    "performative": (lambda: go() >> [send("bob", p(1), "tel")], "tel is not a performative", "tell, untell"),
    "order": (lambda: go() >> [send("bob", "tell", p(1))], "the content comes first"),
    "goal told": (lambda: go() >> [send("bob", sub())], 'send(receiver, sub(), "achieve")'),
    "belief achieved": (lambda: go() >> [send("bob", p(1), "achieve")], "make it a Goal"),
    "event": (lambda: go() >> [send("bob", +p(1))], "write p(1)"),
    "text": (lambda: go() >> [send("bob", "hello")], "send a belief"),
    "class": (lambda: go() >> [send("bob", p)], "write p()"),
    "receiver": (lambda: go() >> [send(p(1), p(1))], "name of an agent"),
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_wrong_message_is_refused_when_the_rule_is_made(name: str):
    make, *words = MESSAGES[name]
    refused(make, *words)


UNKNOWN = {
    "abs": lambda: do(abs(X)),  # type: ignore[arg-type]
    "int": lambda: do(int(X)),  # type: ignore[call-overload]
    "float of an expression": lambda: do(float(X + 1)),  # type: ignore[arg-type]
    "round": lambda: do(round(X)),  # type: ignore[call-overload]
    "index": lambda: do(X[0]),  # type: ignore[index]
    "index of a list": lambda: do([1, 2][X]),  # type: ignore[call-overload]
    "range": lambda: list(range(X)),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_python_cannot_compute_with_a_variable(name: str):
    refused(UNKNOWN[name], "has no value when the rule is made", "compute(lambda")


ACTIONS = {
    "trigger": lambda: do(1) >> [],  # type: ignore[operator]
    "trigger with +": lambda: +do(1) >> [],  # type: ignore[operator]
    "removal": lambda: go() >> [-do(1)],  # type: ignore[operator]
    "negated condition": lambda: go() / ~do(1) >> [],  # type: ignore[operator]
    "joined condition": lambda: go() / (p(1) & do(1)) >> [],
    "conclusion": lambda: do(1) << p(1),  # type: ignore[operator]
}


@pytest.mark.parametrize("name", ACTIONS)
def test_an_action_is_a_step_only(name: str):
    refused(ACTIONS[name], "do(1)")


def test_the_condition_of_an_inference_needs_parentheses():
    refused(lambda: p(X) << q(X) & (X > 1), "put the whole condition in parentheses: p(X) << (a & b)")  # type: ignore[operator]


def test_a_condition_that_binds_may_be_the_first_of_several_steps():
    rules = [
        go(1) >> [check(p(X)), do(X), do(X)],
        go(2) >> [count(p(X), Y), do(Y), do(Y)],
        go(3) >> [findall(X, p(X), Y), do(Y)],
        go(4) >> [my_name(Y), do(Y)],
    ]
    lab = Lab(*rules)
    lab.tell(+p(5), *(go(number) for number in (1, 2, 3, 4)))
    assert sorted(map(str, lab.done)) == sorted(map(str, [5, 5, 1, 1, (5,), "lab"]))


GOALS = {
    "+goal as an event": (lambda: +go() >> [], "go() >> [...]"),
    "+goal as a step": (lambda: +p(1) >> [+go()], "apart(go())"),
    "-goal as a step": (lambda: +p(1) >> [-go()], "drop(go())"),
    "goal in a condition": (lambda: +p(1) / go() >> [], "cannot be a condition"),
    "goal as a conclusion": (lambda: go() << p(1), "is a goal"),
    "goal that is asked": (lambda: +p(1) >> [ask(go())], "write go() to achieve it"),
    "apart with an action": (
        lambda: +p(1) >> [apart(do(1))],  # type: ignore[arg-type]
        "is not a goal",
    ),
    "drop of a belief": (
        lambda: +p(1) >> [drop(p(1))],  # type: ignore[arg-type]
        "drop(g())",
    ),
    "limit in the head": (lambda: go().within(5) >> [], "in the steps that achieve it"),
    "limit as text": (lambda: go().within("5"), "number of seconds"),
}


@pytest.mark.parametrize("name", GOALS)
def test_a_wrong_form_of_a_goal_is_refused(name: str):
    make, *words = GOALS[name]
    refused(make, *words)


NEVER = {
    "removal of a reactor": lambda: -ping(1) >> [],
    "condition on a reactor": lambda: go() / ping(1) >> [],
    "negated condition on a reactor": lambda: go() / ~ping(1) >> [],
    "event of a computed belief": lambda: +far(X) >> [],
    "computed belief added": lambda: go() >> [+far(1)],
    "inference from a reactor": lambda: p(X) << ping(X),
    "negative time": lambda: +p(1).held_for(-5),
    "time as text": lambda: +p(1).held_for("5"),  # type: ignore[arg-type]
    "time of a variable": lambda: +p(X).held_for(X),
    "wait for a text": lambda: go() >> [wait("2")],
    "stage without a name": lambda: stage(go() >> []),  # type: ignore[arg-type]
    "priority without a number": lambda: priority(go() >> [], 2),  # type: ignore[arg-type]
    "label after the plan": lambda: labelled(go() >> [], "x"),  # type: ignore[arg-type]
    "stage of a variable": lambda: go(X) >> [enter(X)],
}


@pytest.mark.parametrize("name", NEVER)
def test_waits_for_impossible_events_are_refused(name: str):
    refused(NEVER[name])


VALUES = {
    "list": (lambda: go() >> [+p([1, 2])], "use a tuple"),
    "list with variables": (lambda: go() / p([X, Y]) >> [do(X)], "use a tuple"),
    "class": (lambda: go() >> [+p(q)], "write q()"),
    "function of variables": (lambda: go(X) >> [do(lambda X: X + 1)], "compute("),  # noqa: N803
    "variable in a dictionary": (lambda: go(X) >> [do({"x": X})], "X is inside a mutable value"),
    "aggregate of another variable": (lambda: go() >> [do(sum_of(Y, p(X)))], "Y has no value"),
    "aggregate in a pattern": (lambda: go() / p(count(q(_))) >> [], "count(condition, N)"),
    "aggregate as a condition": (lambda: go() / count(q(_)) >> [], "is a value"),
    "comparison without parentheses": (lambda: go(X) / (X > 1 & X < 3) >> [], "parentheses"),
    "comparison after a belief": (lambda: go() / (p(X) & X > 3) >> [], "parentheses"),
    "comparison as a step": (lambda: go(X) >> [X > 3], "test(X > 3)"),
    "negation as a step": (lambda: go(X) >> [~p(X)], "test(~p(X))"),
    "function as a step": (lambda: go() >> [lambda: None], "@action"),
    "two events": (lambda: (+p(1) | +q(1)) >> [], "a plan of its own"),
    "event and condition": (lambda: (+p(1) & q(1)) >> [], "event / (condition"),
    "held_for without +": (lambda: p(1).held_for(2) >> [], "write +p(1).held_for(2)"),
    "+changed": (lambda: +mood(X).changed(Y) >> [], "leave out the +"),
    "annotation by =": (lambda: +p(X)[source == "bob"] >> [], 'source("bob")'),  # type: ignore[comparison-overlap]
    "index": (lambda: p(1)[0], "literal.args"),
}


@pytest.mark.parametrize("name", VALUES)
def test_a_value_that_cannot_be_meant_is_refused(name: str):
    make, *words = VALUES[name]
    refused(make, *words)


CALLS = {
    "achieve a belief": (lambda engine: engine.achieve(p(1)), "engine.believe(p(1))"),
    "achieve a class": (lambda engine: engine.achieve(go), "write go()"),
    "achieve an event": (lambda engine: engine.achieve(+p(1)), "engine.believe(p(1))"),
    "achieve an action": (lambda engine: engine.achieve(do(1)), "a plan with the action"),
    "achieve a text": (lambda engine: engine.achieve("go"), "with a Goal"),
    "believe a goal": (lambda engine: engine.believe(go()), "engine.achieve(go())"),
    "believe an event": (lambda engine: engine.believe(+p(1)), "engine.believe(p(1))"),
    "believe a class": (lambda engine: engine.believe(p), "write p()"),
    "believe a text": (lambda engine: engine.believe("p(1)"), "with a Belief"),
    "believe what is computed": (lambda engine: engine.believe(far(1)), "computed"),
    "believe from an object": (lambda engine: engine.believe(p(1), source=3), "name of an agent"),
    "forget a goal": (lambda engine: engine.forget(go()), "engine.achieve(go())"),
    "forget an event": (lambda engine: engine.forget(-p(1)), "engine.forget(p(1))"),
    "belief with a variable": (lambda engine: p(X) in engine.beliefs, "engine.query(p(X))"),
    "sensor class": (lambda engine: engine.add_sensor(Engine), "instance of a Sensor class"),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_call_of_the_engine_is_refused(name: str):
    call, *words = CALLS[name]
    refused(lambda: call(Engine("lab", ManualClock())), *words)


# Names


def test_a_source_in_a_rule_is_a_string():
    lab = Lab(+p(X)[source("bob")] >> [do("bob", X)], +p(X)[source(S)] >> [do(S, X)])
    lab.engine.believe(p(1), source="bob")
    lab.engine.believe(p(2), source="ann")
    lab.tell(+p(3))
    assert lab.done == [("bob", 1), ("ann", 2), ("self", 3)]


@pytest.mark.parametrize("bob", ["bob", Atom("bob")])
def test_a_source_equals_the_string_and_the_atom(bob: object):
    lab = Lab(+p(X)[source(S)] / (bob == S) >> [when(bob == S, [do("bob")])], +p(X)[source(S)] >> [do("not bob")])
    lab.engine.believe(p(1), source="bob")
    lab.engine.believe(p(2), source="ann")
    lab.tell()
    assert lab.done == ["bob", "not bob"]


def test_a_source_finds_beliefs_about_the_agent():
    lab = Lab(+p(X)[source(S)] / q(S) >> [do(S), +mood(S)])
    lab.tell(+q("bob"))
    lab.engine.believe(p(1), source="bob")
    lab.tell()
    assert lab.done == ["bob"]
    assert mood("bob") in lab.engine.beliefs


def test_a_known_name_finds_its_beliefs():
    lab = Lab(go(S) / p(X)[source(S)] >> [do(X)])
    lab.engine.believe(p(1), source="ann")
    lab.engine.believe(p(2), source="bob")
    lab.tell(go("bob"))
    assert lab.done == [2]
    assert [found["S"] for found in lab.engine.query(p(1)[source(S)])] == ["ann"]


def test_the_reason_of_a_failure_is_a_string():
    lab = Lab(
        go() >> [sub()],
        -sub()[error("timeout")] >> [do("late")],
        -sub()[error(S)] / (S == "no_relevant") >> [do(S)],
    )
    lab.tell(go())
    assert lab.done == ["no_relevant"]


def test_the_sender_and_the_performative_of_a_message_are_strings():
    lab = Lab(
        go() >> [send("self", p(1)), wait_for(+message(S, "tell", p(X)), 1), do(S, X)],
        +message("self", "tell", X) >> [do(X)],
    )
    lab.tell(go())
    lab.engine.messaging.send("self", "tell", p(2))
    lab.tell()
    assert lab.done == [p(1), p(2), ("self", 2)] or lab.done == [p(1), ("self", 2), p(2)]


def sources(lab: Lab) -> list[object]:
    return sorted(found["S"] for found in lab.engine.query(p(1)[source(S)]))


def test_a_step_removes_only_the_sources_that_it_names():
    lab = Lab(go(S) >> [-p(_)[source(S)]], -p(X)[source(S)] >> [do(S)])
    for name in ("ann", "bob", "self"):
        lab.engine.believe(p(1), source=name)
    lab.tell(go("bob"))
    assert sources(lab) == ["ann", "self"]
    assert lab.done == ["bob"]
    lab.engine.forget(p(_)[source("ann")])
    lab.tell()
    assert sources(lab) == ["self"]
    lab.engine.forget(p(1))
    lab.tell()
    assert sources(lab) == []


def test_a_query_is_false_without_solutions():
    lab = Lab()
    lab.tell(+p(1))
    assert lab.engine.query(p(X))
    assert not lab.engine.query(p(2))
    assert next(lab.engine.query(p(X))) == {"X": 1}


# Texts


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        (go() >> [when(p(X) & (X > 1), [do(X)], [do(2)])], "go() >> [when(p(X) & (X > 1), [do(X)], [do(2)])]"),
        (go() >> [for_each(p(X), [do(X)])], "go() >> [for_each(p(X), [do(X)])]"),
        (go(X) >> [as_long_as(X > 1, [check(X > 2)])], "go(X) >> [as_long_as(X > 1, [test(X > 2)])]"),
        (go() / (count(p(_), X) & (X > 1)) >> [], "go() / (count(p(_), X) & (X > 1)) >> []"),
        (go() >> [drop(sub(_)), asl(".my_name", X)], 'go() >> [drop(sub(_)), asl(".my_name", X)]'),
    ],
    ids=str,
)  # fmt: skip
def test_a_rule_is_printed_in_its_own_notation(rule: object, text: str):
    assert str(rule) == text


def test_a_branch_may_bind_a_variable_to_any_value():
    lab = Lab(go() >> [together([ask(p(X))], [ask(q(Y))]), do(X, Y)])
    lab.tell(+p(0), +q(p(1)), go())
    assert lab.done == [(0, p(1))]


def test_a_name_is_saved_as_a_string():
    lab = Lab(+p(X)[source(S)] >> [+mood(S)])
    lab.engine.believe(p(1), source="bob")
    lab.tell()
    again = Lab()
    saving.restore(again.engine, saving.save(lab.engine))
    assert again.beliefs == lab.beliefs


def test_two_natures_of_one_name_are_refused():
    other = type("p", (SingletonBelief,), {})
    lab = Lab(+p(X) >> [do(X)])
    refused(lambda: lab.engine.believe(other(1)), "p is a Belief and a SingletonBelief")
    again = type("p", (Belief,), {})
    lab.tell(+again(1))
    assert lab.done == [1]


def test_a_timer_on_a_clock_that_stands_still_is_refused():
    lab = Lab(go() >> [wait(1)])
    lab.engine.achieve(go())
    refused(lab.engine.run, "run_engine")
    society = Society(ManualClock())
    society.add("a").add_text("!go. +!go <- .wait(1000).")
    refused(society.run, "run_engine")


def test_parameters_with_a_default_are_no_variables():
    lab = Lab(go(X) / (lambda X, least=2: least < X) >> [do(compute(lambda X, by=10: X * by))])  # noqa: N803
    lab.tell(go(3), go(1))
    assert lab.done == [30]


def test_a_wait_for_an_aggregate_ends_when_its_beliefs_change():
    lab = Lab(go() >> [wait_for(count(p(_)) == 2, 5), do("two")], sub() >> [wait_for(sum_of(X, p(X), 3)), do("three")])
    lab.tell(go(), sub(), +p(1))
    lab.tell(+p(2))
    assert sorted(lab.done) == ["three", "two"]


def test_aggregates_and_steps_on_goals_have_a_counterpart_in_agentspeak():
    rule = go() / (count(p(_), X) & (X > 1)) >> [findall(Y, q(Y), Z), my_name(S), drop(sub(_)), do(X, Z, S)]
    assert agentspeak(rule) == (
        "+!go : .count(p(_), X) & X > 1 <- .findall(Y, q(Y), Z); .my_name(S); .drop_desire(sub(_)); do(X, Z, S)."
    )
    assert agentspeak(go() >> [do(min_of(X, p(X)))]) == "+!go <- do(.python(min_of, X, p(X)))."


CLASSES = {
    "goal": lambda: go >> [],
    "goal with a condition": lambda: go / p(1) >> [],
    "event": lambda: +p >> [],
    "removal": lambda: -p >> [],
    "negation": lambda: go() / ~p >> [],
    "condition": lambda: go() / p >> [],
    "one of two conditions": lambda: go() / (p(1) & q) >> [],
    "first of two conditions": lambda: go() / (q & p(1)) >> [],
    "conclusion": lambda: p << q(1),
    "added belief": lambda: go() >> [+p],
    "awaited condition": lambda: go() >> [wait_for(p)],  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_without_parentheses_is_refused(name: str):
    refused(CLASSES[name], "(), with its arguments")


def test_an_action_needs_a_parameter_for_the_engine():
    refused(lambda: action(lambda: None), "no parameter for the engine")
    refused(lambda: action(lambda *, engine: None), "no parameter for the engine")
    assert issubclass(action(lambda *parts: None), Action)


def test_an_action_is_no_generator():
    def steps(engine: Engine) -> object:
        yield 1

    refused(lambda: action(steps), "steps is a generator")


@pytest.mark.parametrize("clock", [ManualClock, 5, None])
def test_a_clock_is_checked(clock: object):
    refused(lambda: Engine("lab", clock), "is not a clock", "WallClock()")  # type: ignore[arg-type]


class FalseOfNumpy:
    """Truth value like that of numpy, which is not the object ``False``."""

    def __bool__(self) -> bool:
        return False


FalseOfNumpy.__name__ = "bool_"


@pytest.mark.parametrize("value", [False, FalseOfNumpy()])
def test_an_action_fails_with_any_false_truth_value(value: object):
    @action
    def attempt(engine: Engine) -> object:
        return value

    lab = Lab(go() >> [attempt(), do(1)], -go() >> [do("failed")])
    lab.tell(go())
    assert lab.done == ["failed"]


def test_a_goal_with_another_number_of_arguments_names_the_plans(caplog: pytest.LogCaptureFixture):
    lab = Lab(go(X) >> [do(X)], go(X, Y) >> [do(X, Y)])
    lab.tell(go())
    assert "no plan for go(), only for go/1, go/2" in caplog.text


@pytest.mark.parametrize("rule", [+p(X) >> [go(X, X, X)], go(X) >> [for_each(q(X), [wait(1), go(X, X, X)])]])
def test_a_goal_without_plans_is_logged_when_the_plans_are_compiled(rule: Plan, caplog: pytest.LogCaptureFixture):
    lab = Lab(rule, go(X, Y) >> [go(X, Y)])
    lab.engine.compile_plans()
    assert caplog.text.count("no plan for") == 1
    assert "no plan for the goal go/3; there are plans for go/" in caplog.text


def test_an_action_that_nobody_has_registered_is_logged_when_the_plans_are_compiled(caplog: pytest.LogCaptureFixture):
    engine = Engine("me", ManualClock())
    engine.add_action(lambda engine, text: None, "say")
    engine.add_text('+!g <- say("a"); if (true) { sya("b") }; .print(c); jump; my.act(1).', "me.asl")
    engine.compile_plans()
    logged = [record.getMessage() for record in caplog.records]
    place = "me: me.asl:1: there is no action"
    assert logged == [f"{place} jump/0; register it with engine.add_action", f"{place} sya/1; did you mean say?"]


@pytest.mark.parametrize("name", [".goto", "geo.near"])
def test_an_internal_action_is_not_registered_for_one_agent(name: str) -> None:
    """Programs would not find it: they are read before they know their agent."""
    engine = Engine("me", ManualClock())
    with pytest.raises(RuleError, match=f"me: {name} is the name of an internal action") as caught:
        engine.add_action(lambda engine: None, name)
    assert f'@asl_action("{name}")' in (caught.value.remedy or "")
    assert not engine.actions


NUMBERS = {
    "event": +p(X, Y) >> [],
    "condition": go() / p(X, Y) >> [],
    "inference": q(X) << p(X, _),
    "step": go() >> [for_each(p(X, Y), [do(X)])],
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_belief_with_another_number_of_arguments_than_in_the_rules_is_reported(
    name: str, caplog: pytest.LogCaptureFixture
):
    lab = Lab(NUMBERS[name])
    lab.tell(+p(1), +p(2), +p(1, 2), +mood(1))
    assert caplog.text.count("no rule matches") == 1
    assert "no rule matches p(1): the rules have p with 2 arguments only" in caplog.text


def test_the_event_of_a_changed_belief_has_the_arguments_of_both(caplog: pytest.LogCaptureFixture):
    lab = Lab(p(X).changed(Y) >> [do(X, Y)])
    lab.tell(+p(1), +p(2))
    assert "no rule matches" not in caplog.text


def test_several_numbers_of_arguments_may_be_used(caplog: pytest.LogCaptureFixture):
    lab = Lab(+p(X) >> [do(X)], +p(X, Y) >> [do(X, Y)])
    lab.tell(+p(1), +p(1, 2))
    assert lab.done == [1, (1, 2)]
    assert not caplog.text


def test_a_string_in_place_of_an_atom_is_reported(caplog: pytest.LogCaptureFixture):
    lab = Lab(+p("bob") >> [do(1)], +q(Atom("bob")) >> [do(2)], +mood("bob") >> [do(3)], +mood(X) >> [do(X)])
    lab.tell(+p(Atom("bob")), +q("bob"), +mood(Atom("bob")))
    assert lab.done == [Atom("bob")]
    assert 'no rule matches p(bob): bob does not match "bob" in the rules' in caplog.text
    assert 'no rule matches q("bob"): "bob" does not match bob in the rules' in caplog.text
    assert caplog.text.count("no rule matches") == 2


def test_an_atom_in_agentspeak_for_a_string_in_python_is_reported(caplog: pytest.LogCaptureFixture):
    lab = Lab(+p("bob") >> [do(1)], +q(X) >> [do(X)])
    lab.engine.add_text("+!sub <- +p(bob); +q(bob).")
    lab.tell(sub())
    assert caplog.text.count("does not match") == 1
    assert 'p(bob): bob does not match "bob" in the rules' in caplog.text
