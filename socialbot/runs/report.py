"""Report of a run: the run page as one file, with summary tables."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgspec

from socialbot.core.errors import BagError
from socialbot.core.messages import Message, TraceRecord
from socialbot.core.paths import expect_inside
from socialbot.core.registry import WorldView, phrases_of, world_view_of
from socialbot.graph.node import Graph
from socialbot.runs._frames import Perception, shot_at, stills, turning_points
from socialbot.runs._report_tables import (
    band_section,
    event_section,
    node_section,
    settings_section,
    story_sections,
    visit_section,
)
from socialbot.runs._streams import detections_of
from socialbot.runs.bag_images import BlurredPictures, boxes_of, pictures_of
from socialbot.runs.difference import Difference, Side
from socialbot.runs.distances import distances_of
from socialbot.runs.folder import RecordedRun, newest_run, open_run
from socialbot.runs.heard_sounds import heard_sound
from socialbot.runs.history import OF_TOPICS
from socialbot.runs.narration import log_lines
from socialbot.runs.pages import (
    Page,
    Section,
    bundle,
    charts,
    part,
    render_document,
    table,
    thumbnail,
    timeline,
    write_file,
)
from socialbot.runs.plan_trees import PlanTrees
from socialbot.runs.record import ENDED_WELL, STOPPED
from socialbot.runs.run import NoCommands, RunView, node_views, overview
from socialbot.runs.story import Story, story_of
from socialbot.runs.why import actions, considered, explain

PAGE = "report.html"
MAX_QUOTES = 3

FRAMES_NOTE = "Camera frames at the turning points; boxes show detected persons with their distance."
WORST_NOTE = "Frames with the most errors. Green: found; yellow, dashed: missed; red: false detection."
PERCEPTION_NOTE = "Compared with the ground truth. Red, dashed lines mark the frames with the most errors."


class RunReport:
    """Messages of a run of ``graph`` for its summary and its page."""

    def __init__(self, graph: Graph) -> None:
        self.records: list[TraceRecord] = []
        self.deliberates = any(config.type.deliberates for config in graph.nodes)
        self.phrases = phrases_of(graph)
        self._world: WorldView | None = world_view_of(graph)

    def observe(self, topic: str, message: Message) -> None:
        if isinstance(message, TraceRecord):
            self.records.append(message)
        elif self._world is not None:
            self._world.take(message)

    def story(self) -> Story:
        """Return the story of the run so far."""
        story = story_of(self.records, self.phrases)
        story.world = self._world.results(story.start, story.end) if self._world else {}
        return story

    def write(self, folder: Path, title: str) -> Path:
        """Write the page of the run that is recorded in ``folder``: see `write_report`."""
        return write_report(folder, title, self._world)


def write_report(folder: Path, title: str = "", world: WorldView | None = None) -> Path:
    """Write report.html, and an image of the world at the end, into the folder of a run.

    Args:
        folder: Folder of the run.
        title: Title of the page; that of the run by default.
        world: World view of the run; read from the record by default.

    Raises:
        RunError: The folder holds no run, or a file is a link that leads out of it.
        ParameterError: A file cannot be written.
    """
    with recorded(folder) as run:
        world = run.world_view if world is None else world
        path = write_file(expect_inside(folder, folder / PAGE), report_html(run, title, world))
        if world:
            picture = world.picture(run.end, f"{title or run.title}, at the end")
            write_file(expect_inside(folder, folder / world.file), picture)
    return path


@contextmanager
def recorded(folder: Path | None) -> Iterator[RecordedRun]:
    """Open the run in ``folder``, by default the newest, with the images of its bag.

    Raises:
        RunError: There is no run.
    """
    run = open_run(newest_run() if folder is None else folder)
    with ExitStack() as stack:
        bag, privacy = run.results.get("bag", {}), run.results.get("privacy", "none")
        if "path" in bag and privacy != "no-images":
            try:
                run.images = stack.enter_context(pictures_of(Path(bag["path"]), list(bag.get("topics", ()))))
                if run.images is not None and privacy != "none":
                    run.images = BlurredPictures(run.images, boxes_of(_boxes(run)))
            except BagError as error:
                run.damage.append(f"there are no pictures: {error.where}: {error.what}")
        yield run


def _boxes(run: RecordedRun) -> Iterator[tuple[int, list[tuple[float, float, float, float]]]]:
    for found in detections_of(run):
        yield found.stamp, [(one.x, one.y, one.w, one.h) for one in found.persons]


def report_html(run: RecordedRun, title: str = "", world: WorldView | None = None) -> str:
    """Return the page of a run as one self-contained file."""
    of_agents = (record for record in run.history if record.kind not in OF_TOPICS)
    story = story_of(of_agents, run.wording.phrases)
    perception = Perception(run)
    shots = turning_points(run)
    needed = [*(shot.detection.stamp for shot in shots), *(frame.stamp for frame in perception.worst)]
    sections = [
        *story_sections(story),
        visit_section(run),
        Section("Detection over time", charts(perception.charts()), PERCEPTION_NOTE),
        Section("Worst frames", perception.worst_stills(), WORST_NOTE),
        band_section(run.results),
        Section("Turning points", stills(run, shots), FRAMES_NOTE),
        event_section(run),
        node_section(run),
        settings_section(run),
    ]
    verdict, good = verdict_of(run)
    if story.desires:
        verdict, good = ("goal reached", True) if story.reached else ("goal not reached", False)
    tiles = [*(_story_tiles(story) if story.desires else _figures(run))]
    if world:
        tiles += world.figures(*((story.start, story.end) if story.desires else (run.history.start, run.end)))
    report = Page(
        title=title or run.title,
        lead=story.lead() if story.desires else _lead(run),
        verdict=verdict,
        good=good,
        warnings=run.problems,
        tiles=tiles,
        sections=[section for section in sections if section.content],
    )
    return render_document(
        "run.html",
        report=report,
        data=frozen(run, world, needed),
        bundle=bundle("main.js", charts=True, instead=(("api.js", "frozen.js"),)),
        modules=(),
    )


def verdict_of(run: RecordedRun) -> tuple[str, bool]:
    """Return the result of a run in a word or two, and whether it succeeded."""
    ended = run.results.get("ended", "")
    if not run.results:
        return "broken off", False
    if ended in ENDED_WELL:
        return "ended well", True
    return "stopped" if ended == STOPPED else "failed", False


def difference_page(first: RunView, second: RunView, found: Difference) -> Page:
    """Return the page that compares two runs."""
    runs = (first, second)
    sides = ""
    if found.sides is not None:
        sides = part("sides", [_side(run, side) for run, side in zip(runs, found.sides, strict=True)])
    first_differences = [
        [each.what, *_event(each.first_s, each.first), *_event(each.second_s, each.second)] for each in found.causes
    ]
    changed = [[each.name, _setting(each.first), _setting(each.second)] for each in found.settings]
    return Page(
        title=f"{found.runs[0]} and {found.runs[1]}",
        lead=_difference_lead(found),
        verdict="the same" if found.same else "different",
        good=found.same,
        tiles=[(f"{one} | {other}", f"{kind.replace('_', ' ')}s") for kind, (one, other) in found.counts.items()],
        sections=[
            Section("First different decision", sides, "The chain of causes in each run."),
            Section("Timelines", _timelines(runs, found), "The line marks the first different decision."),
            Section(
                "First differences",
                table(("", "at", found.runs[0], "at", found.runs[1]), first_differences),
                "Where detections and beliefs differ first.",
            ),
            Section("Different settings", table(("", *found.runs), changed)),
        ],
    )


def _difference_lead(found: Difference) -> str:
    if found.same:
        return f"Both runs decide the same, at the same times: {found.decisions[0]} decisions."
    how = "is the same, but at another time" if found.only_time else "is different"
    return f"Decision {found.number} of {found.agent} is the first that {how}."


def _side(run: RunView, side: Side) -> dict[str, Any]:
    frame_s = None if side.why is None else side.why.frame_s
    shots = [] if frame_s is None else shot_at(run, run.history.stamp(frame_s), "the frame at the end of the chain")
    return {"title": side.run, "why": side.why, "frame": stills(run, shots)}


def _timelines(runs: tuple[RunView, RunView], found: Difference) -> str:
    until_s = max(run.history.duration_s for run in runs)
    drawn = []
    for name, run, side in zip(found.runs, runs, found.sides or (None, None), strict=True):
        drawn.append((name, timeline(run.timeline.lanes(), until_s, None if side is None else side.at_s)))
    return part("titled", drawn)


def _event(at_s: float | None, what: str) -> list[tuple[str, str]]:
    return [("", "r"), ("nothing", "")] if at_s is None else [(f"{at_s:.2f} s", "r"), (what, "")]


def _setting(value: Any) -> tuple[str, str]:
    return ("-", "") if value is None else (str(value), "code")


def _lead(run: RecordedRun) -> str:
    history = run.history
    if not len(history):
        return "Nothing happened."
    frames = sum(record.kind == "detection" for record in history)
    said = [record.what for record in history if record.kind == "utterance"]
    text = f"In {history.duration_s:.1f} s "
    if frames:
        people, most = _people(run)
        seen = "nobody was seen" if not most else f"{people} {'person' if people == 1 else 'people'} came into view"
        text += f"and {frames} frames, {seen}{f', at most {most} at once' if most > 1 else ''}."
    else:
        count = len(actions(history))
        text += f"{count} {'action was' if count == 1 else 'actions were'} carried out."
    if said:
        quoted = ", ".join(f"“{each}”" for each in dict.fromkeys(said[:MAX_QUOTES]))
        more = f" and {len(said) - MAX_QUOTES} more" if len(said) > MAX_QUOTES else ""
        agents = history.agents
        speaker = run.wording.name(agents[0]) if len(agents) == 1 else "The agents"
        text += f" {speaker} said {quoted}{more}."
    elif frames:
        text += " Nothing was said."
    return text


def _people(run: RecordedRun) -> tuple[int, int]:
    lanes = {lane.name: lane.bars for lane in run.timeline.lanes()}
    counts = (len(record.detail.get("persons", ())) for record in run.history if record.kind == "detection")
    return len({bar.text for bar in lanes.get("people", ())}), max(counts, default=0)


def _figures(run: RecordedRun) -> list[tuple[str, str]]:
    frames, said = (sum(record.kind == kind for record in run.history) for kind in ("detection", "utterance"))
    figures = [(f"{run.history.duration_s:.1f} s", "duration")]
    if frames:
        figures += [(str(frames), "frames"), (str(_people(run)[0]), "people in view")]
    figures.append((str(len(actions(run.history))), "actions"))
    if said:
        figures.append((str(said), "utterances"))
    bands = (run.results.get("scores") or {}).get("bands", {}).values()
    found, wrong = sum(band["tp"] for band in bands), sum(band["fp"] + band["fn"] for band in bands)
    if found + wrong:
        figures.append((f"{2 * found / (2 * found + wrong):.3f}", "F1 of person detection, all distances"))
    return figures


def _story_tiles(story: Story) -> list[tuple[str, str]]:
    tiles = []
    if story.first is not None:
        planned_s, took_s = story.makespans_s(story.first)
        tiles.append(("-" if took_s is None else f"{took_s:.1f} s", f"for {story.first.name}"))
        if planned_s is not None:
            tiles.append((f"{planned_s:.1f} s", "in its first plan"))
    given_up = sum(plan.given_up for plan in story.plans)
    tiles.append((str(len(story.plans)), f"plans of {len(story.agents)} agents, {given_up} given up"))
    tiles.append((str(sum(step.began is not None for step in story.steps)), "steps begun"))
    if story.words:
        tiles.append((str(len(story.words)), "messages between agents"))
    else:
        about_desires = sum(request.about_desire for request in story.requests)
        tiles.append((str(len(story.requests)), f"requests, {about_desires} for a desire"))
    return tiles


MAX_RECORDS = 20_000
"""Older records of a long run are left out of the page."""

MAX_EXPLANATIONS = 1500
MAX_REJECTIONS = 20
MAX_PICTURES = 40
MAX_PICTURE_BYTES = 1_500_000
MAX_SOUND_BYTES = 1_000_000
NODE_SAMPLES = 200

_MIND = ("beliefs", "desires", "goals", "plans", "actions", "ended", "paused")
_SHARED = ("sight", "speech", "head")

Track = list[tuple[float, Any]]


def frozen(run: RecordedRun, world: WorldView | None, stamps: Iterable[int]) -> str:
    """Return the server answers for a page as JSON, gzip and base64.

    Args:
        run: The run to show.
        world: World view of the run, if it has one.
        stamps: Times (ns) of mandatory images.
    """
    history = run.history
    records = history.part(max(0, len(history) - MAX_RECORDS), len(history))
    begin = records[0].stamp if len(records) < len(history) else history.start
    pictures = _pictures(run, stamps, records)
    shown = overview(run, NoCommands("this page is the record of a run"))
    has = msgspec.structs.replace(shown.has, pictures=bool(pictures), world=world is not None and bool(world))
    content = {
        "run": msgspec.structs.replace(shown, has=has, problems=(), results={}, since_s=history.seconds(begin)),
        "timeline": {"lanes": run.timeline.lanes(), "distances": distances_of(run)},
        "sounds": _sounds(run, records),
        "log": log_lines(run, records),
        "tracks": _tracks(run, records),
        "trees": _trees(run, begin),
        "nodes": _nodes(run, begin),
        "why": _explanations(run, records),
        "plans": [
            msgspec.structs.replace(each, rejected=each.rejected[-MAX_REJECTIONS:]) for each in considered(history)
        ],
        "pictures": pictures,
        "film": world.film(history.start) if world else None,
    }
    return base64.b64encode(gzip.compress(msgspec.json.encode(content), 6, mtime=0)).decode()


def _pictures(run: RecordedRun, stamps: Iterable[int], records: Sequence[TraceRecord]) -> list[tuple[float, str]]:
    """Return images at the given times, then evenly spaced ones up to the limits, by time."""
    if not run.has_images:
        return []
    seen = [record.stamp for record in records if record.kind == "detection"]
    step = max(1, len(seen) // MAX_PICTURES)
    found: dict[int, str] = {}
    size = 0
    for stamp in dict.fromkeys([*stamps, *seen[::step], *seen[-1:]]):
        picture = run.picture(stamp)
        if picture is None or picture.stamp in found:
            continue
        if size > MAX_PICTURE_BYTES or len(found) >= 2 * MAX_PICTURES:
            break
        small = thumbnail(picture.jpeg)
        if small is not None:
            found[picture.stamp] = small.picture
            size += len(small.picture)
    return [(run.history.seconds(stamp), found[stamp]) for stamp in sorted(found)]


def _sounds(run: RecordedRun, records: Sequence[TraceRecord]) -> dict[str, str]:
    """Return the sounds of utterances by file name, up to the limit: a data URL, or the name of an equal file."""
    found: dict[str, str] = {}
    known: dict[bytes, str] = {}
    size = 0
    for record in records:
        name = str(record.detail.get("detail", "")) if record.kind == "speech" and record.what == "started" else ""
        name = heard_sound(record.id) if record.kind == "hearing" else name
        sound = run.sound(name) if name else None
        if sound is None or name in found:
            continue
        if sound in known:
            found[name] = known[sound]
        elif size + len(sound) <= MAX_SOUND_BYTES:
            size += len(sound)
            known[sound] = name
            found[name] = f"data:audio/wav;base64,{base64.b64encode(sound).decode()}"
    return found


def _tracks(run: RecordedRun, records: Sequence[TraceRecord]) -> dict[str, Any]:
    """Return the changes of the shared state and of each agent's mind."""
    agents: dict[str, dict[str, Track]] = {}
    shared: dict[str, Track] = {name: [] for name in _SHARED}
    last: dict[str, Any] = {}
    for number, record in enumerate(records):
        if number + 1 < len(records) and records[number + 1].stamp == record.stamp:
            continue
        moment = run.states.at(record.stamp)
        for name in _SHARED:
            _note(shared[name], moment.at_s, getattr(moment, name))
        for agent in moment.agents:
            if last.get(agent.name) is not agent:
                last[agent.name] = agent
                parts = agents.setdefault(agent.name, {part: [] for part in _MIND})
                for part in _MIND:
                    _note(parts[part], moment.at_s, getattr(agent, part))
    return {"agents": agents, **shared}


