"""Words with which people speak about the deeds and beliefs of an agent, declared beside its rules.

An agent needs no vocabulary to answer questions: the names of its goals, actions and beliefs, and the phrases for its
actions, give English words. A vocabulary adds synonyms, other languages and better sentences::

    VOCABULARY = Vocabulary(
        deeds=(
            Deed(
                calls=("GreetPeople", 'speak("greeting")'),
                words={"en": ("greet", "welcome", "say hello"), "de": ("begrüßen",)},
                did={"en": ("I greeted you", "I greeted {person}")},
                did_not={"en": ("I did not greet you", "I did not greet {person}")},
            ),
        ),
        conditions=(Condition("stays", held={"en": ("you had been here for {present} s", "...")}),),
    )
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

Words = Mapping[str, Sequence[str]]
"""Words or short phrases by language (ISO 639-1)."""

Sentences = Mapping[str, str | tuple[str, str]]
"""Sentences by language: to the person concerned (``you``), and about others, who are named by ``{person}``.

One sentence serves for both.
"""


@dataclass(frozen=True)
class Deed:
    """Goal or action as people name it.

    Args:
        calls: Goals and actions that are this deed: a name, or a call with its first arguments (``speak("offer")``).
        words: Words for it.
        opposites: Words for leaving it undone, such as ``ignore``.
        did: Sentences in the past tense.
        did_not: The same, negated.
    """

    calls: Sequence[str]
    words: Words
    opposites: Words = field(default_factory=dict)
    did: Sentences = field(default_factory=dict)
    did_not: Sentences = field(default_factory=dict)


@dataclass(frozen=True)
class Condition:
    """Belief as a reason, in words.

    A sentence may contain ``{person}``, and the name of a belief about the same person, such as ``{present}``: the time
    (s) for which that belief had been held.

    Args:
        belief: Name of the belief, or a literal such as ``personDetected("No")``.
        held: Sentences for the time at which it was held.
        lacked: Sentences for the time at which it was not.
        ended: Sentences for the time at which it ended.
    """

    belief: str
    held: Sentences = field(default_factory=dict)
    lacked: Sentences = field(default_factory=dict)
    ended: Sentences = field(default_factory=dict)


@dataclass(frozen=True)
class Vocabulary:
    """Words for the deeds and beliefs of an agent package.

    Args:
        deeds: Its goals and actions.
        conditions: Its beliefs as reasons.
        names: Words for the names of its things and agents: for a whole name, such as ``kitchen``, or for the first
            word of several, such as ``box`` of ``box_a1``.
    """

    deeds: Sequence[Deed] = ()
    conditions: Sequence[Condition] = ()
    names: Mapping[str, Words] = field(default_factory=dict)
