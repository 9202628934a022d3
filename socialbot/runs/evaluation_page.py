"""Evaluation as one self-contained HTML page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from markupsafe import Markup

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ImageError
from socialbot.runs.evaluation_tables import (
    CONFIDENCE,
    behaviour_clips,
    behaviour_table,
    causes_table,
    coco_table,
    curve_charts,
    detector_table,
    distance_table,
    paper_tables,
    summary_table,
    tracking_table,
)
from socialbot.runs.pages import (
    Chart,
    LabelledBox,
    Page,
    Section,
    Series,
    Still,
    Table,
    charts,
    part,
    rate,
    render,
    spread,
    thumbnail,
    timeline,
)
from socialbot.runs.record import versions
from socialbot.runs.timeline import Bar, Lane
from socialbot.vision.metrics.behaviour import GREET_S
from socialbot.vision.metrics.evaluation import ClipResult, Evaluation, ScoredImage
from socialbot.vision.metrics.frames import BLOCK_S, LabelledSource
from socialbot.vision.metrics.matches import Match
from socialbot.vision.metrics.scores import DRAWS

WORST = 6
APART_S = 1.5
"""Closer frames of one bag show the same error."""
ACT_S = 0.4
PAPER_NOTE = (
    "The rows of the paper are its Tables 2 and 3. It used other people, other images and another matching rule, so "
    "compare the detectors with each other. Its rows show where its detector was weak."
)
CURVES_NOTE = (
    "Lines: the detector alone, at every threshold. Dots: the pipeline as it runs, with tracking and its own "
    "threshold, which may lie off the line. Diamonds: the paper."
)
COCO_NOTE = (
    "As COCO defines it, for the detector alone. AP is the mean over the IoU thresholds .50 to .95, AP50 and AP75 are "
    "at one threshold. Small people cover less than 32x32 pixels, large ones more than 96x96. AR: average recall."
)
TRACKING_NOTE = (
    "Metrics of the MOTChallenge, for whole recordings. Pairs need an IoU of 0.5; HOTA is a mean over 19 thresholds. "
    "Switches: a person's track changed. Fragments: a person's track was interrupted."
)
DISTANCE_NOTE = (
    "Shares of the true distance, for detected people with a known distance. Bias: median error, positive "
    "if distances are too large. Within 2 sigma: share of distances that differ by at most twice their stated error."
)
BEHAVIOUR_NOTE = (
    "Waldo's node runs on the detections and on the ground truth. What it does on the truth is due. In time means "
    f"within {GREET_S:g} s of a person being there."
)
KEY = (
    ("found", "#35d07f"),
    ("false positive and its cause", "#ff5a4f"),
    ("missed", "#ffd60a"),
    ("not scored", "#9fb4c0"),
    ("dotted white: ground truth", ""),
)
KINDS = {"hit": "seen", "false": "false", "missed": "missed", "spared": "ignored"}


@dataclass(frozen=True)
class Snapshot:
    """Frame of a source with its matches."""

    source: LabelledSource
    scored: ScoredImage


def page(evaluation: Evaluation) -> Page:
    """Build the page; reads the sources again for the images of the worst frames."""
    by_boxes = not evaluation.plan.rules.presence
    overall = [
        (rate(scored.score.overall.score.f1), f"F1 of {name}, {scene}")
        for name, result in evaluation.detectors.items()
        for scene, scored in result.scenes.items()
    ]
    full = [detector_table(evaluation, name, intervals=True) for name in evaluation.detectors]
    return Page(
        title="Seeing people",
        lead=_lead(evaluation),
        tiles=overall,
        sections=[
            Section("F1 by distance", summary_table(evaluation).html()),
            Section("Beside the paper", _titled(paper_tables(evaluation)) if by_boxes else "", PAPER_NOTE),
            Section("In full", _titled(full)),
            Section("Precision and recall", _curves(evaluation), CURVES_NOTE),
            Section("Average precision", _if_rows(coco_table(evaluation)), COCO_NOTE),
            Section("Tracking", _if_rows(tracking_table(evaluation)), TRACKING_NOTE),
            Section("Errors of distances", _if_rows(distance_table(evaluation)), DISTANCE_NOTE),
            Section("Where false positives come from", _causes(evaluation) if by_boxes else ""),
            Section("What Waldo does with it", _behaviour(evaluation), BEHAVIOUR_NOTE),
            Section("The worst frames", _worst_frames(evaluation)),
            Section("How this was measured", render("evaluation_method.html", items=list(_method(evaluation)))),
        ],
    )


def _lead(evaluation: Evaluation) -> str:
    sources = ", ".join(
        f"{source.name} ({len(source.frames)} frames{', ' + source.split if source.split else ''})"
        for source in evaluation.plan.sources
    )
    speeds = [f"{name} {result.speed}" for name, result in evaluation.detectors.items() if result.speed is not None]
    return " ".join([f"{', '.join(evaluation.detectors)} on {sources}.", *(f"{speed}." for speed in speeds)])


def _titled(tables: Iterable[Table]) -> Markup:
    return part("titled", [(each.title, each.html()) for each in tables])


def _curves(evaluation: Evaluation) -> Markup:
    drawn = []
    for chart in curve_charts(evaluation):
        series = []
        for line in chart.lines:
            if line.curve is not None and len(line.curve.recall):
                series.append(Series(line.name, line.thinned(), line.colour))
            if line.point is not None:
                series.append(Series(f"{line.name}, pipeline", (line.point,), line.colour, "points"))
        if chart.paper is not None:
            series.append(Series("paper", (chart.paper,), "soft", "diamonds"))
        drawn.append(Chart(chart.title, series, "recall", "precision", (0, 1), (0, 1)))
    return charts(drawn)


def _causes(evaluation: Evaluation) -> Markup:
    return causes_table(evaluation, explained=True).html() or part("note", "There are none.")


def _if_rows(table: Table) -> Markup:
    return table.html() if table.rows else Markup()


def _behaviour(evaluation: Evaluation) -> Markup:
    by_clip: dict[str, list[tuple[str, ClipResult]]] = {}
    for name, clip in behaviour_clips(evaluation):
        by_clip.setdefault(clip.source.name, []).append((name, clip))
    lines = part("titled", [(clip, _timeline(results)) for clip, results in by_clip.items()])
    return behaviour_table(evaluation).html() + lines if by_clip else Markup()


def _timeline(results: Sequence[tuple[str, ClipResult]]) -> Markup:
    first = results[0][1]
    frames = first.source.frames
    start = frames[0].stamp if frames else 0
    assert first.behaviour is not None
    there = [
        Bar(f"visit {number}", "person", visit.person, (visit.begin - start) / SECOND, (visit.end - start) / SECOND)
        for number, visit in enumerate(first.behaviour.visits)
    ]
    lanes = [Lane("", "people", tuple(there))]
    for name, clip in results:
        bars = []
        for number, act in enumerate(clip.behaviour.acts if clip.behaviour is not None else ()):
            delay = "" if act.delay_s is None else f" after {act.delay_s:.1f} s"
            at_s = (act.time - start) / SECOND
            outcome = "" if act.outcome == "in time" else "late" if act.outcome == "late" else f"failed: {act.outcome}"
            text = f"{act.deed} {act.outcome}{delay}"
            bars.append(Bar(f"{name} {number}", "action", text, at_s, at_s + ACT_S, outcome))
        lanes.append(Lane(name, "actions", tuple(bars)))
    return timeline(lanes, (frames[-1].stamp - start) / SECOND if frames else 0.0)


def worst(clips: Iterable[ClipResult], count: int) -> list[Snapshot]:
    """Return the ``count`` frames with the most errors, worst first and not close together."""
    ranked = sorted(
        (Snapshot(clip.source, scored) for clip in clips for scored in clip.frames if scored.errors),
        key=lambda shot: (-shot.scored.errors, shot.source.name, shot.scored.frame.stamp),
    )
    return spread(ranked, count, _are_close)


def _are_close(one: Snapshot, other: Snapshot) -> bool:
    apart = abs(one.scored.frame.stamp - other.scored.frame.stamp)
    return one.source.images.consecutive and one.source is other.source and apart < nanoseconds(APART_S)


def _worst_frames(evaluation: Evaluation) -> Markup:
    chosen = {
        f"{name}, {scene}": worst(scored.clips, WORST)
        for name, result in evaluation.detectors.items()
        for scene, scored in result.scenes.items()
    }
    images = _load_images([shot for shots in chosen.values() for shot in shots])
    scenes = []
    for title, shots in chosen.items():
        shown = [still for shot in shots if (still := images.get((shot.source.name, shot.scored.frame.stamp)))]
        scenes.append((title, shown, "The images of the errors cannot be read any more." if shots else "No errors."))
    return render("evaluation_frames.html", key=KEY, scenes=scenes)


def _load_images(shots: Sequence[Snapshot]) -> dict[tuple[str, int], Still]:
    """Images of frames by source and stamp; each source is read once."""
    wanted: dict[str, dict[int, Snapshot]] = {}
    for shot in shots:
        wanted.setdefault(shot.source.name, {})[shot.scored.frame.stamp] = shot
    found = {}
    for name, by_stamp in wanted.items():
        for encoded in next(iter(by_stamp.values())).source.images.read():
            shot = by_stamp.get(encoded.stamp)
            with suppress(ImageError):
                if shot is not None:
                    pixels = encoded.bgr(shot.scored.frame.size)
                    if still := thumbnail(pixels, _boxes(shot), _caption(shot)):
                        found[name, encoded.stamp] = still
    return found


def _boxes(shot: Snapshot) -> list[LabelledBox]:
    scored = shot.scored
    matches = [match for match in scored.matches if match.box[2] > 0]
    boxes = [LabelledBox(*person.box, kind="truth") for person in scored.frame.persons]
    if not matches:  # Matching by presence has no boxes.
        boxes += [LabelledBox(each.x, each.y, each.w, each.h) for each in scored.found.persons]
    return boxes + [LabelledBox(*match.box, _label(match), KINDS[match.kind]) for match in matches]


def _caption(shot: Snapshot) -> str:
    scored = shot.scored
    errors = Counter(match.kind for match in scored.matches)
    light = f", light: {scored.frame.light}" if scored.frame.light else ""
    return f"{shot.source.name}, {scored.frame.name}{light}: {errors['false']} false, {errors['missed']} missed"


def _label(match: Match) -> str:
    return {"false": f"{match.cause} {match.score:.2f}", "missed": "missed"}.get(match.kind, "")


def _method(evaluation: Evaluation) -> Iterable[str]:
    rules = evaluation.plan.rules
    if rules.presence:
        yield "Matching by presence: in each frame and band, is a person there? The detector's distance decides."
    else:
        yield (
            f"Greedy matching, best score first, from an IoU of {rules.least_iou:g}. True positives and misses belong "
            "to the band of the true distance, false positives to that of the detector's distance."
        )
    yield "People of whom less than a quarter is visible are not scored."
    yield (
        f"Intervals: {CONFIDENCE}, bootstrap of {DRAWS} draws over blocks of {BLOCK_S:g} s or single images, because "
        "consecutive frames show nearly the same."
    )
    yield "AP: area under the curve of the detector alone, all-point interpolation."
    for source in evaluation.plan.sources:
        yield from (f"{source.name}: {note}" for note in source.notes)
    for name, result in evaluation.detectors.items():
        pipeline = result.pipeline
        changed = "".join(f"; {key} {value}" for key, value in pipeline.changes.items())
        yield f"{name}: new tracks from a score of {pipeline.sure:g}, known tracks from {pipeline.spec.weak:g}{changed}"
        for scene in result.scenes.values():
            for clip in scene.clips:
                if clip.missing_frames or clip.damaged:
                    yield (
                        f"{name}, {clip.source.name}: {clip.missing_frames} frames without an image, {clip.damaged} "
                        f"damaged {clip.first_damage}"
                    )
    yield ", ".join(f"{name} {version}" for name, version in versions().items())
