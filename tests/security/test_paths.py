from __future__ import annotations

from pathlib import Path

import pytest

from socialbot.errors import ParameterError
from socialbot.security.paths import FOLDERS_VARIABLE, allow, within, workspace


@pytest.mark.parametrize("path", ["a.wav", "deep/er/a.wav", "./a", "deep/../a", ""])
def test_paths_inside_are_taken_relative_to_the_folder(tmp_path, path):
    assert within(path, [tmp_path], where="speech.folder") == (tmp_path / path).resolve()
    assert within(tmp_path / path, [tmp_path], where="speech.folder") == (tmp_path / path).resolve()


@pytest.mark.parametrize("path", ["..", "../x", "a/../../x", "/etc/passwd", "/", "~/../../x/../..", "\0"])
def test_paths_that_lead_out_are_refused(tmp_path, path):
    with pytest.raises(ParameterError, match=r"speech\.folder"):
        within(path, [tmp_path / "inside"], where="speech.folder")


def test_a_folder_whose_name_begins_alike_is_outside(tmp_path):
    with pytest.raises(ParameterError):
        within("../runs2/x", [tmp_path / "runs"], where="x")


def test_links_are_followed_before_one_looks(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link").symlink_to(tmp_path)
    (inside / "self").symlink_to(inside / "self")
    for path in ("link/secret", "self/x"):
        with pytest.raises(ParameterError):
            within(path, [inside], where="x")


def test_it_may_be_in_any_of_several_folders(tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    assert within(second / "x", [first, second], where="x") == second / "x"
    assert within("x", [first, second], where="x") == first / "x"


def test_users_allow_folders_for_this_process_and_those_it_starts(tmp_path):
    environment: dict[str, str] = {}
    assert workspace(environment) == (Path.cwd(),)
    allow(tmp_path / "out", environment)
    allow(tmp_path / "out" / "deeper", environment)
    allow(tmp_path / "more", environment)
    allow(Path("runs"), environment)
    assert environment[FOLDERS_VARIABLE] == f"{tmp_path / 'out'}:{tmp_path / 'more'}"
    assert workspace(environment) == (Path.cwd(), tmp_path / "out", tmp_path / "more")
