// UVD: disinfects rooms with ultraviolet light.
//
// Performance: it disinfects at least 85 % of the rooms, even when 25 to 100 % of the plans fail.
// Environment: the ward: partially observable, dynamic, sequential, discrete, with other agents.
// Actuators: wheels, the light, messages to Spot.
// Sensors: place (at), battery (battery_low), results of actions (success_..., failure).
//
// The coordinator sends the plans of a mission. This file has the recovery plans.

kind(uvdrobot).
can(a_navigate_to). can(a_authorize_disinfect). can(a_disinfect_room). can(a_charge).

// Passing problems: a person in the room, who stops the light; a late partner.
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

// Charge the battery between missions.
@charges_when_idle
+battery_low : idle & .my_name(Me) <- by_myself(a_charge(Me)).
@charges_when_free
+idle : battery_low & .my_name(Me) <- by_myself(a_charge(Me)).
