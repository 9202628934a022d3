"""Task network of a disinfection."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from socialbot.planning.htn.domain import Item, TaskDomain, TaskState

DISINFECT = TaskDomain("disinfect")


def mission(spot: str, uvd: str, nurse: str) -> Item:
    """The task to patrol the room of ``nurse`` with ``spot`` and to disinfect it with ``uvd``."""
    return ("m_patrol_and_disinfect", spot, uvd, nurse)


def ward(nurses: Mapping[str, str], robots: Iterable[str], waiting_room: str) -> TaskState:
    """Initial state: nurses in clean rooms, closed doors, and charged robots in the waiting room."""
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
    """Move to the room, or to its closed door, with a charged battery."""
    if state.low_battery.get(agent):
        return None
    state.loc[agent] = room
    return state


@DISINFECT.action
def a_open_door(state: TaskState, agent: str, room: str) -> TaskState:
    """Open the door."""
    state.doors[room] = True
    return state


@DISINFECT.action
def a_approach_nurse(state: TaskState, spot: str, nurse: str) -> TaskState:
    """Approach the nurse in the room."""
    return state


@DISINFECT.action
def a_authenticate_nurse(state: TaskState, spot: str, nurse: str) -> TaskState:
    """Robot and nurse authenticate each other."""
    state.authenticated[spot] = nurse
    return state


@DISINFECT.action
def a_authorize_patrol(state: TaskState, spot: str, nurse: str) -> TaskState:
    """The nurse permits one patrol."""
    state.authenticated.pop(spot, None)
    return state


@DISINFECT.action
def a_patrol_room(state: TaskState, spot: str, room: str) -> TaskState:
    """Check whether the room is fit for disinfection."""
    return state


@DISINFECT.action
def a_adapt_room(state: TaskState, nurse: str, room: str) -> TaskState:
    """The nurse tidies the room, and sends people out."""
    state.cleaned[room] = True
    return state


@DISINFECT.action
def a_authorize_disinfect(state: TaskState, uvd: str, spot: str) -> TaskState:
    """The patrol robot reports an empty room."""
    return state


@DISINFECT.action
def a_disinfect_room(state: TaskState, uvd: str, room: str) -> TaskState:
    """Disinfect with ultraviolet light."""
    state.disinfected[room] = True
    return state


@DISINFECT.action
def a_charge(state: TaskState, robot: str) -> TaskState:
    """Charge the battery."""
    state.low_battery[robot] = False
    return state


@DISINFECT.method("m_patrol_and_disinfect")
def infected(state: TaskState, spot: str, uvd: str, nurse: str) -> list[Item] | None:
    """For an infected room: meet the nurse, patrol, disinfect."""
    if state.disinfected[state.loc[nurse]]:
        return None
    return [
        ("m_approach_nurse", spot, nurse),
        ("m_patrol_room", spot, nurse),
        ("m_disinfect_room", uvd, spot, nurse),
    ]


@DISINFECT.method("m_approach_nurse")
def door_open(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Enter the room."""
    room = state.loc[nurse]
    if not state.doors[room]:
        return None
    return [("m_go", spot, room), ("a_approach_nurse", spot, nurse), ("a_authenticate_nurse", spot, nurse)]


@DISINFECT.method("m_approach_nurse")
def door_closed(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Open the door first."""
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
    """The nurse tidies the room if necessary, and permits the patrol."""
    return [
        ("m_adapt_room", nurse),
        ("m_meet_nurse", spot, nurse),
        ("a_authorize_patrol", spot, nurse),
        ("a_patrol_room", spot, state.loc[nurse]),
    ]


@DISINFECT.method("m_disinfect_room")
def patrolled(state: TaskState, uvd: str, spot: str, nurse: str) -> list[Item] | None:
    """Admit the other robot to a tidy room. There is no method for a dirty one."""
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
    """Nothing to tidy."""
    return []


@DISINFECT.method("m_meet_nurse")
def far_away(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Return to the nurse, with a charge if necessary."""
    if state.loc[spot] == state.loc[nurse] and not state.low_battery[spot]:
        return None
    return [("m_approach_nurse", spot, nurse)]


@DISINFECT.method("m_meet_nurse")
def unknown(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Authenticate again in the room."""
    if state.authenticated.get(spot) == nurse:
        return None
    return [("a_approach_nurse", spot, nurse), ("a_authenticate_nurse", spot, nurse)]


@DISINFECT.method("m_meet_nurse")
def known(state: TaskState, spot: str, nurse: str) -> list[Item]:
    """The permission is still valid."""
    return []


@DISINFECT.method("m_go")
def battery_low(state: TaskState, robot: str, room: str) -> list[Item] | None:
    """Charge first."""
    return [("a_charge", robot), ("a_navigate_to", robot, room)] if state.low_battery[robot] else None


@DISINFECT.method("m_go")
def battery_full(state: TaskState, robot: str, room: str) -> list[Item]:
    """Go at once."""
    return [("a_navigate_to", robot, room)]
