"""The page of a run, whoever ran in it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from socialbot.runs import report_deliberated as deliberated
from socialbot.runs import report_recorded as recorded
from socialbot.runs.folder import RecordedRun
from socialbot.runs.history import OF_TOPICS
from socialbot.runs.record import NOTHING_SHOWN, NOTHING_WANTED, STOPPED, TIME_UP, WELL
from socialbot.runs.report_deliberated import lead_of
from socialbot.runs.report_page import Page, Section
from socialbot.runs.report_sight import Sight
from socialbot.runs.report_worlds import World
from socialbot.runs.story import Story, story_of
from socialbot.runs.summary import Summary
from socialbot.runs.why import actions

ENDED_WELL = ("", WELL, NOTHING_WANTED, NOTHING_SHOWN, TIME_UP)
SHOTS = 8
"""So many pictures there are of a run, at most."""
APART_S = 4.0
"""Moments that lie nearer to each other than this, or an even share of a short run, share a picture."""
QUOTED = 3
"""So many sentences are quoted of what was said."""


def page_of(run: RecordedRun, title: str, world: World | None = None) -> Page:
    """The page of a run."""
    of_agents = (record for record in run.history if record.kind not in OF_TOPICS)
    story = story_of(of_agents, run.wording.phrases)
    sight = Sight(run)
    general = [sight.section(), recorded.frames(run), recorded.deeds(run), recorded.events(run)]
    last = [recorded.seen_well(run.results), recorded.nodes(run), recorded.setting(run)]
    if not story.desires:
        lanes = _lanes("What went on when", sight, recorded.REACTIVE)
        verdict, good = verdict_of(run)
        return Page(
            title=title,
            lead=_lead(run),
            verdict=verdict,
            good=good,
            warnings=warnings_of(run),
            tiles=_figures(run),
            sections=[lanes, *general, *last],
        )
    summary = Summary(story, world.results(story) if world else {})
    scene = world.scene(story, _shots(world, story)) if world else None
    lanes = _lanes("Who was there, and what was said", sight, recorded.PRESENT)
    return Page(
        title=title,
        lead=lead_of(story),
        verdict="goal reached" if summary.reached else "goal not reached",
        good=summary.reached,
        warnings=warnings_of(run),
        tiles=[*_tiles(summary), *(world.tiles(story) if world else [])],
        sections=[*deliberated.sections(story, scene), lanes, *general, *last],
        scripts=deliberated.scripts(story, scene),
    )


def _lanes(title: str, sight: Sight, names: Collection[str]) -> Section:
    plots = sight.plots()
    chart = recorded.lanes_of(sight.run, names, marks=sight.marks(), plots=plots)
    return Section(title, chart, f"{recorded.LANES_NOTE} {recorded.CURVES_NOTE}" if plots else recorded.LANES_NOTE)


def warnings_of(run: RecordedRun) -> list[str]:
    """What a reader has to know first: that a run failed or was broken off, and what of its record is damaged."""
    ended = run.results.get("ended", "")
    found = list(run.damage)
    if ended == STOPPED:
        found.insert(0, "This run was stopped before its end.")
    elif ended not in ENDED_WELL:
        found.insert(0, f"This run failed: {ended}")
    return found


def verdict_of(run: RecordedRun) -> tuple[str, bool]:
    """How a run ended, in a word or two, and whether that is well."""
    ended = run.results.get("ended", "")
    if not run.results:
        return "broken off", False
    if ended == STOPPED:
        return "stopped", False
    return ("ended well", True) if ended in ENDED_WELL else ("failed", False)


def _lead(run: RecordedRun) -> str:
    """What a run came to, in two or three sentences."""
    history = run.history
    detections = [record for record in history if record.kind == "detection"]
    said = [record.what for record in history if record.kind == "utterance"]
    if not len(history):
        return "Nothing happened."
    told = f"In {history.duration_s:.1f} s "
    if detections:
        people, most = _people(run)
        seen = "nobody was seen" if not most else f"{people} {'person' if people == 1 else 'people'} came into view"
        told += f"and {len(detections)} frames, {seen}{f', {most} at once at most' if most > 1 else ''}."
    else:
        count = len(actions(history))
        told += f"{count} {'action was' if count == 1 else 'actions were'} carried out."
    if said:
        quoted = ", ".join(f"“{text}”" for text in dict.fromkeys(said[:QUOTED]))
        more = f" and {len(said) - QUOTED} more" if len(said) > QUOTED else ""
        told += f" {_speaker(run)} said {quoted}{more}."
    elif detections:
        told += " Nothing was said."
    return told


def _people(run: RecordedRun) -> tuple[int, int]:
    """How many people came into view, one after the other, and how many there were at once at most."""
    lanes = {lane.name: lane.bars for lane in run.timeline.lanes()}
    counts = (len(record.detail.get("persons", ())) for record in run.history if record.kind == "detection")
    return len({bar.text for bar in lanes.get("people", ())}), max(counts, default=0)


def _speaker(run: RecordedRun) -> str:
    agents = run.history.agents
    return run.wording.name(agents[0]) if len(agents) == 1 else "The agents"


def _figures(run: RecordedRun) -> list[tuple[str, str]]:
    counts: Mapping[str, int] = {
        kind: sum(record.kind == kind for record in run.history) for kind in ("detection", "utterance")
    }
    figures = [(f"{run.history.duration_s:.1f} s", "from the first to the last of it")]
    if counts["detection"]:
        people, _ = _people(run)
        figures += [(str(counts["detection"]), "frames looked at"), (str(people), "people who came into view")]
    figures.append((str(len(actions(run.history))), "actions"))
    if counts["utterance"]:
        figures.append((str(counts["utterance"]), "things said"))
    bands: Mapping[str, Any] = (run.results.get("scores") or {}).get("bands", {})
    found, wrong = (sum(band[key] for band in bands.values() for key in keys) for keys in (("tp",), ("fp", "fn")))
    if found + wrong:
        figures.append((f"{2 * found / (2 * found + wrong):.3f}", "F1 of seeing people, at all distances"))
    return figures


def _shots(world: World, story: Story) -> list[str]:
    return [world.picture(stamp, f"{story.seconds(stamp):.1f} s: {what}") for stamp, what in _moments(story)]


def _tiles(summary: Summary) -> list[tuple[str, str]]:
    story = summary.story
    tiles = []
    if story.first is not None:
        planned_s, took_s = story.makespans_s(story.first)
        tiles.append(("-" if took_s is None else f"{took_s:.1f} s", f"for {story.first.name}"))
        if planned_s is not None:
            tiles.append((f"{planned_s:.1f} s", "in its first plan"))
    tiles.append((str(len(story.plans)), f"plans of {len(story.agents)} agents, {summary.given_up} given up"))
    tiles.append((str(sum(step.began is not None for step in story.steps)), "steps begun"))
    if story.words:
        tiles.append((str(len(story.words)), "messages between agents"))
    else:
        tiles.append((str(len(story.requests)), f"requests, {summary.requests_for_desires} for a desire"))
    return tiles


def _moments(story: Story) -> list[tuple[int, str]]:
    """What to show pictures of: start and end, plans that were given up, and what agents took up by themselves."""
    turns = [(plan.ended or 0, f"{plan.agent} gives up plan {plan.number}") for plan in story.plans if plan.reason]
    turns += [
        (desire.adopted, f"{desire.agent} wants {desire.name}")
        for desire in story.desires
        if desire.why.startswith("its rule")
    ]
    apart_s = min(APART_S, story.duration_s / SHOTS)
    chosen = [(story.start, "the start")]
    for stamp, what in sorted(turns):
        if story.seconds(stamp) - story.seconds(chosen[-1][0]) >= apart_s and len(chosen) < SHOTS - 1:
            chosen.append((stamp, what))
    return [*chosen, (story.end, "the end")]
