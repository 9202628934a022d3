"""PDDL 2.1: read, represent, simulate and validate."""
