"""Temporal planners in child processes with limits."""
