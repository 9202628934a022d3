"""Task networks: domains as Python functions, plans as trees of tasks, and the way back into a tree when it fails."""
