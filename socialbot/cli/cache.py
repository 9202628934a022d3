"""The commands ``socialbot cache``: list and clear cached detections of bags."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

import typer
from rich.markup import escape

from socialbot.cli._console import Console
from socialbot.cli._options import plain_table

if TYPE_CHECKING:
    from socialbot.runtime.perception_cache import CacheFolder

PANEL = "Bags, cameras and scores"
EXAMPLES = ("socialbot cache show", "socialbot cache clear")
cache = typer.Typer(
    add_completion=False,
    help="List and clear the detections that replays have cached for bags.",
    no_args_is_help=True,
)
_MEGABYTE = 1_000_000


@cache.command()
def show() -> None:
    """List the bags in the cache, the last used first. SOCIALBOT_CACHE names its folder."""
    from socialbot.runtime.perception_cache import describe

    folder = _folder()
    table = plain_table("bag", "nodes", right=("kB", "last used"))
    for file in folder.files():
        entry = describe(folder, file)
        nodes = "damaged; written again when it is needed" if entry is None else ", ".join(entry.nodes)
        detector = f" ({entry.detector})" if entry is not None and entry.detector else ""
        used = f"{datetime.fromtimestamp(file.used).astimezone():%Y-%m-%d %H:%M}"
        bag = file.key[:12] if entry is None else entry.bag
        table.add_row(escape(bag), escape(nodes + detector), f"{file.size / 1e3:.0f}", used)
    console = Console()
    if table.row_count:
        console.print(table)
    _print_size(console, folder)


@cache.command()
def size() -> None:
    """Print the folder, its size and its limit. SOCIALBOT_CACHE_MB changes the limit."""
    _print_size(Console(), _folder())


@cache.command()
def clear() -> None:
    """Remove all entries. The next replay of each bag looks at its images again."""
    folder = _folder()
    count, removed = folder.clear()
    text = f"removed {'1 entry' if count == 1 else f'{count} entries'}, {removed / _MEGABYTE:.1f} MB"
    Console().print_plain(f"{folder.path}: {text}")


def _print_size(console: Console, folder: CacheFolder) -> None:
    files = folder.files()
    used, limit = sum(each.size for each in files) / _MEGABYTE, folder.max_bytes / _MEGABYTE
    count = "1 entry" if len(files) == 1 else f"{len(files)} entries"
    console.print_plain(f"{folder.path}: {count}, {used:.1f} of {limit:.0f} MB")


def _folder() -> CacheFolder:
    from socialbot.runtime.perception_cache import default_folder

    return default_folder()
