;; A courier drives between places and delivers parcels.
(define (domain courier)
  (:requirements :typing :durative-actions :fluents)
  (:types courier place parcel - object)
  (:predicates (at ?c - courier ?p - place) (waits ?x - parcel ?p - place) (delivered ?x - parcel))
  (:functions (drive_s ?from ?to - place))
  (:durative-action drive
    :parameters (?c - courier ?from ?to - place) :duration (= ?duration (drive_s ?from ?to))
    :condition (at start (at ?c ?from))
    :effect (and (at start (not (at ?c ?from))) (at end (at ?c ?to))))
  (:durative-action deliver
    :parameters (?c - courier ?x - parcel ?p - place) :duration (= ?duration 2)
    :condition (and (at start (waits ?x ?p)) (over all (at ?c ?p)))
    :effect (at end (delivered ?x))))
