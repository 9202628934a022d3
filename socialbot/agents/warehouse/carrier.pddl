;; A carrier's view of the warehouse: it shuttles between its loading bay (base) and its deposit.
;; Names and durations (s) are those of ROS2-BDI's demonstration.
(define (domain carrier-domain)
  (:requirements :strips :typing :fluents :durative-actions :negative-preconditions)

  (:types
    base_wp deposit_wp - waypoint
    waypoint carrier box - object)

  (:predicates
    (in ?c - carrier ?w - waypoint)
    (fully_loaded ?c - carrier)
    (fully_unloaded ?c - carrier)
    (lb_load_completed ?c - carrier)                                ; the gripper has let go of the last box
    (sent_off ?c - carrier))                                        ; no more boxes come

  (:functions
    (moving_boxes ?c - carrier))

  (:durative-action carrier_move
    :parameters (?c - carrier ?from - waypoint ?to - waypoint)
    :duration (= ?duration 6)
    :condition (at start (in ?c ?from))
    :effect (and
      (at start (not (in ?c ?from)))
      (at end (in ?c ?to))))

  (:durative-action carrier_unload
    :parameters (?c - carrier ?d - deposit_wp)
    :duration (= ?duration 2)
    :condition (and
      (at start (> (moving_boxes ?c) 0))
      (at start (fully_loaded ?c))
      (at start (in ?c ?d))
      (over all (in ?c ?d)))
    :effect (and
      (at start (not (fully_loaded ?c)))
      (at end (fully_unloaded ?c))
      (at end (assign (moving_boxes ?c) 0)))))
