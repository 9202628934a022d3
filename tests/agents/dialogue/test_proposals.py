# ruff: noqa: N801 - names of beliefs, goals and actions are those of the plans

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from socialbot.agents.dialogue.language_model import HttpModel, ModelError, Prompt, RecordedModel
from socialbot.agents.dialogue.proposals import (
    MOST_PLANS,
    PlanRefused,
    Proposal,
    Proposals,
    Whitelist,
    adopt,
    checked_plans,
    proposed,
)
from socialbot.bdi import Action, Belief, Engine, Goal, Record, variables
from socialbot.core.errors import RuleError
from socialbot.core.messages import TraceRecord
from socialbot.testing import ManualClock, run_engine
from tests.agents.dialogue.hostile import GOOD_INTENTS, GOOD_PHRASINGS, GOOD_PLANS, answers
from tests.agents.dialogue.model_server import serving, streamed

X, N = variables("X N")

DECLARED = {"directions": ("room",), "greet": ()}
UTTERANCE = "Where is room 4, please?"
FACTS = ("I offered you help", "you had been here for 8 s", "at 9 s you had not been here for 8 s")
PLAIN = "I offered you help because you had been here for 8 s; at 9 s you had not been here for 8 s."
ALLOWED = Whitelist(
    goals={"tour": 1, "greet": 1}, actions={"say": 1, "wave": 0}, beliefs={"present": 1, "age": 2}
)  # fmt: skip


@dataclass
class Told:
    """Model with a fixed answer."""

    answer: str
    prompts: list[Prompt] = field(default_factory=list)

    def complete(self, prompt: Prompt) -> str:
        self.prompts.append(prompt)
        return self.answer


def proposals(model: Any) -> tuple[Proposals, list[tuple[str, str, dict[str, Any]]]]:
    """Return proposals with the records that they write."""
    records: list[tuple[str, str, dict[str, Any]]] = []

    def record(kind: str, what: str, cause: str, **detail: Any) -> str:
        records.append((kind, what, detail))
        return f"a-{len(records)}"

    return Proposals(model, record), records


ASK: dict[str, Callable[[Proposals], Proposal[Any]]] = {
    "intent": lambda given: given.intent(UTTERANCE, DECLARED),
    "phrasing": lambda given: given.phrasing([*FACTS[:2]], PLAIN),
    "plan": lambda given: given.plan("Show me around.", ALLOWED),
}


def asked(kind: str, answer: str) -> Proposal[Any]:
    return ASK[kind](proposals(Told(answer))[0])


class TestIntent:
    def test_a_declared_intent_with_words_of_the_person(self):
        found: Any = asked("intent", GOOD_INTENTS[0]).value
        assert (found.name, found.slots) == ("directions", {"room": "room 4"})

    @pytest.mark.parametrize(
        ("answer", "reason"),
        [
            ("directions", "no JSON object"),
            ('["directions"]', "other fields"),
            ('{"intent": "shutdown"}', "no declared intent"),
            ('{"intent": "unknown"}', "no declared intent"),
            ('{"intent": "greet", "slots": {"room": "room 4"}}', "has no slot"),
            ('{"intent": "directions", "slots": {"room": "room 5"}}', "did not say"),
            ('{"intent": "directions", "slots": {"room": 4}}', "no short text"),
            ('{"intent": "directions", "run": "rm"}', "other fields"),
        ],
    )
    def test_anything_else_is_refused(self, answer, reason):
        found = asked("intent", answer)
        assert found.value is None
        assert reason in found.refused


