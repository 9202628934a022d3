"""Environment of ROS: profiles, ROS arguments and stale shared memory."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import pwd
import resource
import socket
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

from socialbot.bridge import environment
from socialbot.bridge.environment import (
    FREE_DOMAINS,
    Across,
    free_domain,
    own_domain,
    prepare,
    split_ros_args,
)
from socialbot.bridge.ros_checks import segment_size
from socialbot.bridge.shared_memory import SHARED
from socialbot.core.errors import GraphError, InstallationError, NodeError
from tests.system.running import PATIENCE_S, limited

PROFILE, DATAGRAM = environment.PROFILE_VARIABLE, environment.DATAGRAM_VARIABLE


def prepared(variables: dict[str, str] | None = None, **options) -> dict[str, str]:
    found = dict(variables or {})
    prepare(found, **options)
    return found


def test_default_discovery_is_limited_to_this_machine() -> None:
    found = prepared()
    assert found[PROFILE] == str(environment.PROFILE)
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "ROS_STATIC_PEERS" not in found


def test_keeps_variables_and_applies_overrides(tmp_path: Path) -> None:
    found = prepared(
        {"ROS_DOMAIN_ID": "3", PROFILE: "my.xml", "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, domain=5, log_folder=tmp_path
    )
    assert (found["ROS_DOMAIN_ID"], found["ROS_LOG_DIR"]) == ("5", str(tmp_path))
    assert (found[PROFILE], found["ROS_AUTOMATIC_DISCOVERY_RANGE"]) == ("my.xml", "OFF")


def test_receives_some_topics_by_udp(tmp_path: Path) -> None:
    found = prepared(log_folder=tmp_path / "log")
    environment.use_topics("dds", found, by_udp=["/speech/say", "/health", "/health"])
    assert found[PROFILE] == str(tmp_path / "log" / "dds.xml")
    profile = ElementTree.parse(found[PROFILE])
    names = [one.get("profile_name") for one in profile.iter() if one.tag.endswith("data_reader")]
    assert names == ["/health", "/speech/say"]
    kept = [one.tag for one in ElementTree.parse(environment.PROFILE).iter()]
    assert [one.tag for one in profile.iter()][: len(kept)] == kept, "all else is as it was"
    prepare(found)
    assert found[PROFILE] == str(tmp_path / "log" / "dds.xml"), "what comes later leaves it alone"


LISTENS = """
import os
from pathlib import Path
from socialbot.bridge.environment import prepare, ros_domain, spinning_node, use_topics
prepare()
use_topics("dds", by_udp=["/health"])
with spinning_node("quiet"):
    links = [Path(f"/proc/self/fd/{number}") for number in os.listdir("/proc/self/fd")]
    own = {os.readlink(link) for link in links if link.is_symlink()}
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        address, _, port = line.split()[1].partition(":")
        if f"socket:[{line.split()[9]}]" in own and int(port, 16) - 7400 - 250 * ros_domain() in range(250):
            print(address)
