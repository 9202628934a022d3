"""The way to ROS and to bags: the only place that knows their types."""
