"""Result of a hospital run: its missions, its end, its event log, its world view and its terminal view."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from socialbot.agents.hospital.missions import DISINFECT
from socialbot.agents.hospital.ward._drawing import WORD, WardAnimation
from socialbot.agents.hospital.ward.messages import AgentState, RoomState, WardState
from socialbot.agents.hospital.ward.ward import NURSE, Room, Ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld, ward_of
from socialbot.agents.teams.event_log import MissionResult, MissionResults, TeamEventLog
from socialbot.agents.teams.messages import Missions, MissionView
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.node import Graph, check_parameters
from socialbot.runs.plan_trees import TreeBranch, as_text, branches, with_failure, with_news

QUIET_S = 0.5
"""A run is complete after this time without infected rooms and open missions."""


def ward_in(graph: Graph) -> Ward | None:
    """The ward of the hospital in ``graph``; None for a graph without one. Raises ParameterError."""
    for node in graph.nodes:
        if issubclass(node.type, HospitalWorld):
            return ward_of(check_parameters(node.type, node.parameters, where=node.name))
    return None


class MissionMonitor:
    """Completion check of a run: no infection to come, no infected room, no open mission.

    Rooms of failed missions may stay infected.
    """

    def __init__(self, ward: Ward) -> None:
        self._last_s = max((time_s for time_s, _ in ward.infections), default=0.0)
        self._last: int | None = None
        """Time of the last infection (ns)."""
        self._infected: set[str] = set()
        self._missions: dict[int, MissionView] = {}
        self._quiet_since: int | None = None

    def observe(self, message: Message) -> None:
        """Take a message of the run."""
        if isinstance(message, WardState):
            if self._last is None:
                self._last = message.stamp + nanoseconds(self._last_s)
            self._infected = {room.name for room in message.rooms if room.infected}
        elif isinstance(message, Missions):
            self._missions.update((view.id, view) for view in message.missions)
        else:
            return
        if not self._is_quiet(message.stamp):
            self._quiet_since = None
        elif self._quiet_since is None:
            self._quiet_since = message.stamp

    def are_over(self, now: int) -> bool:
        """Whether the run is complete at ``now`` (ns)."""
        return self._quiet_since is not None and now - self._quiet_since >= nanoseconds(QUIET_S)

    def _is_quiet(self, now: int) -> bool:
        if self._last is None or now <= self._last:
            return False
        given_up = {view.target for view in self._missions.values() if view.status == "failed"}
        is_open = any(view.status not in ("finished", "failed") for view in self._missions.values())
        return self._infected <= given_up and not is_open


class HospitalView(WardAnimation):
    """World view of a hospital run: its ward and its missions."""

    file = "ward.svg"
    kinds = (WardState, Missions)

    def __init__(self, ward: Ward) -> None:
        super().__init__(ward)
        self._results = MissionResults()

    def take(self, message: Message) -> None:
        super().take(message)
        self._results.take(message)

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        """Numbers of missions, problems and new plans, and the median duration of a mission."""
        missions = self._results.sorted()
        finished = [mission for mission in missions if mission.finished]
        troubled = [mission for mission in missions if mission.problems]
        recovered = sum(mission.finished for mission in troubled)
        seconds = sorted(mission.took_s for mission in finished if mission.took_s is not None)
        figures = [
            (f"{len(finished)} of {len(missions)}", "missions done"),
            (str(sum(len(mission.problems) for mission in missions)), "problems reported by agents"),
            (f"{recovered} of {len(troubled)}" if troubled else "-", "missions done in spite of a problem"),
            (str(sum(mission.view.revisions for mission in missions)), "plans revised before a problem"),
        ]
        return [*figures, (f"{seconds[len(seconds) // 2]:.2f} s", "median time of a mission")] if seconds else figures

    def results(self, start: int, end: int) -> dict[str, Any]:
        """``missions``: their results. ``infected``: the rooms that still need disinfection."""
        rooms = self.state(end).rooms if self else ()
        return {
            "missions": [mission.results() for mission in self._results.sorted()],
            "infected": [room.name for room in rooms if room.infected],
        }

    def summary(self, start: int, end: int) -> list[str]:
        """Nothing: the terminal view prints the missions."""
        return []


def world_view(graph: Graph) -> HospitalView | None:
    """The world view of the hospital in ``graph``; None for a graph without one. Raises ParameterError."""
    ward = ward_in(graph)
    return None if ward is None else HospitalView(ward)


def completion(graph: Graph) -> MissionMonitor | None:
    """The completion check of the hospital in ``graph``; None for a graph without one. Raises ParameterError."""
    ward = ward_in(graph)
    return None if ward is None else MissionMonitor(ward)


def event_log(graph: Graph) -> TeamEventLog | None:
    """The event log of the hospital in ``graph``; None for a graph without a coordinator."""
    is_team = Missions in graph.topics().values()
    return TeamEventLog("{0} is infected", "the ward has changed") if is_team else None


SMALL = 12
"""Largest number of rooms that are listed one by one."""
ROWS = 12
"""Largest number of missions that are all listed; of more, only those with a problem and the unfinished ones."""
TREES = 6
"""Largest number of task trees of a run: of the first plan, and of changed plans."""


class HospitalTerminal:
    """Prints the ward and the task trees of plans during a run."""

    def __init__(self, console: Console, ward: Ward) -> None:
        self.missions = MissionResults()
        self._console = console
        self._ward = ward
        self._state: WardState | None = None
        self._trees = 0
        self._before: dict[str, list[TreeBranch]] = {}
        self._failed: dict[str, str] = {}

    def show(self, message: Message) -> None:
        """Take a message of the run, or a derived trace record, and print what changed."""
        self.missions.take(message)
        match message:
            case WardState():
                first = self._state is None
                self._state = message
                if first:
                    self._show_ward()
            case TraceRecord(kind="step_end") if message.detail.get("outcome") == "failed":
                action, *args = message.what.strip("()").split()
                self._failed[message.source] = f"{action}({', '.join(args)})"
            case TraceRecord(kind="plan_start") if "tree" in message.detail:
                self._show_plan(message)
            case TraceRecord(kind="plan_end") if "tree" in message.detail:
                self._show_end(message)

    def finish(self) -> None:
        """Print the final state of the ward, and a table of the missions."""
        self._show_ward()
        if missions := self.missions.sorted():
            self._console.print(missions_table(missions))

    def _show_plan(self, record: TraceRecord) -> None:
        made, before = branches(record.detail["tree"]), self._before.get(record.what)
        self._before[record.what] = made
        if self._trees and before is None:
            return
        self._show_tree(made if before is None else with_news(made, before))

    def _show_end(self, record: TraceRecord) -> None:
        """Print the task tree of an abandoned plan with its failed action, and the ward."""
        if record.detail.get("outcome") == "succeeded":
            return
        tree = branches(record.detail["tree"])
        team = [call for name, call in self._failed.items() if any(name in branch.text for branch in tree)]
        self._failed.clear()
        self._show_tree(with_failure(tree, team[-1]) if team else tree)
        if len(self._ward.rooms) <= SMALL:
            self._show_ward()

    def _show_tree(self, tree: list[TreeBranch]) -> None:
        self._trees += 1
        if self._trees <= TREES:
            self._console.print(as_text(tree, " " * 11), soft_wrap=True, end="")
        elif self._trees == TREES + 1:
            self._console.print(" " * 11 + "(the page has more trees)", style="dim")

    def _show_ward(self) -> None:
        if self._state is not None:
            self._console.print(ward_text(self._ward, self._state), soft_wrap=True)


def ward_text(ward: Ward, state: WardState) -> Table | Text:
    """The ward for the terminal: a table of rooms; for a large ward, numbers and the infected rooms."""
    if len(ward.rooms) > SMALL:
        return _in_figures(ward, state)
    table = Table("room", "door", "tidy", "disinfected", "occupants", box=None, padding=(0, 2, 0, 0))
    for column in table.columns:
        column.header_style = "dim"
    for room in ward.rooms:
        table.add_row(*_room(room, state.room(room.name), state))
    on_the_way = [_name_of(agent) for agent in state.agents if agent.place not in ward.room_by_name]
    if on_the_way:
        table.add_row("elsewhere", "", "", "", ", ".join(on_the_way))
    return table


def _room(room: Room, state: RoomState | None, ward: WardState) -> Iterator[str | Text]:
    yield room.name
    if state is None:
        yield from ("?", "?", "?")
    else:
        yield Text("open") if state.door_open else Text("closed", "red")
        yield Text("yes") if state.cleaned else Text("dirty", "yellow")
        yield Text("✓", "green") if state.disinfected else Text("✗ infected", "bold red")
    there = [_name_of(agent) for agent in ward.agents if agent.place == room.name]
    yield ", ".join([*there, *(state.people if state else ())])


def _name_of(agent: AgentState) -> str:
    battery = "" if agent.kind == NURSE else f" {agent.battery:.0%}"
    return f"{WORD.get(agent.kind, agent.kind)}{agent.name.removeprefix(agent.kind)}{battery}"


def _in_figures(ward: Ward, state: WardState) -> Text:
    infected = [room.name for room in state.rooms if room.infected]
    text = Text(f"{len(ward.rooms)} rooms: ")
    text.append(f"{len(state.rooms) - len(infected)} disinfected", "green")
    if infected:
        text.append(f", {len(infected)} infected: {', '.join(infected)}", "red")
    unfit = [room.name for room in state.rooms if not room.ready]
    if unfit:
        text.append(f"; not fit: {', '.join(unfit)}", "yellow")
    low = [agent.name for agent in state.agents if agent.low_battery]
    if low:
        text.append(f"; battery low: {', '.join(low)}", "yellow")
    return text


def missions_table(missions: list[MissionResult]) -> Table:
    """Table of missions: planned, done and failed actions, problems, recovery and duration."""
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    for heading in ("mission", "room", "planned", "done", "failed", "problem", "recovered", "ended", "took"):
        is_text, is_problem = heading in ("mission", "room", "recovered", "ended"), heading == "problem"
        justify = "left" if is_text or is_problem else "right"
        no_wrap = is_text or heading == "took"
        table.add_column(heading, justify=justify, no_wrap=no_wrap, min_width=18 if is_problem else None)
    shown = missions if len(missions) <= ROWS else [each for each in missions if each.problems or not each.finished]
    for mission in shown:
        view, problems = mission.view, mission.problems
        number = str(view.id) if view.kind == DISINFECT else f"{view.id} {view.kind}"
        recovered = "" if not problems else "yes" if mission.finished else "no"
        took = "" if mission.took_s is None else f"{mission.took_s:.2f} s"
        table.add_row(number, view.target, *_counts([mission]), "; ".join(problems), recovered, view.status, took)
    if len(missions) > 1:
        met = [mission for mission in missions if mission.problems]
        problems = sum(len(mission.problems) for mission in met)
        recovered = f"{sum(mission.finished for mission in met)} of {len(met)}"
        finished = sum(mission.finished for mission in missions)
        total = (f"all {len(missions)}", "", *_counts(missions), str(problems), recovered, str(finished), "")
        table.add_row(*total, style="bold")
    return table


def _counts(missions: list[MissionResult]) -> tuple[str, str, str]:
    """Numbers of planned, done and failed actions."""
    counts = ((mission.planned, mission.done(), mission.done("failed")) for mission in missions)
    planned, done, failed = map(sum, zip(*counts, strict=True))
    return str(planned), str(done), str(failed)


def terminal_view(graph: Graph, console: Console) -> HospitalTerminal | None:
    """The terminal view of the hospital in ``graph``; None for a graph without one. Raises ParameterError."""
    ward = ward_in(graph)
    return None if ward is None else HospitalTerminal(console, ward)
