from hypothesis import settings

quick = settings(derandomize=True, database=None, deadline=None)
