"""Triangles and their placements in f64: counts, areas, world boxes. None of the server's code."""

import math
from array import array
from dataclasses import dataclass, field

Row3 = tuple[float, float, float, float]
Matrix = tuple[Row3, Row3, Row3]
IDENTITY: Matrix = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


class NotChecked(Exception):
    """A file that this reader cannot read, and why: it is counted, not judged."""


@dataclass
class Box:
    low: list[float]
    high: list[float]

    def off_by(self, other: "Box") -> float:
        """Largest distance between equal sides, metres."""
        return max(abs(a - b) for a, b in zip(self.low + self.high, other.low + other.high))

    def diagonal(self) -> float:
        return math.dist(self.low, self.high)

    def size(self) -> list[float]:
        return [b - a for a, b in zip(self.low, self.high)]

    def middle(self) -> list[float]:
        return [(a + b) / 2 for a, b in zip(self.low, self.high)]

    def largest(self) -> float:
        """Largest coordinate, metres."""
        return max(map(abs, self.low + self.high))


@dataclass
class Mesh:
    """Positions x, y, z by turns; three corners a triangle."""

    positions: array
    triangles: array
    memo: dict = field(default_factory=dict)

    def count(self) -> int:
        return len(self.triangles) // 3

    def axes(self) -> list[array]:
        """Coordinates of the vertices that triangles with three different corners use."""
        if "axes" not in self.memo:
            at, corners = self.positions, self.triangles
            [xs, ys, zs] = [at[0::3], at[1::3], at[2::3]]
            used = set(corners)
            if any(a == b or b == c or a == c for a, b, c in zip(corners[0::3], corners[1::3], corners[2::3])):
                used = set()
                for a, b, c in zip(corners[0::3], corners[1::3], corners[2::3]):
                    if a != b and b != c and a != c:
                        used.update((a, b, c))
            if len(used) < len(xs):
                order = sorted(used)
                [xs, ys, zs] = [array("d", [axis[it] for it in order]) for axis in (xs, ys, zs)]
            self.memo["axes"] = [xs, ys, zs]
        return self.memo["axes"]

    def box(self) -> Box | None:
        if "box" not in self.memo:
            axes = self.axes()
            self.memo["box"] = Box([min(it) for it in axes], [max(it) for it in axes]) if axes[0] else None
        return self.memo["box"]

    def farthest(self, row: Row3) -> float:
        """Largest value of the row's linear part over all vertices."""
        key = row[:3]
        if key not in self.memo:
            a, b, c = key
            if sum(it != 0 for it in key) <= 1:
                box = self.box()
                self.memo[key] = sum(max(f * lo, f * hi) for f, lo, hi in zip(key, box.low, box.high) if f)
            else:
                self.memo[key] = max(a * x + b * y + c * z for x, y, z in zip(*self.axes()))
        return self.memo[key]


@dataclass
class Scene:
    """Meshes and where they stand. A mesh's triangles count once, as in the server's report."""

    meshes: list[Mesh]
    placements: list[tuple[int, Matrix]]
    # The mesh of the file that each mesh is a pose of; empty where each stands for itself.
    origins: list[int] = field(default_factory=list)

    def triangles(self) -> int:
        """A mesh of the file counts once, in however many poses it stands."""
        origins = self.origins or range(len(self.meshes))
        return sum({origins[mesh]: self.meshes[mesh].count() for mesh, _ in self.placements}.values())

    def posed_triangles(self) -> int:
        """A mesh counts once a pose."""
        return sum(self.meshes[mesh].count() for mesh in {mesh for mesh, _ in self.placements})

    def placed(self) -> list[tuple[Mesh, Matrix]]:
        found = [(self.meshes[mesh], matrix) for mesh, matrix in self.placements]
        return [(mesh, matrix) for mesh, matrix in found if mesh.box()]

    def box(self) -> Box | None:
        """World box, exact: placements whose bounds reach no farther are not looked at."""
        placed = self.placed()
        if not placed:
            return None
        high = [farthest(placed, axis, 1.0) for axis in range(3)]
        low = [0.0 - farthest(placed, axis, -1.0) for axis in range(3)]
        return Box(low, high)

    def boxes(self) -> list[Box]:
        """World box of each placement."""
        return [Scene([mesh], [(0, matrix)]).box() for mesh, matrix in self.placed()]

    def largest_extent(self) -> float:
        """Diagonal of the largest placement's box, metres."""
        seen = {}
        for mesh, matrix in self.placed():
            scale = max(math.hypot(*(row[axis] for row in matrix)) for axis in range(3))
            seen[id(mesh)] = max(seen.get(id(mesh), 0.0), scale * mesh.box().diagonal())
        return max(seen.values(), default=0.0)

    def corners(self):
        """World positions of all corners, three a triangle."""
        for mesh, matrix in self.placed():
            at = mesh.positions
            world = [moved(matrix, at[3 * it : 3 * it + 3]) for it in range(len(at) // 3)]
            for corner in mesh.triangles:
                yield world[corner]

    def area(self) -> float:
        corners = list(self.corners())
        total = 0.0
        for a, b, c in zip(corners[0::3], corners[1::3], corners[2::3]):
            total += math.hypot(*cross(minus(b, a), minus(c, a))) / 2
        return total

    def drawn_triangles(self) -> int:
        return sum(self.meshes[mesh].count() for mesh, _ in self.placements)


def farthest(placed: list, axis: int, sign: float) -> float:
    bounds = []
    for mesh, matrix in placed:
        row = tuple(sign * it for it in matrix[axis])
        box = mesh.box()
        bound = row[3] + sum(max(f * lo, f * hi) for f, lo, hi in zip(row, box.low, box.high))
        bounds.append((bound, mesh, row))
    bounds.sort(key=lambda it: -it[0])
    best = -math.inf
    for bound, mesh, row in bounds:
        if bound <= best:
            break
        best = max(best, row[3] + mesh.farthest(row))
    return best


def moved(matrix: Matrix, at) -> tuple[float, float, float]:
    x, y, z = at
    return tuple(a * x + b * y + c * z + d for a, b, c, d in matrix)


def times(left: Matrix, right: Matrix) -> Matrix:
    columns = list(zip(*right))
    return tuple(
        tuple(sum(row[k] * column[k] for k in range(3)) + (row[3] if at == 3 else 0.0) for at, column in enumerate(columns))
        for row in left
    )


def minus(a, b) -> tuple[float, float, float]:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def cross(a, b) -> tuple[float, float, float]:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def polygon_area(loop: list) -> float:
    """Area of a flat polygon, convex or not, by Newell's sum (the shoelace formula in space)."""
    total = (0.0, 0.0, 0.0)
    for a, b in zip(loop, loop[1:] + loop[:1]):
        total = tuple(x + y for x, y in zip(total, cross(minus(a, loop[0]), minus(b, loop[0]))))
    return math.hypot(*total) / 2