def _note(track: Track, at_s: float, value: Any) -> None:
    if not track or track[-1][1] != value:
        track.append((at_s, value))


def _trees(run: RecordedRun, begin: int) -> list[Track]:
    history, trees = run.history, PlanTrees(run.history, run.wording)
    tracks: dict[tuple[str, str], Track] = {}
    for record in history:
        if trees.take(record) and record.stamp >= begin:
            at_s = history.seconds(record.stamp)
            for desire, tree in trees.trees().items():
                _note(tracks.setdefault(desire, []), at_s, tree)
    return list(tracks.values())


def _nodes(run: RecordedRun, begin: int) -> dict[str, Track]:
    tracks: dict[str, Track] = {}
    history = run.history
    for number in range(NODE_SAMPLES + 1):
        stamp = begin + (run.end - begin) * number // NODE_SAMPLES
        for status in node_views(run, stamp):
            _note(tracks.setdefault(status["name"], []), history.seconds(stamp), status)
    return tracks


def _explanations(run: RecordedRun, records: Sequence[TraceRecord]) -> dict[str, Any]:
    """Explain actions first, then other records, evenly chosen up to the limit."""
    acted = {id(record) for record in actions(run.history)}
    others = [record for record in records if id(record) not in acted and record.kind != "detection"]
    found: dict[str, Any] = {}
    for meant in ([record for record in records if id(record) in acted], others):
        free = MAX_EXPLANATIONS - len(found)
        first = len(meant) if len(meant) <= free else free // 2
        for record in (*meant[:first], *meant[max(first, len(meant) - free + first) :]):
            found[record.id] = explain(run.history, run.wording, record)
    return found
