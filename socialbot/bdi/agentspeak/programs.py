"""Parser of AgentSpeak programs: beliefs, rules, goals, plans, and directives such as ``{ include("file.asl") }``."""

from __future__ import annotations

import difflib
import itertools
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from socialbot.bdi.agentspeak.lexer import END, LIBRARIES, AgentSpeakError, Source
from socialbot.bdi.agentspeak.parser import Parser, whole
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import Change, Literal, Structure, literal
from socialbot.bdi.plans import Inference, Plan
from socialbot.bdi.stdlib.registry import opened
from socialbot.bdi.steps import Ask, Step, Update
from socialbot.bdi.terms import NOTHING, Atom, Conjunction, Negation, Variable, conjunction
from socialbot.bdi.trace import log
from socialbot.bdi.unification import unify
from socialbot.core.errors import RuleError
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.reading import read_bytes

_local_numbers = itertools.count(1)

MAX_INCLUDES = 1000  # most included files: each may include the next one twice

DIRECTIVES = {
    "include": (1, 2),
    "namespace": (1, 2),
    "register_function": (1, 3),
}
"""Directives with their smallest and largest number of arguments."""


@dataclass(frozen=True)
class Program:
    """Content of an AgentSpeak text with its included files; each kind in source order.

    ``texts`` are the texts by file, ``omissions`` warnings of steps without ``;`` before them.
    """

    beliefs: tuple[Literal, ...]
    inferences: tuple[Inference, ...]
    goals: tuple[Literal, ...]
    plans: tuple[Plan, ...]
    texts: Mapping[str, str] = field(default_factory=dict)
    omissions: tuple[AgentSpeakError, ...] = ()


@dataclass(frozen=True)
class IncludePaths:
    """Places of included files.

    Attributes:
        folders: Folders that are searched after that of the including file.
        roots: Folders by the name that stands for them, without its ``$``: ``{"jacamoJar": Path("templates")}``.
    """

    folders: tuple[Path, ...] = ()
    roots: Mapping[str, Path] = field(default_factory=dict)

    def find(self, name: str, *including: Path) -> Path:
        """Find an included file; ``including`` are the files that include each other, the innermost last.

        A place that is one of them is passed over if there is another.

        Raises:
            RuleError: The file does not exist, or its root is not configured.
        """
        name = name.replace("\\", "/")
        if name.startswith("$"):
            root, _, rest = name[1:].partition("/")
            if root not in self.roots:
                raise RuleError(
                    f"the root ${root} of the included file {name} is not configured",
                    remedy=f"name its folder: --root {root}=FOLDER, or IncludePaths(roots={{{root!r}: ...}})",
                )
            file = self.roots[root] / rest
            tried: Iterable[Path] = (file,)
        else:
            tried = dict.fromkeys(folder / name for folder in (including[-1].parent, *self.folders))
        files = [file for file in tried if os.path.isfile(file)]
        if not files:
            places = ", ".join(map(str, tried))
            raise RuleError(
                f"the included file {name} does not exist", remedy=f"create it, or give its folder (tried: {places})"
            )
        known = {file.resolve() for file in including}
        return next((file for file in files if file.resolve() not in known), files[0])


def parse(text: str, file: str = "<text>", paths: IncludePaths | None = None) -> Program:
    """Parse a whole text.

    Args:
        text: AgentSpeak program.
        file: Its name in messages, and its place for included files.
        paths: Places of included files; without them includes are refused, so that a text from elsewhere reads no file.

    Raises:
        AgentSpeakError: The text, or an included one, has a mistake.
    """
    return whole(text, file, ProgramParser.program, lambda source: ProgramParser(source, paths))


def read_program(file: Path, paths: IncludePaths | None = None) -> Program:
    """Parse a file. Raises AgentSpeakError for a mistake, RuleError if the file cannot be read."""
    return parse(read_text(file), str(file), paths or IncludePaths())


