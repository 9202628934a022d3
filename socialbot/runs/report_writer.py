"""Collect what a report needs while a run goes on, and write report.html."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from socialbot.bags.images import pictures_of
from socialbot.core.errors import BagError, SocialbotError
from socialbot.core.messages import Message, TraceRecord
from socialbot.core.registry import phrases_of
from socialbot.graph.node import Graph
from socialbot.runs.folder import RecordedRun, newest_run, open_run
from socialbot.runs.report import page_of
from socialbot.runs.report_worlds import World, world_of
from socialbot.runs.story import story_of
from socialbot.runs.summary import Summary

PAGE = "report.html"


class RunReport:
    """Takes the messages of a run of ``graph``, with all its nodes; `write` writes its page."""

    def __init__(self, graph: Graph) -> None:
        self.records: list[TraceRecord] = []
        self._graph = graph
        self.deliberates = any(placement.type.deliberates for placement in graph.placements)
        """Whether there are agents to tell of."""
        self.phrases = phrases_of(graph)
        self._world: World | None = world_of(graph)

    def observe(self, topic: str, message: Message) -> None:
        """Takes one message."""
        if isinstance(message, TraceRecord):
            self.records.append(message)
        elif self._world is not None:
            self._world.take(message)

    def summary(self) -> Summary:
        """The run as far as it has come."""
        story = story_of(self.records, self.phrases)
        return Summary(story, self._world.results(story) if self._world else {})

    def write(self, folder: Path, title: str) -> Path:
        """Writes the page of the run that is recorded in ``folder``: `write_report`."""
        return write_report(folder, title, self._world)


def write_report(folder: Path, title: str = "", world: World | None = None) -> Path:
    """Writes report.html, and a picture of the world at the end, to the ``folder`` of a run.

    ``world`` is what was seen of the world, by default what the record tells of it. Raises RunError when there is no
    run, and SocialbotError when nothing can be written.
    """
    with recorded(folder) as run:
        world = run.stage if world is None else world
        page = page_of(run, title or run.title, world)
        path = page.write(folder / PAGE)
        if world:
            picture = world.picture(run.end, f"{page.title}, at the end")
            try:
                (folder / world.file).write_text(picture, encoding="utf-8")
            except OSError as error:
                raise SocialbotError(f"cannot be written: {error.strerror}", where=str(folder / world.file)) from error
    return path


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
