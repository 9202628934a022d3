"""Appearance of simulated people: height, build, skin, hair and clothes, drawn at random."""

from __future__ import annotations

import colorsys
import random
from dataclasses import dataclass
from typing import Literal

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Looks:
    """Appearance of a person.

    Attributes:
        height_m: Height.
        build: Width in relation to the usual one.
        shape: Proportions of shoulders and hips.
    """

    height_m: float = 1.73
    build: float = 1.0
    shape: Literal["narrow", "wide"] = "wide"
    skin: Colour = (0.80, 0.60, 0.48)
    hair: Colour = (0.16, 0.10, 0.07)
    hair_style: Literal["short", "long", "bun", "bald"] = "short"
    top: Colour = (0.25, 0.35, 0.55)
    sleeves: Literal["long", "short"] = "long"
    jacket: Colour | None = None
    legs: Colour = (0.15, 0.17, 0.25)
    lower: Literal["trousers", "skirt", "shorts"] = "trousers"
    shoes: Colour = (0.08, 0.07, 0.06)
    bag: Colour | None = None
    beard: bool = False


_SKINS = (
    (0.93, 0.74, 0.63), (0.87, 0.67, 0.54), (0.78, 0.58, 0.45),
    (0.62, 0.44, 0.33), (0.45, 0.30, 0.22), (0.33, 0.22, 0.16),
)  # fmt: skip
_HAIRS = ((0.10, 0.08, 0.07), (0.20, 0.13, 0.08), (0.36, 0.22, 0.12), (0.62, 0.47, 0.26), (0.55, 0.54, 0.52))
_TROUSERS = ((0.13, 0.16, 0.26), (0.08, 0.08, 0.09), (0.30, 0.28, 0.25), (0.42, 0.36, 0.27), (0.20, 0.25, 0.35))
_SHOES = ((0.07, 0.06, 0.06), (0.28, 0.17, 0.10), (0.75, 0.74, 0.72))


def random_looks(rng: random.Random) -> Looks:
    """Draw the appearance of a person."""
    shape: Literal["narrow", "wide"] = rng.choice(("narrow", "wide"))
    skin = rng.choice(_SKINS)
    light = sum(skin) > 1.5
    style = rng.choice(("short", "short", "short", "bald") if shape == "wide" else ("long", "bun", "short"))
    jacket = _cloth(rng, 0.12, 0.5) if rng.random() < 0.4 else None
    lower = rng.choice(("trousers",) * 5 + (("skirt",) * 2 if shape == "narrow" else ("shorts",)))
    return Looks(
        height_m=round(rng.gauss(1.77 if shape == "wide" else 1.66, 0.06), 3),
        build=round(min(max(rng.gauss(1.0, 0.09), 0.86), 1.25), 3),
        shape=shape,
        skin=skin,
        hair=rng.choice(_HAIRS if light else _HAIRS[:2]),
        hair_style=style,  # type: ignore[arg-type]
        top=_cloth(rng, 0.25, 0.95),
        sleeves="long" if jacket or rng.random() < 0.6 else "short",
        jacket=jacket,
        legs=rng.choice(_TROUSERS),
        lower=lower,  # type: ignore[arg-type]
        shoes=rng.choice(_SHOES),
        bag=_cloth(rng, 0.15, 0.5) if rng.random() < 0.25 else None,
        beard=shape == "wide" and rng.random() < 0.3,
    )


def _cloth(rng: random.Random, dark: float, bright: float) -> Colour:
    return colorsys.hsv_to_rgb(rng.random(), rng.choice((0.08, 0.35, 0.6, 0.75)), rng.uniform(dark, bright))
