"""Interactive shell for an agent: add beliefs and goals, inspect its state, advance its time."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import agentspeak, parse_condition, parse_event, parse_literal, parse_term
from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.programs import read_text
from socialbot.bdi.intentions import subgoal
from socialbot.bdi.literals import SELF, Change, Literal, is_source, literal
from socialbot.bdi.saving import read, restore, write
from socialbot.bdi.terms import names_in, show
from socialbot.bdi.trace import Record, Trace, as_text, tee
from socialbot.bdi.unification import Var, resolve
from socialbot.core.clock import SECOND, Clock, ManualClock, nanoseconds
from socialbot.core.errors import ParameterError, SocialbotError

HELP = """\
+b(1)             add a belief (-b(1): remove it; -+b(2): replace it)
!go               add a goal
?b(X) & X > 1     query the beliefs
+!go : b(X) <- .print(X).                        add a plan; rules and beliefs likewise, with a final dot
beliefs [NAME]    beliefs, their sources, and the times of their begin
desires           pursued goals                  intentions        intentions, step by step
plans [NAME]      plans                          trace on|off      show every event of the agent
why [ID|NAME]     reasons of a record of the trace, or of the last action
why-not PLAN ARG, ...                            why a plan would not be chosen now
time [+5 s]       show the time; advance it      run [SECONDS]     continue; advance the time
hold              stop after each input          step [N]          run N reasoning cycles
load FILE         add AgentSpeak                 save FILE, restore FILE: state of the agent
help, quit"""

FORMATS = {
    "time": (r"(\+\s*(?P<number>\d+(\.\d+)?)\s*(?P<unit>ms|s|min|h)?)?", "time +5 s, or +500 ms, +2 min"),
    "run": (r"(\d+(\.\d*)?\s*s?)?", "run 5"),
    "step": (r"\d*", "step, or step 3"),
    "trace": (r"on|off|", "trace on, or trace off"),
    "why-not": (r".+", "why-not LABEL ARGUMENT, ..."),
    **{command: (r".+", f"{command} FILE") for command in ("load", "save", "restore")},
}
"""Pattern of the arguments of a command, and how to write it; other commands take any."""

UNITS = {"ms": 0.001, None: 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}
PATIENCE_S = 1.0  # reasoning time (s) of an agent per input line
MOST_SOLUTIONS = 50
LOUD = frozenset({"failure", "dropped"})  # kinds of records that are shown even if the trace is off

_COMMAND = re.compile(r"([a-z][a-z-]*)(?:\s+(.*))?", re.DOTALL)


class Shell:
    """One agent and the commands of its shell. `handle` reports errors and does not raise them.

    With a `ManualClock` only commands advance the time. With another clock the agent runs in a thread, from `start` to
    `close`.
    """

    def __init__(self, engine: Engine, write_line: Callable[[str], object] = print) -> None:
        self.engine = engine
        self.clock: Clock = engine.clock
        self.write = write_line
        self.trace = Trace()
        self.tracing = False
        self.held = False
        self.text = ""
        self._ended = False
        self._lock = threading.RLock()
        self._wakeup = threading.Event()
        self._stepping = False
        engine.trace.sink = tee(*([engine.trace.sink] if engine.trace.sink else []), self.trace, self._show)
        engine.actions = EchoActions(engine.actions)
        if engine.out is None:
            engine.out = lambda text: self.write(f"[{engine.name}] {text}")

    # Running

    def start(self) -> None:
        """Start the thread of the agent, unless its clock is simulated."""
        if isinstance(self.clock, ManualClock):
            return
        host = self.engine.wake

        def wake() -> None:
            self._wakeup.set()
            if host is not None:
                host()

        self.engine.wake = wake
        threading.Thread(target=self._serve, name="agent", daemon=True).start()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._wakeup.set()

    def _serve(self) -> None:
        while not self._ended:
            with self._lock:
                self._wakeup.clear()
                busy = not self.held and self.engine.run_until_idle(256)
                due = self.engine.next_wakeup()
            if not busy:
                late = None if due is None or self.held else max(0.0, (due - self.clock.now()) / SECOND)
                self._wakeup.wait(late)

    def _think(self) -> bool:
        """Run the agent until it is idle; return whether it exceeds `PATIENCE_S`, and say so in simulated time."""
        end = time.monotonic() + PATIENCE_S
        while not self.held and time.monotonic() < end:
            busy = self.engine.run_until_idle(1)  # a cycle may take a tenth of a second
            due = self.engine.next_wakeup()
            if not busy and (due is None or due > self.clock.now()):
                return False
        if not self.held and isinstance(self.clock, ManualClock):
            self.write(f"The agent is still busy at {self._seconds(self.clock.now())}: run continues.")
        return not self.held

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
        continued, self.text = bool(self.text), ""
        if not whole or whole.startswith("//"):
            return True
        if not continued and (found := _COMMAND.fullmatch(whole)) is not None:
            word, rest = found[1], (found[2] or "").strip()
            if word in ("quit", "exit"):
                return False
            command = getattr(self, f"do_{word.replace('-', '_')}", None)
            if command is not None:
                pattern, usage = FORMATS.get(word, (".*", ""))
                if not re.fullmatch(pattern, rest, re.DOTALL):
                    raise ParameterError(f"cannot read {rest!r}", where=word, remedy=f"write {usage}")
                command(rest)
                return True
        if (line.strip() or not continued) and _is_incomplete(whole):
            self.text = whole
            return True
        self._execute(whole)
        self._think()
        return True

    def _execute(self, text: str) -> None:
        """Handle an input without a command: a belief change, goal, query, plan or rule."""
        if text.startswith("!"):
            self._want(parse_literal(text.lstrip("!")))
        elif text.startswith("?"):
            self._ask(text[1:])
        elif text.startswith("-+"):
            self._believe(parse_literal(text[2:]), replace=True)
        elif (event := _belief_event(text)) is not None:
            if event.change is Change.REMOVED:
                self.engine.forget(event.literal)
            else:
                self._believe(event.literal)
        elif text.endswith("."):
            self.engine.add_text(text, "<shell>")
        elif _is_program(text):
            self.engine.add_text(f"{text}.", "<shell>")
        else:
            name = text.partition(" ")[0]
            remedy = f"type help for a list; +{name} adds a belief, !{name} a goal"
            raise ParameterError(f"there is no command {name}", remedy=remedy)

    def _believe(self, belief: Literal, *, replace: bool = False) -> None:
        belief.check()
        beliefs, notes = self.engine.beliefs, belief.annotations
        notes = notes if any(map(is_source, notes)) else notes + SELF

        def change() -> None:
            relation = beliefs.relation(belief.key)
            if not replace:
                beliefs.add(relation, belief.args, notes, "")
            elif (event := beliefs.replace(relation, belief.args, notes, "")) is not None:
                beliefs.events.append(event[1:])

        self.engine.call(change)

    def _want(self, goal: Literal) -> None:
        from socialbot.bdi.stdlib.registry import opened

        variables: dict[str, Any] = {}
        args = opened(goal.args, variables)
        trigger = self.engine.library.triggers[f"+!{goal.key}"]
        request = subgoal(trigger, args, goal.annotations or SELF, "")

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

    def _write_all(self, lines: Iterable[object], noun: str) -> None:
        """Write each line, or that there are none."""
        shown = [str(line) for line in lines]
        for line in shown or [f"no {noun}"]:
            self.write(line)

    def _show(self, record: Record) -> None:
        if self.tracing or self._stepping or record.kind in LOUD:
            details = (record.detail.get(name) for name in ("message", "reason", "label", "outcome", "text"))
            more = next((f": {detail}" for detail in details if detail), "")
            self.write(f"  {self._seconds(record.time)}  {record.id}  {record.kind} {record.what}{more}")

    def _seconds(self, stamp: int) -> str:
        return f"{stamp / SECOND:.3f} s"

    # Commands

    def do_help(self, rest: str) -> None:
        self.write(HELP)

    def do_beliefs(self, rest: str) -> None:
        held = [held for held in self.engine.beliefs if not rest or held.belief.functor == rest]
        rows = sorted((str(one.belief), one.source, self._seconds(one.since)) for one in held)
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
        self._write_all(lines, "beliefs")

    def do_desires(self, rest: str) -> None:
        self._write_all(self.engine.mind().desires, "desires")

    def do_intentions(self, rest: str) -> None:
        lines = []
        for intention in self.engine.intentions:
            lines.append(
                f"#{intention.number} {intention.state}{f': {intention.because}' if intention.because else ''}"
            )
            lines += [f"    {level}" for level in reversed(intention.stack(self.engine.library.goals))]
        self._write_all(lines, "intentions")

    def do_plans(self, rest: str) -> None:
        library = self.engine.library
        plans = [plan for plan in library if not rest or rest in (plan.label, plan.event.literal.functor)]
        lines = [
            agentspeak(plan) if plan.text is not None else f"{plan.label}: {plan}" if plan.label else str(plan)
            for plan in plans
        ]
        rules = [ready.inference for inferences in library.inferences.values() for ready in inferences if not rest]
        lines += [str(rule) if rule.text is None else agentspeak(rule) for rule in rules]
        self._write_all(lines, "plans")

    def do_trace(self, rest: str) -> None:
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
            problem = f"the trace has no {what}" if what else "the agent has done nothing yet"
            raise ParameterError(problem, remedy="trace on shows all events with their ids")
        return max(found, key=lambda record: (record.kind == "action", record.time, found.index(record))).id

    def do_why_not(self, rest: str) -> None:
        label, _, args = rest.partition(" ")
        terms = parse_term(f"[{args}]") if args.strip() else ()
        assert isinstance(terms, tuple)
        if names_in(terms):
            raise ParameterError("an argument is a variable", where="why-not", remedy="write the values of the event")
        self.write(self.engine.why_not(label, *terms))

    def do_time(self, rest: str) -> None:
        if found := re.fullmatch(FORMATS["time"][0], rest):
            self._pass(float(found["number"] or 0) * UNITS[found["unit"]])
        self.write(self._seconds(self.clock.now()))

    def do_run(self, rest: str) -> None:
        self.held = False
        self._wakeup.set()
        self._think()
        self._pass(float(rest.rstrip("s ") or 0))

    def _pass(self, seconds: float) -> None:
        """Advance the time from one scheduled event to the next."""
        if seconds == 0:
            return
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
            if self._think():
                return
        self.clock.set(end)
        self._think()

    def do_hold(self, rest: str) -> None:
        self.held = True
        self.write("The agent is stopped: step runs a reasoning cycle, run continues.")

    def do_step(self, rest: str) -> None:
        self.held = self._stepping = True
        try:
            for _ in range(int(rest or 1)):
                if not self.engine.run_until_idle(1):
                    self.write("The agent is idle.")
                    break
        finally:
            self._stepping = False

    def do_load(self, rest: str) -> None:
        self.engine.add_text(read_text(Path(rest)), rest)
        self._think()

    def do_save(self, rest: str) -> None:
        write(self.engine, rest)
        self.write(f"saved beliefs: {len(self.engine.beliefs)}, intentions: {len(self.engine.intentions)}")

    def do_restore(self, rest: str) -> None:
        data = read(rest)
        restore(self.engine, data)
        if isinstance(self.clock, ManualClock):
            self.clock.set(max(self.clock.now(), data["time"]))
        self.write(f"restored beliefs: {len(self.engine.beliefs)}, goals and events: {len(data['pursuits'])}")
        self._think()

    def completions(self, text: str) -> list[str]:
        commands = [name[3:].replace("_", "-") for name in dir(self) if name.startswith("do_")]
        sign = text[: len(text) - len(text.lstrip("+-!?"))]
        known = {key.rpartition("/")[0] for key in self.engine.beliefs.relations}
        known |= {key[2:].rpartition("/")[0] for key in self.engine.library.triggers if key[1:2] in ("!", "?")}
        names = [sign + name for name in sorted(known)] if sign else [*commands, "quit", *sorted(known)]
        return [name for name in names if name.startswith(text)]


class EchoActions(dict[str, Any]):
    """The actions of an agent. An unknown action is only printed."""

    def get(self, name: str, default: Any = None) -> Any:
        return super().get(name) or partial(_print_action, name)


def _print_action(name: str, engine: Engine, *args: object) -> None:
    from socialbot.bdi.agentspeak._spelling import spelled

    if engine.out is not None:
        engine.out(f"does {spelled(literal(name, args))}")


def _belief_event(text: str) -> Any:
    """Parse a belief change; None for other texts."""
    if not text.startswith(("+", "-")):
        return None
    try:
        event = parse_event(text)
    except AgentSpeakError:
        return None
    return event if event.change in (Change.ADDED, Change.REMOVED) else None


def _is_program(text: str) -> bool:
    return text.startswith(("+", "-", "@", "{")) or "<-" in text or ":-" in text


def _is_incomplete(text: str) -> bool:
    """Whether a text is an incomplete plan or rule, without its final dot."""
    if text.endswith(".") or text.startswith(("!", "?", "-+")) or _belief_event(text) is not None:
        return False
    return _is_program(text)


def _solution(found: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {show(value)}" for name, value in found.items() if not name.startswith("_"))
