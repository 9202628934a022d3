"""Sets of moments of a finite trace as closed intervals of integers (ns), and the operators of MTL on them."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

ClosedInterval = tuple[int, int]

EMPTY: TimeSet


@dataclass(frozen=True, slots=True)
class TimeSet:
    """Set of integers as disjoint closed intervals in order, none next to another."""

    intervals: tuple[ClosedInterval, ...] = ()

    @classmethod
    def of(cls, intervals: Iterable[ClosedInterval]) -> TimeSet:
        """Return the union of intervals, which may overlap; those that end before their begin are empty."""
        merged: list[ClosedInterval] = []
        for begin, end in sorted(each for each in intervals if each[0] <= each[1]):
            if merged and begin <= merged[-1][1] + 1:
                merged[-1] = merged[-1][0], max(merged[-1][1], end)
            else:
                merged.append((begin, end))
        return cls(tuple(merged))

    def __bool__(self) -> bool:
        return bool(self.intervals)

    def __iter__(self) -> Iterator[ClosedInterval]:
        return iter(self.intervals)

    def __contains__(self, moment: int) -> bool:
        place = bisect_right(self.intervals, (moment, _LATEST)) - 1
        return place >= 0 and moment <= self.intervals[place][1]

    def __or__(self, other: TimeSet) -> TimeSet:
        return TimeSet.of((*self.intervals, *other.intervals)) if self and other else self or other

    def __and__(self, other: TimeSet) -> TimeSet:
        found: list[ClosedInterval] = []
        mine, theirs, i, j = self.intervals, other.intervals, 0, 0
        while i < len(mine) and j < len(theirs):
            begin, end = max(mine[i][0], theirs[j][0]), min(mine[i][1], theirs[j][1])
            if begin <= end:
                found.append((begin, end))
            if mine[i][1] < theirs[j][1]:
                i += 1
            else:
                j += 1
        return TimeSet(tuple(found))

    def without(self, other: TimeSet, last: int) -> TimeSet:
        """Return the moments of this set that are not in ``other``; no moment is after ``last``."""
        return self & other.complement(last)

    def complement(self, last: int) -> TimeSet:
        """Return the moments from 0 to ``last`` that are not in this set."""
        found, begin = [], 0
        for first, end in self.intervals:
            if begin < first:
                found.append((begin, first - 1))
            begin = end + 1
        if begin <= last:
            found.append((begin, last))
        return TimeSet(tuple(found))

    def within(self, begin: int, end: int) -> Sequence[ClosedInterval]:
        """Return the intervals that have a moment from ``begin`` to ``end``, whole."""
        first = bisect_left(self.intervals, begin, key=itemgetter(1))
        return self.intervals[first : bisect_right(self.intervals, end, key=itemgetter(0))]

    def clipped(self, begin: int, end: int) -> TimeSet:
        return TimeSet(tuple((max(begin, first), min(end, last)) for first, last in self.within(begin, end)))

    def earlier(self, least: int, most: int | None, last: int) -> TimeSet:
        """Return the moments with a moment of this set ``least`` to ``most`` later (None: any time)."""
        return TimeSet.of((0 if most is None else max(0, a - most), min(last, b - least)) for a, b in self.intervals)

    def later(self, least: int, most: int | None, last: int) -> TimeSet:
        """Return the moments with a moment of this set ``least`` to ``most`` earlier (None: any time)."""
        return TimeSet.of((max(0, a + least), last if most is None else min(last, b + most)) for a, b in self.intervals)

    def starts(self) -> list[int]:
        return [begin for begin, _ in self.intervals]


EMPTY = TimeSet()
_LATEST = 1 << 200


def until(left: TimeSet, right: TimeSet, least: int, most: int | None, last: int) -> TimeSet:
    """Return the moments t with a moment u of ``right``, u - t in [least, most], and [t, u - 1] in ``left``."""
    parts = [right] if least == 0 else []
    for begin, end in left:
        reach = right.clipped(begin, end + 1).earlier(least, most, last)
        parts.append(reach.clipped(begin, end))
    return TimeSet.of(interval for part in parts for interval in part)


def since(left: TimeSet, right: TimeSet, least: int, most: int | None, last: int) -> TimeSet:
    """Return the moments t with a moment u of ``right``, t - u in [least, most], and [u + 1, t] in ``left``."""
    parts = [right] if least == 0 else []
    for begin, end in left:
        reach = right.clipped(begin - 1, end).later(least, most, last)
        parts.append(reach.clipped(begin, end))
    return TimeSet.of(interval for part in parts for interval in part)


def counted(moments: Sequence[int], least: int, most: int | None, low: int, high: int | None, last: int) -> TimeSet:
    """Return the moments t from 0 to ``last`` with ``low`` to ``high`` of ``moments`` in [t + least, t + most]."""
    steps: dict[int, int] = {}
    for moment in moments:
        if moment - least < 0:
            continue
        first = 0 if most is None else max(0, moment - most)
        steps[first] = steps.get(first, 0) + 1
        after = moment - least + 1
        steps[after] = steps.get(after, 0) - 1
    found, count, begin = [], 0, 0
    for place in (*sorted(steps), last + 1):
        end = min(place, last + 1) - 1
        if begin <= end and count >= low and (high is None or count <= high):
            found.append((begin, end))
        begin, count = place, count + steps.get(place, 0)
    return TimeSet.of(found)
