"""Keys of the person behind the scenes in a Wizard-of-Oz study: one key, one sentence, belief or goal."""

from __future__ import annotations

import re
from collections.abc import Sequence
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


def read_wizard(section: YamlSection) -> tuple[WizardKey, ...]:
    """Return the keys of the section ``wizard`` of a graph file. Raises GraphError."""
    return tuple(_key(str(key), section.section(key), section.line(key)) for key in section.page)


def _key(key: str, section: YamlSection, where: str) -> WizardKey:
    commands = get_args(WizardCommand)
    section.only("label", "agent", *commands)
    if not _KEY.fullmatch(key) or key in RESERVED:
        raise GraphError(f"no valid key: {key!r}", where=where, remedy="use a letter from a to z, but not w")
    given = [command for command in commands if command in section.page]
    if len(given) != 1:
        raise GraphError(f"key {key!r} needs one command", where=where, remedy=f"give one of {', '.join(commands)}")
    text = section.text(given[0]).strip()
    if not text:
        raise GraphError(f"{given[0]!r} is empty", where=section.line(given[0]))
    label = section.text("label", f"{given[0]} {text}")
    return WizardKey(key, label, given[0], text, section.text("agent", ""))


def wizard_page(keys: Sequence[WizardKey]) -> dict[str, dict[str, str]]:
    """Return the keys as the section ``wizard`` of a graph file."""
    return {
        each.key: {"label": each.label, each.command: each.text, **({"agent": each.agent} if each.agent else {})}
        for each in keys
    }
