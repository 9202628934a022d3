"""Runs for studies: a table of all records, and tiers of annotations for ELAN.

The format of ELAN is EAF 3.0 (https://www.mpi.nl/tools/elan/EAF_Annotation_Format_3.0_and_ELAN.pdf).
"""

from __future__ import annotations

import csv
import heapq
import io
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import msgspec

from socialbot.core.errors import RunError
from socialbot.core.paths import replace_file, writing
from socialbot.core.terminal import without_controls
from socialbot.runs.folder import RecordedRun
from socialbot.runs.record import VIDEO
from socialbot.runs.visits import visits_of

MOMENT_S = 0.5
"""Duration of an annotation for an event without a duration."""
COLUMNS = ("time_s", "stamp_ns", "frame", "source", "kind", "what", "id", "cause", "detail")

ENDS = {"unbelief": "belief", "achieved": "goal", "failed": "goal", "dropped": "goal"}
"""Kinds of records that end a belief or a goal."""

Annotation = tuple[float, float | None, str]
"""Begin and end (s), and text; events have no end."""


def write_csv(run: RecordedRun, path: Path) -> int:
    """Write a row per record of a run: time, number of the frame, source, kind, text, id, cause and detail as JSON.

    Labels of the run are further columns, the same in every row. A text that a spreadsheet would calculate begins with
    an apostrophe.

    Returns:
        The number of rows.

    Raises:
        RunError: The file cannot be written.
    """
    labels = {_cell(name): _cell(value) for name, value in run.results.get("labels", {}).items()}
    frame = rows = 0
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow([*COLUMNS, *labels])
    for record in run.history:
        rows += 1
        frame += record.kind == "detection"
        seconds = f"{run.history.seconds(record.stamp):.3f}"
        fields = map(_cell, (record.source, record.kind, record.what, record.id, record.cause))
        detail = msgspec.json.encode(record.detail).decode() if record.detail else ""
        writer.writerow([seconds, record.stamp, frame, *fields, detail, *labels.values()])
    with writing(path, RunError, remedy="give another file"):
        replace_file(path, text.getvalue().encode())
    return rows


def _cell(text: str) -> str:
    text = without_controls(text)
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\n")) else text


def write_elan(run: RecordedRun, path: Path) -> int:
    """Write tiers of annotations: visitors, heard and own speech, and the beliefs, goals and actions of each agent.

    The tiers of visitors have the whole visit; a belief lasts until it is removed, speech until it has ended.
    Those that overlap others of their tier are in further tiers.

    Returns:
        The number of annotations.

    Raises:
        RunError: The file cannot be written.
        TruthError: The ground truth beside the bag is unreadable.
    """
    tiers = {
        f"{name} ({number})" if number > 1 else name: found
        for name, annotations in _tiers(run).items()
        for number, found in enumerate(_apart(annotations), 1)
    }
    times = sorted({time for found in tiers.values() for each in found for time in each[:2]})
    document = ElementTree.Element(
        "ANNOTATION_DOCUMENT", AUTHOR="", DATE="1970-01-01T00:00:00+00:00", FORMAT="3.0", VERSION="3.0"
    )
    header = ElementTree.SubElement(document, "HEADER", MEDIA_FILE="", TIME_UNITS="milliseconds")
    if (video := run.folder / VIDEO).is_file():
        ElementTree.SubElement(header, "MEDIA_DESCRIPTOR", MEDIA_URL=video.resolve().as_uri(), MIME_TYPE="video/mp4")
    for name, value in run.results.get("labels", {}).items():
        ElementTree.SubElement(header, "PROPERTY", NAME=without_controls(name)).text = without_controls(value)
    order = ElementTree.SubElement(document, "TIME_ORDER")
    for number, time in enumerate(times, 1):
        ElementTree.SubElement(order, "TIME_SLOT", TIME_SLOT_ID=f"ts{number}", TIME_VALUE=str(time))
    slots = {time: f"ts{number}" for number, time in enumerate(times, 1)}
    count = 0
    for name, found in tiers.items():
        tier = ElementTree.SubElement(
            document, "TIER", LINGUISTIC_TYPE_REF="default-lt", TIER_ID=without_controls(name)
        )
        for begin, end, text in found:
            count += 1
            annotation = ElementTree.SubElement(
                ElementTree.SubElement(tier, "ANNOTATION"), "ALIGNABLE_ANNOTATION",
                ANNOTATION_ID=f"a{count}", TIME_SLOT_REF1=slots[begin], TIME_SLOT_REF2=slots[end],
            )  # fmt: skip
            ElementTree.SubElement(annotation, "ANNOTATION_VALUE").text = without_controls(text)
    ElementTree.SubElement(
        document, "LINGUISTIC_TYPE", LINGUISTIC_TYPE_ID="default-lt", TIME_ALIGNABLE="true", GRAPHIC_REFERENCES="false"
    )
    ElementTree.indent(document)
    with writing(path, RunError, remedy="give another file"):
        replace_file(path, ElementTree.tostring(document, encoding="utf-8", xml_declaration=True))
    return count


