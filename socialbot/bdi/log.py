"""The log of the engine. Logging is imported when there is something to say: it takes long, and mostly there is not."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from logging import Logger


def log() -> Logger:
    """The logger ``socialbot.bdi``."""
    import logging

    return logging.getLogger("socialbot.bdi")
