"""Parser of AgentSpeak programs, plans and plan bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from socialbot.bdi.agentspeak._terms import TermReader
from socialbot.bdi.agentspeak.lexer import BINARY, END, REMEDIES, TRIGGERS, AgentSpeakError, Level, Source
from socialbot.bdi.literals import Change, Event, Literal, literal
from socialbot.bdi.plans import Inference, Origin, Plan
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, For, Fork, If, Step, Update, While
from socialbot.bdi.terms import NOTHING, Atom, Conjunction, Expression, Variable, conjunction

_NESTED = {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}

_JOINS = {word for word, (level, _) in BINARY.items() if level <= Level.COMPARE}

T = TypeVar("T")

DIRECTIVES = frozenset({"include", "begin", "end", "namespace", "register_function"})


@dataclass(frozen=True)
class Program:
    """Content of an AgentSpeak text; each kind in source order."""

    beliefs: tuple[Literal, ...]
    inferences: tuple[Inference, ...]
    goals: tuple[Literal, ...]
    plans: tuple[Plan, ...]


def parse(text: str, file: str = "<text>") -> Program:
    """Parse a whole text. Raises AgentSpeakError."""
    return _whole(text, file, Parser.program)


def parse_plan(text: str, file: str = "<text>") -> Plan:
    """Parse one plan; the final dot is optional. Raises AgentSpeakError."""
    return _whole(text, file, Parser.one_plan)


def parse_literal(text: str, file: str = "<text>") -> Literal:
    """Parse one literal such as ``at(home)[source(bob)]``. Raises AgentSpeakError."""
    return _whole(text, file, Parser.literal)


def parse_term(text: str, file: str = "<text>") -> object:
    """Parse one term. Raises AgentSpeakError."""
    return _whole(text, file, lambda parser: parser.expression(Level.SUM))


def parse_condition(text: str, file: str = "<text>") -> Conjunction:
    """Parse a condition such as the context of a plan. Raises AgentSpeakError."""
    return _whole(text, file, lambda parser: conjunction(parser.condition()))


def parse_event(text: str, file: str = "<text>") -> Event:
    """Parse a trigger such as ``+b(X)``. Raises AgentSpeakError."""
    return _whole(text, file, Parser.event)


def _whole(text: str, file: str, read: Callable[[Parser], T]) -> T:
    parser = Parser(Source(text, file))
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
    """Parser of programs, plans and plan bodies."""

    def program(self) -> Program:
        beliefs: list[Literal] = []
        inferences: list[Inference] = []
        goals: list[Literal] = []
        plans: list[Plan] = []
        labels: dict[str, int] = {}
        words = self.words
        while (word := words[self.at]) != END:
            if word in ("+", "-", "@"):
                start = self.at
                plan = self.plan((".",))
                self.at += 1
                if plan.label in labels:
                    what = f"the label '{plan.label}' is already used in line {labels[plan.label]}"
                    raise self.source.error(start, what, "choose another label")
                if plan.label is not None and plan.origin is not None:
                    labels[plan.label] = plan.origin.line
                plans.append(plan)
            elif word == "!":
                goals.append(self.goal())
            elif word == "{":
                raise self.in_braces(bool(plans) and words[self.at - 1] == ".")
            else:
                self.fact(beliefs, inferences)
        return Program(tuple(beliefs), tuple(inferences), tuple(goals), tuple(plans))

    def in_braces(self, after_plan: bool) -> AgentSpeakError:
        name = self.words[self.at + 1]
        if after_plan and name not in DIRECTIVES:
            return self.unsupported("a plan within a plan", self.at, "write the inner plan after the outer one")
        remedy = "load both files" if name == "include" else None
        return self.unsupported(f"the directive '{name}'" if name != END else "a directive", self.at, remedy)

    def goal(self) -> Literal:
        self.at += 1
        start = self.at
        goal = self.literal("a goal after '!'")
        if goal.annotations and self.limited(goal, start)[1] is not None:
            raise self.source.error(start, "an initial goal has no limit", "set it where the goal is a step")
        self.skip(".", "'.' after a goal")
        return goal

    def fact(self, beliefs: list[Literal], inferences: list[Inference]) -> None:
        """Read a belief or an inference rule."""
        start = self.at
        head = self.literal("a belief, a goal or a plan")
        word = self.words[self.at]
        if word == ":-":
            self.at += 1
            condition = conjunction(self.condition())
            if self.words[self.at] != ".":
                self.fail("'.', '&' or '|' after a condition")
            inferences.append(Inference(head, condition, self.origin(start), self.text(start)))
        elif word != ".":
            self.fail("'.' or ':-' after a belief")
        elif unknown := head.names():
            names = ", ".join(sorted(unknown))
            raise self.source.error(
                start, f"{names} has no value in this belief", f"give it one, or write a rule: {head} :- ..."
            )
        else:
            beliefs.append(head)
        self.at += 1

    def origin(self, start: int) -> Origin:
        source = self.source
        return Origin(source.file, source.line(source.start(start)))

    def text(self, start: int) -> str:
        """Return the text from token ``start`` to the current one, exclusive."""
        source = self.source
        return source.text[source.start(start) : source.start(self.at)].rstrip()

    # Plans

    def one_plan(self) -> Plan:
        return self.plan((".", END))

    def plan(self, ends: tuple[str, ...]) -> Plan:
        """Read a plan up to its end token, one of ``ends``."""
        start = self.at
        words = self.words
        origin = self.origin(start)
        options = self.label() if words[start] == "@" else {}
        event = self.event()
        condition = NOTHING
        body: tuple[Step, ...] = ()
        expected = "':', '<-' or '.' after the trigger"
        if words[self.at] == ":":
            self.at += 1
            condition = conjunction(self.condition())
            expected = "'<-', '.', '&' or '|' after the context"
        if words[self.at] == "<-":
            self.at += 1
            body = self.body()
            if not body and "}" not in ends:
                self.fail("a step")
            expected = "'.' or ';' after a step"
        if words[self.at] not in ends:
            missing = "write '.' at the end of the plan before" if words[self.at] in ("+", "-", "@") else None
            self.fail(expected.replace("'.'", "'}'") if "}" in ends else expected, remedy=missing)
        return Plan(event, condition, body, **options, origin=origin, text=self.text(start))

    def label(self) -> dict[str, Any]:
        """Read a label; return the fields of the plan that it sets."""
        self.at += 1
        options: dict[str, Any] = {}
        if self.words[self.at] != "[":
            options["label"] = self.name(self.at)
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
                return False
        return True

    def event(self) -> Event:
        words = self.words
        at = self.at
        sign = words[at]
        if sign not in ("+", "-"):
            self.fail("'+' or '-' and a trigger")
        kind = words[at + 1] if words[at + 1] in ("!", "?") else ""
        self.at = at + 2 if kind else at + 1
        if self.is_variable():
            raise self.unsupported("a variable as a trigger", self.at, "write a plan for each belief or goal")
        change = TRIGGERS[sign, kind]
        trigger = self.literal("a belief, or '!' or '?' and a goal" if not kind else "a goal")
        if trigger.annotations and change is Change.ADDED:
            return self.marked(trigger, at)
        return Event(change, trigger)

    def marked(self, trigger: Literal, start: int) -> Event:
        """Read an event with the annotation ``held_for(5)`` or ``changed(Before)``; the default is an addition."""
        for note in trigger.annotations:
            match note:
                case Literal(functor="changed", args=before) if len(before) == len(trigger.args):
                    return Event(Change.CHANGED, _without(trigger, note).with_(args=trigger.args + before))
                case Literal(functor="held_for", args=(int() | float() as seconds,)):
                    return Event(Change.HELD, _without(trigger, note), seconds)
                case Literal(functor="held_for", args=(_,)):
                    raise self.source.error(start, "expected a number of seconds in held_for(...)")
        return Event(Change.ADDED, trigger)

    def braces(self) -> Plan | Event:
        """Read a plan or an event as a term."""
        self.at += 1
        start = self.at
        if self.words[start] not in ("+", "-", "@"):
            self.fail("a plan or an event, as {+!g(X) <- a(X)} or {+b(X)}", remedy="conditions go without braces")
        plan = self.plan(("}",))
        bare = self.words[start] != "@" and not plan.condition.terms and self.words[self.at - 1] != "<-"
        self.at += 1
        return plan.event if bare and not plan.body else plan

    # Bodies

    def body(self) -> tuple[Step, ...]:
        words = self.words
        steps: list[Step] = []
        while (word := words[self.at]) not in (".", "}", ")", END):
            side = _STEPS.get(word, Parser.act)(self)
            if words[self.at] in ("|&|", "|||"):
                self.simple(word)
                side = self.fork(side)
            steps += side
            if words[self.at] == ";":
                self.at += 1
            elif words[self.at - 1] != "}":
                break
        return tuple(steps)

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
        """Read a body in braces or parentheses, or a condition in parentheses."""
        word = self.words[self.at]
        if word == "(" and not self.is_group():
            return self.act()
        return self.block("}" if word == "{" else ")")

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
            return (Do(*self.limited(value, start)) if value.annotations else Do(value),)
        if isinstance(value, Atom) and value.name not in ("true", "false"):
            return (Do(literal(value.name)),)
        if isinstance(value, Variable) and self.words[self.at] not in REMEDIES:
            raise self.unsupported("a variable as an action", start, "name the action; '!' goes before a goal")
        if isinstance(value, Expression):
            remedy = "when a plan ends before the '+' or '-', write '.' there" if value.symbol in "+-" else None
            raise self.source.error(start, "expected a step, found arithmetic", remedy)
        condition = self.as_condition(value, start)
        if isinstance(condition, Literal):  # such as .length(L), a function in other places
            return (Do(condition),)
        return (Constrain(conjunction(condition)),)

    def limited(self, what: Literal, start: int) -> tuple[Literal, object]:
        """Split a goal or action into its literal and the limit of its annotation ``within(5)``."""
        for note in what.annotations:
            if isinstance(note, Literal) and note.functor == "within":
                if len(note.args) != 1:
                    raise self.source.error(start, "expected one argument of within(...)", "give seconds: within(5)")
                return _without(what, note), note.args[0]
        return what, None

    def achieve(self) -> tuple[Step, ...]:
        apart = self.words[self.at] == "!!"
        self.at += 1
        start = self.at
        goal = self.named("a goal")
        limit_s = None
        if isinstance(goal, Literal) and goal.annotations:
            goal, limit_s = self.limited(goal, start)
        return (Achieve(goal, apart, limit_s),)

    def ask(self) -> tuple[Step, ...]:
        self.at += 1
        start = self.at
        value = self.expression(Level.OR)
        return (Ask(value if isinstance(value, Variable) else self.as_condition(value, start)),)

    def update(self) -> tuple[Step, ...]:
        sign = self.words[self.at]
        self.at += 1
        if self.words[self.at] == "{":
            raise self.unsupported(f"'{sign}{{'", self.at - 1, "use .add_plan or .remove_plan")
        return (Update(sign, self.named("a belief")),)

    def named(self, what: str) -> Literal | Variable:
        return self.variable() if self.is_variable() else self.literal(what)

    def if_(self) -> tuple[Step, ...]:
        condition = self.in_parentheses()
        then = self.block()
        otherwise: tuple[Step, ...] = ()
        if self.words[self.at] == "elif":
            otherwise = self.if_()
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
        body = self.body()
        self.skip(end, f"';' or '{end}' after a step")
        return body


def _without(item: Literal, note: object) -> Literal:
    return item.with_(annotations=tuple(other for other in item.annotations if other is not note))


_STEPS: dict[str, Callable[[Parser], tuple[Step, ...]]] = {
    **dict.fromkeys(("!", "!!"), Parser.achieve),
    "?": Parser.ask,
    **dict.fromkeys(("+", "-", "-+", "++", "--"), Parser.update),
    "if": Parser.if_,
    **dict.fromkeys(("while", "for"), Parser.loop),
    **dict.fromkeys("{(", Parser.group),
}
"""Step readers by first token; all other steps are actions or conditions."""
