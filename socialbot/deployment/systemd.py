"""Units of systemd, by which a machine of a deployment starts its nodes when it starts itself."""

from __future__ import annotations

import getpass
import re
import sys
from pathlib import Path

from socialbot.errors import ParameterError

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
# What dies is started again by socialbot itself; this is for socialbot.
Restart=on-failure
RestartSec=5
# A command line or configuration that is wrong stays wrong.
RestartPreventExitStatus=2 4
KillSignal=SIGINT
KillMode=mixed
TimeoutStopSec=20
NoNewPrivileges=yes

[Install]
WantedBy=multi-user.target
"""


def unit_name(machine: str) -> str:
    """What the unit of ``machine`` is called."""
    return f"socialbot-{machine}.service"


def unit(file: Path, machine: str, *, user: str | None = None) -> str:
    """The unit that runs the nodes of ``machine`` as the deployment ``file`` says, as ``user``, by default this one.

    Runs are recorded beside the file. Raises ParameterError when the file has a name that no unit can hold.
    """
    file = file.resolve()
    if not str(file).isprintable():
        raise ParameterError("a name that no unit can hold", where=repr(str(file)), remedy="use letters and digits")
    command = [sys.executable, "-m", "socialbot", "up", str(file), "--machine", machine]
    return UNIT.format(
        description=f"socialbot: {machine} of {file.name}".replace("%", "%%"),
        user=user or getpass.getuser(),
        folder=str(file.parent).replace("%", "%%"),
        command=" ".join(map(quoted, command)),
    )


def quoted(argument: str) -> str:
    """``argument`` as systemd takes it in a command, whatever it holds."""
    escaped = argument.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return escaped if re.fullmatch(r"[A-Za-z0-9_./-]+", escaped) else f'"{escaped}"'
