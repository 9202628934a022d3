"""What each person wears."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from body import Body, Part
from clothes import shoes_part, skirt_part, top_part, trousers_part
from collar import collar_part
from face import eye_part, lash_part, skin_part
from hair import hair_part, knot_part
from outfit import Line, Look, Outfit, Skirt, Top, Trousers
from posture import Build
from worn import EXTRAS, glasses, surface, trunk_extent

JACKET: Line = ((-0.1, 0.06), (0.0, 0.055), (0.06, 0.055), (0.3, 0.0), (0.31, -0.03))
BLAZER: Line = ((-0.1, 0.055), (0.0, 0.05), (0.06, 0.05), (0.26, 0.0), (0.27, -0.03))
OPEN: Line = ((-0.1, 0.045), (0.0, 0.045), (0.2, 0.055), (0.9, 0.085))
DENIM, LIGHT_DENIM = (0.035, 0.06, 0.125), (0.13, 0.2, 0.31)
WHITE, BLACK = (0.62, 0.62, 0.6), (0.014, 0.014, 0.016)

OUTFITS = {
    "A": Outfit(
        Look((0.52, 0.30, 0.21), (0.035, 0.02, 0.012), (0.05, 0.09, 0.12), (0.36, 0.13, 0.1), stubble=0.35),
        (Top((0.035, 0.075, 0.16), 0.024, -0.02, hang=0),),
        (0.03, 0.03, 0.032), Trousers((0.085, 0.09, 0.1)),
    ),
    "B": Outfit(
        Look((0.6, 0.37, 0.27), (0.11, 0.05, 0.022), (0.09, 0.05, 0.02), (0.45, 0.12, 0.12), "long"),
        (Top((0.33, 0.07, 0.075), 0.018, -0.12, -0.035, panel=(0.6, 0.58, 0.55), hang=0),),
        (0.07, 0.05, 0.045), Trousers((0.02, 0.021, 0.026)),
    ),
    "C": Outfit(
        Look((0.42, 0.22, 0.14), (0.22, 0.21, 0.2), (0.05, 0.03, 0.02), (0.28, 0.11, 0.09), stubble=0.15),
        (Top((0.42, 0.47, 0.52), 0.024, -0.03, -0.01, stripes=(0.16, 0.24, 0.38), hang=0),),
        (0.06, 0.035, 0.02), Trousers((0.24, 0.19, 0.125)),
    ),
    "D": Outfit(
        Look((0.62, 0.41, 0.32), (0.2, 0.115, 0.05), (0.06, 0.11, 0.13), (0.46, 0.16, 0.15), "tail", brows=0.6),
        (Top(WHITE, 0.018, -0.04, -0.03, sleeve=0.36, collar="crew", motifs=(("logo", (0.05, 0.12, 0.3), 0.075),)),),
        (0.55, 0.55, 0.53), Trousers(DENIM, 0.007, motifs=(("seams", (0.2, 0.13, 0.05), 0),)),
        sole=(0.6, 0.6, 0.6), extras=(("badge", (0.03, 0.1, 0.4)),),
    ),
    "E": Outfit(
        Look((0.5, 0.3, 0.22), (0.06, 0.035, 0.02), (0.06, 0.08, 0.1), (0.36, 0.13, 0.11), "receding", 0.3, 0.016,
             lines=0.5),
        (Top((0.36, 0.05, 0.035), 0.026, -0.07, -0.03, collar="shirt", stiff=0.2,
             motifs=(("checks", (0.02, 0.025, 0.05), 0.085), ("buttons", (0.6, 0.55, 0.45), 0.095))),),
        (0.05, 0.03, 0.018), Trousers((0.035, 0.036, 0.034), 0.02), sole=(0.02, 0.02, 0.02),
    ),
    "F": Outfit(
        Look((0.33, 0.17, 0.1), (0.27, 0.26, 0.25), (0.03, 0.02, 0.012), (0.26, 0.09, 0.08), "bun", lines=0.8,
             glasses=(0.02, 0.015, 0.012)),
        (Top((0.44, 0.32, 0.19), 0.03, 0.03, -0.015, collar="jacket", stiff=0.55,
             motifs=(("buttons", (0.06, 0.035, 0.02), 0.12),)),),
        (0.03, 0.02, 0.015), Trousers((0.03, 0.028, 0.035), 0.014),
        Skirt((0.44, 0.32, 0.19), 0.06, -0.02, 0.012, 0.035, 0.007, motifs=(("buttons", (0.06, 0.035, 0.02), 0.12),)),
        extras=(("belt", (0.2, 0.13, 0.07)), ("shoulder bag", (0.11, 0.03, 0.02))),
    ),
    "G": Outfit(
        Look((0.072, 0.036, 0.021), (0.008, 0.007, 0.006), (0.012, 0.008, 0.006), (0.13, 0.05, 0.042), "afro",
             brows=0.9),
        (Top((0.27, 0.27, 0.28), 0.034, -0.05, -0.035, collar="hood", stiff=0.1,
             motifs=(("cords", (0.6, 0.6, 0.58), 0.1),)),),
        (0.4, 0.03, 0.025), Trousers((0.028, 0.032, 0.028), 0.032), sole=(0.6, 0.6, 0.6),
        extras=(("backpack", (0.02, 0.045, 0.1)),),
    ),
    "H": Outfit(
        Look((0.47, 0.27, 0.18), (0.02, 0.013, 0.01), (0.04, 0.025, 0.015), (0.38, 0.12, 0.11), "none", brows=0.95),
        (Top((0.3, 0.2, 0.36), 0.022, -0.04, 0.0, collar="none", stiff=0.1,
             motifs=(("flowers", (0.55, 0.5, 0.56), 0.06),)),),
        (0.06, 0.03, 0.03), Trousers((0.06, 0.05, 0.075), 0.034),
        Skirt((0.3, 0.2, 0.36), 0.05, 0.14, 0.016, 0.03, 0.01, motifs=(("flowers", (0.55, 0.5, 0.56), 0.06),)),
        extras=(("headscarf", (0.035, 0.15, 0.165)),),
    ),
    "I": Outfit(
        Look((0.6, 0.37, 0.28), (0.25, 0.075, 0.022), (0.07, 0.13, 0.1), (0.42, 0.16, 0.13), "side", 0.4, lines=0.2),
        (Top((0.03, 0.042, 0.085), 0.016, -0.05, -0.03, sleeve=0.35, collar="crew", stiff=0.3),
         Top((0.5, 0.72, 0.03), 0.018, -0.03, -0.05, over=0.012, sleeve=None, collar="none", stiff=0.45,
             motifs=(("reflectors", (0.6, 0.61, 0.63), 0.05), ("zip", (0.1, 0.12, 0.02), 0)))),
        (0.12, 0.065, 0.028), Trousers((0.1, 0.095, 0.085), 0.022, motifs=(("pockets", (0.03, 0.03, 0.025), 0.15),)),
        sole=(0.015, 0.015, 0.015),
    ),
    "J": Outfit(
        Look((0.57, 0.36, 0.28), (0.5, 0.5, 0.49), (0.07, 0.1, 0.13), (0.38, 0.18, 0.16), "rim", 0.2, lines=1.0,
             glasses=(0.2, 0.15, 0.06)),
        (Top(WHITE, 0.012, -0.02, -0.022, collar="shirt", stiff=0.6, under=JACKET,
             motifs=(("buttons", (0.5, 0.5, 0.48), 0.09), ("tie", (0.03, 0.075, 0.045), 0.032))),
         Top((0.16, 0.095, 0.05), 0.026, -0.11, -0.035, over=0.012, collar="jacket", opening=JACKET, lapel=0.06,
             stiff=0.6, motifs=(("tweed", (0.3, 0.21, 0.13), 0.02), ("pockets", (0.06, 0.035, 0.02), 0.15)))),
        (0.025, 0.014, 0.01), Trousers((0.13, 0.13, 0.14), 0.018),
    ),
    "K": Outfit(
        Look((0.16, 0.078, 0.045), (0.016, 0.01, 0.008), (0.018, 0.011, 0.008), (0.24, 0.06, 0.06), "curls"),
        (Top((0.52, 0.25, 0.03), 0.01, 0.03, -0.005, sleeve=0.4, collar="crew", stiff=0.3, hang=0.2,
             motifs=(("flowers", (0.06, 0.09, 0.2), 0.045),)),),
        (0.5, 0.4, 0.3), None,
        Skirt((0.52, 0.25, 0.03), 0.06, 0.04, 0.01, 0.06, 0.016, motifs=(("flowers", (0.06, 0.09, 0.2), 0.045),)),
        extras=(("belt", (0.035, 0.016, 0.01)),),
    ),
    "L": Outfit(
        Look((0.55, 0.36, 0.25), (0.012, 0.011, 0.012), (0.025, 0.016, 0.01), (0.38, 0.16, 0.13), "brush", 0.1,
             glasses=(0.012, 0.012, 0.014)),
        (Top((0.075, 0.088, 0.045), 0.045, -0.15, -0.025, collar="hood", stiff=0.8, quilt=0.012,
             motifs=(("zip", (0.25, 0.25, 0.25), 0),)),),
        (0.25, 0.25, 0.26), Trousers(LIGHT_DENIM, 0.013, motifs=(("seams", (0.3, 0.22, 0.1), 0),)), sole=WHITE,
    ),
    "M": Outfit(
        Look((0.6, 0.39, 0.3), (0.42, 0.34, 0.22), (0.07, 0.12, 0.16), (0.42, 0.1, 0.1), "bob", lines=0.5, brows=0.6),
        (Top((0.6, 0.56, 0.48), 0.01, -0.02, -0.03, collar="crew", stiff=0.3, under=BLAZER),
         Top((0.17, 0.018, 0.045), 0.018, -0.07, -0.04, over=0.01, collar="jacket", opening=BLAZER, lapel=0.055,
             stiff=0.65, motifs=(("pockets", (0.06, 0.008, 0.018), 0.13),))),
        BLACK, None, Skirt((0.03, 0.03, 0.036), 0.08, -0.02, 0.005, 0.0, 0.003), (0.055, 0.04, 0.036),
    ),
    "N": Outfit(
        Look((0.26, 0.135, 0.08), (0.014, 0.01, 0.008), (0.025, 0.016, 0.01), (0.27, 0.1, 0.085), "crop", 0.35),
        (Top((0.58, 0.55, 0.47), 0.024, -0.06, -0.035, sleeve=0.36, collar="polo",
             motifs=(("stripes", (0.025, 0.13, 0.075), 0.1), ("buttons", (0.5, 0.5, 0.45), 0.3))),),
        (0.3, 0.31, 0.33), Trousers((0.36, 0.29, 0.18), 0.03, 0.47), sole=(0.6, 0.3, 0.05),
        extras=(("cap", (0.02, 0.02, 0.024)), ("backpack", (0.42, 0.13, 0.02))),
    ),
    "O": Outfit(
        Look((0.56, 0.37, 0.25), (0.01, 0.009, 0.01), (0.022, 0.014, 0.01), (0.44, 0.15, 0.14), "straight"),
        (Top((0.6, 0.6, 0.6), 0.012, -0.03, -0.035, collar="crew", stiff=0.3, under=OPEN,
             motifs=(("pinstripes", (0.05, 0.07, 0.2), 0.02),)),
         Top((0.1, 0.24, 0.23), 0.022, -0.1, -0.05, over=0.01, collar="none", opening=OPEN, stiff=0.2,
             motifs=(("yoke", (0.36, 0.38, 0.36), 0), ("knit", (0.03, 0.09, 0.09), 0.06)))),
        (0.5, 0.48, 0.45), Trousers((0.2, 0.11, 0.07), 0.05, 0.06),
        extras=(("badge", (0.02, 0.25, 0.08)),),
    ),
    "P": Outfit(
        Look((0.54, 0.35, 0.24), (0.014, 0.012, 0.012), (0.025, 0.016, 0.01), (0.38, 0.15, 0.12), "side", 0.15),
        (Top((0.02, 0.13, 0.12), 0.022, -0.04, -0.015, collar="rib", stiff=0.2,
             motifs=(("stripes", (0.3, 0.32, 0.3), 0.09),)),),
        (0.3, 0.22, 0.13), Trousers((0.17, 0.16, 0.15), 0.016), sole=WHITE,
    ),
    "Q": Outfit(
        Look((0.2, 0.1, 0.06), (0.016, 0.01, 0.008), (0.02, 0.012, 0.009), (0.28, 0.07, 0.07), "bun", brows=0.8),
        (Top((0.6, 0.45, 0.08), 0.022, -0.05, -0.02, collar="crew", stiff=0.2,
             motifs=(("knit", (0.42, 0.3, 0.04), 0.06),)),),
        (0.02, 0.02, 0.022), Trousers((0.2, 0.045, 0.05), 0.02), extras=(("shoulder bag", (0.02, 0.03, 0.06)),),
    ),
    "R": Outfit(
        Look((0.62, 0.42, 0.33), (0.3, 0.19, 0.08), (0.06, 0.11, 0.15), (0.46, 0.18, 0.16), "bob", brows=0.4),
        (Top((0.5, 0.08, 0.2), 0.018, -0.03, -0.02, collar="crew", stiff=0.3,
             motifs=(("logo", (0.6, 0.55, 0.1), 0.05),)),),
        (0.5, 0.5, 0.52), Trousers((0.1, 0.16, 0.3), 0.012), sole=WHITE,
    ),
    "S": Outfit(
        Look((0.55, 0.33, 0.25), (0.1, 0.06, 0.03), (0.06, 0.1, 0.14), (0.4, 0.15, 0.13), "short", 0.5, lines=0.3),
        (Top((0.42, 0.5, 0.58), 0.022, -0.06, -0.02, collar="shirt", stiff=0.3,
             motifs=(("buttons", (0.6, 0.6, 0.58), 0.09), ("pockets", (0.3, 0.36, 0.44), 0.12))),),
        (0.04, 0.022, 0.014), Trousers((0.025, 0.03, 0.055), 0.018), extras=(("belt", (0.05, 0.025, 0.015)),),
    ),
    "T": Outfit(
        Look((0.58, 0.38, 0.29), (0.05, 0.025, 0.014), (0.05, 0.06, 0.04), (0.44, 0.13, 0.13), "tail", brows=0.7,
             glasses=(0.1, 0.02, 0.02)),
        (Top((0.05, 0.05, 0.055), 0.026, -0.1, -0.02, collar="stand", stiff=0.5, quilt=0.009,
             motifs=(("zip", (0.4, 0.4, 0.42), 0),)),),
        (0.45, 0.43, 0.4), Trousers((0.38, 0.36, 0.32), 0.014), sole=WHITE,
    ),
    "U": Outfit(
        Look((0.22, 0.115, 0.07), (0.012, 0.009, 0.008), (0.02, 0.013, 0.009), (0.28, 0.1, 0.09), "crop", brows=0.6),
        (Top((0.08, 0.3, 0.5), 0.022, -0.03, -0.02, sleeve=0.22, collar="polo", stiff=0.3,
             motifs=(("stripes", (0.6, 0.6, 0.55), 0.06),)),),
        (0.45, 0.06, 0.04), Trousers((0.22, 0.18, 0.1), 0.016), sole=WHITE,
    ),
}  # fmt: skip


def dressed(body: Body, outfit: Outfit, seed: int) -> list[Part]:
    """All parts of a person but the hair strands."""
    look = outfit.look
    parts = [skin_part(body, outfit), eye_part(body, look, "L"), eye_part(body, look, "R")]
    parts += [lash_part(body, side) for side in "LR"]
    if look.style != "none":
        parts += [part for part in (hair_part(body, look), knot_part(body, look)) if part]
    below = (outfit.trousers or outfit.skirt or outfit.tops[0]).colour
    for number, top in enumerate(outfit.tops):
        made = top_part(body, top, below, seed + 20 * number)
        parts += [part for part in (made, collar_part(body, made, top)) if part]
    if outfit.trousers:
        parts.append(trousers_part(body, outfit.trousers, outfit.tops[0], seed + 10))
    if outfit.skirt:
        parts.append(skirt_part(body, outfit.skirt, seed + 30))
    parts.append(shoes_part(body, outfit.shoes, outfit.sole))
    parts += glasses(body, look)
    for name, paint in outfit.extras:
        parts += EXTRAS[name](body, parts, paint)
    return parts


def build_of(body: Body, parts: list[Part]) -> Build:
    """Where postures of the arms find the dressed trunk."""
    cloth, shoulder = surface(parts), body.head("upperarm01.L")
    hip = float(body.head("upperleg01.L")[2])
    level = (abs(cloth.points[:, 2] - hip - 0.06) < 0.05) & (body.arm(cloth) < 0.2)
    joints = [body.head(f"{name}.L") for name in ("upperarm01", "lowerarm01", "wrist")]
    reach = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(joints))
    chest = trunk_extent(body, cloth, shoulder[2] - 0.2, 0.14)[0]
    belly = trunk_extent(body, cloth, hip + 0.2, 0.14)[0]
    return Build(shoulder, body.eye(), hip, reach, chest, belly, float(cloth.points[level, 0].max()))
