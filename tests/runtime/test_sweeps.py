"""Sweeps of a real agent over a bag, whose people come from a network that sees the same in every image."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from socialbot.core.errors import ParameterError, RunError
from socialbot.runs.expectations import load_behaviours
from socialbot.runs.sweep_page import classes, heat_maps, sweep_page
from socialbot.runs.sweeps import Axis, BagResult, Sweep, SweepCell, SweepVerdict, measured
from socialbot.runtime.sweeps import JOURNAL, Journal, SweepPlan, SweepRunner, number_text, parse_variation
from tests.system.running import limited, socialbot, socialbot_here
from tests.vision.metrics.scenes import drawn_bag
from tests.vision.networks import constant_network, yolov8_rows

GRAPH = """\
name: eyes
inputs: [/camera/image_raw, /camera/image_raw/compressed, /camera/camera_info]
paced_by: /humans/bodies/detections
nodes:
  image_converter: {{type: image_converter}}
  person_detector:
    type: person_detector
    parameters: {{detector: onnx, model: {model}, layout: yolov8, faces: false, tracker: kalman}}
  bdi_engine: {{type: waldo}}
  listener: {{type: listener}}
  speech: {{type: speaker, parameters: {{engine: bdi_engine}}, remap: {{health: /bdi_engine/health}}}}
"""
GREETS_SOON = """\
from socialbot.testing import expect, person, said

greets = expect(said("greeting")).within(1.05).after(person(nearer_than=50))
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    """A bag with a graph that sees one person in every image."""
    made = drawn_bag(tmp_path_factory.mktemp("bags"), frames=30, beside=False)
    model = made.with_name("model.onnx")
    answers = {"boxes": yolov8_rows((250, 100, 100, 300, 0.9))}
    model.write_bytes(constant_network(answers, shape=(1, 3, 480, 640)))
    made.with_name("eyes.yaml").write_text(GRAPH.format(model=model))
    made.with_name("behaviours.py").write_text(GREETS_SOON)
    return made


def test_a_folder_with_a_link_to_elsewhere_is_refused(bag: Path, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.write_text("mine")
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / JOURNAL).symlink_to(outside)
    with pytest.raises(RunError, match="link"):
        SweepRunner(plan_of(bag, "waldo.appear_s=0.2,2"), tmp_path / "sweep", lambda done, total: None)
    assert outside.read_text() == "mine"


def plan_of(bag: Path, *variations: str, **more) -> SweepPlan:
    settings = {"graph": str(bag.with_name("eyes.yaml")), "expectations": bag.with_name("behaviours.py"), **more}
    return SweepPlan([bag], [parse_variation(text) for text in variations], **settings)


def swept(plan: SweepPlan, folder: Path) -> Sweep:
    return SweepRunner(plan, folder, lambda done, total: None).run()


def outcomes(sweep: Sweep) -> list[tuple[tuple[str, ...], bool]]:
    return [(cell.values, cell.passed) for cell in sweep.cells]


def test_lists_ranges_and_values_are_read():
    assert parse_variation("waldo.range_m=3,6,9").listed() == ("3", "6", "9")
    assert parse_variation("waldo.help_after_s=2:3:0.25").listed() == ("2", "2.25", "2.5", "2.75", "3")
    assert parse_variation("waldo.help_after_s=0.1:0.7:0.2").listed() == ("0.1", "0.3", "0.5", "0.7")
    assert parse_variation("waldo.greeting=At 10:30 we open").listed() == ("At 10:30 we open",)
    assert number_text(0.1 + 0.2) == "0.3"


@pytest.mark.parametrize("text", ["waldo.range_m=1:1e9:1e-7", "waldo.range_m=-1e308:1e308:1", "a.b=0:1:1e-320"])
def test_ranges_of_too_many_steps_are_refused_at_once(text):
    with pytest.raises(ParameterError, match="more than 100000 settings"):
        parse_variation(text).listed()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("range_m=3", "write NODE.PARAMETER"),
        ("waldo.range_m", "write NODE.PARAMETER"),
        ("waldo.range_m=", "write NODE.PARAMETER"),
        ("waldo.range_m=9:3:1", "LOW must be below HIGH"),
        ("waldo.range_m=3:9:0", "LOW must be below HIGH"),
        ("waldo.range_m=3:inf:1", "LOW must be below HIGH"),
    ],
)
def test_other_texts_are_refused(text, message):
    with pytest.raises(ParameterError, match=message):
        parse_variation(text)


