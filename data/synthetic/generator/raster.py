"""Rasterizer in numba: depth, visible triangle of each sample, shadows of light from above, shading."""

from __future__ import annotations

import numba
import numpy as np

NEAR = 0.05
COMPILED = {"cache": True, "fastmath": True, "nogil": True}
RING = np.array([[1, 0], [0.7, 0.7], [0, 1], [-0.7, 0.7], [-1, 0], [-0.7, -0.7], [0, -1], [0.7, -0.7]], np.float32)
CREASE = 0.22  # m within which a surface keeps light from its neighbour


@numba.njit(**COMPILED)
def depths(pixels, faces, left, top, depth):
    """Draws the depths of triangles (m, 3) with vertices (n, 3: u, v, depth) into a buffer with its corner at u, v."""
    high, wide = depth.shape
    for face in range(len(faces)):
        a, b, c = faces[face]
        if pixels[a, 2] < NEAR or pixels[b, 2] < NEAR or pixels[c, 2] < NEAR:
            continue
        ax, ay, bx, by = pixels[a, 0] - left, pixels[a, 1] - top, pixels[b, 0] - left, pixels[b, 1] - top
        cx, cy = pixels[c, 0] - left, pixels[c, 1] - top
        low_x, high_x = max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)), wide - 1)
        low_y, high_y = max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)), high - 1)
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if low_x > high_x or low_y > high_y:
            continue
        nearest = min(pixels[a, 2], pixels[b, 2], pixels[c, 2])
        if abs(area) < 2.0:
            x, y = int((ax + bx + cx) / 3), int((ay + by + cy) / 3)
            if 0 <= x < wide and 0 <= y < high and nearest < depth[y, x]:
                depth[y, x] = nearest
            if abs(area) < 1e-9:
                continue
        for y in range(low_y, high_y + 1):
            for x in range(low_x, high_x + 1):
                u, v = x + 0.5, y + 0.5
                first = ((bx - u) * (cy - v) - (by - v) * (cx - u)) / area
                second = ((cx - u) * (ay - v) - (cy - v) * (ax - u)) / area
                third = 1 - first - second
                if first >= -0.01 and second >= -0.01 and third >= -0.01:
                    z = first * pixels[a, 2] + second * pixels[b, 2] + third * pixels[c, 2]
                    if z < depth[y, x]:
                        depth[y, x] = z


@numba.njit(**COMPILED)
def samples(pixels, faces, number, scale, depth, seen, weights):
    """Draws triangles into samples, scale of them a pixel and side; seen: number + face, weights: of two corners."""
    high, wide = depth.shape
    for face in range(len(faces)):
        a, b, c = faces[face]
        if pixels[a, 2] < NEAR or pixels[b, 2] < NEAR or pixels[c, 2] < NEAR:
            continue
        ax, ay, bx, by = pixels[a, 0] * scale, pixels[a, 1] * scale, pixels[b, 0] * scale, pixels[b, 1] * scale
        cx, cy = pixels[c, 0] * scale, pixels[c, 1] * scale
        low_x, high_x = max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)), wide - 1)
        low_y, high_y = max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)), high - 1)
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if low_x > high_x or low_y > high_y or abs(area) < 1e-9:
            continue
        for y in range(low_y, high_y + 1):
            for x in range(low_x, high_x + 1):
                u, v = x + 0.5, y + 0.5
                first = ((bx - u) * (cy - v) - (by - v) * (cx - u)) / area
                second = ((cx - u) * (ay - v) - (cy - v) * (ax - u)) / area
                third = 1 - first - second
                if first >= 0 and second >= 0 and third >= 0:
                    z = first * pixels[a, 2] + second * pixels[b, 2] + third * pixels[c, 2]
                    if z < depth[y, x]:
                        depth[y, x] = z
                        seen[y, x] = number + face
                        weights[y, x, 0], weights[y, x, 1] = first, second


@numba.njit(**COMPILED)
def normals(points, faces, out):
    """Adds the normals of all faces, as long as their areas, to those of their corners, and makes them unit."""
    out[:] = 0
    for face in range(len(faces)):
        a, b, c = faces[face]
        first, second = points[b] - points[a], points[c] - points[a]
        x = first[1] * second[2] - first[2] * second[1]
        y = first[2] * second[0] - first[0] * second[2]
        z = first[0] * second[1] - first[1] * second[0]
        for corner in (a, b, c):
            out[corner, 0] += x
            out[corner, 1] += y
            out[corner, 2] += z
    for i in range(len(out)):
        length = np.sqrt(out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2)
        if length > 1e-12:
            out[i] /= length


@numba.njit(**COMPILED)
def heights(points, faces, slopes, corner, cell, maps):
    """How high people reach (k, rows, columns) over the floor, seen along k slopes (dx, dy a metre of height)."""
    for k in range(len(slopes)):
        rows, columns = maps[k].shape
        for face in range(len(faces)):
            total_x, total_y, top = 0.0, 0.0, 0.0
            low_x, high_x, low_y, high_y = 1e9, -1e9, 1e9, -1e9
            for j in range(3):
                point = points[faces[face, j]]
                x = (point[0] - point[2] * slopes[k, 0] - corner[0]) / cell
                y = (point[1] - point[2] * slopes[k, 1] - corner[1]) / cell
                low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
                total_x, total_y, top = total_x + x / 3, total_y + y / 3, top + point[2] / 3
            if high_x - low_x > 40 or high_y - low_y > 40:
                continue
            for column in range(max(int(low_x + 0.25), 0), min(int(high_x + 0.25), columns - 1) + 1):
                for row in range(max(int(low_y + 0.25), 0), min(int(high_y + 0.25), rows - 1) + 1):
                    if top > maps[k, row, column]:
                        maps[k, row, column] = top