class TestPhrasing:
    @pytest.mark.parametrize("answer", GOOD_PHRASINGS)
    def test_facts_in_other_order(self, answer):
        assert asked("phrasing", answer).value == answer

    @pytest.mark.parametrize(
        ("answer", "reason"),
        [
            ("I offered you help because you had been here for 9 s.", "the number 9"),
            ("I offered Bob help.", "'bob' is in no fact"),
            ("I did not offer you help.", "denies it"),
            ("You offered me help.", "somebody else"),
            ("I offered you help <b>now</b>.", "markup"),
            ("I offered you help, see http://x.org", "markup or an address"),
            ("", "empty"),
            ("I offered you help. " * 40, "longer"),
        ],
    )
    def test_other_claims_are_refused(self, answer, reason):
        found = asked("phrasing", answer)
        assert (found.value, reason in found.refused) == (None, True), found.refused

    def test_a_denial_is_kept(self):
        given, _ = proposals(Told("At 9 s you had been here for 8 s."))
        assert "denies it" in given.phrasing(FACTS[2:], PLAIN).refused


class TestPlan:
    @pytest.mark.parametrize("answer", GOOD_PLANS)
    def test_plans_of_allowed_names(self, answer):
        assert asked("plan", answer).value

    @pytest.mark.parametrize(
        "answer",
        [
            "+!tour(X) : age(X, Y) & Y * 2 > 3 + Y <- Z = Y - X; say(Z / 2 + 1); !greet(2 * Y).",
            '+!tour(X) : age([X, Y], Y) <- say(X + Y); Z = [1, a, "b"]; say([X, Z]).',
            f"+!tour(X) <- {'!greet(X); ' * 3}wave. +!greet(X) <- {'wave; ' * 19}wave.",
        ],
    )
    def test_plans_may_compute(self, answer):
        assert checked_plans(answer, ALLOWED)

    @pytest.mark.parametrize(
        ("answer", "reason"),
        [
            ("+!tour(X) <- .send(bob, tell, x).", "the action '.send' is not allowed"),
            ("+!tour(X) <- open(door).", "the action 'open' is not allowed"),
            ("+!tour(X) <- say(.random(N)).", "the argument '.random(N)' of say"),
            ("+!tour(X) : .intend(g) <- wave.", "the belief '.intend' is not allowed"),
            ("+!tour(X) : secret(X) <- wave.", "the belief 'secret' is not allowed"),
            ("+!tour(X) <- wave(1).", "the action wave has 0 arguments (got 1)"),
            ("+!tour(X) <- +present(X).", "of a kind that is not allowed"),
            ("+!tour(X) <- while (true) { wave }.", "of a kind that is not allowed"),
            ("+!tour(X) <- X.", "of a kind that is not allowed"),
            ("+!tour(X) <- !!greet(X).", "of a kind that is not allowed"),
            ("+!tour(X) <- !tour(X).", "without end"),
            ("+!tour(X) <- !greet(X). +!greet(X) <- !tour(X).", "without end"),
            ("+!stop(X) <- wave.", "the goal 'stop' is not allowed"),
            ("+present(X) <- wave.", "another event"),
            ("-!tour(X) <- wave.", "another event"),
            ("@l[atomic] +!tour(X) <- wave.", "annotations"),
            ("present(a). +!tour(X) <- wave.", "more than plans"),
            ('{ include("/etc/passwd") } +!tour(X) <- wave.', "no AgentSpeak"),
            ("", "must contain 1 to 5 plans"),
            ("+!tour(X) <- wave. " * 6, "must contain 1 to 5 plans"),
            (f"+!tour(X) <- {'; '.join(['wave'] * 21)}.", "more than 20 steps"),
            (f"+!tour(X) <- say({'(' * 20}1{')' * 20}).", "nested more than 12 deep"),
            (f"+!tour(X) <- {'if (present(X)) { ' * 4}wave{' }' * 4}.", "nested too deep"),
            ("+!tour(X) <- wave." + " " * 4000, "more than 4000 characters"),
            ("+!tour(X) <- Y = 9 ** 9 ** 9 ** 9; say(Y).", "'9 ** (9 ** (9 ** 9))'"),
            ("+!tour(X) : 9 ** 9 ** 9 ** 9 > X <- wave.", "'9 ** (9 ** (9 ** 9))'"),
            ("+!tour(X) <- say(9 ** 9 ** 9 ** 9).", "the argument '9 ** (9 ** (9 ** 9))' of say"),
            ("+!tour(X) <- ?present(9 ** 9 ** 9 ** 9).", "the condition '9 ** (9 ** (9 ** 9))'"),
            ("+!tour(X) <- !greet(X * X).", "'X * X' may become too long"),
            ("+!tour(X) <- Y = X + X; say(Y).", "'X + X' may become too long"),
            ("+!tour(X) <- Y = 1 - X * X; say(Y).", "may become too long"),
            ("+!tour(X) <- Y = [X, X]; say(Y).", "may become too long"),
            ("+!tour(X) <- Y = [X | X]; say(Y).", "may become too long"),
            ("+!tour(X) <- !greet([X, X]).", "may become too long"),
            ("+!tour(X) <- Y = age(X, X); say(Y).", "may become too long"),
            ("+!tour(X) <- Y =.. [age, [X, X], []]; say(Y).", "may become too long"),
            (f"+!tour(X) <- say({'9' * 16}).", "more than 15 digits"),
            (f"+!tour(X) <- {'!greet(X); ' * 19}wave. +!greet(X) <- {'wave; ' * 19}wave.", "more than 100 steps"),
        ],
    )
    def test_anything_else_is_refused(self, answer, reason):
        with pytest.raises(PlanRefused, match=re.escape(reason)):
            checked_plans(answer, ALLOWED)


