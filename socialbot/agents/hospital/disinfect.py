"""How a room is disinfected, as tasks: a patrol that a nurse allows, then ultraviolet light.

State variables: ``loc`` where robots and nurses are; of each room whether its door is open (``doors``), whether it is
tidy and empty (``cleaned``), whether it is ``disinfected``; of robots whether the battery is low (``low_battery``), and
which nurse they have shown who they are (``authenticated``), who then allows one patrol.

What an action needs is left to the methods, and the robots find out whether it can be done. The way to a room is an
exception: a robot whose battery is low does not set out, so a plan that has it do that has to be revised.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from socialbot.planning.htn.domain import Item, TaskDomain, TaskState

DISINFECT = TaskDomain("disinfect")


def mission(spot: str, uvd: str, nurse: str) -> Item:
    """The task to have the room of ``nurse`` patrolled by ``spot`` and disinfected by ``uvd``."""
    return ("m_patrol_and_disinfect", spot, uvd, nurse)


def ward(nurses: Mapping[str, str], robots: Iterable[str], waiting_room: str) -> TaskState:
    """Nurses in their rooms, all doors closed, all rooms clean; robots, with full batteries, in the waiting room."""
    robots = list(robots)
    return TaskState(
        "ward",
        loc={**nurses, **dict.fromkeys(robots, waiting_room)},
        doors=dict.fromkeys(nurses.values(), False),
        cleaned=dict.fromkeys(nurses.values(), True),
        disinfected=dict.fromkeys(nurses.values(), True),
        low_battery=dict.fromkeys(robots, False),
        authenticated={},
    )


@DISINFECT.action
def a_navigate_to(state: TaskState, agent: str, room: str) -> TaskState | None:
    """It goes to the room, or before its door, unless its battery is low."""
    if state.low_battery.get(agent):
        return None
    state.loc[agent] = room
    return state


@DISINFECT.action
def a_open_door(state: TaskState, agent: str, room: str) -> TaskState:
    """It opens the door with its arm."""
    state.doors[room] = True
    return state


@DISINFECT.action
def a_approach_nurse(state: TaskState, spot: str, nurse: str) -> TaskState:
    """It goes up to the nurse."""
    return state


@DISINFECT.action
def a_authenticate_nurse(state: TaskState, spot: str, nurse: str) -> TaskState:
    """The two make sure who the other is."""
    state.authenticated[spot] = nurse
    return state


@DISINFECT.action
def a_authorize_patrol(state: TaskState, spot: str, nurse: str) -> TaskState:
    """The nurse allows one patrol."""
    state.authenticated.pop(spot, None)
    return state


@DISINFECT.action
def a_patrol_room(state: TaskState, spot: str, room: str) -> TaskState:
    """It looks whether the room is fit to be disinfected."""
    return state


@DISINFECT.action
def a_adapt_room(state: TaskState, nurse: str, room: str) -> TaskState:
    """The nurse tidies the room, and sends people out."""
    state.cleaned[room] = True
    return state


@DISINFECT.action
def a_authorize_disinfect(state: TaskState, uvd: str, spot: str) -> TaskState:
    """The robot that patrolled says that nobody is in the room."""
    return state


@DISINFECT.action
def a_disinfect_room(state: TaskState, uvd: str, room: str) -> TaskState:
    """It lights the room with ultraviolet light."""
    state.disinfected[room] = True
    return state


@DISINFECT.action
def a_charge(state: TaskState, robot: str) -> TaskState:
    """It fills its battery."""
    state.low_battery[robot] = False
    return state


@DISINFECT.method("m_patrol_and_disinfect")
def infected(state: TaskState, spot: str, uvd: str, nurse: str) -> list[Item] | None:
    """The room is to be disinfected: the nurse is met, the room patrolled, then disinfected."""
    if state.disinfected[state.loc[nurse]]:
        return None
    return [
        ("m_approach_nurse", spot, nurse),
        ("m_patrol_room", spot, nurse),
        ("m_disinfect_room", uvd, spot, nurse),
    ]


@DISINFECT.method("m_approach_nurse")
def door_open(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """The robot goes straight in."""
    room = state.loc[nurse]
    if not state.doors[room]:
        return None
    return [("m_go", spot, room), ("a_approach_nurse", spot, nurse), ("a_authenticate_nurse", spot, nurse)]


@DISINFECT.method("m_approach_nurse")
def door_closed(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """The robot opens the door first."""
    room = state.loc[nurse]
    if state.doors[room]:
        return None
    return [
        ("m_go", spot, room),
        ("a_open_door", spot, room),
        ("a_approach_nurse", spot, nurse),
        ("a_authenticate_nurse", spot, nurse),
    ]


@DISINFECT.method("m_patrol_room")
def allowed_by_nurse(state: TaskState, spot: str, nurse: str) -> list[Item]:
    """The nurse tidies the room if need be, and is met if that is not the case; then comes the patrol."""
    return [
        ("m_adapt_room", nurse),
        ("m_meet_nurse", spot, nurse),
        ("a_authorize_patrol", spot, nurse),
        ("a_patrol_room", spot, state.loc[nurse]),
    ]


@DISINFECT.method("m_disinfect_room")
def patrolled(state: TaskState, uvd: str, spot: str, nurse: str) -> list[Item] | None:
    """The room is fit: the other robot is let in. There is no way for a room that is not."""
    room = state.loc[nurse]
    if not state.cleaned[room]:
        return None
    return [("a_authorize_disinfect", uvd, spot), ("m_go", uvd, room), ("a_disinfect_room", uvd, room)]


@DISINFECT.method("m_adapt_room")
def untidy(state: TaskState, nurse: str) -> list[Item] | None:
    """The nurse tidies the room."""
    room = state.loc[nurse]
    return None if state.cleaned[room] else [("a_adapt_room", nurse, room)]


@DISINFECT.method("m_adapt_room")
def tidy(state: TaskState, nurse: str) -> list[Item]:
    """There is nothing to tidy."""
    return []


@DISINFECT.method("m_meet_nurse")
def far_away(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """The robot comes back, with a charge if it needs one."""
    if state.loc[spot] == state.loc[nurse] and not state.low_battery[spot]:
        return None
    return [("m_approach_nurse", spot, nurse)]


@DISINFECT.method("m_meet_nurse")
def unknown(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """The robot is in the room, but has to say again who it is."""
    if state.authenticated.get(spot) == nurse:
        return None
    return [("a_approach_nurse", spot, nurse), ("a_authenticate_nurse", spot, nurse)]


@DISINFECT.method("m_meet_nurse")
def known(state: TaskState, spot: str, nurse: str) -> list[Item]:
    """The nurse knows the robot, which has used no permission since."""
    return []


@DISINFECT.method("m_go")
def battery_low(state: TaskState, robot: str, room: str) -> list[Item] | None:
    """It charges first."""
    return [("a_charge", robot), ("a_navigate_to", robot, room)] if state.low_battery[robot] else None


@DISINFECT.method("m_go")
def battery_full(state: TaskState, robot: str, room: str) -> list[Item]:
    """It goes at once."""
    return [("a_navigate_to", robot, room)]