"""
"""Program that prints the addresses on which a node listens."""


def listened(folder: Path, **variables: str) -> set[str]:
    """The addresses on which a node listens that starts in ``folder``."""
    given = {**os.environ, PROFILE: "", "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **variables}
    command = [sys.executable, "-c", LISTENS]
    done = subprocess.run(command, check=True, timeout=300, capture_output=True, text=True, env=given, cwd=folder)
    return set(done.stdout.split())


@pytest.mark.ros
def test_a_node_whose_profile_cannot_be_written_is_bound_to_the_loopback_address(tmp_path: Path) -> None:
    """Fast DDS reads no profile from memory, and without one it listens on all addresses."""
    (tmp_path / "log").touch()  # in the place of a folder
    assert listened(Path.cwd(), ROS_LOG_DIR=str(tmp_path / "log" / "ros")) == {"0100007F"}


@pytest.mark.ros
def test_a_profile_that_somebody_else_put_into_the_working_directory_is_not_used(tmp_path: Path) -> None:
    """Fast DDS would read it after that of socialbot, and listen on all addresses."""
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text(
        '<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>'
        '<participant profile_name="open" is_default_profile="true"/></profiles></dds>'
    )
    assert listened(tmp_path) == {"0100007F"}
    assert "00000000" in listened(tmp_path, SKIP_DEFAULT_XML_FILE="0"), "as its user wishes"


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_the_log_folder_is_private(temporary: Path) -> None:
    first, second = (Path(prepared()["ROS_LOG_DIR"]) for _ in range(2))
    assert first == second
    assert stat.S_IMODE(first.stat().st_mode) == 0o700


@pytest.mark.parametrize("trap", ["link", "dangling", "file", "writable", "other user"])
def test_a_log_folder_that_somebody_else_has_prepared_is_not_used(temporary: Path, trap: str) -> None:
    """Else a node would write through links there, and read a DDS profile of another user."""
    folder, elsewhere = temporary / f"socialbot-ros-log-{os.getuid()}", temporary / "elsewhere"
    elsewhere.mkdir()
    if trap in ("link", "dangling"):
        folder.symlink_to(elsewhere if trap == "link" else temporary / "none")
    elif trap == "file":
        folder.touch()
    else:
        folder.mkdir()
        folder.chmod(0o777 if trap == "writable" else 0o755)
        if trap == "other user":
            if os.getuid():
                pytest.skip("only root can make folders of other users")
            os.chown(folder, 65534, 65534)
    found = Path(prepared()["ROS_LOG_DIR"])
    assert found.parent == temporary
    assert found not in (folder, elsewhere)
    assert stat.S_IMODE(found.stat().st_mode) == 0o700


def test_a_prepared_log_folder_is_not_used_on_a_full_disk(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def is_full(**_: str) -> str:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(environment.tempfile, "mkdtemp", is_full)
    folder = temporary / f"socialbot-ros-log-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    first, second = (Path(prepared()["ROS_LOG_DIR"]) for _ in range(2))
    assert len({first, second, folder}) == 3
    assert not first.exists()


def test_commands_need_no_disk_for_temporary_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory and all folders for temporary files may be on one disk, which is full."""
    monkeypatch.setattr(tempfile, "tempdir", None)
    with limited(resource.RLIMIT_FSIZE, 0):
        with pytest.raises(FileNotFoundError):
            tempfile.gettempdir()
        folder = Path(prepared()["ROS_LOG_DIR"])
        with own_domain(environment={}) as domain:
            assert domain in FREE_DOMAINS
    assert not folder.exists()


def test_a_user_without_a_home_folder_can_use_ros(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(_: int) -> None:
        raise KeyError

    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", nobody)
    assert environment.can_log(prepared())
    assert not environment.can_log({"ROS_LOG_DIR": ""})


@pytest.mark.ros
def test_a_node_starts_where_ros_cannot_write_its_log_and_publishes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "log").touch()  # in the place of a folder
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log" / "ros"))
    program = """
import threading
from rcl_interfaces.msg import Log
from socialbot.bridge.environment import spinning_node
heard = threading.Event()
with spinning_node("loud") as ros:
    ros.create_subscription(Log, "/rosout", lambda log: heard.set(), 10)
    while not heard.wait(0.1):
        ros.get_logger().info("here")
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300, capture_output=True)


def test_messages_of_ros_import_no_generator_of_code() -> None:
    """It takes 9 MB and 45 ms in each process."""
    program = """
