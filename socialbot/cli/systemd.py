"""``socialbot systemd``: write the systemd unit of one machine of a deployment."""

from __future__ import annotations

import getpass
import re
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Annotated

import typer

from socialbot.cli._console import print_line
from socialbot.core.errors import ParameterError
from socialbot.core.paths import replace_file, writing
from socialbot.core.process_settings import ProcessSettings

PANEL = "Run a graph"
EXAMPLES = ("socialbot systemd deploy.yaml --machine robot",)
UNIT = """\
[Unit]
Description={description}
Wants=network-online.target time-sync.target
After=network-online.target time-sync.target

[Service]
Type=exec
User={user}
WorkingDirectory={folder}
ExecStart={command}
# socialbot restarts crashed nodes itself; systemd restarts socialbot.
Restart=on-failure
RestartSec=5
# A wrong command line or configuration stays wrong.
RestartPreventExitStatus=2 4
KillSignal=SIGINT
KillMode=mixed
# A blocked `up` is killed after 30 s.
TimeoutStopSec=45
NoNewPrivileges=yes
{limits}
[Install]
WantedBy=multi-user.target
"""


def systemd(
    file: Annotated[Path, typer.Argument(help="The deployment file.")],
    machine: Annotated[str, typer.Option(help="Machine of a deployment.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the unit; default: print it.")] = None,
) -> None:
    """Write the systemd unit that starts the nodes of a machine at boot."""
    from socialbot.runtime.deployment import load_deployment

    deployment = load_deployment(file)
    deployment.address(machine)
    settings = [deployment.processes[one.name] for one in deployment.half(machine) if one.name in deployment.processes]
    text = unit(file, machine, settings=settings)
    if out is None:
        print_line(text, nl=False)
        return
    path = out / f"socialbot-{machine}.service"
    with writing(path, ParameterError, remedy="name another --out"):
        replace_file(path, text.encode())
    print_line(f"{path}\nsudo cp {path} /etc/systemd/system/ && sudo systemctl enable --now {path.name}")


def unit(file: Path, machine: str, *, user: str | None = None, settings: Collection[ProcessSettings] = ()) -> str:
    """Return the unit for the nodes of ``machine`` in the deployment ``file`` as ``user``, by default this one.

    It permits the priorities and niceness of the ``settings`` of its processes.
    Runs are recorded beside the file. Raises ParameterError for paths that systemd cannot express.
    """
    file = file.resolve()
    if not str(file).isprintable():
        raise ParameterError("a unit cannot hold this path", where=repr(str(file)), remedy="use letters and digits")
    command = [sys.executable, "-m", "socialbot", "up", str(file), "--machine", machine]
    priority = max((each.priority or 0 for each in settings), default=0)
    nice = min((each.nice or 0 for each in settings), default=0)
    return UNIT.format(
        limits=(f"LimitRTPRIO={priority}\n" if priority else "") + (f"LimitNICE={nice:+d}\n" if nice < 0 else ""),
        description=f"socialbot: {machine} of {file.name}".replace("%", "%%"),
        user=user or getpass.getuser(),
        folder=str(file.parent).replace("%", "%%"),
        command=" ".join(map(quoted, command)),
    )


def quoted(argument: str) -> str:
    """Quote ``argument`` for a command of a systemd unit."""
    escaped = argument.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return escaped if re.fullmatch(r"[A-Za-z0-9_./-]+", escaped) else f'"{escaped}"'
