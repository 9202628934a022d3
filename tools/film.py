"""Film a world with physics as a moving picture: ``python tools/film.py warehouse docs/pictures/warehouse.webp``.

Needs mujoco and pillow, and an off-screen OpenGL: ``MUJOCO_GL=egl`` or ``osmesa``.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from socialbot.agents.base.mujoco import load_mujoco
from socialbot.agents.hospital.demo import hospital
from socialbot.agents.hospital.vocabulary import PHRASES as HOSPITAL_PHRASES
from socialbot.agents.hospital.ward.messages import COMMANDS, MISSIONS, RESULTS
from socialbot.agents.teams.messages import ActionCommand, ActionResult, Missions
from socialbot.agents.warehouse.demo import warehouse
from socialbot.agents.warehouse.gripper import PHRASES
from socialbot.agents.warehouse.scenario import GRIPPER
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.inline import InlineRunner

SIZE = (640, 360)
INK, PAPER = "#2b2420", "#fffaf4"


class Film:
    """A run with physics, and what its agents do."""

    def __init__(self, world: str, seed: int, faults: str) -> None:
        if world == "warehouse":
            graph, topics = warehouse(6, seed=seed, faults=faults, world="physics"), [f"/{GRIPPER}/trace"]
        else:
            simulated = {"simulation": "physics", "faults": faults}
            graph, topics = hospital(rate=100.0, seed=seed, world=simulated), [COMMANDS, RESULTS, MISSIONS]
        self.runner = InlineRunner(graph)
        self.running: dict[str, str] = {}
        self.is_over = False
        for topic in topics:
            self.runner.tap(topic, self._take)
        self.runner.start()
        self.physics = self.runner.nodes["world"].world.physics  # type: ignore[attr-defined]
        self._renderer = load_mujoco().Renderer(self.physics.model, SIZE[1] * 2, SIZE[0] * 2)

    def _take(self, topic: str, message: Message) -> None:
        match message:
            case TraceRecord(kind="step", detail=detail):
                self.running[message.what] = f"gripper {PHRASES[detail['action']].format(*detail['args'])}"
            case TraceRecord(kind="step_end"):
                self.running.pop(message.what, None)
            case TraceRecord(kind="desire_fulfilled" | "desire_dropped"):
                self.is_over = True
            case ActionCommand():
                self.running[message.id] = f"{message.robot} {HOSPITAL_PHRASES[message.action].format(*message.args)}"
            case ActionResult():
                self.running.pop(message.id, None)
            case Missions():
                self.is_over = any(view.status == "finished" for view in message.missions)

    def frame(self, time_s: float) -> Image.Image:
        """Let the run go on to a time (s), and draw it."""
        self.runner.advance(round(time_s * SECOND))
        self._renderer.update_scene(self.physics.data, "film")
        picture = Image.fromarray(self._renderer.render()).resize(SIZE, Image.Resampling.LANCZOS)
        canvas, font = ImageDraw.Draw(picture), ImageFont.load_default(13)
        lines = [f"{time_s:.0f} s", *list(self.running.values())[:2]]
        width = 12 + max(canvas.textlength(line, font) for line in lines)
        canvas.rounded_rectangle((8, 8, 8 + width, 16 + 17 * len(lines)), 6, fill=PAPER)
        for number, line in enumerate(lines):
            canvas.text((14, 11 + 17 * number), line, INK, font)
        return picture


def main() -> None:
    """Run the command."""
    os.environ.setdefault("MUJOCO_GL", "egl")  # read by MuJoCo when it is imported
    arguments = argparse.ArgumentParser(description="Films a world with physics.")
    arguments.add_argument("world", choices=("warehouse", "hospital"))
    arguments.add_argument("picture", type=Path)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--faults", default="")
    arguments.add_argument("--limit", type=float, default=200.0, metavar="S")
    arguments.add_argument("--speed", type=float, default=8.0, help="times as fast as the simulation")
    arguments.add_argument("--rate", type=float, default=10.0, metavar="HZ")
    arguments.add_argument("--quality", type=int, default=60)
    given = arguments.parse_args()
    film, frames, time_s, left = Film(given.world, given.seed, given.faults), [], 0.0, 15
    while time_s < given.limit and left:
        frames.append(film.frame(time_s))
        time_s += given.speed / given.rate
        left -= film.is_over
    first, *rest = frames
    duration = round(1000 / given.rate)
    quality = given.quality
    first.save(given.picture, save_all=True, append_images=rest, duration=duration, loop=0, quality=quality, method=4)


if __name__ == "__main__":
    main()
