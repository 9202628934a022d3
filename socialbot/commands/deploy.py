"""``socialbot up FILE --machine M`` for deployments, and ``socialbot systemd``; see docs/deploy.md."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from socialbot.commands.inspect import PORT, watched
from socialbot.errors import ParameterError


def up_machine(
    file: str,
    machine: str | None,
    changes: list[str],
    out: Path,
    minds: Path | None = None,
    page: typer.Context | None = None,
    port: int = PORT,
    *,
    room: int,
) -> None:
    """Brings up the nodes of ``machine``, by default the one this runs on, until Ctrl-C.

    ``changes`` are those of ``--set``; ``out`` takes the record of the run, whose journals have ``room`` (bytes) each.
    Agents go on with what they had in ``minds``, by default in the folder that the deployment names. For a command of
    which ``page`` is the context, the inspector shows what this machine hears.
    """
    from socialbot.cli import with_changes
    from socialbot.deployment.deployment_file import load_deployment
    from socialbot.deployment.entering import enter
    from socialbot.deployment.running import run_machine
    from socialbot.run_record import RunTrace

    deployment = load_deployment(Path(file))
    machine = machine or deployment.this_machine()
    nodes = ", ".join(placement.name for placement in deployment.half(machine))
    graph = with_changes(deployment.graph, changes)
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"{graph.name} on {machine}: {nodes or 'no node'}", markup=False)
    console.print(f"Ctrl-C ends it; its record: {out}", markup=False)
    with RunTrace(out, room=room) as record:
        if page is not None:
            enter(deployment, machine)
            page.with_resource(watched(record, graph, console, port, over_ros=True, stays=False))
        run_machine(deployment, machine, record, Console(highlight=False), graph, minds)


def systemd(
    file: Annotated[Path, typer.Argument(help="The deployment file.")],
    machine: Annotated[str, typer.Option(help="The machine that the unit is for.")],
    out: Annotated[Path | None, typer.Option(help="The folder to write the unit into; default: print it.")] = None,
) -> None:
    """Make the systemd unit by which a machine of a deployment starts its nodes when it starts itself."""
    from socialbot.deployment.deployment_file import load_deployment
    from socialbot.deployment.systemd import unit, unit_name

    load_deployment(file).address(machine)
    text = unit(file, machine)
    if out is None:
        typer.echo(text, nl=False)
        return
    path = out / unit_name(machine)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ParameterError(
            f"cannot be written: {error.strerror}", where=str(path), remedy="name another --out"
        ) from error
    typer.echo(f"{path}\nsudo cp {path} /etc/systemd/system/ && sudo systemctl enable --now {path.name}")
