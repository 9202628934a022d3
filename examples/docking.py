"""Docking: a robot with a low battery drives to its dock by a ROS action, first in vain.

The navigator stands in for Nav2: it offers the action nav2_msgs/action/NavigateToPose, as Nav2 does on a robot.
"""

from socialbot import (
    ActionClient,
    ActionServer,
    AgentNode,
    Belief,
    Engine,
    Goal,
    Graph,
    Input,
    Node,
    NodeConfig,
    Output,
    Parameter,
    RosAction,
    Sensor,
    SingletonBelief,
    Structured,
    action,
    variables,
)
from socialbot.bdi import error, wait
from socialbot.testing import GraphTester

NAVIGATE = "nav2_msgs/action/NavigateToPose"
M, Why = variables("M Why")


class Charge(Structured, frozen=True, kw_only=True):
    """Charge of the battery, from 0 to 1."""

    share: float


class Battery(Node):
    """Battery that loses two percent a second."""

    charge = Output(Charge, "/battery")

    def start(self):
        self.share = 0.26
        self.lose()

    def lose(self):
        self.share -= 0.02
        self.charge.publish(Charge(stamp=self.clock.now(), share=self.share))
        self.call_after(1.0, self.lose)


class Navigator(Node):
    """Drives half a metre a second; the first way is blocked after two metres."""

    navigate = ActionServer(NAVIGATE, "/navigate_to_pose")
    distance_m = Parameter(4.0, "distance to the dock", minimum=0.0)
    blocked = True

    @navigate
    def on_goal(self, goal):
        self.drive(goal, self.distance_m)

    def drive(self, goal, left_m):
        if self.blocked and left_m < 2.0:
            self.blocked = False
            goal.abort({"error_code": 1})
        elif left_m <= 0.0:
            goal.succeed()
        else:
            goal.feedback({"distance_remaining": left_m})
            self.call_after(1.0, lambda: self.drive(goal, left_m - 0.5))


class low(Belief):
    """The battery is low."""


class to_go(SingletonBelief):
    """The dock is this far (m)."""


class charge(Goal):
    """The robot is at its dock."""


class drive_to_dock(RosAction):
    """Drive to the dock by the navigation of the robot."""

    client = "navigate"

    def goal(self):
        return {"pose": {"header": {"frame_id": "map"}, "pose": {"position": {"x": 4.0}}}}

    def feedback(self, feedback):
        return to_go(feedback.distance_remaining)


class Gauge(Sensor):
    """Believe that a charge below 20 % is low."""

    def sense(self, percept):
        return low() if percept.share < 0.2 else -low()


@action
def say(engine, *words):
    print(f"{engine.clock.now() / 1e9:4.1f} s ", *words)


RULES = [
    +low() >> [charge()],
    charge() >> [say("I drive to my dock."), drive_to_dock().within(30), say("I am at my dock.")],
    -charge()[error(Why)] >> [say("I did not get there:", Why), wait(3), charge()],
    +to_go(M) / (M <= 1.0) >> [say("Still", M, "m.")],
]


class Robot(AgentNode):
    """Drives to its dock when its battery is low."""

    battery = Input(Charge, "/battery")
    navigate = ActionClient(NAVIGATE, "/navigate_to_pose")

    def build(self):
        engine = Engine("robot", self.clock, robot=self, sink=self.record, wake=self.wake)
        self.gauge = Gauge()
        engine.add_sensor(self.gauge)
        engine.add_rules(*RULES)
        return engine

    @battery
    def on_battery(self, message):
        self.gauge.push(message)


GRAPH = Graph(
    "docking",
    (NodeConfig("battery", Battery), NodeConfig("robot", Robot)),
    services=frozenset({"/navigate_to_pose"}),
    stand_ins=(NodeConfig("navigator", Navigator),),
)

if __name__ == "__main__":
    with GraphTester(GRAPH) as tester:
        tester.run(25.0)
