"""Proposals of a language model: an intent, a phrasing, or a plan. Each is checked; none is carried out here.

Every prompt and answer is a record of the trace, with the reason of a refusal. A rule of the agent, or a person, may
adopt an accepted proposal.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from socialbot.agents.dialogue.language_model import PROPOSAL, LanguageModel, ModelError, Prompt
from socialbot.bdi import Action, Belief, Engine, Plan
from socialbot.bdi.agentspeak import parse
from socialbot.bdi.literals import Change, Event, Literal
from socialbot.bdi.plans import nodes_of
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, If, Step
from socialbot.bdi.terms import (
    Atom,
    Comparison,
    Conjunction,
    Disjunction,
    Expression,
    Negation,
    Pattern,
    Truth,
    Variable,
    show,
)
from socialbot.core.errors import RuleError, SocialbotError

T = TypeVar("T")

Record = Callable[..., str]
"""Function ``(kind, what, cause, **detail)`` that writes a trace record, such as ``engine.trace.record``."""

MAX_UTTERANCE = 500
MAX_SLOT = 80
MOST_PLANS = 100
"""Number of accepted plan proposals that wait to be adopted; beyond it the oldest is dropped."""


@dataclass(frozen=True)
class Proposal(Generic[T]):
    """Checked proposal: its ``value``, or None and why it was ``refused``. ``record`` is the id of its trace record."""

    value: T | None
    refused: str
    record: str


@dataclass(frozen=True)
class ProposedIntent:
    """Intent with its slots."""

    name: str
    slots: Mapping[str, str]


class Refused(Exception):  # noqa: N818 - a result of a check, not an error
    """A proposal did not pass a check."""


class proposed(Belief):
    """The model proposed plans that passed the checks; the argument is the id of the record."""


class adopt(Action):
    """Add proposed plans to the plans of the agent, whose robot has `Proposals` as ``proposals``."""

    def execute(self, record: str) -> None:
        self.engine.robot.proposals.adopt(self.engine, record, self.id)


class Proposals:
    """Asks a model for proposals and checks them.

    Args:
        model: The model, or None: every proposal is refused then.
        record: Writes the trace record of each prompt and answer.
    """

    def __init__(self, model: LanguageModel | None, record: Record) -> None:
        self._model, self._record = model, record
        self._plans: dict[str, tuple[Plan, ...]] = {}

    def intent(
        self, utterance: str, declared: Mapping[str, Collection[str]], cause: str = ""
    ) -> Proposal[ProposedIntent]:
        """Map an utterance to one of the declared intents.

        Args:
            utterance: What a person said.
            declared: Intents with the names of their slots.
            cause: Id of the record that this is about.
        """
        known = "\n".join(
            f"{name}: {', '.join(sorted(slots)) or 'no slots'}" for name, slots in sorted(declared.items())
        )
        prompt = Prompt(
            "Classify what a person said to a robot. Answer with one JSON object and nothing else: "
            '{"intent": NAME, "slots": {SLOT: TEXT}}. Slots hold words of the person, unchanged. '
            f'If nothing fits: {{"intent": "unknown", "slots": {{}}}}. The intents with their slots:\n{known}',
            utterance[:MAX_UTTERANCE],
        )
        return self._proposed("intent", prompt, lambda answer: _intent(answer, prompt.text, declared), cause)

    def phrasing(self, facts: Sequence[str], plain: str, language: str = "en", cause: str = "") -> Proposal[str]:
        """Phrase facts as one answer. Whoever says it uses ``plain`` if it is refused.

        Args:
            facts: Clauses that may be said.
            plain: The answer without a model.
            language: Language of the answer (ISO 639-1).
            cause: Id of the record that this is about.
        """
        prompt = Prompt(
            f"Say these facts in one or two short sentences in the language {language!r}. Use only words, numbers and "
            "names of the facts, and leave nothing out that a 'not' changes. Answer with the sentences alone.",
            "\n".join(facts),
        )
        return self._proposed("phrasing", prompt, lambda answer: _phrasing(answer, facts, plain), cause)

    def plan(
        self, request: str, whitelist: Whitelist, limits: PlanLimits | None = None, cause: str = ""
    ) -> Proposal[tuple[Plan, ...]]:
        """Propose plans in AgentSpeak for what a person asked for.

        Args:
            request: What the plans are for.
            whitelist: Goals, actions and beliefs that the plans may use.
            limits: Limits of their size.
            cause: Id of the record that this is about.
        """
        prompt = Prompt(
            "Write plans in AgentSpeak (Jason) for a robot. Answer with the plans alone, without comments and fences. "
            "Plans have the form: +!goal(X) : condition(X) <- action(X); !other_goal. Use only these names.\n"
            f"{whitelist.described()}",
            request[:MAX_UTTERANCE],
        )
        found = self._proposed("plan", prompt, lambda answer: checked_plans(answer, whitelist, limits), cause)
        if found.value is not None:
            self._plans[found.record] = found.value
            if len(self._plans) > MOST_PLANS:
                del self._plans[next(iter(self._plans))]
        return found

    def adopt(self, engine: Engine, record: str, cause: str = "") -> None:
        """Add the proposed plans of a record to an agent, as a rule or a person decided.

        Raises:
            RuleError: No accepted plans have this record, they were adopted before, or `MOST_PLANS` newer ones wait.
        """
        plans = self._plans.pop(record, None)
        if plans is None:
            remedy = f"adopt each accepted proposal once, while it is one of the newest {MOST_PLANS}"
            raise RuleError(f"no accepted plans have the record {record!r}", remedy=remedy)
        engine.add_rules(*plans)
        self._record("adopted", record, cause, plans=[str(plan) for plan in plans])

    def _proposed(self, what: str, prompt: Prompt, check: Callable[[str], T], cause: str) -> Proposal[T]:
        answer = error = refused = ""
        value: T | None = None
        try:
            if self._model is None:
                raise ModelError("no language model is configured: set SOCIALBOT_LLM_URL")
            answer = self._model.complete(prompt)
        except ModelError as problem:
            error = refused = problem.what
        if not refused:
            try:
                value = check(answer)
            except Refused as problem:
                refused = str(problem)
            except SocialbotError as problem:
                refused = problem.what
        detail = {"instructions": prompt.instructions, "prompt": prompt.text, "answer": answer, "refused": refused}
        if error:
            detail["error"] = error
        return Proposal(value, refused, self._record(PROPOSAL, what, cause, **detail))


# Intents


def _intent(answer: str, utterance: str, declared: Mapping[str, Collection[str]]) -> ProposedIntent:
    try:
        found = json.loads(answer)
    except (ValueError, RecursionError):
        raise Refused("the answer is no JSON object") from None
    if not isinstance(found, dict) or set(found) - {"intent", "slots"}:
        raise Refused("the answer has other fields than intent and slots")
    name, slots = found.get("intent"), found.get("slots", {})
    if not isinstance(name, str) or name not in declared:
        raise Refused(f"{str(name)[:40]!r} is no declared intent")
    if not isinstance(slots, dict):
        raise Refused("the slots are no JSON object")
    said = f" {' '.join(_words(utterance))} "
    for slot, value in slots.items():
        if slot not in declared[name]:
            raise Refused(f"the intent {name} has no slot {str(slot)[:40]!r}")
        if not isinstance(value, str) or not 0 < len(value) <= MAX_SLOT:
            raise Refused(f"the slot {slot} holds no short text")
        if f" {' '.join(_words(value))} " not in said or not _words(value):
            raise Refused(f"the slot {slot} holds words that the person did not say")
    return ProposedIntent(name, dict(slots))


# Phrasings


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_FUNCTION_WORDS = _set(
    """
    a an the and or but so then that this these those of in on at to for from with by as because since when while
    after before until is are was were be been being am do did does done have has had it its there here also just
    therefore hence which who whom what why how der die das den dem des ein eine einen einem einer und oder aber
    dann dass weil denn da von im auf zu zum zur für mit bei als wenn nachdem bevor bis ist sind war waren bin hat
    habe haben hatte hatten wird wurde es auch daher le la les l un une de du d et ou mais donc que qui car parce
    quand à au aux en dans sur pour avec par est sont était étaient ai avais avait c ce ces cela j y el los las lo
    una unos o pero así porque cuando del al con por para son era eran fue he ha han había su se
    """
)
"""Words without a claim of their own, in the languages of the answers."""

_SUBJECTS = _set(
    """
    i you he she they we ich du sie er wir mich dich dir mir je tu vous nous il elle yo tú te me usted
    """
)

_NEGATIONS = _set(
    """
    not never no nobody nothing none only neither nor without cannot nicht nie kein keine keinen niemand nichts
    nur erst ohne pas jamais rien personne aucun aucune ne n seulement sans nunca nadie nada ningún ninguna solo
    sin
    """
)


def _phrasing(answer: str, facts: Sequence[str], plain: str) -> str:
    text = " ".join(answer.split())
    if not text or len(text) > 2 * len(plain) + 40:
        raise Refused("the phrasing is empty or much longer than the plain answer")
    if re.search(r"[<>{}\[\]\\`*_#|]|://|www\.|@", text):
        raise Refused("the phrasing contains markup or an address")
    known = " ".join(facts)
    for shown in re.findall(r"\d+(?:[.,]\d+)*", text):
        if shown not in re.findall(r"\d+(?:[.,]\d+)*", known):
            raise Refused(f"the number {shown} is in no fact")
    allowed = {_stem(word) for word in _words(known)}
    free = _FUNCTION_WORDS | _SUBJECTS | _NEGATIONS  # `_claims` compares subjects and denials
    for word in _words(text):
        if word not in free and not word.isdigit() and _stem(word) not in allowed:
            raise Refused(f"the word {word!r} is in no fact")
    if _claims(text) - set().union(*map(_claims, facts)):
        raise Refused("the phrasing says of somebody what a fact says of somebody else, or denies it")
    missing = {word for fact in facts for word in _words(fact) if word in _NEGATIONS} - set(_words(text))
    if missing:
        raise Refused(f"the phrasing leaves out {', '.join(sorted(missing))!r}")
    return text


def _claims(text: str) -> set[tuple[str, str, bool]]:
    """Return who is said to do what: each word with the last subject before it, and whether it is denied."""
    found: set[tuple[str, str, bool]] = set()
    for part in re.split(r"[.;:!?]|\b(?:because|denn|weil|car|parce|porque)\b", text.casefold()):
        subject, denied = "", False
        for word in _words(part):
            if word in _SUBJECTS:
                subject = word
            elif word in _NEGATIONS:
                denied = True
            elif word not in _FUNCTION_WORDS:
                found.add((subject, _stem(word), denied))
    return found


def _words(text: str) -> list[str]:
    plain = re.sub(r"n['\u2019]t\b", " not", text.casefold())
    return re.findall(r"[^\W_]+", plain)


def _stem(word: str) -> str:
    return re.sub(r"(?<=\w{3})(?:ing|ed|es|en|e|s)$", "", word)


# Plans


@dataclass(frozen=True)
class Whitelist:
    """Names with their numbers of arguments that a proposed plan may use.

    Args:
        goals: Goals that it may be a plan for, and that it may adopt.
        actions: Actions that it may carry out.
        beliefs: Beliefs that it may test.
    """

    goals: Mapping[str, int] = field(default_factory=dict)
    actions: Mapping[str, int] = field(default_factory=dict)
    beliefs: Mapping[str, int] = field(default_factory=dict)

    def described(self) -> str:
        """Return the names for a prompt."""
        kinds = {"goals": self.goals, "actions": self.actions, "beliefs": self.beliefs}
        return "\n".join(
            f"{kind}: {', '.join(f'{name}/{count}' for name, count in sorted(names.items())) or 'none'}"
            for kind, names in kinds.items()
        )


@dataclass(frozen=True)
class PlanLimits:
    """Largest text (characters), plans, steps of a plan, nesting of brackets and of steps, digits of a number.

    ``all_steps`` counts the steps of a goal with those of the plans that it leads to.
    """

    characters: int = 4000
    plans: int = 5
    steps: int = 20
    brackets: int = 12
    depth: int = 3
    digits: int = 15
    all_steps: int = 100


class PlanRefused(RuleError):  # noqa: N818 - a result of a check
    """A proposed plan is not allowed."""


_TERMS = (Variable, Atom, Expression, Comparison, Conjunction, Disjunction, Negation, Truth, Event)
"""Kinds of parts that only compute and compare."""

_STEPS = (Achieve, Ask, Constrain, Do, If)


def checked_plans(text: str, whitelist: Whitelist, limits: PlanLimits | None = None) -> tuple[Plan, ...]:
    """Return the plans of a proposed text.

    Args:
        text: Plans in AgentSpeak.
        whitelist: The names that they may use.
        limits: Limits of their size; default: `PlanLimits`.

    Raises:
        PlanRefused: The text is no list of plans, or uses something that is not allowed.
    """
    limits = limits or PlanLimits()
    if len(text) > limits.characters:
        raise PlanRefused(f"the text has more than {limits.characters} characters")
    if _nesting(text) > limits.brackets:
        raise PlanRefused(f"brackets are nested more than {limits.brackets} deep")
    if any(not (letter.isprintable() or letter in "\n\t\r") for letter in text):
        raise PlanRefused("the text contains control characters")
    if re.search(rf"\d{{{limits.digits + 1}}}", text):
        raise PlanRefused(f"a number has more than {limits.digits} digits")
    try:
        program = parse(text, "proposal")
    except SocialbotError as error:
        raise PlanRefused(f"it is no AgentSpeak: {error.what}") from None
    except (RecursionError, ValueError, OverflowError):
        raise PlanRefused("it is no AgentSpeak") from None
    if program.beliefs or program.goals or program.inferences:
        raise PlanRefused("it contains more than plans: a belief, a goal or a rule")
    if not 0 < len(program.plans) <= limits.plans:
        raise PlanRefused(f"it must contain 1 to {limits.plans} plans (got {len(program.plans)})")
    for plan in program.plans:
        _check(plan, whitelist, limits)
    _check_goals(program.plans, limits)
    return program.plans


def _nesting(text: str) -> int:
    depth = deepest = 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        deepest = max(deepest, depth)
    return deepest


def _check(plan: Plan, whitelist: Whitelist, limits: PlanLimits) -> None:
    event = plan.event
    if event.change is not Change.WANTED or not isinstance(event.literal, Literal):
        raise PlanRefused("a plan is for another event than an added goal (+!goal)")
    _named(event.literal, whitelist.goals, "goal")
    _plain(event.literal)
    if plan.atomic or plan.priority or plan.stage or plan.annotations or plan.inner or plan.until or plan.stepwise:
        raise PlanRefused("a plan has annotations or plans inside it, which are not allowed")
    _conditions(plan.condition, whitelist)
    steps = list(_steps(plan.body, limits.depth))
    if len(steps) > limits.steps:
        raise PlanRefused(f"a plan has more than {limits.steps} steps")
    for step in steps:
        _check_step(step, whitelist)


def _steps(body: tuple[Step, ...], depth: int) -> Iterator[Step]:
    """Yield the steps with those inside them. Raises PlanRefused if they are nested too deep."""
    if depth == 0:
        raise PlanRefused("steps are nested too deep")
    for step in body:
        yield step
        if isinstance(step, If):
            yield from _steps(step.then, depth - 1)
            yield from _steps(step.otherwise, depth - 1)


def _check_step(step: Step, whitelist: Whitelist) -> None:
    match step:
        case Do(action=Literal() as action, limit_s=None):
            _named(action, whitelist.actions, "action")
            _plain(action)
        case Achieve(goal=Literal() as goal, apart=False, limit_s=None):
            _named(goal, whitelist.goals, "goal")
            _plain(goal)
            for value in goal.args:
                _bounded(value)
        case Ask(query=query, marks=()):
            _conditions(query, whitelist)
        case Constrain(condition=condition) | If(condition=condition):
            _conditions(condition, whitelist)
        case _:
            raise PlanRefused(f"the step {str(step)[:60]!r} is of a kind that is not allowed")


def _named(literal: Literal, known: Mapping[str, int], kind: str) -> None:
    name = literal.functor
    if name not in known:
        raise PlanRefused(f"the {kind} {name[:40]!r} is not allowed")
    if len(literal.args) != known[name]:
        raise PlanRefused(f"the {kind} {name} has {known[name]} arguments (got {len(literal.args)})")
    if literal.annotations:
        raise PlanRefused(f"the {kind} {name} has annotations, which are not allowed")


def _plain(literal: Literal) -> None:
    """Check that the arguments are values, variables and arithmetic, and no calls or literals."""
    for part in nodes_of(literal.args)[1:]:
        if not isinstance(part, (*_TERMS, tuple)) or _is_power(part):
            raise PlanRefused(f"the argument {str(part)[:40]!r} of {literal.functor} is not allowed")


def _is_power(part: object) -> bool:
    return isinstance(part, Expression) and part.symbol == "**"


def _bounded(value: object) -> None:
    """Check that a value that a variable may get is not longer than the values that it is made of.

    Otherwise twenty steps such as ``Y = X * X`` fill the memory.
    """
    match value:
        case Expression(symbol="+" | "*", left=left, right=right):
            grows = not isinstance(left, (int, float)) and not isinstance(right, (int, float))
        case Expression():
            grows = _is_power(value)
        case tuple():
            grows = any(isinstance(each, (tuple, Pattern)) and not isinstance(each, Atom) for each in value)
        case Pattern():
            grows = not isinstance(value, (Variable, Atom))
        case _:
            grows = False
    if grows:
        raise PlanRefused(f"{show(value)[:40]!r} may become too long: add or multiply by a number")
    if isinstance(value, Expression):
        _bounded(value.left)
        _bounded(value.right)


def _conditions(condition: object, whitelist: Whitelist) -> None:
    """Check that a condition consists of beliefs that may be tested, and of comparisons."""
    inside: set[int] = set()
    for part in nodes_of(condition):
        if isinstance(part, Literal):
            if id(part) in inside:
                raise PlanRefused(f"the argument {str(part)[:40]!r} of a condition is not allowed")
            _named(part, whitelist.beliefs, "belief")
            inside.update(id(each) for each in nodes_of(part.args)[1:])
        elif isinstance(part, Comparison):
            _bounded(part.left)
            _bounded(part.right)
        elif not isinstance(part, (*_TERMS, tuple)) or _is_power(part):
            raise PlanRefused(f"the condition {str(part)[:40]!r} is not allowed")


def _check_goals(plans: tuple[Plan, ...], limits: PlanLimits) -> None:
    """Check that no goal leads to itself again, and how many steps each takes with those of the goals it leads to."""
    bodies: dict[str, list[list[Step]]] = {}
    for plan in plans:
        bodies.setdefault(str(plan.event.literal.functor), []).append(list(_steps(plan.body, 100)))  # type: ignore[union-attr]
    counts: dict[str, int] = {}

    def count(goal: str, above: tuple[str, ...] = ()) -> int:
        if goal in above:
            raise PlanRefused(f"the plans for {goal} lead to {goal} again, without end")
        if goal not in counts:
            below = (*above, goal)
            counts[goal] = max((sum(1 + of(step, below) for step in body) for body in bodies.get(goal, ())), default=0)
        return counts[goal]

    def of(step: Step, above: tuple[str, ...]) -> int:
        if isinstance(step, Achieve) and isinstance(step.goal, Literal):
            return count(step.goal.functor, above)
        return 0

    # Goals without end first: a sum says less.
    steps = {goal: count(goal) for goal in bodies}
    for goal, number in steps.items():
        if number > limits.all_steps:
            raise PlanRefused(f"the plans for {goal} lead to more than {limits.all_steps} steps")
