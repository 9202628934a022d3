"""``socialbot test``: expectations on simulations and recorded runs, with exit codes, JUnit XML and a page."""

from __future__ import annotations

import itertools
from pathlib import Path
from xml.etree import ElementTree

import pytest

from socialbot.cli.new import write_project
from tests.system.running import socialbot_here

BEHAVIOURS = """
from socialbot.testing import expect, never, once_per, person, said

greets = expect(said("Hello*")).within(2).after(person(nearer_than=3))
greets_once = once_per(person, said("Hello*", to=person))
greets_at_once = expect(said("Hello*")).within(0.5).after(person(nearer_than=4)).because("people walk on")
never_sings = never(said("La*"))
offers = expect(said("help*")).within(2).after(said("Sorry*"))
due_later = expect(said("Bye*")).within(1000).after(said("Goodbye*"))
"""
NUMBERS = itertools.count()


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    project = write_project(f"tested{next(NUMBERS)}", "python", tmp_path)
    (project / "expected.py").write_text(BEHAVIOURS, "utf-8")
    return project


def test_verdicts_of_a_simulation(project: Path, tmp_path: Path) -> None:
    out, report = tmp_path / "out", tmp_path / "report.xml"
    done = socialbot_here("test", project / "expected.py", project / "graph.yaml", "--out", out, "--junit", report)
    assert done.returncode == 1, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[:2] for line in lines if line.startswith("  ") and line[2] != " "] == [
        ["passed", "greets"],
        ["passed", "greets_once"],
        ["FAILED", "greets_at_once"],
        ["passed", "never_sings"],
        ["untested", "offers"],
        ["open", "due_later"],
    ]
    assert "1 run: 3 passed, 1 failed, 1 open, 1 untested" in lines
    text = done.stdout
    assert "at 1.60 s, person t1: expect said('Hello*') within 0.5 s after person(nearer_than=4)" in text
    assert "it came 0.60 s after it, 0.10 s too late; within(0.6) would pass" in text
    assert f"{out / 'graph' / 'report.html'}#t=1.6" in text
    assert "the frame" in text
    assert "it matters because people walk on" in text
    (suite,) = ElementTree.parse(report).getroot()
    assert suite.attrib == {"name": "graph", "tests": "6", "failures": "1", "errors": "0", "skipped": "2"}
    failure = suite.find("testcase[@name='greets_at_once']/failure")
    assert failure is not None
    assert "too late" in failure.attrib["message"]
    page = (out / "behaviours.html").read_text("utf-8")
    assert 'href="graph/report.html#t=1.6"' in page
    assert "3 passed, 1 failed, 1 open, 1 untested</span>" in page
    assert (out / "graph" / "report.html").is_file()


def test_recorded_runs_and_selection(project: Path, tmp_path: Path) -> None:
    graph, recorded = project / "graph.yaml", tmp_path / "recorded"
    assert socialbot_here("run", graph, "--out", recorded).returncode == 0
    out = ("--out", tmp_path / "out")
    assert socialbot_here("test", project / "expected.py", recorded, *out, "-k", "greets_").returncode == 1
    page = tmp_path / "out" / "behaviours.html"
    for name, outcome in ("never", "all passed"), ("offers", "1 untested"), ("due", "1 open"):
        assert socialbot_here("test", project / "expected.py", recorded, *out, "-k", name).returncode == 0
        assert f"{outcome}</span>" in page.read_text("utf-8")
    assert socialbot_here("test", project / "expected.py", recorded, *out, "-k", "offers", "--strict").returncode == 1
    assert socialbot_here("test", project / "expected.py", recorded, *out, "-k", "due", "--strict").returncode == 1


def bag_without_graph(project: Path, folder: Path) -> Path:
    """The recorded detections of a simulated visit."""
    assert socialbot_here("run", project / "graph.yaml", "--bag", "--out", folder / "ran").returncode == 0
    (bag,) = {path.parent for path in folder.rglob("ran/**/metadata.yaml")}
    (bag / "graph.yaml").unlink()
    return bag


