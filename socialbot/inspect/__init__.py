"""A run looked at from outside: what was so at any time, what led to what, and where two runs part."""
