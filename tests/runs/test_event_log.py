from __future__ import annotations

from socialbot.agents.teams.messages import ActionCommand
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.files import load_graph
from socialbot.runs.record import event_log_topics, with_event_log

COMMAND = ActionCommand(stamp=1, id="c", robot="spotrobot1", action="a_charge", args=("spotrobot1",))


def test_derived_records_follow_their_messages():
    seen: list[Message] = []
    tell = with_event_log(load_graph("hospital"), lambda topic, message: seen.append(message))
    tell("/hospital/commands", COMMAND)
    assert seen[0] == COMMAND
    assert [(record.kind, record.what) for record in seen[1:] if isinstance(record, TraceRecord)] == [
        ("step", "(a_charge spotrobot1)")
    ]


def test_agents_with_a_trace_have_no_event_log():
    def observe(topic: str, message: Message) -> None: ...

    assert with_event_log(load_graph("warehouse"), observe) is observe


def test_event_log_topics_of_the_hospital():
    assert set(event_log_topics(load_graph("hospital"))) == {
        "/hospital/messages", "/hospital/missions", "/hospital/commands", "/hospital/results",
        "/nurse_disinfected1/team_messages", "/spotrobot1/team_messages", "/uvdrobot1/team_messages",
    }  # fmt: skip
    assert event_log_topics(load_graph("cleaner")) == {}
