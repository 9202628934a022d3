// The towers of Hanoi, and a factorial: recursion, arithmetic, results that come back from goals.
//
//     socialbot asl run examples/asl/hanoi.asl

disks(3).

!start.

+!start : disks(N) <-
    !move(N, left, right, middle);
    .count(moved(_, _, _), Moves);
    .print(N, " disks: ", Moves, " moves");
    !factorial(20, F);
    .print("20! = ", F).

+!move(0, _, _, _).
+!move(N, From, To, Other) <-
    !move(N - 1, From, Other, To);
    .print("disk ", N, " from ", From, " to ", To);
    ?moves(K);
    +moved(K + 1, From, To);
    !move(N - 1, Other, To, From).

moves(K) :- .count(moved(_, _, _), K).

+!factorial(0, 1).
+!factorial(N, F) : N > 0 <-
    !factorial(N - 1, G);
    F = N * G.
