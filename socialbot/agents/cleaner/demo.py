"""Demos of the cleaner: alone, and with a sweeper."""

from __future__ import annotations

from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph


def cleaner() -> tuple[str, Graph]:
    """A robot cleans rooms, and recharges when its battery runs low."""
    return "The cleaner", load_graph("cleaner")


def cleaner_sweeper() -> tuple[str, Graph]:
    """A robot cleans rooms that another one sweeps at its request."""
    return "Cleaner and sweeper", load_graph("cleaner-sweeper")
