"""Browser part of `evaluation.inspect`: speed of the page in headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from playwright.sync_api import Page, sync_playwright

from socialbot.core.errors import NodeError

PATIENCE_MS = 60_000.0
WINDOW = {"width": 1440, "height": 900}

STEP = """async times => {
  const scrubber = document.getElementById('scrubber');
  const took = [];
  for (const t of times) {
    const begun = performance.now();
    const shown = new Promise(done => {
      const look = new MutationObserver(() => {
        if (Math.abs(document.body.dataset.shown - scrubber.value) > 1e-4) return;
        look.disconnect();
        done();
      });
      look.observe(document.body, { attributes: true, attributeFilter: ['data-shown'] });
    });
    scrubber.value = t;
    scrubber.dispatchEvent(new Event('input'));
    await shown;
    await new Promise(requestAnimationFrame);
    took.push(performance.now() - begun);
  }
  return took;
}"""

UPDATES = """seconds => new Promise(done => {
  let updates = 0;
  const look = new MutationObserver(() => { updates += 1; });
  look.observe(document.body, { attributes: true, attributeFilter: ['data-shown'] });
  setTimeout(() => { look.disconnect(); done(updates); }, 1000 * seconds);
})"""


@contextmanager
def page() -> Iterator[Page]:
    """Yield an empty browser page.

    Raises:
        NodeError: No browser is available.
    """
    path = shutil.which("chromium")
    if path is None:
        raise NodeError("there is no chromium", remedy="install Debian's package of that name")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser.new_page(viewport=WINDOW)  # pyright: ignore[reportArgumentType]
        finally:
            browser.close()


def first_picture_ms(page: Page, url: str) -> float:
    """Return the time (ms) from opening ``url`` to the first camera image."""
    page.goto(url, timeout=PATIENCE_MS)
    page.wait_for_function("() => document.getElementById('picture').naturalWidth > 0", timeout=PATIENCE_MS)
    return page.evaluate("() => performance.now()")


def steps_ms(page: Page, times: Sequence[float]) -> list[float]:
    """Return the time (ms) of each scrubber move until its state (s) is shown; times must be unique."""
    page.wait_for_selector("body[data-loaded]", timeout=PATIENCE_MS)
    return page.evaluate(STEP, list(times))


def update_ms(page: Page, url: str, seconds: float) -> float:
    """Return the mean interval (ms) of updates on the page of a live run."""
    page.goto(url, timeout=PATIENCE_MS)
    page.wait_for_selector("body[data-loaded]", timeout=PATIENCE_MS)
    return 1e3 * seconds / max(1, page.evaluate(UPDATES, seconds))
