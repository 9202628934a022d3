"""Files of beliefs, desires and rules."""

from __future__ import annotations

import pytest

from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.files import load_beliefs, load_desires, load_rules
from socialbot.deliberation.messages import Desire, FactCondition
from socialbot.deliberation.rules import ReactiveRule, RuleBook, RuleEffect
from tests.deliberation.domains import YARD, dnf, domain, i, n, p

CARRIERS = domain(
    {"waypoint": "object", "base_wp": "waypoint", "deposit_wp": "waypoint", "carrier": "object", "box": "object"},
    [
        "in ?c:carrier ?w:waypoint",
        "fully_loaded ?c:carrier",
        "fully_unloaded ?c:carrier",
        "lb_load_completed ?c:carrier",
    ],
    ["moving_boxes ?c:carrier"],
    {},
)

CLEANER = domain(
    {"waypoint": "object", "cleaner": "object"},
    [
        "in ?r:cleaner ?w:waypoint",
        "workfree ?r:cleaner",
        "cleaned ?w:waypoint",
        "dirty ?w:waypoint",
        "fullcharged ?r:cleaner",
        "pred_a ?w:waypoint",
        "pred_b ?w:waypoint",
        "pred_c ?w:waypoint ?v:waypoint",
    ],
    ["battery_charge ?r:cleaner"],
    {},
)

CARRIER_BELIEFS = """
- {name: deposit, pddl_type: 1, type: deposit_wp}
- {name: base, pddl_type: 1, type: base_wp}
- {name: in, pddl_type: 2, params: [carrier_a, deposit]}
- name: "moving_boxes"
  pddl_type: 3
  params:
    - "carrier_a"
  value: 0
"""

CARRIER_RULES = """
-
  condition:
    clauses:
      - literals:
          - check: "EQ"
            condition_to_check: {name: "moving_boxes", pddl_type: 3, params: ["carrier_a"], value: 0}
  reactive_rules:
    - {set: belief, operation: ADD, value: {name: "fully_unloaded", pddl_type: 2, params: ["carrier_a"]}}
-
  condition:
    clauses:
      - literals:
          - check: "GREQ"
            condition_to_check: {name: "moving_boxes", pddl_type: 3, params: ["carrier_a"], value: 1}
  reactive_rules:
    - {set: belief, operation: DEL, value: {name: "fully_unloaded", pddl_type: 2, params: ["carrier_a"]}}
-
  condition:
    clauses:
      - literals:
          - check: "GREQ"
            condition_to_check: {name: "moving_boxes", pddl_type: 3, params: ["carrier_a"], value: 2}
          - check: "T"
            condition_to_check: {name: "lb_load_completed", pddl_type: 2, params: ["carrier_a"]}
  reactive_rules:
    - {set: belief, operation: ADD, value: {name: "fully_loaded", pddl_type: 2, params: ["carrier_a"]}}
    - set: desire
      operation: ADD
      value:
        name: "go_unload"
        priority: 0.8
        deadline: 16
        value:
          - {name: "fully_unloaded", pddl_type: 2, params: ["carrier_a"]}
    - {set: belief, operation: DEL, value: {name: "lb_load_completed", pddl_type: 2, params: ["carrier_a"]}}
"""

CLEANER_BELIEFS = """
- {name: workfree, pddl_type: 2, params: [cleaner]}
- {name: in, pddl_type: 2, params: [cleaner, dock]}
- {name: battery_charge, pddl_type: 3, params: [cleaner], value: 90}
- {name: dirty, pddl_type: 2, params: [kitchen]}
"""

CLEANER_DESIRES = """
- name: "clean_rooms"
  priority: 0.2
  deadline: 48.0
  value:
    - {name: "cleaned", pddl_type: 2, params: ["kitchen"]}
    - {name: "in", pddl_type: 2, params: ["cleaner", "dock"]}
  precondition:
    clauses:
      - literals:
          - {check: "T", condition_to_check: {name: "in", pddl_type: 2, params: ["cleaner", "bedroom"]}}
      - literals:
          - {check: "T", condition_to_check: {name: "in", pddl_type: 2, params: ["cleaner", "bathroom"]}}
  rollback_belief_add:
    - {name: "workfree", pddl_type: 2, params: ["cleaner"]}
    - {name: "in", pddl_type: 2, params: ["cleaner", "undefined_wp"]}
"""

