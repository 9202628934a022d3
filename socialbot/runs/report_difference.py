"""The page of two runs beside each other: where they decide differently first, and why."""

from __future__ import annotations

from html import escape
from typing import Any

from socialbot.runs.difference import Difference, Side
from socialbot.runs.report_frames import frame_of
from socialbot.runs.report_lanes import Mark
from socialbot.runs.report_page import Page, Section, table
from socialbot.runs.report_recorded import LANES_NOTE, PLANNED, REACTIVE, explanation, lanes_of
from socialbot.runs.run import Run


def difference_page(first: Run, second: Run, found: Difference) -> Page:
    """The page of what was ``found`` between two runs."""
    runs = (first, second)
    return Page(
        title=f"{found.runs[0]} and {found.runs[1]}",
        lead=_lead(found),
        verdict="the same" if found.same else "different",
        good=found.same,
        tiles=[(f"{one} | {other}", f"{kind.replace('_', ' ')}s") for kind, (one, other) in found.counts.items()],
        sections=[
            Section("The decision", _sides(runs, found), "Why each of the runs decided as it did."),
            Section("What went on when", _lanes(runs, found), f"{LANES_NOTE} The dashed line: that decision."),
            Section("Where they part", _partings(found), "What was seen, and believed, differs here first."),
            Section("Set differently", _settings(found)),
        ],
    )


def _lead(found: Difference) -> str:
    if found.same:
        return f"Both runs decide the same, at the same times: {found.decisions[0]} decisions."
    how = "the same, but at another time" if found.only_time else "differently"
    return f"Decision {found.number} of {found.agent} is the first that comes out {how}."


def _sides(runs: tuple[Run, Run], found: Difference) -> str:
    if found.sides is None:
        return ""
    sides = "".join(_side(run, side) for run, side in zip(runs, found.sides, strict=True))
    return f'<div class="sides">{sides}</div>'


def _side(run: Run, side: Side) -> str:
    if side.why is None:
        return f'<div><h3>{escape(side.run)}</h3><p class="note">Nothing more is decided.</p></div>'
    frame_s = side.why.frame_s
    frame = "" if frame_s is None else frame_of(run, run.history.stamp(frame_s), "the frame that led to it")
    return f"<div><h3>{escape(side.run)}</h3>{explanation(side.why, opened=True)}{frame}</div>"


def _lanes(runs: tuple[Run, Run], found: Difference) -> str:
    parts = []
    until_s = max(run.history.duration_s for run in runs)
    for number, run in enumerate(runs):
        at_s = None if found.sides is None else found.sides[number].at_s
        marks = [] if at_s is None else [Mark(at_s, f"the first decision that differs, at {at_s:.2f} s")]
        names = PLANNED if any(record.kind == "desire" for record in run.history) else REACTIVE
        parts.append(f"<h3>{escape(found.runs[number])}</h3>{lanes_of(run, names, marks=marks, until_s=until_s)}")
    return "".join(parts)


def _partings(found: Difference) -> str:
    rows = [
        [(parting.what, ""), *_told(parting.first_s, parting.first), *_told(parting.second_s, parting.second)]
        for parting in found.causes
    ]
    first, second = found.runs
    return table(("", "at", first, "at", second), rows, right=(1, 3)) if rows else ""


def _told(at_s: float | None, what: str) -> list[tuple[str, str]]:
    return [("", "r"), ("nothing", "")] if at_s is None else [(f"{at_s:.2f} s", "r"), (what, "")]


def _settings(found: Difference) -> str:
    rows = [[(setting.name, ""), _value(setting.first), _value(setting.second)] for setting in found.settings]
    return table(("", *found.runs), rows) if rows else ""


def _value(value: Any) -> tuple[str, str]:
    return ("-", "") if value is None else (str(value), "code")
