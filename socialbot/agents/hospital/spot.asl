// Spot: checks whether rooms are fit for disinfection, and opens doors with its arm.
//
// Performance: it detects rooms that are not fit, and reports them to the coordinator.
// Environment: the ward: partially observable, dynamic, sequential, discrete, with other agents.
// Actuators: legs, an arm, messages to the coordinator, UVD robots and nurses.
// Sensors: place (at), battery (battery_low), results of actions (success_..., failure).
//
// The coordinator sends the plans of a mission. This file has the recovery plans.

kind(spotrobot).
can(a_navigate_to). can(a_open_door). can(a_approach_nurse). can(a_authenticate_nurse).
can(a_authorize_patrol). can(a_patrol_room). can(a_authorize_disinfect). can(a_charge).

// Passing problems: an absent nurse, a person in the room, a late partner.
passes("nurse absent").
passes("person in the room").
passes("partner absent").

// Open a closed door.
@opens_door
+failure(Action, "closed door") : not tried(Action, "closed door") & at(Room) & Room \== corridor & .my_name(Me)
    <- +tried(Action, "closed door"); by_myself(a_open_door(Me, Room)); again(Action).

@charges_on_the_way
+failure(a_navigate_to(Me, Room), "low battery") : not tried(a_navigate_to(Me, Room), "low battery")
    <- +tried(a_navigate_to(Me, Room), "low battery"); by_myself(a_charge(Me)); again(a_navigate_to(Me, Room)).

@tries_again
+failure(Action, Reason) : passes(Reason) & not tried(Action, Reason)
    <- +tried(Action, Reason); ?patience(Wait); .wait(Wait); again(Action).

@tells
+failure(Action, Reason) <- problem(Action, Reason).

// Charge the battery between missions.
@charges_when_idle
+battery_low : idle & .my_name(Me) <- by_myself(a_charge(Me)).
@charges_when_free
+idle : battery_low & .my_name(Me) <- by_myself(a_charge(Me)).
