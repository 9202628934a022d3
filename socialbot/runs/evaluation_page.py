"""An evaluation as one self-contained HTML page."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ImageError
from socialbot.runs.evaluation_chart import Mark, Track, timeline
from socialbot.runs.evaluation_figures import (
    CONFIDENCE,
    all_causes,
    asked,
    colours,
    curve_charts,
    followed,
    metres,
    paper_rows,
    paper_score,
    rate,
    scene_columns,
    told_bands,
    told_of_any,
)
from socialbot.runs.record import versions
from socialbot.runs.report_page import Page, Section, wide
from socialbot.vision.metrics.behaviour import GREET_S, OUTCOMES, Deed
from socialbot.vision.metrics.evaluation import ClipResult, Evaluation, ScoredImage
from socialbot.vision.metrics.frames import BLOCK_S, Box, LabelledSource
from socialbot.vision.metrics.matches import CAUSES, Match
from socialbot.vision.metrics.scores import DRAWS, BandScore, Interval

__all__ = ["Pictures", "STYLES", "Snapshot", "bar", "cell", "drawn", "interval", "key", "page", "row", "table", "worst"]


def interval(value: Interval | None) -> str:
    """An interval as people read it; nothing for none."""
    return "" if value is None else f"{value[0]:.2f}-{value[1]:.2f}"


def table(
    heads: Iterable[str], rows: Iterable[str], *, left: Container[int], groups: Iterable[tuple[str, int]] = ()
) -> str:
    """A table; the heads of the columns numbered in ``left`` are set to the left.

    ``groups`` stand above the ``heads``: a word, and how many columns it is for.
    """
    above = "".join(f'<th class="g" colspan="{count}">{escape(word)}</th>' for word, count in groups)
    cells = "".join(
        f'<th class="{"l" if number in left else ""}">{escape(head)}</th>' for number, head in enumerate(heads)
    )
    head = f"<thead>{above and f'<tr>{above}</tr>'}<tr>{cells}</tr></thead>"
    return wide(f'<table class="scores">{head}<tbody>{"".join(rows)}</tbody></table>')


def row(cells: Iterable[str], kind: str = "") -> str:
    """A row of a table from its cells."""
    return f'<tr class="{kind}">{"".join(cells)}</tr>'


def cell(text: str, kind: str = "") -> str:
    """A cell with ``text``, which may hold any sign."""
    return f'<td class="{kind}">{escape(text)}</td>'


def bar(width: float, colour: str, room: float) -> str:
    """A bar ``width`` pixels long, with ``room`` for as many."""
    drawn = f'<span class="bar" style="width:{width:.0f}px;background:{colour}"></span>'
    return f'<span class="room" style="width:{room + 16:.0f}px">{drawn}</span>'


def key(entries: Iterable[tuple[str, str]], more: str = "") -> str:
    """What the colours mean: name and colour of each, and a word about what has none."""
    spans = [f'<span><i style="background:{colour}"></i>{escape(name)}</span>' for name, colour in entries]
    return f'<p class="key">{"".join(spans)}{f"<span>{escape(more)}</span>" if more else ""}</p>'


APART_S = 1.5
"""Frames nearer to each other show the same error."""
WIDTH = 480
QUALITY = 78

LETTERS = {"false": ("#ffffff", "#b3140c"), "missed": ("#222222", "#ffd60a")}
"""Colour of the letters at a box, and of what is round them."""

STYLES = {"hit": ("#2fd06a", ""), "false": ("#ff3b30", ""), "missed": ("#ffd60a", "7 4"), "spared": ("#9fb4c0", "3 3")}
"""Colour and dashes of each verdict."""


@dataclass(frozen=True)
class Snapshot:
    """A frame worth looking at, of one source."""

    source: LabelledSource
    scored: ScoredImage


def worst(clips: Iterable[ClipResult], count: int) -> list[Snapshot]:
    """The frames with the most errors, worst first, no two of them close together."""
    ranked = sorted(
        (Snapshot(clip.source, scored) for clip in clips for scored in clip.frames if scored.errors),
        key=lambda shot: (-shot.scored.errors, shot.source.name, shot.scored.frame.stamp),
    )
    chosen: list[Snapshot] = []
    for shot in ranked:
        if len(chosen) == count:
            break
        if not any(_same_moment(shot, other) for other in chosen):
            chosen.append(shot)
    return chosen


def _same_moment(one: Snapshot, other: Snapshot) -> bool:
    apart = abs(one.scored.frame.stamp - other.scored.frame.stamp)
    return one.source.images.consecutive and one.source is other.source and apart < nanoseconds(APART_S)


class Pictures:
    """The pictures of some frames as JPEG in base64; each source is read once."""

    def __init__(self, shots: Sequence[Snapshot]) -> None:
        self._found: dict[tuple[str, int], str] = {}
        wanted: dict[str, tuple[LabelledSource, set[int]]] = {}
        for shot in shots:
            wanted.setdefault(shot.source.name, (shot.source, set()))[1].add(shot.scored.frame.stamp)
        for name, (source, stamps) in wanted.items():
            for encoded in source.images.pictures():
                if encoded.stamp in stamps:
                    try:
                        self._found[name, encoded.stamp] = _jpeg(encoded.bgr())
                    except ImageError:
                        continue

    def of(self, shot: Snapshot) -> str | None:
        """The picture of ``shot``, made small."""
        return self._found.get((shot.source.name, shot.scored.frame.stamp))


def drawn(shot: Snapshot, jpeg: str) -> str:
    """The picture as SVG with boxes: found, false, missed, spared, and dotted what is true."""
    scored = shot.scored
    width, height = scored.found.width, scored.found.height
    unit = max(width, height) / 640
    parts = [f'<image href="data:image/jpeg;base64,{jpeg}" width="{width}" height="{height}"/>']
    matches = [verdict for verdict in scored.matches if verdict.box[2] > 0]
    parts += [_rectangle(person.box, "#ffffff", "2 4", 1.8 * unit) for person in scored.frame.persons]
    if not matches:  # By presence nothing is said of single boxes.
        parts += [
            _rectangle((each.x, each.y, each.w, each.h), "#5ac8fa", "", 2 * unit) for each in scored.found.persons
        ]
    parts += [_rectangle(verdict.box, *STYLES[verdict.kind], 3 * unit) for verdict in matches]
    parts += [_label(verdict, unit, width) for verdict in matches if verdict.kind in ("false", "missed")]
    label = escape(f"{shot.source.name}, {scored.frame.name}")
    return f'<svg class="frame" viewBox="0 0 {width} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _rectangle(box: Box, colour: str, dashes: str, thick: float) -> str:
    x, y, w, h = box
    dash = f' stroke-dasharray="{dashes}"' if dashes else ""
    place = f'x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" fill="none"'
    # A dark line below keeps the colour visible on anything.
    return (
        f'<rect {place} stroke="#000" stroke-opacity=".55" stroke-width="{2 * thick:.1f}"/>'
        f'<rect {place} stroke="{colour}" stroke-width="{thick:.1f}"{dash}/>'
    )


def _label(verdict: Match, unit: float, width: int) -> str:
    text = f"{verdict.cause} {verdict.score:.2f}" if verdict.kind == "false" else "missed"
    colour, round_it = LETTERS[verdict.kind]
    size = 21 * unit
    long = len(text) * size * 0.56
    left, top, _, high = verdict.box
    x = min(max(left, 2.0), max(width - long, 2.0))
    # What was missed is told inside its box, so that it does not cover the word about a false alarm there.
    y = max(top - 3 * unit, size) if verdict.kind == "false" else min(top + size, top + high)
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:.1f}" fill="{colour}" stroke="{round_it}" '
        f'stroke-width="{5 * unit:.1f}" stroke-linejoin="round" paint-order="stroke">{escape(text)}</text>'
    )


def _jpeg(image: np.ndarray) -> str:
    height, width = image.shape[:2]
    if width > WIDTH:
        image = cv2.resize(image, (WIDTH, max(1, round(height * WIDTH / width))), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return base64.b64encode(data.tobytes()).decode()


WORST = 6
"""So many frames of each detector and scene are shown."""

PAPER_NOTE = (
    "The paper's rows are its Tables 2 and 3: other people, other pictures, and another rule for what is a hit. "
    "Compare the detectors with each other; the paper's rows show where its detector was weak."
)
CURVES_NOTE = (
    "Lines: the detector alone, at every threshold. Dots: the pipeline as it runs, with tracking and its own "
    "threshold, which may lie off the line. Diamonds: the paper."
)
BEHAVIOUR_NOTE = (
    "Waldo's own mind runs on the detections, and beside it on the truth: what he does there is due. In time is within "
    f"{GREET_S:g} s of somebody being there. G greeting, H offer of help; green in time, amber late, red wrong; ? is "
    "what was due and never came. Grey bars are people within his range."
)

GOOD, POOR, BAD = "#2f8f4e", "#b37a00", "#c0392b"
_COLOUR_OF = {"in time": GOOD, "late": POOR}


def page(evaluation: Evaluation) -> Page:
    """The page. Reads the sources once more for the pictures of the worst frames."""
    by_boxes = not evaluation.plan.rules.presence
    return Page(
        title="Seeing people",
        lead=_lead(evaluation),
        tiles=_tiles(evaluation),
        sections=[
            Section("F1 by distance", _key(evaluation) + _summary(evaluation)),
            Section("Beside the paper", _paper(evaluation) if by_boxes else "", PAPER_NOTE),
            Section("In full", "".join(_full(evaluation, name) for name in evaluation.detectors)),
            Section("Precision and recall", _curves(evaluation), CURVES_NOTE),
            Section("Where false alarms come from", _causes(evaluation) if by_boxes else ""),
            Section("What Waldo does with it", _behaviour(evaluation), BEHAVIOUR_NOTE),
            Section("The worst frames", _worst(evaluation)),
            Section("How this was measured", _method(evaluation)),
        ],
    )


def _lead(evaluation: Evaluation) -> str:
    listed = ", ".join(
        f"{source.name} ({len(source.frames)} frames{', ' + source.split if source.split else ''})"
        for source in evaluation.plan.sources
    )
    speeds = {name: result.speed for name, result in evaluation.detectors.items()}
    told = "; ".join(f"{name} {speed}" for name, speed in speeds.items() if speed is not None)
    return f"{', '.join(evaluation.detectors)} on {listed}.{f' {told}.' if told else ''}"


def _tiles(evaluation: Evaluation) -> list[tuple[str, str]]:
    """F1 at all distances, by detector and scene."""
    return [
        (rate(scored.score.overall.score.f1), f"F1 of {name}, {scene}")
        for name, result in evaluation.detectors.items()
        for scene, scored in result.scenes.items()
    ]


def _key(evaluation: Evaluation) -> str:
    return key(colours(evaluation))


def _summary(evaluation: Evaluation) -> str:
    """F1 with its interval: a row for each scene and band, a column for each detector and for the paper."""
    rows = []
    for scene in evaluation.scenes:
        results = {name: result.scenes[scene].score for name, result in evaluation.detectors.items()}
        for number, band in enumerate([*told_of_any(evaluation, scene), "all"]):
            scores = {name: score.overall if band == "all" else score.bands[band] for name, score in results.items()}
            best = max((each.score.f1 for each in scores.values() if each.score.f1 is not None), default=None)
            people = max(each.score.tp + each.score.fn for each in scores.values())
            cells = [
                _f1_cell(each, colour, best)
                for each, (_, colour) in zip(scores.values(), colours(evaluation), strict=True)
            ]
            printed = paper_score(evaluation, scene, band)
            label = scene if not number else ""
            cells = [
                cell(label, "l"),
                cell(metres(band), "l"),
                cell(str(people)),
                *cells,
                cell(rate(printed.f1) if printed else ""),
            ]
            rows.append(row(cells, "first" if not number else ""))
    heads = ["scene", "distance", asked(evaluation), *evaluation.detectors, "paper"]
    return table(heads, rows, left={0, 1, *range(3, 3 + len(evaluation.detectors))})


def _f1_cell(band: BandScore, colour: str, best: float | None) -> str:
    value = band.score.f1
    kind = "best" if value is not None and value == best else ""
    length = bar(60 * (value or 0), colour, 60)
    told = f"{rate(value)} <small>{interval(band.intervals.get('f1'))}</small>"
    return f'<td class="l {kind}">{length}{told}</td>'


def _paper(evaluation: Evaluation) -> str:
    scenes = scene_columns(evaluation)
    heads = ["distance", "", *("TP", "FP", "FN", "P", "R", "F1") * len(scenes)]
    groups = [("", 2), *((scene, 6) for scene in scenes)]
    rows, before = [], ""
    for band, who, scores in paper_rows(evaluation):
        cells = [cell(metres(band) if band != before else "", "l"), cell(who, "l")]
        for scene in scenes:
            score = scores.get(scene)
            counts = ("", "", "") if score is None else (score.tp, score.fp, score.fn)
            rates = ("", "", "") if score is None else map(rate, (score.precision, score.recall, score.f1))
            cells += [cell(str(value), "" if n else "n") for n, value in enumerate((*counts, *rates))]
        rows.append(
            row(cells, " ".join(filter(None, ("first" if band != before else "", "paper" if who == "paper" else ""))))
        )
        before = band
    return table(heads, rows, left=range(2), groups=groups)


def _full(evaluation: Evaluation, name: str) -> str:
    result = evaluation.detectors[name]
    rows = []
    for scene, scored in result.scenes.items():
        for number, (band, score) in enumerate([*told_bands(scored), ("all", scored.score.overall)]):
            each = score.score
            cells = [cell(scene if not number else "", "l"), cell(metres(band), "l")]
            cells += [cell(str(value)) for value in (each.tp + each.fn, each.tp, each.fp, each.fn)]
            cells += [
                f"<td>{rate(value)} <small>{interval(score.intervals.get(key))}</small></td>"
                for key, value in (
                    ("precision", each.precision),
                    ("recall", each.recall),
                    ("f1", each.f1),
                    ("ap", score.ap),
                )
            ]
            rows.append(row(cells, "first" if not number else ""))
    heads = [
        "scene",
        "distance",
        asked(evaluation),
        "found",
        "false",
        "missed",
        "precision",
        "recall",
        "F1",
        "AP of the detector alone",
    ]
    return f"<h3>{escape(name)}, {followed(evaluation, result)}</h3>{table(heads, rows, left=range(2))}"


def _curves(evaluation: Evaluation) -> str:
    return f'{_key(evaluation)}<div class="charts">{"".join(curve_charts(evaluation))}</div>'


def _causes(evaluation: Evaluation) -> str:
    columns, causes = all_causes(evaluation)
    if not causes:
        return '<p class="note">There are none.</p>'
    largest = max(max(counts.values(), default=0) for _, _, counts in columns)
    colour = dict(colours(evaluation))
    rows = []
    for cause in causes:
        bars = [
            f'<td class="l">{bar(90 * counts[cause] / largest, colour[name], 90)}{counts[cause]}</td>'
            for name, _, counts in columns
        ]
        rows.append(row([cell(cause, "l"), *bars, cell(CAUSES.get(cause, "a thing of this kind stands there"), "l")]))
    heads = ["cause", *(f"{name}, {scene}" for name, scene, _ in columns), ""]
    return table(heads, rows, left=range(len(columns) + 2))


def _behaviour(evaluation: Evaluation) -> str:
    clips = [
        (name, clip)
        for name, result in evaluation.detectors.items()
        for scene in result.scenes.values()
        for clip in scene.clips
        if clip.behaviour is not None
    ]
    if not clips:
        return ""
    heads = ["detector", "clip", *(outcome for outcomes in OUTCOMES.values() for outcome in outcomes)]
    groups = [("", 2), *((f"{deed}s", len(outcomes)) for deed, outcomes in OUTCOMES.items())]
    rows = []
    for name, clip in clips:
        assert clip.behaviour is not None
        counts = [
            cell(str(count), "" if number else "n")
            for deed in OUTCOMES
            for number, count in enumerate(clip.behaviour.count(deed).values())
        ]
        rows.append(row([cell(name, "l"), cell(clip.source.name, "l"), *counts]))
    by_clip: dict[str, list[tuple[str, ClipResult]]] = {}
    for name, clip in clips:
        by_clip.setdefault(clip.source.name, []).append((name, clip))
    lines = [f"<h3>{escape(clip)}</h3>{_timeline(results)}" for clip, results in by_clip.items()]
    return table(heads, rows, left=range(2), groups=groups) + "".join(lines)


def _timeline(results: Sequence[tuple[str, ClipResult]]) -> str:
    first = results[0][1]
    frames = first.source.frames
    start = frames[0].stamp if frames else 0
    seconds = (frames[-1].stamp - start) / SECOND if frames else 0.0
    assert first.behaviour is not None
    people: dict[str, list[tuple[float, float, str]]] = {}
    for visit in first.behaviour.visits:
        begin, end = (visit.begin - start) / SECOND, (visit.end - start) / SECOND
        people.setdefault(visit.person, []).append((begin, end, f"{visit.person}: {begin:.1f} to {end:.1f} s"))
    tracks = [Track(person, tuple(bars)) for person, bars in people.items()]
    for name, clip in results:
        acts = clip.behaviour.acts if clip.behaviour is not None else ()
        marks = tuple(
            Mark(
                (act.time - start) / SECOND,
                "?" if act.outcome == "missed" else _letter(act.deed),
                _COLOUR_OF.get(act.outcome, BAD),
                f"{act.deed} {act.outcome}" + (f" after {act.delay_s:.1f} s" if act.delay_s is not None else ""),
            )
            for act in acts
        )
        tracks.append(Track(name, (), marks))
    return wide(timeline(seconds, tracks))


def _letter(deed: Deed) -> str:
    return {"greeting": "G", "offer": "H"}[deed]


def _worst(evaluation: Evaluation) -> str:
    shots = {
        (name, scene): worst(scored.clips, WORST)
        for name, result in evaluation.detectors.items()
        for scene, scored in result.scenes.items()
    }
    pictures = Pictures([shot for each in shots.values() for shot in each])
    names = {"hit": "found", "false": "false alarm, and why", "missed": "missed", "spared": "not judged"}
    parts = [key([(name, STYLES[kind][0]) for kind, name in names.items()], "dotted white: the truth")]
    for (name, scene), chosen in shots.items():
        figures = []
        for shot in chosen:
            jpeg = pictures.of(shot)
            if jpeg is not None:
                frame = shot.scored.frame
                light = f", light: {escape(frame.light)}" if frame.light else ""
                errors = Counter(verdict.kind for verdict in shot.scored.matches)
                caption = f"{escape(shot.source.name)}, {escape(frame.name)}{light}"
                caption += f": {errors['false']} false, {errors['missed']} missed"
                figures.append(f"<figure>{drawn(shot, jpeg)}<figcaption>{caption}</figcaption></figure>")
        said = "The pictures of the errors cannot be read any more." if chosen else "No errors."
        shown = f'<div class="frames">{"".join(figures)}</div>' if figures else f'<p class="note">{said}</p>'
        parts.append(f"<h3>{escape(name)}, {escape(scene)}</h3>{shown}")
    return "\n".join(parts)


def _method(evaluation: Evaluation) -> str:
    rules = evaluation.plan.rules
    matching = (
        "In each frame and band: is somebody there? By the distance that the detector gives."
        if rules.presence
        else f"Greedy matching, best score first, from an IoU of {rules.least_iou:g} on. Hits and misses belong to the "
        "band of the true distance, false alarms to that of the distance which the detector gives."
    )
    items = [
        matching,
        "People of whom less than a quarter is visible are neither asked for nor held against a detector.",
        f"Intervals: {CONFIDENCE}, bootstrap of {DRAWS} draws over blocks of {BLOCK_S:g} s, or single pictures, since "
        "frames that follow each other show nearly the same.",
        "AP: area under the curve of the detector alone, all-point interpolation.",
    ]
    for name, result in evaluation.detectors.items():
        changed = ", ".join(f"{key} {value}" for key, value in result.pipeline.changes.items())
        items.append(
            f"{name}: believed from a score of {result.pipeline.sure:g}, tracks kept from {result.pipeline.spec.weak:g}"
            + (f"; {changed}" if changed else "")
        )
        items += [
            f"{name}, {clip.source.name}: {clip.missing_frames} frames without a picture, {clip.damaged} damaged "
            f"{clip.first_damage}"
            for scene in result.scenes.values()
            for clip in scene.clips
            if clip.missing_frames or clip.damaged
        ]
    items.append(", ".join(f"{name} {version}" for name, version in versions().items()))
    return '<ul class="method">' + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>"
