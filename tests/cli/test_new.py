"""``socialbot new``: what it writes runs at once, and it overwrites nothing."""

from __future__ import annotations

import importlib.util
import itertools
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal, get_args

import msgspec
import pytest

from socialbot.cli.new import Language, project_files, write_project
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.core.installation import pip_command
from socialbot.core.messages import Message, PersonDetection, PersonDetections, TraceRecord, Utterance
from socialbot.graph.files import load_graph
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph
from socialbot.runtime.deployment import load_deployment
from socialbot.vision.metrics.behaviour import DETECTIONS
from socialbot.vision.metrics.truth import GroundTruth, TruthFrame, load_truth, truth_beside
from tests.example_modules import load_file
from tests.system.running import limited, socialbot, socialbot_here

NUMBERS = itertools.count()
KINDS: tuple[Literal["python", "asl"], ...] = get_args(Language)


@pytest.fixture(params=KINDS)
def project(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of each kind, whose package has a name of its own: this process imports it."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    return write_project(f"greeter{next(NUMBERS)}_{request.param}", request.param, tmp_path)


def test_graphs_and_deployment_are_valid(project: Path) -> None:
    assert [one.name for one in load_graph(str(project / "graph.yaml")).nodes] == ["visitors", "mind", "speech"]
    assert load_graph(str(project / "camera.yaml")).paced_by == "/humans/bodies/detections"
    deployment = load_deployment(project / "deployment.yaml")
    assert [one.name for one in deployment.half("workstation")] == ["mind"]


@pytest.fixture
def planning_project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of a planning robot."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    return write_project(f"planner{next(NUMBERS)}", "python", tmp_path, "planning")


def test_tests_of_the_project_pass(project: Path) -> None:
    check_tests_pass(project)


def test_a_run_warns_of_an_action_that_the_robot_does_not_have(tmp_path: Path) -> None:
    project = write_project(f"greeter{next(NUMBERS)}", "asl", tmp_path)
    plans = project / project.name / "agent.asl"
    plans.write_text(plans.read_text().replace('say("Goodbye!")', 'sya("Goodbye!")'))
    done = socialbot("run", project / "graph.yaml", "--out", tmp_path / "run")
    assert done.returncode == 0
    assert f"{plans}:12: there is no action sya/1; did you mean say?" in done.stderr


def test_a_planning_robot_runs_and_its_tests_pass(planning_project: Path) -> None:
    assert [one.name for one in load_graph(str(planning_project / "graph.yaml")).nodes] == [planning_project.name]
    check_tests_pass(planning_project)
    name = planning_project.name
    files = {path.relative_to(planning_project).as_posix() for path in planning_project.rglob("*") if path.is_file()}
    assert {".gitignore", "README.md", "graph.yaml", f"{name}/domain.pddl", f"{name}/agent.py"} <= files
    assert not [path for path in files if "my_robot" in (planning_project / path).read_text("utf-8", "ignore")]


def test_a_project_for_a_robot_has_its_profile_and_graph(tmp_path: Path) -> None:
    done = socialbot_here("new", "hostess", "--robot", "reachy_mini", "--out", tmp_path)
    assert done.returncode == 0
    assert "socialbot doctor --robot robot.yaml" in done.stdout
    graph = load_graph(str(tmp_path / "hostess" / "robot_graph.yaml"))
    assert graph.node("robot_head").type.__name__ == "ReachyHead"
    assert (tmp_path / "hostess" / "robot.yaml").read_text().splitlines()[1:3] == ["like: reachy_mini", "name: hostess"]


def test_a_project_for_a_robot_of_ones_own_holds_its_profile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robby.yaml").write_text(
        "name: robby\ncamera: {image: /eye/image_raw, info: /eye/camera_info}\nspeech: {type: topic, topic: /speech}\n"
    )
    assert socialbot_here("new", "robby_host", "--robot", "robby.yaml").returncode == 0
    (tmp_path / "robby.yaml").unlink()
    (tmp_path / "robby_host").rename(tmp_path / "moved")
    monkeypatch.chdir("/")
    graph = load_graph(str(tmp_path / "moved" / "robot_graph.yaml"))
    assert graph.node("speech").type.__name__ == "TopicSpeaker"
    readme = (tmp_path / "moved" / "README.md").read_text()
    assert "socialbot doctor --robot robot.yaml" in readme
    assert "socialbot up robot_graph.yaml" in readme


