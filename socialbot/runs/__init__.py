"""Records of runs: read, explain, compare, show in a page, export."""
