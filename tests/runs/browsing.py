"""The page of the inspector in a browser, over runs that the real parts have recorded."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, ConsoleMessage, FloatRect, Page, sync_playwright

from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import CompressedImage
from socialbot.runs.bag_images import pictures_of
from socialbot.runs.folder import open_run
from socialbot.runs.serving import Address, serving
from tests.runs.runs import START, greeting

PICTURES = "/camera/image_raw/compressed"
TENTHS = 40
COMES_S = 1.0
PATIENCE_MS = 90_000
NO_CONNECTION = "net::ERR_"
"""Browsers put that on the console whatever a page makes of it."""


def waldo_with_pictures(folder: Path) -> Path:
    """A run of Waldo, 4 s long, with a picture each tenth of a second; somebody is there from `COMES_S` on."""
    run = greeting(folder / "run", comes=int(COMES_S * 10), tenths=TENTHS)
    with BagWriter(folder / "bag") as bag:
        for tenth in range(TENTHS):
            picture = _picture(tenth)
            bag.write(PICTURES, picture, picture.stamp)
    results = json.loads((run / "results.json").read_text())
    results["bag"] = {"path": str(folder / "bag"), "start": START, "topics": {PICTURES: PICTURES}}
    (run / "results.json").write_text(json.dumps(results))
    return run


def _picture(tenth: int) -> CompressedImage:
    pixels = np.full((480, 640, 3), 90, np.uint8)
    if tenth >= COMES_S * 10:
        cv2.rectangle(pixels, (100, 50), (180, 250), (60, 160, 230), -1)
    cv2.putText(pixels, f"{tenth / 10:.1f} s", (420, 440), cv2.FONT_HERSHEY_SIMPLEX, 1.5, (255, 255, 255), 3)
    data = cv2.imencode(".jpg", pixels)[1]
    return CompressedImage(stamp=START + tenth * SECOND // 10, frame_id="camera", format="jpeg", data=data.reshape(-1))


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """A recorded run on its page; gives the address."""
    results = json.loads((folder / "results.json").read_text())
    bag = results.get("bag", {})
    with ExitStack() as stack:
        pictures = stack.enter_context(pictures_of(Path(bag["path"]), list(bag["topics"]))) if bag else None
        yield stack.enter_context(serving(open_run(folder, pictures), Address(port=0))).url


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser, where there is one."""
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("needs chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


class Visit:
    """The page, opened at ``where`` (what comes behind the # of the address), and what the console says."""

    def __init__(
        self, browser: Browser, url: str, where: str = "", *, width: int = 1440, height: int = 900, dark: bool = False
    ) -> None:
        self.page: Page = browser.new_page(
            viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light"
        )
        self.page.set_default_timeout(PATIENCE_MS)
        self.errors: list[str] = []
        self.page.on("console", self._note)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(f"{url}#{where}")
        self._wait_for_page()

    def _wait_for_page(self) -> None:
        self.page.wait_for_selector("body[data-loaded]")
        self.page.wait_for_selector("body[data-shown]")

    def load_again(self) -> None:
        self.page.reload()
        self._wait_for_page()

    def _note(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.errors.append(f"{message.text} {message.location}")

    def close(self, *, lost: bool = False) -> None:
        """Leaves the page, which has to have gone without complaint; of its own that a server was ``lost``."""
        self.page.close()
        own = [error for error in self.errors if not (lost and NO_CONNECTION in error)]
        assert own == []

    def seek(self, seconds: float) -> None:
        """Moves the scrubber, and waits until all of that moment is shown."""
        self.page.locator("#scrubber").fill(f"{seconds:g}")
        self.wait(seconds)

    def wait(self, seconds: float) -> None:
        """Waits until a moment is shown."""
        self.page.wait_for_function("t => Math.abs(document.body.dataset.shown - t) < 1e-4", arg=seconds)

    def texts(self, selector: str) -> list[str]:
        """Return the texts of the elements of a selector."""
        return [text.strip() for text in self.page.locator(selector).all_text_contents()]

    def number(self, script: str) -> float:
        """Return the number that a script evaluates to."""
        return float(self.page.evaluate(script))

    def place(self, selector: str) -> FloatRect:
        """Return the position of an element (pixels)."""
        place = self.page.locator(selector).bounding_box()
        assert place is not None, f"{selector} is not to be seen"
        return place
