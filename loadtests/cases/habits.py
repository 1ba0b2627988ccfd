"""Habits of exporters, each put into a small model that is known: triangles, box, and the warning
where one is due."""

import json
import struct
from array import array
from dataclasses import dataclass
from pathlib import Path

import boxes
from files.picture import png
from files.surface import IDENTITY, Mesh, Scene
from files.writer import Gltf, cuboid, glb
from made import folder
from rig import Rig
from rows import Row, row, short

BOM = b"\xef\xbb\xbf"
POINTS, TRIANGLES = cuboid(1.5, 0.75, 2.25)
NAN = float("nan")


@dataclass
class Habit:
    """Without `triangles` the file must be refused. Some warning has each of `warns`."""

    name: str
    data: bytes
    triangles: int | None = len(TRIANGLES)
    warns: tuple[str, ...] = ()


def obj(head: str = "", face: str = "{0}", tail: str = "") -> bytes:
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS)
    faces = "".join("f " + " ".join(face.format(it + 1) for it in corners) + "\n" for corners in TRIANGLES)
    return (head + vertices + faces + tail).encode()


def ply(points: list, vertex: str = "float") -> bytes:
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n" + "".join(f"property {vertex} {it}\n" for it in "xyz")
    header += f"element face {len(TRIANGLES)}\nproperty list uchar int vertex_indices\nend_header\n"
    lines = [" ".join(map(str, at)) for at in points] + [f"3 {a} {b} {c}" for a, b, c in TRIANGLES]
    return (header + "\n".join(lines) + "\n").encode()


def stl(head: bytes, count: int, extra: bytes = b"") -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *(it for corner in corners for it in POINTS[corner]), 0) for corners in TRIANGLES)
    return head.ljust(80) + struct.pack("<I", count) + facets + extra


def stl_text(vertex: str = "") -> bytes:
    facets = ["facet normal 0 0 0\nouter loop\n" + "".join("vertex {} {} {}\n".format(*POINTS[it]) for it in corners) + "endloop\nendfacet\n"
              for corners in TRIANGLES]  # fmt: skip
    return ("solid x\n" + "".join(facets) + vertex + "endsolid x\n").encode()


LOST = "facet normal 0 0 0\nouter loop\nvertex nan 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
NAN_FACET = struct.pack("<12fH", 0, 0, 0, NAN, 0, 0, 1, 0, 0, 0, 1, 0, 0)


def texts() -> list[Habit]:
    count = len(TRIANGLES)
    return [
        Habit("mark.obj", BOM + obj()),
        Habit("mark.ply", BOM + ply(POINTS)),
        Habit("mark_text.stl", BOM + stl_text()),
        Habit("zero_normal.obj", obj("vn 0 1 0\n", "{0}//0")),
        Habit("zero_uv.obj", obj("vt 0 0\n", "{0}/0/0")),
        Habit("absent_vt.obj", obj("", "{0}/{0}")),
        Habit("absent_vn.obj", obj("", "{0}//{0}")),
        Habit("absent_both.obj", obj("", "{0}/{0}/{0}")),
        Habit("vt_beyond.obj", obj("vt 0 0\n", "{0}/{0}")),
        Habit("unused_nan.obj", obj(tail="v nan nan nan\n")),
        Habit("unused_nan.ply", ply([*POINTS, (NAN, 0, 0)])),
        Habit("nan_facet.stl", stl(b"binary", count + 1, NAN_FACET), count, ("facet",)),
        Habit("nan_facet_text.stl", stl_text(LOST), count, ("facet",)),
        Habit("solid_binary.stl", stl(b"solid but binary", count)),
        Habit("count_zero.stl", stl(b"binary", 0), count, ("count",)),
        Habit("count_large.stl", stl(b"binary", 10**9), None),
        Habit("windows.obj", obj("mtllib windows.mtl\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\n", "{0}/1")),
        Habit("marked_mtl.obj", obj("mtllib marked.mtl\nusemtl m\n")),
        Habit("lowercase.ply", ply(POINTS, "double")),
        Habit("windows_lines.obj", obj().replace(b"\n", b"\r\n")),
        Habit("strips.ply", strips()),
        Habit("long_line.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x " + b"x" * 5000 + b"\nend_header\n", None),
    ]


