"""``socialbot down``: stop runs of ``socialbot up``."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from socialbot.cli._console import print_line
from socialbot.cli._options import VerboseOption, expect_no_machine, graph_names
from socialbot.core.errors import GraphError
from socialbot.core.messages import UpStatus
from socialbot.core.process import Ending
from socialbot.graph.status import printable

if TYPE_CHECKING:
    from socialbot.bridge.run_announcer import RunStatuses


PANEL = "Run a graph"
EXAMPLES = (
    "socialbot down",
    "socialbot down deploy.yaml",
)
NOT_ENDED = 10  # exit code: a run was not found, or did not end in time
LISTEN_S = 5.0  # time to wait for an unknown machine; a running one announces itself every second

SLOW = {
    "up": "no answer; with keys it accepts trusted senders only",
    "ending": "still ending",
    "ended": "its nodes have ended, but not its process",
}
"""Explanation of the last state of a run after the timeout."""

ASK_EVERY_S = 0.5
POLL_S = 0.05


@dataclass(frozen=True)
class Target:
    """Runs to end: those ``wanted``, one on each of ``machines``; ``own`` is this machine."""

    wanted: Callable[[UpStatus], bool]
    machines: tuple[str, ...] = ()
    own: str = ""

    @property
    def here(self) -> bool:
        """Whether runs on this computer are to end."""
        return not self.machines or self.own in self.machines


def down(
    file: Annotated[
        str | None,
        typer.Argument(help="Deployment or graph; default: all runs on this machine.", autocompletion=graph_names),
    ] = None,
    machine: Annotated[str | None, typer.Option(help="Machine of a deployment; default: all.")] = None,
    timeout: Annotated[float, typer.Option(min=0.0, help="Time limit in seconds.")] = 20.0,
    verbose: VerboseOption = False,
) -> None:
    """End runs of "socialbot up" as Ctrl-C would, and wait for them. Exit code 10: one did not end.

    If keys are set, only the owner of a key can end a run.
    """
    target = _enter(file, machine)
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.run_announcer import RunStatuses, locked_runs

    with Ending().on_signals() as ending, spinning_node("down") as ros:
        runs = RunStatuses(ros)
        found = find_runs(runs, target, ending, timeout)
        for one in found if verbose else ():
            print_line(f"{_named(one)}: asked to end")
        left = end(runs, found, ending, timeout)
        silent = [pid for run, pid in locked_runs().items() if target.here and run not in runs.statuses]
        refused = runs.refused
    unheard = [name for name in target.machines if name not in {one.machine for one in found}]
    for name in (name for name in unheard if not silent or name != target.own):
        # A run on this machine would have been received.
        what = "nothing is up" if name == target.own else "no answer; a run on this machine continues"
        print_line(f"{name}: {what}", err=name != target.own)
    for pid in silent:
        why = "its key is not trusted" if refused else "it does not answer"
        print_line(f"process {pid}: a run is up here, but {why}; end it by: kill -INT {pid}", err=True)
    if not (found or silent or target.machines):
        print_line(f"nothing is up here in ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}")
    for one in left:
        print_line(f"{_named(one)}: not ended after {timeout:g} s: {SLOW[one.state]}", err=True)
    if left or silent or set(unheard) - {target.own}:
        raise typer.Exit(NOT_ENDED)


def find_runs(runs: RunStatuses, target: Target, ending: Ending, timeout_s: float) -> list[UpStatus]:
    """Return the runs to end.

    It waits for all runs on this computer and all machines of ``target``: at most ``timeout_s``, and `LISTEN_S` for
    unknown machines.
    """
    from socialbot.bridge.run_announcer import locked_runs

    begun = time.monotonic()
    while True:
        found = [one for one in tuple(runs.statuses.values()) if one.state != "ended" and target.wanted(one)]
        others = set(target.machines) - {one.machine for one in found} - {target.own}
        here = not target.here or locked_runs().keys() <= runs.statuses.keys()
        passed = time.monotonic() - begun
        known = not here or (others and runs.incomplete)
        if (here and not others) or ending.asked or passed > (max(timeout_s, LISTEN_S) if known else LISTEN_S):
            return found
        time.sleep(POLL_S)


def end(runs: RunStatuses, found: Sequence[UpStatus], ending: Ending, timeout_s: float) -> list[UpStatus]:
    """Ask the runs ``found`` to end and print each end. Return the runs left after ``timeout_s``."""
    from socialbot.bridge.run_announcer import is_gone, locked_runs

    here = locked_runs().keys()
    begun = time.monotonic()
    asked_at = -ASK_EVERY_S
    left = [one.run for one in found]
    while left and not ending.asked and time.monotonic() < begun + timeout_s:
        if time.monotonic() >= asked_at + ASK_EVERY_S:
            asked_at = time.monotonic()
            for run in left:
                if runs.statuses[run].state == "up":
                    runs.ask_to_end(run)
        vanished = here - locked_runs().keys()
        for run in [run for run in left if is_gone(runs.statuses[run], vanished=run in vanished)]:
            left.remove(run)
            last = runs.statuses[run]
            error = f", with an error: {printable(last.reason)}" if last.reason else ""
            print_line(f"{_named(last)}: ended after {time.monotonic() - begun:.1f} s{error}")
        time.sleep(POLL_S)
    return [runs.statuses[run] for run in left]


def _enter(file: str | None, machine: str | None) -> Target:
    """Join the ROS domain of ``file`` and return the runs to end."""
    from socialbot.runtime.deployment import is_deployment, load_deployment

    if file is not None and is_deployment(file):
        from socialbot.runtime.machine import enter

        deployment = load_deployment(Path(file))
        if machine is not None:
            deployment.address(machine)
        try:
            own = deployment.this_machine()
        except GraphError:
            # The addresses do not identify this machine.
            if machine is None:
                raise
            own = machine
        enter(deployment, own)
        machines = tuple(name for name in deployment.machines if machine in (None, name) and deployment.half(name))
        graph = deployment.graph.name
        return Target(lambda one: one.graph == graph and one.machine in machines, machines, own)
    expect_no_machine(machine)
    from socialbot.bridge.run_announcer import is_here
    from socialbot.graph.files import load_graph

    name = None if file is None else load_graph(file).name
    return Target(lambda one: is_here(one) and name in (None, one.graph))


def _named(one: UpStatus) -> str:
    return printable(f"{one.graph} on {one.machine}")
