"""Whose turn it is: which desire to plan for next.

A higher priority goes first, then the earliest deadline, then who came first. Desires whose precondition or context
does not hold are passed over, as are those that have just failed. While a desire is pursued nobody else has a turn,
unless the policy is to preempt: then it is whoever outranks that desire, by its priority or by a strictly shorter
deadline; but not when it has done so before, in vain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from socialbot.deliberation.desires import Wish
from socialbot.deliberation.options import Policy


def next_wish(
    ranked: Sequence[Wish], pursued: Wish | None, policy: Policy, is_ready: Callable[[Wish], bool]
) -> Wish | None:
    """The desire to plan for, if there is any, of those that are ``ranked``; ``pursued`` is the one that is pursued.

    ``is_ready`` tells whether one may be planned for by now. It is asked about all who would have had a turn.
    """
    if pursued is not None and policy == "NO_PREEMPT":
        return None
    for wish in ranked:
        if pursued is not None and not wish.outranks(pursued):
            return None
        if not wish.blocked and pursued not in wish.in_vain and is_ready(wish):
            return wish
    return None