def test_a_grid_runs_every_combination(bag, tmp_path):
    sweep = swept(plan_of(bag, "waldo.appear_s=0.2,2", "waldo.range_m=1,40"), tmp_path)
    assert outcomes(sweep) == [
        (("0.2", "1"), False),
        (("0.2", "40"), True),
        (("2", "1"), False),
        (("2", "40"), False),
    ]
    assert sweep.cells[0].failures() == [f"{bag.name}: greets"]
    reason = sweep.cells[0].results[0].verdicts[0].reason
    assert reason.startswith("fails at 0.")
    assert "person" in reason


def test_the_bag_of_the_current_folder_has_its_name(bag, tmp_path, monkeypatch):
    monkeypatch.chdir(bag)
    plan = SweepPlan([Path()], [parse_variation("waldo.appear_s=0.2")], str(bag.with_name("eyes.yaml")))
    found = swept(plan, tmp_path / "sweep")
    assert found.bags == tuple(result.bag for result in found.cells[0].results) == (bag.name,)


@pytest.mark.slow
def test_parallel_processes_find_the_same(bag, tmp_path):
    plan = plan_of(bag, "waldo.appear_s=0.2,2", "waldo.range_m=1,40")
    parallel = plan_of(bag, "waldo.appear_s=0.2,2", "waldo.range_m=1,40", jobs=2)
    assert swept(plan, tmp_path / "one") == swept(parallel, tmp_path / "two")


