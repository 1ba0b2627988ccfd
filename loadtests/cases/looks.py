"""Cases judged by their pictures: holes, closed surfaces, visible, textured, the same."""

import math
from array import array
from pathlib import Path

from files.picture import contrast, count, holes, mean, mean_difference, png
from files.writer import Gltf, cuboid, grid
from rig import CASES, Rig, look
from rows import Row, later, row

# A checker of two colours spreads so much; a white or washed surface hardly at all.
TEXTURED = 80
# Share of the picture that a framed model covers at least.
VISIBLE = 0.05


def tiles(rig: Rig, options: tuple[str, ...] = ()) -> list[Row]:
    """Hole pixels of tiles16.glb by the measure of cracks.py."""
    file = CASES / "tiles16.glb"
    camera = look((20, 26, 14), (20, 0, -18), 50)
    full = rig.render(file, "reference", *camera, "--reference", size="1280x720").shown()
    rows = []
    for pixels in ("0.25", "1", "2", "4"):
        shown = rig.render(file, pixels, *camera, "--pixel-error", pixels, size="1280x720").shown()
        found = holes(shown, full)
        rows.append(row(f"tiles16.glb at {pixels} px", "0 hole pixels of a plate that the reference hides",
                        f"{found} (red in all {count(shown.red())}, reference {count(full.red())})", found == 0))  # fmt: skip
    return rows


def planned(rig: Rig) -> list[Row]:
    """Tiles that different jobs build are the scene that one process builds."""
    file, scene = CASES / "tiles16.glb", "tiles16.planned"
    common = ("--library", rig.library, "--scene", scene, "--quiet")
    steps = [(file, "--plan", "--jobs", 4), *(("--job", it) for it in range(4)), ("--finish",)]
    for step in steps:
        run = rig.run("server", "ingest", *step, *common, "--rebuild") if "--job" in step else rig.run("server", "ingest", *step, *common)
        if run.code:
            return [row("tiles16.glb by 4 jobs", "exit 0", f"exit {run.code}: {run.error()}", False)]
    whole = scene_hash(rig, rig.ingest(file).scene)
    found = scene_hash(rig, scene)
    return [row("tiles16.glb by 4 jobs", f"the scene of one process, {whole[:12]}", found[:12], whole == found)]


def scene_hash(rig: Rig, scene: str) -> str:
    """The scene's hash, as `show` tells it; empty where the library has none."""
    run = rig.run("server", "show", scene, "--library", rig.library)
    return next((line.split()[1] for line in run.out.splitlines() if line.startswith("scene")), "")


def joined(rig: Rig, name: str, front: float, length: float, height: float) -> list[Row]:
    """A row of touching boxes from the front, in three views of a few millimetres a pixel: no pixel
    looks between them."""
    through = farther = pixels = 0
    away, views = 20.0, 3
    part = length / views
    for view in range(views):
        middle = (part * (view + 0.5), height, front)
        camera = look((middle[0], height, front + away), middle, math.degrees(2 * math.atan(part * 0.98 / 40 / away)))
        depths = rig.render(CASES / name, f"front{view}", *camera, size="1280x64").depths()
        pixels += len(depths.metres)
        through += sum(it == 0 for it in depths.metres)
        farther += sum(it > away + 0.02 for it in depths.metres)
    return [row(f"{name} from the front", f"no background between touching boxes in {pixels} pixels",
                f"{through} of background, {farther} behind the front", through + farther == 0)]  # fmt: skip