@numba.njit(**COMPILED)
def lit_share(x, y, z, slopes, corner, cell, maps, bias):
    """The share of the light from above that reaches a point."""
    open_, total = 0.0, 0.0
    for k in range(len(slopes)):
        rows, columns = maps[k].shape
        column = int((x - z * slopes[k, 0] - corner[0]) / cell)
        row = int((y - z * slopes[k, 1] - corner[1]) / cell)
        for i in range(-2, 3, 2):
            for j in range(-2, 3, 2):
                total += 1
                inside = 0 <= row + i < rows and 0 <= column + j < columns
                if not inside or maps[k, row + i, column + j] < z + bias:
                    open_ += 1
    return open_ / total


@numba.njit(**COMPILED)
def floor_shares(depth, eye, rays, slopes, corner, cell, maps):
    """The share of the light from above that reaches the surface in each pixel (h, w); rays (h, w, 3) of depth 1."""
    high, wide = depth.shape
    out = np.ones((high, wide), np.float32)
    for y in range(high):
        for x in range(wide):
            if depth[y, x] < 100:
                z = depth[y, x]
                a, b, c = eye[0] + rays[y, x, 0] * z, eye[1] + rays[y, x, 1] * z, eye[2] + rays[y, x, 2] * z
                out[y, x] = lit_share(a, b, c, slopes, corner, cell, maps, 0.03)
    return out


@numba.njit(**COMPILED)
def shaded(
    depth, seen, weights, faces, points, normal, colour, chart, cloth, pictures, gloss, eye, lamps, ambient,
    slopes, corner, cell, maps, ring, reach,
):  # fmt: skip
    """Light (h, w, 3) of the samples in which something is seen.

    cloth: number of the picture of each face or -1; pictures (k, h, w, 4: roots of colours, shares), 0 to 255; chart
    (m, 3, 2). lamps (n, 4): place and watts over pi squared. reach: samples around one in which a crease is looked
    for, a metre away.
    """
    high, wide = seen.shape
    out, paint = np.zeros((high, wide, 3), np.float32), np.zeros(3, np.float32)
    for y in range(high):
        for x in range(wide):
            face = seen[y, x]
            if face < 0:
                continue
            first, second = weights[y, x]
            third = 1 - first - second
            a, b, c = faces[face]
            px = first * points[a, 0] + second * points[b, 0] + third * points[c, 0]
            py = first * points[a, 1] + second * points[b, 1] + third * points[c, 1]
            pz = first * points[a, 2] + second * points[b, 2] + third * points[c, 2]
            nx = first * normal[a, 0] + second * normal[b, 0] + third * normal[c, 0]
            ny = first * normal[a, 1] + second * normal[b, 1] + third * normal[c, 1]
            nz = first * normal[a, 2] + second * normal[b, 2] + third * normal[c, 2]
            length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-6)
            nx, ny, nz = nx / length, ny / length, nz / length
            wx, wy, wz = eye[0] - px, eye[1] - py, eye[2] - pz
            length = max(np.sqrt(wx * wx + wy * wy + wz * wz), 1e-6)
            wx, wy, wz = wx / length, wy / length, wz / length
            if nx * wx + ny * wy + nz * wz < -0.25:
                nx, ny, nz = -nx, -ny, -nz
            for j in range(3):
                paint[j] = first * colour[a, j] + second * colour[b, j] + third * colour[c, j]
            if cloth[face] >= 0:
                k = cloth[face]
                u = first * chart[face, 0, 0] + second * chart[face, 1, 0] + third * chart[face, 2, 0]
                v = first * chart[face, 0, 1] + second * chart[face, 1, 1] + third * chart[face, 2, 1]
                row = min(max(int(v * pictures.shape[1]), 0), pictures.shape[1] - 1)
                column = min(max(int(u * pictures.shape[2]), 0), pictures.shape[2] - 1)
                share = pictures[k, row, column, 3] / 255
                for j in range(3):
                    paint[j] += ((pictures[k, row, column, j] / 255) ** 2 - paint[j]) * share
            crease, span = 0.0, reach / depth[y, x]
            for j in range(len(ring)):
                row, column = int(y + ring[j, 1] * span), int(x + ring[j, 0] * span)
                if 0 <= row < high and 0 <= column < wide:
                    step = depth[y, x] - depth[row, column]
                    if 0.008 < step < CREASE:
                        crease += 1 - step / CREASE
            keeps = 1 - 0.75 * crease / len(ring)
            reached = lit_share(px + 0.03 * nx, py + 0.03 * ny, pz + 0.03 * nz, slopes, corner, cell, maps, 0.05)
            sum_, shine = 0.0, 0.0
            for j in range(len(lamps)):
                lx, ly, lz = lamps[j, 0] - px, lamps[j, 1] - py, lamps[j, 2] - pz
                if lz <= 0:
                    continue
                square = lx * lx + ly * ly + lz * lz
                length = np.sqrt(square)
                lx, ly, lz = lx / length, ly / length, lz / length
                strength = lamps[j, 3] * lz / square
                sum_ += strength * max((nx * lx + ny * ly + nz * lz) * 0.92 + 0.08, 0.0)
                hx, hy, hz = lx + wx, ly + wy, lz + wz
                cosine = (nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
                if cosine > 0.6:
                    for _ in range(4):
                        cosine *= cosine
                    shine += strength * cosine
            direct = sum_ * (0.12 + 0.88 * reached)
            sky = keeps * (0.72 + 0.28 * nz)
            for j in range(3):
                out[y, x, j] = paint[j] * (direct * (0.5 + 0.5 * keeps) + ambient[j] * sky)
                out[y, x, j] += gloss[a] * shine * reached * 3.0
    return out
