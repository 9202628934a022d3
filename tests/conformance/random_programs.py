"""Random programs with what Jason prints for them.

Each program has two agents and mixes printed terms, beliefs with annotations, rules, internal actions, goals that fail,
waits and messages. The seed of a program is its number. ``random_programs.json`` contains the answers of Jason.

    python -m tests.conformance.random_programs "COMMAND" [COUNT]

runs the programs in Jason and writes the file. COMMAND runs a project file, given as its last argument, in the current
folder, and prints lines such as ``[agent] text``.
"""

from __future__ import annotations

import hashlib
import json
import random
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

ANSWERS = Path(__file__).with_suffix(".json")
VERSION = "3.3.2"
"""Version of Jason that is recorded."""

BATCH = 40
"""Programs that run in one system of Jason."""


class Maker:
    """Generator of one program; `steps` are those of its main plan, `others` its other plans, facts and rules."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.random = random.Random(number)
        self.steps: list[str] = []
        self.others: list[str] = []
        self.fresh = 0

    def pick(self, *items: str) -> str:
        return self.random.choice(items)

    def new(self, prefix: str) -> str:
        self.fresh += 1
        return f"{prefix}{self.fresh}"

    def show(self, *parts: str) -> None:
        self.steps.append(self.printing(*parts))

    @staticmethod
    def printing(*parts: str) -> str:
        return '.print("> ", ' + ", ".join(parts) + ")"

    def number_term(self) -> str:
        return self.pick("0", "1", "2", "7", "-3", "1.5", "0.25", "10", "100000", "2.0", "1.0e-7", "12345678.9")

    def atom(self) -> str:
        return self.pick("a", "b", "cat", "'A B'", "'Bob'", "x_1", "true")

    def term(self, depth: int = 2) -> str:
        kind = self.random.randrange(4 if depth == 0 else 8)
        if kind == 0:
            return self.number_term()
        if kind == 1:
            return self.atom()
        if kind == 2:
            return self.pick('"s"', '"two words"', '"it\'s"', '""', '"a\\"b"')
        if kind in (3, 4):
            return f"[{', '.join(self.term(max(depth - 1, 0)) for _ in range(self.random.randrange(4)))}]"
        args = ", ".join(self.term(depth - 1) for _ in range(self.random.randrange(1, 4)))
        text = f"{self.pick('f', 'g', 'pos')}({args})"
        return f"{self.pick('', '', '~')}{text}{self.notes() if kind == 7 else ''}"

    def notes(self) -> str:
        found = self.random.sample(["n", "m(1)", "k(z)", "w([1,2])", 'v("s")'], self.random.randrange(1, 4))
        return f"[{', '.join(found)}]"

    def numbers(self) -> list[int]:
        return [self.random.randrange(-5, 20) for _ in range(self.random.randrange(2, 6))]

    def expression(self, depth: int = 2) -> str:
        if depth == 0:
            return str(self.random.randrange(1, 12))
        sign = self.pick("+", "-", "*", "/", " div ", " mod ", "**")
        right = str(self.random.randrange(1, 4)) if sign == "**" else self.expression(depth - 1)
        if sign in ("/", " div ", " mod "):
            right = str(self.random.randrange(1, 9))
        return f"({self.expression(depth - 1)}{sign}{right})"

    def condition(self, depth: int = 2) -> str:
        if depth == 0:
            return self.pick("a", "b(1)", "X > 3", "Y = f(Z)", "not c", "d(X)[source(S)]", "true", 'e \\== "s"')
        sign = self.pick(" & ", " | ", "not ")
        inner = self.condition(depth - 1)
        return f"not ({inner})" if sign == "not " else f"({self.condition(depth - 1)}{sign}{inner})"

    # Parts of programs

    def terms(self) -> None:
        self.show(self.term(), '" "', self.term(1), '" "', self.number_term())
        variable = self.new("V")
        self.steps.append(f"{variable} = {self.term()}")
        self.show(variable, f"[{variable}]")

    def arithmetic(self) -> None:
        variable = self.new("V")
        self.steps.append(f"{variable} = {self.expression()}")
        self.show(variable)

    def beliefs(self) -> None:
        name, variable, note = self.new("b"), self.new("V"), self.new("V")
        for value in self.random.sample(range(9), 3):
            self.others.append(f"{name}({value}){self.pick('', self.notes())}.")
        self.steps.append(self.pick(f"+{name}(9){self.notes()}", f"-{name}(_)", f"-+{name}(4)", f"+{name}(3)[z]"))
        self.steps.append(f"for ({name}({variable})[{note}]) {{ {self.printing(variable, note)} }}")
        found = self.new("L")
        self.steps.append(f".findall(p({found}x), {name}({found}x), {found})")
        self.steps.append(f".sort({found}, {found}s)")
        self.show(f"{found}s")

    def events(self) -> None:
        name = self.new("e")
        self.others.append(f'+{name}(X)[source(S)|T] : X > 3 <- .print("> ", big, X, S, T).')
        self.others.append(f'+{name}(X) <- .print("> ", small, X).')
        self.others.append(f'-{name}(X) <- .print("> ", gone, X).')
        self.steps += [f"+{name}({value})" for value in self.random.sample(range(8), 2)]
        self.steps.append(f"-{name}(_)")

    def rules(self) -> None:
        fact, rule, left, found = self.new("k"), self.new("r"), self.new("V"), self.new("L")
        pairs = self.random.sample([(a, b) for a in range(4) for b in range(4)], 5)
        self.others += [f"{fact}({one}, {two})." for one, two in pairs]
        body = self.pick(
            f"{fact}(X, Z) & {fact}(Z, Y)",
            f"{fact}(X, Y) & not {fact}(Y, X)",
            f"{fact}(X, Y) | {fact}(Y, X)",
            f"{fact}(X, Z) & Y = Z * 2 + X",
            f"{fact}(X, Y) & .count({fact}(X, _), N) & N > 1",
        )
        self.others.append(f"{rule}(X, Y) :- {body}.")
        self.steps.append(f".count({rule}(_, _), {found}c)")
        self.steps.append(f".setof(pair({left}, {left}b), {rule}({left}, {left}b), {found})")
        self.show(f"{found}c", found)

    def lists(self) -> None:
        items, out = str(self.numbers()), self.new("R")
        self.steps.append(
            self.pick(
                f".sort({items}, {out})",
                f".reverse({items}, {out})",
                f".max({items}, {out})",
                f".min({items}, {out})",
                f".length({items}, {out})",
                f".nth(1, {items}, {out})",
                f".concat({items}, [x], {out})",
                f".union({items}, [1,2], {out})",
                f".difference({items}, [1,2,3], {out})",
                f".intersection({items}, [1,2,3,4,5], {out})",
                f".findall(I, .member(I, {items}) & I > 2, {out})",
                f".findall(P, .prefix(P, {items}), {out})",
                f".findall(P, .sublist(P, [1,2,3]), {out})",
                f"[_, {out}|_] = {items}",
                f"[_|{out}] = {items}",
            )
        )
        self.show(out)

    def strings(self) -> None:
        out = self.new("S")
        self.steps.append(
            self.pick(
                f'.concat({self.term(1)}, "-", {self.number_term()}, {out})'.replace(".concat([", '.concat("", ['),
                f'.upper_case("Some Text", {out})',
                f'.substring("abcdef", {out}, 2, 4)',
                f'.replace("banana", "a", "o", {out})',
                f".term2string({self.term()}, {out})",
                f'.term2string({out}, "f(1,[a,B],\\"x\\")")',
                f'.term2string({out}, "a & not b(1)")',
                f'.length("hello", {out})',
                f'.reverse("abc", {out})',
            )
        )
        self.show(out, f"[{out}]")

    def plans(self) -> None:
        variable = self.new("P")
        body = "; ".join(
            self.pick(
                "!h(X)", "!!i", "?q(X, Y)", "+b(1)[n]", "-b(_)", "-+c(X)", ".print(X, \"s\")", "X = Y * 2 + Z",
                "if (a & b) { c(1) } else { !d }", "while (not a) { -e; f }", "for (b(V)) { +g(V) }", "act(X)",
                ".wait(100)", "a |&| b", "X > 3",
            )
            for _ in range(self.random.randrange(1, 4))
        )  # fmt: skip
        context = self.pick("", f" : {self.condition()}")
        label = self.pick("", "@l ", "@l[atomic, z(1)] ")
        self.steps.append(f"{variable} = {{ {label}{self.pick('+!', '-!', '+', '+?')}t(X){context} <- {body} }}")
        self.show(variable)

    def conditions(self) -> None:
        variable = self.new("C")
        self.steps.append(f"{variable} = ({self.condition()})")
        self.show(variable)

    def control(self) -> None:
        out, low = self.new("I"), self.random.randrange(3)
        name = self.new("n")
        even, odd = self.printing("even", out), self.printing("odd", out)
        self.steps.append(
            f"for (.range({out}, {low}, {low + 3})) {{ if ({out} mod 2 == 0) {{ {even} }} else {{ {odd} }} }}"
        )
        self.others.append(f"{name}({low}).")
        turn = f"{self.printing(out + 'w')}; -+{name}({out}w + 1)"
        self.steps.append(f"while ({name}({out}w) & {out}w < {low + 3}) {{ {turn} }}")

    def goals(self) -> None:
        goal, out = self.new("g"), self.new("V")
        self.others.append(f"+!{goal}(N, R) : N > {self.random.randrange(6)} <- R = N * 2.")
        self.others.append(f"+!{goal}(N, R) <- R = small(N).")
        self.steps.append(f"!{goal}({self.random.randrange(8)}, {out})")
        self.show(out)

    def failures(self) -> None:
        goal = self.new("g")
        step = self.pick(
            ".fail", f"!{goal}none(1)", "?nothing(1)", "1 > 2", f"!{goal}no(2)", ".member(z, [a, b])", "X = 3; X == 4",
            "unknown_action(1)", '.fail(reason(late))', "true; true", "a & b", ".print(\"> inner\"); false",
        )  # fmt: skip
        self.others.append(f"+!{goal}no(X) : X > 5.")
        self.others.append(f'+!{goal}(A) <- .print("> ", try, A); {step}; .print("> ", never).')
        handler = self.pick('-!{0}(A)[error(E)] <- .print("> ", E, A).', '-!{0}(A)[code(C)] <- .print("> ", A, C).', "")
        self.others.append(handler.format(goal))
        self.steps.append(f"!{goal}({self.number_term()})")
        self.show(goal)

    def waits(self) -> None:
        name, out = self.new("w"), self.new("V")
        form = self.random.randrange(4)
        if form == 0:
            self.others.append(f"+!{name} <- .wait(60); +{name}(5).")
            self.steps += [f"!!{name}", f".wait({{+{name}({out})}})"]
        elif form == 1:
            self.others.append(f"+!{name} <- .wait(60); +{name}(5).")
            self.steps += [f"!!{name}", f".wait({name}({out}) & {out} > 3)"]
        elif form == 2:
            self.steps.append(f".wait({{+{name}({out})}}, 50, _)")
            out = "late"
        else:
            self.steps.append(f".wait({name}({out}), 50)")
        self.show(f"waited({out})")

    def messages(self) -> None:
        name, out, me = self.new("m"), self.new("A"), self.number
        form = self.random.randrange(5)
        value = self.term(1).lstrip("~")
        if form == 0:
            self.steps += [f".send(b{me}, tell, fact({value})[n])", ".wait(100)"]
            self.steps.append(f".send(b{me}, askOne, fact(_), {out})")
        elif form == 1:
            self.steps.append(f".send(b{me}, askAll, known(_), {out})")
        elif form == 2:
            self.steps.append(f".send(b{me}, askOne, missing(_), {out})")
        elif form == 3:
            self.others.append(f'+{name}(X)[source(S)] <- .print("> ", got, X, S).')
            self.steps += [f".send(b{me}, achieve, reply({name}({value})))", ".wait(150)"]
            out = "sent"
        else:
            self.steps.append(f".send(b{me}, askOne, double(4, _), {out})")
        self.show(out)

    def agents(self) -> dict[str, str]:
        """Return the texts of the program by agent."""
        parts: tuple[Callable[[], None], ...] = (
            self.terms, self.arithmetic, self.beliefs, self.events, self.rules, self.lists, self.strings, self.plans,
            self.conditions, self.control, self.goals, self.failures, self.failures, self.waits, self.messages,
        )  # fmt: skip
        for part in self.random.sample(parts, 4):
            part()
        plan = ";\n   ".join(self.steps)
        main = "\n".join(["!go.", *filter(None, self.others), f"+!go <-\n   {plan}."])
        main += '\n-!go[error(E)] <- .print("> failed ", E).\n'
        other = 'known(1). known(two)[x].\n+!reply(W)[source(S)] <- .print("> asked ", W); .send(S, tell, W).\n'
        other += '+?double(X, Y) <- Y = X * 2.\n+fact(X)[source(S)] <- .print("> told ", X, S).\n'
        return {f"a{self.number}": main, f"b{self.number}": other}


def agents(number: int) -> dict[str, str]:
    """Return the texts of a program by agent."""
    return Maker(number).agents()


def digest(count: int) -> str:
    """Return a digest of the first programs, which shows whether the answers belong to them."""
    texts = "\n".join(text for number in range(count) for text in agents(number).values())
    return hashlib.sha1(texts.encode()).hexdigest()


def recorded() -> dict[str, Any]:
    """Return the version of Jason, the digest of the programs, and the lines of each, such as ``a 7``, sorted."""
    return json.loads(ANSWERS.read_text("utf-8"))


def compared(line: str) -> str:
    """Return a line without the numbers of Jason's variables, which count up in the whole system."""
    return re.sub(r"\b_\d+\w*", "_", line)


