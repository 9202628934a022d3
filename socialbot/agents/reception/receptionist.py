"""Receptionist: Waldo shows the way, calls colleagues and tells the opening hours."""

from __future__ import annotations

from socialbot.agents.dialogue import Answer, Ask, Confirm, Respond, Script, load_script
from socialbot.agents.dialogue.conversation import tell, turn
from socialbot.agents.reception.building import BUILDING, load_building
from socialbot.agents.reception.messages import CallStatus, ColleagueCall
from socialbot.agents.waldo import TalkingWaldo, small_talk
from socialbot.agents.waldo.talking import Warn
from socialbot.bdi import Belief, Goal, Inference, LongAction, Plan, apart, compute, error_msg, variables, wait_for
from socialbot.core import paths
from socialbot.graph.ports import Input, Output, Parameter


class lost(Belief):
    """This person has asked for a room that is not in the building."""


class Summon(Goal):
    """Call a colleague in an emergency, without a confirmation."""


class Fetch(Goal):
    """Call a colleague for a person, and say whether the colleague comes."""


class call(LongAction):
    """Call a colleague; achieved if the colleague comes."""

    def start(self, colleague: str) -> None:
        self.engine.robot.call(self, colleague)

    def cancel(self) -> None:
        self.engine.robot.calls.pop(self.id, None)
        self.cancelled()


class Receptionist(TalkingWaldo):
    """Agent node of Waldo at a reception: also shows the way, calls colleagues and tells the opening hours.

    Rooms, colleagues and hours are in the file ``building``. A telephone node answers calls.
    """

    calls_out = Output(ColleagueCall, "/reception/calls")
    call_status = Input(CallStatus, "/reception/call_status", optional=True)

    building = Parameter("", "YAML file of rooms, colleagues and hours; empty: that of the demo", fixed=True)
    call_within_s = Parameter(15.0, "longest time until a colleague answers, s", minimum=0.1, maximum=120.0)

    def make_script(self) -> Script:
        self.calls: dict[str, call] = {}
        building = paths.in_workspace(self.building, where=f"{self.name}.building") if self.building else BUILDING
        self.place = load_building(building)
        base = Script(values={"room": self.place.rooms, "colleague": self.place.people}, base=small_talk())
        script = load_script(BUILDING.with_name("reception.yaml"), base=base) | self.place.script()
        if self.script:
            script = load_script(paths.in_workspace(self.script, where=f"{self.name}.script"), base=script)
        return script

    def rules(self) -> list[Plan | Inference | list[Plan]]:
        Who, What, Slots, Room, Person, Day, _ = variables("Who What Slots Room Person Day _")  # noqa: N806
        place, way = self.place, compute(lambda Room: f"way_{Room}")  # noqa: N803
        is_urgent = self.conversation.is_urgent
        limit, now = compute(lambda: self.call_within_s), self.clock.now

        def hours_of(room: str, day: str) -> tuple[str, ...]:
            return place.hours_on(day or "today", now(), room) or ()

        return [
            Respond(Who, "directions", (Room,)) >> [Answer(Who, way, ())],
            Respond(Who, "room", (Room,)) >> [Answer(Who, way, ())],
            Respond(Who, "elsewhere", _) / lost(Who) >> [-lost(Who), Answer(Who, "unknown_room", ())],
            Respond(Who, "elsewhere", _)
            >> [+lost(Who), Ask(Who, "which_room", (), What, Slots), Respond(Who, What, Slots), -lost(Who)],
            -Respond(Who, "elsewhere", _) >> [-lost(Who)],
            Respond(Who, "find_colleague", (Person,)) / (lambda Person: bool(place.colleagues[Person].room))  # noqa: N803
            >> [Answer(Who, compute(lambda Person: f"way_{place.colleagues[Person].room}"), ())],  # noqa: N803
            Respond(Who, "find_colleague", (Person,)) >> [Respond(Who, "call", (Person,))],
            Respond(Who, "call", (Person,)) >> [Confirm(Who, "shall_i_call", (Person,)), Fetch(Who, Person)],
            -Respond(Who, "call", _)[error_msg("the person says no")] >> [Answer(Who, "no_help", ())],
            Fetch(Who, Person)
            >> [Answer(Who, "calling", (Person,)), call(Person).within(limit), Answer(Who, "coming", (Person,))],
            -Fetch(Who, Person) >> [Answer(Who, "not_reached", (Person,))],
            Respond(Who, "colleague", (Person,)) >> [Respond(Who, "call", (Person,))],
            # The call begins at once; its result is told after the warning.
            Respond(Who, What, _) / (lambda What: bool(place.emergency) and is_urgent(What))  # noqa: N803
            >> [
                apart(Summon(Who, place.emergency)),
                Warn(Who, What),
                tell("calling", Who, (place.emergency,)).within(30),
            ],
            Summon(Who, Person)
            >> [call(Person).within(limit), wait_for(~turn(_), 30), tell("help_is_coming", Who, (Person,)).within(30)],
            -Summon(Who, Person) >> [wait_for(~turn(_), 30), tell("no_help_reached", Who, (Person,)).within(30)],
            Respond(Who, "room_hours", (Room, Day)) / (lambda Room: Room not in place.room_hours)  # noqa: N803
            >> [Answer(Who, "room_hours_unknown", ()), Respond(Who, "hours", (Day,))],
            Respond(Who, "room_hours", (Room, Day)) / (lambda Room, Day: bool(hours_of(Room, Day)))  # noqa: N803
            >> [Answer(Who, "room_open_on", compute(lambda Room, Day: (Day or "today", Room, *hours_of(Room, Day))))],  # noqa: N803
            Respond(Who, "room_hours", (Room, Day))
            >> [Answer(Who, "room_closed_on", compute(lambda Room, Day: (Day or "today", Room)))],  # noqa: N803
            Respond(Who, "clock", _) >> [Answer(Who, "clock", compute(lambda: (place.clock_at(now()),)))],
            Respond(Who, "hours", (Day,)) / (lambda Day: Day not in ("", "today") and place.hours_on(Day, now()))  # noqa: N803
            >> [Answer(Who, "open_on", compute(lambda Day: (Day, *(place.hours_on(Day, now()) or ()))))],  # noqa: N803
            Respond(Who, "hours", (Day,)) / (lambda Day: Day not in ("", "today"))  # noqa: N803
            >> [Answer(Who, "closed_on", (Day,))],
            Respond(Who, "hours", _) / (lambda: place.is_open(self.clock.now()))
            >> [Answer(Who, "open_now", compute(lambda: place.hours_at(self.clock.now())))],
            Respond(Who, "hours", _) / (lambda: place.hours_at(self.clock.now()) is not None)
            >> [Answer(Who, "closed_now", compute(lambda: place.hours_at(self.clock.now())))],
            Respond(Who, "hours", _) >> [Answer(Who, "closed_today", ())],
        ]

    def call(self, action: call, colleague: str) -> None:
        """Request a call; `on_call_status` ends the action."""
        self.calls[action.id] = action
        contact = self.place.colleagues[colleague].contact
        now = self.clock.now()
        self.calls_out.publish(
            ColleagueCall(stamp=now, id=action.id, colleague=colleague, contact=contact, cause=action.id)
        )

    @call_status
    def on_call_status(self, status: CallStatus) -> None:
        action = self.calls.pop(status.id, None)
        if action is not None:
            if status.state == "coming":
                action.done()
            else:
                action.failed("the colleague is unavailable")
