// A contract net: one agent calls for proposals, the others make offers, the cheapest gets the work.
// All agents have this program; who calls is told by the name.
//
//     socialbot asl run examples/asl/contract_net.asl --agents manager,ada,bob,cleo

price(ada, 30). price(bob, 20). price(cleo, 25).

!begin.

// The one who calls

+!begin : .my_name(manager) <-
    .print("who paints the fence?");
    .broadcast(achieve, offer(fence));
    .wait(.count(bid(fence, _)[source(_)], 3) | .count(refuses(fence), 3), 2000);
    .findall(o(Price, Agent), bid(fence, Price)[source(Agent)], Offers);
    .print("offers: ", Offers);
    .min(Offers, o(Price, Winner));
    .send(Winner, askOne, busy(_), Busy);
    .print(Winner, " is to do it for ", Price, "; busy before: ", Busy);
    .send(Winner, achieve, work(fence)).
+!begin.

-!begin[error(E), error_msg(M)] <- .print("nobody does it: ", E, ", ", M).

+done(Task)[source(Agent)] <- .print(Agent, " has done it").

// Those who work

+!offer(Task)[source(Caller)] : .my_name(Me) & price(Me, Price) <- .send(Caller, tell, bid(Task, Price)).
+!offer(Task)[source(Caller)] <- .send(Caller, tell, refuses(Task)).

+!work(Task)[source(Caller)] <-
    +busy(Task);
    .print("I paint the ", Task);
    .wait(20);
    -busy(Task);
    .send(Caller, tell, done(Task)).
