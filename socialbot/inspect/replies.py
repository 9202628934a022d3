"""What the server answers with."""

from __future__ import annotations

from typing import Any

import msgspec
from starlette.responses import Response

JSON = "application/json"
FRESH = {"Cache-Control": "no-store"}
"""A moment that was asked for now is not to be taken from a cache later: another run may be shown by then."""


def reply(content: Any, *, status: int = 200) -> Response:
    """``content``, which may be made of structs, as JSON."""
    return Response(msgspec.json.encode(content), status, FRESH, JSON)


def reply_error(status: int, what: str) -> Response:
    """What is wrong with a request."""
    return reply({"error": what}, status=status)
