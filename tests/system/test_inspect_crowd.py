"""The page of a hundred agents at work, in a browser."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="needs playwright")

from playwright.sync_api import expect

from evaluation.inspect import AGENTS, crowd
from tests.runs.browsing import Visit, chromium

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.xdist_group("browser")]

PATIENCE_MS = 60_000


def test_any_of_them_is_found_and_followed(tmp_path: Path) -> None:
    with chromium() as browser, crowd(tmp_path, AGENTS, inspected=True) as (_, _, address):
        visit = Visit(browser, address)
        agents = visit.page.locator("#agent-list li")
        expect(agents).to_have_count(AGENTS, timeout=PATIENCE_MS)
        visit.page.locator("#agent-filter").fill("agent77")
        expect(agents).to_have_count(1, timeout=PATIENCE_MS)
        agents.locator("button").click()
        expect(visit.page.locator("#mind-title")).to_have_text("agent77", timeout=PATIENCE_MS)
        places = visit.page.locator("#beliefs li", has_text="at(").locator(".what")
        for _ in range(3):
            before = places.last.inner_text()
            expect(places).to_have_count(1, timeout=PATIENCE_MS)
            expect(places.last).not_to_have_text(before, timeout=PATIENCE_MS)
        visit.close()
