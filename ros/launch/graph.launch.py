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

from socialbot.graph.files import load_graph, with_changes
from socialbot.runtime.deployment import load_deployment
from socialbot.runtime.machine import graph_processes, machine_processes

ARGUMENTS = {
    "graph": ("waldo", "a graph that comes with socialbot, or a graph file"),
    "deployment": ("", "a deployment file, instead of a graph: which node runs on which machine"),
    "machine": ("", "of the deployment; by default the one that has an address of this machine"),
    "set": ("", "changes of parameters, as of `socialbot up`: 'camera.source=0 speech.volume=0.5'"),
    "params_file": ("", "a ROS parameter file for all nodes"),
    "sim_time": ("false", "whether the time comes from /clock"),
    "respawn": ("true", "whether a node that ends is started again"),
    "translate": (
        "",
        "true: also publish in types of RViz, vision_msgs and ROS4HRI; head: also the head pose; "
        "default: as the graph says",
    ),
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
    started = [
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
    wanted = given["translate"] or ("true" if graph_of(given).standard else "false")
    return started if wanted == "false" else [*started, translator(given)]


def translator(given):
    """What says all again in types that other packages know."""
    machine = ["--machine", machine_of(given)] if given["deployment"] else []
    head = ["--head"] if given["translate"] == "head" else []
    changes = [part for change in shlex.split(given["set"]) for part in ("--set", change)]
    return Node(
        package="socialbot",
        executable="socialbot",
        name="translator",
        arguments=["translate", given["deployment"] or given["graph"], *machine, *head, *changes],
        ros_arguments=["-p", f"use_sim_time:={given['sim_time']}"],
        output="screen",
        respawn=given["respawn"] == "true",
        respawn_delay=RESPAWN_DELAY_S,
    )


def processes(given, folder):
    """The processes of the graph or the machine."""
    graph = graph_of(given)
    if given["deployment"]:
        return machine_processes(load_deployment(Path(given["deployment"])), machine_of(given), folder, graph)
    return graph_processes(graph, folder, sim_time=given["sim_time"] == "true")


def graph_of(given):
    """The graph with the changes of the argument ``set``."""
    file = given["deployment"]
    graph = load_deployment(Path(file)).graph if file else load_graph(given["graph"])
    return with_changes(graph, shlex.split(given["set"]))


def machine_of(given):
    """Which machine of the deployment this is."""
    return given["machine"] or load_deployment(Path(given["deployment"])).this_machine()