CLEANER_RULES = """
- condition: {clauses: [{literals: [{check: T, condition_to_check: {name: pred_a, pddl_type: 2, params: ["*"]}}]}]}
  reactive_rules:
    - {set: belief, operation: ADD, value: {name: pred_b, pddl_type: 2, params: [hall]}}
- condition: {clauses: [{literals: [{check: T, condition_to_check: {name: dirty, pddl_type: 2, params: ["{x}"]}}]}]}
  reactive_rules:
    - {set: belief, operation: DEL, value: {name: cleaned, pddl_type: 2, params: ["{x}"]}}
- condition:
    clauses:
      - literals:
          - {check: T, condition_to_check: {name: pred_c, pddl_type: 2, params: ["{x}", "{y}"]}}
  reactive_rules:
    - {set: desire, operation: ADD, value: {name: "do_{x}_{y}", priority: 0.3, deadline: 20,
       value: [{name: cleaned, pddl_type: 2, params: ["{y}"]}]}}
- name: low
  condition:
    clauses:
      - literals:
          - {check: LE, condition_to_check: {name: battery_charge, pddl_type: 3, params: [cleaner], value: 40}}
  reactive_rules:
    - {set: desire, operation: ADD, value: {name: go_recharge, priority: 0.8, deadline: 16.0,
       value: [{name: fullcharged, pddl_type: 2, params: [cleaner]}]}}
"""