def closed(rig: Rig) -> list[Row]:
    """flip.stl from all six sides: each ray into the sphere ends at its near side."""
    size, away, fov, inner = 160, 4.0, 35.0, 0.97
    rows = []
    for label, eye in (("front", (0, 0, 1)), ("back", (0, 0, -1)), ("left", (-1, 0, 0)),
                       ("right", (1, 0, 0)), ("top", (0, 1, 0)), ("bottom", (0, -1, 0))):  # fmt: skip
        camera = look([away * it for it in eye], (0, 0, 0), fov, (0, 0, 1) if eye[1] else (0, 1, 0))
        depths = rig.render(CASES / "flip.stl", label, *camera, size=f"{size}x{size}").depths()
        inside = open_ = 0
        for index, depth in enumerate(depths.metres):
            x, y = (((2 * (it + 0.5) / size) - 1) * math.tan(math.radians(fov / 2)) for it in (index % size, index // size))
            # The ray (x, y, 1) t from the eye meets the inner sphere first at this depth.
            squared = 1 + x * x + y * y
            root = away * away - squared * (away * away - inner * inner)
            if root > 0:
                inside += 1
                open_ += depth == 0 or depth > (away - math.sqrt(root)) / squared + 0.01
        rows.append(row(f"flip.stl {label}", f"{inside} pixels closed", f"{open_} open", open_ == 0 and inside > 1000))
    return rows


def visible(rig: Rig, name: str) -> list[Row]:
    depths = rig.render(CASES / name, "framed").depths()
    share = sum(depths.covered()) / len(depths.metres)
    return [row(f"{name} visible", f"at least {VISIBLE:.0%} of the picture", f"{share:.1%}", share >= VISIBLE)]


def textured(rig: Rig, name: str) -> list[Row]:
    """The checker's two colours are seen, neither white nor washed."""
    rendered = rig.render(CASES / name, "framed")
    found = contrast(rendered.shown(), rendered.depths().covered())
    return [row(f"{name} textured", f"colours spread by {TEXTURED} of 255 at least", str(found), found >= TEXTURED)]


def same(rig: Rig) -> list[Row]:
    """The terrain far from the origin looks like the one near it."""
    far, near = (rig.render(CASES / name, "framed") for name in ("utm_obj.obj", "local_obj.obj"))
    off = mean_difference(far.shown(), near.shown())
    drawn = [it.report["drawn"]["triangles"] for it in (far, near)]
    return [row("utm_obj.obj looks as local_obj.obj", "mean difference below 0.5 of 255",
                f"{off:.2f}, drawn {drawn[0]} and {drawn[1]} triangles", off < 0.5)]  # fmt: skip


def emissive(rig: Rig) -> list[Row]:
    """Lit by its texture; until then a warning."""
    rendered = rig.render(CASES / "emissive_only.glb", "framed")
    covered = rendered.depths().covered()
    found = mean(rendered.shown(), covered)
    said = rig.ingest(CASES / "emissive_only.glb").warned("emissive")
    return [later("emissive_only.glb lit", "mean above 60 of 255, until then a warning about its emissive texture",
                  f"mean {found:.0f}; {said or 'no warning'}", found > 60 and any(covered), bool(said))]  # fmt: skip


def glass(rig: Rig) -> list[Row]:
    """Alpha 0.3 over the background, which is one colour a row; until then a warning."""
    shown = rig.render(CASES / "glass.glb", "front", *look((0, 0, 3), (0, 0, 0)), size="96x96").shown()
    differences = []
    for at in range(40 * 96 + 40, 56 * 96 + 40, 96):
        left = at // 96 * 96
        differences.append(sum(abs(plane[at] - plane[left]) for plane in shown.planes[:3]) / 3)
    found = sum(differences) / len(differences)
    said = rig.ingest(CASES / "glass.glb").warned("blend")
    return [later("glass.glb blended", "4 to 60 of 255 off the background, until then a warning about BLEND",
                  f"{found:.0f} off; {said or 'no warning'}", 4 <= found <= 60, bool(said))]  # fmt: skip


def sheet(rig: Rig, name: str, material: str) -> Path:
    """A square in x and y with texture coordinates, as OBJ with a material of these lines."""
    made = rig.folder / "looks"
    made.mkdir(exist_ok=True)
    points, triangles = grid(8, 8, lambda x, z: (x / 8, 0, z / 8))
    text = f"mtllib {name}.mtl\nusemtl m\n" + "".join(f"v {x} {1 - z} 0\nvt {x} {z}\n" for x, _, z in points)
    text += "".join("f " + " ".join(f"{it + 1}/{it + 1}" for it in corners) + "\n" for corners in triangles)
    (made / f"{name}.mtl").write_text(f"newmtl m\nKd 1 1 1\n{material}\n")
    cell = [bytes((230, 20, 20)), bytes((20, 20, 230))]
    cells = (cell[(x // 16 + y // 16) % 2] for y in range(64) for x in range(64))
    (made / "checker.png").write_bytes(png(64, 64, b"".join(cells)))
    (made / f"{name}.obj").write_text(text)
    return made / f"{name}.obj"


MATERIALS = {
    "windows_path": 'map_Kd "D:\\old disk\\checker.png"',
    "lost_glow": "Ke 1 1 1\nmap_Kd checker.png\nmap_Ke lost.png",
    "metal_map": "Pm 1\nPr 0\nmap_Kd checker.png\nmap_Pm lost.png",
    "d_and_tr": "d 1\nTr 1\nmap_Kd checker.png",
    "tr_and_d": "Tr 1\nd 1\nmap_Kd checker.png",
}


def materials(rig: Rig) -> list[Row]:
    """Habits of MTL that must leave the checker of `map_Kd` as it is."""
    rows = []
    for name, material in MATERIALS.items():
        rendered = rig.render(sheet(rig, name, material), "framed")
        found = contrast(rendered.shown(), rendered.depths().covered())
        expected = f"colours spread by {TEXTURED} of 255 at least"
        rows.append(row(f"made {name}.obj", expected, str(found), found >= TEXTURED))
    return rows


def share(rig: Rig, file: Path, label: str, *options) -> float:
    """Covered share of a picture."""
    covered = rig.render(file, label, *options, size="96x96").depths().covered()
    return sum(covered) / len(covered)


def sides(rig: Rig) -> list[Row]:
    """OBJ, PLY and STL are seen from both sides, glTF from the front alone."""
    made = sheet(rig, "sides", "").parent
    (made / "sides.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"
    )
    facets = [((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0), (1, 1, 0), (0, 1, 0))]
    loops = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in corners) for corners in facets]
    text = "".join(f"facet normal 0 0 1\nouter loop\n{it}endloop\nendfacet\n" for it in loops)
    (made / "sides.stl").write_text(f"solid s\n{text}endsolid s\n")
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)]))
    gltf.write(made / "sides.glb")
    rows = []
    for kind in ("obj", "ply", "stl", "glb"):
        front, back = (share(rig, made / f"sides.{kind}", str(z), *look((0.5, 0.5, z), (0.5, 0.5, 0))) for z in (2, -2))
        holds = front > VISIBLE and (back == 0 if kind == "glb" else back > VISIBLE)
        expected = "seen from the front alone" if kind == "glb" else "seen from both sides"
        rows.append(row(f"made sides.{kind}", expected, f"{front:.0%} front, {back:.0%} back", holds))
    return rows


