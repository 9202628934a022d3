"""Planning: PDDL domains and problems, planners in processes of their own, plans and their checks."""
