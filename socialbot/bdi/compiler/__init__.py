"""Compiler of plans to Python functions: variables become locals, joins nested loops over indexes."""
