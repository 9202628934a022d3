"""The tutorials and how-to pages, followed word by word in an empty folder."""

from __future__ import annotations

import itertools
import re
import shlex
from contextlib import ExitStack
from pathlib import Path

import cv2
import pytest

import socialbot as socialbot_package
from socialbot.bags.reader import open_bag
from socialbot.cli.new import write_project
from socialbot.core.messages import CompressedImage
from socialbot.vision.images import bgr_from_compressed
from tests.system.following import DOCS, Block, Terminal, blocks, follow, has_its_place, same, save
from tests.system.running import actions, cut, eventually, socialbot, socialbot_here
from tests.system.two_hosts import TwoHosts, two_hosts

HOWTO = sorted(f"howto/{page.name}" for page in (DOCS / "howto").glob("*.md"))
TUTORIALS = [
    "tutorial.md",
    "tutorial-devices.md",
    "tutorial-agent.md",
    "tutorial-machines.md",
    "tutorial-behaviours.md",
]
AGENT, MACHINES, BEHAVIOURS = TUTORIALS[2:]
EXTENDING = "howto/extending.md"
VIDEO_S = (12.0, 14.0)
NOT_TYPED = (
    "howto/asking.md",
    "howto/ci.md",
    "howto/dialogue.md",
    "howto/hearing.md",
    "howto/language-model.md",
    "howto/reachy-mini.md",
    "howto/reception.md",
    "howto/requests.md",
    "howto/robots.md",
    "howto/simulation.md",
    "howto/study.md",
    "howto/teams.md",
)
"""Pages with files for services elsewhere, with excerpts, or with commands for a microphone, a robot or an extra."""


def test_all_howto_pages_exist() -> None:
    assert [Path(page).stem for page in HOWTO] == [
        "agentspeak",
        "asking",
        "cameras",
        "ci",
        "detectors",
        "dialogue",
        "extending",
        "hearing",
        "language-model",
        "planners",
        "reachy-mini",
        "reception",
        "requests",
        "robots",
        "services",
        "simulation",
        "study",
        "teams",
        "topics",
        "voices",
        "warehouse",
    ]


@pytest.mark.parametrize("page", [*TUTORIALS, *HOWTO])
def test_every_block_is_a_file_a_command_or_its_output(page: str) -> None:
    told = blocks(page)
    for before, block in zip([None, *told], told, strict=False):
        assert has_its_place(block, before), block.text
    assert page != MACHINES or sum(map(is_live, told)) == 2


def film(bag: Path, out: Path) -> None:
    """A part of a bag as a video, every third picture of it."""
    writer = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (640, 480))
    begin_s, end_s = VIDEO_S
    with open_bag(bag) as source:
        topics = {topic.name: topic.name for topic in source.image_topics}
        for number, (_, message) in enumerate(source.messages(topics)):
            seconds = (message.stamp - source.start) / 1e9
            if isinstance(message, CompressedImage) and begin_s <= seconds < end_s and number % 3 == 0:
                writer.write(bgr_from_compressed(message))
    writer.release()


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in HOWTO if page != EXTENDING])
def test_howto_pages_show_what_happens(page: str, corridor: Path, tmp_path: Path) -> None:
    if page == "howto/cameras.md":
        film(corridor, tmp_path / "visit.avi")
    if page == "howto/planners.md":
        pytest.importorskip("kairos", reason="kairos-planner is not installed")
    assert follow(blocks(page), Terminal(tmp_path)) > 0 or page in NOT_TYPED


def checkout(folder: Path) -> None:
    """Fill ``folder`` with a checkout whose commands can be changed."""
    package = Path(socialbot_package.__file__).parent
    (folder / "socialbot/cli").mkdir(parents=True)
    for path in (*package.iterdir(), *package.joinpath("cli").iterdir()):
        if path.name not in ("cli", "__pycache__"):
            (folder / "socialbot" / path.relative_to(package)).symlink_to(path)


def install(project: str, folder: Path) -> None:
    """Write what pip leaves in ``folder`` when it installs a project there without its files."""
    name, points = re.search(r'^name = "(\w+)"', project, re.MULTILINE), project.partition("[project.entry-points.")[2]
    assert name is not None
    info = folder / f"{name[1]}-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name[1]}\nVersion: 0.1.0\n", "utf-8")
    (info / "entry_points.txt").write_text("[" + points.replace('"', ""), "utf-8")


