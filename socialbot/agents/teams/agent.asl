// Recovery plans of an agent without a program of its own: try a failed action once more, then tell the coordinator.

@tries_again
+failure(Action, Reason) : not tried(Action, Reason)
    <- +tried(Action, Reason); ?patience(Wait); .wait(Wait); again(Action).

@tells
+failure(Action, Reason) <- problem(Action, Reason).
