"""Re-identification of people: by the colours of their clothes, and by where they were last seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.vision.appearance import OTHER, UNLIKE, Appearance, clarity_of
from socialbot.vision.motion import BoxFilter, Cut
from socialbot.vision.whereabouts import FloorPoint, LastSeen

REMEMBER_S = 90.0
"""How long a lost person can be recognised, s."""
_MOST_REMEMBERED = 32
_RETURNED = 0.12  # A lost person is recognised below this distance of looks,
_CLEARER = 0.7  # if other known people are farther by this factor.
_PLACED = 1.5  # A person is recognised by place and look if their misfits, 1 at most each, add up to less.
_PROVEN = 0.18  # The looks of a person recognised by look alone stay below this distance,
_PROOFS = 5  # as the median of so many,
_PROVING_S = 3.0  # for this long.
_PLACED_PROOFS = 3  # So many looks prove a recognition by place.
_DECIDING_S = 0.6  # A near new track that may show a lost person waits this long for its id.

Locate = Callable[[np.ndarray, Cut], FloorPoint | None]
"""Where on the floor the person in a box is, which the image cuts off at some sides; None if that is unknown."""


@dataclass(eq=False)
class TrackedPerson:
    """State of a track; without ``id`` it is not confirmed yet."""

    motion: BoxFilter
    box: np.ndarray
    score: float
    cut: Cut
    key: int
    id: str = ""
    hits: int = 1
    sure_hits: int = 0
    misses: int = 0
    unseen_s: float = 0.0
    best: float = 0.0
    fit: float = 1.0
    hidden_s: float = 0.0
    begun: int = 0
    last: int = 0
    sure_at: int = 0
    mixed: int = -(2**62)
    appearance: Appearance = field(default_factory=Appearance)
    others: list[np.ndarray] = field(default_factory=list)
    met: set[str] = field(default_factory=set)
    due: bool = False
    new: bool = False
    turned: bool = False
    seen: LastSeen | None = None
    claim: Recognition | None = None

    @property
    def feet_hidden(self) -> bool:
        return self.hidden_s > 0

    def accept(self) -> None:
        """Take a recognition for proven: merge the remembered appearance of the person with that of the track."""
        if self.claim is not None:
            before, self.claim = self.claim.person, None
            before.appearance.learn(self.appearance)
            self.appearance, self.met = before.appearance, self.met | before.met


@dataclass(eq=False)
class Recognition:
    """Recognition of a lost ``person``, by look alone or also ``by_place``, that further ``looks`` must prove.

    A person who enters may show little of themselves, and look like somebody else at first. The looks are ``whole`` if
    they show upper body and legs; ``since`` is the stamp of the first one (ns).
    """

    person: TrackedPerson
    since: int
    by_place: bool = False
    whole: bool = False
    looks: list[np.ndarray] = field(default_factory=list)

    def prove(self, look: np.ndarray, stamp: int) -> bool | None:
        """Compare a further ``look`` with the memory: whether the recognition is proven; None as long as it is open."""
        whole = not np.isnan(look).any()
        if whole and not self.whole:
            self.whole, self.since, self.looks = True, stamp, []
        if whole is self.whole and not np.isnan(look[:, 0]).all():
            self.looks = [*self.looks, look][-_PROOFS:]
        far = float(np.median(self.person.appearance.distances(np.array(self.looks)))) if self.looks else math.inf
        # People turn round and come near: their looks may differ later, and the place counts at the beginning.
        if self.by_place and len(self.looks) >= _PLACED_PROOFS and far < UNLIKE:
            return True
        if len(self.looks) < _PROOFS:
            return None
        if far > (OTHER if self.by_place else _PROVEN):
            return False
        return True if (stamp - self.since) / SECOND > _PROVING_S else None


class LostPeople:
    """Memory of the people who were lost, of whom the last ones are kept."""

    def __init__(self) -> None:
        self.people: list[TrackedPerson] = []

    def add(self, people: Iterable[TrackedPerson]) -> None:
        """Remember ``people``; their recognitions, if they are not refuted, count as proven."""
        people = list(people)
        for each in people:
            each.accept()
        self.people = [*self.people, *people][-_MOST_REMEMBERED:]

    def remove(self, person: TrackedPerson) -> None:
        """Forget a person, who may be unknown."""
        self.people = [each for each in self.people if each is not person]

    def forget_before(self, stamp: int) -> None:
        """Forget people who were last seen before ``stamp`` (ns)."""
        self.people = [person for person in self.people if person.last >= stamp]

    def turn(self, turn: np.ndarray, centre: np.ndarray) -> None:
        """Move people with the background of the image, as far as a homography moves its ``centre``."""
        for person in self.people:
            person.motion.shift(turn, centre)
            person.turned = True

    def recognise(
        self, person: TrackedPerson, present: Sequence[TrackedPerson], stamp: int, locate: Locate | None
    ) -> Recognition | None:
        """Find the lost person whom a track shows.

        People who are present in the image or predicted in it may be lost, too.
        """
        others = [each for each in present if each.id and each is not person]
        known = [*self.people, *others]
        far = {each.id: _distance(each, person) for each in known}
        missed = [each for each in others if each.misses]
        lost = [each for each in (*self.people, *missed) if each.id not in person.met]
        away = _misfits(person, lost, stamp, locate)
        # Out of view, people stay where they were, or walk on.
        here = [each for each in lost if _is_here(each, person, far[each.id], away.get(each.id))]
        alike = min((far[each.id] for each in lost), default=math.inf)
        if alike <= _RETURNED:
            here = [each for each in here if far[each.id] == math.inf or _CLEARER * far[each.id] <= alike]
        if here:
            best = min(here, key=lambda each: (*_misfit(far[each.id], away.get(each.id)), -each.last))
            return Recognition(best, stamp, by_place=True)
        best = min(lost, key=lambda each: (far[each.id], -each.last), default=None)
        if best is None or far[best.id] > _RETURNED or away.get(best.id) == math.inf:
            return None
        alike = [each for each in known if each is not best and far[best.id] > _CLEARER * far[each.id]]
        return None if any(each.id in best.met for each in alike) else Recognition(best, stamp)

    def may_return(self, person: TrackedPerson) -> bool:
        """Whether the next looks of a new track may show that it is a lost person."""
        partly_seen = person.cut.left or person.cut.right or person.mixed >= person.begun
        patience = _DECIDING_S * float(clarity_of(person.box[None])[0])
        known = [each for each in self.people if len(each.appearance)]
        if not (known and partly_seen) or (person.last - person.begun) / SECOND >= patience:
            return False
        if not len(person.appearance):
            return True
        lost = [each for each in known if each.id not in person.met]
        return any(each.appearance.distance_to(person.appearance) < UNLIKE for each in lost)


def _distance(person: TrackedPerson, other: TrackedPerson) -> float:
    """Distance between the appearances of two people; the first may have a remembered one, too."""
    far = person.appearance.distance_to(other.appearance)
    return far if person.claim is None else min(far, person.claim.person.appearance.distance_to(other.appearance))


def _misfits(
    person: TrackedPerson, lost: Sequence[TrackedPerson], stamp: int, locate: Locate | None
) -> dict[str, float]:
    """How far a track is from where each of the ``lost`` may be, by id, as far as that is known."""
    seen = {each.id: each.seen for each in lost if each.seen is not None}
    point = locate(person.box, person.cut) if locate is not None and seen else None
    if point is None:
        return {}
    found = {name: each.misfit(stamp, point) for name, each in seen.items()}
    return {name: away for name, away in found.items() if away is not None}


def _is_here(before: TrackedPerson, person: TrackedPerson, far: float, away: float | None) -> bool:
    """Whether a track is where a lost person may be, and does not look like somebody else."""
    stays = before.turned and before.motion.is_at(person.box, person.cut)
    # Colours that are not known agree with anybody's.
    if far == math.inf:
        return stays and (away is None or away <= 1)
    near = stays if away is None else away <= 1
    return near and far < UNLIKE and (stays or _misfit(far, away)[0] < _PLACED)


def _misfit(far: float, away: float | None) -> tuple[float, float]:
    """Misfit of look and place, and that of the place."""
    return far / UNLIKE + (away or 0.0), away or 0.0
