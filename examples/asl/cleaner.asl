// A robot cleans a corridor of cells, and carries what it finds to the bin in cell 0. It can carry one thing at a time;
// now and then its arm slips.
//
//     socialbot asl run examples/asl/cleaner.asl

at(0).
size(6).
garbage(2). garbage(3). garbage(5).
slips(3, 2).            // in cell 3 the arm slips twice

!clean.

// Goes along the corridor.
+!clean : at(X) & size(N) & X < N - 1 <- !step(1); !look; !clean.
+!clean <- !go(0); .count(binned(_), N); .print("clean: ", N, " things are in the bin").

+!look : at(X) & garbage(X) <- .print("found something in cell ", X); !pick(X); !carry(X).
+!look.

+!pick(X) : slips(X, N) & N > 0 <- -+slips(X, N - 1); .fail(error(slipped)).
+!pick(X) <- -garbage(X); +holding(X).
-!pick(X)[error(slipped)] <- .print("slipped; again"); !pick(X).

// To the bin, and back to where it was.
+!carry(X) <- !go(0); -holding(X); +binned(X); !go(X).

+!go(X) : at(X).
+!go(X) : at(Y) & X < Y <- !step(-1); !go(X).
+!go(X) : at(Y) & X > Y <- !step(1); !go(X).

+!step(D) : at(X) <- -+at(X + D); .wait(1).
