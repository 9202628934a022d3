"""Nodes with typed ports, node configuration, graph files, the inline runner and health monitoring; no ROS."""
