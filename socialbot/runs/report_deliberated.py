"""What deliberating agents did, as sections of a page: a film, trees of tasks, a chart of plans, what was wanted."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from socialbot.runs.narration import Sentence
from socialbot.runs.report_gantt import KINDS, Gantt
from socialbot.runs.report_page import SCRIPT, Section, folded, table
from socialbot.runs.report_trees import trees_html
from socialbot.runs.story import DesireTold, PlanTold, RequestTold, Story, WordTold

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


def sections(story: Story, scene: Scene | None = None) -> list[Section]:
    """All that is to be told of a story; ``scene`` is its world. The film needs `scripts` behind it."""
    gantt = Gantt(story)
    asked = "" if story.words else _requests(story)
    return [
        Section("As it went", _stage(story, gantt, scene)),
        Section("The tasks, before and after", trees_html(story), TREES_NOTE),
        Section("Who did what, and when", _chart(gantt), WORDS_NOTE if gantt.has_words else REQUESTS_NOTE),
        Section("What happened", _told(story)),
        *([Section(scene.shots_title, _shots(scene))] if scene is not None else []),
        Section("What was wanted", _desires(story)),
        Section("What was said", _words(story)),
        Section("What was asked of each other", asked),
    ]


def scripts(story: Story, scene: Scene | None = None) -> str:
    """What moves the film, as elements to stand at the end of the page."""
    data = {
        "duration": round(story.duration_s, story.digits),
        "digits": story.digits,
        "film": None if scene is None else scene.film,
        "crane": "" if scene is None else scene.crane,
        "turns": [
            (round(story.seconds(told.stamp), 2), told.agent, told.text)
            for told in story.sentences
            if told.verb in TURNS
        ],
    }
    text = json.dumps(data, separators=(",", ":")).replace("</", "<\\/")
    return f'<script type="application/json" id="data">{text}</script><script>{SCRIPT}</script>'


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


def _stage(story: Story, gantt: Gantt, scene: Scene | None) -> str:
    agents = "".join(f'<dt>{escape(name)}</dt><dd data-agent="{escape(name)}"></dd>' for name in gantt.agents)
    usual = max((n for n in SPEEDS if story.duration_s / n >= FILM_S), default=SPEEDS[0])
    speeds = "".join(f'<option value="{n}"{" selected" if n == usual else ""}>{n}x</option>' for n in SPEEDS)
    end, step = f"{story.duration_s:.{story.digits}f}", 0.1**story.digits
    picture = "" if scene is None else scene.picture
    controls = (
        '<div class="controls"><button>Play</button>'
        f'<input type="range" min="0" max="{end}" step="{step:g}" value="0" aria-label="time">'
        f'<output>{0:.{story.digits}f} s</output><select aria-label="speed">{speeds}</select></div>'
    )
    now = f'<div class="now"><dl style="margin:0">{agents}</dl><div class="turn"></div></div>'
    return f'<div class="stage"><div>{picture}{controls}</div>{now}</div>'


def _shots(scene: Scene) -> str:
    return f'<div class="shots">{"".join(scene.shots)}</div>' if scene.shots else ""


def _chart(gantt: Gantt) -> str:
    names = "".join(f'<div style="height:{high:.0f}px">{escape(name)}</div>' for name, high in gantt.names)
    legend = "".join(
        f'<span class="k{number % KINDS}"><i></i>{escape(action)}</span>' for number, action in enumerate(gantt.actions)
    )
    return (
        f'<div class="key">{legend}</div><div class="gantt-box">'
        f'<div class="names" style="padding-top:28px">{names}</div>'
        f'<div class="scroll" tabindex="0">{gantt.svg()}</div></div>'
    )


def _told(story: Story) -> str:
    turns = [told for told in story.sentences if told.verb in TURNS]
    every = f"All {len(story.sentences)} lines, with every step and request"
    return _sentences(story, turns) + folded(every, _sentences(story, story.sentences))


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
    return table(heads, rows, right=range(3, 8))


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
        parts.append(folded(f"{len(beliefs)} requests about beliefs", _request_table(story, beliefs)))
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
    return table(("asked", "agent", "what", "last answer", "came of it", "id"), rows, right=(0, 3))


def _words(story: Story) -> str:
    """What was said: what is of weight at once, all of it unfolded."""
    if not story.words:
        return ""
    heavy = [word for word in story.words if word.weight]
    return _word_table(story, heavy) + folded(f"All {len(story.words)} messages", _word_table(story, story.words))


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
    return table(("at", "from", "to", "speech act", "what", "about"), rows, right=(0,))


def _at(story: Story, stamp: int) -> str:
    return f"{story.seconds(stamp):.{story.digits}f} s"