def strips() -> bytes:
    """The two big faces of a box as one list of strips; -1 ends each."""
    header = "ply\nformat ascii 1.0\nelement vertex 8\n" + "".join(f"property float {it}\n" for it in "xyz")
    header += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    strip = [0, 1, 4, 5, 6, 7, 2, 3, 0, 1, -1, 0, 4, 2, 6, -1, 1, 3, 5, 7, -1]
    return (header + "\n".join(" ".join(map(str, at)) for at in POINTS) + f"\n{len(strip)} {' '.join(map(str, strip))}\n").encode()


def model() -> Gltf:
    gltf = Gltf()
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.2, 0.2, 1]}})
    gltf.node(mesh=gltf.mesh(POINTS, TRIANGLES, 0))
    return gltf


def textured(**image) -> Gltf:
    gltf = model()
    uvs = gltf.accessor(array("f", [it for x, y, z in POINTS for it in (x, y)]), "VEC2", 2, 5126)
    gltf.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uvs
    gltf.json["materials"][0]["pbrMetallicRoughness"] = {"baseColorTexture": {"index": 0}}
    gltf.json |= {"textures": [{"source": 0}], "images": [image]}
    return gltf


def with_image(data: bytes, kind: str) -> Gltf:
    gltf = textured(mimeType=kind)
    gltf.json["images"][0]["bufferView"] = gltf.view(data)
    return gltf


def requiring(name: str, **more) -> Gltf:
    gltf = model()
    gltf.json |= {"extensionsUsed": [name], "extensionsRequired": [name], **more}
    return gltf


def plain(gltf: Gltf) -> bytes:
    return glb(gltf.text(), gltf.binary)


def changed(**fields) -> Gltf:
    gltf = model()
    gltf.json |= fields
    return gltf


def gltfs() -> list[Habit]:
    count = len(TRIANGLES)
    animated = model()
    times = animated.accessor(array("f", [0, 1]), "SCALAR", 1, 5126)
    moves = animated.accessor(array("f", [0] * 6), "VEC3", 3, 5126)
    animated.json["animations"] = [{"channels": [{"sampler": 0, "target": {"path": "translation"}}], "samplers": [{"input": times, "output": moves}]}]
    pointer = model()
    pointer.json["animations"] = [{"channels": [{"sampler": "x", "target": 7}], "samplers": None}]
    unread = model()
    unread.json["buffers"].append({"byteLength": 64, "extensions": {"EXT_meshopt_compression": {"fallback": True}}})
    lights = requiring("KHR_lights_punctual", extensions={"KHR_lights_punctual": {"lights": [{"type": "point"}]}})
    lights.json["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    hidden = requiring("KHR_node_visibility")
    hidden.node(mesh=0, translation=[50, 0, 0], extensions={"KHR_node_visibility": {"visible": False}})
    twice = model()
    twice.node(children=[0], translation=[0, 0, 0])
    colors = model()
    shades = colors.accessor(array("B", [255, 0, 0, 255] * len(POINTS)), "VEC4", 4, 5121)
    colors.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = shades
    whole = model()
    text = json.dumps(whole.json)
    for key in ("count", "byteLength", "byteOffset", "componentType", "mesh", "indices", "bufferView", "buffer"):
        text = floats(text, key)
    blend = model()
    blend.json["materials"][0] |= {"alphaMode": "BLEND"}
    gloss = requiring("KHR_materials_pbrSpecularGlossiness")
    gloss.json["materials"][0] = {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1]}}}
    return [
        Habit("mark_chunk.glb", glb(BOM + model().text(), model().binary)),
        Habit("whole_numbers_as_floats.glb", glb(text.encode(), whole.binary)),
        Habit("channel_without_node.glb", plain(animated)),
        Habit("broken_animation.glb", plain(pointer)),
        Habit("unread_buffer.glb", plain(unread)),
        Habit("lights_required.glb", plain(lights)),
        Habit("hidden_node.glb", plain(hidden)),
        Habit("transform_required.glb", plain(requiring("KHR_texture_transform"))),
        Habit("root_and_child.glb", plain(twice), count, ("",)),
        Habit("colors_not_normalized.glb", plain(colors)),
        Habit("blend.glb", plain(blend), count, ("blend",)),
        Habit("glossiness.glb", plain(gloss)),
        Habit("missing_image.glb", plain(textured(uri="lost%20picture.jpg")), count, ("lost picture.jpg",)),
        Habit("escaped_image.glb", plain(textured(uri="50%_done.png")), count, ("50%_done.png",)),
        Habit("http_image.glb", plain(textured(uri="https://example.invalid/a.png")), count, ("example.invalid/a.png",)),
        Habit("parent_image.glb", plain(textured(uri="../../etc/a.png")), count, ("a.png",)),
        Habit("broken_image.glb", plain(with_image(b"\x89PNG\r\n\x1a\nbroken", "image/png")), count, ("images[0]",)),
        Habit("no_image.glb", plain(with_image(b"hello, world", "image/png")), count, ("images[0]",)),
        Habit("mistyped_image.glb", plain(with_image(b"RIFF\x10\0\0\0WEBPVP8 ", "image/jpeg")), count, ("images[0]",)),
        Habit("unknown_required.glb", plain(requiring("VENDOR_sparkles")), None),
        Habit("no_triangle.glb", plain(changed(nodes=[{}])), None),
    ]


