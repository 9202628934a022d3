"""AgentSpeak, in the syntax of Jason: text becomes plans, and plans become text."""

from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.notation import rules
from socialbot.bdi.agentspeak.parser import (
    Program,
    parse,
    parse_condition,
    parse_event,
    parse_literal,
    parse_plan,
    parse_term,
)
from socialbot.bdi.agentspeak.printer import agentspeak

__all__ = [
    "AgentSpeakError", "Program", "agentspeak", "parse", "parse_condition", "parse_event", "parse_literal",
    "parse_plan", "parse_term", "rules",
]  # fmt: skip
