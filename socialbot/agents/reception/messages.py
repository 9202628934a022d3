"""Messages between the receptionist and a telephone."""

from typing import Literal

from socialbot.core.messages import Structured


class ColleagueCall(Structured, frozen=True, kw_only=True):
    """Request to call a colleague to the reception; ``contact`` is a telephone number or address."""

    id: str
    colleague: str
    contact: str
    cause: str = ""


class CallStatus(Structured, frozen=True, kw_only=True):
    """Result of the call with this ``id``: whether the colleague comes."""

    id: str
    state: Literal["coming", "unavailable"]


MESSAGES = (ColleagueCall, CallStatus)
