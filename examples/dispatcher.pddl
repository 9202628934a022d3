;; A dispatcher lets others deliver.
(define (domain dispatcher)
  (:requirements :typing :durative-actions)
  (:types parcel - object)
  (:predicates (delivered ?x - parcel))
  (:durative-action dispatch
    :parameters (?x - parcel) :duration (= ?duration 30)
    :condition ()
    :effect (at end (delivered ?x))))
