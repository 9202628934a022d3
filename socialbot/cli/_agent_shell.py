"""Interactive shell for an agent: add beliefs and goals, inspect its state, advance its time."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import agentspeak, parse_condition, parse_event, parse_literal, parse_term
from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.belief_base import is_source
from socialbot.bdi.intentions import OPEN, SUBGOAL
from socialbot.bdi.literals import SELF, Change, Literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.saving import read, restore, write
from socialbot.bdi.terms import names_in, show
from socialbot.bdi.trace import Record, Trace, as_text, tee
from socialbot.bdi.unification import Var, closed, resolve
from socialbot.core.clock import SECOND, Clock, ManualClock, nanoseconds
from socialbot.core.errors import ParameterError, SocialbotError

HELP = """\
+b(1)             believes something from now on (-b(1): no longer; -+b(2): instead of b(1))
!go               gives it a goal
?b(X) & X > 1     asks what it believes
+!go : b(X) <- .print(X).                        adds a plan; rules and beliefs likewise, with a dot at the end
beliefs [NAME]    what it believes, who says so, since when
desires           the goals it pursues           intentions        what it does about them, step by step
plans [NAME]      its plans                      trace on|off      show all that goes on in it
why [ID|NAME]     what led to a record of the trace, or to the last action
why-not PLAN ARG, ...                            why a plan would not be chosen now
time [+5 s]       the time; lets time pass       run [SECONDS]     lets it go on, lets time pass
hold              stops it after each input      step [N]          lets it make N turns
load FILE         adds AgentSpeak                save FILE, restore FILE: its mind
help, quit"""

UNITS = {"ms": 0.001, "s": 1.0, "min": 60.0, "h": 3600.0}
PATIENCE_S = 1.0
"""The reasoning time (s) of an agent per input line, in slices of `TURNS` reasoning cycles."""

TURNS = 100
MOST_SOLUTIONS = 50
LOUD = frozenset({"failure", "dropped"})
"""The kinds of records that are shown even if the trace is off."""

_COMMAND = re.compile(r"([a-z][a-z-]*)(?:\s+(.*))?", re.DOTALL)
_DURATION = re.compile(r"\+\s*(\d+(?:\.\d+)?)\s*([a-z]*)")


class Shell:
    """One agent and the commands of its shell. `handle` reports errors and does not raise them.

    With a `ManualClock` only commands advance the time. With another clock the agent runs in a thread, from `start` to
    `close`.
    """

    def __init__(self, engine: Engine, write_line: Callable[[str], object] = print) -> None:
        self.engine = engine
        self.clock: Clock = engine.clock
        self.simulated = isinstance(engine.clock, ManualClock)
        self.write = write_line
        self.trace = Trace()
        self.tracing = False
        self.held = False
        self.text = ""
        self._ended = False
        self._lock = threading.RLock()
        self._bell = threading.Event()
        self._stepping = False
        engine.trace.sink = tee(*([engine.trace.sink] if engine.trace.sink else []), self.trace, self._show)
        engine.actions = _Actions(engine.actions, self)
        if engine.out is None:
            engine.out = lambda text: self.write(f"[{engine.name}] {text}")

    # Running

    def start(self) -> None:
        """Start the thread of the agent, unless its clock is simulated."""
        if self.simulated:
            return
        host = self.engine.wake

        def wake() -> None:
            self._bell.set()
            if host is not None:
                host()

        self.engine.wake = wake
        threading.Thread(target=self._serve, name="agent", daemon=True).start()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._bell.set()

    def _serve(self) -> None:
        while not self._ended:
            with self._lock:
                self._bell.clear()
                busy = not self.held and self.engine.run_until_idle(256)
                due = self.engine.next_wakeup()
            if not busy:
                late = None if due is None or self.held else max(0.0, (due - self.clock.now()) / SECOND)
                self._bell.wait(late)

    def _think(self) -> None:
        if not self.held and self._busy() and self.simulated:
            self.write(f"It is still busy after {PATIENCE_S} s of real time: run lets it go on.")

    def _busy(self) -> bool:
        """Run the agent until it is idle; return whether it exceeds `PATIENCE_S`."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            busy = self.engine.run_until_idle(TURNS)
            due = self.engine.next_wakeup()
            if not busy and (due is None or due > self.clock.now()):
                return False
        return True

    # Input

    @property
    def prompt(self) -> str:
        return "    ... " if self.text else f"{self.engine.name}> "

    def handle(self, line: str) -> bool:
        """Execute an input line; return False to end the shell."""
        try:
            with self._lock:
                return self._handle(line)
        except (SocialbotError, OSError) as problem:
            self.write(f"error: {problem}")
        except Exception as problem:  # noqa: BLE001 - no input may end the shell
            self.write(f"error: {type(problem).__name__}: {problem}")
        return True

    def _handle(self, line: str) -> bool:
        whole = f"{self.text}\n{line}".strip()
        going_on, self.text = bool(self.text), ""
        if not whole or whole.startswith("//"):
            return True
        if not going_on and (found := _COMMAND.fullmatch(whole)) is not None:
            word, rest = found[1], (found[2] or "").strip()
            if word in ("quit", "exit"):
                return False
            command = getattr(self, f"do_{word.replace('-', '_')}", None)
            if command is not None:
                command(rest)
                return True
        if (line.strip() or not going_on) and _wants_more(whole):
            self.text = whole
            return True
        self._say(whole)
        self._think()
        return True

    def _say(self, text: str) -> None:
        """Handle an input without a command: a belief change, goal, query, plan or rule."""
        if text.startswith("!"):
            self._want(parse_literal(text.lstrip("!")))
        elif text.startswith("?"):
            self._ask(text[1:])
        elif text.startswith("-+"):
            belief = parse_literal(text[2:])
            belief.check()
            self._change(partial(self.engine.beliefs.replace, self.engine.beliefs.relation(belief.key)), belief)
        elif (event := _belief_event(text)) is not None:
            self._believe(event.literal, event.change)
        elif text.endswith("."):
            self.engine.add_text(text, "<shell>")
        elif text.startswith(("+", "-", "@")) or "<-" in text or ":-" in text:
            self.engine.add_text(f"{text}.", "<shell>")
        else:
            name = text.partition(" ")[0]
            raise ParameterError(
                f"there is no command {name}", remedy=f"help lists them; +{name} believes it, !{name} wants it"
            )

    def _believe(self, belief: Literal, change: Change) -> None:
        if change is Change.REMOVED:
            self.engine.forget(belief)  # type: ignore[arg-type]
        else:
            belief.check()
            self._change(partial(self.engine.beliefs.add, self.engine.beliefs.relation(belief.key)), belief)

    def _change(self, change: Callable[..., Any], belief: Literal) -> None:
        notes = belief.annotations
        notes = notes if any(map(is_source, notes)) else notes + SELF

        def make() -> None:
            event = change(belief.args, notes, "")
            if event is not None:
                self.engine.interpreter.events.append(event[1:])

        self.engine.call(make)

    def _want(self, goal: Literal) -> None:
        from socialbot.bdi.stdlib.registry import opened

        variables: dict[str, Any] = {}
        args = opened(goal.args, variables)
        trigger = self.engine.library.triggers[f"+!{goal.key}"]
        request = (SUBGOAL if closed(args) else SUBGOAL | OPEN, trigger, args, goal.annotations or SELF, "")

        def ended(failure: Any) -> None:
            found = {name: resolve(value) for name, value in variables.items() if not isinstance(resolve(value), Var)}
            if failure is None:
                self.write(f"achieved {goal}{': ' + _solution(found) if found else ''}")

        self.engine.call(lambda: self.engine.intentions.adopt(request, ended))

    def _ask(self, text: str) -> None:
        self._think()
        count = 0
        for count, found in enumerate(self.engine.query(parse_condition(text)), 1):
            if count > MOST_SOLUTIONS:
                self.write("...")
                break
            self.write(_solution(found) or "yes")
            if not found:
                break
        if count == 0:
            self.write("no")

    # Trace

    def _show(self, record: Record) -> None:
        if self.tracing or self._stepping or record.kind in LOUD:
            detail = record.detail
            more = (
                detail.get("message")
                or detail.get("reason")
                or detail.get("label")
                or detail.get("outcome")
                or detail.get("text")
            )
            self.write(
                f"  {record.time / SECOND:.3f} s  {record.id}  {record.kind} {record.what}{f': {more}' if more else ''}"
            )

    # Commands

    def do_help(self, rest: str) -> None:
        self.write(HELP)

    def do_beliefs(self, rest: str) -> None:
        found = [
            (str(held.belief), held.source, f"{held.since / SECOND:.3f} s")
            for held in self.engine.beliefs
            if not rest or held.belief.functor == rest
        ]
        for line in _columns(sorted(found)):
            self.write(line)
        if not found:
            self.write("no beliefs")

    def do_desires(self, rest: str) -> None:
        for desire in self.engine.mind().desires:
            self.write(str(desire))
        if not self.engine.mind().desires:
            self.write("no desires")

    def do_intentions(self, rest: str) -> None:
        for intention in self.engine.intentions:
            because = f": {intention.because}" if intention.because else ""
            self.write(f"#{intention.number} {intention.state}{because}")
            for level in reversed(intention.stack(self.engine.library.goals)):
                self.write(f"    {level}")
        if not self.engine.intentions:
            self.write("no intentions")

    def do_plans(self, rest: str) -> None:
        plans = [
            plan for plan in self.engine.library if not rest or rest in (plan.label, plan.event.literal.functor)
        ]  # fmt: skip
        for plan in plans:
            self.write(_written(plan))
        for inference in () if rest else _inferences(self.engine):
            self.write(inference)
        if not plans:
            self.write("no plans")

    def do_trace(self, rest: str) -> None:
        if rest not in ("on", "off", ""):
            raise ParameterError(f"trace {rest}", remedy="write trace on, or trace off")
        self.tracing = rest == "on" if rest else not self.tracing
        self.write(f"trace {'on' if self.tracing else 'off'}")

    def do_why(self, rest: str) -> None:
        self.write(as_text(self.trace.explain(self._record(rest))))

    def _record(self, what: str) -> str:
        if what in self.trace:
            return what
        if what.isdigit():
            return f"{self.engine.name}-{what}"
        found = self.trace.find(what=what) if what else self.trace.find("action")
        if not found:
            raise ParameterError(
                f"nothing on the trace is called {what}" if what else "it has done nothing yet",
                remedy="trace on shows what happens, and its ids",
            )
        return max(found, key=lambda record: (record.kind == "action", record.time, found.index(record))).id

    def do_why_not(self, rest: str) -> None:
        label, _, args = rest.partition(" ")
        if not label:
            raise ParameterError("why-not what?", remedy="write why-not LABEL ARGUMENT, ...")
        terms = parse_term(f"[{args}]") if args.strip() else ()
        assert isinstance(terms, tuple)
        if names_in(terms):
            raise ParameterError("a variable is no value", remedy="give the arguments of the event you think of")
        self.write(self.engine.why_not(label, *terms))

    def do_time(self, rest: str) -> None:
        if rest:
            found = _DURATION.fullmatch(rest)
            if found is None or (found[2] or "s") not in UNITS:
                raise ParameterError(
                    f"cannot read {rest!r}", where="time", remedy="write time +5 s, or +500 ms, +2 min"
                )
            self._pass(float(found[1]) * UNITS[found[2] or "s"])
        self.write(f"{self.clock.now() / SECOND:.3f} s")

    def do_run(self, rest: str) -> None:
        self.held = False
        self._bell.set()
        self._think()
        if rest:
            try:
                seconds = float(rest.removesuffix("s"))
            except ValueError:
                raise ParameterError(f"cannot read {rest!r}", where="run", remedy="write run 5") from None
            self._pass(seconds)

    def _pass(self, seconds: float) -> None:
        """Advance the time from one scheduled event to the next."""
        if not isinstance(self.clock, ManualClock):
            self._lock.release()
            try:
                threading.Event().wait(seconds)
            finally:
                self._lock.acquire()
            return
        end = self.clock.now() + nanoseconds(seconds)
        self._think()
        while (due := self.engine.next_wakeup()) is not None and due <= end and not self.held:
            self.clock.set(max(due, self.clock.now()))
            if self._busy():
                self.write(f"It is still busy at {self.clock.now() / SECOND:.3f} s: run lets it go on.")
                return
        self.clock.set(end)
        self._think()

    def do_hold(self, rest: str) -> None:
        self.held = True
        self.write("It stands still: step lets it make a turn, run lets it go on.")

    def do_step(self, rest: str) -> None:
        if rest and not rest.isdigit():
            raise ParameterError(f"cannot read {rest!r}", where="step", remedy="write step, or step 3")
        self.held = self._stepping = True
        try:
            for _ in range(int(rest or 1)):
                if not self.engine.run_until_idle(1):
                    self.write("Nothing is left to do now.")
                    break
        finally:
            self._stepping = False

    def do_load(self, rest: str) -> None:
        path = Path(_file(rest, "load"))
        self.engine.add_text(path.read_text("utf-8"), str(path))
        self._think()

    def do_save(self, rest: str) -> None:
        write(self.engine, _file(rest, "save"))
        self.write(f"saved {len(self.engine.beliefs)} beliefs, {len(self.engine.intentions)} intentions")

    def do_restore(self, rest: str) -> None:
        data = read(_file(rest, "restore"))
        restore(self.engine, data)
        if isinstance(self.clock, ManualClock):
            self.clock.set(max(self.clock.now(), data["time"]))
        self.write(f"restored {len(self.engine.beliefs)} beliefs, {len(data['pursuits'])} goals and events")
        self._think()

    def completions(self, text: str) -> list[str]:
        """Return the completions of a word."""
        commands = [name[3:].replace("_", "-") for name in dir(self) if name.startswith("do_")]
        sign = text[: len(text) - len(text.lstrip("+-!?"))]
        known = {key.rpartition("/")[0] for key in self.engine.beliefs.relations}
        known |= {key[2:].rpartition("/")[0] for key in self.engine.library.triggers if key[1:2] in ("!", "?")}
        names = [sign + name for name in sorted(known)] if sign else [*commands, "quit", *sorted(known)]
        return [name for name in names if name.startswith(text)]