# Alpha of the factor, of the vertices or of the texture, the cutoff, and whether all is drawn.
CUTOFFS = (
    ("factor", 0.5, 0.5, True),
    ("factor", 0.498, 0.5, False),
    ("factor", 0.3, 0.3, True),
    ("factor", 1.0, 1.0, True),
    ("factor", 1.0, 1.1, False),
    ("factor", 0.0, 0.0, True),
    ("color", 0.5, 0.5, True),
    ("color", 128 / 255, 128 / 255, True),
    ("color", 0.25, 0.5, False),
    ("texture", 128 / 255, 128 / 255, True),
    ("texture", 127 / 255, 0.5, False),
    ("texture", 51 / 255, 0.2, True),
)


def cutoff(rig: Rig) -> list[Row]:
    """Alpha equal to the cutoff is kept, a little less is not."""
    rows = []
    for source, alpha, at, kept in CUTOFFS:
        gltf = Gltf()
        points, triangles = grid(4, 4, lambda x, y: (x / 4, 1 - y / 4, 0))
        factor = {"baseColorFactor": [1, 0, 0, alpha if source == "factor" else 1]}
        attributes = {}
        if source == "color":
            colors = array("f", [1, 1, 1, alpha] * len(points))
            attributes["COLOR_0"] = gltf.accessor(colors, "VEC4", 4, 5126)
        if source == "texture":
            factor["baseColorTexture"] = {"index": 0}
            uvs = array("f", [it for x, y, _ in points for it in (x, y)])
            attributes["TEXCOORD_0"] = gltf.accessor(uvs, "VEC2", 2, 5126)
            image = gltf.view(png(8, 8, bytes((255, 255, 255, round(255 * alpha))) * 64, 4))
            gltf.json |= {"textures": [{"source": 0}], "images": [{"bufferView": image, "mimeType": "image/png"}]}
        material = gltf.add("materials", {"pbrMetallicRoughness": factor, "alphaMode": "MASK", "alphaCutoff": at})
        gltf.node(mesh=gltf.mesh(points, triangles, material, **attributes))
        file = gltf.write(rig.folder / f"cutoff_{source}_{alpha:.3f}_{at:.3f}.glb")
        # The square fills the picture.
        found = share(rig, file, "front", *look((0.5, 0.5, 1), (0.5, 0.5, 0)))
        name = f"made alpha {alpha:.3f} of the {source} at cutoff {at:.3f}"
        rows.append(row(name, "all drawn" if kept else "none drawn", f"{found:.1%}", found == float(kept)))
    return rows


def outlier(rig: Rig) -> list[Row]:
    """Twenty boxes, and one 5,400 km away: the default view shows the twenty and says so."""
    gltf = Gltf()
    mesh = gltf.mesh(*cuboid(1, 1, 1))
    for at in range(20):
        gltf.node(mesh=mesh, translation=[2 * (at % 5), 0, 2 * (at // 5)])
    gltf.node(mesh=mesh, translation=[5.4e6, 0, 0])
    rendered = rig.render(gltf.write(rig.folder / "outlier.glb"), "framed")
    covered = rendered.depths().covered()
    found = sum(covered) / len(covered)
    said = "; ".join(rendered.report["warnings"])
    return [row("made outlier", "at least 5% of the picture, and a warning", f"{found:.1%}, {said or 'no warning'}", found >= VISIBLE and bool(said))]
