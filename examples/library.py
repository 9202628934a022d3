"""Library: runners fetch books from rooms whose doors a porter must hold, and others replace those that fail."""

from pathlib import Path
from typing import ClassVar

from socialbot import Delivery, Graph, InlineRunner, Input, NodeConfig, Parameter, read_domain, read_problem
from socialbot.agents import teams
from socialbot.planning.htn import TaskDomain, TaskState

RUNNERS, PORTERS, DESK = ("runner1", "runner2", "runner3"), ("porter1", "porter2"), "desk"
BOOKS = {"atlas": "cellar", "bible": "cellar", "comic": "attic", "diary": "attic"}
LIBRARY = TaskDomain("library")


# The world: what actions change. ``loc`` has runners and books; a book in the hands of a runner is at the runner.


@LIBRARY.action
def a_hold(state, porter, room):
    state.holders[room] = [*state.holders[room], porter]
    return state


@LIBRARY.action
def a_release(state, porter, room):
    state.holders[room] = [other for other in state.holders[room] if other != porter]
    return state


@LIBRARY.action
def a_enter(state, runner, room):
    return moved(state, runner, room) if state.holders[room] and state.loc[runner] == DESK else None


@LIBRARY.action
def a_leave(state, runner, room):
    return moved(state, runner, DESK) if state.holders[room] and state.loc[runner] == room else None


@LIBRARY.action
def a_take(state, runner, book, place):
    is_there = place_of(state, book) == place == state.loc[runner]
    return moved(state, book, runner) if is_there and not carried(state, runner) else None


@LIBRARY.action
def a_put(state, runner, book, place):
    return moved(state, book, place) if state.loc[book] == runner and state.loc[runner] == place else None


def moved(state, what, place):
    state.loc[what] = place
    return state


def place_of(state, book):
    return state.loc.get(state.loc[book], state.loc[book])


def carried(state, runner):
    return next((book for book in BOOKS if state.loc.get(book) == runner), None)


@LIBRARY.method("m_fetch")
def has_it(state, runner, porter, book):
    return [("m_to", runner, porter, DESK), ("a_put", runner, book, DESK)] if state.loc[book] == runner else None


@LIBRARY.method("m_fetch")
def fetch(state, runner, porter, book):
    there, other = place_of(state, book), carried(state, runner)
    down = [("a_put", runner, other, state.loc[runner])] if other else []
    return [*down, ("m_to", runner, porter, there), ("a_take", runner, book, there), ("m_fetch", runner, porter, book)]


@LIBRARY.method("m_to")
def go(state, runner, porter, place):
    here, way = state.loc[runner], []
    for action, room in (("a_leave", here), ("a_enter", place)):
        if here != place and room != DESK:
            way += [("a_hold", porter, room), (action, runner, room), ("a_release", porter, room)]
    return way


def problem(mission: teams.Mission, state: TaskState):
    """The same mission in PDDL."""
    runner, porter, book = mission.team["Runner"], mission.team["Porter"], mission.target
    hands = f"(has {runner} {book})" if state.loc[book] == runner else f"(in {book} {place_of(state, book)})"
    other = carried(state, runner)
    full = "" if other == book else f"(has {runner} {other})" if other else f"(empty {runner})"
    rooms = state.holders if porter in mission.active or not mission.active else {}  # a porter may work for others
    held = "".join(f"(open {room})(holds {porter} {room})" for room, by in rooms.items() if porter in by)
    text = f"""(define (problem fetch) (:domain library)
      (:objects {runner} - runner {porter} - porter {" ".join(BOOKS)} - book {" ".join(state.holders)} - place)
      (:init (at {runner} {state.loc[runner]}) {hands} {full} {held or f"(idle {porter})"})
      (:goal (and (brought {book} {DESK}) (idle {porter}))))"""
    return read_problem(text, PDDL)


PDDL = read_domain(Path(__file__).with_suffix(".pddl").read_text("utf-8"))


class Library(teams.TeamDomain[teams.TeamState]):
    roles = (teams.Role("Runner", frozenset({"a_take", "a_enter"})), teams.Role("Porter", frozenset({"a_hold"})))
    kinds: ClassVar = {"fetch": 0, "urgent": 1}
    undone = "the book is not on the desk"

    def __init__(self, *, htn: bool = True) -> None:
        self.planner = teams.HtnMissionPlanner(LIBRARY) if htn else teams.PddlMissionPlanner(PDDL, problem)

    def targets(self, world):
        return [book for book, place in world.variables["loc"].items() if book in BOOKS and place != DESK]

    def is_done(self, world, target):
        return world.variables["loc"].get(target) == DESK if target in BOOKS else None

    def hopeless(self, world, target):
        return "" if target in world.variables["loc"] else f"{target} is gone"

    def member(self, world, name):
        agent = world.agent(name)
        return None if agent is None else teams.MemberState(agent.busy, agent.home)

    def state(self, world, mission, *, sees):
        return TaskState(**world.variables).copy()

    def tasks(self, mission):
        return [("m_fetch", mission.team["Runner"], mission.team["Porter"], mission.target)]

    def longest_s(self, action):
        return 4.0


class LibraryWorld(teams.TeamWorld):
    domain = LIBRARY
    seconds: ClassVar = {"a_hold": 2.0, "a_enter": 4.0, "a_leave": 4.0, "a_take": 3.0, "a_put": 3.0}

    def initial(self):
        return TaskState(loc={**dict.fromkeys(RUNNERS, DESK), **BOOKS}, holders={room: [] for room in BOOKS.values()})

    def members(self):
        return dict.fromkeys((*RUNNERS, *PORTERS), DESK)


class Coordinator(teams.TeamCoordinator):
    state = Input(teams.TeamState, teams.STATE, Delivery.LATCHED)
    planner = Parameter("htn", "planner of missions", choices=("htn", "pddl"))

    def team_domain(self):
        return Library(htn=self.planner == "htn")

    @state
    def on_state(self, message):
        self.observe(message)


class Runner(teams.TeamAgent):
    kind, can = "runner", ("a_enter", "a_leave", "a_take", "a_put")


class Porter(teams.TeamAgent):
    kind, can = "porter", ("a_hold", "a_release")


def library(planner: str = "htn", faults: str = "") -> Graph:
    """The graph of the library."""
    world = NodeConfig("world", LibraryWorld, {"faults": faults})
    coordinator = NodeConfig("coordinator", Coordinator, {"planner": planner, "patience_s": 20.0})
    team = {**dict.fromkeys(RUNNERS, Runner), **dict.fromkeys(PORTERS, Porter)}
    return Graph("library", (world, coordinator, *(NodeConfig(name, kind) for name, kind in team.items())))


def main() -> None:
    """A runner dies in the cellar, a porter hangs, a book vanishes, and a runner joins late."""
    for planner in ("htn", "pddl"):
        runner, results = (
            InlineRunner(library(planner, "15 stalls porter2 1000; 20 vanishes diary")),
            teams.MissionResults(),
        )
        runner.tap(teams.MISSIONS, lambda _, message, results=results: results.take(message))
        runner.kill("runner3")
        runner.start()
        for second, do, who in ((9, runner.kill, "runner1"), (60, runner.restart, "runner3")):
            runner.advance(second * 10**9)
            do(who)
        runner.advance(300 * 10**9)
        for each in results.sorted():
            team, problems = " and ".join(each.view.team) or "nobody", "; ".join(each.problems) or "no problem"
            print(f"{planner}: {each.view.target} {each.view.status} by {team} ({problems})")


if __name__ == "__main__":
    main()