def test_an_unknown_robot_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    done = socialbot_here("new", "hostess", "--robot", "reachy", "--out", tmp_path)
    assert (done.returncode, list(tmp_path.iterdir())) == (4, [])
    done = socialbot_here("new", "hostess", "--robot", "tiago", "--template", "planning", "--out", tmp_path)
    assert (done.returncode, list(tmp_path.iterdir())) == (4, [])


def test_a_planning_robot_in_agentspeak_is_refused(tmp_path: Path) -> None:
    done = socialbot("new", "courier", "--template", "planning", "--language", "asl", "--out", tmp_path)
    assert done.returncode != 0
    assert "omit --language asl" in done.stderr
    assert not (tmp_path / "courier").exists()


def check_tests_pass(project: Path) -> None:
    """Run the tests of a project in this process."""
    module = load_file(project / "tests" / "test_agent.py", f"tests_of_{project.name}")
    tests = [value for name, value in vars(module).items() if name.startswith("test_")]
    assert len(tests) == 2
    for test in tests:
        test()


VISITORS = Path(__file__).parents[2] / "data" / "synthetic" / "visitors_tune"
NEAR_M, SLACK_M = 3.0, 0.3


def greeter(project: Path) -> Graph:
    """Return the graph of a project for a camera, with its mind and its voice alone, fed with detections."""
    nodes = tuple(each for each in load_graph(str(project / "camera.yaml")).nodes if each.name in ("mind", "speech"))
    graph = Graph(project.name, nodes, inputs=frozenset({DETECTIONS}))
    return graph.with_parameters({"speech": {"playback": "off"}})


def said(graph: Graph, frames: Iterable[PersonDetections]) -> list[tuple[int, str]]:
    """Return the stamps and texts of the sentences for these detections."""
    found: list[tuple[int, str]] = []
    runner = None

    def note(topic: str, message: Message) -> None:
        assert isinstance(message, Utterance)
        found.append((message.stamp, message.text))

    for frame in frames:
        if runner is None:
            runner = InlineRunner(graph, start=frame.stamp)
            runner.tap("/speech/say", note)
            runner.start()
        runner.feed(DETECTIONS, frame)
    assert runner is not None
    runner.close()
    return found


def near(frame: TruthFrame, within_m: float = NEAR_M) -> set[str]:
    return {one.id for one in frame.persons if one.distance_m is not None and one.distance_m <= within_m}


def shown(truth: GroundTruth, rng: random.Random) -> Iterator[PersonDetections]:
    """Yield the true people with inexact distances; each is missed for 3 to 6 s while near, again and again."""
    missed: dict[str, int] = {}
    for frame in truth.frames:
        for who in near(frame):
            if frame.stamp >= missed.get(who, 0) and rng.random() < 0.1:
                missed[who] = frame.stamp + nanoseconds(rng.uniform(3.0, 6.0))
        persons = [one for one in frame.persons if one.id not in near(frame) or frame.stamp >= missed.get(one.id, 0)]
        yield PersonDetections(
            stamp=frame.stamp, frame_id="camera", width=640, height=480,
            persons=tuple(
                PersonDetection(
                    x=one.x, y=one.y, w=one.w, h=one.h, score=0.9, track_id=one.id,
                    distance_m=None if one.distance_m is None else max(0.0, one.distance_m + rng.gauss(0.0, 0.1)),
                )
                for one in persons
            ),
        )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_each_visitor_gets_one_goodbye_when_they_leave_although_detections_have_gaps(project: Path, seed: int) -> None:
    truth = load_truth(truth_beside(VISITORS))
    sentences = said(greeter(project), shown(truth, random.Random(seed)))
    visitors = set().union(*(near(frame) for frame in truth.frames))
    goodbyes = [stamp for stamp, text in sentences if text == "Goodbye!"]
    assert len(sentences) - len(goodbyes) == len(visitors) == 6
    assert len(goodbyes) == 6, "D comes twice, and I stays"
    check_goodbyes(truth, goodbyes)


