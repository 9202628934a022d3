;; The gripper's view of the warehouse: a crane on rails that takes boxes from stacks and puts them on carriers.
;; Names and durations (s) are those of ROS2-BDI's demonstration. socialbot adds takes_boxes, which leaves
;; planners less to look at, and carrier_unloading, which lets carriers come several times.
(define (domain gripper-domain)
  (:requirements :strips :typing :fluents :durative-actions :negative-preconditions)

  (:types
    box stackbase - box_or_stackbase
    deposit gripper carrier - object)

  (:predicates
    (upon ?g - gripper ?base - stackbase)                           ; the gripper is over a stack or loading bay
    (on ?b - box ?below - box_or_stackbase ?base - stackbase)       ; a box stands on another, or on the floor
    (in ?what - box_or_stackbase ?base - box_or_stackbase)          ; which stack it belongs to, bases to themselves
    (clear ?top - box_or_stackbase)                                 ; nothing stands on it
    (holding ?g - gripper ?b - box)
    (stored ?b - box ?d - deposit)
    (carrier_in_base ?c - carrier ?base - stackbase)
    (carrier_in_deposit ?c - carrier ?d - deposit)
    (carrier_can_come ?c - carrier ?base - stackbase)               ; the loading bay of the carrier
    (carrier_can_go ?c - carrier ?d - deposit)                      ; the deposit of the carrier
    (carrier_moving ?c - carrier ?b - box)                          ; the box went with the carrier
    (takes_boxes ?base - stackbase))                                ; boxes may be put down here

  (:functions
    (holding_boxes ?g - gripper)
    (stacked ?base - stackbase)
    (moving_boxes ?c - carrier))

  (:durative-action gripper_pickup
    :parameters (?g - gripper ?b - box ?below - box_or_stackbase ?base - stackbase)
    :duration (= ?duration 3)
    :condition (and
      (at start (on ?b ?below ?base))
      (at start (in ?b ?base))
      (at start (in ?below ?base))
      (at start (clear ?b))
      (at start (< (holding_boxes ?g) 1))
      (over all (upon ?g ?base)))
    :effect (and
      (at start (increase (holding_boxes ?g) 1))
      (at end (not (in ?b ?base)))
      (at end (holding ?g ?b))
      (at end (not (clear ?b)))
      (at end (not (on ?b ?below ?base)))
      (at end (clear ?below))
      (at end (decrease (stacked ?base) 1))))

  (:durative-action gripper_putdown
    :parameters (?g - gripper ?b - box ?below - box_or_stackbase ?base - stackbase)
    :duration (= ?duration 3)
    :condition (and
      (at start (clear ?below))
      (at start (holding ?g ?b))
      (at start (< (stacked ?base) 3))
      (at start (takes_boxes ?base))
      (at start (in ?below ?base))
      (over all (upon ?g ?base)))
    :effect (and
      (at start (not (clear ?below)))
      (at end (decrease (holding_boxes ?g) 1))
      (at end (increase (stacked ?base) 1))
      (at end (not (holding ?g ?b)))
      (at end (clear ?b))
      (at end (on ?b ?below ?base))
      (at end (in ?b ?base))))

  (:durative-action gripper_put_on_carrier
    :parameters (?g - gripper ?b - box ?c - carrier ?base - stackbase)
    :duration (= ?duration 4)
    :condition (and
      (at start (< (moving_boxes ?c) 2))
      (at start (holding ?g ?b))
      (at start (upon ?g ?base))
      (at start (carrier_in_base ?c ?base))
      (over all (upon ?g ?base))
      (over all (carrier_in_base ?c ?base)))
    :effect (and
      (at end (decrease (holding_boxes ?g) 1))
      (at end (increase (moving_boxes ?c) 1))
      (at end (not (holding ?g ?b)))
      (at end (carrier_moving ?c ?b))))

  (:durative-action gripper_move
    :parameters (?g - gripper ?from - stackbase ?to - stackbase)
    :duration (= ?duration 5)
    :condition (at start (upon ?g ?from))
    :effect (and
      (at start (not (upon ?g ?from)))
      (at end (upon ?g ?to))))

  (:durative-action req_carrier_to_come
    :parameters (?c - carrier ?d - deposit ?base - stackbase)
    :duration (= ?duration 6)
    :condition (and
      (at start (carrier_in_deposit ?c ?d))
      (over all (clear ?base))
      (over all (carrier_can_come ?c ?base)))
    :effect (and
      (at start (not (carrier_in_deposit ?c ?d)))
      (at end (not (clear ?base)))
      (at end (carrier_in_base ?c ?base))))

  ;; A full carrier leaves and unloads by itself; whoever has more boxes for it waits until it has.
  (:durative-action carrier_unloading
    :parameters (?c - carrier ?base - stackbase ?d - deposit)
    :duration (= ?duration 8)
    :condition (and
      (at start (>= (moving_boxes ?c) 2))
      (over all (carrier_can_come ?c ?base))
      (over all (carrier_can_go ?c ?d)))
    :effect (and
      (at start (not (carrier_in_base ?c ?base)))
      (at end (clear ?base))
      (at end (carrier_in_deposit ?c ?d))
      (at end (decrease (moving_boxes ?c) 2)))))
