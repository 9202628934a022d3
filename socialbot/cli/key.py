"""The commands ``socialbot key``: keys of the machines of a deployment; see docs/security.md."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from socialbot.cli._console import Console
from socialbot.cli._options import plain_table

PANEL = "Join a running graph"
EXAMPLES = (
    "socialbot key new robot",
    "socialbot key list",
)
key = typer.Typer(
    add_completion=False, help="Manage the keys that sign messages between machines.", no_args_is_help=True
)

FolderOption = Annotated[Path | None, typer.Option(help="Folder of keys; default: SOCIALBOT_KEYS, else ./keys.")]


@key.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the key, such as the name of the machine.")],
    folder: FolderOption = None,
) -> None:
    """Make a key pair. Keep the .key file here; copy the .pub file to every machine that should trust it."""
    from socialbot.bridge.keys import fingerprint, load_keys, new_key

    chosen = _folder(folder)
    secret, public = new_key(name, chosen)
    console = Console(soft_wrap=True)
    console.print(f"private: {secret}  keep it on this machine", markup=False)
    console.print(f"public:  {public}  copy it to all machines", markup=False)
    console.print(f"fingerprint: {fingerprint(load_keys(chosen, name).trusted[name])}", markup=False)


@key.command(name="list")
def list_keys(folder: FolderOption = None) -> None:
    """List trusted keys by name and fingerprint."""
    from socialbot.bridge.keys import fingerprint, load_public_keys, load_successors, private_names

    chosen = _folder(folder)
    private = private_names(chosen)
    table = plain_table("name", "fingerprint", "")
    for name, public in load_public_keys(chosen).items():
        table.add_row(name, fingerprint(public), "its private key is here" if name in private else "")
    for name, public in load_successors(chosen).items():
        table.add_row(name, fingerprint(public), "the next key")
    Console().print(table if table.row_count else f"no keys in {chosen}")


@key.command()
def rotate(
    name: Annotated[str, typer.Argument(help="Name of the key.")],
    folder: FolderOption = None,
    finish: Annotated[
        bool, typer.Option("--finish", help="Replace the key, after all machines have the next.")
    ] = False,
) -> None:
    """Replace a key while graphs run: make the next one, and replace the present one with --finish."""
    from socialbot.bridge.keys import begin_rotation, finish_rotation
    from socialbot.bridge.transport import window_s

    chosen = _folder(folder)
    console = Console(soft_wrap=True)
    if finish:
        public = finish_rotation(name, chosen, window_s=window_s(os.environ))
        console.print(f"{name} signs with its next key", markup=False)
        console.print(f"copy {public} to all machines, and delete {name}.next.pub there", markup=False)
        return
    _, public = begin_rotation(name, chosen)
    console.print(f"copy {public} to all machines; then: socialbot key rotate {name} --finish", markup=False)


@key.command()
def check(
    name: Annotated[str, typer.Argument(help="Private key, if there are several.")] = "",
    folder: FolderOption = None,
) -> None:
    """Check that the keys are usable. Exit code 4: they are not."""
    from socialbot.bridge.keys import load_keys

    chosen = _folder(folder)
    keys = load_keys(chosen, name)
    others = ", ".join(sorted(set(keys.trusted) - {keys.name})) or "no other key"
    Console(soft_wrap=True).print(f"{chosen}: signs as {keys.name}, trusts {others}", markup=False)


def _folder(given: Path | None) -> Path:
    from socialbot.bridge.environment import KEYS_VARIABLE
    from socialbot.bridge.transport import split_keys

    return given or Path(split_keys(os.environ.get(KEYS_VARIABLE, ""))[0] or "keys")