@pytest.mark.slow
def test_two_worker_processes_of_a_cluster_find_the_same(bag, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        variations = "waldo.appear_s=0.2,2", "waldo.range_m=1,40"
        there = swept(plan_of(bag, *variations, scheduler=cluster.scheduler_address), tmp_path / "there")
        gone = plan_of(bag, *variations, scheduler="tcp://127.0.0.1:9")
        monkeypatch.setattr("socialbot.vision.metrics.workers.CONNECT_S", 0.5)
        with pytest.raises(ParameterError, match="no Dask scheduler answers"):
            swept(gone, tmp_path / "gone")
    assert there == swept(plan_of(bag, *variations), tmp_path / "here")


def test_expectations_of_an_agent_package_are_found_by_its_name(bag, tmp_path):
    sweep = swept(plan_of(bag, "waldo.appear_s=0.2", expectations=Path("waldo")), tmp_path)
    [verdicts] = [result.verdicts for cell in sweep.cells for result in cell.results]
    assert [each.name for each in verdicts] == [each.name for each in load_behaviours("waldo")]


def test_finished_runs_are_not_repeated(bag, tmp_path, monkeypatch):
    first = swept(plan_of(bag, "waldo.appear_s=0.2,2"), tmp_path)
    journal = tmp_path / JOURNAL
    journal.write_bytes(journal.read_bytes()[:-20])  # as after an interruption while a line was written
    runner = SweepRunner(plan_of(bag, "waldo.appear_s=0.2,2"), tmp_path, lambda done, total: None)
    assert (runner.run(), runner.reused) == (first, 1)
    more = SweepRunner(plan_of(bag, "waldo.appear_s=0.2,2,3"), tmp_path, lambda done, total: None)
    assert (len(more.run().cells), more.reused) == (3, 2)
    other = bag.with_name("other.py")
    other.write_text(GREETS_SOON.replace("1.05", "3"))
    changed = SweepRunner(plan_of(bag, "waldo.appear_s=0.2,2", expectations=other), tmp_path, lambda done, total: None)
    changed.run()
    assert changed.reused == 0


def test_a_bisection_finds_where_the_expectation_flips(bag, tmp_path):
    sweep = swept(plan_of(bag, "waldo.appear_s=0:3:0.05", "waldo.range_m=1,40", method="bisect"), tmp_path)
    never, flips = sweep.thresholds
    assert (never.values, never.below, never.outcome_below) == (("", "1"), None, "fails")
    assert (flips.outcome_below, flips.outcome_above) == ("passes", "fails")
    low, high = float(flips.below or "nan"), float(flips.above or "nan")
    assert 0 < high - low <= 0.05
    grid = swept(plan_of(bag, f"waldo.appear_s={low},{high}", "waldo.range_m=40"), tmp_path / "grid")
    assert [cell.passed for cell in grid.cells] == [True, False]


@pytest.mark.slow
def test_without_expectations_a_bisection_finds_other_decisions(bag, tmp_path):
    sweep = swept(plan_of(bag, "waldo.range_m=1:40", method="bisect", expectations=None), tmp_path)
    [flip] = sweep.thresholds
    known = {cell.values[0]: cell.digests for cell in sweep.cells}
    assert known[flip.below or ""] != known[flip.above or ""]


@pytest.mark.parametrize("method", ["random", "sobol"])
def test_samples_depend_on_the_seed_alone(bag, method):
    if method == "sobol":
        pytest.importorskip("scipy")

    def cells(seed: int) -> list[tuple[str, ...]]:
        variations = ["waldo.appear_s=0:3", "waldo.range_m=1,40", "waldo.vanish_s=1:4:1"]
        return plan_of(bag, *variations, method=method, samples=12, seed=seed).cells()

    found = cells(1)
    assert found == cells(1) != cells(2)
    assert len(found) == 12
    assert all(0 <= float(a) < 3 and b in ("1", "40") and c in "1234" for a, b, c in found)
    assert {b for _, b, _ in found} == {"1", "40"}


def test_impossible_values_are_refused_before_anything_runs(bag, tmp_path):
    with pytest.raises(ParameterError, match="out of range"):
        swept(plan_of(bag, "waldo.appear_s=0.2,99"), tmp_path)
    assert not (tmp_path / JOURNAL).exists()
    with pytest.raises(ParameterError, match="a grid needs the step"):
        swept(plan_of(bag, "waldo.appear_s=0:3"), tmp_path)
    with pytest.raises(ParameterError, match="0 parameters have a range"):
        swept(plan_of(bag, "waldo.appear_s=1,2", method="bisect"), tmp_path)


def cell(number: int, values: tuple[str, ...], missed: float, said: float, *, passed: bool = True, digest: str = ""):
    verdicts = (SweepVerdict("greets", passed, "" if passed else "fails at 1 s"),)
    result = BagResult(
        bag="b", digest=digest or str(number), measures={"missed": missed, "said": said}, verdicts=verdicts
    )
    return SweepCell(number, values, (result,))


def made_sweep(*cells: SweepCell) -> Sweep:
    axes = tuple(
        Axis(name, tuple(dict.fromkeys(each.values[number] for each in cells)))
        for number, name in enumerate(("n.a", "n.b"))
    )
    return Sweep(graph="g", bags=("b",), axes=axes, expectations="e.py", cells=cells)


def test_the_front_holds_passing_settings_that_no_other_beats():
    cells = [
        cell(1, ("1", "1"), 0, 5),
        cell(2, ("1", "2"), 1, 3),
        cell(3, ("2", "1"), 1, 4),
        cell(4, ("2", "2"), 0, 1, passed=False),
    ]
    assert [each.number for each in made_sweep(*cells).pareto(("missed", "said"))] == [1, 2]


def test_neighbours_that_pass_and_fail_are_compared():
    cells = [
        cell(1, ("1", "1"), 0, 5),
        cell(2, ("10", "1"), 0, 5, passed=False),
        cell(3, ("2", "1"), 0, 5, digest="1"),
        cell(4, ("2", "2"), 0, 5),
    ]
    pair = made_sweep(*cells).pair()
    assert pair is not None
    assert [each.number for each in pair] == [2, 3]
    same = made_sweep(*(cell(number, (str(number), "1"), 0, 5, digest="x") for number in (1, 2)))
    assert same.pair() is None


def test_a_heat_map_is_in_the_order_of_numbers():
    cells = [cell(i, (a, b), 0, 1) for i, (a, b) in enumerate([("10", "x"), ("9", "x"), ("2.5", "x"), ("9", "y")], 1)]
    [map] = heat_maps(made_sweep(*cells))
    assert (map.x, map.y) == (("2.5", "9", "10"), ("x", "y"))
    assert [[each and each.text for each in row] for row in map.rows] == [["C", "B", "A"], [None, "D", None]]
    assert list(classes(made_sweep(*cells)).values()) == ["A", "B", "C", "D"]


def test_the_page_names_values_that_all_cells_share():
    page = sweep_page(made_sweep(cell(1, ("1", "7.25"), 0, 1), cell(2, ("2", "7.25"), 0, 2)), ("missed", "said")).html()
    assert "Set for all" in page
    assert "7.25" in page.partition("Set for all")[2]
    varied = sweep_page(made_sweep(cell(1, ("1", "7"), 0, 1), cell(2, ("2", "8"), 0, 2)), ("missed", "said")).html()
    assert "Set for all" not in varied


def test_the_page_escapes_what_it_shows():
    bad = cell(1, ("<script>", "1"), 0, 1, passed=False)
    text = sweep_page(made_sweep(bad, cell(2, ("2", "2"), 0, 2)), ("missed", "said")).html()
    assert "&lt;script&gt;" in text
    assert "<script>1" not in text


def test_the_command_writes_a_page_and_goes_on(bag, tmp_path):
    command = ["sweep", bag, "--graph", bag.with_name("eyes.yaml"), "--expect", bag.with_name("behaviours.py")]
    command += ["--set", "waldo.appear_s=0.2,2", "--out", tmp_path / "out", "--jobs", "1"]
    done = socialbot_here(*command)
    assert done.returncode == 0, done.stderr
    assert "passes" in done.stdout
    assert "Cell 1 (appear_s=0.2) and cell 2 (appear_s=2)" in done.stdout
    assert "because" in done.stdout
    page = (tmp_path / "out" / "index.html").read_text()
    assert "First different decision" in page
    again = socialbot_here(*command, "--json")
    assert len(msgspec.json.decode(again.stdout)["cells"]) == 2
    assert "2 of them from before" in socialbot_here(*command).stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "nothing to vary"),
        (["--set", "nobody.range_m=1,2"], "no node 'nobody'"),
        (["--set", "waldo.range_m=1,2", "--compare", "1,9"], "no cell '9'"),
        (["--set", "waldo.range_m=1,2", "--pareto", "fun,said"], "--pareto"),
        (["--set", "waldo.range_m=1,2", "--expect", "nowhere.py"], "there is no such file"),
    ],
    ids=str,
)
def test_mistakes_are_explained(bag, tmp_path, options, message):
    command = ["sweep", bag, "--graph", bag.with_name("eyes.yaml"), "--out", tmp_path / "out", "--jobs", "1"]
    refused = socialbot_here(*command, *options)
    assert refused.returncode == 4
    assert message in refused.stderr


