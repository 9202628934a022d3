"""Take the screenshots of the inspector for docs/pictures: ``python -m tools.pictures [NAME...]``.

Missing runs are made in ``--runs``, except ``deployment``: the run of the workstation from
``python -m evaluation.faults --only clear``. Needs chromium, playwright and pillow.
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from socialbot.runs.report import recorded
from socialbot.runs.serving import Address, serving

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
CORRIDOR = str(ROOT / "data" / "synthetic" / "corridor")

RUNS: Mapping[str, Sequence[str]] = {
    "corridor": ("replay", CORRIDOR, "--runner", "inline", "--no-video"),
    "warehouse": ("demo", "warehouse", "--run", "2"),
    "hospital": ("demo", "hospital"),
}
"""The commands that make the runs."""


@dataclass(frozen=True)
class Shot:
    """Screenshot of a run at ``where`` after ``clicks``: of one ``part``, or of the whole viewport."""

    run: str
    where: str
    clicks: tuple[str, ...] = ()
    part: str = ""
    width: int = 1280
    height: int = 760
    dark: bool = False


SHOTS: Mapping[str, Shot] = {
    "waldo": Shot("corridor", "t=9.6"),
    "why": Shot("corridor", "t=17.2", ("#timeline text.beside:has-text('Can I help')",), dark=True),
    "plans": Shot("corridor", "t=9.6", ("#tab-plans", "#pane-plans button:has-text('greeting_several')"), "#side"),
    "question": Shot("corridor", "t=18", ("#tab-ask", "#questions .others button >> nth=0"), "#side"),
    "nodes": Shot("deployment", "t=30", ("summary",), "#nodes", width=1440),
    "warehouse": Shot("warehouse", "t=92.5&agent=gripper_a", height=1260),
    "hospital": Shot(
        "hospital", "t=2.42&agent=spotrobot1", ("#timeline .bar.step.bad >> nth=0",), height=1390, dark=True
    ),
    "phone": Shot("corridor", "t=17.2", width=390, height=844),
}
PROJECT = "my_robot"
ASK = "ask"
"""Screenshot of a live agent that receives a request."""


def made(run: str, folder: Path) -> Path:
    """Return the folder of a run; make the run if it is missing."""
    path = folder / run
    if not path.exists():
        if run not in RUNS:
            raise SystemExit(f"error: {path} is missing; it is not made here")
        subprocess.run(socialbot(*RUNS[run], "--out", str(path)), check=True, stdout=subprocess.DEVNULL)
    return path


def socialbot(*arguments: str) -> list[str]:
    """Return a command line of socialbot."""
    return [sys.executable, "-m", "socialbot", *arguments]


def opened(browser: Browser, url: str, shot: Shot) -> Page:
    """Open the page in the size and colour scheme of a screenshot."""
    page = browser.new_page(
        viewport={"width": shot.width, "height": shot.height}, color_scheme="dark" if shot.dark else "light"
    )
    page.goto(f"{url}#{shot.where}")
    page.wait_for_selector("body[data-loaded]")
    page.wait_for_selector("body[data-shown]")
    return page


def taken(browser: Browser, shot: Shot, folder: Path) -> bytes:
    """Return a screenshot of a recorded run as PNG."""
    with recorded(made(shot.run, folder)) as run, serving(run, Address(port=0)) as served:
        page = opened(browser, served.url, shot)
        for click in shot.clicks:
            page.click(click)
        return settled(page, shot.part)


def settled(page: Page, part: str) -> bytes:
    """Return the loaded page, or a part of it, as PNG."""
    page.wait_for_load_state("networkidle")
    page.mouse.move(0, 0)
    page.evaluate("scrollTo(0, 0)")  # a click may have scrolled to what it hit
    page.wait_for_timeout(1000)
    found = page.locator(part).screenshot() if part else page.screenshot()
    page.close()
    return found


@contextmanager
def going_on(folder: Path) -> Iterator[str]:
    """Run a new project with simulated people over ROS; yield the address of its page."""
    subprocess.run(socialbot("new", PROJECT, "--out", str(folder)), check=True, stdout=subprocess.DEVNULL)
    command = socialbot("up", "graph.yaml", "--inspect", "--port", "0", "--set", "visitors.visits=1000")
    with subprocess.Popen(command, cwd=folder / PROJECT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = (re.search(r"http://\S+", line) for line in process.stdout)
        try:
            yield next(found.group() for found in told if found)
        finally:
            process.send_signal(signal.SIGINT)
            process.stdout.read()


def asked(browser: Browser, folder: Path) -> bytes:
    """Pause an agent of a live run, add a belief, and return a screenshot as PNG."""
    with going_on(folder) as url:
        page = opened(browser, url, Shot(ASK, ""))
        page.click("#tab-ask")
        page.locator("#beliefs button").first.wait_for(timeout=60_000)
        page.click("[name=pause]")
        page.fill("#ask-belief", 'visitor("ann")')
        page.click("[name=believe]")
        page.locator("#ask-belief-answer:has-text('accepted')").wait_for()
        page.mouse.move(0, 0)
        page.wait_for_timeout(1000)
        return page.screenshot()


def keep(png: bytes, path: Path) -> None:
    """Save a screenshot with a reduced palette."""
    Image.open(io.BytesIO(png)).convert("RGB").quantize(256, kmeans=3).save(path, optimize=True)


def main() -> None:
    """Run the command."""
    arguments = argparse.ArgumentParser(description="Takes the pictures of the inspector.")
    arguments.add_argument("names", nargs="*", metavar="NAME", help=", ".join([*SHOTS, ASK]), default=[*SHOTS, ASK])
    arguments.add_argument("--runs", type=Path, metavar="FOLDER", help="where runs are kept; default: nowhere")
    given = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        runs = given.runs or Path(folder)
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for name in given.names:
            png = asked(browser, Path(folder)) if name == ASK else taken(browser, SHOTS[name], runs)
            keep(png, PICTURES / f"inspect_{name}.png")
        browser.close()


if __name__ == "__main__":
    main()
