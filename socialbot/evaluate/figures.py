"""What the terminal, the page and the document show alike: rows beside the paper, causes, curves, colours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from socialbot.evaluate.chart import COLOURS, Line, Point, curves_chart
from socialbot.evaluate.evaluation import DetectorResult, Evaluation, SceneResult
from socialbot.evaluate.paper import PAPER, SCENES, paper_scene
from socialbot.evaluate.scores import COVERAGE, BandScore
from socialbot.vision.scoring import Score

__all__ = [
    "CONFIDENCE", "Row", "all_causes", "asked", "colours", "curve_charts", "followed", "metres", "paper_rows",
    "paper_score", "rate", "scene_columns", "told_bands", "told_of_any",
]  # fmt: skip

CONFIDENCE = f"{100 * COVERAGE:g} %"
"""How sure intervals are, as tables say it."""

Row = tuple[str, str, dict[str, Score]]
"""Distance band, who (the paper or a detector), and the scores by scene."""


def rate(value: float | None, places: int = 3) -> str:
    """A rate as people read it; "-" for none."""
    return "-" if value is None else f"{value:.{places}f}"


def metres(band: str) -> str:
    """A band as people read it: "2-10 m"."""
    return f"{band} m" if "-" in band else band


def paper_rows(evaluation: Evaluation) -> list[Row]:
    """The scores laid beside those of the paper: for each band the paper's row, if any, then the detectors'.

    By presence, which the paper does not judge by, there are none.
    """
    rows: list[Row] = []
    if evaluation.plan.rules.presence:
        return rows
    columns = _column_of(evaluation.scenes)
    for band in evaluation.plan.rules.keys:
        paper = {scene: scores[band] for scene, scores in PAPER.items() if band in scores}
        if paper:
            rows.append((band, "paper", paper))
        for name, result in evaluation.detectors.items():
            scores = {columns[scene]: each.score.bands[band].score for scene, each in result.scenes.items()}
            if any(score.tp or score.fp or score.fn for score in scores.values()):
                rows.append((band, name, scores))
    return rows


def scene_columns(evaluation: Evaluation) -> list[str]:
    """The columns of the tables beside the paper: its scenes, then others."""
    return list(dict.fromkeys([*SCENES, *_column_of(evaluation.scenes).values()]))


def _column_of(scenes: Sequence[str]) -> dict[str, str]:
    """The column of each scene: the paper's where it alone stands for one of its scenes, else its own."""
    papers = {scene: paper_scene(scene) for scene in scenes}
    alone = Counter(papers.values())
    return {scene: paper if paper is not None and alone[paper] == 1 else scene for scene, paper in papers.items()}


def told_bands(scene: SceneResult) -> Iterable[tuple[str, BandScore]]:
    """The bands with anything in them, and those that were asked for."""
    for band, score in scene.score.bands.items():
        if "-" in band or score.score.tp or score.score.fp or score.score.fn:
            yield band, score


def told_of_any(evaluation: Evaluation, scene: str) -> list[str]:
    """The names of the bands of ``scene`` that are told of any detector."""
    told = {band for result in evaluation.detectors.values() for band, _ in told_bands(result.scenes[scene])}
    return [band for band in evaluation.plan.rules.keys if band in told]


def followed(evaluation: Evaluation, result: DetectorResult) -> str:
    """Whether people were followed from frame to frame."""
    consecutive = {source.footage.consecutive for source in evaluation.plan.sources}
    if not result.pipeline.tracked or True not in consecutive:
        return "without tracking"
    return "with tracking" if False not in consecutive else "with tracking (single pictures without)"


def asked(evaluation: Evaluation) -> str:
    """What is found or missed: people, or by presence frames with somebody in the band."""
    return "frames" if evaluation.plan.rules.presence else "people"


def colours(evaluation: Evaluation) -> list[tuple[str, str]]:
    """The name and the colour of each detector."""
    return [(name, COLOURS[number % len(COLOURS)]) for number, name in enumerate(evaluation.detectors)]


def all_causes(evaluation: Evaluation) -> tuple[list[tuple[str, str, Counter[str]]], list[str]]:
    """The causes of false alarms: detector, scene and counts; and all causes there are, the most frequent first."""
    columns = [
        (name, scene, Counter(scored.score.overall.causes))
        for name, result in evaluation.detectors.items()
        for scene, scored in result.scenes.items()
    ]
    total: Counter[str] = Counter()
    for _, _, causes in columns:
        total.update(causes)
    return columns, [cause for cause, _ in total.most_common()]


def paper_score(evaluation: Evaluation, scene: str, band: str) -> Score | None:
    """What the paper has for a scene and band; None by presence, which it did not judge by."""
    if evaluation.plan.rules.presence:
        return None
    return PAPER.get(paper_scene(scene) or "", {}).get(band)


def curve_charts(evaluation: Evaluation) -> list[str]:
    """A chart of precision over recall for each scene and band with people."""
    scores = [scored.score.bands for result in evaluation.detectors.values() for scored in result.scenes.values()]
    keys = [key for key in evaluation.plan.rules.keys if any(bands[key].curve is not None for bands in scores)]
    return [_chart(evaluation, scene, band) for scene in evaluation.scenes for band in keys]


def _chart(evaluation: Evaluation, scene: str, band: str) -> str:
    lines = []
    for name, colour in colours(evaluation):
        score = evaluation.detectors[name].scenes[scene].score.bands[band]
        lines.append(Line(name, colour, score.curve, _point(score.score)))
    return curves_chart(f"{scene}, {metres(band)}", lines, _point(paper_score(evaluation, scene, band)))


def _point(score: Score | None) -> Point | None:
    if score is None or score.recall is None or score.precision is None:
        return None
    return score.recall, score.precision
