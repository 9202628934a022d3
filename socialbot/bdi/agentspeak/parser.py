"""Parser of AgentSpeak plans, plan bodies, literals and terms."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from socialbot.bdi.agentspeak._terms import TermReader
from socialbot.bdi.agentspeak.lexer import (
    BINARY,
    END,
    KEYWORDS,
    REMEDIES,
    TRIGGERS,
    AgentSpeakError,
    Level,
    Source,
    qualified,
)
from socialbot.bdi.literals import Change, Event, Literal, literal
from socialbot.bdi.plans import Inference, Origin, Plan
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, For, Fork, If, PlanBody, Step, Update, While
from socialbot.bdi.terms import (
    NOTHING,
    Atom,
    Comparison,
    Conjunction,
    Expression,
    LiteralVariable,
    Truth,
    Variable,
    conjunction,
)

GOAL_NOTES = ("within", "hard_deadline", "source")
LABEL_NOTES = ("atomic", "priority", "stage", "breakpoint", "all_unifs", "source")
BELIEF_NOTES = ("held_for", "changed", "source")
"""Annotations with a meaning, of goals and actions, of labels of plans, and of added beliefs as triggers."""

_PLAN_BEGINS = frozenset({"+", "-", "^", "@"})
"""First tokens of plans."""

_NESTED = {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}

_STEP_SIGNS = ("!", "!!", "?", "if", "while", "for")

_NAME = re.compile(r"\.?[^\W\d]")

_JOINS = {word for word, (level, _) in BINARY.items() if level <= Level.COMPARE}

T = TypeVar("T")


def parse_plan(text: str, file: str = "<text>") -> Plan:
    """Parse one plan; the final dot is optional. Raises AgentSpeakError."""
    return whole(text, file, Parser.one_plan)


def parse_literal(text: str, file: str = "<text>") -> Literal:
    """Parse one literal such as ``at(home)[source(bob)]``. Raises AgentSpeakError."""
    return whole(text, file, Parser.literal)


def parse_term(text: str, file: str = "<text>") -> object:
    """Parse one term. Raises AgentSpeakError."""
    return whole(text, file, lambda parser: parser.expression(Level.SUM))


def parse_condition(text: str, file: str = "<text>") -> Conjunction:
    """Parse a condition such as the context of a plan. Raises AgentSpeakError."""
    return whole(text, file, lambda parser: conjunction(parser.condition()))


def parse_event(text: str, file: str = "<text>") -> Event:
    """Parse a trigger such as ``+b(X)``. Raises AgentSpeakError."""
    return whole(text, file, Parser.event)


def whole(text: str, file: str, read: Callable[[Any], T], make: Callable[[Source], Parser] | None = None) -> T:
    """Parse all of a text with a method of the parser."""
    parser = (make or Parser)(Source(text, file))
    try:
        found = read(parser)
    except RecursionError:
        raise parser.source.error(parser.at, "this is nested too deeply") from None
    if parser.words[parser.at] == ".":
        parser.at += 1
    if parser.words[parser.at] != END:
        parser.fail("the end of the text")
    return found


class Parser(TermReader):
    """Parser of plans and plan bodies.

    Attributes:
        omissions: Warnings of steps without ``;`` before them, by token.
    """

    def __init__(self, source: Source) -> None:
        super().__init__(source)
        self.omissions: dict[int, AgentSpeakError] = {}

    def origin(self, start: int) -> Origin:
        source = self.source
        return Origin(source.file, source.line(source.start(start)))

    def text(self, start: int) -> str:
        """Return the text from token ``start`` to the current one, exclusive."""
        source = self.source
        return source.text[source.start(start) : source.start(self.at)].rstrip()

    # Plans

    def one_plan(self) -> Plan:
        plan = self.plan((".", END))
        return self.with_inner(plan) if self.words[self.at] == "." else plan

    def with_inner(self, plan: Plan) -> Plan:
        """Read the dot after a plan, and its inner plans in braces, if any."""
        self.at += 1
        words = self.words
        if not self.begins_inner():
            return plan
        start = self.at
        self.at += 1
        inner = []
        while words[self.at] in _PLAN_BEGINS:
            each = self.plan((".",))
            inner.append(self.with_inner(each))
        self.skip("}", f"an inner plan, or '}}' after those of '{_first_line(plan)}'")
        text = f"{plan.text}. {self.text(start)}"
        return replace(plan, inner=tuple(inner), text=text)

    def begins_inner(self) -> bool:
        """Check whether inner plans, which are no directive, begin here."""
        return self.words[self.at] == "{" and self.words[self.at + 1] in _PLAN_BEGINS

    def plan(self, ends: tuple[str, ...]) -> Plan:
        """Read a plan up to its end token, one of ``ends``."""
        start = self.at
        words = self.words
        origin = self.origin(start)
        options = self.label("}" in ends) if words[start] == "@" else {}
        event = self.event()
        condition = NOTHING
        body: tuple[Step, ...] = ()
        expected = "':', '<-' or '.' after the trigger"
        if words[self.at] == ":":
            self.at += 1
            condition = conjunction(self.condition())
            expected = "'<-', '.', '&' or '|' after the context"
        until = None
        if words[self.at] == "<:":
            self.at += 1
            until = conjunction(self.condition())
            expected = "'<-', '.', '&' or '|' after the goal condition"
        if words[self.at] == "<-":
            self.at += 1
            bare = words[self.at] == "true"  # a body without steps, as in Jason
            body = self.body()
            if not body and "}" not in ends:
                self.fail("a step")
            if bare and isinstance(body[0], Do) and isinstance(body[0].action, Truth):
                body = body[1:]
            expected = "'.' or ';' after a step"
        if words[self.at] not in ends:
            missing = "write '.' at the end of the plan before" if words[self.at] in ("+", "-", "@") else None
            self.fail(expected.replace("'.'", "'}'") if "}" in ends else expected, remedy=missing)
        return Plan(event, condition, body, **options, origin=origin, text=self.text(start), until=until)

    def label(self, inner: bool) -> dict[str, Any]:
        """Read a label, which may be a variable in an ``inner`` plan; return the fields of the plan that it sets."""
        self.at += 1
        options: dict[str, Any] = {}
        if inner and self.is_variable():
            options["label"] = self.variable()
        elif self.words[self.at] != "[":
            options["label"] = qualified(self.namespace, self.name(self.at), 0)
            self.at += 1
        if self.words[self.at] == "[":
            start = self.at
            notes = self.annotations()
            options["annotations"] = tuple(note for note in notes if not self.option(options, note, start))
        return options

    def option(self, options: dict[str, Any], note: object, start: int) -> bool:
        """Apply an annotation of a label; return whether the engine supports it."""
        match note:
            case Atom(name="atomic"):
                options["atomic"] = True
            case Literal(functor="priority", args=(int() as rank,)):
                options["priority"] = rank
            case Literal(functor="stage", args=(str() | Atom() as stage,)):
                options["stage"] = str(stage)
            case Literal(functor="priority", args=(_,)):
                raise self.source.error(start, "expected an integer, as in priority(3)")
            case Literal(functor="stage", args=(_,)):
                raise self.source.error(start, "expected a name, as in stage(night)")
            case _:
                self.refuse_typo(note, LABEL_NOTES, start)
                return False
        return True

    def refuse_typo(self, note: object, known: tuple[str, ...], start: int) -> None:
        """Reject an annotation whose name is almost that of one with a meaning; all others are for the program."""
        name = note.name if isinstance(note, Atom) else note.functor if isinstance(note, Literal) else ""
        near = [] if name in known else difflib.get_close_matches(name, known, 1, cutoff=0.85)
        if near:
            raise self.source.error(start, f"the annotation '{name}' has no meaning", f"did you mean '{near[0]}'?")

    def event(self) -> Event:
        words = self.words
        at = self.at
        sign = words[at]
        if sign not in ("+", "-", "^"):
            self.fail("'+' or '-' and a trigger")
        kind = words[at + 1] if words[at + 1] in ("!", "?") else ""
        self.at = at + 2 if kind else at + 1
        if sign == "^" and not kind:
            self.fail("'!' or '?' and a goal after '^'", at + 1)
        change = TRIGGERS[sign, kind]
        trigger: Any = self.literal_or_variable("a belief, or '!' or '?' and a goal" if not kind else "a goal")
        if isinstance(trigger, Literal) and trigger.annotations and change is Change.ADDED:
            return self.marked(trigger, at)
        return Event(change, trigger)

    def marked(self, trigger: Literal, start: int) -> Event:
        """Read an event with the annotation ``held_for(5)`` or ``changed(Before)``; the default is an addition."""
        for note in trigger.annotations:
            self.refuse_typo(note, BELIEF_NOTES, start)
            match note:
                case Literal(functor="changed", args=before) if len(before) == len(trigger.args):
                    return Event(Change.CHANGED, _without(trigger, note).with_(args=trigger.args + before))
                case Literal(functor="held_for", args=(int() | float() as seconds,)):
                    return Event(Change.HELD, _without(trigger, note), seconds)
                case Literal(functor="held_for", args=(_,)):
                    raise self.source.error(start, "expected a number of seconds in held_for(...)")
        return Event(Change.ADDED, trigger)

    def braces(self) -> Plan | Event | PlanBody | Inference:
        """Read a plan, an event, steps or a rule as a term."""
        namespace, self.namespace = self.namespace, self.own_namespace
        self.at += 1
        found = self.nested(self.in_braces)
        self.namespace = namespace
        return found

    def in_braces(self) -> Plan | Event | PlanBody | Inference:
        words, start = self.words, self.at
        if words[start] == "@" or (
            words[start] in ("+", "-", "^") and words[start + 1] not in ("{", "+", "-", "<", ">")
        ):
            plan = self.plan(("}", ";"))
            if words[self.at] == "}":
                self.at += 1
                bare = not plan.body and not plan.condition.terms and words[self.at - 2] != "<-"
                return plan.event if bare and words[start] != "@" else plan
            self.at = start
        else:
            rule = self.rule_in_braces()
            if rule is not None:
                return rule
        steps = self.body()
        self.skip("}", "';' or '}' after a step")
        return PlanBody(steps)

    def rule_in_braces(self) -> Inference | None:
        """Read ``head :- condition }``; return None, without progress, if there is no ``:-``."""
        start, words = self.at, self.words
        at, depth = start, 0
        while words[at] != END and (depth or words[at] not in (":-", "}", ";")):
            depth += _NESTED.get(words[at], 0)
            at += 1
        if words[at] != ":-":
            return None
        head = self.literal("the head of a rule")
        self.skip(":-", "':-' after the head of a rule")
        condition = conjunction(self.condition())
        rule = Inference(head, condition, self.origin(start), self.text(start))
        self.skip("}", "'}', '&' or '|' after a condition")
        return rule

    # Bodies

    def body(self) -> tuple[Step, ...]:
        words = self.words
        steps: list[Step] = []
        while (word := words[self.at]) not in (".", "}", ")", END):
            line = self.source.line(self.source.start(self.at))
            side = _STEPS.get(word, Parser.act)(self)
            for step in side:
                step.line = step.line or line
            if words[self.at] in ("|&|", "|||"):
                self.simple(word)
                side = self.fork(side)
            steps += side
            if words[self.at] == ";":
                self.at += 1
            elif words[self.at - 1] != "}" and not self.begins_line():
                break
        return tuple(steps)

    def begins_line(self) -> bool:
        """Check whether a step begins in a line of its own, where Jason needs no ``;`` before it; note the omission."""
        word, source, at = self.words[self.at], self.source, self.at
        if word not in _STEP_SIGNS and (word in REMEDIES or word in KEYWORDS or _NAME.match(word) is None):
            return False
        ended = source.start(at - 1) + len(self.words[at - 1])
        if "\n" not in source.text[ended : source.start(at)]:
            return False
        if at not in self.omissions:
            remedy = "write ';' after the step before, or '.' if its plan ends there"
            self.omissions[at] = source.error(at, "there is no ';' before this step", remedy)
        return True

    def side(self) -> tuple[Step, ...]:
        """Read an operand of `|&|` or `|||`: one step, or a body in braces or parentheses."""
        word = self.words[self.at]
        self.simple(word)
        return _STEPS.get(word, Parser.act)(self)

    def simple(self, word: str) -> None:
        """Reject steps that ``|&|`` and ``|||`` cannot join."""
        if word in ("if", "while", "for"):
            self.fail("a step", remedy=f"put '{word}' into braces: {{ {word} (...) {{ ... }} }}")

    def group(self) -> tuple[Step, ...]:
        """Read a body in braces or parentheses, a condition in parentheses, or a comparison of a term in braces."""
        word = self.words[self.at]
        if not (self.is_group() if word == "(" else self.is_block()):
            return self.act()
        return self.block("}" if word == "{" else ")")

    def is_block(self) -> bool:
        """Check whether the next braces enclose steps rather than a term that is compared, as in ``{ S; _ } = B``."""
        depth = 0
        for at in range(self.at, len(self.words) - 1):
            depth += _NESTED.get(self.words[at], 0)
            if depth == 0:
                return BINARY.get(self.words[at + 1], (None,))[0] != Level.COMPARE
        return True

    def is_group(self) -> bool:
        """Check whether the next parentheses enclose steps rather than all or part of a condition."""
        depth = 0
        compares = False
        for at in range(self.at, len(self.words) - 1):
            word = self.words[at]
            depth += _NESTED.get(word, 0)
            if depth == 0:
                return self.words[at + 1] not in BINARY and not compares
            if depth == 1 and word in (";", "|&|", "|||", "!", "!!", "?"):
                return True
            compares = compares or (depth == 1 and word in _JOINS)
        return True

    def fork(self, first: tuple[Step, ...]) -> tuple[Step, ...]:
        """Read parallel steps; ``|&|`` binds tighter than ``|||``."""
        return self.branches(self.together(first), "|||", lambda: self.together(self.side()))

    def together(self, first: tuple[Step, ...]) -> tuple[Step, ...]:
        return self.branches(first, "|&|", self.side)

    def branches(self, first: tuple[Step, ...], sign: str, read: Callable[[], tuple[Step, ...]]) -> tuple[Step, ...]:
        branches = [first]
        while self.words[self.at] == sign:
            self.at += 1
            branches.append(read())
        return first if len(branches) == 1 else (Fork(tuple(branches), every=sign == "|&|"),)

    def act(self) -> tuple[Step, ...]:
        """Read an action or a test condition."""
        start = self.at
        value = self.expression(Level.OR)
        if isinstance(value, Literal):
            if value.negated:
                raise self.source.error(start, "an action has no '~'", "write +~b to believe that b is false")
            if "::" in value.functor:  # actions have no namespace
                value = value.with_()
                value.functor = value.functor.rpartition("::")[2]
            return (Do(*self.limited(value, start)) if value.annotations else Do(value),)
        if isinstance(value, Atom) and value.name not in ("true", "false"):
            return (Do(literal(value.name)),)
        if isinstance(value, (Variable, LiteralVariable)) and self.words[self.at] not in REMEDIES:
            if isinstance(value, LiteralVariable) and isinstance(value.variable, Literal):
                value = value.variable  # actions have no namespace
            return (Do(value),)
        if isinstance(value, Expression):
            remedy = "when a plan ends before the '+' or '-', write '.' there" if value.symbol in "+-" else None
            raise self.source.error(start, "expected a step, found arithmetic", remedy)
        condition = self.as_condition(value, start)
        if isinstance(condition, Comparison):
            return (Constrain(conjunction(condition)),)
        # A literal such as .length(L) is a function in other places. Other conditions are actions that nobody has.
        return (Do(condition),)

    def limited(self, what: Literal, start: int) -> tuple[Literal, object]:
        """Split a goal or action into its literal and the limit of its annotation ``within(5)``.

        The annotation ``hard_deadline(5000)`` is a limit, too, but remains, since it changes the reason of the failure.
        """
        for note in what.annotations:
            self.refuse_typo(note, GOAL_NOTES, start)
            if isinstance(note, Literal) and note.functor in ("within", "hard_deadline"):
                if len(note.args) != 1:
                    unit = "seconds: within(5)" if note.functor == "within" else "milliseconds: hard_deadline(5000)"
                    raise self.source.error(start, f"expected one argument of {note.functor}(...)", f"give {unit}")
                limit = note.args[0]
                if note.functor == "within":
                    return _without(what, note), limit
                return what, limit / 1000 if isinstance(limit, (int, float)) else Expression("/", limit, 1000)
        return what, None

    def achieve(self) -> tuple[Step, ...]:
        apart = self.words[self.at] == "!!"
        self.at += 1
        start = self.at
        goal = self.literal_or_variable("a goal")
        limit_s = None
        if isinstance(goal, Literal) and goal.annotations:
            goal, limit_s = self.limited(goal, start)
        return (Achieve(goal, apart, limit_s),)

    def ask(self) -> tuple[Step, ...]:
        self.at += 1
        start = self.at
        value = self.expression(Level.OR)
        known = isinstance(value, (Variable, LiteralVariable))
        return (Ask(value if known else self.as_condition(value, start)),)

    def update(self) -> tuple[Step, ...]:
        sign = self.words[self.at]
        self.at += 1
        if self.words[self.at] == "{":
            return (self.update_of_plan(sign),)
        changed = self.literal_or_variable("a belief")
        if sign == "+>":
            return (Do(literal(".assertz", (changed,))),)
        return (Update("+" if sign == "+<" else sign, changed),)

    def update_of_plan(self, sign: str) -> Step:
        """Read ``+{plan}``, ``-{plan}`` or ``+{rule}`` after its sign."""
        start = self.at
        item = self.braces()
        if isinstance(item, Event):
            item = Plan(item, NOTHING, ())
        if isinstance(item, Inference) and sign in ("+", "+<", "+>", "-"):
            return Update(sign[0], item)
        if isinstance(item, Plan) and sign == "-":
            return Do(literal(".remove_plan", (item,)))
        if isinstance(item, Plan) and sign in ("+", "+<", "+>"):
            place = Atom("end" if sign == "+>" else "begin")
            return Do(literal(".add_plan", (item, Atom("self"), place)))
        raise self.source.error(start, f"'{sign}' cannot change a plan or rule", "write +{...} or -{...}")

    def if_(self) -> tuple[Step, ...]:
        condition = self.in_parentheses()
        then = self.block()
        otherwise: tuple[Step, ...] = ()
        if self.words[self.at] == "elif":
            otherwise = self.nested(self.if_)
        elif self.words[self.at] == "else":
            self.at += 1
            if self.words[self.at] == "if":
                self.fail("'{' after 'else'", remedy="write 'elif'")
            otherwise = self.block()
        return (If(condition, then, otherwise),)

    def loop(self) -> tuple[Step, ...]:
        kind = While if self.words[self.at] == "while" else For
        return (kind(self.in_parentheses(), self.block()),)

    def in_parentheses(self) -> Conjunction:
        """Read the condition after ``if``, ``elif``, ``while`` or ``for``."""
        word = self.words[self.at]
        self.at += 1
        self.skip("(", f"'(' after '{word}'")
        condition = conjunction(self.condition())
        self.skip(")", "an operator or ')' after a condition")
        return condition

    def block(self, end: str = "}") -> tuple[Step, ...]:
        """Read steps in braces, or in parentheses."""
        self.skip("{" if end == "}" else "(", "'{' before the steps")
        body = self.nested(self.body)
        self.skip(end, f"';' or '{end}' after a step")
        return body


def _first_line(plan: Plan) -> str:
    return (plan.text or "").split("\n", 1)[0]


def _without(item: Literal, note: object) -> Literal:
    return item.with_(annotations=tuple(other for other in item.annotations if other is not note))


_STEPS: dict[str, Callable[[Parser], tuple[Step, ...]]] = {
    **dict.fromkeys(("!", "!!"), Parser.achieve),
    "?": Parser.ask,
    **dict.fromkeys(("+", "-", "-+", "++", "--", "+<", "+>"), Parser.update),
    "if": Parser.if_,
    **dict.fromkeys(("while", "for"), Parser.loop),
    **dict.fromkeys("{(", Parser.group),
}
"""Step readers by first token; all other steps are actions or conditions."""
