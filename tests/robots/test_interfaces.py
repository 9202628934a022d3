"""The interfaces of robots for the ROS wheels: complete, named everywhere, and valid."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from socialbot.bridge.transport import ROBOT_PACKAGES

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "interfaces" / "robot_interfaces"
FILES = sorted([*FOLDER.glob("*/msg/*.msg"), *FOLDER.glob("*/action/*.action")])
PACKAGES = {path.relative_to(FOLDER).parts[0] for path in FILES}


def test_every_package_is_built_and_named():
    built = re.findall(r"^build_interfaces\((\w+)", (FOLDER / "CMakeLists.txt").read_text("utf-8"), re.MULTILINE)
    assert sorted(built) == sorted(PACKAGES)
    assert PACKAGES - {"tf2_msgs"} == ROBOT_PACKAGES  # that one has a remedy of its own
    table = (FOLDER / "README.md").read_text("utf-8")
    for path in FILES:
        assert re.search(rf"\b{path.stem}\b", table), path
        assert path.parent.parent.name in table


def test_every_type_of_the_robots_is_among_them():
    text = "".join(path.read_text("utf-8") for path in (ROOT / "socialbot" / "robots").rglob("*.py"))
    used = {name for name in re.findall(r'"(\w+)/(?:msg|action)/(\w+)"', text) if name[0] in PACKAGES}
    assert used >= {("control_msgs", "FollowJointTrajectory"), ("tts_msgs", "TTS")}
    assert used <= {(path.parent.parent.name, path.stem) for path in FILES}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_definition_is_valid(path):
    from rosbags.typesys import get_types_from_msg

    parts = path.read_text("utf-8").split("---\n")
    assert len(parts) == (3 if path.suffix == ".action" else 1)
    for number, part in enumerate(parts):
        name = f"{path.parent.parent.name}/msg/{path.stem}{number or ''}"
        assert get_types_from_msg(part, name)
