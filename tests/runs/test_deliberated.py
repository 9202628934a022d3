from __future__ import annotations

import json
import re

from socialbot.core.messages import TraceRecord
from socialbot.runs.report_deliberated import Scene, lead_of, scripts, sections
from socialbot.runs.report_page import Page
from socialbot.runs.story import Story, story_of
from tests.runs.deliberating_runs import DETOUR, PHRASES, desire, record
from tests.runs.pages import headings, read

STORY = story_of(DETOUR, PHRASES)


def page(*, story: Story = STORY, scene: Scene | None = None, title: str = "A run") -> str:
    return Page(title, sections=sections(story, scene), scripts=scripts(story, scene)).html()


def test_the_page_tells_all_of_the_run():
    words = read(page())
    for told in ("A run", "7.00 s", "gives up plan 1 for be_home", "asks bob for open_door", "be_home"):
        assert told in words


def test_what_people_wrote_is_text():
    odd = story_of((desire(0, "a", "</script><u>x"), record(1, "a", "desire_dropped", "</script><u>x", reason="<s>")))
    html = page(story=odd, title="<u>")
    assert "<u>" not in html.split("<script")[0]
    assert "<s>" not in html.split("<script")[0]
    data = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert data is not None
    assert json.loads(data[1])["turns"][0][2].startswith("wants </script><u>x")


def test_the_film_is_with_it():
    scene = Scene('<svg class="floor"></svg>', {"robots": {}, "boxes": {}, "holding": []}, "crane", ["<svg><g/></svg>"])
    html = page(scene=scene)
    assert '<div class="shots"><svg><g/></svg></div>' in html
    assert '"crane":"crane"' in html


def test_the_lead_says_what_came_of_it():
    assert lead_of(STORY) == (
        "ann wanted be_home and reached it after 7.0 s; its first plan said 5.0 s. "
        "One plan was given up, at 3.0 s: ann goes from yard to hall, the door is locked."
    )
    assert lead_of(story_of(DETOUR[:3])).startswith("ann wanted be_home and was still at it")
    dropped = story_of((desire(0, "a", "x"), record(1, "a", "desire_dropped", "x", reason="deleted")))
    assert lead_of(dropped) == "a wanted x, which was dropped: deleted. No plan was given up."
    assert lead_of(story_of([])) == "Nobody wanted anything."


def test_what_was_said_is_a_table_of_its_own():
    def said(text: str, weight: str) -> TraceRecord:
        more = {"receiver": "bob", "performative": "inform", "content": "Problem", "mission": "m_1", "weight": weight}
        return record(1, "ann", "said", text, **more)

    html = page(story=story_of((desire(0, "ann", "x"), said("reports <smoke>", "problem"), said("hums", ""))))
    read(html)
    assert html.count('<td class="bad">reports &lt;smoke&gt;</td>') == 2, "at once, and among all"
    assert html.count('<td class="">hums</td>') == 1
    assert "What was asked of each other" not in html
    assert "What was asked of each other" in page()


def test_the_film_of_a_long_run_is_faster():
    def usual(seconds: float) -> str:
        story = story_of((desire(0, "ann", "x"), record(seconds, "ann", "desire_dropped", "x", reason="")))
        found = re.search(r"selected>(.*?)x<", page(story=story))
        assert found is not None
        return found[1]

    assert [usual(seconds) for seconds in (1.0, 5.0, 30.0, 126.0, 9999.0)] == ["0.1", "0.2", "1", "5", "20"]


def test_what_groups_look_like_is_with_the_film():
    film = {"robots": {}, "faces": {"room": [(0.0, 0)]}, "drawings": ["</script>"]}
    html = page(scene=Scene('<svg class="ward"></svg>', film, shots=["<svg/>"], shots_title="The ward"))
    data = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert data is not None
    assert json.loads(data[1])["film"] == json.loads(json.dumps(film))
    assert "The ward" in headings(html)
