"""Task networks: methods in Python, task trees, and repair."""
