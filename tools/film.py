"""Film the warehouse with physics as a moving picture: ``python tools/film.py docs/pictures/warehouse.webp``.

Needs mujoco and pillow, and an off-screen OpenGL: ``MUJOCO_GL=egl`` or ``osmesa``.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from socialbot.agents.base.mujoco import load_mujoco
from socialbot.agents.warehouse.demo import warehouse
from socialbot.agents.warehouse.gripper import PHRASES
from socialbot.agents.warehouse.physics import PhysicalWarehouse
from socialbot.agents.warehouse.scenario import GRIPPER
from socialbot.agents.warehouse.world_node import WarehouseWorld
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.inline import InlineRunner

SIZE = (640, 360)
INK, PAPER = "#2b2420", "#fffaf4"


class Film:
    """A run of the warehouse, and the steps of its gripper."""

    def __init__(self, seed: int, faults: str) -> None:
        self.runner = InlineRunner(warehouse(6, seed=seed, faults=faults, world="physics"))
        self.running: dict[str, str] = {}
        self.is_over = False
        self.runner.tap(f"/{GRIPPER}/trace", self._take)
        self.runner.start()
        node = self.runner.nodes["world"]
        assert isinstance(node, WarehouseWorld)
        assert isinstance(node.world, PhysicalWarehouse)
        self.world = node.world
        self._renderer = load_mujoco().Renderer(self.world.model, SIZE[1] * 2, SIZE[0] * 2)

    def _take(self, topic: str, record: Message) -> None:
        assert isinstance(record, TraceRecord)
        if record.kind == "step":
            self.running[record.what] = PHRASES[record.detail["action"]].format(*record.detail["args"])
        elif record.kind == "step_end":
            self.running.pop(record.what, None)
        elif record.kind in ("desire_fulfilled", "desire_dropped"):
            self.is_over = True

    def frame(self, time_s: float) -> Image.Image:
        """Let the run go on to a time (s), and draw it."""
        self.runner.advance(round(time_s * SECOND))
        self._renderer.update_scene(self.world.data, "film")
        picture = Image.fromarray(self._renderer.render()).resize(SIZE, Image.Resampling.LANCZOS)
        canvas, font = ImageDraw.Draw(picture), ImageFont.load_default(13)
        lines = [f"{time_s:.0f} s", *(f"gripper {text}" for text in list(self.running.values())[:2])]
        width = 12 + max(canvas.textlength(line, font) for line in lines)
        canvas.rounded_rectangle((8, 8, 8 + width, 16 + 17 * len(lines)), 6, fill=PAPER)
        for number, line in enumerate(lines):
            canvas.text((14, 11 + 17 * number), line, INK, font)
        return picture


def main() -> None:
    """Run the command."""
    os.environ.setdefault("MUJOCO_GL", "egl")  # read by MuJoCo when it is imported
    arguments = argparse.ArgumentParser(description="Films the warehouse with physics.")
    arguments.add_argument("picture", type=Path)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--faults", default="")
    arguments.add_argument("--limit", type=float, default=200.0, metavar="S")
    arguments.add_argument("--speed", type=float, default=8.0, help="times as fast as the simulation")
    arguments.add_argument("--rate", type=float, default=10.0, metavar="HZ")
    given = arguments.parse_args()
    film, frames, time_s, left = Film(given.seed, given.faults), [], 0.0, 15
    while time_s < given.limit and left:
        frames.append(film.frame(time_s))
        time_s += given.speed / given.rate
        left -= film.is_over
    first, *rest = frames
    duration = round(1000 / given.rate)
    first.save(given.picture, save_all=True, append_images=rest, duration=duration, loop=0, quality=60, method=4)


if __name__ == "__main__":
    main()
