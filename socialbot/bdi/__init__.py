"""Beliefs, desires and intentions: the engine that decides.

>>> from socialbot.clock import ManualClock
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

from socialbot.bdi.actions import Action, PlanFailed, fail, wait
from socialbot.bdi.engine import Engine
from socialbot.bdi.intentions import Mind
from socialbot.bdi.literals import Belief, Goal, Reactor, SingletonBelief
from socialbot.bdi.rules import Rule
from socialbot.bdi.sensors import Sensed, Sensor
from socialbot.bdi.terms import Variable, variables
from socialbot.bdi.trace import Record

__all__ = [
    "Action", "Belief", "Engine", "Goal", "Mind", "PlanFailed", "Reactor", "Record", "Rule", "Sensed", "Sensor",
    "SingletonBelief", "Variable", "fail", "variables", "wait",
]  # fmt: skip
