"""Simulated places: people in rooms, and a robot that sees them and turns its head."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="simulation",
    module="socialbot.robots.simulation",
    nodes={
        "simulated_place": "socialbot.robots.simulation.node:SimulatedPlace",
        "truth_detector": "socialbot.robots.simulation.truth_detector:TruthDetector",
    },
    graphs={"foyer": "graph.yaml"},
    demos={"foyer": "socialbot.robots.simulation.demo:demo"},
)
