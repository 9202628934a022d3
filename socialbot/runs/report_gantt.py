"""A chart of all plans of a run (SVG): a lane for each agent, a band for each plan, a bar for each step."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from html import escape
from typing import TypeVar

from socialbot.core.clock import SECOND
from socialbot.runs.story import PlanTold, RequestTold, StepTold, Story, WordTold

T = TypeVar("T", PlanTold, StepTold)

ROOM_PX = 1120.0
"""Pixels that a chart is wide, as long as a second has at least `LEAST_PX` and at most `MOST_PX` of them."""
LEAST_PX, MOST_PX = 6.0, 240.0

TOP, BAND, BAR, PLANNED, GAP, BETWEEN = 34.0, 20.0, 18.0, 5.0, 4.0, 22.0
LETTER_PX = 6.8
KINDS = 10
"""So many colours there are for actions."""


class Gantt:
    """The chart of a story; ``names`` are its lanes with their height in pixels, from top to bottom."""

    def __init__(self, story: Story) -> None:
        self._story = story
        self.agents = _in_order(story)
        self.scale = min(max(ROOM_PX / max(story.duration_s, 1.0), LEAST_PX), MOST_PX)
        self.width = story.duration_s * self.scale + 40
        self.actions = list(dict.fromkeys(step.action for step in story.steps))
        self._bands = {agent: _packed(story.plans, agent, _plan_began, story.end) for agent in self.agents}
        self._rows = {agent: _packed(story.steps, agent, _began, story.end) for agent in self.agents}
        self._tops: dict[str, float] = {}
        y = TOP
        for agent in self.agents:
            self._tops[agent] = y
            y += self._height(agent)
        self.height = y
        self.names = [(agent, self._height(agent)) for agent in self.agents]

    @property
    def has_words(self) -> bool:
        """Whether its arrows are words, and not requests."""
        return bool(self._story.words)

    def svg(self) -> str:
        """The chart."""
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" class="gantt" role="img" width="{self.width:.0f}" '
            f'height="{self.height:.0f}" viewBox="0 0 {self.width:.0f} {self.height:.0f}" '
            f'font-family="system-ui, sans-serif" data-scale="{self.scale:.4f}"><title>Who did what, and when</title>',
            *self._axis(),
            *(part for agent in self.agents for part in self._lane(agent)),
            *(part for request in self._story.requests for part in self._request(request)),
            *(self._word(word) for word in self._words()),
            *self._turns(),
            f'<line class="cursor" x1="0" x2="0" y1="18" y2="{self.height:.0f}"/>',
            "</svg>",
        ]
        return "\n".join(parts)

    def kind(self, action: str) -> int:
        """The number of an action's colour."""
        return self.actions.index(action) % KINDS

    def _height(self, agent: str) -> float:
        return self._bands_height(agent) + len(self._rows[agent]) * (BAR + PLANNED + GAP) + BETWEEN

    def _bands_height(self, agent: str) -> float:
        return len(self._bands[agent]) * (BAND + GAP)

    def _x(self, time: int) -> float:
        return self._story.seconds(time) * self.scale

    def _axis(self) -> Iterator[str]:
        each = next(step for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 5000) if step * self.scale >= 46)
        for second in range(0, int(self._story.duration_s) + 1, each):
            x = second * self.scale
            yield f'<line class="tick" x1="{x:.1f}" x2="{x:.1f}" y1="20" y2="{self.height:.0f}"/>'
            yield f'<text class="axis" x="{x + 3:.1f}" y="14">{second} s</text>'

    def _lane(self, agent: str) -> Iterator[str]:
        top, high = self._tops[agent], self._height(agent) - 8
        yield f'<rect class="lane" x="0" y="{top - 6:.1f}" width="{self.width:.1f}" height="{high:.1f}"/>'
        for number, bands in enumerate(self._bands[agent]):
            yield from (self._band(plan, top + number * (BAND + GAP)) for plan in bands)
        for number, row in enumerate(self._rows[agent]):
            y = top + self._bands_height(agent) + number * (BAR + PLANNED + GAP)
            for step in row:
                yield from self._step(step, y)

    def _band(self, plan: PlanTold, y: float) -> str:
        x, end = self._x(plan.began), self._x(self._story.end if plan.ended is None else plan.ended)
        lasted_s = (end - x) / self.scale
        told = f"plan {plan.number} for {plan.desire}: {plan.outcome or 'goes on'}"
        planned = "" if plan.makespan_s is None else f"planned {plan.makespan_s:.1f} s, "
        more = f"{len(plan.plan.steps)} steps, {planned}lasted {lasted_s:.1f} s"
        again = "↻ " if plan.again else ""
        label = again + _fitting(end - x - 10, f"plan {plan.number} · {plan.desire}", plan.desire, f"{plan.number}")
        sign = " ✗" if plan.given_up else ""
        return (
            f'<g class="plan {plan.outcome or "open"}"><title>{escape(told)}\n{escape(more)}'
            f"{escape(f'{chr(10)}{plan.reason}' if plan.reason else '')}</title>"
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(end - x, 2):.1f}" height="{BAND}" rx="4"/>'
            f'<text x="{x + 6:.1f}" y="{y + 14:.1f}">{escape(label + sign)}</text></g>'
        )

    def _step(self, step: StepTold, y: float) -> Iterator[str]:
        began = step.began if step.began is not None else step.ended or 0
        x, end = self._x(began), self._x(self._story.end if step.ended is None else step.ended)
        wide = max(end - x - 1, 3.0)
        lines = [f"{step.agent} {step.text}", f"from {x / self.scale:.1f} s to {end / self.scale:.1f} s"]
        if step.plan is not None and step.planned is not None:
            first = self._story.seconds(step.plan.began) + step.planned.start_s
            last = first + step.planned.duration_s
            lines.append(f"planned from {first:.1f} s to {last:.1f} s")
            yield (
                f'<rect class="planned k{self.kind(step.action)}" x="{first * self.scale:.1f}" y="{y + BAR + 1:.1f}" '
                f'width="{max((last - first) * self.scale - 1, 1):.1f}" height="{PLANNED - 1}" rx="1"/>'
            )
        lines.append(f"{step.outcome or 'goes on'}{f': {step.message}' if step.message else ''}")
        label = _fitting(wide - 8, *_labels(step.text))
        failed = step.outcome in ("failed", "lost")
        mark = f'<text class="cross" x="{end - 4:.1f}" y="{y + 14:.1f}">✗</text>' if failed else ""
        yield (
            f'<g class="step k{self.kind(step.action)} {step.outcome or "open"}" data-from="{x / self.scale:.2f}" '
            f'data-to="{end / self.scale:.2f}" data-agent="{escape(step.agent)}" data-text="{escape(step.text)}">'
            f"<title>{escape(chr(10).join(lines))}</title>"
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{BAR}" rx="3"/>'
            f'<text x="{x + 4:.1f}" y="{y + 13:.1f}">{escape(label)}</text>{mark}</g>'
        )

    def _request(self, request: RequestTold) -> Iterator[str]:
        if request.sender not in self._tops or request.receiver not in self._tops:
            return
        x, (start, end) = self._x(request.asked), self._between(request.sender, request.receiver)
        kind = "desire" if request.about_desire else "belief"
        bad = " bad" if request.state in ("refused", "timeout", "dropped") else ""
        told = f"{request.sender} {request.text}: {request.state}{f', {request.reason}' if request.reason else ''}"
        head = _head(x, end, 5 if end > start else -5)
        yield (
            f'<g class="request {kind}{bad}"><title>{escape(told)}</title>'
            f'<path d="M{x:.1f} {start:.1f}V{end:.1f}"/><path class="head" d="{head}"/></g>'
        )
        if request.about_desire and request.state == "fulfilled" and request.ended is not None:
            back = self._x(request.ended)
            yield (
                f'<g class="request done"><title>{escape(told)}</title><path d="M{back:.1f} {end:.1f}V{start:.1f}"/>'
                f'<circle cx="{back:.1f}" cy="{start:.1f}" r="3"/></g>'
            )

    def _words(self) -> Iterator[WordTold]:
        """What was said to one who has a lane, and is of weight."""
        return (word for word in self._story.words if word.weight and {word.sender, word.receiver} <= set(self._tops))

    def _word(self, word: WordTold) -> str:
        x, (start, end) = self._x(word.stamp), self._between(word.sender, word.receiver)
        head = _head(x, end, 5 if end > start else -5)
        return (
            f'<g class="request {word.weight}"><title>{escape(f"{word.sender} {word.text}")}</title>'
            f'<path d="M{x:.1f} {start:.1f}V{end:.1f}"/><path class="head" d="{head}"/></g>'
        )

    def _between(self, sender: str, receiver: str) -> tuple[float, float]:
        """Where an arrow from one lane to another begins and ends."""
        down = self._tops[receiver] > self._tops[sender]
        bottom = self._tops[sender] + self._height(sender) - BETWEEN
        if down:
            return bottom, self._tops[receiver]
        return self._tops[sender], self._tops[receiver] + self._height(receiver) - BETWEEN

    def _turns(self) -> Iterator[str]:
        """Marks the moments at which plans were given up."""
        for plan in self._story.plans:
            if plan.given_up and plan.ended is not None:
                x = self._x(plan.ended)
                yield f'<line class="turn" x1="{x:.1f}" x2="{x:.1f}" y1="20" y2="{self.height:.0f}"/>'


