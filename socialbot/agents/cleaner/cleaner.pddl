;; A robot that cleans rooms until its battery runs low. Durations in s; names are those of ROS2-BDI's quick start.
(define (domain cleaner-domain)
  (:requirements :strips :typing :fluents :durative-actions :negative-preconditions)

  (:types waypoint cleaner - object)

  (:predicates
    (in ?r - cleaner ?w - waypoint)
    (dock ?w - waypoint)                                            ; where the battery is charged
    (workfree ?r - cleaner)                                         ; the robot does nothing else
    (cleaned ?w - waypoint)
    (dirty ?w - waypoint)                                           ; somebody saw dirt there
    (fullcharged ?r - cleaner)
    (rested ?r - cleaner))

  (:functions
    (battery_charge ?r - cleaner))                                  ; percent

  (:durative-action movetoward
    :parameters (?r - cleaner ?from - waypoint ?to - waypoint)
    :duration (= ?duration 4)
    :condition (and
      (at start (in ?r ?from))
      (at start (workfree ?r))
      (at start (> (battery_charge ?r) 15)))
    :effect (and
      (at start (not (workfree ?r)))
      (at start (not (in ?r ?from)))
      (at end (in ?r ?to))
      (at end (decrease (battery_charge ?r) 10))
      (at end (workfree ?r))))

  (:durative-action doclean
    :parameters (?r - cleaner ?w - waypoint)
    :duration (= ?duration 4)
    :condition (and
      (at start (workfree ?r))
      (at start (> (battery_charge ?r) 30))
      (over all (in ?r ?w)))
    :effect (and
      (at start (not (workfree ?r)))
      (at end (cleaned ?w))
      (at end (not (dirty ?w)))
      (at end (decrease (battery_charge ?r) 20))
      (at end (workfree ?r))))

  (:durative-action recharge
    :parameters (?r - cleaner ?w - waypoint)
    :duration (= ?duration 4)
    :condition (and
      (at start (workfree ?r))
      (over all (in ?r ?w))
      (over all (dock ?w)))
    :effect (and
      (at start (not (workfree ?r)))
      (at end (fullcharged ?r))
      (at end (assign (battery_charge ?r) 100))
      (at end (workfree ?r))))

  (:durative-action do_nothing
    :parameters (?r - cleaner)
    :duration (= ?duration 4)
    :condition (at start (workfree ?r))
    :effect (and
      (at start (not (workfree ?r)))
      (at end (rested ?r))
      (at end (workfree ?r)))))
