"""Make an animation of a recorded run with images: ``python tools/animate.py RUN PICTURE.webp``.

The README shows ``socialbot replay data/synthetic/corridor --runner inline``. Needs pillow.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection
from socialbot.runs.report import recorded
from socialbot.runs.state import AgentMind, HeadView, RunState

SIZE = (720, 360)
SCENE = (480, 360)
"""Size of the camera image (px)."""
MARGIN = 14
SHOWN_S = 2.5
"""Display time of finished actions and of utterances."""

PAPER, INK, FADED, MARKED, SKIN = "#fffaf4", "#2b2420", "#94877d", "#b8502a", "#c96f4a"

Canvas = ImageDraw.ImageDraw


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font of pillow in ``size``."""
    return ImageFont.load_default(size)


def frame(moment: RunState, jpeg: bytes, did: Sequence[str]) -> Image.Image:
    """Draw the state of a run: detections and speech on the left, beliefs and actions (``did``) on the right."""
    picture = Image.new("RGB", SIZE, PAPER)
    scene = Image.open(io.BytesIO(jpeg)).convert("RGB")
    scale = SCENE[0] / scene.width
    picture.paste(scene.resize(SCENE), (0, 0))
    canvas = ImageDraw.Draw(picture)
    for person in moment.sight.persons if moment.sight else ():
        draw_person(canvas, person, scale)
    draw_robot(canvas, moment.head)
    said = [spoken.text for spoken in moment.speech if moment.at_s - spoken.since_s < SHOWN_S]
    if said:
        draw_bubble(canvas, said[-1])
    draw_mind(canvas, moment.at_s, moment.agents[0] if moment.agents else None, sights(moment), did)
    return picture


def sights(moment: RunState) -> list[str]:
    """List the detected people as text."""
    persons = moment.sight.persons if moment.sight else ()
    return [f"{person.track_id}, {person.distance_m:.1f} m away" for person in persons if person.distance_m is not None]


def draw_person(canvas: Canvas, person: PersonDetection, scale: float) -> None:
    """Draw a box with id and distance."""
    left, top, right, bottom = (
        scale * value for value in (person.x, person.y, person.x + person.w, person.y + person.h)
    )
    canvas.rectangle((left, top, right, bottom), outline=SKIN, width=3)
    text = person.track_id if person.distance_m is None else f"{person.track_id}  {person.distance_m:.1f} m"
    label = canvas.textbbox((left + 5, max(top - 19, 2)), text, font=font(13))
    canvas.rectangle((label[0] - 5, label[1] - 3, label[2] + 5, label[3] + 3), fill=SKIN)
    canvas.text((left + 5, max(top - 19, 2)), text, font=font(13), fill="white")


def draw_robot(canvas: Canvas, head: HeadView | None) -> None:
    """Draw the face of Waldo at the bottom left; its eyes are wide open while it tracks a person."""
    left, top = MARGIN, SCENE[1] - 68
    wide = 6 if head is not None and head.mode == "track" else 3
    canvas.line((left + 28, top, left + 28, top - 10), fill=SKIN, width=4)
    canvas.ellipse((left + 23, top - 15, left + 33, top - 5), fill=SKIN)
    canvas.rounded_rectangle((left, top, left + 56, top + 54), 12, fill=SKIN, outline=PAPER, width=2)
    for x in (left + 18, left + 38):
        canvas.ellipse((x - 6, top + 22 - wide, x + 6, top + 22 + wide), fill="white")
    canvas.arc((left + 16, top + 24, left + 40, top + 46), 20, 160, fill="white", width=3)


def draw_bubble(canvas: Canvas, text: str) -> None:
    """Draw the current utterance beside the face."""
    left, top = MARGIN + 78, SCENE[1] - 70
    box = canvas.textbbox((left + 12, top + 10), text, font=font(18))
    canvas.rounded_rectangle((left, top, box[2] + 12, box[3] + 11), 10, fill="white", outline=INK, width=2)
    canvas.polygon([(left + 1, top + 12), (left - 14, top + 24), (left + 1, top + 26)], fill="white")
    canvas.line([(left, top + 12), (left - 14, top + 24), (left, top + 26)], fill=INK, width=2)
    canvas.text((left + 12, top + 10), text, font=font(18), fill=INK)


def draw_mind(canvas: Canvas, at_s: float, agent: AgentMind | None, seen: Sequence[str], did: Sequence[str]) -> None:
    """Draw percepts, beliefs, desires and actions, with new ones highlighted."""
    x, y = SCENE[0] + MARGIN, MARGIN
    canvas.text((x, y), f"{at_s:.1f} s", font=font(15), fill=FADED)
    beliefs = agent.beliefs if agent else ()
    ended = [one for one in agent.ended if at_s - one.at_s < SHOWN_S] if agent else []
    y += 28
    for title, lines in (
        ("sees", [(text, False) for text in seen]),
        ("believes", [(held.text, at_s - held.since_s < SHOWN_S) for held in beliefs]),
        ("wanted", [(one.text, True) for one in ended if one.kind == "goal"]),
        ("did", [(text, True) for text in did]),
    ):
        canvas.text((x, y), title, font=font(13), fill=FADED)
        y += 19
        for text, new in lines:
            canvas.text((x + 8, y), text, font=font(15), fill=MARKED if new else INK)
            y += 20
        y += 10


def frames(folder: Path, begin_s: float, end_s: float, rate_hz: float) -> Iterator[Image.Image]:
    """Yield the frames from ``begin_s`` to ``end_s``."""
    with recorded(folder) as run:
        for number in range(round((end_s - begin_s) * rate_hz)):
            stamp = run.history.start + round((begin_s + number / rate_hz) * SECOND)
            picture = run.picture(stamp)
            if picture is not None:
                lately = run.history.between(stamp - round(SHOWN_S * SECOND), stamp)
                did = [record.what for record in lately if record.kind == "action"]
                yield frame(run.states.at(stamp), picture.jpeg, did)


def main() -> None:
    """Run the command."""
    arguments = argparse.ArgumentParser(description="Makes an animated picture of a recorded run.")
    arguments.add_argument("run", type=Path)
    arguments.add_argument("picture", type=Path)
    arguments.add_argument("--begin", type=float, default=6.0, metavar="S")
    arguments.add_argument("--end", type=float, default=20.0, metavar="S")
    arguments.add_argument("--rate", type=float, default=5.0, metavar="HZ")
    given = arguments.parse_args()
    first, *rest = frames(given.run, given.begin, given.end, given.rate)
    first.save(
        given.picture,
        save_all=True,
        append_images=rest,
        duration=round(1000 / given.rate),
        loop=0,
        quality=75,
        method=6,
    )


if __name__ == "__main__":
    main()
