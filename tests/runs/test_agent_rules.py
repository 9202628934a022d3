"""Rules that a run never considered."""

from __future__ import annotations

from socialbot.bdi import Action, Belief, Goal, variables
from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import load_graph
from socialbot.runs.agent_rules import not_triggered, rules_of
from socialbot.runs.history import History


class near(Belief):  # noqa: N801
    pass


class greet(Goal):  # noqa: N801
    pass


class rest(Goal):  # noqa: N801
    pass


class wave(Action):  # noqa: N801
    def execute(self) -> None:
        pass


Who = variables("Who")
RULES = (
    greet() >> [wave()],
    +near(Who) >> [greet()],
    -near("bob") >> [rest(), greet()],
    +near(Who).held_for(5) >> [greet()],
    rest() >> [greet()],
)


def history(*records: tuple[float, str, str]) -> History:
    made = [
        TraceRecord(stamp=round(at_s * SECOND), id=f"r{n}", source="ann", kind=kind, what=what, cause="")
        for n, (at_s, kind, what) in enumerate(records)
    ]
    return History(made, start=0)


def reasons(found: History) -> dict[str, str]:
    return {each.event: each.because for each in not_triggered(found, {"ann": RULES}, "WAVE()")}


def test_events_that_would_have_triggered_a_rule_are_named():
    absent = reasons(history())
    assert absent == {
        "greet()": "the goal greet() was not adopted in this run",
        "+near(Who)": "+near(Who) did not occur in this run",
        '-near("bob")': '-near("bob") did not occur in this run',
        str(RULES[3].event): f"no rule was chosen for {RULES[3].event} in this run",
        "rest()": "the goal rest() was not adopted in this run",
    }


def test_events_that_occurred_are_not_denied():
    came = history((1.0, "unbelief", 'near("eve")'), (2.5, "unbelief", 'near("ann")'), (3.0, "belief", "nearby()"))
    why = reasons(came)
    assert why['-near("bob")'].startswith('-near("bob") did not apply to near("eve") at 1.00 s and 1 more: ')
    assert why["+near(Who)"] == "+near(Who) did not occur in this run"
    times = {each.event: each.occurred_s for each in not_triggered(came, {"ann": RULES}, "wave()")}
    assert (times['-near("bob")'], times["greet()"]) == ((1.0, 2.5), ())


def test_rules_of_a_graph_are_those_of_its_agents():
    rules = rules_of(load_graph("waldo"))
    assert list(rules) == ["bdi_engine"]
    found = not_triggered(history(), rules, 'speak("offer")')
    assert [each.leads_to for each in found][:2] == ["", found[0].plan]
    assert all(each.where.startswith("waldo.py:") for each in found)