@pytest.mark.slow
def test_a_node_an_agent_and_a_command_are_added(corridor: Path, tmp_path: Path) -> None:
    told = blocks(EXTENDING)
    project = next(number for number, block in enumerate(told) if block.file == "pyproject.toml")
    checkout(tmp_path)
    cut(corridor, tmp_path / "corridor", 0.0, 6.0)
    terminal = Terminal(tmp_path, PYTHONPATH=str(tmp_path))
    assert follow(told[: project + 1], terminal) == 2
    install(told[project].text, tmp_path)
    assert follow(told[project + 1 :], terminal) == 4


BEGIN = [". .venv/bin/activate", "socialbot new my_robot", "cd my_robot"]
"""The first commands of the tutorials on a project."""


def project(told: list[Block], folder: Path) -> Terminal:
    """A terminal where the first commands lead."""
    assert told[0].text.splitlines() == BEGIN
    terminal = Terminal(folder)
    code, printed = terminal.type(BEGIN[1])
    assert code == 0, printed
    terminal.folder = folder / "my_robot"
    return terminal


@pytest.mark.slow
def test_the_first_tutorial(tmp_path: Path) -> None:
    told = blocks("tutorial.md")
    assert follow(told[1:], project(told, tmp_path)) > 5


@pytest.mark.slow
def test_the_tutorial_on_devices(tmp_path: Path) -> None:
    told = blocks("tutorial-devices.md")
    assert follow(told[1:], project(told, tmp_path)) > 5


@pytest.mark.slow
def test_the_tutorial_on_behaviours(tmp_path: Path) -> None:
    told = blocks(BEHAVIOURS)
    assert follow(told[1:], project(told, tmp_path)) > 5


def polite(folder: Path) -> Path:
    """The graph of the polite Waldo, with the module beside it."""
    for block in blocks("tutorial.md"):
        if block.file.startswith("polite"):
            (folder / block.file).write_text(block.text, "utf-8")
    return folder / "polite.yaml"