@pytest.mark.slow
def test_an_interrupted_sweep_continues(bag, tmp_path):
    command = ["sweep", bag, "--graph", bag.with_name("eyes.yaml"), "--set", "waldo.vanish_s=1:30:0.25"]
    command += ["--out", tmp_path / "out", "--jobs", "2"]
    running = subprocess.Popen(
        [sys.executable, "-m", "socialbot", *map(str, command)], stderr=subprocess.PIPE, text=True, env=os.environ
    )
    journal = tmp_path / "out" / JOURNAL
    while running.poll() is None and (not journal.exists() or journal.read_bytes().count(b"\n") < 10):
        pass
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=120)
    assert "continues" in errors
    before = journal.read_bytes().count(b'"key"')
    assert 0 < before < 117
    done = socialbot(*command)
    assert done.returncode == 0, done.stderr
    assert f"{before} of them from before" in done.stdout.replace("\n", " ")


def test_measures_count_what_a_run_did(bag, tmp_path):
    from socialbot.runs.folder import open_run
    from socialbot.runtime.bag_source import replay
    from socialbot.runtime.sweeps import graph_for

    replay(bag, graph_for(bag, str(bag.with_name("eyes.yaml"))), tmp_path / "run")
    run = open_run(tmp_path / "run")
    found = measured(run, bag.name)
    said = [record for record in run.history if record.kind == "utterance"]
    assert found.measures["said"] == len(said) > 0
    assert found.measures["first_said_s"] == pytest.approx(run.history.seconds(said[0].stamp), abs=1e-3)
    assert all(one.stamp <= two.stamp for one, two in pairwise(said))


def test_a_result_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    journal = Journal(tmp_path / JOURNAL)
    with limited(resource.RLIMIT_FSIZE, 0), pytest.raises(RunError, match="cannot be written: File too large"):
        journal.add("key", BagResult(bag="bag"))