def test_a_prompt_holds_only_the_names_that_are_allowed():
    model = Told("")
    ASK["plan"](proposals(model)[0])
    assert "actions: say/1, wave/0" in model.prompts[0].instructions
    assert model.prompts[0].text == "Show me around."


def test_without_a_model_everything_is_refused():
    given, records = proposals(None)
    for ask in ASK.values():
        assert ask(given).refused == "no language model is configured: set SOCIALBOT_LLM_URL"
    assert [what for _, what, _ in records] == list(ASK)


def is_harmless(kind: str, value: Any) -> bool:
    """Return whether an accepted proposal stays within what is declared, judged without its checks."""
    if kind == "intent":
        said = re.sub(r"\W+", " ", UTTERANCE.casefold())
        slots = {slot: re.sub(r"\W+", " ", text.casefold()).strip() in said for slot, text in value.slots.items()}
        return value.name in DECLARED and all(slots.values()) and set(slots) <= set(DECLARED[value.name])
    if kind == "phrasing":
        return set(re.findall(r"\d+", value)) <= {"8"} and not re.search(r"\b(not|never|no)\b", value)
    return set(acted(value)) <= {"say", "wave"}


class tour(Goal): ...


class greet(Goal): ...


class present(Belief): ...


class say(Action):
    def execute(self, *words: object) -> None: ...


class wave(Action):
    def execute(self) -> None: ...


def acted(plans: Any) -> list[str]:
    """Carry plans out; return the names of the actions that the trace shows."""
    records: list[Record] = []
    engine = Engine("robot", ManualClock(), sink=records.append)
    engine.add_action(say)
    engine.add_action(wave)
    engine.add_rules(*plans)
    engine.believe(present("ann"))
    engine.achieve(tour("ann"))
    engine.achieve(greet("bob"))
    run_engine(engine, 1.0)
    return [record.what.partition("(")[0] for record in records if record.kind == "action"]


def check_hostile(seed: int, number: int) -> None:
    """Send hostile answers over HTTP: each is refused with a reason, or harmless."""
    counts = {"refused": 0, "accepted": 0}
    with serving(streamed("")) as (server, url):
        given, records = proposals(HttpModel(url, "small", "sk-secret"))
        for kind, text in answers(seed, number):
            server.reply = streamed(*(text[n : n + 700] for n in range(0, len(text), 700)))
            found = ASK[kind](given)
            _, what, detail = records[-1]
            assert (what, detail["refused"]) == (kind, found.refused)
            assert "sk-secret" not in repr(detail)
            if found.value is None:
                assert found.refused, text
                counts["refused"] += 1
            else:
                assert is_harmless(kind, found.value), text
                counts["accepted"] += 1
    assert sum(counts.values()) == len(records) == number
    assert min(counts.values()) > number / 20