class _Actions(dict[str, Any]):
    """The actions of an agent. An unknown action is only printed."""

    def __init__(self, known: dict[str, Any], shell: Shell) -> None:
        super().__init__(known)
        self.shell = shell

    def get(self, name: str, default: Any = None) -> Any:
        return super().get(name) or partial(self._print, name)

    def _print(self, name: str, engine: Engine, *args: object) -> None:
        shown = f"({', '.join(map(show, args))})" if args else ""
        self.shell.write(f"[{engine.name}] does {name}{shown}")


def _belief_event(text: str) -> Any:
    """Parse a belief change; None for other texts."""
    if not text.startswith(("+", "-")):
        return None
    try:
        event = parse_event(text)
    except AgentSpeakError:
        return None
    return event if event.change in (Change.ADDED, Change.REMOVED) else None


def _wants_more(text: str) -> bool:
    """Whether a text is an incomplete plan or rule, without its final dot."""
    if text.endswith(".") or text.startswith(("!", "?", "-+")) or _belief_event(text) is not None:
        return False
    return text.startswith(("+", "-", "@", "{")) or "<-" in text or ":-" in text


def _solution(found: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {show(value)}" for name, value in found.items() if not name.startswith("_"))


def _columns(rows: list[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def _written(plan: Plan) -> str:
    return agentspeak(plan) if plan.text is not None else f"{plan.label + ': ' if plan.label else ''}{plan}"


def _inferences(engine: Engine) -> Iterator[str]:
    for inferences in engine.library.inferences.values():
        for ready in inferences:
            yield agentspeak(ready.inference) if ready.inference.text is not None else str(ready.inference)


def _file(name: str, command: str) -> str:
    if not name:
        raise ParameterError("which file?", where=command, remedy=f"write {command} FILE")
    return name
