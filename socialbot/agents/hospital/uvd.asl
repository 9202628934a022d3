// UVD: disinfects rooms with ultraviolet light.
//
// Performance: it disinfects at least 85 % of the rooms, even when 25 to 100 % of the plans fail.
// Environment: the ward: partially observable, dynamic, sequential, discrete, with other agents.
// Actuators: wheels, the light, words to Spot.
// Sensors: where it is (at), its battery (battery_low), what its actions come to (success_..., failure).
//
// The plans of a mission come from the coordinator. What is here is what it mends by itself.

kind(uvdrobot).
can(a_navigate_to). can(a_authorize_disinfect). can(a_disinfect_room). can(a_charge).

// What passes: somebody who walks through the room turns the light off; a partner who is late.
passes("person in the room").
passes("partner absent").

@charges_on_the_way
+failure(a_navigate_to(Me, Room), "low battery") : not tried(a_navigate_to(Me, Room), "low battery")
    <- +tried(a_navigate_to(Me, Room), "low battery"); by_myself(a_charge(Me)); again(a_navigate_to(Me, Room)).

@comes_back_charged
+failure(a_disinfect_room(Me, Room), "low battery") : not tried(a_disinfect_room(Me, Room), "low battery")
    <- +tried(a_disinfect_room(Me, Room), "low battery"); by_myself(a_charge(Me)); by_myself(a_navigate_to(Me, Room));
       again(a_disinfect_room(Me, Room)).

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
