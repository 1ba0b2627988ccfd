"""The default view: triangles, bytes and pages to settle, pixels, and the picture's PSNR."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from programs import Programs

SIZE = (960, 540)
# Sizes at which foliage is drawn.
FOLIAGE_SIZES = ((64, 36), (160, 90), (320, 240), (640, 360), SIZE)
# Pictures narrower than this are drawn again a little higher and wider, and their pixels added up:
# the cover of a few hundred pixels depends on where their middles fall.
NARROW_PX = 300
MORE_PX = ((1, 0), (0, 1), (1, 1), (0, 2), (1, 2), (0, 3), (1, 3))
# Pixel errors of the curves, in pixels of SIZE.
CURVE_ERRORS_PX = (0.25, 0.5, 1, 2, 4, 8, 16, 32)
# Curves need no picture: one this much smaller, at an error as much smaller, draws the same cut.
CURVE_SHRINKS = 10


def covered(pfm: Path) -> np.ndarray:
    """A flag a pixel, rows from the top: something was hit."""
    kind, size, scale, body = pfm.read_bytes().split(b"\n", 3)
    if kind != b"Pf":
        raise ValueError(f"{pfm}: expected a PFM of one channel, found {kind!r}")
    width, height = map(int, size.split())
    depths = np.frombuffer(body, "<f4" if float(scale) < 0 else ">f4", width * height)
    return depths.reshape(height, width)[::-1] > 0


@dataclass
class View:
    """One settled view."""

    scene: str
    size: tuple[int, int]
    pixel_error: float
    triangles: int
    clusters: int
    pages: int
    # Bytes of pages, hierarchy and scene; textures apart.
    bytes: int
    texture_bytes: int
    pool_bytes: int
    covered_px: int
    # Against full detail: left out where it was not drawn.
    psnr_db: float | None = None
    psnr_covered_db: float | None = None
    reference_px: int | None = None
    differs_px: int | None = None
    # The same, added up over several pictures.
    cover_sum_px: int | None = None
    reference_sum_px: int | None = None

    @property
    def triangles_a_pixel(self) -> float:
        return self.triangles / max(self.covered_px, 1)

    @property
    def cover(self) -> float | None:
        """Covered pixels over those of full detail."""
        if self.reference_sum_px:
            return self.cover_sum_px / self.reference_sum_px
        return self.covered_px / self.reference_px if self.reference_px else None

    def json(self) -> dict:
        return asdict(self) | {"triangles_a_pixel": self.triangles_a_pixel, "cover": self.cover}


def drawn(programs: Programs, scene: str, stem: Path, size: tuple[int, int], *how) -> dict:
    return programs.reported(
        programs.client, "render", programs.library, "--scene", scene, "--size", f"{size[0]}x{size[1]}",
        "--out", stem.with_suffix(".png"), "--depth", stem.with_suffix(".pfm"), *how,
    )  # fmt: skip


def settled(
    programs: Programs, scene: str, stem: Path, size=SIZE, pixel_error: float = 1.0, *how: str
) -> View:
    said = drawn(programs, scene, stem, size, "--pixel-error", pixel_error, *how)
    textures = said.get("texture_bytes_fetched", 0)
    return View(
        scene, size, pixel_error, said["drawn"]["triangles"], said["drawn"]["clusters"], said["pages_fetched"],
        said["bytes_fetched"] - textures, textures, said["pool_bytes"], int(covered(stem.with_suffix(".pfm")).sum()),
    )  # fmt: skip


def view(programs: Programs, scene: str, pictures: Path, size=SIZE, compared: bool = True) -> View:
    """The view at one pixel of error, and full detail beside it. Pictures stay in their folder."""
    stem = pictures / f"{scene}-{size[0]}x{size[1]}"
    found = settled(programs, scene, stem, size)
    full = stem.with_name(stem.name + "-full")
    if compared:
        drawn(programs, scene, full, size, "--reference")
        of = [stem.with_suffix(".png"), full.with_suffix(".png"), "--depths", stem.with_suffix(".pfm"), full.with_suffix(".pfm")]
        figures = programs.reported(programs.loadtests, "compare", *of)
        # Equal pictures have no noise.
        found.psnr_db = figures.get("psnr_db")
        found.psnr_covered_db = figures.get("psnr_covered_db")
        found.reference_px = figures["covered_px"]
        found.differs_px = figures["coverage_differs_px"]
    for it in (stem, full):
        it.with_suffix(".pfm").unlink(missing_ok=True)
    return found


def foliage(programs: Programs, scene: str, pictures: Path, size: tuple[int, int], again: bool) -> View:
    """As `view`. Covers of several pictures are added up; triangles are those of the first."""
    first = view(programs, scene, pictures, size)
    if again and size[0] < NARROW_PX:
        others = [view(programs, scene, pictures, (size[0] + w, size[1] + h)) for w, h in MORE_PX]
        first.cover_sum_px = first.covered_px + sum(it.covered_px for it in others)
        first.reference_sum_px = first.reference_px + sum(it.reference_px for it in others)
    return first


def curve(programs: Programs, scene: str, errors_px=CURVE_ERRORS_PX) -> list[dict]:
    """Triangles and bytes over the pixel error."""
    # Occlusion depends on the pixels; the cut does not.
    size = tuple(it // CURVE_SHRINKS for it in SIZE)
    points = []
    for pixel_error in errors_px:
        found = settled(
            programs, scene, programs.folder / "curve", size, pixel_error / CURVE_SHRINKS, "--no-occlusion"
        )
        points.append({"error_px": pixel_error, "triangles": found.triangles, "bytes": found.bytes, "pages": found.pages})
    return points
