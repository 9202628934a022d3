"""Planning in three packages: `pddl` (PDDL 2.1), `planners` (temporal planners) and `htn` (task networks)."""
