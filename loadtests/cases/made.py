"""Generated scenes whose figures are known in f64: equal borders, placements far from the origin,
concave polygons."""

import json
import math
import random
from pathlib import Path

import boxes
import shapes
from files import texts
from files.picture import holes
from files.surface import Scene
from files.writer import Gltf, cuboid, grid, noise, waves
from rig import Rig, look
from rows import Row, metres, row

TILES = 4
QUADS = 96
TILE_METRES = 10.0
PIXELS = ("0.25", "1", "2", "4")
FAR = {"UTM": (456789.123, 120.507, -5428123.456), "ECEF": (4194500.123, 4780123.511, -171234.257)}


def folder(rig: Rig) -> Path:
    made = rig.folder / "made"
    made.mkdir(exist_ok=True)
    return made


def plate(gltf: Gltf) -> None:
    points, triangles = grid(1, 1, lambda x, z: (100.0 * x - 30, -6.0, -70 + 100.0 * z))
    gltf.node(mesh=gltf.mesh(points, triangles, gltf.unlit(1, 0, 0)))


def tile(column: int, row: int, origin: tuple[float, float]) -> tuple[list, list]:
    """A tile of one terrain around `origin`; all heights are of the whole, so borders are equal."""

    def place(x: int, z: int):
        world = [TILE_METRES * (a + b / QUADS) for a, b in ((column, x), (row, z))]
        return (world[0] - origin[0], waves(*world), world[1] - origin[1])

    return grid(QUADS, QUADS, place)


