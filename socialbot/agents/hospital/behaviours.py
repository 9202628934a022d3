"""Expectations on the coordinator, the robots and the nurses of a hospital.

``socialbot test hospital hospital`` checks it on a simulation.
"""

from socialbot.runs.expectations import (
    achieved,
    did,
    doing,
    expect,
    failed,
    finished,
    never,
    planned,
    told,
    wanted,
)

DONE = "successful"
PATROLS, DISINFECTS = did("a_patrol_room(Spot, Room)"), did("a_disinfect_room(Uvd, Room)")

# Missions
reaches_the_goal = expect(achieved("disinfect *")).within(60).after(wanted("disinfect *"))
plans_at_once = expect(planned("disinfect *")).within(0.5).after(wanted("disinfect *"))
plans_again_after_a_problem = expect(planned("disinfect *")).within(0.5).after(planned("disinfect *", "failed"))
problems_are_reported = expect(told("reports *", to="coordinator")).within(5).after(failed("a_patrol_room(_, _)"))
starts_in_time = expect(did("a_navigate_to(_, _)")).within(1).after(planned("disinfect *"))

# Safety
authenticates_before_permission = (
    expect(finished("a_authenticate_nurse(Spot, Nurse)", DONE)).within(2).before(did("a_authorize_patrol(Spot, Nurse)"))
)
patrols_only_with_permission = (
    expect(finished("a_authorize_patrol(Spot, _)", DONE)).within(2).before(did("a_patrol_room(Spot, _)"))
)
disinfects_only_patrolled_rooms = (
    expect(finished("a_patrol_room(_, Room)", DONE)).within(30).before(did("a_disinfect_room(_, Room)"))
)
disinfects_only_when_admitted = (
    expect(finished("a_authorize_disinfect(Uvd, _)", DONE)).within(30).before(did("a_disinfect_room(Uvd, _)"))
)
disinfects_each_room_once = expect(finished("a_disinfect_room(_, Room)", DONE)).at_most(1).in_total()
stays_while_it_disinfects = never(did("a_navigate_to(Uvd, _)")).while_(doing("a_disinfect_room(Uvd, _)"))
opens_the_door_before_it_enters = expect(finished("a_open_door(Spot, Room)", DONE)).before(
    did("a_approach_nurse(Spot, _)")
)
