"""Exact distances of points to a triangle surface, in f64: all points walk one tree of boxes."""

import numpy as np
from scipy.spatial import cKDTree

from surface import Surface

# Pairs of point and box that are held at once, at most about.
PAIRS_AT_ONCE = 2_000_000
# Triangles nearest by their middles whose distance bounds the search.
FIRST_TRIES = 6
# Distances below this share of the surface's extent are not lowered further.
NEAR_ENOUGH = 1e-7


def squared(v: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", v, v)


def dot(v: np.ndarray, w: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", v, w)


def to_segments(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distance of each point to its segment."""
    along, from_a = b - a, p - a
    length = squared(along)
    share = np.clip(dot(from_a, along) / np.where(length > 0, length, 1), 0, 1)
    return squared(from_a - along * share[:, None])


def to_triangles(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Squared distance of each point to its triangle: to the plane where the foot lies inside."""
    rim = np.minimum(np.minimum(to_segments(p, a, b), to_segments(p, b, c)), to_segments(p, c, a))
    ab, bc, ca = b - a, c - b, a - c
    normal = np.cross(ab, -ca)
    size = squared(normal)
    inside = dot(np.cross(ab, p - a), normal) >= 0
    inside &= dot(np.cross(bc, p - b), normal) >= 0
    inside &= dot(np.cross(ca, p - c), normal) >= 0
    # Flatter triangles: the interior lies as near as the rim, to more digits than the normal has.
    longest = np.maximum(np.maximum(squared(ab), squared(bc)), squared(ca))
    inside &= size > 1e-20 * longest**2
    height = dot(p - a, normal) ** 2 / np.where(inside, size, 1)
    return np.where(inside, np.minimum(rim, height), rim)


def interleaved(cells: np.ndarray) -> np.ndarray:
    """Morton codes of 20 bits a coordinate."""
    code = np.zeros(len(cells), np.uint64)
    for axis in range(3):
        x = cells[:, axis].astype(np.uint64)
        for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):
            x = (x | (x << np.uint64(shift))) & np.uint64(mask)
        code |= x << np.uint64(axis)
    return code


class Tree:
    """A binary tree of boxes over the triangles, large triangles apart from small ones."""

    def __init__(self, surface: Surface):
        corners = surface.corners()
        middle = corners.mean(1)
        radius = np.sqrt(((corners - middle[:, None]) ** 2).sum(2)).max(1)
        low, span = middle.min(0), max(float(np.ptp(middle, axis=0).max()), 1e-300)
        cells = np.minimum((middle - low) / span * 2**20, 2**20 - 1)
        usual = max(float(np.median(radius)), 1e-300)
        size = np.clip(np.log2(np.maximum(radius, usual) / usual) // 1.5, 0, 7).astype(np.uint64)
        order = np.argsort(interleaved(cells) | (size << np.uint64(60)), kind="stable")
        self.near_enough = (NEAR_ENOUGH * span) ** 2
        self.corners = [np.ascontiguousarray(corners[order, i]) for i in range(3)]
        self.middles = cKDTree(middle[order], balanced_tree=False, compact_nodes=False)
        self.depth = max(len(order) - 1, 0).bit_length()
        width = 1 << self.depth
        low = np.full((width, 3), np.inf)
        high = np.full((width, 3), -np.inf)
        low[: len(order)] = corners[order].min(1)
        high[: len(order)] = corners[order].max(1)
        self.levels = [(low, high)]
        while len(low) > 1:
            low, high = low.reshape(-1, 2, 3).min(1), high.reshape(-1, 2, 3).max(1)
            self.levels.append((low, high))
        self.levels.reverse()

    def distances(self, points: np.ndarray) -> np.ndarray:
        tries = min(FIRST_TRIES, len(self.corners[0]))
        _, near = self.middles.query(points, k=tries)
        near = near.reshape(len(points), tries)
        best = np.full(len(points), np.inf)
        for column in near.T:
            best = np.minimum(best, to_triangles(points, *(it[column] for it in self.corners)))
        for start in range(0, len(points), PAIRS_AT_ONCE // 64):
            part = slice(start, start + PAIRS_AT_ONCE // 64)
            best[part] = self.walk(points[part], best[part])
        return np.sqrt(best)

    def walk(self, points: np.ndarray, best: np.ndarray) -> np.ndarray:
        """Lowers squared distances to the least. Boxes that are no nearer are left out."""
        best = best.copy()
        far = np.flatnonzero(best > self.near_enough)
        stack = [(0, far, np.zeros(len(far), np.int64))]
        while stack:
            level, who, box = stack.pop()
            if len(who) > PAIRS_AT_ONCE:
                half = len(who) // 2
                stack += [(level, who[:half], box[:half]), (level, who[half:], box[half:])]
                continue
            if level == self.depth:
                found = to_triangles(points[who], *(it[box] for it in self.corners))
                np.minimum.at(best, who, found)
                continue
            low, high = self.levels[level + 1]
            who, box = np.repeat(who, 2), (box[:, None] * 2 + (0, 1)).reshape(-1)
            p = points[who]
            outside = np.maximum(np.maximum(low[box] - p, p - high[box]), 0)
            kept = squared(outside) < best[who]
            if kept.any():
                stack.append((level + 1, who[kept], box[kept]))
        return best
