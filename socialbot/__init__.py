"""socialbot: framework for robots that notice people and act proactively.

The public names below are imported on first use, so ``import socialbot`` is fast.
"""

from __future__ import annotations

import os as _os
from typing import TYPE_CHECKING

from socialbot._old_names import install as _install_old_names
from socialbot.core.lazy import lazy_exports as _lazy_exports
from socialbot.core.limits import IMAGE_PIXELS as _IMAGE_PIXELS
from socialbot.core.limits import IMAGE_VARIABLE as _IMAGE_VARIABLE

_os.environ.setdefault(_IMAGE_VARIABLE, str(_IMAGE_PIXELS))
_os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # onnxruntime reports its use to Microsoft otherwise

if TYPE_CHECKING:
    from socialbot.agents.base.agent_node import AgentNode
    from socialbot.agents.base.deliberating import Deliberating
    from socialbot.agents.base.foreign_node import ForeignNodeState
    from socialbot.agents.base.ros_action import RosAction
    from socialbot.bags.reader import Bag, open_bag
    from socialbot.bags.writer import BagWriter
    from socialbot.bdi import (
        ANYTHING,
        Action,
        Atom,
        Belief,
        Engine,
        Goal,
        Library,
        Literal,
        LongAction,
        Plan,
        Record,
        Sensor,
        SingletonBelief,
        ThreadAction,
        ThreadSensor,
        Trace,
        Variable,
        action,
        variables,
    )  # fmt: skip
    from socialbot.bdi.literals import Event
    from socialbot.bdi.society import Society
    from socialbot.core.clock import SECOND, Clock, ManualClock, nanoseconds
    from socialbot.core.errors import GraphError, MessageError, ParameterError, SocialbotError
    from socialbot.core.messages import (
        ActionRequest,
        AudioData,
        CameraInfo,
        CompressedImage,
        HeadCommand,
        Health,
        HeardSpeech,
        Image,
        Message,
        PersonDetection,
        PersonDetections,
        RosMessage,
        SpeechStatus,
        StopSpeech,
        Structured,
        TraceRecord,
        Utterance,
        VoiceActivity,
        ros_message,
    )  # fmt: skip
    from socialbot.core.registry import AgentPackage, Film, WorldView
    from socialbot.deliberation.actions import PlanAction
    from socialbot.deliberation.sensing import FactSensor, fluent, instance, predicate
    from socialbot.graph.calls import CallResult, GoalHandle, PendingCall
    from socialbot.graph.files import dump_graph, load_graph, parse_graph
    from socialbot.graph.inline import InlineRunner
    from socialbot.graph.node import Context, Graph, Node, NodeConfig, Timer
    from socialbot.graph.ports import Delivery, Input, Output, Parameter
    from socialbot.graph.services import ActionClient, ActionServer, Client, Service
    from socialbot.planning.htn.planner import TaskPlanner
    from socialbot.planning.pddl.reader import read_domain, read_problem
    from socialbot.planning.planners.engines import make_planner
    from socialbot.runs.folder import RecordedRun, open_run
    from socialbot.runtime.bag_source import replay
    from socialbot.runtime.run import RunResult

__version__ = "0.1.0"

__all__ = [
    "ANYTHING", "Action", "ActionClient", "ActionRequest", "ActionServer", "AgentNode", "AgentPackage", "Atom",
    "AudioData", "Bag", "BagWriter", "Belief", "CallResult", "CameraInfo", "Client", "Clock", "CompressedImage",
    "Context", "Deliberating", "Delivery", "Engine", "Event", "FactSensor", "Film", "ForeignNodeState", "Goal",
    "GoalHandle", "Graph", "GraphError", "HeadCommand", "Health", "HeardSpeech", "Image", "InlineRunner", "Input",
    "Library", "Literal", "LongAction", "ManualClock", "Message", "MessageError", "Node", "NodeConfig", "Output",
    "Parameter", "ParameterError", "PendingCall", "PersonDetection", "PersonDetections", "Plan", "PlanAction",
    "Record", "RecordedRun", "RosAction", "RosMessage", "RunResult", "SECOND", "Sensor", "Service", "SingletonBelief",
    "SocialbotError", "Society", "SpeechStatus", "StopSpeech", "Structured", "TaskPlanner", "ThreadAction",
    "ThreadSensor", "Timer", "Trace", "TraceRecord", "Utterance", "Variable", "VoiceActivity", "WorldView", "action",
    "dump_graph", "fluent", "instance", "load_graph", "make_planner", "nanoseconds", "open_bag", "open_run",
    "parse_graph", "predicate", "read_domain", "read_problem", "replay", "ros_message", "variables",
]  # fmt: skip

__getattr__ = _lazy_exports(__name__)
_install_old_names()


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