@pytest.fixture
def write(tmp_path):
    def write(text, name="file.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def believing(domain, *facts):
    base = FactBase(Engine("agent", ManualClock()), domain)
    for fact in facts:
        base.add(fact)
    return base


def said(book):
    return [str(reaction) for reaction in book.react()]


# Files of ROS2-BDI


def test_beliefs_are_read(write):
    assert load_beliefs(write(CARRIER_BELIEFS), CARRIERS) == (
        i("deposit", "deposit_wp"),
        i("base", "base_wp"),
        p("in", "carrier_a", "deposit"),
        n("moving_boxes", "carrier_a"),
    )


def test_desires_are_read(write):
    (desire,) = load_desires(write(CLEANER_DESIRES), CLEANER)
    assert desire == Desire(
        name="clean_rooms",
        priority=0.2,
        deadline=48.0,
        value=(p("cleaned", "kitchen"), p("in", "cleaner", "dock")),
        precondition=dnf([("T", p("in", "cleaner", "bedroom"))], [("T", p("in", "cleaner", "bathroom"))]),
        rollback_belief_add=(p("workfree", "cleaner"), p("in", "cleaner", "undefined_wp")),
    )


def test_rules_are_read(write):
    rules = load_rules(write(CLEANER_RULES), CLEANER)
    assert [rule.name for rule in rules] == ["rule_1", "rule_2", "rule_3", "low"]
    assert rules[0] == ReactiveRule(
        "rule_1", dnf([("T", p("pred_a", "*"))]), (RuleEffect(operation="ADD", fact=p("pred_b", "hall")),)
    )


def test_the_rules_of_a_carrier_send_it_to_unload_when_two_boxes_are_on_it(write):
    facts = believing(CARRIERS, *load_beliefs(write(CARRIER_BELIEFS), CARRIERS))
    book = RuleBook(facts)
    for rule in load_rules(write(CARRIER_RULES), CARRIERS):
        book.add(rule)
    assert said(book) == ["ADD belief (fully_unloaded carrier_a)"]
    facts.add(p("lb_load_completed", "carrier_a"))
    facts.add(n("moving_boxes", "carrier_a", value=1))
    assert said(book) == ["DEL belief (fully_unloaded carrier_a)"]
    facts.add(n("moving_boxes", "carrier_a", value=2))
    assert said(book) == [
        "DEL belief (fully_unloaded carrier_a)",
        "ADD belief (fully_loaded carrier_a)",
        "ADD desire go_unload",
        "DEL belief (lb_load_completed carrier_a)",
    ]


def test_the_rules_of_a_cleaner_use_wildcards_and_variables(write):
    facts = believing(CLEANER, *load_beliefs(write(CLEANER_BELIEFS), CLEANER))
    book = RuleBook(facts)
    for rule in load_rules(write(CLEANER_RULES), CLEANER):
        book.add(rule)
    assert said(book) == ["DEL belief (cleaned kitchen)"]
    facts.add(p("pred_a", "hall"))
    facts.add(p("pred_c", "hall", "kitchen"))
    assert said(book) == ["ADD belief (pred_b hall)", "ADD desire do_hall_kitchen"]
    facts.add(n("battery_charge", "cleaner", value=30))
    assert said(book) == ["ADD desire go_recharge"]


def test_older_files_give_the_type_of_an_instance_as_its_parameter(write):
    text = "- {name: box_a, pddl_type: 1, params: [box]}\n"
    assert load_beliefs(write(text), YARD) == (i("box_a", "box"),)


def test_instances_come_first_and_may_stand_anywhere(write):
    text = """
- {name: clear, pddl_type: 2, params: [box_a]}
- {name: on, pddl_type: 2, params: [box_b, box_a, base_1]}
- {name: box_a, pddl_type: 1, type: box}
"""
    facts = load_beliefs(write(text), YARD)
    assert facts == (i("box_a", "box"), p("clear", "box_a"), p("on", "box_b", "box_a", "base_1"))
    assert believing(YARD, *facts).kinds("base_1") == ("base",)


@pytest.mark.parametrize(
    ("effect", "what"),
    [
        ("{set: desire, operation: ADD, value: {name: q}}", "the desire q wants nothing"),
        (
            '{set: desire, operation: ADD, value: {name: q, value: [{name: clear, pddl_type: 2, params: ["*"]}]}}',
            "an added fact or desire needs names, not '*'",
        ),
        ('{set: belief, operation: ADD, value: {name: clear, pddl_type: 2, params: ["b*"]}}', "not 'b*'"),
    ],
)
def test_impossible_effects_are_errors_with_file_and_line(write, effect, what):
    path = write(f"- condition: {{clauses: []}}\n  reactive_rules:\n    - {effect}\n")
    with pytest.raises(PlanningError) as error:
        load_rules(path, YARD)
    assert what in error.value.what
    assert error.value.where == f"{path}:3"


@pytest.mark.parametrize("deadline", [".inf", ".nan", "1e300", "-1"])
def test_a_deadline_out_of_range_is_an_error_with_file_and_line(write, deadline):
    path = write(f"- name: a\n  value: [{{name: loaded, pddl_type: 2}}]\n  deadline: {deadline}\n")
    with pytest.raises(PlanningError, match=r"'deadline' must be a number from 0 to 1000000, got ") as error:
        load_desires(path, YARD)
    assert error.value.where == f"{path}:3"


def test_names_are_lower_case_and_variables_are_not(write):
    text = """
- name: Tidy
  condition: {clauses: [{literals: [{check: T, condition_to_check: {name: Clear, pddl_type: 2, params: ["{X}"]}}]}]}
  reactive_rules:
    - set: desire
      operation: ADD
      value: {name: "Do_{X}", value: [{name: IN, pddl_type: 2, params: ["{X}", Start]}]}
"""
    (rule,) = load_rules(write(text), YARD)
    desire = Desire(name="Do_{X}", value=(p("in", "{X}", "start"),))
    assert rule == ReactiveRule("Tidy", dnf([("T", p("clear", "{X}"))]), (RuleEffect(operation="ADD", desire=desire),))


def test_desires_may_have_negations_and_numbers(write):
    text = """
- name: empty
  value: [{name: load, pddl_type: 3, value: 2}]
  conditions:
    - {check: F, condition_to_check: {name: clear, pddl_type: 2, params: [start]}}
    - {check: LE, condition_to_check: {name: stacked, pddl_type: 3, params: [start], value: 1}}
"""
    (desire,) = load_desires(write(text), YARD)
    assert desire.wanted == (
        FactCondition(check="EQ", condition_to_check=n("load", value=2)),
        FactCondition(check="F", condition_to_check=p("clear", "start")),
        FactCondition(check="LE", condition_to_check=n("stacked", "start", value=1)),
    )


@pytest.mark.parametrize("load", [load_beliefs, load_desires, load_rules])
def test_a_file_without_anything_in_it_is_an_empty_list(write, load):
    assert load(write("# nothing yet\n"), YARD) == ()


# Mistakes

RULE = """- condition: {clauses: [{literals: [{check: T, condition_to_check: {name: loaded, pddl_type: 2}}]}]}
  reactive_rules: [{set: belief, operation: ADD, value: {name: loaded, pddl_type: 2}}]
"""

BELIEF_MISTAKES = [
    (
        "- {name: clear, pddl_type: 2, params: [a]}\n- {name: claer, pddl_type: 2}",
        2,
        "no predicate 'claer'",
        "'clear'?",
    ),
    ("- name: clear\n  pddl_type: 2\n  parms: [a]", 3, "unknown key 'parms'", "'params'?"),
    ("- {name: clear, pddl_type: 4, params: [a]}", 1, "'pddl_type' must be one of 1, 2, 3, got 4", None),
    ("- {name: clear, pddl_type: 2.0, params: [a]}", 1, "'pddl_type' must be one of 1, 2, 3", None),
    ("- {name: clear, params: [a]}", 1, "'pddl_type' is missing", None),
    ("- {pddl_type: 2, params: [a]}", 1, "'name' is missing", None),
    ("- {name: clear, pddl_type: 2, params: [a, b]}", 1, "has 1 parameter", None),
    ("- {name: clear, pddl_type: 2, params: a}", 1, "'params' must be a list of texts, got 'a'", None),
    ("- {name: clear, pddl_type: 2, params: [{x}]}", 1, "'params' must be a text", '"{x}" in quotes'),
    ("- name: clear\n  pddl_type: 2\n  params:\n    - 7", 4, "'params' must be a text, got 7", None),
    ("- {name: clear, pddl_type: 2, params: ['*']}", 1, "'*' is no name", None),
    ("- {name: carrier_in_base, pddl_type: 2, params: [start, start]}", 1, "start is a base, not a carrier", None),
    (
        "- {name: a, pddl_type: 1, type: box}\n- {name: a, pddl_type: 1, type: carrier}",
        2,
        "a is a box, not a carrier",
        None,
    ),
    ("- {name: a, pddl_type: 1, type: boxx}", 1, "no type 'boxx'", "'box'?"),
    ("- {name: a, pddl_type: 1}", 1, "a: its type is missing", None),
    ("- {name: clear, pddl_type: 1, params: [a, b]}", 1, "an instance has no parameters", "pddl_type 2"),
    ("- {name: load, pddl_type: 3, value: much}", 1, "'value' must be a number", None),
    ("- {name: load, pddl_type: 3, value: .nan}", 1, "'value' must be a number, got nan", None),
    (
        "- {name: load, pddl_type: 3, value: 1}\n- {name: load, pddl_type: 3, value: 2}",
        2,
        "(load) = 1 has another value above",
        None,
    ),
    ("- {name: load, pddl_type: 2}", 1, "'load' is a function", "pddl_type is 3"),
    ("name: load", 1, "expected a list, got names with values", None),
    ("- load", 1, "expected names with values, got 'load'", "name, pddl_type"),
    ("- {name: clear, pddl_type: 2, params: [*]}", 1, "no valid YAML", "in quotes"),
    ("- {name: clear\n\n", 3, "no valid YAML", None),
    ("- {name: a, name: b, pddl_type: 1}", 1, "no valid YAML", None),
]

DESIRE_MISTAKES = [
    ("- {name: a, priority: 1.5}", 1, "'priority' must be a number from 0 to 1, got 1.5", None),
    ("- name: a\n  deadline: -1", 2, "'deadline' must be a number from 0 to 1000000, got -1", None),
    ("- {name: a, deadline: .nan}", 1, "'deadline' must be a number from 0 to 1000000, got nan", None),
    ("- {name: ''}", 1, "'name' is missing", None),
    ("- {name: a}\n- {name: a}", 2, "another desire has the name 'a'", None),
    ("- {name: a, goal: []}", 1, "unknown key 'goal'", None),
    ("- name: a\n  value:\n    - {name: cler, pddl_type: 2, params: [start]}", 3, "no predicate 'cler'", "'clear'?"),
    ("- {name: a, value: [{name: clear, pddl_type: 2, params: ['*']}]}", 1, "'*' is no name", None),
    (
        "- name: a\n  context:\n    clauses:\n    - literals:\n      - check: TT\n"
        "        condition_to_check: {name: loaded, pddl_type: 2}",
        5,
        "'check' must be one of EQ, EX, F, GR, GREQ, LE, LEQ, T, got 'TT'",
        None,
    ),
    (
        "- name: a\n  precondition: {clauses: [{literals: [{check: T}]}]}",
        2,
        "'condition_to_check' is missing",
        None,
    ),
    (
        "- name: a\n  conditions: [{check: T, condition_to_check: {name: load, pddl_type: 3}}]",
        2,
        "T checks a predicate",
        None,
    ),
    ("- {name: a, context: {clause: []}}", 1, "unknown key 'clause'", "'clauses'?"),
]

RULE_MISTAKES = [
    (RULE.replace("loaded", "lowded", 1), 1, "no predicate 'lowded'", "'loaded'?"),
    (RULE.replace("ADD", "SET"), 2, "'operation' must be one of ADD, DEL, got 'SET'", None),
    (RULE.replace("belief", "goal"), 2, "'set' must be one of belief, desire, got 'goal'", None),
    (RULE.replace("reactive_rules", "reactive_rule"), 2, "unknown key 'reactive_rule'", "'reactive_rules'?"),
    (RULE.splitlines()[0], 1, "a rule without effects", None),
    ("- name: a\n  reactive_rules: []", 1, "'condition' is missing", None),
    (f"- name: rule_2\n{RULE.replace('- ', '  ', 1)}{RULE}", 4, "another rule has the name 'rule_2'", None),
    (RULE.replace("name: loaded", "name: clear, params: ['base_{x}']", 1), 1, "has to be the whole parameter", None),
    (
        RULE.replace("value: {name: loaded, pddl_type: 2}", "value: {name: clear, pddl_type: 2, params: ['do_{x}']}"),
        1,
        "the variable {x} is not bound",
        None,
    ),
]


@pytest.mark.parametrize(
    ("load", "text", "line", "what", "remedy"),
    [
        (load, *mistake)
        for load, mistakes in (
            (load_beliefs, BELIEF_MISTAKES), (load_desires, DESIRE_MISTAKES), (load_rules, RULE_MISTAKES),
        )
        for mistake in mistakes
    ],
)  # fmt: skip
def test_mistakes_are_errors_with_file_and_line(write, load, text, line, what, remedy):
    path = write(text)
    with pytest.raises(PlanningError) as caught:
        load(path, YARD)
    assert (what in caught.value.what, caught.value.where) == (True, f"{path}:{line}"), caught.value
    assert (remedy or "") in (caught.value.remedy or "")


def test_a_missing_file_is_an_error(tmp_path):
    with pytest.raises(PlanningError, match="cannot be read"):
        load_beliefs(tmp_path / "nothing.yaml", YARD)
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PlanningError, match="cannot be read"):
        load_rules(tmp_path / "bytes.yaml", YARD)


@pytest.mark.parametrize(
    "text",
    [
        "- &a {name: in, pddl_type: 2, params: [robot, *a]}",
        "- {name: in, pddl_type: 2, params: &a [*a]}",
        "- {[name]: in}",
        "- {name: in, pddl_type: 2, params: [robot], value: " + "9" * 5000 + "}",
        "- " * 5000,
        "[" * 5000,
    ],
)
def test_invalid_yaml_is_an_error(write, text):
    with pytest.raises(PlanningError):
        load_beliefs(write(text), YARD)


def test_facts_may_be_merged_of_others(write):
    text = "- {name: a, pddl_type: 1, type: nothing}\n- &x {name: b, pddl_type: 1, typ: x}\n- <<: *x\n"
    with pytest.raises(PlanningError, match="unknown key 'typ'"):
        load_beliefs(write(text), YARD)
