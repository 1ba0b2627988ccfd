"""Cases judged by their exported triangles: boxes, areas, counts, gaps, warnings."""

import math
from array import array

import boxes
from files import texts
from rig import CASES, Rig
from rows import Row, metres, row

# Corners that are nearer than this in the file are one place.
ONE_PLACE = 1e-6
# Neighbours may part by this or by the stated error, metres.
GAP = 1e-3


def instances(rig: Rig, name: str) -> list[Row]:
    """Box, and the box of each instance."""
    file = CASES / name
    source, exported = boxes.read(file), rig.export(file)
    size = " x ".join(f"{it:.4g}" for it in source.box().size())
    faults = boxes.box_faults(source, exported) + boxes.each_faults(source, exported)
    expected = f"{len(source.placements)} instances, {size} m, within the stated error"
    return [row(name, expected, "; ".join(faults) or boxes.said(source, exported), not faults)]


def cylinder(rig: Rig) -> list[Row]:
    """Every vertex of cyl24.obj lies on the radius 1.2345; its height is 7.891."""
    exported = rig.export(CASES / "cyl24.obj")
    axes = zip(*(mesh.axes() for mesh, _ in exported.scene.placed()))
    xs, ys, zs = (array("d", [it for part in axis for it in part]) for axis in axes)
    spans = sorted(((max(it) - min(it), it) for it in (xs, ys, zs)), key=lambda it: -it[0])
    height, rest = spans[0][0], [it for _, it in spans[1:]]
    radii = [it for it in map(math.hypot, *rest) if it > 0.5]
    off = max(abs(height - 7.891), *(abs(it - 1.2345) for it in radii))
    # Each end of the height may be off. The file has six decimals.
    holds = off <= 2 * exported.error_metres + 1e-6
    return [row("cyl24.obj", "radius 1.2345 m, height 7.891 m within the stated error",
                f"off by {metres(off)}, stated {metres(exported.error_metres)}", holds)]  # fmt: skip


def polygon(rig: Rig, name: str) -> list[Row]:
    """Area and count of a concave polygon."""
    file = texts.read(CASES / name)
    exported = rig.export(CASES / name)
    area, found = file.area(), exported.scene.area()
    triangles = sum(len(it) - 2 for it in file.loops)
    count = exported.scene.drawn_triangles()
    # A border that moves by the error sweeps its length times the error.
    around = sum(math.dist(file.vertices[a], file.vertices[b]) for loop in file.loops for a, b in zip(loop, loop[1:] + loop[:1]))
    holds = abs(area - found) <= 2 * around * exported.error_metres + 1e-9 and count == triangles
    return [row(name, f"area {area:.6g} m2 in {triangles} triangles", f"{found:.6g} m2 in {count}", holds)]


def gaps(rig: Rig, name: str) -> list[Row]:
    """Tiles: all vertices of the file are there, and corners that tiles share stay together."""
    file = CASES / name
    source, exported = boxes.read(file), rig.export(file)
    limit = max(GAP, 2 * exported.error_metres)
    cells: dict[tuple, list] = {}
    for at in set(exported.scene.corners()):
        cells.setdefault(tuple(math.floor(it / 0.05) for it in at), []).append(at)
    lost, apart, farthest = 0, 0.0, 0.0
    places = {tuple(round(it / ONE_PLACE) for it in at): at for at in source.corners()}
    for at in places.values():
        near = [other for cell in around(at) for other in cells.get(cell, []) if math.dist(at, other) < 0.04]
        if not near:
            lost += 1
            continue
        farthest = max(farthest, max(math.dist(at, it) for it in near))
        apart = max(apart, max(math.dist(near[0], it) for it in near))
    count = exported.scene.drawn_triangles()
    holds = not lost and apart <= limit and farthest <= boxes.allowed(source, exported) + ONE_PLACE and count == source.drawn_triangles()
    expected = f"{source.drawn_triangles()} triangles, shared corners within {metres(limit)}, vertices within the stated error"
    found = f"{count} triangles, corners {metres(apart)} apart, {lost} lost, off by {metres(farthest)}, stated {metres(exported.error_metres)}"
    return [row(f"{name} gaps", expected, found, holds)]


