"""Atoms of expectations: states of people, and utterances, beliefs, goals and actions of agents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from itertools import islice
from typing import Any

from socialbot.bdi.terms import Variable
from socialbot.core.errors import RuleError, suggestion
from socialbot.core.messages import Health, TraceRecord
from socialbot.runs.expectations._observation import (
    HEALTH,
    ActionObserver,
    AtomObserver,
    EventObserver,
    PersonObserver,
    StateObserver,
)
from socialbot.runs.expectations._patterns import TextPattern, call_of, names_in, pattern_of
from socialbot.runs.expectations.formulas import AtomicFormula, is_number
from socialbot.runs.history import NEAR_NS, History

_FACES_RAD = 1.0
_GAP_S = 0.5
_POSTURES = ("standing", "seated")


class ObservedAtom(AtomicFormula):
    """Atom with the observer that finds it in a run.

    ``domain`` is an atom that gives values of its variables, and ``name`` that of a belief, goal or action, or the text
    of an utterance.
    """

    def __init__(
        self,
        text: str,
        observer: Callable[[], AtomObserver],
        *,
        is_event: bool,
        variables: Iterable[str] = (),
        binds: Iterable[str] | None = None,
        domain: AtomicFormula | None = None,
        name: str = "",
    ) -> None:
        self.text = text
        self.is_event = is_event
        self.variables = frozenset(variables)
        self.binds = self.variables if binds is None else frozenset(binds)
        self._observer = observer
        self._domain = domain
        self.name = name

    def observer(self) -> AtomObserver:
        return self._observer()

    def atoms(self) -> Iterator[AtomicFormula]:
        yield self
        if self._domain is not None:
            yield self._domain


def _by(record: TraceRecord, agent: str | None) -> bool:
    return agent is None or fnmatchcase(record.source, agent)


def _title(function: str, what: object, **options: object) -> str:
    given = [f"{what}"] if what != "" else []
    given += [f"{name}={value!s}" for name, value in options.items() if value is not None]
    return f"{function}({', '.join(given)})"


def _require_texts(function: str, **options: object) -> None:
    """Refuse options that are no text: they are compared with those of records."""
    for name, value in options.items():
        if value is not None and not isinstance(value, str):
            remedy = f"give a text in quotation marks: {name}='...'"
            raise RuleError(f"{name}={value!r} is no text", where=f"{function}()", remedy=remedy)


# People


class PersonInView:
    """Any person in view; called, it returns the state that a person satisfies conditions."""

    name = ""

    def __call__(
        self,
        *,
        nearer_than: float | None = None,
        farther_than: float | None = None,
        facing: bool | None = None,
        approaching: bool | None = None,
        posture: str | None = None,
        seen: bool = False,
        gap_s: float = _GAP_S,
    ) -> AtomicFormula:
        """Return the state of a person in view. All conditions must hold.

        Args:
            nearer_than: Largest distance (m); a person without a distance is nearer than nothing.
            farther_than: Least distance (m).
            facing: Whether the person faces the robot, within 1 rad.
            approaching: Whether the person comes nearer at 0.1 m/s or more.
            posture: "standing" or "seated".
            seen: Leave out predicted boxes.
            gap_s: Longest time (s) without such a detection that does not end the state.
        """
        given = {"nearer_than": nearer_than, "farther_than": farther_than, "gap_s": gap_s}
        for name, value in given.items():
            if value is not None and not is_number(value):
                raise RuleError(f"{name}={value!r} is no number", where="person()", remedy="give metres or seconds: 5")
        if posture not in (None, *_POSTURES):
            remedy = suggestion(posture, _POSTURES)
            raise RuleError(f"posture={posture!r} is no posture", where="person()", remedy=remedy)

        def is_it(found: Mapping[str, Any]) -> bool:
            distance, faces, speed = found.get("distance_m"), found.get("facing_rad"), found.get("approach_mps")
            return (
                (nearer_than is None or (distance is not None and distance < nearer_than))
                and (farther_than is None or (distance is not None and distance > farther_than))
                and (facing is None or (faces is not None and (faces <= _FACES_RAD) == facing))
                and (approaching is None or (speed is not None and (speed >= 0.1) == approaching))
                and (posture is None or found.get("posture") == posture)
                and not (seen and found.get("unseen_s", 0.0) > 0.0)
            )

        text = _title(
            self.name or "anyone",
            "",
            nearer_than=nearer_than,
            farther_than=farther_than,
            facing=facing,
            approaching=approaching,
            posture=posture,
            seen=seen or None,
        )
        return ObservedAtom(
            text,
            lambda: PersonObserver(is_it, self.name, gap_s),
            is_event=False,
            variables=(self.name,) if self.name else (),
        )


class PersonVariable(Variable, PersonInView):
    """Variable for a person, also as an argument: ``believed(greeted(person))``.

    Called, it returns the state of this person: ``person(nearer_than=6)``.
    """


# Utterances and actions


def said(what: str = "*", *, to: Variable | str | None = None, by: str | None = None) -> AtomicFormula:
    """Return the event that an utterance is spoken.

    Args:
        what: Its text, or an argument of the action that speaks it, such as the situation ``greeting``; ``*`` and
            ``?`` stand for other text.
        to: Person whom it concerns: the reasons of the utterance name them.
        by: Agent that speaks.
    """
    _require_texts("said", what=what, by=by)
    if to is not None and not isinstance(to, (str, Variable)):
        raise RuleError(f"to={to!r} is no person", where="said()", remedy="give person, a variable, or a track id")
    variable = to.name if isinstance(to, Variable) else None

    def select(record: TraceRecord, history: History) -> Iterator[Mapping[str, str]]:
        chain = [record]
        for each in history.before(record):
            if each.kind == "detection":
                break
            chain.append(each)
        action = next((each for each in chain if each.kind in ("action", "step")), None)
        if not (fnmatchcase(record.what, what) or (action and any(fnmatchcase(x, what) for x in _arguments(action)))):
            return
        if by is not None and (action is None or not _by(action, by)):
            return
        if to is None:
            yield {}
            return
        concerned = {name for each in chain for name in _named(each)}
        if variable is not None:
            yield from ({variable: name} for name in sorted(concerned))
        elif to in concerned:
            yield {}

    return ObservedAtom(
        _title("said", repr(what), to=to, by=by),
        lambda: EventObserver(select, kinds=("utterance",), later=True),
        is_event=True,
        variables=() if variable is None else (variable,),
        binds=(),
        domain=to() if isinstance(to, PersonVariable) else None,
        name=what,
    )


def _arguments(record: TraceRecord) -> tuple[str, ...]:
    return call_of(record.what)[1]


def _named(record: TraceRecord) -> set[str]:
    """Return the names in the text of a record, and in what its rule matched."""
    matched = record.detail.get("matched", ())
    texts = [str(each.get("what", "")) for each in matched if isinstance(each, Mapping)]
    return {name for text in (record.what, *texts) for name in names_in(text)}


def _event(
    function: str, what: object, kinds: tuple[str, ...], by: str | None, where: Callable[[TraceRecord], bool] | None
) -> AtomicFormula:
    _require_texts(function, by=by)
    pattern = pattern_of(what, function)

    def select(record: TraceRecord, history: History) -> Iterator[Mapping[str, str]]:
        if _by(record, by) and (where is None or where(record)) and _first_of(record, history):
            values = pattern.match(record.what)
            if values is not None:
                yield values

    return ObservedAtom(
        _title(function, pattern.text, by=by),
        lambda: EventObserver(select, kinds=kinds, later=True),
        is_event=True,
        variables=pattern.variables,
        name=pattern.name,
    )


def _first_of(record: TraceRecord, history: History) -> bool:
    """Whether an action is none that only carries out a step of a plan, which is recorded, too."""
    if record.kind != "action":
        return True
    if any(each.kind == "step" for each in islice(history.before(record), 4)):
        return False
    call = call_of(record.what)
    near = history.between(record.stamp, record.stamp + NEAR_NS)
    return not any(each.kind == "step" and each.source == record.source and call_of(each.what) == call for each in near)


def did(what: object, *, by: str | None = None) -> AtomicFormula:
    """Return the event that an agent begins an action or a step of a plan: ``did("carrier_move(_, base, _)")``."""
    return _event("did", what, ("action", "step"), by, None)


def finished(what: object, outcome: str = "*", *, by: str | None = None) -> AtomicFormula:
    """Return the event that an action or step ends, with an ``outcome`` such as "failed"."""
    _require_texts("finished", outcome=outcome)
    return _event("finished", what, ("action_end", "step_end"), by, lambda each: fnmatchcase(_outcome(each), outcome))


def _outcome(record: TraceRecord) -> str:
    return str(record.detail.get("outcome", ""))


def doing(what: object, *, by: str | None = None) -> AtomicFormula:
    """Return the state that an action or a step of a plan is in execution. Actions that end at once are left out."""
    _require_texts("doing", by=by)
    pattern = pattern_of(what, "doing")

    def begins(record: TraceRecord) -> Mapping[str, str] | None:
        return pattern.match(record.what) if _by(record, by) else None

    return ObservedAtom(
        _title("doing", pattern.text, by=by),
        lambda: ActionObserver(begins),
        is_event=False,
        variables=pattern.variables,
        name=pattern.name,
    )


def failed(what: object = "*", *, by: str | None = None) -> AtomicFormula:
    """Return the event that a goal, an action or a rule of an agent fails."""
    return _event("failed", what, ("failure",), by, None)


def told(what: str = "*", *, to: str | None = None, by: str | None = None) -> AtomicFormula:
    """Return the event that an agent sends another one a message or a request.

    Args:
        what: Its text; ``*`` and ``?`` stand for other text.
        to: Agent that receives it.
        by: Agent that sends it.
    """
    _require_texts("told", what=what, to=to, by=by)

    def select(record: TraceRecord, history: History) -> Iterator[Mapping[str, str]]:
        receiver = record.detail.get("receiver")
        is_to = to is None or receiver == to or (receiver is None and f" {to}" in record.what)
        if _by(record, by) and is_to and fnmatchcase(record.what, what):
            yield {}

    return ObservedAtom(
        _title("told", repr(what), to=to, by=by),
        lambda: EventObserver(select, kinds=("message", "said", "request")),
        is_event=True,
    )


# Beliefs and goals


def _state(
    function: str,
    pattern: TextPattern,
    changes: Callable[[TraceRecord, History], Iterable[tuple[str, Mapping[str, str], bool]]],
    kinds: tuple[str, ...],
    by: str | None,
) -> AtomicFormula:
    _require_texts(function, by=by)
    return ObservedAtom(
        _title(function, pattern.text, by=by),
        lambda: StateObserver(changes, kinds=kinds),
        is_event=False,
        variables=pattern.variables,
        name=pattern.name,
    )


def believed(what: object, *, by: str | None = None) -> AtomicFormula:
    """Return the state that an agent holds a belief, such as ``believed(personDetected("No"))``.

    Args:
        what: The belief, its class, or a text. Its variables are bound: one instance for each value.
        by: Agent that believes.
    """
    pattern = pattern_of(what, "believed")

    def changes(record: TraceRecord, history: History) -> Iterator[tuple[str, Mapping[str, str], bool]]:
        values = pattern.match(record.what)
        if values is not None and _by(record, by):
            name = f"{record.source} {record.what}"
            if record.kind == "belief":
                yield name, values, True
            elif not record.detail.get("left"):
                yield name, values, False

    return _state("believed", pattern, changes, ("belief", "unbelief"), by)


def wanted(what: object, *, by: str | None = None) -> AtomicFormula:
    """Return the event that an agent adopts a goal or desire."""
    return _event("wanted", what, ("goal", "desire"), by, None)


def wanting(what: object, *, by: str | None = None) -> AtomicFormula:
    """Return the state that an agent pursues a goal or desire, until it is achieved or dropped."""
    pattern = pattern_of(what, "wanting")

    def changes(record: TraceRecord, history: History) -> Iterator[tuple[str, Mapping[str, str], bool]]:
        if record.kind in ("goal", "desire"):
            values = pattern.match(record.what)
            if values is not None and _by(record, by):
                yield record.id, values, True
        elif record.kind == "dropped":
            yield from ((each.id, {}, False) for each in history.before(record) if each.kind == "goal")
        else:
            yield record.cause, {}, False

    kinds = ("goal", "desire", "achieved", "continued", "dropped", "desire_fulfilled", "desire_dropped")
    return _state("wanting", pattern, changes, kinds, by)


def achieved(what: object, *, by: str | None = None) -> AtomicFormula:
    """Return the event that an agent achieves a goal, or fulfils a desire."""
    return _event("achieved", what, ("achieved", "desire_fulfilled"), by, None)


def dropped(what: object = "*", *, by: str | None = None) -> AtomicFormula:
    """Return the event that an agent gives up an intention or a desire."""
    return _event("dropped", what, ("dropped", "desire_dropped", "desire_refused"), by, None)


def planned(what: object = "*", outcome: str | None = None, *, by: str | None = None) -> AtomicFormula:
    """Return the event that a plan for a desire starts; with an ``outcome`` such as "succeeded", that it ends so."""
    _require_texts("planned", outcome=outcome)
    if outcome is None:
        return _event("planned", what, ("plan_start",), by, None)
    return _event("planned", what, ("plan_end",), by, lambda each: fnmatchcase(_outcome(each), outcome))


def recorded(kind: str, what: object = "*", *, by: str | None = None) -> AtomicFormula:
    """Return the event of a trace record of any ``kind``, such as "percept" or "plan"; ``by`` is its source."""
    _require_texts("recorded", kind=kind)
    return _event(f"recorded {kind}", what, (kind,), by, None)


# Nodes and topics


def health(node: str, *states: str) -> AtomicFormula:
    """Return the state that a node has one of the health ``states``, such as "ok", "stale" or "failed"."""
    _require_texts("health", node=node)
    if not states:
        raise RuleError("health() needs a state", where=f"health({node!r})", remedy='add one: health("camera", "ok")')

    def changes(found: Health, history: History) -> Iterator[tuple[str, Mapping[str, str], bool]]:
        if fnmatchcase(found.node, node):
            yield found.node, {}, found.state in states

    return ObservedAtom(
        _title("health", ", ".join((node, *states))), lambda: StateObserver(changes, (HEALTH,)), is_event=False
    )


def message(topic: str, where: Callable[[Any], bool] | None = None) -> AtomicFormula:
    """Return the event of a recorded message on ``topic`` that satisfies ``where``; see `latest`."""

    def select(found: Any, history: History) -> Iterator[Mapping[str, str]]:
        if where is None or where(found):
            yield {}

    return ObservedAtom(_title("message", topic), lambda: EventObserver(select, (topic,)), is_event=True)


def latest(topic: str, where: Callable[[Any], bool]) -> AtomicFormula:
    """Return the state that the latest recorded message on ``topic`` satisfies ``where``.

    The record of a run holds the messages of simulators, as far as they change.
    """

    def changes(found: Any, history: History) -> Iterator[tuple[str, Mapping[str, str], bool]]:
        yield topic, {}, where(found)

    return ObservedAtom(_title("latest", topic), lambda: StateObserver(changes, (topic,)), is_event=False)


anyone = PersonInView()
"""Some person in view; the state has no variable, so it has one instance."""

person = PersonVariable("person")
"""A person in view, by track id: one instance for each."""
