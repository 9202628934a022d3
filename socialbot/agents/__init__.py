"""The agents that socialbot ships, each with its beliefs, plans, sensors and actions."""
