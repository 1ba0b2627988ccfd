"""Triangle surfaces in f64: the PLY files that `export` writes, welding, samples by area."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

SCALARS = {"float": "f4", "double": "f8", "uint": "u4", "int": "i4", "uchar": "u1", "ushort": "u2"}


@dataclass
class Surface:
    """Places of vertices (n x 3, f64) and corners of triangles (m x 3)."""

    places: np.ndarray
    faces: np.ndarray

    def corners(self) -> np.ndarray:
        return self.places[self.faces]

    def diagonal(self) -> float:
        return float(np.linalg.norm(np.ptp(self.places, axis=0)))

    def areas(self) -> np.ndarray:
        a, b, c = np.moveaxis(self.corners(), 1, 0)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    def samples(self, count: int, random: np.random.Generator) -> np.ndarray:
        """Points spread evenly over the area."""
        total = np.cumsum(self.areas())
        chosen = np.searchsorted(total, random.random(count) * total[-1], side="right")
        a, b, c = np.moveaxis(self.places[self.faces[np.minimum(chosen, len(self.faces) - 1)]], 1, 0)
        u, v = random.random((2, count, 1))
        fold = u + v > 1
        u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
        return a + (b - a) * u + (c - a) * v

    def some_vertices(self, count: int, random: np.random.Generator) -> np.ndarray:
        """All vertices that a triangle has, or so many of them."""
        used = np.zeros(len(self.places), bool)
        used[self.faces] = True
        used = np.flatnonzero(used)
        if len(used) > count:
            used = random.choice(used, count, replace=False)
        return self.places[used]

    def welded(self) -> "Surface":
        """Vertices of equal position are one, triangles without three vertices are gone."""
        order = np.lexsort(self.places.T)
        sorted_places = self.places[order]
        first = np.ones(len(order), bool)
        first[1:] = (sorted_places[1:] != sorted_places[:-1]).any(1)
        number = np.empty(len(order), np.int64)
        number[order] = np.cumsum(first) - 1
        a, b, c = number[self.faces].T
        whole = (a != b) & (b != c) & (c != a)
        return Surface(sorted_places[first], np.stack([a, b, c], 1)[whole])


def read_ply(path: Path) -> Surface:
    """A binary PLY of positions and triangles, as `export` writes it."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    fields: list[tuple[str, str]] = []
    vertices = faces = 0
    for line in data[:end].decode("ascii").splitlines():
        match line.split():
            case ["format", kind, _] if kind != "binary_little_endian":
                raise ValueError(f"{path}: expected binary_little_endian, found {kind}")
            case ["element", "vertex", count]:
                vertices = int(count)
            case ["element", "face", count]:
                faces = int(count)
            case ["property", "list", "uchar", ("uint" | "int"), _]:
                pass
            case ["property", kind, name] if not faces:
                fields.append((name, "<" + SCALARS[kind]))
            case ["property", *_]:
                raise ValueError(f"{path}: expected only lists of corners a face, found {line}")
    vertex = np.dtype(fields)
    corner = np.dtype([("count", "u1"), ("corners", "<u4", 3)])
    if len(data) != end + vertices * vertex.itemsize + faces * corner.itemsize:
        raise ValueError(f"{path}: expected {vertices} vertices and {faces} triangles, found another length")
    table = np.frombuffer(data, vertex, vertices, end)
    places = np.stack([table[axis].astype(np.float64) for axis in "xyz"], 1)
    rows = np.frombuffer(data, corner, faces, end + vertices * vertex.itemsize)
    return Surface(places, rows["corners"].astype(np.int64))
