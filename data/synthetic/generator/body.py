"""A person's rest body and the dressed parts that move with its bones."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from gait import SIDES, Skeleton
from mesh import Mesh, triangles
from outfit import Colour

SOLE = 0.022


@dataclass
class Part:
    """A dressed piece: mesh, colour of every vertex, kind of material.

    picture (h, w, 4): fabric to lay over the colours, at chart (faces * 3, 2), shares of its width and height.
    """

    name: str
    mesh: Mesh
    colour: np.ndarray
    material: str
    picture: np.ndarray | None = None
    chart: np.ndarray | None = None
    rest: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        """Remembers the rest points for the material."""
        self.rest = self.mesh.points.copy()

    def rig(self, carriers: np.ndarray) -> None:
        """Prepares posing: bones that never turn by themselves hand their weight to their carriers."""
        used = np.unique(carriers[self.mesh.skin.any(0)])
        weights = np.zeros((len(self.mesh.points), len(used)), np.float32)
        for bone in np.flatnonzero(self.mesh.skin.any(0)):
            weights[:, np.searchsorted(used, carriers[bone])] += self.mesh.skin[:, bone]
        self.bones, self.weights = used, weights
        self.wide = np.concatenate([self.mesh.points, np.ones((len(self.mesh.points), 1))], 1).astype(np.float32)

    def posed(self, transforms: np.ndarray) -> np.ndarray:
        """Vertices (n, 3), single precision, under bone transforms (bones, 3, 4); after rig."""
        moves = transforms[self.bones].astype(np.float32).reshape(len(self.bones), 12)
        return np.einsum("nij,nj->ni", (self.weights @ moves).reshape(-1, 3, 4), self.wide)


class Body:
    """A person's rest shape on thick soles, its skeleton and the shells to cut clothes from."""

    def __init__(self, arrays: dict[str, np.ndarray], name: str) -> None:
        """arrays: what anatomy.py wrote."""
        lift = np.array([0, 0, SOLE])
        self.labels = [str(label) for label in arrays["labels"]]
        self.skeleton = Skeleton(self.labels, arrays["parents"], arrays[f"{name}/heads"] + lift)
        points = arrays[f"{name}/points"] + lift
        skin = np.zeros((len(points), len(self.labels)), np.float32)
        np.put_along_axis(skin, arrays["bones"], arrays["weights"].astype(np.float32), 1)
        self.groups = {
            key.split("/")[1]: Mesh(points, np.empty((0, 3), int), skin).kept(triangles(quads))
            for key, quads in arrays.items()
            if key.startswith("faces/")
        }

    def head(self, label: str) -> np.ndarray:
        """A joint at rest."""
        return self.skeleton.head(label)

    def eye(self) -> np.ndarray:
        """The point between the eyes."""
        return (self.head("eye.L") + self.head("eye.R")) / 2

    def rides(self, mesh: Mesh, words: tuple[str, ...]) -> np.ndarray:
        """How much each vertex follows bones with such names, 0..1."""
        chosen = [any(label.startswith(word) for word in words) for label in self.labels]
        return mesh.skin[:, chosen].sum(1)

    def arm(self, mesh: Mesh) -> np.ndarray:
        """How much each vertex follows the arms, 0..1."""
        return self.rides(mesh, ("upperarm", "lowerarm", "wrist"))

    def along(self, points: np.ndarray, start: str, end: str) -> np.ndarray:
        """Metres before the end joint on the line from the start joint, whichever side is nearer."""
        side = np.where(points[:, 0] >= 0, 0, 1)
        options = []
        for suffix in SIDES:
            axis = self.head(f"{end}.{suffix}") - self.head(f"{start}.{suffix}")
            options.append((self.head(f"{end}.{suffix}") - points) @ (axis / np.linalg.norm(axis)))
        return np.stack(options)[side, np.arange(len(points))]

    def bound(self, count: int, bone: str) -> np.ndarray:
        """Skin weights of things that ride on one bone."""
        skin = np.zeros((count, len(self.labels)), np.float32)
        skin[:, self.labels.index(bone)] = 1
        return skin


def bell(away: np.ndarray, width: float) -> np.ndarray:
    """1 where away is 0, falling like a Gaussian."""
    return np.exp(-0.5 * (away / width) ** 2)


def spot(points: np.ndarray, centre: np.ndarray, size: tuple[float, float, float]) -> np.ndarray:
    """A soft blob: 1 in the centre, 0 outside."""
    return np.exp(-0.5 * (((points - centre) / size) ** 2).sum(1))


def mixed(base: np.ndarray, paint: Colour | np.ndarray, share: np.ndarray) -> np.ndarray:
    """Paint over a colour with a share per vertex."""
    return base + (np.asarray(paint) - base) * np.clip(share, 0, 1)[:, None]
