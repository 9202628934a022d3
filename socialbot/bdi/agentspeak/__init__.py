"""AgentSpeak in Jason's syntax: parser, loader and printer of plans."""

from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.notation import rules
from socialbot.bdi.agentspeak.parser import parse_condition, parse_event, parse_literal, parse_plan, parse_term
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.agentspeak.programs import IncludePaths, Program, parse, read_program

__all__ = [
    "AgentSpeakError", "IncludePaths", "Program", "agentspeak", "parse", "parse_condition", "parse_event",
    "parse_literal", "parse_plan", "parse_term", "read_program", "rules",
]  # fmt: skip
