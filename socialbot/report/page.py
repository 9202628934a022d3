"""The page of a run (HTML), which needs nothing else: a film, a chart of all plans, what happened and why."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from socialbot.report.gantt import KINDS, Gantt
from socialbot.report.narration import Sentence
from socialbot.report.story import DesireTold, PlanTold, RequestTold, Story, WordTold
from socialbot.report.style import SCRIPT, STYLE
from socialbot.report.trees import trees_html

TURNS = ("wants", "plans", "reached", "fails", "drops", "refuses", "senses")
"""Verbs of what is told at once; steps and requests are unfolded."""

SPEEDS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
FILM_S = 20.0
"""A film is shown as fast as it can be seen in no less than this, s."""

TREES_NOTE = (
    "Tasks with the method that does them, and actions: ✓ done, ✗ failed, · to be done, ✚ new in this plan; what is "
    "crossed out belongs to a way that was given up."
)
REQUESTS_NOTE = (
    "Bands are plans, bars their steps; the thin line below a bar is when the plan had it. Arrows are requests: "
    "solid for a desire, dotted for a belief; green is the news that a desire was reached. Red lines: a plan was "
    "given up. A click moves the film."
)
WORDS_NOTE = (
    "Bands are plans (↻: a new one after another was given up), bars what was done because of them. Arrows are "
    "messages: solid for a plan, dotted for a word between partners, red for a problem. Red lines: a plan was given "
    "up. A click moves the film."
)

HOW_WELL = {"fulfilled": "good", "dropped": "bad", "refused": "bad"}


@dataclass(frozen=True)
class Scene:
    """What is shown of the world: a picture in which things move (groups with ``data-name``), how they move, and shots.

    ``film`` has, by the names of groups, ``robots``: moments of s, x and y. It may have ``boxes``, which also have a
    height, ``holding``, when the gripper has one, and ``faces``: moments of s and the number of what a group looks like
    from then on, among the ``drawings``. ``crane`` is the name of what runs on the bridge, if there is one.
    """

    picture: str
    film: Mapping[str, Any]
    crane: str = ""
    shots: Sequence[str] = ()
    shots_title: str = "The floor at the turns"


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
        gantt, kind, story = Gantt(self.story), "" if self.good else " bad", self.story
        parts = [
            f'<h1>{escape(self.title)}<span class="mark{kind}">{escape(self.verdict)}</span></h1>',
            f'<p class="lead">{escape(self.lead)}</p>',
            _tiles(self.tiles),
            "<h2>As it went</h2>",
            self._stage(gantt),
            *_section("The tasks, before and after", TREES_NOTE, trees_html(story)),
            "<h2>Who did what, and when</h2>",
            _chart(gantt),
            "<h2>What happened</h2>",
            _told(story),
            *self._shots(),
            "<h2>What was wanted</h2>",
            _desires(story),
            *_section("What was said", "", _words(story)),
            *([] if story.words else ["<h2>What was asked of each other</h2>", _requests(story)]),
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
        usual = max((n for n in SPEEDS if self.story.duration_s / n >= FILM_S), default=SPEEDS[0])
        speeds = "".join(f'<option value="{n}"{" selected" if n == usual else ""}>{n}x</option>' for n in SPEEDS)
        end, step = f"{self.story.duration_s:.{self.story.digits}f}", 0.1**self.story.digits
        picture = "" if self.scene is None else self.scene.picture
        controls = (
            '<div class="controls"><button>Play</button>'
            f'<input type="range" min="0" max="{end}" step="{step:g}" value="0" aria-label="time">'
            f'<output>{0:.{self.story.digits}f} s</output><select aria-label="speed">{speeds}</select></div>'
        )
        now = f'<div class="now"><dl style="margin:0">{agents}</dl><div class="turn"></div></div>'
        return f'<div class="stage"><div>{picture}{controls}</div>{now}</div>'

    def _shots(self) -> Iterable[str]:
        if self.scene is not None and self.scene.shots:
            yield f"<h2>{escape(self.scene.shots_title)}</h2>"
            yield f'<div class="shots">{"".join(self.scene.shots)}</div>'

    def _data(self) -> str:
        story = self.story
        data = {
            "duration": round(story.duration_s, story.digits),
            "digits": story.digits,
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
        said = "." if planned_s is None else f"; its first plan said {planned_s:.1f} s."
        told += f" and reached it after {took_s:.1f} s{said}"
    elif first.how:
        told += f", which was {first.how}: {first.reason}."
    else:
        told += " and was still at it when the run ended."
    if len(story.aims) > 1:
        reached = sum(desire.how == "fulfilled" for desire in story.aims)
        told += f" Of {len(story.aims)} desires, {reached} were fulfilled."
    given_up = [plan for plan in story.plans if plan.given_up]
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
    note = WORDS_NOTE if gantt.has_words else REQUESTS_NOTE
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
        f'<li class="v-{each.verb}"><time data-t="{story.seconds(each.stamp):.2f}">{_at(story, each.stamp)}'
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
    ended = "" if desire.ended is None else _at(story, desire.ended)
    how = (desire.how or "still wanted") + (f": {desire.reason}" if desire.reason else "")
    return [
        (desire.agent, ""),
        (desire.name, ""),
        (desire.why, ""),
        ("" if desire.priority is None else f"{desire.priority:g}", "r"),
        ("" if desire.deadline_s is None else f"{desire.deadline_s:g} s", "r"),
        (_at(story, desire.adopted), "r"),
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
            (_at(story, request.asked), "r"),
            (request.sender, ""),
            (request.text, ""),
            ("" if request.ended is None else _at(story, request.ended), "r"),
            (
                request.state + (f": {request.reason}" if request.reason else ""),
                {"fulfilled": "good", "refused": "bad", "timeout": "bad", "dropped": "bad"}.get(request.state, ""),
            ),
            (request.id, ""),
        ]
        for request in requests
    ]
    return _table(("asked", "agent", "what", "last answer", "came of it", "id"), rows, right=(0, 3))


def _words(story: Story) -> str:
    """What was said: what is of weight at once, all of it unfolded."""
    if not story.words:
        return ""
    heavy = [word for word in story.words if word.weight]
    summary = f"<summary>All {len(story.words)} messages</summary>"
    return f"{_word_table(story, heavy)}<details>{summary}{_word_table(story, story.words)}</details>"


def _word_table(story: Story, words: Iterable[WordTold]) -> str:
    rows = [
        [
            (_at(story, word.stamp), "r"),
            (word.sender, ""),
            (word.receiver, ""),
            (f"{word.performative} {word.content}", "code"),
            (word.text, "bad" if word.weight == "problem" else ""),
            (word.about, ""),
        ]
        for word in words
    ]
    return _table(("at", "from", "to", "speech act", "what", "about"), rows, right=(0,))


def _section(title: str, note: str, content: str) -> list[str]:
    """A section with its heading, if there is anything to tell."""
    told = [f'<p class="note">{note}</p>'] if note else []
    return [f"<h2>{title}</h2>", *told, content] if content else []


def _at(story: Story, stamp: int) -> str:
    return f"{story.seconds(stamp):.{story.digits}f} s"


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
