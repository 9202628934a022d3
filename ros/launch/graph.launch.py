"""The nodes of a graph, or those of one machine of a deployment, each in a process of its own.

ros2 launch socialbot graph.launch.py graph:=warehouse
ros2 launch socialbot graph.launch.py deployment:=waldo.yaml machine:=robot
"""

import shlex
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.logging import launch_config
from launch_ros.actions import Node

from socialbot.cli import with_changes
from socialbot.deployment.deployment_file import load_deployment
from socialbot.deployment.launching import graph_processes, machine_processes
from socialbot.graph_file import load_graph

ARGUMENTS = {
    "graph": ("waldo", "a graph that comes with socialbot, or a graph file"),
    "deployment": ("", "a deployment file, instead of a graph: which node runs on which machine"),
    "machine": ("", "of the deployment; by default the one that has an address of this machine"),
    "set": ("", "changes of parameters, as of `socialbot up`: 'camera.source=0 speech.volume=0.5'"),
    "params_file": ("", "a ROS parameter file for all nodes"),
    "sim_time": ("false", "whether the time comes from /clock"),
    "respawn": ("true", "whether a node that ends is started again"),
}
RESPAWN_DELAY_S = 1.0


def generate_launch_description():
    """The arguments, and the nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context):
    """The nodes that the arguments ask for."""
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    return [
        Node(
            package="socialbot",
            executable="node",
            name=process.name,
            arguments=list(process.arguments),
            additional_env=dict(process.variables),
            parameters=[given["params_file"]] if given["params_file"] else None,
            output="screen",
            respawn=given["respawn"] == "true",
            respawn_delay=RESPAWN_DELAY_S,
        )
        for process in processes(given, Path(launch_config.log_dir) / "socialbot")
    ]


def processes(given, folder):
    """The processes of the graph or the machine."""
    changes = shlex.split(given["set"])
    if given["deployment"]:
        deployment = load_deployment(Path(given["deployment"]))
        machine = given["machine"] or deployment.this_machine()
        return machine_processes(deployment, machine, folder, with_changes(deployment.graph, changes))
    graph = with_changes(load_graph(given["graph"]), changes)
    return graph_processes(graph, folder, sim_time=given["sim_time"] == "true")
