"""A deployment's machine robot: ros2 launch socialbot robot.launch.py deployment:=waldo.yaml."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir


def generate_launch_description():
    """The deployment file is the argument, the same on all machines."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("deployment", description="the deployment file: which node runs on which machine"),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(PathJoinSubstitution([ThisLaunchFileDir(), "graph.launch.py"])),
                launch_arguments={"deployment": LaunchConfiguration("deployment"), "machine": "robot"}.items(),
            ),
        ]
    )
