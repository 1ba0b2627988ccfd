"""Independent readers of OBJ, PLY and STL in f64. Polygons stay loops, which have an area."""

import re
import struct
from array import array
from dataclasses import dataclass
from pathlib import Path

from files.surface import IDENTITY, Mesh, Scene, polygon_area

BOM = b"\xef\xbb\xbf"
CODES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip


@dataclass
class Polygons:
    """Vertices and the polygons over them."""

    vertices: list[tuple[float, float, float]]
    loops: list[list[int]]

    def area(self) -> float:
        return sum(polygon_area([self.vertices[it] for it in loop]) for loop in self.loops)

    def scene(self) -> Scene:
        """Fans: right for the box and the count, not for the area of a concave polygon."""
        triangles = array("I")
        for loop in self.loops:
            for b, c in zip(loop[1:], loop[2:]):
                triangles.extend((loop[0], b, c))
        return Scene([Mesh(array("d", [it for at in self.vertices for it in at]), triangles)], [(0, IDENTITY)])


def read(path: Path) -> Polygons:
    data = path.read_bytes().removeprefix(BOM)
    return {".obj": obj, ".ply": ply, ".stl": stl}[path.suffix.lower()](data)


def obj(data: bytes) -> Polygons:
    vertices, loops = [], []
    for line in data.decode("utf-8", "replace").replace("\\\n", " ").splitlines():
        parts = line.split("#")[0].split()
        if parts[:1] == ["v"]:
            vertices.append(tuple(float(it) for it in parts[1:4]))
        elif parts[:1] == ["f"]:
            corners = [int(it.split("/")[0]) for it in parts[1:]]
            loops.append([it - 1 if it > 0 else len(vertices) + it for it in corners])
    return Polygons(vertices, loops)


def ply(data: bytes) -> Polygons:
    end = re.search(rb"end_header\r?\n", data)
    elements, form = [], ""
    for line in data[: end.start()].decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            form = words[1]
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    reader = PlyText(data[end.end() :]) if form == "ascii" else PlyBytes(data[end.end() :], "<" if "little" in form else ">")
    vertices, loops = [], []
    for name, count, properties in elements:
        for _ in range(count):
            row = {}
            for words in properties:
                if words[0] == "list":
                    row[words[3]] = [reader.value(words[2]) for _ in range(int(reader.value(words[1])))]
                else:
                    row[words[1]] = reader.value(words[0])
            if name == "vertex":
                vertices.append((row["x"], row["y"], row["z"]))
            elif name in ("face", "tristrips"):
                corners = [int(it) for it in row.get("vertex_indices", row.get("vertex_index", []))]
                loops += [corners] if name == "face" else strips(corners)
    return Polygons(vertices, loops)


class PlyText:
    def __init__(self, data: bytes):
        self.words = iter(data.split())

    def value(self, _kind: str) -> float:
        return float(next(self.words))


class PlyBytes:
    def __init__(self, data: bytes, order: str):
        self.data, self.at = data, 0
        self.forms = {kind: struct.Struct(order + code) for kind, code in CODES.items()}

    def value(self, kind: str) -> float:
        form = self.forms[kind]
        [value] = form.unpack_from(self.data, self.at)
        self.at += form.size
        return value


def strips(corners: list[int]) -> list[list[int]]:
    """Triangles of strips that -1 ends; stitches, which name a corner twice, are none."""
    found, strip = [], []
    for corner in [*corners, -1]:
        if corner >= 0:
            strip.append(corner)
            continue
        for it in range(len(strip) - 2):
            triangle = [strip[it], strip[it + 1 + it % 2], strip[it + 2 - it % 2]]
            if len(set(triangle)) == 3:
                found.append(triangle)
        strip = []
    return found


def stl(data: bytes) -> Polygons:
    """By length: as many facets of 50 bytes as follow the header, whatever its count says."""
    at = []
    text = data[:5].lower() == b"solid" and b"facet" in data[:1000]
    if text:
        at = [tuple(map(float, it.split())) for it in re.findall(rb"vertex\s+(\S+\s+\S+\s+\S+)", data)]
    else:
        for start in range(84, len(data) - 49, 50):
            values = struct.unpack_from("<9f", data, start + 12)
            at += [values[0:3], values[3:6], values[6:9]]
    return Polygons(at, [[it, it + 1, it + 2] for it in range(0, len(at), 3)])
