from socialbot.bdi import Atom, source
from socialbot.bdi.literals import literal
from socialbot.bdi.unification import Var, resolve, unify


def test_what_is_resolved_has_no_bound_variables_left_in_it():
    who, trail = Var("Who"), []
    pattern = (source(who), (literal("at", (who, 1)),))
    assert unify(who, Atom("bob"), trail)
    assert resolve(pattern) == (source(Atom("bob")), (literal("at", (Atom("bob"), 1)),))


def test_what_has_nothing_to_resolve_stays_the_same_object():
    term = (1, (source(Atom("bob")),), literal("at", (Var("X"),)))
    assert resolve(term) is term
