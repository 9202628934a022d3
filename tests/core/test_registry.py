"""Declarations of agent packages: mistakes name the package, the field and the remedy."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from socialbot.core import registry
from socialbot.core.errors import GraphError
from socialbot.core.registry import AgentPackage
from socialbot.graph.files import load_graph

MODULE = """
from socialbot import Node, Structured

class Seat(Structured, frozen=True):
    number: int

class Usher(Node):
    pass

MESSAGES = (Seat,)
PHRASES = {"show": "shows {0}"}

def demo():
    pass
"""


@pytest.fixture
def declared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Declares a package of the module ``usher_node``, the only one beside those of socialbot."""
    (tmp_path / "usher_node.py").write_text(MODULE)
    (tmp_path / "usher").mkdir()
    (tmp_path / "usher" / "__init__.py").write_text("")
    (tmp_path / "usher" / "graph.yaml").write_text("name: usher\nnodes:\n  usher: {type: usher}\n")
    monkeypatch.syspath_prepend(tmp_path)

    def declare(**fields: Any) -> AgentPackage:
        package = AgentPackage(**{"name": "usher", "module": "usher", "nodes": {"usher": "usher_node:Usher"}, **fields})
        monkeypatch.setattr(registry, "agent_packages", lambda: (package,))
        registry.message_types.cache_clear()
        return package

    yield declare
    registry.message_types.cache_clear()
    for name in ("usher", "usher_node"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"nodes": ("usher_node:Usher",)}, "'nodes' must be a mapping"),
        ({"graphs": ("graph.yaml",)}, "'graphs' must be a mapping"),
        ({"messages": "usher_node:MESSAGES"}, "'messages' must be a sequence"),
        ({"phrases": {"show": "shows"}}, "'phrases' must be a text"),
        ({"nodes": {"usher": "usher_node.Usher"}}, "nodes: 'usher_node.Usher' is no reference"),
        ({"nodes": {"usher": object}}, "is no reference"),
        ({"messages": ("usher_node",)}, "messages: 'usher_node' is no reference"),
        ({"world_view": "usher_node"}, "world_view: 'usher_node' is no reference"),
    ],
)
def test_a_declaration_of_the_wrong_form_is_rejected_where_it_stands(declared, fields, words):
    with pytest.raises(GraphError) as caught:
        declared(**fields)
    assert words in str(caught.value)
    assert "agent package 'usher'" in str(caught.value)


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ("usher_node:MESSAGE", ["has no 'MESSAGE'", "did you mean 'MESSAGES'?"]),
        ("usher_nodes:MESSAGES", ["there is no module 'usher_nodes'"]),
        ("usher_node:Seat", ["'usher_node:Seat' is no sequence of message classes"]),
        ("usher_node:PHRASES", ["'usher_node:PHRASES' is no sequence of message classes"]),
    ],
)
def test_wrong_messages_of_a_package_are_reported(declared, reference, words):
    declared(messages=(reference,))
    with pytest.raises(GraphError) as caught:
        registry.message_types()
    assert all(word in str(caught.value) for word in (*words, "agent package 'usher'")), str(caught.value)


@pytest.mark.parametrize(
    ("field", "reference", "words"),
    [
        ("phrases", "usher_node:MESSAGES", "is no mapping"),
        ("phrases", "usher_node:PHRASE", "did you mean 'PHRASES'?"),
        ("vocabulary", "usher_node:PHRASES", "is no Vocabulary"),
        ("world_view", "usher_node:PHRASES", "is no function"),
        ("terminal_view", "usher_node:gone", "has no 'gone'"),
    ],
)
def test_wrong_references_of_a_package_are_reported(declared, field, reference, words):
    package = declared(**{field: reference})
    with pytest.raises(GraphError) as caught:
        package.load(field, reference)
    assert words in str(caught.value)
    assert "agent package 'usher'" in str(caught.value)


def test_right_references_of_a_package_are_loaded(declared):
    package = declared(
        messages=("usher_node:MESSAGES",), phrases="usher_node:PHRASES", demos={"usher": "usher_node:demo"}
    )
    assert [kind.__name__ for kind in registry.message_types()][-1] == "Seat"
    assert package.load("phrases", package.phrases) == {"show": "shows {0}"}
    assert package.load("demos", "usher_node:demo")() is None


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"graphs": {"usher": "graf.yaml"}}, "there is no file 'graf.yaml' in the folder of the module 'usher'"),
        ({"graphs": {"usher": "graph.yaml"}, "module": "ushr"}, "there is no module 'ushr'"),
    ],
)
def test_a_missing_file_of_a_package_is_reported(declared, fields, words):
    declared(**fields)
    with pytest.raises(GraphError) as caught:
        load_graph("usher")
    assert words in str(caught.value)
    assert "agent package 'usher'" in str(caught.value)


def test_an_error_of_an_entry_point_keeps_its_remedy(monkeypatch):
    """A declaration that is wrong says what to change; 'uninstall it' is not all."""

    class Point:
        name, value = "usher", "usher:AGENT"

        def load(self) -> AgentPackage:
            return AgentPackage("usher", "usher", messages="usher_node:MESSAGES")

    registry.agent_packages.cache_clear()
    monkeypatch.setattr(metadata, "entry_points", lambda **_: [Point()])
    try:
        with pytest.raises(GraphError, match="'messages' must be a sequence") as caught:
            registry.agent_packages()
    finally:
        registry.agent_packages.cache_clear()
    assert "write a tuple" in str(caught.value)
