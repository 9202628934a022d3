"""A graph on several machines: which node runs where, and how the machines find and trust each other."""
