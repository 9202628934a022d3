// Spot: sees whether rooms are fit to be disinfected, and opens doors with its arm.
//
// Performance: it finds out whether a room is unfit, and reports that to the coordinator.
// Environment: the ward: partially observable, dynamic, sequential, discrete, with other agents.
// Actuators: legs, an arm, words to the coordinator, to UVD robots and nurses.
// Sensors: where it is (at), its battery (battery_low), what its actions come to (success_..., failure).
//
// The plans of a mission come from the coordinator. What is here is what it mends by itself.

kind(spotrobot).
can(a_navigate_to). can(a_open_door). can(a_approach_nurse). can(a_authenticate_nurse).
can(a_authorize_patrol). can(a_patrol_room). can(a_authorize_disinfect). can(a_charge).

// What passes: somebody who is away for a moment, a partner who is late.
passes("nurse absent").
passes("person in the room").
passes("partner absent").

// A door in its way it opens by itself.
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

// Between missions it sees to its battery.
@charges_when_idle
+battery_low : idle & .my_name(Me) <- by_myself(a_charge(Me)).
@charges_when_free
+idle : battery_low & .my_name(Me) <- by_myself(a_charge(Me)).