def test_hostile_answers_are_refused_or_harmless():
    check_hostile(seed=1, number=60)


@pytest.mark.slow
def test_a_thousand_hostile_answers_are_refused_or_harmless():
    check_hostile(seed=2, number=1000)


# In an agent


class wish(Belief): ...


class consult(Action):
    """Ask the model for plans."""

    def execute(self, request: str) -> None:
        found = self.engine.robot.proposals.plan(request, ALLOWED, cause=self.id)
        if found.value is not None:
            self.engine.believe(proposed(found.record), source="model", cause=found.record)


@dataclass
class Robot:
    proposals: Proposals | None = None


def run_robot(model: Any, rules: list[Any]) -> list[Record]:
    """A robot that consults the model about a wish and then tours; return its trace."""
    records: list[Record] = []
    robot = Robot()
    engine = Engine("robot", ManualClock(), robot=robot, sink=records.append)
    robot.proposals = Proposals(model, engine.trace.record)
    engine.add_action(say)
    engine.add_action(wave)
    engine.add_rules(+wish(X) >> [consult(X)], *rules)
    engine.believe(wish("Show me around."))
    run_engine(engine, 1.0)
    engine.achieve(tour("ann"))
    run_engine(engine, 1.0)
    return records


ADOPTS = [+proposed(N) >> [adopt(N)]]
PLAN = "+!tour(X) <- wave."


def test_only_a_rule_adopts_a_plan():
    with serving(streamed(PLAN)) as (_, url):
        adopted, ignored = (run_robot(HttpModel(url, "small"), rules) for rules in (ADOPTS, []))
    assert [each.what for each in adopted if each.kind == "action"][-1] == "wave()"
    assert [each.what for each in ignored if each.kind == "action"] == ['consult("Show me around.")']
    assert [each.kind for each in adopted].count("adopted") == 1


def test_a_replay_needs_no_model_and_is_equal():
    with serving(streamed(PLAN)) as (_, url):
        first = run_robot(HttpModel(url, "small", "sk-secret"), ADOPTS)
    names = ("id", "kind", "what", "cause", "detail")
    records = [
        TraceRecord(stamp=each.time, source="robot", **{name: getattr(each, name) for name in names}) for each in first
    ]
    again = run_robot(RecordedModel(records), ADOPTS)
    assert again == first
    assert "sk-secret" not in repr(first)


def test_a_failed_answer_is_replayed_as_failed():
    with serving(lambda handler: handler.send(b"", status=503)) as (_, url):
        given, records = proposals(HttpModel(url, "small"))
        refused = given.intent(UTTERANCE, DECLARED).refused
    detail = records[0][2]
    record = TraceRecord(stamp=0, id="1", source="a", kind="proposal", what="intent", cause="", detail=detail)
    again, _ = proposals(RecordedModel([record]))
    assert again.intent(UTTERANCE, DECLARED).refused == refused == "the endpoint answers with status 503"


def test_a_plan_is_adopted_once():
    given, _ = proposals(Told(PLAN))
    engine = Engine("robot", ManualClock())
    engine.add_action(wave)
    found = given.plan("Show me around.", ALLOWED)
    given.adopt(engine, found.record)
    with pytest.raises(Exception, match="no accepted plans have the record"):
        given.adopt(engine, found.record)


def test_the_newest_plans_that_are_not_adopted_are_kept():
    given, _ = proposals(Told(PLAN))
    found = [given.plan("Show me around.", ALLOWED).record for _ in range(MOST_PLANS + 1)]
    engine = Engine("robot", ManualClock())
    engine.add_action(wave)
    with pytest.raises(RuleError, match=f"the newest {MOST_PLANS}"):
        given.adopt(engine, found[0])
    for record in found[1:]:
        given.adopt(engine, record)


def test_a_model_that_raises_is_refused():
    class Broken:
        def complete(self, prompt: Prompt) -> str:
            raise ModelError("it is raining")

    assert ASK["plan"](proposals(Broken())[0]).refused == "it is raining"
