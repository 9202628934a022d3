"""`.include` loads a program into a running agent."""

from __future__ import annotations

from pathlib import Path

from socialbot.bdi.agentspeak.programs import IncludePaths
from tests.bdi.mas import Mas


def said(tmp_path: Path, text: str) -> list[str]:
    (tmp_path / "more.asl").write_text(
        "b(1). !begin. +!begin <- .print(begun). +!g(X) : b(Y) <- .print(g, X, Y).", "utf-8"
    )
    mas = Mas(me="")
    mas.society.include_paths = IncludePaths((tmp_path,))
    mas.me.add_text(text)
    return mas.until(1).lines


def test_plans_beliefs_and_goals_are_added(tmp_path):
    assert said(tmp_path, '!go. +!go <- .include("more.asl"); !g(2); ?b(X); .print(X).') == ["begun", "g21", "1"]


def test_a_namespace_is_made_for_a_variable(tmp_path):
    text = '!go. +!go <- .include("more.asl", N); !N::g(2); if (not b(_)) { .print(own) }.'
    assert said(tmp_path, text) == ["begun", "g21", "own"]


def test_a_file_that_does_not_exist_fails(tmp_path):
    text = '!go. +!go <- .include("none.asl"). -!go[error(E), error_msg(M)] <- .print(E, " ", M).'
    (line,) = said(tmp_path, text)
    assert line.startswith("action_failed .include: ")
    assert "the included file none.asl does not exist" in line


def test_without_folders_it_fails():
    mas = Mas(me='!go. +!go <- .include("more.asl"). -!go[error_msg(M)] <- .print(M).')
    assert mas.until(1).lines == [".include: more.asl cannot be loaded: set Society.include_paths"]
