"""Run a graph: from a bag, on live input or simulated; processes, supervision, deployment."""
