"""The page of a run (HTML), which needs nothing else: a film, a chart of all plans, what happened and why."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from socialbot.report.gantt import KINDS, Gantt
from socialbot.report.narration import Sentence
from socialbot.report.story import DesireTold, PlanTold, RequestTold, Story
from socialbot.report.style import SCRIPT, STYLE

TURNS = ("wants", "plans", "reached", "fails", "drops", "refuses", "senses")
"""Verbs of what is told at once; steps and requests are unfolded."""

HOW_WELL = {"fulfilled": "good", "dropped": "bad", "refused": "bad"}


@dataclass(frozen=True)
class Scene:
    """What is shown of the world: a picture in which things move (groups with ``data-name``), how they move, and shots.

    ``film`` is as `socialbot.agents.warehouse.film` makes it; ``crane`` the name of what runs on the bridge.
    """

    picture: str
    film: Mapping[str, Any]
    crane: str
    shots: Sequence[str] = ()


@dataclass(frozen=True)
class Page:
    """All that is on a page. ``tiles`` are figures with what they count, ``setting`` is the configuration by name."""

    title: str
    lead: str
    good: bool
    verdict: str
    story: Story
    tiles: Sequence[tuple[str, str]] = ()
    scene: Scene | None = None
    setting: Mapping[str, object] = field(default_factory=dict)

    def html(self) -> str:
        """The page."""
        gantt, kind = Gantt(self.story), "" if self.good else " bad"
        parts = [
            f'<h1>{escape(self.title)}<span class="mark{kind}">{escape(self.verdict)}</span></h1>',
            f'<p class="lead">{escape(self.lead)}</p>',
            _tiles(self.tiles),
            "<h2>As it went</h2>",
            self._stage(gantt),
            "<h2>Who did what, and when</h2>",
            _chart(gantt),
            "<h2>What happened</h2>",
            _told(self.story),
            *self._shots(),
            "<h2>What was wanted</h2>",
            _desires(self.story),
            "<h2>What was asked of each other</h2>",
            _requests(self.story),
            "<h2>How it was run</h2>",
            _setting(self.setting),
            f'<script type="application/json" id="data">{self._data()}</script>',
            f"<script>{SCRIPT}</script>",
        ]
        head = (
            '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
            f'<meta name="color-scheme" content="light dark"><title>{escape(self.title)}</title>'
        )
        head += f"<style>{STYLE}</style>"
        body = "\n".join(parts)
        return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'

    def _stage(self, gantt: Gantt) -> str:
        agents = "".join(f'<dt>{escape(name)}</dt><dd data-agent="{escape(name)}"></dd>' for name in gantt.agents)
        speeds = "".join(f'<option value="{n}"{" selected" if n == 5 else ""}>{n}x</option>' for n in (1, 2, 5, 10, 20))
        end = f"{self.story.duration_s:.1f}"
        picture = "" if self.scene is None else self.scene.picture
        controls = (
            '<div class="controls"><button>Play</button>'
            f'<input type="range" min="0" max="{end}" step="0.1" value="0" aria-label="time">'
            f'<output>0.0 s</output><select aria-label="speed">{speeds}</select></div>'
        )
        now = f'<div class="now"><dl style="margin:0">{agents}</dl><div class="turn"></div></div>'
        return f'<div class="stage"><div>{picture}{controls}</div>{now}</div>'

    def _shots(self) -> Iterable[str]:
        if self.scene is not None and self.scene.shots:
            yield "<h2>The floor at the turns</h2>"
            yield f'<div class="shots">{"".join(self.scene.shots)}</div>'

    def _data(self) -> str:
        story = self.story
        data = {
            "duration": round(story.duration_s, 1),
            "film": None if self.scene is None else self.scene.film,
            "crane": "" if self.scene is None else self.scene.crane,
            "turns": [
                (round(story.seconds(told.stamp), 2), told.agent, told.text)
                for told in story.sentences
                if told.verb in TURNS
            ],
        }
        return json.dumps(data, separators=(",", ":")).replace("</", "<\\/")


def lead_of(story: Story) -> str:
    """What a run came to, in two or three sentences."""
    first = story.first
    if first is None:
        return "Nobody wanted anything."
    planned_s, took_s = story.makespans_s(first)
    told = f"{first.agent} wanted {first.name}"
    if first.how == "fulfilled" and took_s is not None:
        told += f" and reached it after {took_s:.1f} s; its first plan said {planned_s:.1f} s."
    elif first.how:
        told += f", which was {first.how}: {first.reason}."
    else:
        told += " and was still at it when the run ended."
    given_up = [plan for plan in story.plans if plan.outcome in ("failed", "aborted", "lost")]
    if given_up:
        first_at = f"{story.seconds(given_up[0].ended or 0):.1f} s: {_why(story, given_up[0])}."
        one = len(given_up) == 1
        told += (
            f" One plan was given up, at {first_at}"
            if one
            else f" {len(given_up)} plans were given up, first at {first_at}"
        )
    else:
        told += " No plan was given up."
    return told


def _why(story: Story, plan: PlanTold) -> str:
    """Why a plan was given up: in the words of the step that failed, if one did."""
    failed = (step for step in story.steps if step.plan is plan and step.outcome == "failed")
    step = next((step for step in failed if step.ended == plan.ended), None)
    return plan.reason if step is None else f"{step.agent} {step.text}, {step.message}"


def _tiles(tiles: Sequence[tuple[str, str]]) -> str:
    inner = "".join(
        f'<div class="tile"><b>{escape(figure)}</b><span>{escape(what)}</span></div>' for figure, what in tiles
    )
    return f'<div class="tiles">{inner}</div>'


def _chart(gantt: Gantt) -> str:
    names = "".join(f'<div style="height:{high:.0f}px">{escape(name)}</div>' for name, high in gantt.names)
    legend = "".join(
        f'<span class="k{number % KINDS}"><i></i>{escape(action)}</span>' for number, action in enumerate(gantt.actions)
    )
    note = (
        "Bands are plans, bars their steps; the thin line below a bar is when the plan had it. Arrows are requests: "
        "solid for a desire, dotted for a belief; green is the news that a desire was reached. Red lines: a plan was "
        "given up. A click moves the film."
    )
    return (
        f'<p class="note">{note}</p><div class="key">{legend}</div>'
        f'<div class="gantt-box"><div class="names" style="padding-top:28px">{names}</div>'
        f'<div class="scroll">{gantt.svg()}</div></div>'
    )


def _told(story: Story) -> str:
    turns = [told for told in story.sentences if told.verb in TURNS]
    return (
        f"{_sentences(story, turns)}<details><summary>All {len(story.sentences)} lines, with every step and request"
        f"</summary>{_sentences(story, story.sentences)}</details>"
    )


def _sentences(story: Story, told: Iterable[Sentence]) -> str:
    lines = "".join(
        f'<li class="v-{each.verb}"><time data-t="{story.seconds(each.stamp):.2f}">{story.seconds(each.stamp):.1f} s'
        f"</time><b>{escape(each.agent)}</b><span>{escape(each.text)}</span></li>"
        for each in told
    )
    return f'<ol class="told">{lines}</ol>'


def _desires(story: Story) -> str:
    rows = []
    for desire in story.desires:
        plans = [
            plan
            for plan in story.plans
            if (plan.agent, plan.desire) == (desire.agent, desire.name)
            and desire.adopted <= plan.began <= (story.end if desire.ended is None else desire.ended)
        ]
        rows.append(_desire(story, desire, len(plans)))
    heads = ("agent", "desire", "came from", "priority", "deadline", "from", "to", "plans", "how it ended")
    return _table(heads, rows, right=range(3, 8))


def _desire(story: Story, desire: DesireTold, plans: int) -> list[tuple[str, str]]:
    ended = "" if desire.ended is None else f"{story.seconds(desire.ended):.1f} s"
    how = (desire.how or "still wanted") + (f": {desire.reason}" if desire.reason else "")
    return [
        (desire.agent, ""),
        (desire.name, ""),
        (desire.why, ""),
        ("" if desire.priority is None else f"{desire.priority:g}", "r"),
        ("" if desire.deadline_s is None else f"{desire.deadline_s:g} s", "r"),
        (f"{story.seconds(desire.adopted):.1f} s", "r"),
        (ended, "r"),
        (str(plans), "r"),
        (how, HOW_WELL.get(desire.how, "")),
    ]


def _requests(story: Story) -> str:
    if not story.requests:
        return '<p class="note">Nothing.</p>'
    desires = [request for request in story.requests if request.about_desire]
    beliefs = [request for request in story.requests if not request.about_desire]
    parts = [_request_table(story, desires)] if desires else []
    if beliefs:
        what = f"<summary>{len(beliefs)} requests about beliefs</summary>"
        parts.append(f"<details>{what}{_request_table(story, beliefs)}</details>")
    return "".join(parts)


def _request_table(story: Story, requests: Iterable[RequestTold]) -> str:
    rows = [
        [
            (f"{story.seconds(request.asked):.1f} s", "r"),
            (request.sender, ""),
            (request.text, ""),
            ("" if request.ended is None else f"{story.seconds(request.ended):.1f} s", "r"),
            (
                request.state + (f": {request.reason}" if request.reason else ""),
                {"fulfilled": "good", "refused": "bad", "timeout": "bad", "dropped": "bad"}.get(request.state, ""),
            ),
            (request.id, ""),
        ]
        for request in requests
    ]
    return _table(("asked", "agent", "what", "last answer", "came of it", "id"), rows, right=(0, 3))


def _setting(setting: Mapping[str, object]) -> str:
    rows = [[(name, ""), (str(value), "code")] for name, value in setting.items()]
    return _table(("", ""), rows, right=())


def _table(heads: Sequence[str], rows: Iterable[Sequence[tuple[str, str]]], *, right: Sequence[int]) -> str:
    top = "".join(f'<th class="{"r" if n in right else ""}">{escape(head)}</th>' for n, head in enumerate(heads))
    lines = "".join(f"<tr>{''.join(_cell(text, kind) for text, kind in row)}</tr>" for row in rows)
    thead = f"<thead><tr>{top}</tr></thead>" if any(heads) else ""
    return f'<div class="wide"><table>{thead}<tbody>{lines}</tbody></table></div>'


def _cell(text: str, kind: str) -> str:
    if kind == "code":
        return f"<td><code>{escape(text)}</code></td>"
    return f'<td class="{kind}">{escape(text)}</td>'
