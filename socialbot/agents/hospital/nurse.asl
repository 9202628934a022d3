// Screen of a nurse: authenticates the robot, permits the patrol, tidies the room.
//
// The coordinator sends the plans of a mission.

kind(nurse_disinfected).
can(a_authenticate_nurse). can(a_authorize_patrol). can(a_adapt_room).

passes("nurse absent").
passes("partner absent").

@tries_again
+failure(Action, Reason) : passes(Reason) & not tried(Action, Reason)
    <- +tried(Action, Reason); ?patience(Wait); .wait(Wait); again(Action).

@tells
+failure(Action, Reason) <- problem(Action, Reason).
