"""ROS interface: the only package that imports rclpy."""
