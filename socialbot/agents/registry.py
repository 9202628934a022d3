"""Every structured message that comes with socialbot, for codecs and schema pages."""

from __future__ import annotations

from socialbot.agents.hospital.messages import MISSION_MESSAGES
from socialbot.agents.hospital.ward.messages import WARD_MESSAGES
from socialbot.agents.warehouse.messages import WAREHOUSE_MESSAGES
from socialbot.core.messages import (
    ActionRequest,
    AgentAnswer,
    AgentCommand,
    DownRequest,
    HeadCommand,
    Health,
    Mind,
    PersonDetections,
    PictureAck,
    SpeechStatus,
    Structured,
    TraceRecord,
    UpStatus,
    Utterance,
)
from socialbot.deliberation.messages import AGENT_MESSAGES

STRUCTURED: tuple[type[Structured], ...] = (
    PersonDetections, ActionRequest, Utterance, SpeechStatus, HeadCommand, TraceRecord, Mind, PictureAck, Health,
    UpStatus, DownRequest, AgentCommand, AgentAnswer,
    *AGENT_MESSAGES, *WAREHOUSE_MESSAGES, *MISSION_MESSAGES, *WARD_MESSAGES,
)  # fmt: skip
