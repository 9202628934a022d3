"""Plans compiled to Python functions: variables are locals, joins are nested loops over indexes."""
