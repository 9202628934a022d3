;; A robot that cleans rooms once they are swept; sweeping is another robot's work. Durations in s.
(define (domain team-cleaner-domain)
  (:requirements :strips :typing :durative-actions :negative-preconditions)

  (:types waypoint cleaner sweeper - object)

  (:predicates
    (in ?r - cleaner ?w - waypoint)
    (workfree ?r - cleaner)
    (swept ?w - waypoint)
    (cleaned ?w - waypoint))

  (:durative-action movetoward
    :parameters (?r - cleaner ?from - waypoint ?to - waypoint)
    :duration (= ?duration 4)
    :condition (and
      (at start (in ?r ?from))
      (at start (workfree ?r)))
    :effect (and
      (at start (not (workfree ?r)))
      (at start (not (in ?r ?from)))
      (at end (in ?r ?to))
      (at end (workfree ?r))))

  ;; Asks the sweeper, and lasts until the sweeper has done it; meanwhile the robot is free for other work.
  (:durative-action asksweeping
    :parameters (?r - cleaner ?s - sweeper ?w - waypoint)
    :duration (= ?duration 20)
    :condition (at start (not (swept ?w)))
    :effect (at end (swept ?w)))

  (:durative-action doclean
    :parameters (?r - cleaner ?w - waypoint)
    :duration (= ?duration 4)
    :condition (and
      (at start (workfree ?r))
      (at start (swept ?w))
      (over all (in ?r ?w)))
    :effect (and
      (at start (not (workfree ?r)))
      (at end (cleaned ?w))
      (at end (workfree ?r)))))
