"""The voice of a node in the hospital: what it says becomes speech acts with ids of their own."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from socialbot.agents.hospital.messages import AclMessage, AnyContent, Performative
from socialbot.clock import Clock


class Voice:
    """Says things as ``name``; ``publish`` sends them."""

    def __init__(self, name: str, clock: Clock, publish: Callable[[AclMessage], object]) -> None:
        self._name = name
        self._clock = clock
        self._publish = publish
        self._begun = clock.now()
        self._numbers = itertools.count(1)

    def say(
        self, receiver: str, performative: Performative, content: AnyContent, mission: str = "", in_reply_to: str = ""
    ) -> None:
        """Says ``content`` to the receiver; see `AclMessage`."""
        self._publish(
            AclMessage(
                stamp=self._clock.now(),
                id=f"{self._name}-{self.next_id()}",
                sender=self._name,
                receiver=receiver,
                performative=performative,
                content=content,
                in_reply_to=in_reply_to,
                mission=mission,
            )
        )

    def next_id(self) -> str:
        """One that this speaker, however often it begins anew, has not used before."""
        return f"{self._begun}-{next(self._numbers)}"
