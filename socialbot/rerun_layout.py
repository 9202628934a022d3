"""What Rerun shows of a run, and where: the picture beside what was decided, the world below, curves at the foot."""

from __future__ import annotations

from typing import Any

from socialbot.inspect.run_folder import RecordedRun

WORLD = "base_link"
CAMERA = f"{WORLD}/camera"
PICTURE = f"{CAMERA}/picture"
PEOPLE = f"{WORLD}/people"
DISTANCES, HEAD, LOG, MINDS = "distance_m", "head", "log", "minds"
"""Entities. What is below `WORLD` is in the frame of the robot's foot: x forward, y left, z up."""

BEHIND_M, AHEAD_M = (-5.0, 3.0, 5.0), (4.0, 0.0, 0.8)
"""From where the world is looked at, and at what."""


def layout(run: RecordedRun, blueprint: Any) -> Any:
    """The views of ``run``, made with the module ``rerun.blueprint``; those of people only where some were seen."""
    sees = any(record.kind == "detection" for record in run.history)
    turns = any(record.kind == "motion" for record in run.history)
    # Sentences begin with who did it.
    columns = blueprint.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    log = blueprint.TextLogView(origin=LOG, name="What happened, and why", columns=columns)
    minds = blueprint.Tabs(
        *(
            blueprint.TextDocumentView(origin=f"{MINDS}/{agent}", name=f"Mind of {run.wording.name(agent)}")
            for agent in run.history.agents
        )
    )
    if not sees:
        return _with_panels(blueprint, blueprint.Horizontal(log, minds, column_shares=[3, 2]))
    curves = [blueprint.TimeSeriesView(origin=DISTANCES, name="How far people are, m")]
    if turns:
        curves.append(blueprint.TimeSeriesView(origin=HEAD, name="Where the head points, rad"))
    eye = blueprint.EyeControls3D(position=BEHIND_M, look_target=AHEAD_M)
    views = blueprint.Horizontal(
        blueprint.Vertical(
            blueprint.Spatial2DView(origin=PICTURE, name="Camera"),
            blueprint.Spatial3DView(origin=WORLD, name="Around the robot", eye_controls=eye),
            row_shares=[3, 2],
        ),
        blueprint.Vertical(log, minds, *curves, row_shares=[3, 2, *(2 for _ in curves)]),
        column_shares=[1, 1],
    )
    return _with_panels(blueprint, views)


def _with_panels(blueprint: Any, views: Any) -> Any:
    return blueprint.Blueprint(
        views,
        blueprint.BlueprintPanel(state="collapsed"),
        blueprint.SelectionPanel(state="collapsed"),
        blueprint.TimePanel(state="collapsed", timeline="run"),
    )
