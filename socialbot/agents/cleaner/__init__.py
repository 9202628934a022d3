"""The smallest deliberating agents: a robot that cleans, and a pair that sweeps and cleans."""