def whole_tiles() -> Gltf:
    """Each tile in world coordinates, as tiles16.glb has them."""
    gltf = Gltf()
    sand = gltf.unlit(0.8, 0.7, 0.5)
    for at in range(TILES * TILES):
        gltf.node(mesh=gltf.mesh(*tile(at % TILES, at // TILES, (0, 0)), sand))
    plate(gltf)
    return gltf


def moved_tiles() -> Gltf:
    """Each tile around its own corner, put in place by its node."""
    gltf = Gltf()
    sand = gltf.unlit(0.8, 0.7, 0.5)
    for at in range(TILES * TILES):
        column, line = at % TILES, at // TILES
        origin = (TILE_METRES * column, TILE_METRES * line)
        gltf.node(mesh=gltf.mesh(*tile(column, line, origin), sand), translation=[origin[0], 0, origin[1]])
    plate(gltf)
    return gltf


def instanced_tiles(gap: float = 0.0) -> Gltf:
    """One tile whose opposite borders are equal, sixteen times."""

    def place(x: int, z: int):
        a, b = x % QUADS / QUADS, z % QUADS / QUADS
        height = sum(noise(a * cells, b * cells, cells) * 2.2 / cells for cells in (2, 4, 8, 20))
        return (TILE_METRES * x / QUADS, height, TILE_METRES * z / QUADS)

    gltf = Gltf()
    mesh = gltf.mesh(*grid(QUADS, QUADS, place), gltf.unlit(0.8, 0.7, 0.5))
    for at in range(TILES * TILES):
        gltf.node(mesh=mesh, translation=[(TILE_METRES + gap) * (at % TILES), 0, (TILE_METRES + gap) * (at // TILES)])
    plate(gltf)
    return gltf


TERRAINS = {"tiles": whole_tiles, "tiles around their corners": moved_tiles, "instanced tiles": instanced_tiles}


def borders(rig: Rig, name: str) -> list[Row]:
    """Hole pixels between tiles whose borders are equal."""
    file = TERRAINS[name]().write(folder(rig) / f"{name.replace(' ', '_')}.glb")
    camera = look((20, 22, 52), (20, 0, 18), 50)
    full = rig.render(file, "reference", *camera, "--reference", size="960x540").shown()
    counts = [holes(rig.render(file, it, *camera, "--pixel-error", it, size="960x540").shown(), full) for it in PIXELS]
    return [row(f"made {name}", f"0 hole pixels at {', '.join(PIXELS)} px", ", ".join(map(str, counts)), not any(counts))]


def turned(random_: random.Random) -> list[float]:
    """A rotation as a quaternion, unit in f64."""
    parts = [random_.gauss(0, 1) for _ in range(4)]
    length = math.hypot(*parts)
    return [it / length for it in parts]


def far_boxes(rig: Rig, name: str) -> list[Row]:
    """Boxes at odd places and turns: translations, nested nodes and matrices."""
    chance = random.Random(name)
    gltf = Gltf()
    mesh = gltf.mesh(*cuboid(0.613, 0.427, 1.011))
    origin = FAR[name]
    for at in range(40):
        here = [chance.uniform(0, 50) for _ in range(3)]
        there = [a + b for a, b in zip(origin, here)]
        if at % 3 == 0:
            gltf.node(mesh=mesh, translation=there, rotation=turned(chance), scale=[chance.uniform(0.5, 2) for _ in range(3)])
        elif at % 3 == 1:
            child = gltf.add("nodes", {"mesh": mesh, "translation": here, "rotation": turned(chance)})
            gltf.node(translation=list(origin), children=[child])
        else:
            a, b = chance.uniform(0, 6), chance.uniform(0.5, 1.5)
            gltf.node(mesh=mesh, matrix=[b * math.cos(a), 0, -b * math.sin(a), 0, 0, b, 0, 0, b * math.sin(a), 0, b * math.cos(a), 0, *there, 1])
    file = gltf.write(folder(rig) / f"boxes_{name}.glb")
    source, exported = boxes.read(file), rig.export(file)
    faults = boxes.box_faults(source, exported) + boxes.each_faults(source, exported)
    return [row(f"made boxes in {name}", "40 placements, each box within the stated error", "; ".join(faults) or boxes.said(source, exported), not faults)]


def terrain_text(name: str, kind: str) -> bytes:
    """A terrain of 32 x 32 quads as OBJ, double PLY or text STL, far from the origin."""
    x0, y0, z0 = FAR[name]
    points, triangles = grid(32, 32, lambda x, z: (x0 + 0.2 * x, y0 + 0.3 * math.sin(x / 5) * math.cos(z / 4), z0 + 0.2 * z))
    lines = [" ".join(f"{it:.4f}" for it in at) for at in points]
    if kind == "obj":
        return "\n".join([*(f"v {it}" for it in lines), *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles), ""]).encode()
    if kind == "ply":
        header = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property double {it}" for it in "xyz"),
                  f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]  # fmt: skip
        return "\n".join([*header, *lines, *(f"3 {a} {b} {c}" for a, b, c in triangles), ""]).encode()
    facets = [f"facet normal 0 1 0\nouter loop\n{''.join(f'vertex {lines[it]}{chr(10)}' for it in corners)}endloop\nendfacet" for corners in triangles]
    return "\n".join(["solid terrain", *facets, "endsolid terrain", ""]).encode()


def far_text(rig: Rig, name: str, kind: str) -> list[Row]:
    file = folder(rig) / f"terrain_{name}.{kind}"
    file.write_bytes(terrain_text(name, kind))
    source, exported = boxes.read(file), rig.export(file)
    faults = vertex_faults(source, exported.scene, boxes.allowed(source, exported))
    return [row(f"made {kind} in {name}", "2048 triangles, vertices within the stated error", "; ".join(faults) or "all there", not faults)]


def vertex_faults(source: Scene, found: Scene, allowed: float) -> list[str]:
    """Every vertex of the file is exported, within the error, and no triangle is lost."""
    ours = list(found.corners())
    faults = [] if len(ours) == 3 * source.drawn_triangles() else [f"{len(ours) // 3} triangles"]
    cells: dict[tuple, list] = {}
    for at in set(ours):
        cells.setdefault(tuple(math.floor(it / 0.05) for it in at), []).append(at)
    worst = 0.0
    for at in set(source.corners()):
        near = [math.dist(at, it) for cell in shapes.around(at) for it in cells.get(cell, [])]
        worst = max(worst, min(near, default=math.inf))
    return faults + ([f"a vertex off by {metres(worst)}, allowed {metres(allowed)}"] if worst > allowed else [])


def exported_again(rig: Rig, name: str) -> list[Row]:
    """`export` of a far scene: .ply tells its places, .glb is ingested again to the same places."""
    file = folder(rig) / f"terrain_{name}.obj"
    file.write_bytes(terrain_text(name, "obj"))
    scene, source, rows = rig.ingest(file).scene, boxes.read(file), []
    allowed = boxes.allowed(source, rig.export(file))
    for kind in ("ply", "glb"):
        out = folder(rig) / f"again_{name}.{kind}"
        run = rig.run("server", "export", scene, "--library", rig.library, "--source", "--out", out)
        if run.code:
            rows.append(row(f"made export .{kind} in {name}", "exit 0", f"exit {run.code}: {run.error()}", False))
            continue
        if kind == "ply":
            faults = vertex_faults(source, boxes.read(out), allowed)
        else:
            # Ingested again, it is rounded again.
            again = rig.export(out)
            faults = vertex_faults(source, again.scene, allowed + again.error_metres)
        rows.append(row(f"made export .{kind} in {name}", "places within the stated error", "; ".join(faults) or "all there", not faults))
    return rows


def stars(rig: Rig, kind: str) -> list[Row]:
    """Concave polygons in random planes, and rings whose hole a bridge cuts open: area as given."""
    chance = random.Random(kind)
    vertices, loops = [], []
    for number in range(40):
        loop = ring(chance) if number % 4 == 3 else star(chance)
        a, b = math.tau * chance.random(), math.tau * chance.random()
        first = len(vertices)
        for x, y in loop:
            x, z = x * math.cos(a), x * math.sin(a)
            y, z = y * math.cos(b) - z * math.sin(b), y * math.sin(b) + z * math.cos(b)
            vertices.append((x + 4 * (number % 8), y + 4 * (number // 8), z))
        loops.append(list(range(first, len(vertices))))
    lines = [" ".join(map(repr, at)) for at in vertices]
    if kind == "obj":
        text = [*(f"v {it}" for it in lines), *("f " + " ".join(str(it + 1) for it in loop) for loop in loops)]
    else:
        text = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}", *(f"property double {it}" for it in "xyz"),
                f"element face {len(loops)}", "property list uchar int vertex_indices", "end_header",
                *lines, *(f"{len(loop)} " + " ".join(map(str, loop)) for loop in loops)]  # fmt: skip
    file = folder(rig) / f"stars.{kind}"
    file.write_text("\n".join(text) + "\n")
    area, exported = texts.read(file).area(), rig.export(file)
    found = exported.scene.area()
    # A border of so many metres that moves by the error.
    slack = 2 * exported.error_metres * sum(math.dist(vertices[a], vertices[b]) for loop in loops for a, b in zip(loop, loop[1:] + loop[:1]))
    holds = abs(area - found) <= slack + 1e-6 * area
    return [row(f"made concave .{kind}", f"area {area:.6g} m2 within {slack:.2g}", f"{found:.6g} m2", holds)]


def star(chance: random.Random) -> list[tuple[float, float]]:
    corners = chance.randrange(5, 24)
    return [(r * math.cos(math.tau * it / corners), r * math.sin(math.tau * it / corners)) for it in range(corners) for r in [chance.uniform(0.3, 1.6)]]


def ring(chance: random.Random) -> list[tuple[float, float]]:
    """A square around a square hole: one loop that goes in and comes back over the same edge."""
    outer = [(-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (-1.5, 1.5)]
    size = chance.uniform(0.2, 1.2)
    inner = [(-size, -size), (-size, size), (size, size), (size, -size)]
    return [*outer, outer[0], *inner, inner[0]]


def claims(rows: list[Row]) -> str:
    """Rows as the stability table of the report reads them."""
    reference = "generated in f64"
    found = [{"case": it.name, "reference": reference, "expected": it.expected, "found": it.found, "holds": it.state != "NOT"} for it in rows]
    return json.dumps({"claims": found}, indent=1)
