"""Reads the bodies of plans: steps, and the conditions and blocks among them."""

from __future__ import annotations

from collections.abc import Callable

from socialbot.bdi.agentspeak.grammar import BINARY, COMPARE, OR, REMEDIES
from socialbot.bdi.agentspeak.lexer import END
from socialbot.bdi.agentspeak.terms import TermReader
from socialbot.bdi.conditions import Conjunction, conjunction
from socialbot.bdi.literals import Literal, literal
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, For, Fork, If, Step, Update, While
from socialbot.bdi.terms import Atom, Expression, Variable

_NESTED = {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}

_JOINS = {word for word, (level, _) in BINARY.items() if level <= COMPARE}


class BodyReader(TermReader):
    """Reads steps."""

    def body(self) -> tuple[Step, ...]:
        """Steps, up to what ends them."""
        words = self.words
        steps: list[Step] = []
        while (word := words[self.at]) not in (".", "}", ")", END):
            side = _STEPS.get(word, BodyReader.act)(self)
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
        """One step, or a body in braces or parentheses: what `|&|` and `|||` join."""
        word = self.words[self.at]
        self.simple(word)
        return _STEPS.get(word, BodyReader.act)(self)

    def simple(self, word: str) -> None:
        """Refuses steps that ``|&|`` and ``|||`` cannot join."""
        if word in ("if", "while", "for"):
            self.fail("a step", remedy=f"put '{word}' into braces: {{ {word} (...) {{ ... }} }}")

    def group(self) -> tuple[Step, ...]:
        """A body in braces or parentheses, unless the parentheses only begin a condition."""
        word = self.words[self.at]
        if word == "(" and not self.is_group():
            return self.act()
        end = "}" if word == "{" else ")"
        self.at += 1
        body = self.body()
        self.skip(end, f"';' or '{end}' after a step")
        return body

    def is_group(self) -> bool:
        """Whether the parentheses that open here hold steps: they do unless a condition is in them, or around them."""
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
        """Steps side by side; ``|&|`` binds tighter than ``|||``."""
        branches = [self.together(first)]
        while self.words[self.at] == "|||":
            self.at += 1
            branches.append(self.together(self.side()))
        return branches[0] if len(branches) == 1 else (Fork(tuple(branches), every=False),)

    def together(self, first: tuple[Step, ...]) -> tuple[Step, ...]:
        branches = [first]
        while self.words[self.at] == "|&|":
            self.at += 1
            branches.append(self.side())
        return first if len(branches) == 1 else (Fork(tuple(branches), every=True),)

    def act(self) -> tuple[Step, ...]:
        """An action, or a condition that has to hold."""
        start = self.at
        value = self.expression(OR)
        if isinstance(value, Literal):
            if value.negated:
                raise self.source.error(start, "an action has no '~'", "write +~b to believe that b is false")
            return (Do(*self.limited(value, start)) if value.annotations else Do(value),)
        if isinstance(value, Atom) and value.name not in ("true", "false"):
            return (Do(literal(value.name)),)
        if isinstance(value, Variable):
            if self.words[self.at] in REMEDIES:
                self.fail("an operator")
            raise self.unsupported("a variable as an action", start, "name the action; '!' goes before a goal")
        if isinstance(value, Expression):
            remedy = "when a plan ends before the '+' or '-', write '.' there" if value.symbol in "+-" else None
            raise self.source.error(start, "expected a step, found arithmetic", remedy)
        condition = self.as_condition(value, start)
        if isinstance(condition, Literal):  # such as .length(L), which is a function elsewhere
            return (Do(condition),)
        return (Constrain(conjunction(condition)),)

    def limited(self, what: Literal, start: int) -> tuple[Literal, object]:
        """A goal or action without the annotation ``within(5)``, and the limit that it sets."""
        for index, note in enumerate(what.annotations):
            if isinstance(note, Literal) and note.functor == "within":
                if len(note.args) != 1:
                    raise self.source.error(start, "expected one argument of within(...)", "give seconds: within(5)")
                rest = what.annotations[:index] + what.annotations[index + 1 :]
                return what.with_(annotations=rest), note.args[0]
        return what, None

    def achieve(self) -> tuple[Step, ...]:
        apart = self.words[self.at] == "!!"
        self.at += 1
        start = self.at
        goal = self.named("a goal")
        if isinstance(goal, Literal) and goal.annotations:
            goal, limit_s = self.limited(goal, start)
            return (Achieve(goal, apart, limit_s),)
        return (Achieve(goal, apart),)

    def ask(self) -> tuple[Step, ...]:
        self.at += 1
        start = self.at
        value = self.expression(OR)
        return (Ask(value if isinstance(value, Variable) else self.as_condition(value, start)),)

    def update(self) -> tuple[Step, ...]:
        sign = self.words[self.at]
        self.at += 1
        if self.words[self.at] == "{":
            raise self.unsupported(f"'{sign}{{'", self.at - 1, "use .add_plan or .remove_plan")
        return (Update(sign, self.named("a belief")),)

    def named(self, what: str) -> Literal | Variable:
        """A literal, or a variable that stands for one."""
        if self.is_variable():
            return self.variable()
        return self.literal(what)

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

    def while_(self) -> tuple[Step, ...]:
        return (While(self.in_parentheses(), self.block()),)

    def for_(self) -> tuple[Step, ...]:
        return (For(self.in_parentheses(), self.block()),)

    def in_parentheses(self) -> Conjunction:
        """The condition after ``if``, ``elif``, ``while`` or ``for``."""
        word = self.words[self.at]
        self.at += 1
        self.skip("(", f"'(' after '{word}'")
        condition = conjunction(self.condition())
        self.skip(")", "an operator or ')' after a condition")
        return condition

    def block(self) -> tuple[Step, ...]:
        """A body in braces."""
        self.skip("{", "'{' before the steps")
        body = self.body()
        self.skip("}", "';' or '}' after a step")
        return body


_STEPS: dict[str, Callable[[BodyReader], tuple[Step, ...]]] = {
    "!": BodyReader.achieve,
    "!!": BodyReader.achieve,
    "?": BodyReader.ask,
    "+": BodyReader.update,
    "-": BodyReader.update,
    "-+": BodyReader.update,
    "++": BodyReader.update,
    "--": BodyReader.update,
    "if": BodyReader.if_,
    "while": BodyReader.while_,
    "for": BodyReader.for_,
    "{": BodyReader.group,
    "(": BodyReader.group,
}
"""Readers of steps by their first words; everything else is an action or a condition."""
