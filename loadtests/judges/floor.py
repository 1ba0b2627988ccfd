"""Triangles that a plain whole-mesh simplifier needs for a distance.

It knows no attributes, clusters or levels.
Its curve over counts belongs to the model alone, so it is kept in a file between runs."""

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path

import fast_simplification
import numpy as np

from distance import Tree
from surface import Surface

# Counts tried are source / 2^(step / STEPS_PER_HALVING).
STEPS_PER_HALVING = 3
# Fewest triangles tried.
FEWEST = 32
# Area samples of the shared judge, which come first among the points.
SAMPLES_JUDGE = 3_000
SAMPLES_AREA = 10_000
SAMPLES_VERTICES = 20_000
# Columns of a curve's points: by all points, and by the shared judge's samples.
LARGEST, JUDGED = 1, 2


def probes(surface: Surface, seed: int) -> np.ndarray:
    """Points that stand for a surface: samples by area, then vertices."""
    random = np.random.default_rng(seed)
    return np.concatenate([surface.samples(SAMPLES_AREA, random), surface.some_vertices(SAMPLES_VERTICES, random)])


@dataclass
class Distances:
    """Largest distances both ways, metres; `judged` is over the shared judge's samples alone."""

    to_cut: float
    to_source: float
    judged: float
    p99: float

    @property
    def largest(self) -> float:
        return max(self.to_cut, self.to_source)


class Source:
    """The source surface, measured against."""

    def __init__(self, surface: Surface):
        self.surface = surface
        self.diagonal = surface.diagonal()
        self.points = probes(surface, 1)
        self.tree = Tree(surface)

    def against(self, cut: Surface) -> Distances:
        to_cut = Tree(cut).distances(self.points)
        to_source = self.tree.distances(probes(cut, 2))
        judged = max(to_cut[:SAMPLES_JUDGE].max(), to_source[:SAMPLES_JUDGE].max())
        p99 = max(np.percentile(it[:SAMPLES_AREA], 99) for it in (to_cut, to_source))
        return Distances(float(to_cut.max()), float(to_source.max()), float(judged), float(p99))


class Floor:
    """Count and distance of the plain simplifier, tried where asked and kept."""

    def __init__(self, source: Source, kept: dict):
        self.source = source
        self.kept = kept
        self.welded: Surface | None = None
        self.steps = max(0, math.floor(STEPS_PER_HALVING * math.log2(max(len(source.surface.faces) / FEWEST, 1))))

    def tried(self, step: int) -> list[float]:
        """Triangles, largest distance and judged distance as shares of the diagonal."""
        if str(step) not in self.kept:
            if self.welded is None:
                self.welded = self.source.surface.welded()
            wanted = round(len(self.welded.faces) / 2 ** (step / STEPS_PER_HALVING))
            # Single floats: far from the origin the middle goes to it first.
            middle = self.welded.places.min(0) + np.ptp(self.welded.places, axis=0) / 2
            places, faces = (self.welded.places - middle).astype(np.float32), self.welded.faces.astype(np.int32)
            if step:
                places, faces = fast_simplification.simplify(places, faces, target_count=wanted)
            cut = Surface(places.astype(np.float64) + middle, faces.astype(np.int64))
            found = self.source.against(cut)
            self.kept[str(step)] = [len(faces), found.largest / self.source.diagonal, found.judged / self.source.diagonal]
        return self.kept[str(step)]

    def triangles(self, share: float, column: int = LARGEST) -> float:
        """Fewest triangles whose distance stays within a share of the diagonal: the step where it
        first exceeds, found by halving, and a straight line in logarithms between."""
        fine, coarse = 0, self.steps + 1
        while coarse - fine > 1:
            middle = (fine + coarse) // 2
            if middle <= self.steps and self.tried(middle)[column] <= share:
                fine = middle
            else:
                coarse = middle
        a = self.tried(fine)
        if coarse > self.steps or a[column] >= share:
            return a[0]
        b = self.tried(coarse)
        # The rounding to floats is a distance already at full detail.
        from_a = math.log(share / max(a[column], share * 1e-3))
        whole = math.log(b[column] / max(a[column], share * 1e-3))
        return float(a[0] * (b[0] / a[0]) ** (from_a / whole))


class Floors:
    """The curves of all models, one JSON file, to which several runs may add."""

    def __init__(self, file: Path):
        self.file = file
        self.models = self.read()

    def read(self) -> dict:
        return json.loads(self.file.read_text()) if self.file.exists() else {}

    def of(self, name: str, source: Source) -> Floor:
        return Floor(source, self.models.setdefault(f"{name}:{len(source.surface.faces)}", {}))

    def keep(self) -> None:
        for name, steps in self.read().items():
            mine = self.models.setdefault(name, {})
            mine |= {step: steps[step] for step in steps.keys() - mine.keys()}
        written = self.file.with_suffix(f".{os.getpid()}")
        written.write_text(json.dumps(self.models, indent=1))
        written.replace(self.file)