def _in_order(story: Story) -> list[str]:
    """First the agents with plans for what the run was about, then the others by name."""
    aims = {(desire.agent, desire.name) for desire in story.aims}
    first = list(dict.fromkeys(plan.agent for plan in story.plans if (plan.agent, plan.desire) in aims))
    return [*first, *sorted(set(story.agents) - set(first), key=_by_number)]


def _by_number(name: str) -> list[str | int]:
    """What names are sorted by: carrier_10 comes after carrier_9."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _packed(told: Sequence[T], agent: str, began: Callable[[T], int], end: int) -> list[list[T]]:
    """What is told of an agent in rows, so that those of a row follow each other."""
    rows: list[list[T]] = []
    free: list[int] = []
    for each in sorted((each for each in told if each.agent == agent), key=began):
        number = next((n for n, since in enumerate(free) if since <= began(each) + SECOND // 20), len(rows))
        if number == len(rows):
            rows.append([])
            free.append(0)
        rows[number].append(each)
        free[number] = end if each.ended is None else each.ended
    return rows


def _plan_began(plan: PlanTold) -> int:
    return plan.began


def _began(step: StepTold) -> int:
    return step.began if step.began is not None else step.ended or 0


def _head(x: float, y: float, point: float) -> str:
    """The head of an arrow that points down, or up where ``point`` is negative."""
    return f"M{x - 3.5:.1f} {y - point:.1f}L{x:.1f} {y:.1f}L{x + 3.5:.1f} {y - point:.1f}z"


def _labels(text: str) -> Iterator[str]:
    """What a bar may say, the longest first: the whole phrase, what it is about, and the end of that name."""
    yield text
    things = [word for word in text.split() if "_" in word] or text.split()[-1:]
    thing = things[-1] if " to " in text else things[0]
    yield thing
    yield thing.rpartition("_")[2]


def _fitting(room: float, *labels: str) -> str:
    """The first of some labels for which there is room, in pixels; an empty text if there is for none."""
    return next((label for label in labels if len(label) * LETTER_PX <= room), "")
