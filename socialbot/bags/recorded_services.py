"""Answers of services and actions in a bag, for the clients of a replay.

The answers of a service are its events (``SERVICE/_service_event``, with contents). Those of an action are the status
and feedback of its goals, and the events of its services if they were recorded: without them goals are matched in their
order, and results have no content.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from socialbot.bags.reader import Bag
from socialbot.core.clock import SECOND, Clock
from socialbot.core.messages import RosMessage
from socialbot.graph.calls import Outcome, PendingCall
from socialbot.graph.node import Graph
from socialbot.graph.services import recorded_topic

_REQUESTS, _RESPONSES = (0, 1), (2, 3)
"""Event types: request sent, request received; response sent, response received."""

_OUTCOMES: Mapping[int, Outcome] = {4: "succeeded", 5: "cancelled", 6: "aborted"}
"""Outcomes by terminal status of a goal, as in action_msgs/GoalStatus."""

CallAt = Callable[[int, Callable[[], None]], object]


@dataclass
class RecordedCall:
    """Call in a bag: times in ns after it was sent."""

    message: Any = None
    """Request or goal; None if it was not recorded."""

    accepted: bool = True
    feedback: list[tuple[int, Any]] = field(default_factory=list)
    end: tuple[int, Outcome, Any] | None = None
    """Time, outcome and result."""

    used: bool = False


class RecordedChannel:
    """Channel that answers a call as an equal one in a bag, after the same time. Each recorded call answers once."""

    def __init__(self, topic: str, calls: Sequence[RecordedCall], clock: Clock, call_at: CallAt) -> None:
        self.topic = topic
        self._calls = calls
        self._clock = clock
        self._call_at = call_at

    def send(self, call: PendingCall) -> None:
        self._after(0, lambda: self._answer(call))

    def cancel(self, call: PendingCall) -> None:
        """The recorded server cannot be asked, so the call ends at once."""
        self._after(0, lambda: call.end("cancelled"))

    def _after(self, delay: int, callback: Callable[[], None]) -> None:
        self._call_at(self._clock.now() + delay, callback)

    def _answer(self, call: PendingCall) -> None:
        unused = [each for each in self._calls if not each.used]
        found = next((each for each in unused if each.message is None or _fits(call.message, each.message)), None)
        if found is None:
            call.end(
                "absent",
                reason=f"the bag holds no answer of {self.topic} to this request ({len(unused)} others are left): "
                f"record it again, or declare a stand-in",
            )
            return
        found.used = True
        call.on_sent()
        if not found.accepted:
            call.end("rejected")
            return
        call.on_accepted()
        for delay, feedback in found.feedback:
            self._after(delay, lambda feedback=feedback: call.on_feedback(feedback))
        if found.end is not None:
            delay, outcome, result = found.end
            self._after(delay, lambda: call.end(outcome, result))


def recorded_services(bag: Bag, graph: Graph) -> dict[str, Callable[[Clock, CallAt], RecordedChannel]]:
    """Factories of channels, for the clients of ``graph`` whose answers are in ``bag`` and not given by its nodes.

    Raises:
        BagError: The bag cannot be read.
    """
    offered = {topic for config in graph.nodes for topic, _ in config.servers}
    filled = {topic.name for topic in bag.topics if topic.count}
    found: dict[str, list[RecordedCall]] = {}
    for config in graph.nodes:
        for topic, port in config.clients:
            if topic not in offered and recorded_topic(port, topic) in filled:
                found[topic] = _goals(bag, topic, filled) if port.interface.is_action else _exchanges(bag, topic)
    return {topic: functools.partial(RecordedChannel, topic, calls) for topic, calls in found.items()}


def _messages(bag: Bag, *topics: str) -> Iterator[tuple[str, RosMessage]]:
    """The messages of topics with their time of reception as the stamp."""
    for topic, message in bag.messages({topic: topic for topic in topics}, {}):
        if isinstance(message, RosMessage):
            yield topic, message


def _exchanges(bag: Bag, service: str) -> list[RecordedCall]:
    """The calls of a service in the order of their requests. Their contents may be missing."""
    calls: dict[tuple[bytes, int], tuple[RecordedCall, int]] = {}
    for _, event in _messages(bag, f"{service}/_service_event"):
        info = event.info
        key = bytes(info.client_gid), int(info.sequence_number)
        at = info.stamp.sec * SECOND + info.stamp.nanosec
        if info.event_type in _REQUESTS and key not in calls and len(event.request):
            calls[key] = RecordedCall(event.request[0]), at
        elif info.event_type in _RESPONSES and key in calls and len(event.response):
            call, begin = calls[key]
            call.end = max(0, at - begin), "succeeded", event.response[0]
    return [call for call, _ in calls.values()]


def _goals(bag: Bag, action: str, filled: set[str]) -> list[RecordedCall]:
    """The goals of an action, in the order of their acceptance."""
    prefix = f"{action}/_action"
    status, feedback = f"{prefix}/status", f"{prefix}/feedback"
    sent, results = f"{prefix}/send_goal/_service_event", f"{prefix}/get_result/_service_event"
    goals: dict[bytes, tuple[RecordedCall, int]] = {}
    waiting: dict[tuple[bytes, int], bytes] = {}
    for topic, message in _messages(bag, *(each for each in (status, feedback, sent, results) if each in filled)):
        at = message.stamp
        if topic == status:
            for one in message.status_list:
                call, begin = goals.setdefault(bytes(one.goal_info.goal_id.uuid), (RecordedCall(), at))
                if one.status in _OUTCOMES and call.end is None:
                    call.end = at - begin, _OUTCOMES[one.status], None
        elif topic == feedback:
            call, begin = goals.setdefault(bytes(message.goal_id.uuid), (RecordedCall(), at))
            call.feedback.append((at - begin, message.feedback))
        else:
            key = topic.encode() + bytes(message.info.client_gid), int(message.info.sequence_number)
            if message.info.event_type in _REQUESTS and len(message.request):
                waiting[key] = bytes(message.request[0].goal_id.uuid)
                if topic == sent:
                    call, _ = goals.setdefault(waiting[key], (RecordedCall(), at))
                    call.message = message.request[0].goal
            elif key in waiting and len(message.response):
                call, begin = goals.setdefault(waiting[key], (RecordedCall(), at))
                response = message.response[0]
                if topic == sent:
                    call.accepted = bool(response.accepted)
                elif response.status in _OUTCOMES:
                    time_s = at - begin if call.end is None else call.end[0]
                    call.end = time_s, _OUTCOMES[response.status], response.result
    return [call for call, _ in goals.values()]


def _fits(given: Any, recorded: Any) -> bool:
    """Whether each given field is that of the recorded message; floats may have been rounded to 32 bits."""
    if hasattr(given, "get_fields_and_field_types"):
        names: Any = given.get_fields_and_field_types()
    elif hasattr(given, "__dict__"):
        names = vars(given)
    elif isinstance(given, (str, bytes)):
        return given == recorded
    elif isinstance(given, (Sequence, np.ndarray)) or hasattr(given, "typecode"):
        return len(given) == len(recorded) and all(map(_fits, given, recorded))
    elif isinstance(given, float):
        return math.isclose(given, recorded, rel_tol=1e-6, abs_tol=1e-9) or (math.isnan(given) and math.isnan(recorded))
    else:
        return bool(given == recorded)
    return all(hasattr(recorded, name) and _fits(getattr(given, name), getattr(recorded, name)) for name in names)
