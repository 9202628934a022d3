"""Planning: `pddl` (PDDL 2.1), `planners` (temporal planners) and `htn` (task networks)."""

__all__ = ["htn", "pddl", "planners"]