def test_a_graph_for_bags_is_not_for_the_other_sources(project: Path, tmp_path: Path) -> None:
    graph, bag = project / "graph.yaml", bag_without_graph(project, tmp_path)
    done = socialbot_here(
        "test", project / "expected.py", graph, bag, tmp_path / "ran", "--graph", graph, "-k", "greets_once",
        "--out", tmp_path / "out",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith(("graph", bag.name, "ran"))]
    assert lines == [f"graph  ({graph})", f"{bag.name}  ({bag}, with {graph})", f"ran  ({tmp_path / 'ran'})"]
    assert done.stdout.count("  passed   greets_once  1 instance") == 3


@pytest.mark.parametrize("given", [".", ".."])
def test_the_run_of_a_bag_named_by_its_place_gets_the_name_of_the_bag(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str
) -> None:
    graph, bag, out = project / "graph.yaml", bag_without_graph(project, tmp_path), tmp_path / "all" / "out"
    (bag / "inner").mkdir()
    monkeypatch.chdir(bag if given == "." else bag / "inner")
    done = socialbot_here("test", project / "expected.py", given, "--graph", graph, "-k", "greets_once", "--out", out)
    assert done.returncode == 0, done.stderr
    assert f"{bag.name}  ({given}, with {graph})" in done.stdout.splitlines()
    assert sorted(path.name for path in out.iterdir()) == sorted([bag.name, "behaviours.html"])
    assert list(out.parent.iterdir()) == [out]


def test_the_nearest_change_that_passes_is_found(project: Path, tmp_path: Path) -> None:
    (project / "expected.py").write_text(
        "from socialbot.testing import expect, person, said\n"
        'early = expect(said("Hello*")).within(0.3).after(person(nearer_than=4.05))\n',
        "utf-8",
    )
    done = socialbot_here(
        "test", project / "expected.py", project / "graph.yaml", "--out", tmp_path / "out", "--nearest"
    )
    assert done.returncode == 1
    (found,) = [line for line in done.stdout.splitlines() if "nearest change" in line]
    name, _, value = found.rpartition("--set ")[2].partition("=")
    assert name == "mind.range_m"
    assert 3.3 <= float(value) <= 4.2
    changed = socialbot_here(
        "test", project / "expected.py", project / "graph.yaml", "--out", tmp_path / "again", "--set", f"{name}={value}"
    )
    assert changed.returncode == 0, changed.stdout


@pytest.mark.parametrize(
    ("text", "arguments", "code", "words"),
    [
        (None, ("graph.yaml",), 4, "there is no such file"),
        ("x = 1", ("graph.yaml",), 4, "there is no expectation"),
        ("1 / 0", ("graph.yaml",), 4, "ZeroDivisionError"),
        (BEHAVIOURS, (), 4, "nothing to test"),
        (BEHAVIOURS, ("graph.yaml", "-k", "nowhere"), 4, "no expectation has 'nowhere'"),
        (BEHAVIOURS, ("runs/none",), 3, "no such file or folder"),
        (BEHAVIOURS, ("nosuchgraph",), 4, "nosuchgraph"),
        (BEHAVIOURS, ("graph.yaml", "--graph", "waldo"), 4, "only bags are replayed with a graph"),
        (BEHAVIOURS, ("graph.yaml", "--set", "mind.nothing=1"), 4, "no parameter 'nothing'"),
        (
            BEHAVIOURS,
            ("--live", "graph.yaml", "--junit", "r.xml", "--strict"),
            4,
            "--junit: without effect with --live",
        ),
        (BEHAVIOURS, ("--live", "graph.yaml", "--no-cache"), 4, "--cache: without effect with --live"),
        (BEHAVIOURS, ("graph.yaml", "--machine", "robot"), 4, "--machine: without effect without --live"),
        (
            "from socialbot.testing import *\nx = never(said('a')).within(2)",
            ("graph.yaml",),
            4,
            "other.py: x: within()",
        ),
        (
            "from socialbot.testing import *\nx = expect(said(to=believed)).in_total()",
            ("graph.yaml",),
            4,
            "to=",
        ),
    ],
)
def test_mistakes(project: Path, monkeypatch, text, arguments, code: int, words: str) -> None:
    monkeypatch.chdir(project)
    behaviours = project / "other.py"
    if text is not None:
        behaviours.write_text(text, "utf-8")
    done = socialbot_here("test", behaviours, *arguments)
    assert (done.returncode, words in done.stderr) == (code, True), done.stderr
    assert "remedy" in done.stderr
