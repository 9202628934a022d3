"""The coordinator as a node: speech acts and the state of the ward in, speech acts and the state of missions out."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import cast

import msgspec

from socialbot.agents.hospital.coordinator import Coordinator
from socialbot.agents.hospital.messages import (
    COORDINATOR,
    TOPIC,
    AclMessage,
    Missions,
)
from socialbot.agents.hospital.missions import Conduct, Memory, Policy
from socialbot.agents.hospital.voice import Voice
from socialbot.agents.hospital.ward.messages import STATE, WardState
from socialbot.errors import ParameterError
from socialbot.graph import Context, Delivery, Input, Node, Output, Parameter
from socialbot.security import paths

MISSIONS = "/hospital/missions"


class HospitalCoordinator(Node):
    """Directs the robots and nurses of a hospital. What it has to remember it keeps in a file, if it is given one."""

    heard = Input(AclMessage, TOPIC)
    state = Input(WardState, STATE, Delivery.LATCHED)
    said = Output(AclMessage, TOPIC)
    missions = Output(Missions, MISSIONS, Delivery.LATCHED)

    policy = Parameter(
        "auto",
        "after a problem: replan the whole mission, repair its plan, decide by its joint actions, or give it up",
        choices=("auto", "replan", "repair", "none"),
    )
    proactive = Parameter(True, "whether it looks at rooms and batteries, and acts before a plan meets a problem")
    triggers = Parameter(True, "whether it begins a mission by itself where a room is to be disinfected")
    patience_s = Parameter(120.0, "s without news of a mission until it is planned anew", minimum=1.0, maximum=1e5)
    rest_s = Parameter(5.0, "s until a mission is tried again that could not go on", minimum=0.0, maximum=1e4)
    memory_file = Parameter("", "the file in which it remembers missions and agents; empty: none", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for a file that cannot be read, or is where none may be kept."""
        super().__init__(name, context, parameters)
        self._memory_file = (
            paths.in_workspace(self.memory_file, where=f"{name}.memory_file") if self.memory_file else None
        )
        voice = Voice(COORDINATOR, self.clock, self.said.publish)
        self.coordinator = Coordinator(voice.say, Conduct(), self._recall())
        self._saved = b""
        for parameter in ("policy", "proactive", "triggers", "patience_s", "rest_s"):
            self.on_parameter(parameter)

    def start(self) -> None:
        self.coordinator.begin()

    @heard
    def on_heard(self, message: AclMessage) -> None:
        """Takes what agents say."""
        self.coordinator.hear(message, self.clock.now())
        self._tell()

    @state
    def on_state(self, message: WardState) -> None:
        """Takes what the ward shows."""
        self.coordinator.observe(message, self.clock.now())
        self._tell()

    def on_parameter(self, name: str) -> None:
        conduct, value = self.coordinator.conduct, self.parameter_values[name]
        if name == "policy":
            conduct.policy = cast(Policy, value)
        elif name != "memory_file":
            setattr(conduct, name, value)

    def _tell(self) -> None:
        """Publishes and saves what has changed."""
        if not self.coordinator.changed:
            return
        self.coordinator.changed = False
        self.missions.publish(Missions(stamp=self.clock.now(), missions=tuple(self.coordinator.views())))
        self._save()

    def _save(self) -> None:
        path = self._memory_file
        if path is None:
            return
        data = msgspec.json.encode(self.coordinator.memory)
        if data == self._saved:
            return
        new = path.with_name(f"{path.name}.new")
        try:
            new.write_bytes(data)
            os.replace(new, path)
        except OSError as error:
            self.log.warning("cannot remember: %s", error)
            return
        self._saved = data

    def _recall(self) -> Memory:
        path = self._memory_file
        if path is None or not path.exists():
            return Memory()
        try:
            return msgspec.json.decode(path.read_bytes(), type=Memory)
        except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ParameterError(
                f"cannot read what it remembers: {error}", where=str(path), remedy="delete the file"
            ) from error
