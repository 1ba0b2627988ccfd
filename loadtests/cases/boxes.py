"""World boxes and triangle counts: `export --source` against this folder's own readers."""

from pathlib import Path

from files import gltf, texts
from files.surface import NotChecked, Scene
from rig import Exported, Rig
from rows import UNCHECKED, Row, metres, row

# Rounding of the arithmetic here and there, as a share of the largest coordinate.
ROUNDING = 2.0**-44
# A smaller area, as a share of the diagonal's square, is rounding.
FLAT = 1e-12
# A grid step is at most the extent / 2^14; half its diagonal counts as error.
FINEST_SHARE = 3**0.5 / 2 / 2**14
# The same for the finest step that the format has.
FINEST_METRES = 3**0.5 / 2 / 2**100


def read(file: Path) -> Scene:
    return gltf.read(file) if file.suffix in (".glb", ".gltf") else texts.read(file).scene()


def model(rig: Rig, file: Path) -> list[Row]:
    """One row: triangles, the box, and a stated error that is as small as `auto` promises."""
    try:
        source = read(file)
    except NotChecked as why:
        rig.ingest(file)
        return [Row(file.name, "a box", f"not checked, {why}", UNCHECKED)]
    ingested, exported = rig.ingest(file), rig.export(file)
    faults = box_faults(source, exported)
    if ingested.triangles not in (source.triangles(), source.posed_triangles()):
        faults.append(f"{ingested.triangles} triangles")
    expected = f"{source.triangles()} triangles, the box within the stated error"
    return [row(file.name, expected, "; ".join(faults) or said(source, exported), not faults)]


def large_model(rig: Rig, file: Path) -> list[Row]:
    """The same, and its triangles are let go."""
    rows = model(rig, file)
    rig.exported.pop(str(file), None)
    return rows


def said(source: Scene, exported: Exported) -> str:
    box, found = source.box(), exported.scene.box()
    off = metres(box.off_by(found)) if box and found else "nothing"
    return f"{source.triangles()}, off by {off}, stated {metres(exported.error_metres)}"


def allowed(source: Scene, exported: Exported) -> float:
    """Metres by which a point may be off."""
    return exported.error_metres + ROUNDING * source.box().largest()


def box_faults(source: Scene, exported: Exported) -> list[str]:
    box, found = source.box(), exported.scene.box()
    if not box or not found:
        # Triangles without area are left out.
        shown = box and source.area() > FLAT * box.diagonal() ** 2
        return [f"{'no' if shown else 'a'} box, of the file {box}"] if found or shown else []
    faults = []
    if box.off_by(found) > allowed(source, exported):
        faults.append(f"box off by {metres(box.off_by(found))}, stated {metres(exported.error_metres)}")
    most = max(FINEST_SHARE * source.largest_extent(), FINEST_METRES)
    if exported.error_metres > most * (1 + ROUNDING):
        faults.append(f"stated error {metres(exported.error_metres)}, extent / 2^14 gives {metres(most)}")
    return faults


def each_faults(source: Scene, exported: Exported) -> list[str]:
    """The box of every placement, found by its middle; an instance is neither lost nor gained."""
    wanted, found = source.boxes(), exported.scene.boxes()
    if len(wanted) != len(found):
        return [f"{len(found)} instances, of the file {len(wanted)}"]
    nearest = ((it, min(found, key=lambda other: it.off_by(other))) for it in wanted)
    worst = max(it.off_by(other) for it, other in nearest)
    return [f"an instance off by {metres(worst)}"] if worst > allowed(source, exported) else []