def around(at) -> list[tuple]:
    x, y, z = (math.floor(it / 0.05) for it in at)
    return [(x + a, y + b, z + c) for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1)]


def neighbours(rig: Rig, name: str) -> list[Row]:
    """Vertices that meshes of a scene share exactly stay within the stated error of each other."""
    file = CASES / name
    source, exported = boxes.read(file), rig.export(file)
    if len(source.placements) != len(exported.scene.placements):
        return [row(f"{name} joints", f"{len(source.placements)} instances", f"{len(exported.scene.placements)}", False)]
    apart = 0.0
    ours = exported.scene.boxes()
    for it in source.boxes():
        mine = min(ours, key=lambda other: it.off_by(other))
        for axis in range(3):
            for other in source.boxes():
                if abs(it.high[axis] - other.low[axis]) < ONE_PLACE and touches(it, other, axis):
                    beside = min(ours, key=lambda found: other.off_by(found))
                    apart = max(apart, abs(mine.high[axis] - beside.low[axis]))
    limit = exported.error_metres + ONE_PLACE
    return [row(f"{name} joints", f"touching boxes at most {metres(limit)} apart", f"{metres(apart)}", apart <= limit)]


def touches(a, b, axis: int) -> bool:
    return all(a.low[it] < b.high[it] - ONE_PLACE and b.low[it] < a.high[it] - ONE_PLACE for it in range(3) if it != axis)


def facets(rig: Rig) -> list[Row]:
    """count0.stl: the length says how many facets there are, and a warning that it does."""
    [judged] = boxes.model(rig, CASES / "count0.stl")
    said = rig.ingest(CASES / "count0.stl").warned("count") or rig.ingest(CASES / "count0.stl").warned("header")
    return [judged, row("count0.stl warning", "a warning about the header's count", said or "none", bool(said))]


def far_and_near(rig: Rig) -> list[Row]:
    """The same terrain far from and near the origin: one triangle count, one shape."""
    found = [rig.export(CASES / name) for name in ("utm_obj.obj", "local_obj.obj")]
    [far, near] = [it.scene.drawn_triangles() for it in found]
    [wanted, _] = [texts.read(CASES / name).scene().triangles() for name in ("utm_obj.obj", "local_obj.obj")]
    [a, b] = [it.scene.box().size() for it in found]
    off = max(abs(x - y) for x, y in zip(a, b))
    stated = sum(it.error_metres for it in found)
    return [row("utm_obj.obj = local_obj.obj", f"{wanted} triangles each, sizes within {metres(2 * stated + 1e-3)}",
                f"{far} and {near}, off by {metres(off)}", far == near == wanted and off <= 2 * stated + 1e-3)]  # fmt: skip


def named(rig: Rig, name: str, parts: tuple[str, ...]) -> list[Row]:
    """Geometry is read, and a warning names all of the parts."""
    said = rig.ingest(CASES / name).warned(*parts)
    expected = f"a warning that names {' and '.join(parts)}"
    return [row(f"{name} warning", expected, said or f"none in {rig.ingest(CASES / name).warnings}", bool(said))]


def bomb(rig: Rig) -> list[Row]:
    """bomb60k.png: refused, or left out by name; little memory here and in the viewer."""
    most = 1 << 30
    file = CASES / "bomb60k.png.gltf"
    run, ingested = rig.try_ingest(file)
    said = ingested.warned("bomb60k.png") if ingested else run.err
    holds = run.code in (0, 1) and "bomb60k.png" in said and run.peak_bytes < most
    expected = f"exit 1 or a warning, bomb60k.png by name, below {most >> 20} MiB"
    rows = [row("bomb60k.png.gltf", expected, f"exit {run.code}, {run.peak_bytes >> 20} MiB, {said.strip() or 'no warning'}", holds)]
    if ingested:
        peak = rig.render(file, "memory", size="64x64").peak_bytes
        rows.append(row("bomb60k.png.gltf drawn", f"below {most >> 20} MiB", f"{peak >> 20} MiB", peak < most))
    return rows


