"""Dialogue of agents: intents with slots, beliefs of what is heard, and goals to ask, answer and confirm."""

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports

if TYPE_CHECKING:
    from socialbot.agents.dialogue.conversation import (
        SILENCE,
        SOMEBODY,
        Answer,
        Ask,
        Confirm,
        Conversation,
        Converse,
        Policy,
        Repair,
        Respond,
        Turn,
        asked,
        conversation_rules,
        heard,
        replied,
        speaks,
        talks,
        tell_again,
        turn,
        waits,
    )
    from socialbot.agents.dialogue.intents import UNKNOWN, Grammar, Intent, Reading
    from socialbot.agents.dialogue.language_model import HttpModel, RecordedModel, model_from_environment
    from socialbot.agents.dialogue.proposals import Proposals, Whitelist, adopt, proposed
    from socialbot.agents.dialogue.script import ANY, Question, Script, load_script

__all__ = [
    "ANY", "SILENCE", "SOMEBODY", "UNKNOWN", "Answer", "Ask", "Confirm", "Conversation", "Converse", "Grammar",
    "HttpModel", "Intent", "Policy", "Proposals", "Question", "Reading", "RecordedModel", "Repair", "Respond",
    "Script", "Turn", "Whitelist", "adopt", "asked", "conversation_rules", "heard", "load_script",
    "model_from_environment", "proposed", "replied", "speaks", "talks", "tell_again", "turn", "waits",
]  # fmt: skip

__getattr__ = lazy_exports(__name__)
