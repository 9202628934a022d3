"""A recorded run, with the pictures of its bag."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from socialbot.bridge.bag_pictures import pictures_of
from socialbot.errors import BagError
from socialbot.inspect.run_folder import RecordedRun, newest_run, open_run


@contextmanager
def recorded(folder: Path | None) -> Iterator[RecordedRun]:
    """The run in a folder, by default the newest, with its pictures. Raises RunError."""
    folder = newest_run() if folder is None else folder
    run = open_run(folder)
    with ExitStack() as stack:
        bag = run.results.get("bag", {})
        if "path" in bag:
            try:
                pictures = stack.enter_context(pictures_of(Path(bag["path"]), list(bag.get("topics", ()))))
            except BagError as error:
                run.damage.append(f"there are no pictures: {error.where}: {error.what}")
            else:
                run = open_run(folder, pictures) if pictures is not None else run
        yield run
