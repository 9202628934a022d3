from __future__ import annotations

import os
import shutil
import stat

import pytest
from typer.testing import CliRunner

from socialbot.bridge.security import SecurityError, fingerprint, load_keys, load_private_key, new_key, private_names
from socialbot.cli.key import key


@pytest.fixture
def folder(tmp_path):
    new_key("robot", tmp_path / "keys")
    return tmp_path / "keys"


def complaint(folder, name="") -> str:
    with pytest.raises(SecurityError) as caught:
        load_keys(folder, name)
    return str(caught.value)


def test_a_new_key_is_ones_own_and_is_believed(folder):
    keys = load_keys(folder)
    assert (keys.name, set(keys.trusted)) == ("robot", {"robot"})
    keys.trusted["robot"].verify(keys.private.sign(b"word"), b"word")


def test_only_its_owner_can_read_the_private_file_and_git_leaves_it_out(folder):
    assert stat.S_IMODE((folder / "robot.key").stat().st_mode) == 0o600
    assert (folder / ".gitignore").read_text() == "*.key\n"
    assert "PrivateKey" not in repr(load_keys(folder))


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_private_key_that_others_can_read_or_change_is_refused(folder, mode):
    (folder / "robot.key").chmod(mode)
    text = complaint(folder)
    assert "other users can read or change this private key" in text
    assert f"chmod 600 {folder / 'robot.key'}" in text


@pytest.mark.parametrize("name", [".", "robot.pub"])
def test_what_anybody_may_change_is_refused(folder, name):
    (folder / name).chmod(0o757 if name == "." else 0o646)
    assert "anybody can" in complaint(folder)


def test_of_several_private_keys_one_has_to_be_named(folder):
    new_key("workstation", folder)
    assert "several private keys: robot, workstation" in complaint(folder)
    assert load_keys(folder, "workstation").name == "workstation"
    assert private_names(folder) == ["robot", "workstation"]


def test_a_folder_with_public_keys_only_cannot_speak(folder):
    (folder / "robot.key").unlink()
    assert "no private key" in complaint(folder)


def test_a_private_key_of_another_pair_is_refused(folder, tmp_path):
    new_key("robot", tmp_path / "other")
    shutil.copy(tmp_path / "other" / "robot.pub", folder)
    assert "are not a pair" in complaint(folder)
    (folder / "robot.pub").unlink()
    assert "there is no robot.pub" in complaint(folder, "robot")


def test_an_existing_key_is_never_overwritten(folder):
    before = (folder / "robot.key").read_bytes()
    (folder / "robot.pub").unlink()
    with pytest.raises(SecurityError, match="cannot create the key 'robot'"):
        new_key("robot", folder)
    assert (folder / "robot.key").read_bytes() == before


@pytest.mark.parametrize("name", ["", "../robot", "a/b", ".robot", "-robot", "r" * 65, "robot\n", "róbot"])
def test_names_cannot_lead_out_of_the_folder(folder, name):
    with pytest.raises(SecurityError, match="is not a valid key name"):
        new_key(name, folder)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"rubbish",
        b"-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n",
        # The length of a part is wrong, of which OpenSSL complains in a way of its own.
        b"-----BEGIN PRIVATE KEY-----\nMC4CAQAwBQYDK2VvBCIEIAABAgMEBQYHCAkKCwwNDg8QERITFBUWFxgZGhscHR4f\n"
        b"-----END PRIVATE KEY-----\n",
    ],
)
def test_damaged_keys_are_refused(folder, text):
    (folder / "robot.pub").write_bytes(text)
    assert "the file holds no usable key" in complaint(folder)
    (folder / "robot.key").write_bytes(text)
    with pytest.raises(SecurityError, match="the file holds no usable key"):
        load_private_key(folder / "robot.key")


def test_keys_of_another_kind_are_refused(folder):
    from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    public = generate_private_key(SECP256R1()).public_key()
    (folder / "robot.pub").write_bytes(public.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    assert "not a public Ed25519 key" in complaint(folder)


def test_a_missing_folder_is_told(tmp_path):
    assert "no such folder" in complaint(tmp_path / "none", "robot")


class TestCommands:
    def run(self, *arguments: object) -> str:
        result = CliRunner().invoke(key, [str(one) for one in arguments], catch_exceptions=False)
        assert result.exit_code == 0
        return result.output

    def test_new_list_and_check_tell_the_same_fingerprint(self, folder):
        made = self.run("new", "workstation", "--folder", folder)
        shown = fingerprint(load_keys(folder, "robot").trusted["workstation"])
        assert shown in made
        assert shown in self.run("list", "--folder", folder)
        assert "speaks as robot, believes workstation" in self.run("check", "robot", "--folder", folder)

    def test_the_folder_is_that_of_the_variable(self, folder, monkeypatch):
        monkeypatch.setenv("SOCIALBOT_KEYS", f"{folder}:robot")
        assert "robot" in self.run("list")
        monkeypatch.delenv("SOCIALBOT_KEYS")
        monkeypatch.chdir(folder.parent)
        assert "speaks as robot" in self.run("check")

    def test_check_fails_where_the_keys_cannot_be_used(self, folder):
        os.chmod(folder / "robot.key", 0o644)
        with pytest.raises(SecurityError):
            self.run("check", "--folder", folder)
