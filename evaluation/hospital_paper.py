"""What is known of the paper's experiments, and of those of its predecessor, by rate of problems (%).

The paper is the one on plan recovery in multi-robot systems with BDI agents whose ward this is. Of its figures only
Table 3 gives numbers; Figures 7 to 9 are read as it tells of them. The predecessor has no BDI: its figures are counted
again from its two published sets of 30 runs a cell. Which of them the paper shows is not said.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

RUNS = 30
"""Runs of each cell."""


class Recovered(NamedTuple):
    """A row of Table 3: missions of `RUNS` that met a problem, and the mean time of all, s."""

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
"""By how much its mean time grows from 10 % to 100 %, in %."""


class Run(NamedTuple):
    """A cell of the predecessor: problems and completed missions of `RUNS`, the mean time, s."""

    problems: int
    completed: int
    seconds: float


class PastCell(NamedTuple):
    """The predecessor with and without planning anew."""

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
"""Its times are those of whole processes, of which a mission takes 1.05 s; a new plan takes 0.05 s."""
