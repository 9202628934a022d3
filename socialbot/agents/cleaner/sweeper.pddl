;; A robot that sweeps the rooms it is asked to sweep. Durations in s.
(define (domain sweeper-domain)
  (:requirements :strips :typing :durative-actions :negative-preconditions)

  (:types waypoint sweeper - object)

  (:predicates
    (in ?r - sweeper ?w - waypoint)
    (workfree ?r - sweeper)
    (swept ?w - waypoint))

  (:durative-action movetoward
    :parameters (?r - sweeper ?from - waypoint ?to - waypoint)
    :duration (= ?duration 4)
    :condition (and
      (at start (in ?r ?from))
      (at start (workfree ?r)))
    :effect (and
      (at start (not (workfree ?r)))
      (at start (not (in ?r ?from)))
      (at end (in ?r ?to))
      (at end (workfree ?r))))

  (:durative-action dosweep
    :parameters (?r - sweeper ?w - waypoint)
    :duration (= ?duration 6)
    :condition (and
      (at start (workfree ?r))
      (over all (in ?r ?w)))
    :effect (and
      (at start (not (workfree ?r)))
      (at end (swept ?w))
      (at end (workfree ?r)))))
