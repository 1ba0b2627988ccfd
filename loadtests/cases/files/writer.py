"""Writes generated models: glTF with one buffer, and the triangles of small shapes."""

import json
import math
import struct
from array import array
from pathlib import Path

Point = tuple[float, float, float]


class Gltf:
    """`json` may be changed at will before it is written."""

    def __init__(self):
        self.binary = b""
        self.json: dict = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}],
        }  # fmt: skip

    def add(self, key: str, item: dict) -> int:
        self.json.setdefault(key, []).append(item)
        return len(self.json[key]) - 1

    def view(self, data: bytes) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        item = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        self.binary += data
        self.json["buffers"][0]["byteLength"] = len(self.binary)
        return self.add("bufferViews", item)

    def accessor(self, values: array, kind: str, width: int, component: int, **more) -> int:
        item = {"bufferView": self.view(values.tobytes()), "componentType": component, "count": len(values) // width, "type": kind, **more}
        if kind == "VEC3" and values:
            item |= {"min": [min(values[it::3]) for it in range(3)], "max": [max(values[it::3]) for it in range(3)]}
        return self.add("accessors", item)

    def mesh(self, points: list[Point], triangles: list[tuple], material: int | None = None, **attributes: int) -> int:
        flat = array("f", [it for at in points for it in at])
        order = array("I", [it for corners in triangles for it in corners])
        primitive = {"attributes": {"POSITION": self.accessor(flat, "VEC3", 3, 5126), **attributes}, "indices": self.accessor(order, "SCALAR", 1, 5125)}
        if material is not None:
            primitive["material"] = material
        return self.add("meshes", {"primitives": [primitive]})

    def node(self, **fields) -> int:
        """A node that is a root of the scene."""
        index = self.add("nodes", fields)
        self.json["scenes"][0]["nodes"].append(index)
        return index

    def unlit(self, red: float, green: float, blue: float, **more) -> int:
        self.json["extensionsUsed"] = ["KHR_materials_unlit"]
        factor = {"baseColorFactor": [red, green, blue, 1], "metallicFactor": 0}
        return self.add("materials", {"pbrMetallicRoughness": factor, "extensions": {"KHR_materials_unlit": {}}, **more})

    def text(self) -> bytes:
        return json.dumps(self.json).encode()

    def write(self, path: Path, mark: bytes = b"") -> Path:
        """A .glb; `mark` goes before the JSON."""
        path.write_bytes(glb(mark + self.text(), self.binary))
        return path

    def write_apart(self, path: Path, text: bytes | None = None) -> Path:
        """A .gltf with its buffer beside it."""
        self.json["buffers"][0]["uri"] = path.stem + ".bin"
        path.with_suffix(".bin").write_bytes(self.binary)
        path.write_bytes(self.text() if text is None else text)
        return path


def glb(text: bytes, binary: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def grid(columns: int, rows: int, place) -> tuple[list[Point], list[tuple]]:
    """A sheet of quads that faces +y where x goes right and z towards the eye."""
    points = [place(column, row) for row in range(rows + 1) for column in range(columns + 1)]
    triangles = []
    for row in range(rows):
        for column in range(columns):
            at = row * (columns + 1) + column
            below = at + columns + 1
            triangles += [(at, below, at + 1), (at + 1, below, below + 1)]
    return points, triangles


def cuboid(x: float, y: float, z: float) -> tuple[list[Point], list[tuple]]:
    points = [(x * (it & 1), y * (it >> 1 & 1), z * (it >> 2)) for it in range(8)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return points, [corners for a, b, c, d in quads for corners in ((a, b, c), (a, c, d))]


def waves(x: float, z: float) -> float:
    """Height of a rough terrain with features of 0.5 to 8 m, metres."""
    return sum(noise(x / size, z / size) * size * 0.22 for size in (8.0, 3.1, 1.3, 0.5))


def noise(x: float, z: float, period: int = 0) -> float:
    """Smooth values of -1 to 1 between those of whole places; the same again after the period."""
    a, b = math.floor(x), math.floor(z)
    u, v = (t * t * (3 - 2 * t) for t in (x - a, z - b))
    corners = [spread((a + i) % period if period else a + i, (b + j) % period if period else b + j) for j in (0, 1) for i in (0, 1)]
    return (corners[0] * (1 - u) + corners[1] * u) * (1 - v) + (corners[2] * (1 - u) + corners[3] * u) * v


def spread(a: int, b: int) -> float:
    mixed = (a * 374761393 + b * 668265263) & 0xFFFFFFFF
    mixed = ((mixed ^ (mixed >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((mixed ^ (mixed >> 16)) & 0xFFFF) / 32767.5 - 1
