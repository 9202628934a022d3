"""Node of the simulated ward: executes commands, and publishes results and sensor data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from socialbot.agents.hospital.ward._world import WardWorld
from socialbot.agents.hospital.ward.messages import CANCELS, COMMANDS, RESULTS, STATE, AgentState, RoomState, WardState
from socialbot.agents.hospital.ward.physics import PhysicalWard
from socialbot.agents.hospital.ward.ward import (
    DURATIONS,
    SLOW_S,
    STATE_SENSOR,
    Ward,
    large_ward,
    paper_ward,
    parse_faults,
)
from socialbot.agents.teams.messages import ActionCancel, ActionCommand, ActionResult
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.graph.node import Context, Node, Timer
from socialbot.graph.ports import Delivery, Input, Output, Parameter


class HospitalWorld(Node):
    """Simulator of a hospital ward."""

    is_simulator = True

    commands = Input(ActionCommand, COMMANDS)
    cancels = Input(ActionCancel, CANCELS)
    results = Output(ActionResult, RESULTS)
    state = Output(WardState, STATE, Delivery.LATCHED)

    ward = Parameter(
        "paper", "ward: the four rooms of the paper, or a large one", choices=("paper", "large"), fixed=True
    )
    rooms = Parameter(50, "number of rooms of the large ward", minimum=1, maximum=10_000, fixed=True)
    spots = Parameter(4, "number of patrol robots in the large ward", minimum=0, maximum=100, fixed=True)
    uvds = Parameter(4, "number of disinfection robots in the large ward", minimum=0, maximum=100, fixed=True)
    nurses = Parameter(
        0, "number of nurses in the large ward; 0: one in each room", minimum=0, maximum=10_000, fixed=True
    )
    every_s = Parameter(3.0, "period of infections in the large ward (s)", minimum=0.0, maximum=3600.0, fixed=True)
    pace = Parameter("paper", "durations of actions", choices=tuple(DURATIONS), fixed=True)
    simulation = Parameter(
        "kinematic", "physics: mass and friction in MuJoCo (extra sim)", choices=("kinematic", "physics"), fixed=True
    )
    seed = Parameter(0, "random seed of durations and problems", fixed=True)
    rate = Parameter(0.0, "percentage of infections with a problem", minimum=0.0, maximum=100.0, fixed=True)
    noise = Parameter(0.0, "largest relative deviation of durations", minimum=0.0, maximum=0.5, fixed=True)
    faults = Parameter("", "further faults: 2 dirty room1; 7 silent uvdrobot1 5; 8 slow state 5", fixed=True)
    period_s = Parameter(0.2, "period of the sensors (s)", minimum=0.01, maximum=10.0)
    pause_s = Parameter(
        0.0,
        "shortest time between reports of changes (s); reduces the load of large wards",
        minimum=0.0,
        maximum=10.0,
    )

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for unknown faults, more nurses than rooms, or physics that cannot run."""
        super().__init__(name, context, parameters)
        self.world = self._new_world()
        self._seen: dict[str, tuple[int, RoomState | AgentState]] = {}
        """Last values of slow sensors, with their times."""
        self._timer: Timer | None = None
        self._published = self._published_at = -1
        """Number of changes at the last report, and its time."""

    def start(self) -> None:
        # The clock of the world starts when all nodes run.
        self.world = self._new_world()
        self._publish(due=True)
        self.context.call_at(self.clock.now() + nanoseconds(self.period_s), self._report)

    def _new_world(self) -> WardWorld:
        ward = ward_of(self.parameter_values)
        if self.simulation == "physics" and math.isinf(DURATIONS[self.pace].speed):
            raise ParameterError(
                f"with physics, robots cannot move at the pace {self.pace!r}",
                where=f"{self.name}.pace",
                remedy="set pace to paper or clinic, or simulation to kinematic",
            )
        kind = PhysicalWard if self.simulation == "physics" else WardWorld
        return kind(
            ward,
            seed=self.seed,
            rate=self.rate,
            noise=self.noise,
            faults=parse_faults(self.faults, ward),
            durations=DURATIONS[self.pace],
            start=self.clock.now(),
        )

    @commands
    def on_command(self, command: ActionCommand) -> None:
        self.world.advance(self.clock.now())
        self.world.command(command.id, command.robot, command.action, command.args)
        self._publish()

    @cancels
    def on_cancel(self, cancel: ActionCancel) -> None:
        self.world.advance(self.clock.now())
        self.world.cancel(cancel.id)
        self._publish()

    def _report(self) -> None:
        self.world.advance(self.clock.now())
        self._publish(due=True)
        self.context.call_at(self.clock.now() + nanoseconds(self.period_s), self._report)

    def _on_event(self) -> None:
        self._timer = None
        self.world.advance(self.clock.now())
        self._publish()

    def _publish(self, *, due: bool = False) -> None:
        """Publish results, and the state if it is due or has changed; schedule the next event."""
        for result in self.world.take_results():
            if result.reason:
                self.log.info("%s of %s failed: %s", result.action, result.robot, result.reason)
            self.results.publish(result)
        changed = self.world.changes != self._published
        due_at = self._published_at + nanoseconds(self.pause_s)
        if (changed and self.world.now >= due_at) or (due and self.world.now != self._published_at):
            self._publish_state()
            changed = False
        times = [due_at] if changed and self.world.now < due_at else []
        times += [] if self.world.next_event is None else [self.world.next_event]
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.context.call_at(min(times), self._on_event) if times else None

    def _publish_state(self) -> None:
        world = self.world
        slow = world.is_faulty("slow", STATE_SENSOR) and world.now - self._published_at < nanoseconds(SLOW_S)
        if world.is_faulty("silent", STATE_SENSOR) or slow:
            return
        self._published, self._published_at = world.changes, world.now
        true = world.state()
        if world.has_faulty_sensors:
            rooms, agents = tuple(self._sensed(true.rooms)), tuple(self._sensed(true.agents))
            true = WardState(stamp=world.now, rooms=rooms, agents=agents)
        else:
            self._seen.clear()
        self.state.publish(true)

    def _sensed(self, values: Iterable[RoomState | AgentState]) -> Iterator[Any]:
        """Values of the sensors that are not silent; old ones for slow sensors."""
        now = self.world.now
        for value in values:
            if self.world.is_faulty("silent", value.name):
                continue
            if self.world.is_faulty("slow", value.name):
                since, seen = self._seen.get(value.name, (now, value))
                if now - since >= nanoseconds(SLOW_S):
                    since, seen = now, value
                self._seen[value.name] = since, seen
                value = seen
            else:
                self._seen.pop(value.name, None)
            yield value


def ward_of(parameters: Mapping[str, Any]) -> Ward:
    """The ward of a `HospitalWorld` with these parameters. Raises ParameterError for more nurses than rooms."""
    if parameters["ward"] == "paper":
        return paper_ward()
    sizes = (parameters[name] for name in ("rooms", "spots", "uvds", "nurses"))
    try:
        return large_ward(*sizes, every_s=parameters["every_s"])
    except ValueError as error:
        raise ParameterError(str(error), where="ward", remedy="set nurses to at most the number of rooms") from error
