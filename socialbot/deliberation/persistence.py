"""What an agent believes and desires in a file, so that it goes on after a crash.

Plans are not kept: what steps have begun is taken back, as if the plan had been aborted, and a new one is made.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from socialbot.core.errors import PlanningError
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.fact_index import FactIndex
from socialbot.deliberation.messages import INSTANCE, Desire, Fact


class KeptDesire(msgspec.Struct, frozen=True, kw_only=True):
    """A desire and how often it has failed."""

    desire: Desire
    failed_planning: int = 0
    failed_execution: int = 0


class Kept(msgspec.Struct, frozen=True, kw_only=True, tag_field="schema", tag="socialbot/Kept/1"):
    """The content of such a file."""

    domain: str
    facts: tuple[Fact, ...]
    desires: tuple[KeptDesire, ...]


def keep(deliberator: Deliberator, path: Path) -> None:
    """Writes the file. Whoever reads it finds the old one or the new one, never half of one."""
    kept = Kept(
        domain=deliberator.domain.name,
        facts=deliberator.director.beliefs_if_aborted(),
        desires=tuple(
            KeptDesire(desire=wish.desire, failed_planning=wish.failed_planning, failed_execution=wish.failed_execution)
            for wish in deliberator.desires
        ),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f"{path.name}.new")
    new.write_bytes(msgspec.json.encode(kept))
    os.replace(new, path)


def recall(deliberator: Deliberator, path: Path) -> bool:
    """Gives an agent back what the file holds; False when there is no file.

    Raises PlanningError, with nothing changed, for another file, or one that does not fit the domain.
    """
    try:
        kept = msgspec.json.decode(path.read_bytes(), type=Kept)
    except FileNotFoundError:
        return False
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise PlanningError(
            f"no kept mind: {error}", where=str(path), remedy="delete the file to begin anew"
        ) from error
    if kept.domain != deliberator.domain.name:
        raise PlanningError(
            f"it was kept by an agent of the domain {kept.domain}", where=str(path), remedy="delete it to begin anew"
        )
    index = FactIndex(deliberator.domain, (fact for fact in kept.facts if fact.pddl_type == INSTANCE))
    for fact in kept.facts:
        reason = index.unknown(fact)
        if reason is not None:
            raise PlanningError(
                f"the domain is not what it was: {reason}", where=str(path), remedy="delete the file to begin anew"
            )
    for fact in kept.facts:
        deliberator.facts.add(fact, cause="kept")
    for item in kept.desires:
        deliberator.desire(item.desire, cause="kept")
        wish = deliberator.desires.get(item.desire.name)
        if wish is not None:
            wish.failed_planning, wish.failed_execution = item.failed_planning, item.failed_execution
    return True
