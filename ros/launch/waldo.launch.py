"""Waldo on one machine: ros2 launch socialbot waldo.launch.py camera:=0 detector:=hog."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir


def generate_launch_description():
    """The graph `waldo`, with the parameters that one sets most."""
    camera, detector, more = (LaunchConfiguration(name) for name in ("camera", "detector", "set"))
    changes = ["'camera.source=", camera, "' 'person_detector.detector=", detector, "' ", more]
    return LaunchDescription(
        [
            DeclareLaunchArgument("camera", default_value="0", description="device, video file or folder of pictures"),
            DeclareLaunchArgument("detector", default_value="nanodet", description="nanodet, hog, or one of your own"),
            DeclareLaunchArgument("set", default_value="", description="further changes: 'speech.volume=0.5'"),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(PathJoinSubstitution([ThisLaunchFileDir(), "graph.launch.py"])),
                launch_arguments={"graph": "waldo", "set": changes}.items(),
            ),
        ]
    )
