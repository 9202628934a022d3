"""``socialbot key enclaves``. SROS2 is not here: a program ``ros2`` on PATH makes files as sros2 0.13 does."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from socialbot.graph.ports import NODE_NAME
from tests.runtime.deployments import PAGE
from tests.system.running import socialbot_here

ROS2 = """\
#!{python}
import json, os, sys
from pathlib import Path

with open({calls!r}, "a") as calls:
    print(json.dumps([*sys.argv[1:], os.environ["ROS_DOMAIN_ID"]]), file=calls)
command, verb, *arguments = sys.argv[1:]
if command != "security" or {without!r}:
    sys.exit("usage: ros2 [-h]\\nros2: error: invalid choice: 'security'")
if verb == "--help":
    sys.exit()
if verb == {failing!r}:
    sys.exit("a first line\\nUnable to do that")
store = Path(arguments[0])
signed = "MIME-Version: 1.0\\n\\n<id>" + os.environ["ROS_DOMAIN_ID"] + "</id>\\n"
if verb == "create_keystore":
    for folder in ("public", "private", "enclaves"):
        (store / folder).mkdir(parents=True)
    (store / "public/ca.cert.pem").write_text("CA")
    (store / "private/ca.key.pem").write_text("KEY OF THE CA")
    for role in ("identity_ca", "permissions_ca"):
        (store / "public" / (role + ".cert.pem")).symlink_to("ca.cert.pem")
        (store / "private" / (role + ".key.pem")).symlink_to("ca.key.pem")
    (store / "enclaves/governance.p7s").write_text(signed)
else:
    folder = store / "enclaves" / arguments[1].lstrip("/")
    folder.mkdir(parents=True, exist_ok=True)
    for role in ("identity_ca", "permissions_ca"):
        (folder / (role + ".cert.pem")).symlink_to(os.path.relpath(store / "public" / (role + ".cert.pem"), folder))
    (folder / "governance.p7s").symlink_to(os.path.relpath(store / "enclaves/governance.p7s", folder))
    for name in ("cert.pem", "key.pem"):
        (folder / name).write_text(name + " of " + arguments[1])
    (folder / "permissions.p7s").write_text(signed)
