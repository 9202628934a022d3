"""socialbot: a robot that notices people and acts without being asked."""

__version__ = "0.1.0"
