"""Parse and publish single messages."""

from __future__ import annotations

import pytest

from socialbot.bridge.topics import parse_message
from socialbot.core.errors import MessageError
from socialbot.deliberation.messages import Belief, Desire, DesireItem, Fact


def test_fields_come_as_yaml_or_json_and_the_stamp_from_the_sender():
    held = Fact(name="holding", params=("gripper_a", "box_a1"))
    yaml = "{desire: {name: grab, priority: 0.9, value: [{name: holding, params: [gripper_a, box_a1]}]}}"
    assert parse_message("DesireItem", yaml, stamp=7) == DesireItem(
        stamp=7, desire=Desire(name="grab", priority=0.9, value=(held,))
    )
    json = '{"belief": {"name": "holding", "params": ["gripper_a", "box_a1"]}, "stamp": 3}'
    assert parse_message("Belief", json, stamp=7) == Belief(stamp=3, belief=held)


@pytest.mark.parametrize(
    ("schema", "fields", "complaint"),
    [
        ("DesireItm", "{}", "did you mean 'DesireItem'?"),
        ("Belief", "{believe: {name: a}}", "did you mean 'belief'?"),
        ("Belief", "{}", "missing required field `belief`"),
        ("Belief", "{belief: {name: 3}}", r"Expected `str`, got `int` - at `\$.belief.name`"),
        ("DesireItem", "{desire: {name: a, priority: 1.5}}", r"\$.desire.priority"),
        ("Belief", "{belief: [", "not valid YAML"),
        ("Belief", "a", "expected names with values"),
    ],
)
def test_what_does_not_fit_its_schema_is_refused_before_it_is_sent(schema, fields, complaint):
    with pytest.raises(MessageError, match=complaint.replace("?", r"\?")):
        parse_message(schema, fields, stamp=0)


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ('{"belief": {"name": "\\ud800"}}', "surrogates"),
        ("{[a]: b}", "no field"),
        ("{{a: b}: c}", "not valid YAML"),
        ("9" * 5000, "not valid YAML"),
        ("{" * 5000, "nested more than"),
    ],
)
def test_what_nobody_means_to_send_is_refused_too(fields, complaint):
    with pytest.raises(MessageError, match=complaint):
        parse_message("Belief", fields, stamp=0)
