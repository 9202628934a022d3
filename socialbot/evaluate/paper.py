"""The figures of the paper *A Case Study of Adding Proactivity in Indoor Social Robots*: section 4.3, Tables 2 and 3.

HOG with a support vector machine on a robot in a corridor, scene 1 with steady light and scene 2 with changing light.
Other people, other pictures and another rule for what is a hit: the figures tell where that detector was weak, not
how much better another one is. For that, compare detectors on the same frames.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from socialbot.vision.scoring import Score

__all__ = ["PAPER", "SCENES", "paper_scene"]

SCENES = ("Scene 1", "Scene 2")

PAPER: Mapping[str, Mapping[str, Score]] = MappingProxyType(
    {
        "Scene 1": {"0-2": Score(tp=253, fp=160, fn=187), "2-10": Score(tp=401, fp=87, fn=112)},
        "Scene 2": {"0-2": Score(tp=175, fp=160, fn=265), "2-10": Score(tp=354, fp=114, fn=132)},
    }
)
"""Table 2 by scene and band. Table 3 follows from it."""


def paper_scene(name: str) -> str | None:
    """The paper's scene that the scene called ``name`` stands for: "scene1" for "Scene 1"."""
    found = re.match(r"scene[\W_]*([12])(?!\d)", name.lower())
    return f"Scene {found[1]}" if found else None
