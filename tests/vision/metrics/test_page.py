from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
from rich.console import Console

from socialbot.runs.evaluation_page import page as page_of
from socialbot.runs.evaluation_tables import PAPER, markdown, paper_scene, show, write_markdown
from socialbot.vision.metrics.frames import bag_source, image_sources
from socialbot.vision.metrics.matches import Rules
from socialbot.vision.metrics.pipeline import PipelineSettings, with_changes
from socialbot.vision.metrics.scores import BandScore, Score
from tests.runs.pages import headings
from tests.vision.metrics.scenes import drawn_bag, drawn_pictures, evaluated, with_band

BLIND = with_changes(PipelineSettings("hog"), ["threshold=9", "tracker=none"])


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    bag = drawn_bag(folder, scene="scene1", frames=4)
    pictures = image_sources(drawn_pictures(folder / "<room>", 2))
    # A threshold that nothing reaches in one of the scenes makes frames worth looking at.
    return evaluated([bag_source(bag), *pictures])


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    """Everybody is missed."""
    bag = drawn_bag(tmp_path_factory.mktemp("clips"), frames=3, objects=[])
    return evaluated([bag_source(bag)], BLIND)


def page(evaluation):
    return page_of(evaluation).html()


class Checker(HTMLParser):
    """Notes links to the outside, and tags that are not closed."""

    def __init__(self):
        super().__init__()
        self.open, self.outside, self.texts = [], [], []

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        links = [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        self.outside += [link for link in links if not link.startswith(("data:", "#"))]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def checked(text):
    checker = Checker()
    checker.feed(text)
    assert checker.open == []
    return checker


def test_page_needs_nothing_from_elsewhere(evaluation):
    checker = checked(page(evaluation))
    assert checker.outside == []


def test_names_are_shown_as_they_are(evaluation):
    assert "<room>" in "".join(checked(page(evaluation)).texts)


def test_page_shows_the_evaluation(evaluation):
    text = "".join(checked(page(evaluation)).texts)
    f1 = evaluation.detectors["hog"].scenes["scene1"].score.bands["2-10"].score.f1
    assert f"{f1:.3f}" in text
    assert "0.593" in text  # the paper's


def test_page_looks_like_all_others_and_has_every_part(evaluation):
    html = page(evaluation)
    assert headings(html) == [
        "F1 by distance",
        "Beside the paper",
        "In full",
        "Precision and recall",
        "Average precision",
        "Tracking",
        "Errors of distances",
        "Where false positives come from",
        "What Waldo does with it",
        "The worst frames",
        "How this was measured",
    ]
    assert html.count('class="plot"') == 2  # precision over recall, for each scene with people


def test_worst_frames_are_shown_with_missed_people(blind):
    text = page(blind)
    checked(text)
    assert text.count("<image ") == 1  # the frames are within a second of each other
    assert "1 missed" in text
    assert "data:image/jpeg;base64," in text


def test_page_is_the_same_every_time(blind):
    assert page(blind) == page(blind)


def test_presence_has_no_row_of_the_paper(tmp_path):
    bag = drawn_bag(tmp_path, scene="scene1", frames=3)
    text = page(evaluated([bag_source(bag)], rules=Rules(presence=True)))
    assert "0.593" not in text
    checked(text)


def test_presence_has_no_causes(evaluation, tmp_path):
    by_presence = evaluated([bag_source(drawn_bag(tmp_path, frames=1))], rules=Rules(presence=True))
    for told, heading in ((page, "Where false positives come from"), (markdown, "False positives by cause")):
        assert heading in told(evaluation)
        assert heading not in told(by_presence)


def test_summary_has_the_bands_of_every_detector(evaluation):
    hog = evaluation.detectors["hog"]
    other = with_band(hog, "scene1", "outside", BandScore(Score(tp=0, fp=7, fn=0)))
    none = with_band(hog, "scene1", "outside", BandScore(Score()))
    both = replace(evaluation, detectors={"hog": none, "other": other})
    summary = page(both).partition(">F1 by distance</h2>")[2].partition("</table>")[0]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in summary.split("<tr")]
    assert [cells[1] for cells in rows if cells][:5] == ["0-2 m", "2-10 m", "10-20 m", "outside", "all"]


