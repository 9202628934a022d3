"""Random formulas of metric temporal logic and random traces, as data for socialbot and for another implementation."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from socialbot.runs.expectations import formulas as mtl
from socialbot.runs.expectations._time_sets import TimeSet

Term = list[Any]
"""Formula as a list: its operator, perhaps a window, its parts."""

NAMES = ("p", "q", "r")
UNARY = ("F", "G", "O", "H")
BINARY = ("U", "S")


def random_term(rng: random.Random, depth: int) -> Term:
    """A formula of at most ``depth`` operators above each other."""
    if depth == 0 or rng.random() < 0.12:
        return ["atom", rng.choice(NAMES)]
    kind = rng.choice(("not", "and", "or", "implies", "rise", *UNARY, *UNARY, *BINARY, *BINARY))
    if kind in ("not", "rise"):
        return [kind, random_term(rng, depth - 1)]
    if kind in ("and", "or", "implies"):
        return [kind, random_term(rng, depth - 1), random_term(rng, depth - 1)]
    least = rng.choice((0, 0, 1, rng.randrange(6)))
    window = None if rng.random() < 0.25 else [least, least + rng.randrange(8)]
    parts = [random_term(rng, depth - 1) for _ in range(1 if kind in UNARY else 2)]
    return [kind, window, *parts]


def random_signals(rng: random.Random, length: int) -> dict[str, list[bool]]:
    """A trace: per atom its value at each moment, in stretches as well as in single moments."""
    signals = {}
    for name in NAMES:
        share, value, values = rng.random(), rng.random() < 0.5, []
        for _ in range(length):
            value = not value if rng.random() < share else value
            values.append(value)
        signals[name] = values
    return signals


class SignalAtom(mtl.AtomicFormula):
    """Atom of a random trace."""

    is_event = False

    def __init__(self, name: str) -> None:
        self.text = name


@dataclass
class SignalTrace:
    """Random trace as an observed one."""

    signals: Mapping[str, Sequence[bool]]
    memory: int
    complete: bool

    @property
    def end(self) -> int:
        return len(next(iter(self.signals.values()))) - 1

    @property
    def last(self) -> int:
        return self.end + self.memory

    def occurrences(self, atom: mtl.AtomicFormula, binding: mtl.Binding) -> Sequence[mtl.Occurrence]:
        moments = TimeSet.of((at, at) for at, value in enumerate(self.signals[atom.text]) if value)
        return [mtl.Occurrence(*each) for each in moments]


def formula_of(term: Term) -> mtl.TemporalFormula:
    """The formula that a term stands for."""
    kind, *rest = term
    if kind == "atom":
        return SignalAtom(rest[0])
    timed = kind in UNARY + BINARY
    window = mtl.Window(*rest[0]) if timed and rest[0] is not None else mtl.ALWAYS
    parts = [formula_of(each) for each in (rest[1:] if timed else rest)]
    made = {"F": mtl.Eventually, "G": mtl.Always, "O": mtl.Once, "H": mtl.Historically, "U": mtl.Until, "S": mtl.Since}
    if kind in made:
        return made[kind](*parts, window)
    if kind == "not":
        return ~parts[0]
    if kind == "rise":
        return mtl.Rise(parts[0])
    return {"and": parts[0] & parts[-1], "or": parts[0] | parts[-1], "implies": parts[0].implies(parts[-1])}[kind]


def verdicts(term: Term, signals: Mapping[str, Sequence[bool]], *, complete: bool) -> dict[str, str]:
    """When a formula holds for certain and when it may hold, as a 1 or a 0 for each moment."""
    formula = formula_of(term)
    trace = SignalTrace(signals, formula.memory, complete)
    must, may = formula.truth(trace, {})
    moments = range(trace.end + 1)
    return {name: "".join("01"[at in found] for at in moments) for name, found in (("must", must), ("may", may))}


# The same for rtamt, which knows no open end: what comes after it is set to the worst and to the best case.


DEEPEST = 5
"""Most operators above each other, with the atom."""


def rtamt_case(term: Term, signals: Mapping[str, Sequence[bool]], *, complete: bool) -> dict[str, Any]:
    """A formula as text for rtamt, and the trace of its variables, up to where it ends (``moments``).

    ``p`` is where an atom holds and ``not_p`` where it does not. Atoms under an odd number of negations are written as
    ``not not_p``, so that a value of -1 beyond the end is the worst case for both, and 1 the best one.

    rtamt ends a window without limit with its trace. ``inside_N`` ends it earlier: for a complete trace with that, else
    where nothing changes any more. N is how many such windows are around it, which reach less far.
    """
    text = _text(term, True, 0, complete)
    moments, reach = len(next(iter(signals.values()))), _reach(term) + 2
    more = reach * (DEEPEST + 1)
    columns: dict[str, list[list[int]]] = {}
    for name, values in signals.items():
        columns[name] = [[1 if value else -1 for value in values], [-1] * more]
        columns[f"not_{name}"] = [[-1 if value else 1 for value in values], [-1] * more]
    limits = {f"inside_{n}": moments + (0 if complete else (n + 1) * reach) for n in range(DEEPEST)}
    inside = {name: [1] * limit + [-1] * (moments + more - limit) for name, limit in limits.items()}
    worst = {name: first + rest for name, (first, rest) in columns.items()} | inside
    best = {name: first + [1] * more for name, (first, _) in columns.items()} | inside
    return {"text": text, "moments": moments, "traces": {"must": worst, "may": best}}


def _reach(term: Term) -> int:
    kind, *rest = term
    if kind == "atom":
        return 0
    window = rest[0] if kind in UNARY + BINARY else None
    parts = rest[1:] if kind in UNARY + BINARY else rest
    return (window[1] if window else 0) + 1 + max(_reach(each) for each in parts)


def _text(term: Term, positive: bool, around: int, complete: bool) -> str:
    kind, *rest = term
    if kind == "atom":
        return f"({rest[0]} >= 0)" if positive else f"(not (not_{rest[0]} >= 0))"
    if kind in UNARY + BINARY:
        window, *parts = rest
        limits = "" if window is None else f"[{window[0]}:{window[1]}]"
        ends = window is None and kind in ("F", "G", "U")
        texts = [_text(each, positive, around + ends, complete) for each in parts]
        if ends:
            texts[-1] = f"((inside_{around} >= 0) {'implies' if kind == 'G' else 'and'} {texts[-1]})"
        words = {"F": "eventually", "G": "always", "O": "once", "H": "historically", "U": "until", "S": "since"}
        word = f"{words[kind]}{limits}"
        return f"({word} {texts[0]})" if kind in UNARY else f"({texts[0]} {word} {texts[1]})"
    if kind == "not":
        return f"(not {_text(rest[0], not positive, around, complete)})"
    if kind == "rise":
        now, before = (_text(rest[0], sign, around, complete) for sign in (positive, not positive))
        return f"({now} and not (once[1:1] {before}))"
    first = _text(rest[0], positive if kind != "implies" else not positive, around, complete)
    return f"({first} {kind} {_text(rest[1], positive, around, complete)})"
