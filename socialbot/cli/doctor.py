"""``socialbot doctor``: check the installation and say how to fix it."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import textwrap
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from socialbot.bridge import ros_checks
from socialbot.bridge.ros_checks import Check, Finding
from socialbot.cli._console import Console
from socialbot.cli._options import JsonOption, RobotOption, expect_effect, graph_names, many
from socialbot.cli._runs import print_json
from socialbot.core.errors import DeviceError, GraphError, InstallationError, ParameterError, SocialbotError
from socialbot.core.installation import extra_command, installed_version, pip_command
from socialbot.graph.files import load_graph

OLDEST, NEWEST = (3, 10), (3, 14)

PANEL = "Start here"
EXAMPLES = (
    "socialbot doctor",
    "socialbot doctor --quick",
    "socialbot doctor my_graph.yaml",
    "socialbot doctor --robot reachy_mini",
)
GB = 1_000_000_000
MIN_FREE_BYTES = 1 * GB
OPENCV = "opencv-python-headless"
_OPENCV_WHEELS = (OPENCV, "opencv-python", "opencv-contrib-python", "opencv-contrib-python-headless")
_PACKAGES = ("msgspec", "numpy", "rich", "rosbags", "ruamel.yaml", "typer")


def examine(*, quick: bool = False, graph: str = "waldo") -> Iterator[Finding]:
    """Run all checks, of the camera pose for ``graph``.

    With ``quick``, skip the round trip over DDS, which takes seconds.
    """
    for check in (*FIRST_CHECKS, *ros_checks.CHECKS, *LAST_CHECKS):
        if quick and check is ros_checks.round_trip:
            continue
        name = getattr(check, "__name__", "check").replace("_", " ")
        try:
            finding = camera_pose(graph) if check is camera_pose else check()
        except SocialbotError as error:
            finding = Finding(name, "error", error.what, error.remedy or "")
        except Exception as error:  # noqa: BLE001 - a failing check must not stop the others
            finding = Finding(name, "error", f"cannot be checked: {type(error).__name__}: {error}")
        if finding is not None:
            yield finding


def examine_robot(name: str) -> Iterator[Finding]:
    """Check that a robot has and answers all that its profile needs. Raises GraphError for an invalid profile."""
    from socialbot.bridge.robot_checks import check_topics
    from socialbot.robots.profile import load_profile
    from socialbot.robots.requirements import daemon_answers, requirements

    profile = load_profile(name)
    text = profile.title or profile.name
    if profile.tested == "hardware":
        yield Finding("profile", "ok", f"{text}; tested on a robot")
    else:
        remedy = "compare names and limits with your robot, and let it move slowly at first"
        where = "tested in simulation only" if profile.tested == "simulation" else "not tested on a robot"
        yield Finding("profile", "warning", f"{text}; {where}", remedy)
    for answer in daemon_answers(profile):
        state = "error" if answer.problem else "ok"
        yield Finding(answer.part, state, answer.problem or answer.text, answer.remedy if answer.problem else "")
    if profile.camera is not None and profile.camera.device:
        yield _robot_camera(profile.camera.device)
    try:
        needed = tuple(requirements(profile))
    except GraphError as error:
        yield Finding("profile", "error", f"{error.where}: {error.what}", error.remedy or "")
        return
    if needed:
        ros = ros_checks.ros()
        if ros.state == "error":
            yield ros
        else:
            yield from check_topics(needed, profile.hint)


def examine_graph(name: str) -> Iterator[Finding]:
    """Check that the nodes outside a graph are there, and its ROS types installed. Raises GraphError."""
    from socialbot.bridge.robot_checks import check_topics
    from socialbot.robots.requirements import graph_requirements

    graph = load_graph(name)
    ros, needed = ros_checks.ros(), tuple(graph_requirements(graph))
    what = many(len(needed), "connection") if needed else "nothing"
    yield Finding("graph", "ok", f"{graph.name}: needs {what} of other nodes")
    if needed and ros.state != "error":
        yield ros_checks.settings()
        yield from check_topics(needed, "", source="graph file")
    elif needed:
        yield ros


def _robot_camera(source: str) -> Finding:
    """Check that the camera of a robot can be opened on this computer."""
    from socialbot.vision.camera_node import open_frames

    try:
        with closing(open_frames(source)) as frames:
            return Finding("camera", "ok", f"{source}: {frames.size[0]}x{frames.size[1]}")
    except DeviceError as error:
        remedy = f"{error.remedy}; or use --camera FILE"
        return Finding("camera", "warning", f"{error.where or source}: {error.what}", remedy)


def python() -> Finding:
    """Check that ROS wheels exist for this Python version."""
    text = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    if not OLDEST <= sys.version_info[:2] <= NEWEST:
        wanted = f"{'.'.join(map(str, OLDEST))} to {'.'.join(map(str, NEWEST))}"
        return Finding("Python", "error", text, f"make a venv with Python {wanted}")
    return Finding("Python", "ok", text)


def packages() -> Finding:
    """Check that the packages of every command are installed, and no conflicting ones."""
    name = "packages"
    found = {package: installed_version(package) for package in _PACKAGES}
    missing = [package for package, version in found.items() if version is None]
    if missing:
        return Finding(name, "error", f"not installed: {', '.join(missing)}", pip_command("install", *missing))
    if installed_version("lark") is not None and installed_version("lark-parser") is not None:
        remedy = f"{pip_command('uninstall', 'lark', 'lark-parser')}; {pip_command('install', 'lark-parser')}"
        return Finding(name, "warning", "lark conflicts with the lark-parser of the ROS wheels", remedy)
    return Finding(name, "ok", ", ".join(f"{package} {version}" for package, version in found.items()))


def opencv() -> Finding:
    """Check that OpenCV is installed only once, and has the HOG detector."""
    name = "OpenCV"
    remedy = pip_command("install", f"{OPENCV}>=4.12,<5")
    try:
        import cv2
    except ImportError as error:
        return Finding(name, "error", f"cannot be imported: {error}", remedy)
    if int(cv2.__version__.split(".")[0]) >= 5 or not hasattr(cv2, "HOGDescriptor"):
        return Finding(name, "error", f"{cv2.__version__} has no HOG detector for people", remedy)
    installed = [wheel for wheel in _OPENCV_WHEELS if installed_version(wheel) is not None]
    if len(installed) > 1:
        others = pip_command("uninstall", *(wheel for wheel in installed if wheel != OPENCV))
        again = pip_command("install", "--force-reinstall", f"{OPENCV}<5")
        text = f"several wheels overwrite each other: {', '.join(installed)}"
        return Finding(name, "warning", text, f"{others}; {again}")
    return Finding(name, "ok", f"{cv2.__version__}, with the HOG detector")


def network() -> Finding:
    """Check that the neural person detector runs."""
    name = "person detector"
    try:
        from socialbot.vision.detectors import nanodet

        nanodet(0.5)
    except SocialbotError as error:
        return Finding(name, "error", error.what, f"{error.remedy}; or set person_detector.detector=hog")
    return Finding(name, "ok", f"NanoDet runs on onnxruntime {installed_version('onnxruntime')}")


def speech() -> Finding:
    """Check that espeak-ng synthesises a word."""
    name = "speech"
    try:
        from socialbot.speech.synthesis import Synthesizer

        sound = Synthesizer().say("hello")
    except SocialbotError as error:
        return Finding(name, "warning", f"the robot cannot speak: {error.what}", error.remedy or "")
    return Finding(name, "ok", f"espeak-ng says 'hello' in {sound.duration_s:.2f} s of sound")


def sound_device() -> Finding:
    """Check that there is a sound output device."""
    from socialbot.speech.playback import find_player

    name = "sound device"
    if installed_version("miniaudio") is None:
        return Finding(name, "warning", "miniaudio is not installed: no sound", extra_command("speech"))
    if find_player() is None:
        remedy = "connect a loudspeaker; in a container: docker run --device /dev/snd; join the group 'audio'"
        return Finding(name, "warning", "none; speech is kept as .wav files of the run", remedy)
    return Finding(name, "ok", "opens")


def cameras(folder: Path = Path("/dev")) -> Finding | None:
    """Check that a camera can be opened."""
    name = "cameras"
    if sys.platform != "linux":
        return None
    devices = sorted(folder.glob("video*"))
    if not devices:
        remedy = "connect one; in a container: docker run --device /dev/video0; or use --camera FILE, or replay a bag"
        return Finding(name, "warning", "none", remedy)
    sizes = {device.name: size for device in devices if (size := _picture_size(device)) is not None}
    if not sizes:
        locked = any(not os.access(device, os.R_OK | os.W_OK) for device in devices)
        remedy = "sudo usermod -aG video $USER, then log in again" if locked else "is another program using it?"
        return Finding(name, "warning", f"none of {', '.join(device.name for device in devices)} can be opened", remedy)
    return Finding(name, "ok", ", ".join(f"{device} ({w}x{h})" for device, (w, h) in sizes.items()))


def camera_pose(graph: str = "waldo") -> Finding | None:
    """Check what the person detector of a graph knows about the pose of its camera."""
    from socialbot.vision.camera import CameraPose
    from socialbot.vision.camera_pose import load_pose
    from socialbot.vision.person_detector import PersonDetector

    name = "camera pose"
    detector = next((each for each in load_graph(graph).nodes if issubclass(each.type, PersonDetector)), None)
    if detector is None:
        return None
    defaults = {key: each.default for key, each in detector.type.parameters().items()}
    values = {**defaults, **detector.parameters}
    file = str(values["camera_file"])
    pose = CameraPose.stated(values["mount_height_m"], values["pitch_rad"], load_pose(Path(file)) if file else None)
    where = f"{graph}: {pose}"
    if pose.source != "assumed":
        return Finding(name, "ok", where)
    remedy = f"socialbot calibrate BAG --save {file or 'camera.json'}"
    if not file:
        remedy += f"; then set {detector.name}.camera_file=camera.json"
    return Finding(name, "warning", f"{where} until people or transforms show it", remedy)


def runs_folder(folder: Path = Path("runs")) -> Finding:
    """Check that the folder of runs is writable and has free space."""
    name = "runs folder"
    existing = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        remedy = "work in a folder of your own, or name one with --out"
        return Finding(name, "error", f"{existing} cannot be written", remedy)
    free = shutil.disk_usage(existing).free
    if free < MIN_FREE_BYTES:
        text = f"{free / GB:.2f} GB free in {existing}; a minute of video takes 10 MB, a bag of raw images 1.6 GB"
        return Finding(name, "warning", text, "free space, or name another folder with --out")
    return Finding(name, "ok", f"{folder}/ can be written, {free / GB:,.0f} GB free")


FIRST_CHECKS: tuple[Check, ...] = (python, packages)
LAST_CHECKS: tuple[Check, ...] = (opencv, network, speech, sound_device, cameras, camera_pose, runs_folder)


def _picture_size(device: Path) -> tuple[int, int] | None:
    from socialbot.vision.camera_node import open_frames

    if not os.access(device, os.R_OK | os.W_OK):
        return None
    try:
        with closing(open_frames(str(device))) as frames:
            return frames.size
    except DeviceError:
        return None


STYLES = {"ok": "green", "warning": "yellow", "error": "bold red"}
NAME_COLUMNS = 14
INDENT = " " * (len("warning ") + NAME_COLUMNS + 1)
WIDEST = 100


def doctor(
    context: typer.Context,
    checked: Annotated[
        str | None,
        typer.Argument(
            metavar="[GRAPH]", help="Check what this graph needs of other nodes.", autocompletion=graph_names
        ),
    ] = None,
    as_json: JsonOption = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Skip a slow check: the round trip of images over DDS.")
    ] = False,
    graph: Annotated[str, typer.Option(help="Graph whose camera pose is shown.")] = "waldo",
    robot: RobotOption = None,
) -> None:
    """Check the installation, or a graph or robot, and print remedies. Exit code 5: a check failed."""
    if checked is not None and robot is not None:
        what = "a graph and a robot are checked one by one"
        raise ParameterError(what, where="--robot", remedy="leave out one of them")
    if checked is not None or robot is not None:
        expect_effect(context, ("quick", "graph"), f"for a {'graph' if robot is None else 'robot'}")
    console = Console()
    findings: list[Finding] = []
    with console.status("examining"):
        for finding in _examined(checked, robot, graph, quick=quick):
            findings.append(finding)
            if not as_json:
                console.print(_paragraph(finding, min(console.width, WIDEST)), soft_wrap=True)
    count = Counter(finding.state for finding in findings)
    if as_json:
        print_json({"schema": "socialbot/doctor", "version": 1, "findings": findings})
    else:
        console.print(f"\n{count['ok']} ok, {many(count['warning'], 'warning')}, {many(count['error'], 'error')}")
    if count["error"]:
        raise typer.Exit(InstallationError.exit_code)


def _examined(checked: str | None, robot: str | None, graph: str, *, quick: bool) -> Iterator[Finding]:
    if robot is not None:
        return examine_robot(robot)
    return examine(quick=quick, graph=graph) if checked is None else examine_graph(checked)


def _paragraph(finding: Finding, width: int) -> Text:
    # Do not break long words: commands and paths to copy.
    lines = textwrap.TextWrapper(width, subsequent_indent=INDENT, break_long_words=False, break_on_hyphens=False)
    head = f"{finding.state:7} {finding.name:{NAME_COLUMNS}} "
    text = Text(lines.fill(head + finding.text))
    text.stylize(STYLES[finding.state], 0, len(finding.state))
    text.stylize("bold", len("warning "), len(head))
    if finding.remedy:
        text.append("\n" + lines.fill(f"{INDENT}remedy: {finding.remedy}"), style="cyan")
    return text
