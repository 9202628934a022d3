"""Expectations on the grippers and carriers of a warehouse with two boxes for each carrier.

``socialbot test warehouse warehouse`` checks it on a simulation.
"""

from socialbot.runs.expectations import (
    achieved,
    believed,
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

LEAVES, COMES = did("carrier_move(Carrier, base, deposit)"), did("carrier_move(Carrier, deposit, base)")
PUTS = did("gripper_put_on_carrier(_, _, Carrier, _)")
LOADED = believed("moving_boxes(Carrier, 2)")

# The task
sorts_all_boxes = expect(achieved("sort_boxes")).within(125).after(wanted("sort_boxes"))
picks_up_each_box_once = expect(did("gripper_pickup(_, Box, _, _)")).exactly(1).in_total()
puts_down_each_box_that_it_picked_up = (
    expect(did("gripper_put_on_carrier(_, Box, _, _)")).within(10).after(finished("gripper_pickup(_, Box, _, _)"))
)
no_plan_is_given_up = never(planned("*", "aborted") | planned("*", "failed"))
nothing_fails = never(failed())

# Carriers
carriers_come_when_asked = expect(COMES).within(1).after(did("req_carrier_to_come(Carrier, _, _)"))
carriers_come_in_time = expect(believed("in(Carrier, base)")).within(7).after(COMES)
carriers_leave_in_time_when_loaded = expect(LEAVES).within(7).after(LOADED)
carriers_leave_only_loaded = expect(LOADED).within(0).before(LEAVES)
carriers_unload_at_the_deposit = (
    expect(finished("carrier_unload(Carrier, deposit)"))
    .within(3)
    .after(finished("carrier_move(Carrier, base, deposit)"))
)
carriers_unload_only_there = (
    expect(believed("in(Carrier, deposit)")).within(0).before(did("carrier_unload(Carrier, _)"))
)

# Work together
loads_only_carriers_that_are_there = expect(believed("in(Carrier, base)")).within(0).before(PUTS)
announces_that_it_loads = (
    expect(told("* asks * to del belief (lb_load_completed *"))
    .within(0.5)
    .after(did("gripper_put_on_carrier(_, _, _, _)"))
)
announces_that_it_has_loaded = (
    expect(told("* asks * to add belief (lb_load_completed *"))
    .within((5, 10))
    .after(did("gripper_put_on_carrier(_, _, _, _)"))
)
stands_still_while_it_loads = never(did("gripper_move(_, _, _)")).while_(doing("gripper_put_on_carrier(_, _, _, _)"))
