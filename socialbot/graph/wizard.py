"""Keys of the person behind the scenes in a Wizard-of-Oz study: one key, one sentence, belief or goal."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, get_args

import msgspec

from socialbot.core.errors import GraphError

if TYPE_CHECKING:
    from socialbot.core.yaml import YamlSection

WizardCommand = Literal["say", "believe", "achieve"]

RESERVED = frozenset("w")
"""Keys that the run page uses itself."""

_KEY = re.compile(r"[a-z]")


class WizardKey(msgspec.Struct, frozen=True):
    """Key of the run page with its command.

    Args:
        key: Lower-case letter.
        label: Text of its button; by default the command with its text.
        command: "say" a sentence, "believe" a belief, or "achieve" a goal.
        text: The sentence, belief or goal.
        agent: Agent that gets the command; by default the one that the page shows.
    """

    key: str
    label: str
    command: WizardCommand
    text: str
    agent: str = ""


class WizardEntry(msgspec.Struct):
    """Entry of a key in a graph file: one command with its text, label and agent."""

    label: str | None = None
    agent: str = ""
    say: str | None = None
    believe: str | None = None
    achieve: str | None = None


def read_wizard(root: YamlSection, entries: Mapping[str, WizardEntry]) -> tuple[WizardKey, ...]:
    """Return the keys of the section ``wizard`` of a graph file. Raises GraphError."""
    return tuple(_key(key, entry, root) for key, entry in entries.items())


def _key(key: str, entry: WizardEntry, root: YamlSection) -> WizardKey:
    where = root.line("wizard", key)
    if not _KEY.fullmatch(key) or key in RESERVED:
        raise GraphError(f"no valid key: {key!r}", where=where, remedy="use a letter from a to z, but not w")
    commands = get_args(WizardCommand)
    given = [(command, text) for command in commands if (text := getattr(entry, command)) is not None]
    if len(given) != 1:
        raise GraphError(f"key {key!r} needs one command", where=where, remedy=f"give one of {', '.join(commands)}")
    [(command, text)] = given
    if not text.strip():
        raise GraphError(f"{command!r} is empty", where=root.line("wizard", key, command))
    label = f"{command} {text.strip()}" if entry.label is None else entry.label
    return WizardKey(key, label, command, text.strip(), entry.agent)


def wizard_page(keys: Sequence[WizardKey]) -> dict[str, dict[str, str]]:
    """Return the keys as the section ``wizard`` of a graph file."""
    return {
        each.key: {"label": each.label, each.command: each.text, **({"agent": each.agent} if each.agent else {})}
        for each in keys
    }
