"""World view of a run."""

from __future__ import annotations

from socialbot.core.registry import WorldView, world_view_of

World = WorldView
world_of = world_view_of