def check_goodbyes(truth: GroundTruth, goodbyes: list[int]) -> None:
    """Check that each goodbye is said when somebody walks away who was near in the last 3 s."""
    for stamp in goodbyes:
        before = [frame for frame in truth.frames if stamp - nanoseconds(3.0) <= frame.stamp <= stamp]
        left = set().union(*(near(frame, NEAR_M + SLACK_M) for frame in before)) - near(before[-1])
        assert left, f"nobody left at {stamp}"


@pytest.mark.slow
def test_people_on_a_video_get_goodbyes_only_when_they_leave(project: Path, tmp_path: Path) -> None:
    bag, graph = copied(VISITORS, tmp_path), project / "camera.yaml"
    done = socialbot_here("replay", bag, "--graph", graph, "--out", tmp_path / "run", "--no-video")
    assert done.returncode == 0, done.stderr
    truth = load_truth(truth_beside(VISITORS))
    records = [msgspec.json.decode(line, type=TraceRecord) for line in (tmp_path / "run/trace.jsonl").open("rb")]
    goodbyes = [each.stamp for each in records if (each.kind, each.what) == ("utterance", "Goodbye!")]
    assert 5 <= len(goodbyes) <= 6
    check_goodbyes(truth, goodbyes)


def copied(bag: Path, folder: Path) -> Path:
    """Copy a bag without its ground truth."""
    return Path(shutil.copytree(bag, folder / bag.name))


@pytest.mark.slow
def test_project_is_independent(project: Path) -> None:
    scripts = Path(sys.executable).parent
    for command in (
        [sys.executable, "-m", "pytest", "-q"],
        [scripts / "ruff", "check", "."],
        [scripts / "ruff", "format", "--check", "."],
        [scripts / "pyright", "--pythonpath", sys.executable, project.name, "tests"],
    ):
        done = subprocess.run(command, cwd=project, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, f"{done.args}\n{done.stdout}\n{done.stderr}"


def test_template_name_is_replaced(project: Path) -> None:
    files = [path for path in project.rglob("*") if path.is_file()]
    assert {".gitignore", "README.md", "pyproject.toml", f"{project.name}.launch.py"} <= {path.name for path in files}
    assert not [path for path in files if "my_robot" in f"{path}{path.read_text('utf-8')}"]


@pytest.mark.parametrize("agent", KINDS)
def test_files_compile(agent: Literal["python", "asl"]) -> None:
    files = project_files("my_robot", agent)
    assert {"graph.yaml", "my_robot/agent.py", "tests/test_agent.py", "launch/my_robot.launch.py"} <= set(files)
    for path, text in files.items():
        if path.endswith(".py"):
            compile(text, path, "exec")


def test_prints_next_commands(tmp_path: Path) -> None:
    done = socialbot("new", "my_robot", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"cd {tmp_path / 'my_robot'}" in done.stdout
    assert "socialbot run graph.yaml" in done.stdout
    assert (tmp_path / "my_robot" / "graph.yaml").exists()
    assert "install pytest" not in done.stdout


def test_a_missing_pytest_is_installed_into_the_environment_of_socialbot(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    done = socialbot_here("new", "my_robot", "--out", tmp_path)
    assert f"run its tests; before them: {pip_command('install', 'pytest')}" in done.stdout


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("My-Robot", "not a name for a Python package"),
        ("1robot", "not a name for a Python package"),
        ("../robot", "not a name for a Python package"),
        ("class", "not a name for a Python package"),
        ("", "exists already"),
        ("json", "a Python module 'json' exists already"),
        ("socialbot", "a Python module 'socialbot' exists already"),
        ("numpy", "a Python module 'numpy' exists already"),
        ("tests", "a Python module 'tests' exists already"),
    ],
)
def test_refuses_invalid_names(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=words):
        write_project(name, "python", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_refuses_existing_folder(tmp_path: Path) -> None:
    mine = tmp_path / "my_robot" / "agent.py"
    mine.parent.mkdir()
    mine.write_text("mine", "utf-8")
    with pytest.raises(ParameterError, match="exists already"):
        write_project("my_robot", "python", tmp_path)
    assert [path.name for path in mine.parent.iterdir()] == ["agent.py"]
    assert mine.read_text("utf-8") == "mine"


def test_a_project_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    with limited(resource.RLIMIT_FSIZE, 600), pytest.raises(ParameterError, match="cannot be written: File too large"):
        write_project("greeter", "python", tmp_path)
    assert not (tmp_path / "greeter").exists()