def test_page_names_tracked_sources(evaluation, blind, tmp_path):
    mixed = "hog with tracking (single images without)"
    assert mixed in page(evaluation)
    assert "hog without tracking" in page(blind)
    bag, pictures = drawn_bag(tmp_path, frames=1), drawn_pictures(tmp_path / "room", 1)
    assert "hog with tracking<" in page(evaluated([bag_source(bag)]))
    assert "hog without tracking" in page(evaluated(image_sources(pictures)))


def test_errors_whose_images_are_gone_are_still_errors(tmp_path):
    folder = drawn_pictures(tmp_path / "room", 1)
    result = evaluated(image_sources(folder), BLIND)
    (folder / "0.png").write_bytes(b"rubbish")
    text = page(result)
    assert "No errors." not in text
    assert "cannot be read any more" in text


def test_tables_agree_with_the_json(evaluation):
    console = Console(width=150, record=True, file=__import__("io").StringIO())
    show(evaluation, console)
    text = console.export_text()
    for score in PAPER["Scene 2"].values():
        assert re.search(rf"{score.tp}\s+{score.fp}\s+{score.fn}", text)
    assert "…" not in text
    assert "<room>" in text


def test_document_agrees_with_the_json(evaluation, tmp_path):
    write_markdown(evaluation, tmp_path / "new")
    text = (tmp_path / "new" / "evaluation.md").read_text()
    f1 = evaluation.detectors["hog"].scenes["scene1"].score.bands["2-10"].score.f1
    assert f"{f1:.3f}" in text
    assert "| 0-2 m | paper | 0.613 | 0.575 | 0.593 | 0.522 | 0.398 | 0.452 |" in text
    tables = [block.splitlines() for block in text.split("\n\n") if block.startswith("|")]
    assert len(tables) == 8
    distance = evaluation.detectors["hog"].scenes["scene1"].score.overall.distance
    assert distance is not None
    row = next(line for line in tables[6] if "| all |" in line)
    assert f"| all | {distance.people} | {distance.median:.1%} | {distance.p90:.1%} |" in row
    assert all(len({line.count("|") for line in table}) == 1 for table in tables)
    drawing = ElementTree.fromstring((tmp_path / "new" / "curves.svg").read_text())
    charts = [each for each in drawing if each.get("class") == "chart"]
    assert len(charts) == 2
    assert {(each.get("x"), each.get("y")) for each in charts} == {("0", "26"), ("0", "324")}
    assert all(re.search(r"\d+ [\d.]+L", path.get("d", "")) for path in drawing.iterfind(".//{*}path[@fill='none']"))


def test_scenes_of_the_paper():
    assert paper_scene("scene1") == paper_scene("Scene 1") == paper_scene("scene_1_heldback") == "Scene 1"
    assert paper_scene("scene2") == "Scene 2"
    assert paper_scene("corridor") is paper_scene("scene12") is paper_scene("scene3") is None


def test_papers_table_three_follows_from_its_table_two():
    rates = {
        (scene, band): (score.precision, score.recall, score.f1)
        for scene, bands in PAPER.items()
        for band, score in bands.items()
    }
    assert rates["Scene 1", "0-2"] == pytest.approx((0.612, 0.575, 0.593), abs=0.0015)
    assert rates["Scene 1", "2-10"] == pytest.approx((0.822, 0.782, 0.801), abs=0.0015)
    assert rates["Scene 2", "0-2"] == pytest.approx((0.52, 0.398, 0.451), abs=0.0025)
    assert rates["Scene 2", "2-10"] == pytest.approx((0.756, 0.728, 0.742), abs=0.0015)
