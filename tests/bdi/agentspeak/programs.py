"""Random plans, such as can be written in AgentSpeak."""

from __future__ import annotations

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from socialbot.bdi.literals import Change, Event, Literal, literal
from socialbot.bdi.plans import Inference, Plan
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, For, Fork, If, Update, While
from socialbot.bdi.terms import (
    Atom,
    Call,
    Comparison,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    Negation,
    Truth,
    Variable,
    conjunction,
)

SLOW = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])

TEXT = st.text(max_size=4) | st.sampled_from(('a "b"', "\\n", "\n", "it's", "// no", "/* x", "#", "\t\r\b\f"))
ODD_NAMES = st.sampled_from(("Big", "_x", "two words", "if", "not", "it's", "été", "Été", "", "f.g", "math.pi", "wait"))
NAMES = st.sampled_from("abcdef") | ODD_NAMES
ACTIONS = NAMES | st.sampled_from((".print", ".fail", "lib.act", ".length", ".a.b"))
ATOMS = st.builds(Atom, NAMES | TEXT | st.sampled_from(("true", "false", ".x", "mod", "math.max")))
VARIABLES = st.builds(Variable, st.sampled_from(("X", "Y", "Z", "_", "_X", "Do", "None", "Éa")))
NUMBERS = st.integers(-99, 99) | st.floats(allow_nan=False, allow_infinity=False)
ARITHMETIC = st.sampled_from(("+", "-", "*", "/", "div", "mod", "**"))
COMPARISONS = st.sampled_from((">", ">=", "<", "<=", "==", "!=", "=", "=.."))


def tuples(items, least=0, most=2):
    return st.lists(items, min_size=least, max_size=most).map(tuple)


def structures(functors, args, notes):
    """Literals, but none that would be an atom as a term."""
    made = st.builds(lambda f, a, n, s: literal(f, a, n, negated=s), functors, args, notes, st.booleans())
    return made.filter(lambda item: bool(item.args or item.annotations or item.negated))


def calls(terms):
    named = st.builds(
        lambda name, args: Call(name, *args), st.sampled_from(("math.max", "f", "lib.f")), tuples(terms, 1)
    )
    return named | st.builds(Call, st.just("math.pi")) | st.builds(Call, st.sampled_from((".length", ".count")), terms)


def compound(terms):
    """Terms with other terms in them."""
    operands = NUMBERS | VARIABLES | calls(terms)
    sums = st.builds(Expression, ARITHMETIC, operands, operands)
    return (
        tuples(terms)
        | st.builds(Cons, tuples(terms, 1), VARIABLES)
        | structures(NAMES, tuples(terms), tuples(terms))
        | calls(terms)
        | sums
        | st.builds(Expression, ARITHMETIC, sums | operands, sums)
    )


_TERMS = st.recursive(NUMBERS | VARIABLES | ATOMS | TEXT, compound, max_leaves=4)
TERMS = st.deferred(lambda: _TERMS)

_NOTES = tuples(TERMS.filter(lambda note: not (isinstance(note, Literal) and note.functor == "held_for")), most=1)
NOTES = st.deferred(lambda: _NOTES)

_LITERALS = st.builds(lambda f, a, n, s: literal(f, a, n, negated=s), NAMES, tuples(TERMS), NOTES, st.booleans())
LITERALS = st.deferred(lambda: _LITERALS)


def disjunction(parts):
    first = parts[0].terms if isinstance(parts[0], Disjunction) else (conjunction(parts[0]),)
    return Disjunction((*first, *map(conjunction, parts[1:])))


SIMPLE = LITERALS | st.builds(Comparison, COMPARISONS, TERMS, TERMS) | st.builds(Truth, st.booleans())
_CONDITIONS = st.recursive(
    SIMPLE,
    lambda inner: (
        st.builds(Negation, inner)
        | tuples(inner, 2, 3).map(lambda parts: conjunction(*parts))
        | tuples(inner, 2, 3).map(disjunction)
    ),
    max_leaves=4,
)
CONDITIONS = st.deferred(lambda: _CONDITIONS)

_CONTEXTS = st.builds(conjunction, CONDITIONS)
CONTEXTS = st.deferred(lambda: _CONTEXTS)

LIMITS = st.none() | TERMS
_QUERIES = CONDITIONS.filter(lambda query: not isinstance(query, (Literal, Truth)))
QUERIES = st.deferred(lambda: _QUERIES)

_PLAIN = sorted(set(Change) - {Change.HELD, Change.CHANGED}, key=str)
_TRIGGERS = (
    st.builds(Event, st.sampled_from(_PLAIN), LITERALS)
    | st.builds(Event, st.just(Change.HELD), LITERALS, NUMBERS)
    | LITERALS.filter(lambda literal: literal.args).map(
        lambda literal: Event(Change.CHANGED, literal.with_(args=literal.args + literal.args[::-1]))
    )
)
TRIGGERS = st.deferred(lambda: _TRIGGERS)


def internal(args):
    """Internal actions, which take conditions, plans and events as arguments."""
    return st.builds(literal, st.sampled_from((".findall", "lib.act")), tuples(args, 1))


def nested(steps):
    bodies = tuples(steps)
    forks = st.builds(Fork, tuples(bodies, 2, 3), st.booleans())
    blocks = st.builds(If, CONTEXTS, bodies, bodies) | st.sampled_from((While, For)).flatmap(
        lambda kind: st.builds(kind, CONTEXTS, bodies)
    )
    inner = st.builds(Plan, TRIGGERS, st.just(Conjunction(())) | CONTEXTS, bodies)
    return blocks | forks | st.builds(Do, internal(inner | TRIGGERS | QUERIES))


_STEPS = st.recursive(
    st.builds(Do, st.builds(literal, ACTIONS, tuples(TERMS), NOTES), LIMITS)
    | st.builds(Do, internal(TERMS | QUERIES))
    | st.builds(Achieve, LITERALS, st.booleans(), LIMITS)
    | st.builds(Achieve, VARIABLES, st.booleans())
    | st.builds(Ask, CONDITIONS | VARIABLES)
    | st.builds(Update, st.sampled_from(("+", "-", "-+", "++", "--")), LITERALS | VARIABLES)
    | st.builds(Constrain, st.builds(conjunction, st.builds(Comparison, COMPARISONS, TERMS, TERMS))),
    nested,
    max_leaves=4,
)
STEPS = st.deferred(lambda: _STEPS)

PLANS = st.builds(
    Plan,
    TRIGGERS,
    st.just(Conjunction(())) | CONTEXTS,
    tuples(STEPS, most=3),
    st.none() | NAMES,
    st.booleans(),
    st.integers(-3, 3),
    st.none() | TEXT | NAMES,
    NOTES.map(lambda notes: tuple(note for note in notes if note is not Atom("atomic"))),
)
INFERENCES = st.builds(Inference, LITERALS, CONTEXTS)
