"""Triangle meshes whose vertices carry everything linear: rest position, skin weights and other fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


def triangles(quads: np.ndarray) -> np.ndarray:
    """Splits quads in two."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


@dataclass
class Mesh:
    """Rest points (n, 3), faces (m, 3) and skin weights (n, bones)."""

    points: np.ndarray
    faces: np.ndarray
    skin: np.ndarray

    def kept(self, faces: np.ndarray) -> Mesh:
        """The mesh of some of its faces, without unused vertices."""
        used, inverse = np.unique(faces, return_inverse=True)
        return Mesh(self.points[used], inverse.reshape(-1, 3), self.skin[used])

    def blended(self, pairs: np.ndarray, share: np.ndarray) -> Mesh:
        """Vertices on edges: the first end's weight is 1 - share; no faces."""
        a, b = pairs.T
        mix = [field[a] + (field[b] - field[a]) * share[:, None] for field in (self.points, self.skin)]
        return Mesh(mix[0], np.empty((0, 3), int), mix[1])

    def joined(self, other: Mesh, faces: np.ndarray) -> Mesh:
        """Both vertex lists under new faces."""
        return Mesh(np.concatenate([self.points, other.points]), faces, np.concatenate([self.skin, other.skin]))

    def edges(self) -> np.ndarray:
        """Every edge once, lower index first."""
        corners = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        return np.unique(np.sort(corners, axis=1), axis=0)

    def clipped(self, field: np.ndarray) -> Mesh:
        """The part where field >= 0, cut smoothly through the triangles."""
        edges = self.edges()
        crossing = edges[(field[edges[:, 0]] < 0) != (field[edges[:, 1]] < 0)]
        start, end = field[crossing].T
        count = len(self.points)
        index = {tuple(edge): count + i for i, edge in enumerate(crossing.tolist())}
        whole = self.faces[(field[self.faces] >= 0).all(1)].tolist()
        cut = self.faces[(field[self.faces] >= 0).any(1) & (field[self.faces] < 0).any(1)].tolist()
        for face in cut:
            outline = []
            for a, b in zip(face, face[1:] + face[:1], strict=True):
                if field[a] >= 0:
                    outline.append(a)
                if (field[a] < 0) != (field[b] < 0):
                    outline.append(index[min(a, b), max(a, b)])
            whole += [[outline[0], outline[i], outline[i + 1]] for i in range(1, len(outline) - 1)]
        faces = np.array(whole, int).reshape(-1, 3)
        return self.joined(self.blended(crossing, start / (start - end)), faces).kept(faces)

    def subdivided(self) -> Mesh:
        """Every triangle in four."""
        edges = self.edges()
        keys = edges[:, 0] * len(self.points) + edges[:, 1]

        def middle(a: int, b: int) -> np.ndarray:
            pair = np.sort(self.faces[:, [a, b]], axis=1)
            return len(self.points) + np.searchsorted(keys, pair[:, 0] * len(self.points) + pair[:, 1])

        a, b, c = self.faces.T
        ab, bc, ca = middle(0, 1), middle(1, 2), middle(2, 0)
        faces = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        return self.joined(self.blended(edges, np.full(len(edges), 0.5)), faces)

    def normals(self) -> np.ndarray:
        """Unit vertex normals, weighted by area."""
        return normals(self.points, self.faces)

    def border(self) -> np.ndarray:
        """Which vertices lie on an open edge."""
        corners = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, uses = np.unique(corners, axis=0, return_counts=True)
        flags = np.zeros(len(self.points), bool)
        flags[edges[uses == 1]] = True
        return flags

    def smoothed(self, field: np.ndarray, rounds: int, pinned: np.ndarray | None = None) -> np.ndarray:
        """A field after some rounds of averaging with the neighbours; pinned vertices keep theirs."""
        a, b = self.edges().T
        degree = np.maximum(np.bincount(np.concatenate([a, b]), minlength=len(self.points)), 1)[:, None]
        shape, field = field.shape, field.reshape(len(field), -1).astype(float)
        for _ in range(rounds):
            ends, others = np.concatenate([a, b]), np.concatenate([b, a])
            total = np.stack([np.bincount(ends, column[others], len(field)) for column in field.T], 1)
            mean = (field + total / degree) / 2
            field = mean if pinned is None else np.where(pinned[:, None], field, mean)
        return field.reshape(shape)


def normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit vertex normals, weighted by area."""
    a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    flat = np.cross(b - a, c - a)
    total = np.stack([np.bincount(faces.ravel(), np.repeat(flat[:, k], 3), len(points)) for k in range(3)], 1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def waves(points: np.ndarray, length: float, stretch: tuple[float, float, float], seed: int) -> np.ndarray:
    """Smooth noise of about unit size: random cosines of one wavelength, stretched along the axes."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(24, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction *= 2 * np.pi / length * rng.uniform(0.6, 1.5, (24, 1)) / np.array(stretch)
    return np.cos(points @ direction.T + rng.uniform(0, 2 * np.pi, 24)).mean(1) * 4.0


def folds(points: np.ndarray, length: float, stretch: tuple[float, float, float], seed: int) -> np.ndarray:
    """Narrow round ridges between flat stretches, the way cloth folds: about -0.3 to 0.7."""
    return np.exp(-((1.7 * waves(points, length, stretch, seed)) ** 2)) - 0.3
