"""Read, write, import, convert and repair bags without ROS."""
