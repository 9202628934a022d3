"""What each person wears."""

from __future__ import annotations

from body import Body, Outfit, Part
from clothes import shoes_part, top_part, trousers_part
from face import eye_part, skin_part
from hair import hair_part

OUTFITS = {
    "A": Outfit(
        skin=(0.52, 0.30, 0.21), hair=(0.035, 0.02, 0.012), iris=(0.05, 0.09, 0.12), lips=(0.36, 0.13, 0.1),
        top=(0.035, 0.075, 0.16), trousers=(0.085, 0.09, 0.1), shoes=(0.03, 0.03, 0.032),
        loose=0.024, hem=-0.02, neck=0.0, stubble=0.35,
    ),
    "B": Outfit(
        skin=(0.6, 0.37, 0.27), hair=(0.11, 0.05, 0.022), iris=(0.09, 0.05, 0.02), lips=(0.45, 0.12, 0.12),
        top=(0.33, 0.07, 0.075), trousers=(0.02, 0.021, 0.026), shoes=(0.07, 0.05, 0.045),
        loose=0.018, hem=-0.12, neck=-0.035, long_hair=True, open_front=(0.6, 0.58, 0.55),
    ),
    "C": Outfit(
        skin=(0.42, 0.22, 0.14), hair=(0.22, 0.21, 0.2), iris=(0.05, 0.03, 0.02), lips=(0.28, 0.11, 0.09),
        top=(0.42, 0.47, 0.52), trousers=(0.24, 0.19, 0.125), shoes=(0.06, 0.035, 0.02),
        loose=0.024, hem=-0.03, neck=-0.01, stripes=(0.16, 0.24, 0.38), stubble=0.15,
    ),
}  # fmt: skip


def dressed(body: Body, outfit: Outfit, seed: int) -> list[Part]:
    """All parts of a person but the hair strands."""
    return [
        skin_part(body, outfit),
        eye_part(body, outfit, "L"),
        eye_part(body, outfit, "R"),
        hair_part(body, outfit),
        top_part(body, outfit, seed),
        trousers_part(body, outfit, seed + 10),
        shoes_part(body, outfit),
    ]