def _tiers(run: RecordedRun) -> dict[str, list[Annotation]]:
    tiers: dict[str, list[Annotation]] = {}
    for visit in visits_of(run)[0]:
        text = visit.outcome if visit.nearest_m is None else f"{visit.outcome}, {visit.nearest_m:.1f} m"
        tiers.setdefault(f"visitor {visit.person}", []).append((visit.came_s, visit.left_s, text))
    for name, annotation in (*_spoken(run), *_thought(run)):
        tiers.setdefault(name, []).append(annotation)
    return tiers


def _spoken(run: RecordedRun) -> Iterator[tuple[str, Annotation]]:
    """Yield heard sentences by their speaker, and utterances, each until its speech has ended."""
    for record in run.history:
        if record.kind == "hearing":
            speaker = f"heard from {who}" if (who := record.detail.get("person")) else "heard"
            begin_s = run.history.seconds(int(record.detail.get("start", record.stamp)))
            yield speaker, (max(begin_s, 0.0), run.history.seconds(record.stamp), record.what)
        elif record.kind == "utterance":
            states = [each for each in run.history.effects(record) if each.kind == "speech"]
            begin = min((each.stamp for each in states if each.what == "started"), default=record.stamp)
            end = max((each.stamp for each in states), default=0)
            begin_s, end_s = run.history.seconds(begin), run.history.seconds(end)
            yield "speech", (begin_s, end_s if end > begin else None, record.what)


def _thought(run: RecordedRun) -> Iterator[tuple[str, Annotation]]:
    """Yield the beliefs and goals of each agent until they end, and its actions."""
    held: dict[tuple[str, str, str], tuple[str, float]] = {}
    for record in run.history:
        at_s, key = run.history.seconds(record.stamp), (record.source, ENDS.get(record.kind, record.kind), record.what)
        if record.kind == "action":
            yield f"{record.source}: actions", (at_s, None, record.what)
        elif record.kind in ENDS.values():
            tier = f"{record.source}: {record.kind}s"
            if record.kind == "belief":
                tier += f", {record.what.partition('(')[0]}"
            held.setdefault(key, (tier, at_s))
        elif key in held:
            tier, began_s = held.pop(key)
            yield tier, (began_s, at_s, record.what)
    for (_, _, what), (tier, began_s) in held.items():
        yield tier, (began_s, run.history.duration_s, what)


def _apart(found: list[Annotation]) -> list[list[tuple[int, int, str]]]:
    """Return annotations in ms in groups that do not overlap, as tiers require.

    Events last `MOMENT_S`, or until the next annotation begins.
    """
    begins = sorted({round(begin_s * 1000) for begin_s, _, _ in found})
    following = dict(pairwise(begins))
    groups: list[list[tuple[int, int, str]]] = []
    busy: list[tuple[int, int]] = []
    free: list[int] = []
    """Ends and places of the last annotations of groups, and the places of groups that have ended."""
    for begin_s, end_s, text in sorted(found, key=lambda each: each[0]):
        begin = round(begin_s * 1000)
        moment = begin + round(MOMENT_S * 1000)
        end = min(moment, following.get(begin, moment)) if end_s is None else max(round(end_s * 1000), begin + 1)
        while busy and busy[0][0] <= begin:
            heapq.heappush(free, heapq.heappop(busy)[1])
        if not free:
            groups.append([])
        place = heapq.heappop(free) if free else len(groups) - 1
        groups[place].append((begin, end, text))
        heapq.heappush(busy, (end, place))
    return groups
