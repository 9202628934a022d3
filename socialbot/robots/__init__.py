"""Robots: profiles, their nodes for heads, bases and speech, and a simulated place."""

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports
from socialbot.core.registry import AgentPackage

if TYPE_CHECKING:
    from socialbot.robots.asking import AskingAgent, answered, ask
    from socialbot.robots.head import RobotHead
    from socialbot.robots.joints import JointsAgent, move_joints
    from socialbot.robots.navigation import MobileAgent, approach, give_way, return_home
    from socialbot.robots.profile import RobotProfile, load_profile, robot_names
    from socialbot.robots.speech import ActionSpeaker, RobotSpeaker

AGENT = AgentPackage(
    name="robots",
    module="socialbot.robots",
    nodes={
        "naoqi_head": "socialbot.robots.head:NaoqiHead",
        "robot_head_action": "socialbot.robots.head:TrajectoryActionHead",
        "reachy_camera": "socialbot.robots.reachy_mini:ReachyCamera",
        "reachy_head": "socialbot.robots.reachy_mini:ReachyHead",
        "reachy_speaker": "socialbot.robots.reachy_mini:ReachySpeaker",
        "robot_ears": "socialbot.robots.speech:RobotEars",
        "robot_head_topic": "socialbot.robots.head:TrajectoryHead",
        "robot_people": "socialbot.robots.people:RobotPeople",
        "say_skill_speaker": "socialbot.robots.speech:SaySkillSpeaker",
        "topic_speaker": "socialbot.robots.speech:TopicSpeaker",
        "tts_speaker": "socialbot.robots.speech:TtsSpeaker",
    },
    robots={name: f"profiles/{name}.yaml" for name in ("nao", "pepper", "reachy_mini", "tiago", "turtlebot4")},
)

__all__ = [
    "AGENT", "ActionSpeaker", "AskingAgent", "JointsAgent", "MobileAgent", "RobotHead", "RobotProfile", "RobotSpeaker",
    "answered", "approach", "ask", "give_way", "load_profile", "move_joints", "return_home", "robot_names",
]  # fmt: skip

__getattr__ = lazy_exports(__name__)