"""


class Ros2:
    """A program ``ros2`` that records its calls."""

    def __init__(self, folder: Path) -> None:
        self.program, self._calls = folder / "bin/ros2", folder / "calls"
        self.program.parent.mkdir()
        self.write()

    def write(self, *, without_security: bool = False, failing: str = "") -> None:
        text = ROS2.format(python=sys.executable, calls=str(self._calls), without=without_security, failing=failing)
        self.program.write_text(text)
        self.program.chmod(0o755)

    @property
    def calls(self) -> list[list[str]]:
        return [json.loads(line) for line in self._calls.read_text().splitlines()] if self._calls.exists() else []


@pytest.fixture
def ros2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Ros2:
    made = Ros2(tmp_path)
    monkeypatch.setenv("PATH", f"{made.program.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    return made


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "waldo.yaml"
    path.write_text(PAGE)
    return path


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return tmp_path / "key store"


Enclaves = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def enclaves(store: Path) -> Enclaves:
    return lambda graph: socialbot_here("key", "enclaves", graph, "--keystore", store)


def contents(folder: Path) -> dict[Path, str]:
    return {path: path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_makes_an_enclave_for_each_machine_in_the_domain_of_the_deployment(
    ros2: Ros2, file: Path, store: Path, enclaves: Enclaves
) -> None:
    """SROS2 writes ROS_DOMAIN_ID into the permissions; in another domain no node would start."""
    done = enclaves(file)
    assert done.returncode == 0, done.stderr
    assert ros2.calls == [
        ["security", "create_keystore", str(store), "42"],
        ["security", "create_enclave", str(store), "/socialbot/robot", "42"],
        ["security", "create_enclave", str(store), "/socialbot/workstation", "42"],
    ]


def test_prints_what_to_set_on_each_machine(ros2: Ros2, file: Path, store: Path, enclaves: Enclaves) -> None:
    parts = enclaves(file).stdout.split("\n\n")
    assert f"copy nothing of '{store}/private'" in parts[0]
    for part, machine in zip(parts[1:], ("robot", "workstation"), strict=True):
        assert part.startswith(f"{machine}: enclave /socialbot/{machine}, created")
        exports = [shlex.split(line)[1] for line in part.splitlines() if line.startswith("  export ")]
        assert exports == [
            "ROS_SECURITY_ENABLE=true",
            "ROS_SECURITY_STRATEGY=Enforce",
            f"ROS_SECURITY_KEYSTORE={store}",
            f"ROS_SECURITY_ENCLAVE_OVERRIDE=/socialbot/{machine}",
            "ROS_DOMAIN_ID=42",
        ]


def test_the_printed_command_copies_one_enclave_and_no_key_of_the_ca(
    ros2: Ros2, file: Path, tmp_path: Path, store: Path, enclaves: Enclaves
) -> None:
    """A program ``ssh`` runs the second half of the command here, after the keystore was put elsewhere."""
    ssh = ros2.program.with_name("ssh")
    ssh.write_text(
        f'#!/bin/sh\necho "$1" >> {tmp_path}/hosts\ncat > {tmp_path}/robot.tar\nmv "{store}" {tmp_path}/old\n'
        f'sh -c "$2" < {tmp_path}/robot.tar\n'
    )
    ssh.chmod(0o755)
    [command, _] = [line for line in enclaves(file).stdout.splitlines() if line.startswith("  tar ")]
    subprocess.run(["sh", "-c", command], check=True)
    assert (tmp_path / "hosts").read_text() == "10.77.0.1\n"
    copied = {str(path.relative_to(store / "enclaves/socialbot/robot")): text for path, text in contents(store).items()}
    assert sorted(copied) == [
        "cert.pem", "governance.p7s", "identity_ca.cert.pem", "key.pem", "permissions.p7s", "permissions_ca.cert.pem",
    ]  # fmt: skip
    assert copied["identity_ca.cert.pem"] == copied["permissions_ca.cert.pem"] == "CA"
    assert "KEY OF THE CA" not in copied.values()
    assert not [path for path in store.rglob("*") if path.is_symlink()], "links would lead to files that stay here"


def test_nobody_else_can_read_the_keys(ros2: Ros2, file: Path, store: Path, enclaves: Enclaves) -> None:
    before = os.umask(0o022)
    try:
        enclaves(file)
    finally:
        os.umask(before)
    private = [path for path in (store, *store.rglob("*")) if not path.is_symlink()]
    assert [path for path in private if path.stat().st_mode & 0o077] == []


def test_existing_enclaves_stay_as_they_are(ros2: Ros2, file: Path, store: Path, enclaves: Enclaves) -> None:
    enclaves(file)
    shutil.rmtree(store / "enclaves/socialbot/robot")
    before = contents(store)
    output = enclaves(file).stdout
    assert "/socialbot/robot, created" in output
    assert "/socialbot/workstation, kept as it is" in output
    assert {path: text for path, text in contents(store).items() if path in before} == before
    assert ros2.calls[3:] == [["security", "create_enclave", str(store), "/socialbot/robot", "42"]]


def test_a_machine_that_has_its_enclave_needs_no_ros2(ros2: Ros2, file: Path, store: Path, enclaves: Enclaves) -> None:
    enclaves(file)
    ros2.program.unlink()
    shutil.rmtree(store / "private")
    done = enclaves(file)
    assert (done.returncode, done.stdout.count("kept as it is")) == (0, 2)


@pytest.mark.parametrize("lost", ["key.pem", "permissions.p7s", "governance.p7s"])
def test_a_damaged_enclave_is_named_and_kept(
    ros2: Ros2, file: Path, store: Path, enclaves: Enclaves, lost: str
) -> None:
    enclaves(file)
    (store / "enclaves/socialbot/robot" / lost).unlink()
    before = contents(store)
    done = enclaves(file)
    assert done.returncode == 4
    assert f"enclaves/socialbot/robot: there is no file {lost}" in done.stderr
    assert "delete this folder" in done.stderr
    assert contents(store) == before


@pytest.mark.parametrize("lost", ["private", "enclaves"])
def test_a_keystore_without_its_ca_is_named_and_kept(
    ros2: Ros2, file: Path, store: Path, enclaves: Enclaves, lost: str
) -> None:
    """A second CA would be another keystore, whose enclaves the first ones do not know."""
    enclaves(file)
    shutil.rmtree(store / "enclaves/socialbot/robot")
    shutil.rmtree(store / lost)
    before, calls = contents(store), ros2.calls
    done = enclaves(file)
    assert (done.returncode, contents(store), ros2.calls) == (4, before, calls)
    assert "where the keystore was made" in done.stderr


def test_a_graph_on_one_machine_has_one_enclave(
    ros2: Ros2, store: Path, enclaves: Enclaves, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    output = enclaves("waldo").stdout
    assert ros2.calls[1:] == [["security", "create_enclave", str(store), "/socialbot/waldo", "7"]]
    assert "waldo: enclave /socialbot/waldo, created" in output
    assert "ssh" not in output


def test_the_keystore_of_the_shell_is_the_default(ros2: Ros2, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for variable, folder in (("", "keystore"), (str(tmp_path / "other"), "other")):
        monkeypatch.setenv("ROS_SECURITY_KEYSTORE", variable)
        assert f"ROS_SECURITY_KEYSTORE={tmp_path / folder}\n" in socialbot_here("key", "enclaves", "waldo").stdout
        assert (tmp_path / folder / "private/ca.key.pem").is_file()


def test_a_keystore_of_another_domain_is_refused(ros2: Ros2, store: Path, file: Path, enclaves: Enclaves) -> None:
    enclaves(file)
    calls = ros2.calls
    done = enclaves("waldo")
    assert (done.returncode, ros2.calls) == (4, calls)
    assert "is for ROS domain 42, and the graph runs in domain 0" in done.stderr
    file.write_text(PAGE.replace("domain: 42", "domain: 43"))
    assert "runs in domain 43" in enclaves(file).stderr


def test_drivers_in_a_domain_of_their_own_are_refused(
    ros2: Ros2, file: Path, enclaves: Enclaves, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers = "security: {keys: keys, drivers: {domain: 43, topics: [/head_controller/joint_trajectory]}}"
    file.write_text(PAGE.replace("security: {keys: keys}", drivers))
    done = enclaves(file)
    assert done.returncode == 4
    assert "security.drivers: an SROS2 keystore is for one ROS domain" in done.stderr
    monkeypatch.setenv("SOCIALBOT_DRIVERS", "43:/head_controller/joint_trajectory")
    assert "SOCIALBOT_DRIVERS: an SROS2 keystore" in enclaves("waldo").stderr
    assert ros2.calls == []


def test_without_ros2_the_remedy_is_to_install_it(
    ros2: Ros2, file: Path, store: Path, enclaves: Enclaves, monkeypatch: pytest.MonkeyPatch
) -> None:
    ros2.program.unlink()
    monkeypatch.setenv("PATH", str(ros2.program.parent))
    done = enclaves(file)
    assert done.returncode == 5
    assert "ros2 is not on PATH" in done.stderr
    assert "ros-jazzy-sros2; source /opt/ros/jazzy/setup.bash" in done.stderr
    assert not store.exists()


def test_ros2_without_security_or_that_does_not_start_is_named(ros2: Ros2, file: Path, enclaves: Enclaves) -> None:
    ros2.write(without_security=True)
    done = enclaves(file)
    assert done.returncode == 5
    assert "there is no `ros2 security`: ros2: error: invalid choice: 'security'" in done.stderr
    assert "ros-jazzy-sros2" in done.stderr
    ros2.program.write_text("no program")
    assert "cannot be started: Exec format error" in enclaves(file).stderr


@pytest.mark.parametrize("verb", ["create_keystore", "create_enclave"])
def test_a_failure_of_ros2_is_named(ros2: Ros2, file: Path, store: Path, enclaves: Enclaves, verb: str) -> None:
    ros2.write(failing=verb)
    done = enclaves(file)
    assert done.returncode == 4
    assert done.stderr.splitlines()[0] == f"error: {store}: ros2 security {verb} failed: Unable to do that"


def test_a_graph_name_that_ros_refuses_is_named(ros2: Ros2, tmp_path: Path, enclaves: Enclaves) -> None:
    path = tmp_path / "eyes.yaml"
    path.write_text("name: two eyes\nnodes:\n  camera: {type: camera}\n")
    done = enclaves(path)
    assert done.returncode == 4
    assert "an enclave cannot be called 'two eyes'" in done.stderr
    assert "letters, digits and _" in done.stderr
    assert ros2.calls == []


@pytest.mark.ros
@pytest.mark.parametrize("name", ["robot", "_1", "a__b", "a" * 200, "1robot", "two eyes", "a-b", "ä", ""])
def test_names_are_those_that_ros_accepts(name: str) -> None:
    """SROS2 checks names of enclaves with this function."""
    from rclpy.exceptions import InvalidNamespaceException
    from rclpy.validate_namespace import validate_namespace

    try:
        accepted = validate_namespace(f"/socialbot/{name}")
    except InvalidNamespaceException:
        accepted = False
    assert accepted == (NODE_NAME.fullmatch(name) is not None)
