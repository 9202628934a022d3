"""What a person looks like and wears, as plain data; colours are linear RGB, lengths metres."""

from __future__ import annotations

from dataclasses import dataclass

Colour = tuple[float, float, float]
Motif = tuple[str, Colour, float]
Line = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Look:
    """Skin, face and hair.

    style: a key of hair.STYLES. stubble, brows, lines: 0..1, how strong beard shadow, brows and wrinkles are. beard:
    length of a beard. glasses: colour of the frame.
    """

    skin: Colour
    hair: Colour
    iris: Colour
    lips: Colour
    style: str = "short"
    stubble: float = 0.0
    beard: float = 0.0
    brows: float = 0.85
    lines: float = 0.0
    glasses: Colour | None = None


@dataclass(frozen=True)
class Top:
    """A shirt, pullover, jacket or the upper part of a dress or coat.

    loose: gap to the body. over: more gap, for what is worn over something. hem: height of the hem above the hip
    joints. neck: how much the neckline sits above the usual one. sleeve: where sleeves end, before the wrist; None
    for no sleeves. opening: (depth below the neck, half width of the gap in front). lapel: its width. collar: rib,
    shirt, stand, hood or nothing. motifs: what the fabric shows (see fabric.py). panel, stripes: an undershirt that is
    only painted on, thin painted stripes. stiff: 0 hangs in folds, 1 has hardly any. quilt: height of padded rolls.
    under: the gap of what is worn over it, through which it shows. hang: 1 falls straight over the hips, 0 follows
    them.
    """

    colour: Colour
    loose: float
    hem: float
    neck: float = 0.0
    over: float = 0.0
    sleeve: float | None = 0.012
    collar: str = "rib"
    opening: Line | None = None
    lapel: float = 0.0
    motifs: tuple[Motif, ...] = ()
    panel: Colour | None = None
    stripes: Colour | None = None
    stiff: float = 0.0
    quilt: float = 0.0
    under: Line | None = None
    hang: float = 0.85


@dataclass(frozen=True)
class Trousers:
    """wide: gap to the leg; None follows from the top. end: height of the hem above the ankle joint."""

    colour: Colour
    wide: float | None = None
    end: float = -0.05
    motifs: tuple[Motif, ...] = ()


@dataclass(frozen=True)
class Skirt:
    """waist: height above the hip joints; hem: height above the knee joints; flare: more width at the hem."""

    colour: Colour
    waist: float
    hem: float
    loose: float = 0.012
    flare: float = 0.03
    pleats: float = 0.012
    opening: Line | None = None
    motifs: tuple[Motif, ...] = ()


@dataclass(frozen=True)
class Outfit:
    """Everything on one person, tops from the inside out; extras: keys of worn.EXTRAS with a colour each."""

    look: Look
    tops: tuple[Top, ...]
    shoes: Colour
    trousers: Trousers | None = None
    skirt: Skirt | None = None
    stockings: Colour | None = None
    sole: Colour | None = None
    extras: tuple[tuple[str, Colour], ...] = ()