def read_text(file: Path) -> str:
    """Read a text file in UTF-8; as in Jason, U+FFFD replaces other bytes, with a warning.

    Raises:
        RuleError: The file cannot be read.
    """
    try:
        data = read_bytes(file, TEXT_BYTES)
    except OSError as problem:
        what = f"cannot be read: {problem.strerror}"
        raise RuleError(what, where=str(file), remedy="check its path") from problem
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = data.count(b"\n", 0, problem.start) + 1
        remedy = f"iconv -f latin1 -t utf-8 {file.name} -o utf8_{file.name}"
        log().warning("%s:%d: not UTF-8 text: U+FFFD replaces other bytes; to convert it: %s", file, line, remedy)
        text = data.decode("utf-8-sig", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


class ProgramParser(Parser):
    """Parser of programs."""

    def __init__(
        self,
        source: Source,
        paths: IncludePaths | None = None,
        including: tuple[Path, ...] = (),
        included: list[Path] | None = None,
    ) -> None:
        super().__init__(source)
        self.paths = paths
        self.including = including
        self.included = [] if included is None else included
        self.beliefs: list[Literal] = []
        self.inferences: list[Inference] = []
        self.goals: list[Literal] = []
        self.plans: list[Plan] = []
        self.labels: dict[str, Plan] = {}
        self.texts = {source.file: source.text}
        self.omitted: list[AgentSpeakError] = []  # of included files

    def program(self) -> Program:
        self.components()
        if self.words[self.at] == "{":
            self.fail("a directive before '{ end }'")
        beliefs, goals = tuple(self.beliefs), tuple(self.goals)
        omissions = (*self.omissions.values(), *self.omitted)
        return Program(beliefs, tuple(self.inferences), goals, tuple(self.plans), self.texts, omissions)

    def components(self) -> None:
        """Read beliefs, goals, plans and directives up to the end of the text or of a directive."""
        words = self.words
        while (word := words[self.at]) != END:
            if word in ("+", "-", "^", "@"):
                start = self.at
                self.add_plan(self.with_inner(self.plan((".",))), start)
            elif word == "!":
                self.goals.append(self.goal())
            elif word == "{":
                if words[self.at + 1] == "end" and words[self.at + 2] == "}":
                    return
                self.directive()
            else:
                self.fact()

    def add_plan(self, plan: Plan, start: int) -> None:
        known = self.labels.get(plan.label) if plan.label is not None else None
        if known is not None:
            if known.origin == plan.origin or known.same_text(plan):
                return  # of a file that is included twice, or the same plan again
            place = known.origin
            where = f"line {place.line}" if place and place.file == self.source.file else str(place)
            what = f"the label '{plan.label}' is already used in {where}"
            raise self.source.error(start, what, "choose another label")
        if plan.label is not None:
            self.labels[plan.label] = plan
        self.plans.append(plan)

    def goal(self) -> Literal:
        self.at += 1
        start = self.at
        goal = self.literal("a goal after '!'")
        if goal.annotations and self.limited(goal, start)[1] is not None:
            raise self.source.error(start, "an initial goal has no limit", "set it where the goal is a step")
        self.skip(".", "'.' after a goal")
        return goal

    def fact(self) -> None:
        """Read a belief or an inference rule; a belief with variables is a rule that always holds."""
        start = self.at
        head = self.literal("a belief, a goal or a plan")
        word = self.words[self.at]
        condition = NOTHING
        if word == ":-":
            self.at += 1
            condition = conjunction(self.condition())
            if self.words[self.at] != ".":
                self.fail("'.', '&' or '|' after a condition")
        elif word != ".":
            self.fail("'.' or ':-' after a belief")
        if word == ":-" or head.names():
            self.inferences.append(Inference(head, condition, self.origin(start), self.text(start)))
        else:
            self.beliefs.append(head)
        self.at += 1

    # Directives

    def directive(self) -> None:
        """Read a directive, and up to ``{ end }`` after ``begin``."""
        start = self.at
        self.at += 1
        begins = self.words[self.at] == "begin"
        self.at += begins
        at = self.at
        name = self.words[at]
        directives = DIRECTIVES | PATTERNS
        if name not in directives:
            near = difflib.get_close_matches(name, directives, 1)
            known = f"{', '.join(directives)} are supported"
            shown = f"the directive '{name}'" if name != END else "a directive"
            raise self.unsupported(shown, start, f"did you mean '{near[0]}'?" if near else known)
        namespace, self.namespace = self.namespace, ""
        self.at += 1
        args = self.arguments(name) if self.words[self.at] == "(" else ()
        self.namespace = namespace
        least, most = directives[name]
        if not least <= len(args) <= most:
            raise self.source.error(at, f"the directive '{name}' takes {least} to {most} arguments")
        self.skip("}", f"'}}' after the directive '{name}'")
        if name in PATTERNS:
            self.pattern(name, args, at, begins)
            return
        if begins and name != "namespace":
            raise self.source.error(at, f"the directive '{name}' has no content", f"write {{ {name}(...) }}")
        if name == "include":
            self.include(args, at)
        elif name == "namespace":
            self.open_namespace(args, at, begins)
        else:
            self.register_function(args, at)

    def open_namespace(self, args: tuple[object, ...], at: int, begins: bool) -> None:
        """Declare a namespace; after ``begin`` it is that of all components up to ``{ end }``."""
        name, *kind = args
        if not isinstance(name, Atom) or kind not in ([], [Atom("local")], [Atom("global")]):
            raise self.source.error(at, "expected a namespace", "write namespace(name) or namespace(name, local)")
        if kind == [Atom("local")]:
            self.local_namespaces.setdefault(name.name, f"#{next(_local_numbers)}{name.name}")
        elif kind == [Atom("global")]:
            self.local_namespaces.pop(name.name, None)
        if not begins:
            return
        before = self.namespace, self.own_namespace
        self.namespace = self.own_namespace = self.local_namespaces.get(name.name, name.name)
        self.components()
        if self.words[self.at] != "{":
            self.fail("'{ end }' of a namespace")
        self.at += 3
        self.namespace, self.own_namespace = before

    def pattern(self, name: str, args: tuple[object, ...], at: int, begins: bool) -> None:
        """Apply a goal pattern to the plans up to ``{ end }``."""
        if not begins and name != "sga":
            raise self.source.error(
                at, f"the directive '{name}' has content", f"write {{ begin {name}(...) }} ... {{ end }}"
            )
        before = len(self.plans)
        if begins:
            self.components()
            if self.words[self.at] != "{":
                self.fail(f"'{{ end }}' of {name}")
            self.at += 3
        inner = tuple(self.plans[before:])
        origin = self.origin(at)

        def read(text: str) -> Plan:
            parser = Parser(Source(text, self.source.file))
            parser.namespace = parser.own_namespace = self.namespace
            return replace(parser.one_plan(), origin=origin)

        try:
            self.plans[before:] = expanded(name, args, inner, read)
            self.beliefs += kept(name, args)
        except (RuleError, AgentSpeakError) as problem:
            raise self.source.error(at, f"the pattern '{name}' is wrong: {problem.what}", problem.remedy) from problem

    def register_function(self, args: tuple[object, ...], at: int) -> None:
        """Register a function that a rule computes; one without a rule is a function in Python."""
        name, *rule = args
        if not isinstance(name, str) or "." not in name or name[0] == "." or name.startswith(LIBRARIES):
            raise self.source.error(at, "expected the name of a function, with a dot", 'write "library.name"')
        match rule:
            case []:
                pass
            case [int() as arity, str() as predicate]:
                self.functions[name, arity] = predicate
            case _:
                raise self.source.error(
                    at, "expected the name, the number of arguments and the rule", 'write ("lib.f", 2, "rule")'
                )

    def include(self, args: tuple[object, ...], at: int) -> None:
        """Add the components of another file."""
        name, *namespace = args
        if not isinstance(name, str) or not all(isinstance(item, (Atom, Variable)) for item in namespace):
            raise self.source.error(at, "expected the name of a file", 'write include("file.asl", namespace)')
        if self.paths is None:
            raise self.unsupported(
                "an include in a text without a place", at, "load the program as a file, or give the paths of includes"
            )
        try:
            file = self.paths.find(name, *self.including, Path(self.source.file))
            text = read_text(file)
        except RuleError as problem:
            raise self.source.error(at, problem.what, problem.remedy) from None
        place = file.resolve()
        including = (*self.including, Path(self.source.file).resolve())
        if place in including:
            chain = " -> ".join(each.name for each in (*including[including.index(place) :], place))
            raise self.source.error(at, f"the file includes itself: {chain}", "remove one of the includes")
        self.included.append(place)
        if len(self.included) > MAX_INCLUDES:
            raise self.source.error(at, f"more than {MAX_INCLUDES} files are included", "include each file once")
        inner = ProgramParser(Source(text, str(file)), self.paths, including, self.included)
        own = self.namespace
        if namespace:
            given = namespace[0]
            own = given.name if isinstance(given, Atom) else f"#{next(_local_numbers)}ns"
            own = self.local_namespaces.get(own, own)
        inner.namespace = inner.own_namespace = own
        inner.functions = self.functions
        inner.labels = self.labels
        found = inner.program()
        self.texts.update(found.texts)
        self.omitted += found.omissions
        self.beliefs += found.beliefs
        self.inferences += found.inferences
        self.goals += found.goals
        self.plans += found.plans


# Goal patterns: directives such as ``{ begin dg(g) } ... { end }``, which add plans for a goal, as Jason does.
# The names are those of Jason: dg (declarative goal), bdg (with backtracking), ebdg (exclusive), bc (blind commitment),
# smc (single-minded), rc (relativised), omc (open-minded), mg (maintenance goal), sga (sequenced adoption).

Read = Callable[[str], Plan]
"""Reader of the text of a plan."""

PATTERNS = {
    "dg": (1, 1), "bdg": (1, 1), "ebdg": (1, 1), "bc": (1, 2), "smc": (2, 2), "rc": (2, 2), "omc": (3, 3), "mg": (1, 2),
    "sga": (3, 3),
}  # fmt: skip
"""Goal patterns with their smallest and largest number of arguments."""

_EXTENDED: dict[str, tuple[str, tuple[str, ...]]] = {
    "bdg": ("dg", ("-!{0} <- !{0}.",)),
    "bc": ("bdg", ("+!{0} <- !{0}.",)),
    "smc": ("bc", ("+{1} <- .fail_goal({0}).",)),
    "rc": ("bc", ("-{1} <- .succeed_goal({0}).",)),
    "omc": ("bc", ("+{1} <- .drop_intention({0}).", "-{2} <- .succeed_goal({0}).")),
    "mg": ("bc", ("-{0} <- !{0}.",)),
}
"""Patterns with the plans of another one and further plans, whose places are the goal and the other arguments.

An optional second argument names another pattern instead, as in ``bc(g, ebdg(g))``.
"""

_SEQUENCED = (
    "{0} : not f__l(_) & ({1}) <- !f__g({2}).",
    "{0} : f__l(_) & ({1}) <- +f__l({2}).",
    "+!f__g({2}) <- +f__l({2}); !{2}; -f__l({2}).",
    "-!f__g({2}) <- -f__l({2}).",
    "-f__l({2}) : f__l({2}) <- !f__g({2}).",
)
"""Plans of ``sga``; the places are the trigger, the context and the goal."""


def expanded(name: str, args: tuple[object, ...], plans: tuple[Plan, ...], read: Read) -> list[Plan]:
    """Return the plans of a goal pattern.

    Args:
        name: One of `PATTERNS`.
        args: The arguments of the directive.
        plans: The plans inside.
        read: Reads the text of an added plan.

    Raises:
        RuleError: An argument is wrong.
    """
    if name == "sga":
        trigger, context, _ = args
        if not isinstance(trigger, str) or not isinstance(context, str):
            raise RuleError("sga expects a trigger and a context as strings", remedy='write sga("+b(X)", "c(X)", g(X))')
        goal = agentspeak(_goal(name, args))
        return [read(text.format(trigger, context, goal)) for text in _SEQUENCED]
    wanted = _goal(name, args)
    goal = agentspeak(wanted)
    if name in _EXTENDED:
        base, added = _EXTENDED[name]
        least, most = PATTERNS[name]
        given: tuple[object, ...] = (wanted,)
        if least < len(args) <= most:
            base, given = _inner(name, args[1])
        words = (goal, *map(agentspeak, args[1:]))
        return [*expanded(base, given, plans, read), *(read(text.format(*words)) for text in added)]
    if name == "dg":
        before = [read(f"+!{goal} : {goal}."), read(f"+!{goal} : .intend({goal}).")]
        asking = [_asking(plan) if _is_for(plan, wanted) else plan for plan in plans]
        return [*before, *asking, read(f"+{goal} <- .succeed_goal({goal}).")]
    return _exclusive(wanted, plans, read)


def kept(name: str, args: tuple[object, ...]) -> tuple[Literal, ...]:
    """Initial beliefs of a goal pattern: the goal that ``mg`` maintains."""
    return (_goal(name, args),) if name == "mg" else ()


def _goal(name: str, args: tuple[object, ...]) -> Structure:
    found = args[2] if name == "sga" else args[0]
    if isinstance(found, Atom):
        return literal(found.name)
    if not isinstance(found, Structure):
        raise RuleError(f"{name} expects a goal", remedy=f"write {name}(g), for example")
    return found


def _exclusive(wanted: Structure, plans: tuple[Plan, ...], read: Read) -> list[Plan]:
    """Return the plans of ``ebdg``: each of the plans for the goal is tried once."""
    goal, number, tries = agentspeak(wanted), 0, []
    for plan in plans:
        if _is_for(plan, wanted):
            number += 1
            tried = literal("p__f", (number, wanted))
            plan = replace(plan, condition=Conjunction((Negation(tried), *plan.condition.terms)))
            plan = _asking(plan, Update("+", tried))
        tries.append(plan)
    after = (
        f"-!{goal} <- !{goal}.",
        f"+{goal} <- .abolish(p__f(_,{goal})); .succeed_goal({goal}).",
        f"-{goal} <- .abolish(p__f(_,{goal})).",
    )
    return [read(f"+!{goal} : {goal}."), *tries, *map(read, after)]


def _inner(name: str, pattern: object) -> tuple[str, tuple[object, ...]]:
    """Return the name and the arguments of the pattern that is the second argument of another one."""
    if not isinstance(pattern, Literal) or pattern.functor not in PATTERNS:
        raise RuleError(f"{agentspeak(pattern)} is not a goal pattern", remedy=f"write {name}(g, bdg(g))")
    least, most = PATTERNS[pattern.functor]
    if not least <= len(pattern.args) <= most:
        raise RuleError(
            f"the pattern {pattern.functor} takes {least} to {most} arguments", remedy="see docs/semantics.md"
        )
    return pattern.functor, pattern.args


def _is_for(plan: Plan, goal: Literal) -> bool:
    """Whether a plan is for a goal, or for a special case of it."""
    head = plan.event.literal
    if plan.event.change is not Change.WANTED or not isinstance(head, Literal) or head.key != goal.key:
        return False
    return unify(opened(head.args), opened(goal.args), [])


def _asking(plan: Plan, *before: Step) -> Plan:
    """Add the question for its goal at the end of a plan, and steps at the begin; its text says them, too."""
    goal: Any = plan.event.literal
    changed = replace(plan, body=(*before, *plan.body, Ask(goal)))
    return replace(changed, text=agentspeak(changed).removesuffix("."))
