"""Changes of keys while processes run: removal, damage, and rotation without refused messages."""

from __future__ import annotations

import grp
import io
import os
import pwd
import resource
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from socialbot.bridge.detached_seals import SealMatcher
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.keys import (
    RELOAD_PERIOD_S,
    WINDOW_S,
    KeyRing,
    SecurityError,
    begin_rotation,
    finish_rotation,
    load_keys,
    new_key,
)
from socialbot.bridge.message_tags import LEAST_BYTES
from socialbot.bridge.security import Seal, SealError, Stream
from socialbot.bridge.topics import observer_node
from socialbot.bridge.transport import WINDOW_VARIABLE, open_transport
from socialbot.cli.key import key
from socialbot.core.clock import SECOND
from socialbot.core.messages import Utterance
from socialbot.graph.node import Graph, NodeConfig
from tests.bridge.hosting import node_hosts
from tests.bridge.test_strangers import TOPIC, Mouth
from tests.system.running import eventually, limited


class Machine:
    """A folder of keys of one machine, and the clock (s) of a process with them."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name, self.now = folder / name, name, 0.0
        new_key(name, self.folder)

    def start(self) -> None:
        self.ring = KeyRing(self.folder, self.name, lambda: self.now)
        self.seal = Seal(self.ring, "here")
        self.stream, self.opener = self.seal.stream("/say"), self.seal.opener("/say", joins_late=True)

    def copy_to(self, other: Machine, *names: str) -> None:
        for name in names:
            shutil.copy(self.folder / name, other.folder / name)

    def wait(self) -> None:
        self.now += RELOAD_PERIOD_S


@pytest.fixture
def machines(tmp_path: Path) -> tuple[Machine, Machine]:
    robot, desk = Machine(tmp_path, "robot"), Machine(tmp_path, "desk")
    robot.copy_to(desk, "robot.pub")
    desk.copy_to(robot, "desk.pub")
    robot.start()
    desk.start()
    return robot, desk


def reason(sender: Machine, receiver: Machine) -> str:
    """Why a message is refused; empty if it is accepted."""
    try:
        receiver.opener.open(sender.stream.seal("word"))
    except SealError as error:
        return error.reason
    return ""


def test_a_removed_key_is_refused_after_the_reload_period(machines: tuple[Machine, Machine]) -> None:
    robot, desk = machines
    assert reason(desk, robot) == ""
    (robot.folder / "desk.pub").unlink()
    assert reason(desk, robot) == ""
    robot.wait()
    assert reason(desk, robot) == "unknown sender"
    desk.copy_to(robot, "desk.pub")
    robot.wait()
    assert reason(desk, robot) == ""


@pytest.mark.parametrize("size", [4, LEAST_BYTES])
def test_a_message_whose_seal_came_before_the_key_was_removed_is_refused(
    machines: tuple[Machine, Machine], size: int
) -> None:
    """A stolen key could seal messages for the whole time window in advance."""
    robot, desk = machines
    taken: list[bytes] = []
    matcher = SealMatcher(robot.opener, lambda cdr, _: taken.append(cdr), lambda error: pytest.fail(str(error)))
    first, second = bytes(size), b"\1" * size
    for cdr in (first, second):
        matcher.take_seal(desk.stream.seal_detached(cdr)[1])
    matcher.take_message(first)
    (robot.folder / "desk.pub").unlink()
    robot.wait()
    matcher.take_message(second)
    assert taken == [first]


def test_a_replaced_key_makes_the_old_one_forged(machines: tuple[Machine, Machine], tmp_path: Path) -> None:
    robot, desk = machines
    new_key("desk", tmp_path / "other")
    shutil.copy(tmp_path / "other" / "desk.pub", robot.folder)
    robot.wait()
    assert reason(desk, robot) == "forged"


@pytest.mark.parametrize("damage", ["text", "mode", "link", "folder", "mode of the folder"])
def test_unusable_keys_are_not_trusted_and_said(
    damage: str, machines: tuple[Machine, Machine], caplog: pytest.LogCaptureFixture
) -> None:
    robot, desk = machines
    public = robot.folder / "desk.pub"
    if damage == "text":
        public.write_text("damaged")
    elif damage == "mode":
        public.chmod(0o666)
    elif damage == "link":
        public.unlink()
        public.symlink_to("none")
    elif damage == "folder":
        shutil.rmtree(robot.folder)
    else:
        robot.folder.chmod(0o777)
    robot.wait()
    assert reason(desk, robot) == "unknown sender"
    assert reason(robot, robot) == ("" if damage in ("text", "mode", "link") else "unknown sender")
    assert "keys removed: desk" in caplog.text or "trusts nobody" in caplog.text
    assert reason(robot, desk) == ""  # the private key of the running process signs


@pytest.mark.parametrize("full_at", [1, 2])
@pytest.mark.parametrize(
    "begin", [lambda folder: new_key("desk", folder), lambda folder: begin_rotation("robot", folder)]
)
def test_a_full_disk_leaves_no_part_of_a_new_key(
    full_at: int, begin: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The keys of before are used, and the key can be made as soon as there is room."""
    new_key("robot", tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    opened: list[int] = []

    def fdopen(number: int, mode: str) -> io.FileIO:
        opened.append(number)
        if len(opened) < full_at:
            return io.FileIO(number, mode)
        os.close(number)
        return io.FileIO("/dev/full", "wb")

    monkeypatch.setattr("socialbot.bridge.keys.os.fdopen", fdopen)
    with pytest.raises(SecurityError, match="No space left on device"):
        begin(tmp_path)
    monkeypatch.undo()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert load_keys(tmp_path).name == "robot"
    begin(tmp_path)


SHARED_GROUP, PRIVATE_GROUP = 54321, 54322


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> None:
    """A group with another user, and one without."""
    user = pwd.getpwuid(os.getuid())
    other = pwd.struct_passwd(("other", "x", user.pw_uid + 1000, SHARED_GROUP, "", "/", "/bin/sh"))
    group = {gid: grp.struct_group((str(gid), "x", gid, [])) for gid in (SHARED_GROUP, PRIVATE_GROUP)}
    monkeypatch.setattr(pwd, "getpwall", lambda: [user, other])
    monkeypatch.setattr(grp, "getgrgid", group.__getitem__)


@pytest.mark.usefixtures("groups")
@pytest.mark.parametrize("place", ["desk.pub", ".", "..", "link"])
@pytest.mark.parametrize(("mode", "group", "good"), [
    (0o775, SHARED_GROUP, False), (0o775, 54323, False), (0o775, PRIVATE_GROUP, True), (0o757, PRIVATE_GROUP, False),
])  # fmt: skip
def test_keys_that_a_group_or_others_can_change_or_replace_are_refused(
    place: str, mode: int, group: int, good: bool, tmp_path: Path
) -> None:
    folder = tmp_path / "shared" / "keys"
    new_key("robot", folder)
    new_key("desk", tmp_path / "other")
    shutil.copy(tmp_path / "other" / "desk.pub", folder)
    changed = folder / place
    if place == "link":
        changed = tmp_path / "others"
        changed.mkdir()
        (folder / "desk.pub").replace(changed / "desk.pub")
        (folder / "desk.pub").symlink_to(changed / "desk.pub")
    try:
        os.chown(changed, -1, group)
    except PermissionError:
        pytest.skip("only root can give a file to another group")
    changed.chmod(mode)
    if good:
        assert set(load_keys(folder, "robot").trusted) == {"robot", "desk"}
    else:
        with pytest.raises(SecurityError, match=r"other users can .*\n *remedy: chmod go-w "):
            load_keys(folder, "robot")


@pytest.mark.parametrize("path", ["shared/keys", "link", "relative", "parent/keys"])
def test_keys_behind_a_link_that_others_can_replace_are_refused(path: str, tmp_path: Path) -> None:
    """Otherwise another user puts a folder of theirs in its place, whose keys count from then on."""
    new_key("robot", tmp_path / "own" / "keys")
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    (shared / "keys").symlink_to(tmp_path / "own" / "keys")
    (shared / "own").symlink_to("../own")
    (tmp_path / "link").symlink_to(shared / "keys")
    (tmp_path / "relative").symlink_to("shared/../shared/keys")
    (tmp_path / "parent").symlink_to("shared/own")
    with pytest.raises(SecurityError, match=rf"other users can .*\n *remedy: chmod go-w {shared}"):
        load_keys(tmp_path / path, "robot")
    shared.chmod(0o755)
    assert load_keys(tmp_path / path, "robot").name == "robot"


@pytest.mark.parametrize("user", [0, 1000])
@pytest.mark.parametrize("place", ["keys/desk.pub", "keys", ".", "elsewhere", "link"])
def test_keys_that_belong_to_another_user_are_refused(
    place: str, user: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their owner can replace them, whatever their mode is. Root may use the keys of a user."""
    new_key("robot", tmp_path / "keys")
    new_key("desk", tmp_path / "elsewhere")
    (tmp_path / "keys" / "desk.pub").symlink_to(tmp_path / "elsewhere" / "desk.pub")
    (tmp_path / "link").symlink_to("keys")
    tmp_path.chmod(0o1777)
    monkeypatch.setattr(os, "getuid", lambda: user)
    assert set(load_keys(tmp_path / "link", "robot").trusted) == {"robot", "desk"}
    try:
        os.chown(tmp_path / place, 1001, -1, follow_symlinks=False)
    except PermissionError:
        pytest.skip("only root can give a file to another user")
    if (place, user) == ("keys", 0):
        assert set(load_keys(tmp_path / "link", "robot").trusted) == {"robot", "desk"}
    else:
        with pytest.raises(SecurityError, match=rf"other users can .*\n *remedy: chown {user} "):
            load_keys(tmp_path / "link", "robot")


@pytest.mark.usefixtures("groups")
def test_keys_below_a_sticky_folder_are_trusted(tmp_path: Path) -> None:
    """Such as /tmp."""
    new_key("robot", tmp_path / "shared" / "keys")
    (tmp_path / "shared").chmod(0o1777)
    assert load_keys(tmp_path / "shared" / "keys").name == "robot"


def test_changes_count_beside_a_dangling_link(machines: tuple[Machine, Machine]) -> None:
    robot, desk = machines
    (robot.folder / "old.pub").symlink_to("none")
    robot.wait()
    assert reason(desk, robot) == ""
    (robot.folder / "desk.pub").unlink()
    robot.wait()
    assert reason(desk, robot) == "unknown sender"


def test_a_damaged_private_key_does_not_stop_a_running_process(machines: tuple[Machine, Machine]) -> None:
    robot, desk = machines
    (robot.folder / "robot.key").write_text("damaged")
    robot.wait()
    assert reason(robot, desk) == reason(desk, robot) == ""
    with pytest.raises(SecurityError):
        KeyRing(robot.folder, "robot")


def test_a_rotation_refuses_no_message(machines: tuple[Machine, Machine]) -> None:
    robot, desk = machines
    slow = Machine.__new__(Machine)  # another process of the robot, which has not read its keys again yet
    slow.folder, slow.name, slow.now = robot.folder, "robot", 0.0
    slow.start()

    def check() -> None:
        pairs = [(robot, desk), (desk, robot), (robot, slow), (slow, robot), (slow, desk)]
        assert [reason(*pair) for pair in pairs] == [""] * 5

    begin_rotation("robot", robot.folder)
    check()
    robot.copy_to(desk, "robot.next.pub")
    for each in machines:
        each.wait()
        check()

    def pause(seconds: float) -> None:
        assert seconds >= RELOAD_PERIOD_S
        robot.wait()
        check()
        slow.wait()
        check()

    before = robot.ring.latest().private.private_bytes_raw()
    finish_rotation("robot", robot.folder, pause)
    assert robot.ring.latest().private.private_bytes_raw() != before
    check()
    robot.copy_to(desk, "robot.pub")
    check()
    (desk.folder / "robot.next.pub").unlink()
    for each in (robot, slow, desk):
        each.wait()
        check()
    assert desk.ring.latest().successors == robot.ring.latest().successors == {}


@pytest.mark.parametrize("window_s", [WINDOW_S, 60.0])
def test_a_rotation_waits_for_messages_under_way(machines: tuple[Machine, Machine], window_s: float) -> None:
    """A busy machine or a lost packet delays them; they are sealed with the last key."""
    robot, _ = machines
    under_way: list[str] = []
    pauses: list[float] = []

    def pause(seconds: float) -> None:
        under_way.append(robot.stream.seal("word"))  # a process signs with its last key up to the reload period
        robot.wait()
        pauses.append(seconds)
        assert [robot.opener.open(text) for text in under_way[len(pauses) - 1 :]] == ["word"]

    begin_rotation("robot", robot.folder)
    finish_rotation("robot", robot.folder, pause, window_s)
    assert pauses[1] >= RELOAD_PERIOD_S + window_s


def test_the_old_key_is_worthless_after_a_rotation(machines: tuple[Machine, Machine], tmp_path: Path) -> None:
    robot, desk = machines
    shutil.copytree(robot.folder, tmp_path / "stolen")
    begin_rotation("robot", robot.folder)
    finish_rotation("robot", robot.folder, lambda _: None)
    robot.copy_to(desk, "robot.pub")
    desk.wait()
    thief = Machine.__new__(Machine)
    thief.folder, thief.name, thief.now = tmp_path / "stolen", "robot", 0.0
    thief.start()
    assert reason(thief, desk) == "forged"


def test_a_machine_whose_key_is_removed_during_a_rotation_is_refused_with_its_next_key(
    machines: tuple[Machine, Machine],
) -> None:
    robot, desk = machines
    begin_rotation("robot", robot.folder)
    robot.copy_to(desk, "robot.next.pub")
    finish_rotation("robot", robot.folder, lambda _: None)
    desk.wait()
    robot.wait()
    assert reason(robot, desk) == ""
    (desk.folder / "robot.pub").unlink()
    desk.wait()
    assert reason(robot, desk) == "unknown sender"
    assert load_keys(desk.folder, "desk").of("robot") == []


def test_a_replaced_own_key_opens_no_replay_after_a_restart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of the sender is ahead, so only the notes from before the restart tell that the command is old."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder, environment = tmp_path / "keys", {KEYS_VARIABLE: f"{tmp_path / 'keys'}:robot", "ROS_DOMAIN_ID": "60"}
    for name in ("robot", "desk"):
        new_key(name, folder)
    ahead = Stream(load_keys(folder, "desk"), "ROS domain 60", "/say", now=lambda: time.time_ns() + 3 * SECOND)
    text = ahead.seal("a command")
    assert _opened(environment, text) == "a command"
    begin_rotation("robot", folder)
    finish_rotation("robot", folder, lambda _: None)
    with pytest.raises(SealError, match="late"):
        _opened(environment, text)


def _opened(environment: dict[str, str], text: str) -> str | None:
    """The text of a message that a new process receives."""
    opener = open_transport(environment).opener("/say")
    assert opener is not None
    return opener.open(text)


def test_an_interrupted_end_of_a_rotation_can_be_repeated(machines: tuple[Machine, Machine]) -> None:
    robot, desk = machines
    begin_rotation("robot", robot.folder)
    steps = iter([None])
    with pytest.raises(StopIteration):
        finish_rotation("robot", robot.folder, lambda _: next(steps))
    public = finish_rotation("robot", robot.folder, lambda _: None)
    robot.copy_to(desk, public.name)
    for machine in machines:
        machine.wait()
    assert reason(robot, desk) == ""
    assert sorted(path.name for path in robot.folder.glob("robot*")) == ["robot.key", "robot.pub"]


def test_mistakes_in_a_rotation(tmp_path: Path) -> None:
    with pytest.raises(SecurityError, match="no such folder"):
        begin_rotation("robot", tmp_path / "none")
    new_key("robot", tmp_path)
    with pytest.raises(SecurityError, match="cannot be read"):
        finish_rotation("robot", tmp_path)
    begin_rotation("robot", tmp_path)
    with pytest.raises(SecurityError, match="it exists already"):
        begin_rotation("robot", tmp_path)
    new_key("other", tmp_path)
    shutil.copy(tmp_path / "other.pub", tmp_path / "robot.next.pub")
    with pytest.raises(SecurityError, match="are not a pair"):
        finish_rotation("robot", tmp_path)


def test_the_command_tells_what_to_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(WINDOW_VARIABLE, "0.1")

    def run(*arguments: object) -> str:
        result = CliRunner().invoke(key, [str(one) for one in arguments], catch_exceptions=False)
        assert result.exit_code == 0
        return result.output

    new_key("robot", tmp_path)
    assert f"copy {tmp_path}/robot.next.pub" in run("rotate", "robot", "--folder", tmp_path)
    assert "the next key" in run("list", "--folder", tmp_path)
    assert f"copy {tmp_path}/robot.pub" in run("rotate", "robot", "--folder", tmp_path, "--finish")
    assert sorted(path.name for path in tmp_path.glob("robot*")) == ["robot.key", "robot.pub"]
    assert "signs as robot" in run("check", "--folder", tmp_path)


@pytest.mark.ros
def test_running_nodes_follow_their_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, desk = Machine(tmp_path, "robot"), Machine(tmp_path, "desk")
    robot.copy_to(desk, "robot.pub")
    desk.copy_to(robot, "desk.pub")
    graph = Graph("g", (NodeConfig("mouth", Mouth),), inputs=frozenset({TOPIC}))
    number = 0
    with observer_node() as ros:
        monkeypatch.setenv(KEYS_VARIABLE, str(desk.folder))
        transport = open_transport()
        sender = transport.advertise(ros, TOPIC, Utterance)
        monkeypatch.setenv(KEYS_VARIABLE, str(robot.folder))
        with node_hosts(graph) as host:
            mouth = host("mouth")
            assert eventually(lambda: sender.publisher.get_subscription_count() == 1)

            def say() -> bool:
                nonlocal number
                number += 1
                before = len(mouth.node.said), mouth.statistics.refusals.total()
                sender.publish(Utterance(stamp=1, id="u", text=str(number)))
                assert eventually(lambda: (len(mouth.node.said), mouth.statistics.refusals.total()) != before)
                return len(mouth.node.said) > before[0]

            assert say()
            begin_rotation("desk", desk.folder)
            desk.copy_to(robot, "desk.next.pub")
            assert all(say() for _ in range(20))
            finishing = threading.Thread(target=finish_rotation, args=("desk", desk.folder))
            finishing.start()
            while finishing.is_alive():
                assert say()
            desk.copy_to(robot, "desk.pub")
            os.unlink(robot.folder / "desk.next.pub")
            assert all(say() for _ in range(20))
            (robot.folder / "desk.pub").unlink()
            assert eventually(lambda: not say())
            assert mouth.statistics.refusals == {"unknown sender": 1}


def test_a_full_disk_leaves_no_part_of_the_list_of_private_files(tmp_path: Path) -> None:
    """Git would take private keys, as the list is written only where there is none."""
    with limited(resource.RLIMIT_FSIZE, 3), pytest.raises(SecurityError, match="File too large"):
        new_key("robot", tmp_path)
    new_key("robot", tmp_path)
    assert (tmp_path / ".gitignore").read_text() == "*.key\n"