def record(command: str, count: int) -> None:
    """Run the programs in Jason and write what they print."""
    answers: list[list[str]] = []
    for begin in range(0, count, BATCH):
        numbers = range(begin, min(begin + BATCH, count))
        texts = {name: text for number in numbers for name, text in agents(number).items()}
        with tempfile.TemporaryDirectory() as folder:
            for name, text in texts.items():
                Path(folder, f"{name}.asl").write_text(text, "utf-8")
            Path(folder, "programs.mas2j").write_text(f"MAS programs {{ agents: {' '.join(f'{n};' for n in texts)} }}")
            ended = subprocess.run(
                [*shlex.split(command), "programs.mas2j"], cwd=folder, capture_output=True, text=True, check=False
            )
        found: dict[str, list[str]] = {str(number): [] for number in numbers}
        for line in (ended.stdout + ended.stderr).splitlines():
            parts = re.match(r"\[([ab](\d+))\] > ?(.*)", line)
            if parts:
                found[parts[2]].append(compared(f"{parts[1][0]} {parts[3]}"))
        answers += [sorted(found[str(number)]) for number in numbers]
    lines = ",\n".join(json.dumps(answer, ensure_ascii=False) for answer in answers)
    heading = f'"jason": "{VERSION}", "programs": "{digest(count)}"'
    ANSWERS.write_text(f'{{{heading}, "answers": [\n{lines}\n]}}\n', "utf-8")


if __name__ == "__main__":
    record(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else len(recorded()["answers"]))