import sys
import socialbot.bridge
from std_msgs.msg import String
String.__class__.__import_type_support__()
print(String.__class__._TYPE_SUPPORT is not None, [name for name in ("em", "lark") if name in sys.modules])
"""
    assert subprocess.check_output([sys.executable, "-c", program], text=True, timeout=300) == "True []\n"


def test_repairs_the_newest_messages_fast_on_a_network(tmp_path: Path) -> None:
    found = prepared(across=Across(peers=("10.77.0.2",)), log_folder=tmp_path)
    environment.use_topics("dds", found, by_udp=["/health"], fresh=["/view/link", "/view/link/_seal"])
    periods = heartbeats_s(Path(found[PROFILE]))
    assert periods["/view/link"] == periods["/view/link/_seal"] < periods["socialbot_writer"] < periods["/health"]
    assert {name: each for name, each in periods.items() if "/view" not in name} == heartbeats_s(
        environment.WIFI_PROFILE
    )


def heartbeats_s(profile: Path) -> dict[str, float]:
    """Period of the heartbeats by the name of the writers."""
    space = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"
    return {
        one.get("profile_name", ""): float(one.findtext(f".//{space}sec", "0"))
        + float(one.findtext(f".//{space}nanosec", "0")) / 1e9
        for one in ElementTree.parse(profile).iter(f"{space}data_writer")
    }


def test_keeps_custom_profiles_and_those_without_such_topics() -> None:
    own = prepared({PROFILE: "my.xml"})
    open_ = prepared({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"})
    for found in (own, open_):
        before = dict(found)
        environment.use_topics("dds", found, by_udp=["/health"])
        assert found == before


def test_across_machines_by_addresses() -> None:
    # The launcher itself was prepared for one machine, and hands its variables on.
    found = prepared(prepared(), across=Across(peers=("10.77.0.1", "10.77.0.3")))
    assert found[PROFILE] == str(environment.WIFI_PROFILE)
    assert found["ROS_STATIC_PEERS"] == "10.77.0.1;10.77.0.3"
    assert found["ROS_DISCOVERY_SERVER"] == ""
    assert int(found[DATAGRAM]) + 28 <= 1500
    assert prepared(found) == found
    few = prepared(found, across=Across(peers=("10.77.0.1",), participants=12))
    assert few[environment.PARTICIPANTS_VARIABLE] == "12"


def test_across_machines_by_a_discovery_server() -> None:
    found = prepared(across=Across(server="10.77.0.1:11811"))
    assert (found["ROS_DISCOVERY_SERVER"], found["ROS_STATIC_PEERS"]) == ("10.77.0.1:11811", "")


@pytest.mark.parametrize(
    "opened",
    [
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
        {"ROS_STATIC_PEERS": "10.77.0.2"},
        {"ROS_DISCOVERY_SERVER": "10.77.0.1:11811"},
    ],
)
def test_only_an_opened_graph_uses_the_network_profile(opened: dict[str, str]) -> None:
    found = prepared(opened)
    assert found[PROFILE] == str(environment.WIFI_PROFILE)
    assert int(found[DATAGRAM]) > 16 * 2**20
    assert prepared(found) == found
    closed = prepared({**found, "ROS_AUTOMATIC_DISCOVERY_RANGE": "", **dict.fromkeys(opened, "")})
    assert closed[PROFILE] == str(environment.PROFILE)
    addresses = [one.text for one in ElementTree.parse(environment.PROFILE).iter() if one.tag.endswith("}address")]
    assert set(addresses) == {"127.0.0.1"}


def test_raw_images_use_large_datagrams() -> None:
    found = prepared(across=Across(peers=("10.77.0.2",)), raw_pictures=True)
    assert int(found[DATAGRAM]) > 16 * 2**20
    assert prepared(found, across=Across(peers=("10.77.0.2",)))[DATAGRAM] == str(environment.PACKET_BYTES)


def test_keeps_a_custom_profile_across_machines() -> None:
    assert prepared({PROFILE: "my.xml"}, across=Across(peers=("a",)))[PROFILE] == "my.xml"


def test_both_profiles_have_the_same_shared_memory() -> None:
    assert segment_size(environment.PROFILE) == segment_size(environment.WIFI_PROFILE) == 32 * 2**20
    texts = [one.text or "" for one in ElementTree.parse(environment.WIFI_PROFILE).iter()]
    assert {f"${{{DATAGRAM}}}", f"${{{environment.PARTICIPANTS_VARIABLE}}}"} <= set(texts)


@pytest.mark.parametrize("domain", ["-1", "233", "x", "1.5", "²", "9" * 5000])
def test_refuses_invalid_domains(domain: str) -> None:
    with pytest.raises(GraphError, match="not a ROS domain"):
        environment.ros_domain({"ROS_DOMAIN_ID": domain})


@pytest.mark.ros
def test_refuses_the_security_that_the_wheels_lack(monkeypatch: pytest.MonkeyPatch) -> None:
    """With ROS_SECURITY_STRATEGY=Permissive, they would start without it."""
    environment.require_ros()
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setattr(environment, "installed_version", lambda name: None)
    environment.require_ros()
    monkeypatch.setattr(environment, "installed_version", lambda name: "1.0")
    with pytest.raises(InstallationError, match=r"SROS 2"):
        environment.require_ros()


OURS = ["--graph", "waldo", "head"]


@pytest.mark.parametrize(
    ("arguments", "ours", "ros"),
    [
        (OURS, OURS, []),
        ([*OURS, "--ros-args"], OURS, ["--ros-args"]),
        ([*OURS, "--ros-args", "-p", "a:=1"], OURS, ["--ros-args", "-p", "a:=1"]),
        (["--ros-args", "-p", "a:=1", "--", *OURS], OURS, ["--ros-args", "-p", "a:=1", "--"]),
        (
            ["--ros-args", "-p", "a:=1", "--", "head", "--ros-args", "-p", "b:=2"],
            ["head"],
            ["--ros-args", "-p", "a:=1", "--", "--ros-args", "-p", "b:=2"],
        ),
        (["head", "--", "-p"], ["head", "--", "-p"], []),
    ],
)
def test_splits_ros_arguments(arguments, ours, ros):
    assert split_ros_args(arguments) == (ours, ros)


def run_node(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "socialbot", "node", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "200"})


@pytest.mark.slow
@pytest.mark.ros
def test_an_invalid_ros_parameter_is_one_error():
    done = run_node("head", "--ros-args", "-r", "__node:=head", "-p", "dead_band_rad:=ten")
    assert done.returncode == 4
    assert "head.dead_band_rad" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.ros
def test_invalid_ros_arguments_are_one_error(tmp_path: Path):
    done = run_node("head", "--ros-args", "--params-file", str(tmp_path / "none.yaml"))
    assert done.returncode == 4
    assert "error: --ros-args: ROS rejects the arguments" in done.stderr
    assert "Traceback" not in done.stderr


def test_run_has_an_unused_domain_of_its_own():
    first: dict[str, str] = {}
    second: dict[str, str] = {}
    with own_domain(environment=first) as one, own_domain(environment=second) as other:
        assert one in FREE_DOMAINS
        assert one != other
        assert (first, second) == ({"ROS_DOMAIN_ID": str(one)}, {"ROS_DOMAIN_ID": str(other)})
    assert first == second == {}


def test_a_claim_of_an_ended_run_of_another_user_is_no_obstacle(monkeypatch: pytest.MonkeyPatch):
    if os.geteuid():
        pytest.skip("only root can be two users")
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o777)
        monkeypatch.setattr(tempfile, "tempdir", folder)
        with own_domain(environment={}) as first:
            pass
        os.seteuid(65534)
        try:
            with own_domain(environment={}, domains=[first]) as second:
                assert second == first
        finally:
            os.seteuid(0)


def test_a_claim_follows_no_link(temporary: Path):
    for domain in FREE_DOMAINS:
        (temporary / f"socialbot-domain-{domain}.lock").symlink_to(temporary / "made")
    with pytest.raises(NodeError, match="are all in use"), own_domain(environment={}):
        pass
    assert not (temporary / "made").exists()


def test_a_file_system_without_locks_is_no_obstacle(temporary: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with own_domain(environment={}) as domain:
        assert domain in FREE_DOMAINS


def test_domain_in_use_is_passed_over():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        free = free_domain()
        taken.bind(("", 7400 + 250 * free))
        with own_domain(environment={}) as domain:
            assert domain > free
        with pytest.raises(NodeError, match="are all in use"):
            free_domain([free])


@pytest.mark.parametrize(("asked", "caller", "entered"), [(7, "12", 7), (None, "12", 12), (7, None, 7)])
def test_given_domain_is_entered(asked, caller, entered):
    variables = {} if caller is None else {"ROS_DOMAIN_ID": caller}
    before = dict(variables)
    with own_domain(asked, variables) as domain:
        assert (domain, variables) == (entered, {"ROS_DOMAIN_ID": str(entered)})
    assert variables == before


def test_invalid_domain_of_the_caller_is_refused():
    with (
        pytest.raises(GraphError, match="'forty' is not a ROS domain"),
        own_domain(environment={"ROS_DOMAIN_ID": "forty"}),
    ):
        pass


@pytest.mark.ros
@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_errors_of_dds_do_not_damage_the_output(other_domain: int, discovery: str) -> None:
    """Such as of a port in shared memory that another process has locked.

    DDS refuses such a port without a message if a killed process has left its memory, so that is removed first.
    """
    code = """
