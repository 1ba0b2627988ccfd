"""Cuts at four errors: the share that they use, and triangles against the plain simplifier."""

import math
import time
from dataclasses import asdict, dataclass
from statistics import median

from floor import JUDGED, Floors, Source
from programs import Programs
from surface import read_ply

# Errors asked for, shares of the diagonal.
SHARES = (3e-4, 1e-3, 3e-3, 1e-2)
# The plain simplifier simplifies at all below this share of the source.
SIMPLIFIED = 0.9
# Largest source that the plain simplifier is tried on, triangles.
LARGEST_FLOOR = 3_000_000


@dataclass
class ErrorRow:
    model: str
    # Error asked for as a share of the diagonal.
    share: float
    source: int
    triangles: int
    # Largest distances as shares of the error: over all points, each way, and over the samples
    # of the shared judge.
    largest: float
    to_cut: float
    to_source: float
    judged: float
    p99: float
    # Triangles of the plain simplifier at the error asked for, by all points and by the judge's
    # samples; and at the distance that was found, by all points.
    plain: float | None
    plain_judged: float | None
    plain_equal: float | None

    def over(self, plain: float | None) -> float | None:
        return self.triangles / plain if plain and plain < SIMPLIFIED * self.source else None

    @property
    def ratio(self) -> float | None:
        return self.over(self.plain)

    @property
    def ratio_judged(self) -> float | None:
        return self.over(self.plain_judged)

    @property
    def ratio_equal(self) -> float | None:
        return self.over(self.plain_equal)

    def ratios(self) -> dict:
        return {"ratio": self.ratio, "ratio_judged": self.ratio_judged, "ratio_equal": self.ratio_equal}

    def json(self) -> dict:
        return asdict(self) | self.ratios()

    def __str__(self) -> str:
        ratios = " ".join(f"{it:6.2f}" if it else "     -" for it in self.ratios().values())
        plain = f"{self.plain_judged:9.0f}" if self.plain_judged else "        -"
        return (
            f"{self.model:22s} {self.share:7.0e} {self.source:9d} {self.triangles:9d}  {self.largest:6.3f} {self.judged:6.3f} {self.p99:6.3f}"
            f"  {self.to_cut:6.3f} {self.to_source:6.3f}  {plain} {ratios}"
        )


HEAD = (
    f"{'model':22s} {'E':>7s} {'source':>9s} {'cut':>9s}  {'max':>6s} {'judge':>6s} {'p99':>6s}"
    f"  {'to cut':>6s} {'to src':>6s}  {'plain':>9s} {'ratio':>6s} {'judge':>6s} {'equal':>6s}"
)


def rows(programs: Programs, floors: Floors, scene: str, say=print) -> list[ErrorRow]:
    started = time.monotonic()
    source = Source(read_ply(programs.export(scene, "--source")))
    triangles = len(source.surface.faces)
    floor = floors.of(scene, source) if triangles <= LARGEST_FLOOR else None
    found = []
    for share in SHARES:
        error = share * source.diagonal
        cut = read_ply(programs.export(scene, "--error", repr(error)))
        d = source.against(cut)
        plain = [None] * 3
        if floor:
            plain = [floor.triangles(share), floor.triangles(share, JUDGED), floor.triangles(d.largest / source.diagonal)]
            floors.keep()
        shares = (it / error for it in (d.largest, d.to_cut, d.to_source, d.judged, d.p99))
        row = ErrorRow(scene, share, triangles, len(cut.faces), *shares, *plain)
        say(row)
        found.append(row)
    say(f"{scene}: {time.monotonic() - started:.0f} s")
    return found


def geometric_mean(values: list[float]) -> float | None:
    return math.exp(sum(map(math.log, values)) / len(values)) if values else None


def summary(found: list[ErrorRow]) -> dict:
    """The figures that have goals."""
    models = sorted({it.model for it in found})
    by_model = {name: median(it.judged for it in found if it.model == name) for name in models}
    return {
        "largest": max(it.largest for it in found),
        "judged_median": median(it.judged for it in found),
        "largest_median": median(it.largest for it in found),
        "least_model_median": min(by_model.values()),
        "least_model": min(by_model, key=by_model.get),
        "model_medians": by_model,
        "ratio": geometric_mean([it.ratio for it in found if it.ratio]),
        "ratio_equal": geometric_mean([it.ratio_equal for it in found if it.ratio_equal]),
        "ratio_judged": geometric_mean([it.ratio_judged for it in found if it.ratio_judged]),
    }


def said(figures: dict) -> list[str]:
    shown = lambda it: "-" if it is None else f"{it:.3g}"
    return [
        f"largest distance / E: never above 1 wanted, {figures['largest']:.3f} found (all points)",
        f"median of distance / E: at least 0.6 wanted, {figures['judged_median']:.3f} found by 3,000 samples, {figures['largest_median']:.3f} by all points",
        f"least median of a model: at least 0.4 wanted, {figures['least_model_median']:.3f} found ({figures['least_model']})",
        (
            f"triangles / plain simplifier, geometric mean: at most 1.5 wanted, {shown(figures['ratio'])} found,"
            f" {shown(figures['ratio_judged'])} by 3,000 samples, {shown(figures['ratio_equal'])} at equal distance"
        ),
    ]