def floats(text: str, key: str) -> str:
    """Integers behind the key as `1.0`."""
    parts = text.split(f'"{key}": ')
    for at, part in enumerate(parts[1:], 1):
        digits = len(part) - len(part.lstrip("0123456789"))
        parts[at] = part[:digits] + (".0" if digits else "") + part[digits:]
    return f'"{key}": '.join(parts)


def expected() -> Scene:
    flat = array("d", [it for at in POINTS for it in at])
    return Scene([Mesh(flat, array("I", [it for corners in TRIANGLES for it in corners]))], [(0, IDENTITY)])


def habits(rig: Rig, kind: str) -> list[Row]:
    made = folder(rig)
    rows = []
    (made / "windows.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd C:\\Users\\me\\tex\\windows.png\n")
    (made / "marked.mtl").write_bytes(BOM + b"newmtl m\nKd 1 0 0\n")
    (made / "windows.png").write_bytes(png(2, 2, bytes((255, 0, 0, 0, 0, 255, 0, 0, 255, 255, 0, 0))))
    for habit in {"texts": texts, "gltf": gltfs}[kind]():
        file = made / habit.name
        file.write_bytes(habit.data)
        rows.append(judged(rig, file, habit))
    return rows


def judged(rig: Rig, file: Path, habit: Habit) -> Row:
    run, ingested = rig.try_ingest(file)
    expects = "refused in one short line" if habit.triangles is None else f"{habit.triangles} triangles, the box of the plain file"
    expects += "".join(f", a warning {f'with {it}' if it else ''}" for it in habit.warns)
    name = f"habit {habit.name}"
    if habit.triangles is None:
        line = run.err.strip()
        holds = run.code == 1 and line.count("\n") == 0 and len(line) <= 300 + len(str(file)) and file.name in line
        return row(name, expects, short(f"exit {run.code}: {line}"), holds)
    if ingested is None:
        return row(name, expects, short(f"exit {run.code}: {run.err}"), False)
    rig.ingested[str(file)] = ingested
    faults = [f"no warning with {it}: {ingested.warnings}" for it in habit.warns if not ingested.warned(it)]
    if ingested.triangles != habit.triangles:
        faults.append(f"{ingested.triangles} triangles")
    faults += boxes.box_faults(expected(), rig.export(file))
    return row(name, expects, short("; ".join(faults) or f"{ingested.triangles} triangles"), not faults)