from socialbot.bridge.environment import spinning_node
with spinning_node("told"):
    print("{}")
"""
    first = 7400 + 250 * other_domain
    locks = [SHARED / f"fastrtps_port{port}_el" for port in range(first + 10, first + 20)]
    files = {os.open(path, os.O_RDWR | os.O_CREAT): path for path in locks}
    own: list[Path] = []
    try:
        for file, path in files.items():
            with contextlib.suppress(BlockingIOError):  # another process has locked it
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                own.append(path)
                path.with_name(path.name.removesuffix("_el")).unlink(missing_ok=True)
        variables = {"ROS_DOMAIN_ID": str(other_domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": discovery}
        ended = subprocess.run(
            [sys.executable, "-c", code], text=True, capture_output=True, check=True, env={**os.environ, **variables}
        )
    finally:
        for path in own:
            path.unlink(missing_ok=True)
        for file in files:
            os.close(file)
    assert ended.stdout == "{}\n"
    assert "open_and_lock_file failed" in ended.stderr


GIVEN_UP = """
import os, threading
from socialbot.bridge import environment
join = threading.Thread.join
threading.Thread.join = lambda thread, timeout_s=None: join(thread)  # the executor ends in time
with environment.spinning_node("reader") as reader:
    reader.destroy_node = lambda: print("destroyed", flush=True)
    environment.give_up(reader)
print("left", flush=True)
os._exit(0)
"""


@pytest.mark.ros
def test_a_node_that_is_given_up_is_not_destroyed() -> None:
    """A thread of DDS may hold a lock for which `destroy_node` waits, and rclpy keeps Python's lock meanwhile."""
    done = subprocess.run([sys.executable, "-c", GIVEN_UP], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout) == (0, "left\n"), done.stderr
