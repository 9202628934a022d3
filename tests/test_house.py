"""The rules of the house: who may import what."""

from __future__ import annotations

import ast
import json
import math
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import socialbot

ROOT = Path(socialbot.__file__).parent
ROS = {"rclpy", "rosbags", "ament_index_python", "builtin_interfaces", "rosidl_runtime_py", "launch", "launch_ros"}


@cache
def imports(path: Path) -> frozenset[str]:
    """Every module that ``path`` imports anywhere, inside functions too, in full."""
    return frozenset(imported(ast.parse(path.read_text("utf-8")), path))


def called(call: ast.Call) -> str:
    """Return the name of a called function without its module."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def imported(tree: ast.AST, path: Path) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} imports relatively"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and called(node).endswith(("import_module", "__import__")):
            yield from (str(arg.value) for arg in node.args[:1] if isinstance(arg, ast.Constant))


def modules(folder: str = "") -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def offenders(paths: list[Path], forbidden: tuple[str, ...]) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}: {name}"
        for path in paths
        for name in sorted(imports(path))
        if any(name == start or name.startswith(f"{start}.") for start in forbidden)
    ]


PICKLES = ("pickle", "marshal", "shelve", "dill", "cloudpickle", "jsonpickle", "joblib", "yaml")
CODE = {"eval", "exec", "compile"}
DANGEROUS = re.compile(r"(?<!re\.)\b(eval|exec|compile|YAML)\(|allow_pickle")
"""Most files need not be parsed."""


def dangers(path: Path) -> Iterator[str]:
    """Return the constructs in ``path`` that turn data into code: `eval`, unsafe YAML, pickles in arrays."""
    text = path.read_text("utf-8")
    for node in ast.walk(ast.parse(text)) if DANGEROUS.search(text) else ():
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        options = {option.arg: option.value for option in node.keywords}
        if name.removeprefix("builtins.") in CODE:
            yield f"{path.name}:{node.lineno} {name}"
        elif name.rpartition(".")[2] == "YAML":
            kind = options.get("typ", node.args[0] if node.args else None)
            if not (isinstance(kind, ast.Constant) and kind.value in ("safe", "rt")):
                yield f"{path.name}:{node.lineno} YAML that may make objects"
        elif "allow_pickle" in options:
            yield f"{path.name}:{node.lineno} allow_pickle"


def test_nothing_turns_data_into_code():
    assert offenders(modules(), PICKLES) == []
    # Plans become Python functions, which is what the compiler is for; it writes their text itself, with all that comes
    # from a plan as constants.
    compiler = set(modules("bdi/compiler"))
    assert [danger for path in modules() if path not in compiler for danger in dangers(path)] == []
    assert {danger.rpartition(" ")[2] for path in compiler for danger in dangers(path)} <= {"exec", "compile"}


@pytest.mark.parametrize(
    "code",
    [
        "eval(text)",
        "builtins.exec(text)",
        "YAML().load(f)",
        "ruamel.yaml.YAML(typ='unsafe')",
        "np.load(f, allow_pickle=1)",
    ],
)
def test_such_code_would_be_found(tmp_path, code):
    path = tmp_path / "bad.py"
    path.write_text(code)
    assert len(list(dangers(path))) == 1


DOMAIN_NAMES = re.compile(r"ROS_DOMAIN_ID|DRIVERS|free_domain")
DOMAIN = re.compile(r"'ROS_DOMAIN_ID'(: |, )'\d+'|DRIVERS(_VARIABLE|')(: |, )'\d+:|\bfree_domain\(")


def fixed_domains(path: Path) -> Iterator[str]:
    """Return the ROS domains of tests and fixtures in ``path`` that are literals, or that no lock keeps for them."""
    text = path.read_text("utf-8")
    if not DOMAIN_NAMES.search(text):
        return  # Unparsing takes long.
    tree = ast.parse(text)
    marks = [ast.unparse(node) for node in tree.body if isinstance(node, ast.Assign)]
    everywhere = any("pytestmark" in mark and "mark.ros" in mark for mark in marks)
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef):
            continue
        decorators = " ".join(map(ast.unparse, node.decorator_list))
        body = "\n".join(map(ast.unparse, node.body))
        if everywhere or "mark.ros" in decorators or "fixture" in decorators:
            yield from (f"{path.name}:{node.lineno} {found[0]}" for found in DOMAIN.finditer(body))


def test_no_test_shares_a_domain_with_other_runs_on_the_machine():
    """The worker has a domain, and the fixture ``other_domain`` is another one."""
    tests = Path(__file__).parent
    paths = [*tests.rglob("*.py"), *(tests.parent / "evaluation").rglob("*.py")]
    assert len(paths) > 100
    found = [each for path in paths for each in fixed_domains(path)]
    assert found == []


@pytest.mark.parametrize(
    "code",
    [
        'setenv("ROS_DOMAIN_ID", "42")',
        'own = {"ROS_DOMAIN_ID": "42"}',
        'own = {DRIVERS_VARIABLE: "43:/a"}',
        "free_domain()",
    ],
)
def test_such_domains_would_be_found(tmp_path, code):
    path = tmp_path / "test_it.py"
    for mark in ("@pytest.mark.ros", "@pytest.fixture"):
        path.write_text(f"{mark}\ndef test():\n    {code}\n")
        assert len(list(fixed_domains(path))) == 1
    path.write_text(f"pytestmark = pytest.mark.ros\ndef test():\n    {code}\n")
    assert len(list(fixed_domains(path))) == 1
    path.write_text(f"def test():\n    {code}\n")
    assert not list(fixed_domains(path))


LIVE_READ = re.compile(r"\bstd(out|err)\.read(line|lines)?\(")


def test_no_test_reads_from_a_live_process():
    """It may write nothing and never end: `tests.system.running.next_line` waits for a limited time."""
    root = Path(__file__).parents[1]
    paths = [*(root / "tests").rglob("*.py"), *(root / "evaluation" / "tests").rglob("*.py")]
    found = {path.name for path in paths if LIVE_READ.search(path.read_text("utf-8"))}
    assert found == set()


READS = re.compile(
    r"\b(read_text|read_bytes|open|load|fromfile|loadtxt|genfromtxt|imread|VideoCapture|parse|connect)\("
)
LIBRARIES = frozenset({
    "json.load", "tomllib.load", "np.load", "np.fromfile", "np.loadtxt", "np.genfromtxt", "cv2.imread",
    "cv2.VideoCapture", "onnx.load", "ElementTree.parse", "sqlite3.connect",
})  # fmt: skip
OPENING = frozenset({"open", "io.open", "av.open", "wave.open", "Image.open"})
WITHIN_LIMITS = {
    "bridge/dds_threads.py (task / 'comm').read_bytes": "written by the kernel",
    "bridge/dds_threads.py (task / 'schedstat').read_bytes": "written by the kernel",
    "bridge/dds_threads.py (task / 'status').read_bytes": "written by the kernel",
    "core/_process_guard.py open": "written by the kernel",
    "core/reading.py open": "holds the limits",
    "core/installation.py distribution(PACKAGE).read_text": "the installed package",
    "runs/pages.py (PAGE / replaced.get(name, name)).read_text": "a file of the page",
    "runs/pages.py (PAGE / name).read_text": "a file of the page",
    "runs/pages.py (PAGE / 'vendor/uPlot.iife.min.js').read_text": "a file of the page",
    "cli/new.py template.read_text": "a template of a project",
    "runtime/fork_server.py open": "a pipe to an own process",
    "runtime/_processes.py (task / 'schedstat').read_bytes": "written by the kernel",
    "core/process.py (process / 'stat').read_text": "written by the kernel",
    "bridge/_node_thread.py open": "written by the kernel",
    "bridge/ros_checks.py path.read_text": "written by the kernel",
    "bridge/run_announcer.py BOOT_ID.read_text": "written by the kernel",
    "bridge/run_announcer.py SOCKETS.read_text": "written by the kernel",
    "bags/image_files.py cv2.VideoCapture": "checked before",
    "vision/camera_node.py cv2.VideoCapture": "checked before, or a camera",
    "bags/sound.py av.open": "checked before",
    "bags/_files.py storage_mcap.read_bytes": "of rosbags, from an opened file",
    "speech/audio.py wave.open": "checked before, and read in parts",
}
"""Reads of files that do not need `socialbot.core.reading`, with the reason."""


def reads(path: Path) -> Iterator[str]:
    """Return the calls in ``path`` that read a file which may have no end, except those of the package and /proc."""
    text = path.read_text("utf-8")
    for node in ast.walk(ast.parse(text)) if READS.search(text) else ():
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        owner, _, method = name.rpartition(".")
        if method in ("read_text", "read_bytes"):
            found = owner not in ("", "paths", "reading")
        elif name in OPENING or method == "open":
            options = {option.arg: option.value for option in node.keywords}
            mode = options.get("mode", next(iter(node.args[name in OPENING :]), None))
            kind = mode.value if isinstance(mode, ast.Constant) else "" if mode else None
            plain = name in OPENING or "encoding" in options
            found = plain if kind is None else "r" in str(kind)
        else:
            found = name in LIBRARIES
        if found and not any(own in ast.unparse(node) for own in ("files(", "__file__", "/proc/")):
            yield f"{path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name} {name}"


def test_files_are_read_within_limits():
    found = {read for path in modules() for read in reads(path)}
    assert found - WITHIN_LIMITS.keys() == set(), "read them with socialbot.core.reading"
    assert WITHIN_LIMITS.keys() - found == set(), "these exceptions are not needed"


@pytest.mark.parametrize(
    "code",
    [
        "Path(name).read_text('utf-8')",
        "path.read_bytes()[:9]",
        "open(name)",
        "open(name, 'rb')",
        "open(name, mode='r')",
        "path.open('rb')",
        "path.open(encoding='utf-8')",
        "json.load(file)",
        "np.load(path)",
        "cv2.VideoCapture(path)",
        "ElementTree.parse(path)",
    ],
)
def test_other_reads_would_be_found(tmp_path, code):
    path = tmp_path / "bad.py"
    path.write_text(code)
    assert len(list(reads(path))) == 1


@pytest.mark.parametrize("code", ["read_text(path)", "paths.read_text(path)", "open(name, 'wb')", "host.open()"])
def test_writes_and_bounded_reads_are_allowed(tmp_path, code):
    path = tmp_path / "good.py"
    path.write_text(code)
    assert not list(reads(path))


ROOMS = (
    ("core",),
    ("graph", "bdi", "planning"),
    ("bags", "speech"),
    ("vision", "deliberation"),
    ("runs",),
    ("agents",),
    ("robots",),
    ("bridge",),
    ("runtime",),
    ("cli",),
)
"""The folders from the ground up; a room imports only rooms of lower floors."""

FLOOR = {room: floor for floor, rooms in enumerate(ROOMS) for room in rooms}


def test_the_rooms_are_those_of_the_plan():
    assert {path.parent.name for path in ROOT.glob("*/__init__.py")} == set(FLOOR)
    assert len([path for path in ROOT.glob("*.py") if path.name not in ("__init__.py", "__main__.py")]) <= 2


@pytest.mark.parametrize("room", FLOOR)
def test_no_room_imports_one_above_or_beside_it(room):
    above = tuple(f"socialbot.{other}" for other, floor in FLOOR.items() if floor >= FLOOR[room] and other != room)
    assert modules(room)
    assert offenders(modules(room), above) == []


def test_only_the_bridge_knows_ros():
    for path in modules():
        if path.relative_to(ROOT).parts[0] in ("bridge", "bags"):  # bags read and write with rosbags, without rclpy
            continue
        tops = {name.partition(".")[0] for name in imports(path)}
        assert not {top for top in tops if top in ROS or top.endswith(("_msgs", "_srvs"))}, path


def test_the_engine_needs_only_a_few_parts_of_the_core():
    allowed = ("socialbot.bdi", "socialbot.core.clock", "socialbot.core.errors", "socialbot.core.terminal")
    allowed += ("socialbot.core.limits", "socialbot.core.reading")
    for path in modules("bdi"):
        for name in imports(path):
            top = name.partition(".")[0]
            assert name.startswith(allowed) if top == "socialbot" else top in sys.stdlib_module_names, (path, name)


def test_clock_and_errors_need_nothing_but_the_standard_library():
    for name in ("core/clock.py", "core/errors.py", "core/__init__.py"):
        assert {top.partition(".")[0] for top in imports(ROOT / name)} <= sys.stdlib_module_names


def python(code: str, *, folder: Path | None = None) -> str:
    """Return the output of ``code`` in a new interpreter."""
    done = subprocess.run(
        [sys.executable, "-I", "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=60, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


BEGIN = f"import sys; sys.path.insert(0, {str(ROOT.parent)!r})\n"


def test_importing_the_engine_loads_nothing_beyond_the_standard_library():
    loaded = python(
        BEGIN + "before = set(sys.modules); import socialbot.bdi; print(*set(sys.modules) - before)"
    ).split()
    own = {
        "socialbot",
        "socialbot._old_names",
        "socialbot.core",
        "socialbot.core.clock",
        "socialbot.core.errors",
        "socialbot.core.lazy",
        "socialbot.core.limits",
        "socialbot.core.reading",
    }
    for name in loaded:
        assert name in own or name.startswith("socialbot.bdi") or name.partition(".")[0] in sys.stdlib_module_names


def import_time_s(module: str) -> float:
    """Processor seconds that a fresh interpreter takes to import a module."""
    code = BEGIN + f"import time; begin = time.process_time(); import {module}; print(time.process_time() - begin)"
    return float(python(code))


def test_importing_the_engine_costs_about_as_much_as_importing_asyncio():
    python(BEGIN + "import socialbot.bdi")  # compiles
    least = {"socialbot.bdi": math.inf, "asyncio": math.inf}
    for _ in range(40):  # a busy machine adds to both, but not each time
        least = {module: min(time_s, import_time_s(module)) for module, time_s in least.items()}
        if least["socialbot.bdi"] < 1.5 * least["asyncio"]:
            return
    pytest.fail(f"seconds of the processor: {least}")


WITHOUT_ROS = BEGIN + textwrap.dedent(f"""
    import importlib.abc

    class NoRos(importlib.abc.MetaPathFinder):
        def find_spec(self, name, path=None, target=None):
            if name.partition(".")[0] in {sorted(ROS - {"rosbags"})} or name.partition(".")[0].endswith("_msgs"):
                raise ModuleNotFoundError(f"{{name}} is blocked", name=name)

    sys.meta_path.insert(0, NoRos())
    """)


def test_without_ros_the_inline_runner_the_replay_and_the_cli_are_there():
    python(WITHOUT_ROS + "import socialbot.graph.inline, socialbot.runtime.bag_source, socialbot.cli.main")


def test_without_ros_waldo_runs_inline():
    said = python(
        WITHOUT_ROS
        + textwrap.dedent("""
        import json
        from socialbot.core.clock import SECOND
        from socialbot.graph.files import load_graph
        from socialbot.graph.inline import InlineRunner
        from socialbot.core.messages import PersonDetection, PersonDetections

        graph = load_graph("waldo").without_sources().with_parameters({"speech": {"playback": "off"}})
        runner = InlineRunner(graph)
        actions = []
        runner.tap("/waldo/actions", lambda _, message: actions.append(message.name))
        runner.start()
        person = PersonDetection(x=0, y=0, w=9, h=9, score=1.0, distance_m=2.0)
        for tenth in range(20):
            seen = PersonDetections(
                stamp=tenth * SECOND // 10, frame_id="camera", width=640, height=480, persons=(person,)
            )
            runner.feed("/humans/bodies/detections", seen)
        runner.close()
        print(json.dumps([actions, [name for name in sys.modules if name.startswith("rclpy")]]))
        """)
    )
    assert json.loads(said) == [["speak"], []]
