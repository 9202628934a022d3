"""Published results of the paper and of its predecessor by problem rate (%).

The paper covers plan recovery in multi-robot systems with BDI agents, and defines this ward. Only its Table 3 has
numbers; values of Figures 7 to 9 come from its text. The predecessor has no BDI: its figures are recounted from two
published sets of 30 runs per cell. The paper does not say which set it shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

RUNS = 30


class Recovered(NamedTuple):
    """Row of Table 3: missions of `RUNS` with a problem, and the mean time of all, s."""

    problems: int
    seconds: float


TABLE_3: Mapping[int, Recovered] = {
    10: Recovered(4, 4.34),
    25: Recovered(5, 4.39),
    50: Recovered(18, 5.04),
    75: Recovered(22, 5.16),
    100: Recovered(30, 5.33),
}
"""BDI with recovery; all missions were completed."""
GROWTH = 22.81
"""Growth of its mean time from 10 % to 100 %, in %."""


class Run(NamedTuple):
    """Cell of the predecessor: problems and completed missions of `RUNS`, and mean time, s."""

    problems: int
    completed: int
    seconds: float


class PastCell(NamedTuple):
    """Predecessor with and without replanning."""

    replan: Run
    plain: Run


PREDECESSOR: tuple[Mapping[int, PastCell], ...] = (
    {
        10: PastCell(Run(2, 30, 2.59), Run(2, 28, 2.60)),
        25: PastCell(Run(10, 30, 2.66), Run(7, 23, 2.59)),
        50: PastCell(Run(16, 30, 2.68), Run(18, 12, 2.59)),
        75: PastCell(Run(23, 30, 2.76), Run(24, 6, 2.58)),
    },
    {
        10: PastCell(Run(5, 30, 2.76), Run(4, 26, 2.59)),
        25: PastCell(Run(11, 30, 2.76), Run(7, 23, 2.66)),
        50: PastCell(Run(21, 30, 2.73), Run(15, 15, 2.58)),
        75: PastCell(Run(24, 30, 2.70), Run(20, 10, 2.58)),
    },
)
"""Times are those of whole processes; a mission takes 1.05 s of these, a new plan 0.05 s."""