@pytest.mark.slow
def test_the_agent_of_the_first_tutorial_says_goodbye(corridor: Path, tmp_path: Path) -> None:
    graph = polite(tmp_path)
    bag = cut(corridor, tmp_path / "visit", 12.0, 29.0)
    done = socialbot(
        "replay", bag, "--graph", graph, "--runner", "inline", "--out", tmp_path / "run", "--no-video",
        "--set", "bdi_engine.farewell=See you!", "--set", "bdi_engine.help_after_s=3",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert ("farewell", "See you!") in [arguments for _, name, arguments in actions(tmp_path / "run")]


def test_graph_lists_the_parameters_of_a_new_node(tmp_path: Path) -> None:
    done = socialbot("graph", polite(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "bdi_engine.farewell = 'Goodbye!'" in done.stdout


def transcript(command: str) -> list[str]:
    """The output of a command in the README, by line."""
    _, found, rest = (DOCS.parent / "README.md").read_text("utf-8").partition(f"    $ {command}\n")
    assert found, f"the README does not show {command!r}"
    lines = itertools.takewhile(lambda line: line.startswith("    "), rest.splitlines())
    return [line.removeprefix("    ") for line in lines]


def test_the_readme_shows_verdicts_as_they_are_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    readme = (DOCS.parent / "README.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(from socialbot.testing.*?)```", readme, re.DOTALL)
    monkeypatch.chdir(write_project("readme_robot", "python", tmp_path))
    Path("behaviours.py").write_text(code, "utf-8")
    command = "socialbot test behaviours.py graph.yaml --nearest --out checked"
    done = socialbot_here(*shlex.split(command)[1:])
    assert done.returncode == 1, done.stderr
    assert done.stdout.splitlines() == transcript(command)


@pytest.mark.slow
def test_the_readme_shows_the_reason_as_it_is_printed(corridor: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert socialbot_here("replay", corridor, "--no-video", "--out", run).returncode == 0
    shown = transcript("socialbot why")
    assert socialbot_here("why", run).stdout.splitlines()[: len(shown)] == shown


def is_live(block: Block) -> bool:
    return block.text.startswith("socialbot up")


@pytest.fixture
def terminal(tmp_path: Path) -> Terminal:
    """In an empty folder, to which the first commands of the tutorial lead."""
    assert blocks(AGENT)[0].text.splitlines() == [". .venv/bin/activate", "mkdir garden", "cd garden"]
    (tmp_path / "garden").mkdir()
    return Terminal(tmp_path / "garden")


@pytest.mark.slow
def test_the_tutorial_on_agents(terminal: Terminal) -> None:
    told = blocks(AGENT)[1:]
    live = next(number for number, block in enumerate(told) if is_live(block))
    assert all(block.shows is not None for block in told[:live] if block.language == "sh")
    assert follow(told[:live], terminal) > 5


@pytest.mark.slow
def test_the_robot_of_the_tutorial_on_agents_obeys_commands(terminal: Terminal) -> None:
    told = blocks(AGENT)
    number = next(number for number, block in enumerate(told) if is_live(block))
    save(told[1:number], terminal.folder)
    trace = terminal.folder / "live" / "trace.jsonl"
    with terminal.running(told[number].text):
        assert eventually(lambda: trace.exists() and "water_roses" in trace.read_text("utf-8"), 60.0)
        for command in told[number + 1].text.splitlines():
            code, printed = terminal.type(command)
            assert code == 0, printed
            assert "gina" in printed or "pub" in command, printed
        assert eventually(lambda: "visit" in trace.read_text("utf-8"), 20.0)
    assert [block.language for block in told[number + 1 :]] == ["sh"]


PLACE = re.compile(r"On the (robot|workstation)|On (either) machine")

SCP = """#!/bin/sh
# Copies between the homes of the two hosts: scp [-r] FROM HOST:TO
for to; do :; done
while [ $# -gt 1 ]; do [ "$1" = -r ] || from=$1; shift; done
cp -r "$from" "{homes}/${{to%%:*}}/${{to#*:}}"
"""


def place(block: Block, before: str) -> str:
    """The host on which a block is typed: the one that the text above it names, else that of the block before."""
    found = PLACE.findall(block.before)
    return (found[-1][0] or "robot") if found else before


def terminals(hosts: TwoHosts, homes: Path) -> dict[str, Terminal]:
    """A terminal on each host, in a home of its own."""
    shims = homes / "bin"
    shims.mkdir()
    (shims / "scp").write_text(SCP.format(homes=homes), "utf-8")
    (shims / "scp").chmod(0o755)
    found = {}
    for name, host in (("robot", hosts.robot), ("workstation", hosts.workstation)):
        (homes / name).mkdir()
        terminal = found[name] = Terminal(homes / name, host.command())
        terminal.environment["PATH"] = f"{shims}:{terminal.environment['PATH']}"
    return found


@pytest.mark.slow
@pytest.mark.ros
def test_the_tutorial_on_two_machines(tmp_path: Path) -> None:
    traces = [tmp_path / name / "my_robot" / "runs" / name / "trace.jsonl" for name in ("robot", "workstation")]
    with two_hosts() as hosts, ExitStack() as running:
        at, where = terminals(hosts, tmp_path), "robot"
        for block in blocks(MACHINES):
            where = place(block, where)
            save([block], at[where].folder)
            if is_live(block):
                running.enter_context(at[where].running(block.text))
            elif block.language == "sh":
                of_status = block.text.startswith("socialbot status")
                if of_status:
                    assert eventually(lambda: all("Hello" in words(trace) for trace in traces), 60.0), logs(tmp_path)
                # On a busy machine a report of a node may arrive too late, which `status` tells. It is asked again.
                code, printed = at[where].type(block.text)
                for _ in range(4 if of_status else 0):
                    if code or block.shows is None or same(printed, block.shows):
                        break
                    code, printed = at[where].type(block.text)
                assert code == 0, f"{block.text}\n{printed}"
                assert block.shows is None or same(printed, block.shows), f"{block.text}\n{printed}"
    assert "Hello! Nice to see you." in words(traces[0])


def words(trace: Path) -> str:
    return trace.read_text("utf-8") if trace.exists() else ""


def logs(folder: Path) -> str:
    return "\n".join(f"{log}: {log.read_text('utf-8')}" for log in sorted(folder.rglob("*.log")))
