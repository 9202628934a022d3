"""Agents as nodes: messages in, actions out."""
