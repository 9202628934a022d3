"""BDI engine: beliefs, desires (goals), intentions and plans.

>>> from socialbot.core.clock import ManualClock
>>> class rain(Belief): ...
>>> class stay_dry(Goal): ...
>>> class say(Action):
...     def execute(self, text): print(text)
>>> engine = Engine("cat", ManualClock())
>>> engine.add_rules(
...     +rain() >> [stay_dry()],
...     stay_dry() >> [say("I go inside.")],
... )
>>> engine.believe(rain())
>>> engine.run_until_idle()
I go inside.
False
"""

from socialbot.bdi.aggregates import compute, count, findall, max_of, min_of, my_name, sum_of
from socialbot.bdi.durative_actions import LongAction, Pool, ThreadAction
from socialbot.bdi.engine import Engine
from socialbot.bdi.environment import Environment
from socialbot.bdi.intentions import Failed, Failure, Intention, MentalState, Sleep
from socialbot.bdi.library import Library
from socialbot.bdi.literals import (
    ANYTHING,
    Belief,
    Computed,
    Event,
    Goal,
    Literal,
    Reactor,
    SingletonBelief,
    error,
    error_msg,
    literal,
    source,
)  # fmt: skip
from socialbot.bdi.plans import Inference, Plan, atomic, labelled, priority, stage
from socialbot.bdi.sensors import Sensed, Sensor, ThreadSensor
from socialbot.bdi.society import Society
from socialbot.bdi.stdlib.actions import asl_action
from socialbot.bdi.steps import (
    Action,
    PlanFailed,
    action,
    apart,
    as_long_as,
    ask,
    asl,
    drop,
    enter,
    fail,
    first_of,
    for_each,
    message,
    resume,
    send,
    suspend,
    test,
    together,
    wait,
    wait_for,
    when,
)  # fmt: skip
from socialbot.bdi.terms import Atom, Variable, variables
from socialbot.bdi.trace import JsonLines, Record, Trace, as_text, read_trace, tee

__all__ = [
    "ANYTHING", "Action", "Atom", "Belief", "Computed", "Engine", "Environment", "Event", "Failed", "Failure", "Goal",
    "Inference", "Intention", "JsonLines", "Library", "Literal", "LongAction", "MentalState", "Plan", "PlanFailed",
    "Pool", "Reactor", "Record", "Sensed", "Sensor", "SingletonBelief", "Sleep", "Society", "ThreadAction",
    "ThreadSensor", "Trace", "Variable", "action", "apart", "as_long_as", "as_text", "ask", "asl", "asl_action",
    "atomic", "compute", "count", "drop", "enter", "error", "error_msg", "fail", "findall", "first_of", "for_each",
    "labelled", "literal", "max_of", "message", "min_of", "my_name", "priority", "read_trace", "resume", "send",
    "source", "stage", "sum_of", "suspend", "tee", "test", "together", "variables", "wait", "wait_for", "when",
]  # fmt: skip
