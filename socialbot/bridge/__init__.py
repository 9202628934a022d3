"""ROS interface: the only package that imports rclpy."""

import sys

# ROS messages load their libraries with a package that also imports the generator of their code, with two parsers.
sys.modules.setdefault("rosidl_generator_py.generate_py_impl", None)  # pyright: ignore[reportArgumentType]
