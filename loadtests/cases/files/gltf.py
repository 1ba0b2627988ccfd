"""An independent reader of glTF 2.0 in f64: sparse, quantized and interleaved accessors, node
matrices, instancing, rest poses."""

import base64
import json
import math
import struct
import urllib.parse
from array import array
from pathlib import Path

from files.surface import IDENTITY, Matrix, Mesh, NotChecked, Scene, times

CODES = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5125: "I", 5126: "f"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
# Normalized integers stand for their share of these; signed ones end at -1.
FULL = {5120: 127.0, 5121: 255.0, 5122: 32767.0, 5123: 65535.0}


def read(path: Path) -> Scene:
    return Document(path).scene()


class Document:
    def __init__(self, path: Path):
        self.path = path
        data = path.read_bytes()
        self.bin = b""
        text = data
        if data[:4] == b"glTF":
            at, text = 12, None
            while at + 8 <= len(data):
                size, kind = struct.unpack_from("<I4s", data, at)
                if kind == b"JSON" and text is None:
                    text = data[at + 8 : at + 8 + size]
                elif kind == b"BIN\0" and not self.bin:
                    self.bin = data[at + 8 : at + 8 + size]
                at += 8 + size
        self.json = json.loads(text.decode("utf-8-sig"))
        self.buffers: dict[int, bytes] = {}

    def all(self, key: str) -> list:
        return self.json.get(key, [])

    def buffer(self, index: int) -> bytes:
        if index not in self.buffers:
            uri = self.all("buffers")[index].get("uri")
            if uri is None:
                self.buffers[index] = self.bin
            elif uri.startswith("data:"):
                self.buffers[index] = base64.b64decode(uri.split(",", 1)[1])
            else:
                self.buffers[index] = (self.path.parent / urllib.parse.unquote(uri)).read_bytes()
        return self.buffers[index]

    def view(self, index: int) -> tuple[dict, bytes]:
        view = self.all("bufferViews")[index]
        for name in view.get("extensions", {}):
            if name.endswith("meshopt_compression"):
                raise NotChecked(f"{name}: compressed")
        start = view.get("byteOffset", 0)
        return view, self.buffer(view["buffer"])[start : start + view["byteLength"]]

    def accessor(self, index: int) -> list[array]:
        """An array a component, as stored."""
        accessor = self.all("accessors")[index]
        code, count = CODES[accessor["componentType"]], int(accessor["count"])
        width, size = WIDTHS[accessor["type"]], struct.calcsize(code)
        if "bufferView" in accessor:
            view, data = self.view(accessor["bufferView"])
            stride = int(view.get("byteStride", 0)) or size * width
            start = int(accessor.get("byteOffset", 0))
            columns = [column(data, start + size * it, stride, code, count) for it in range(width)]
        else:
            columns = [array(code, bytes(size * count)) for _ in range(width)]
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            [places] = self.packed(sparse["indices"], sparse["indices"]["componentType"], 1, sparse["count"])
            values = self.packed(sparse["values"], accessor["componentType"], width, sparse["count"])
            for to, of in zip(columns, values):
                for place, value in zip(places, of):
                    to[place] = value
        return columns

    def packed(self, part: dict, kind: int, width: int, count: int) -> list[array]:
        _, data = self.view(part["bufferView"])
        code, start = CODES[kind], part.get("byteOffset", 0)
        size = struct.calcsize(code)
        return [column(data, start + size * it, size * width, code, count) for it in range(width)]

    def floats(self, index: int) -> list[array]:
        """An array a component, in f64; normalized integers as shares."""
        accessor = self.all("accessors")[index]
        columns = self.accessor(index)
        if accessor.get("normalized"):
            full = FULL[accessor["componentType"]]
            return [array("d", [max(it / full, -1.0) for it in values]) for values in columns]
        return [array("d", values) for values in columns]

    def scene(self) -> Scene:
        meshes: list[Mesh] = []
        placements: list[tuple[int, Matrix]] = []
        known: dict[int, int] = {}
        origins: list[int] = []
        worlds = self.worlds()
        nodes = self.all("nodes")
        for index, matrices in worlds:
            node = nodes[index]
            if "mesh" not in node:
                continue
            number = known.get(node["mesh"])
            if number is None or "skin" in node or self.moves(node):
                number = len(meshes)
                meshes.append(self.mesh(node["mesh"], node))
                origins.append(node["mesh"])
                if "skin" not in node and not self.moves(node):
                    known[node["mesh"]] = number
            # A skinned mesh stands where its joints say, whatever its node says.
            placements += [(number, IDENTITY if "skin" in node else matrix) for matrix in matrices]
        return Scene(meshes, placements, origins)

    def moves(self, node: dict) -> bool:
        weights = node.get("weights") or self.all("meshes")[node["mesh"]].get("weights") or []
        return any(weights)

    def roots(self) -> list[int]:
        scenes = self.all("scenes")
        if scenes:
            return scenes[self.json.get("scene", 0)].get("nodes", [])
        children = {child for node in self.all("nodes") for child in node.get("children", [])}
        return [it for it in range(len(self.all("nodes"))) if it not in children]

    def worlds(self) -> list[tuple[int, list[Matrix]]]:
        """The visible nodes of the scene and their world matrices: one, or one an instance."""
        nodes, found = self.all("nodes"), []
        if not nodes:
            self.json["nodes"] = [{"mesh": it} for it in range(len(self.all("meshes")))]
            return [(it, [IDENTITY]) for it in range(len(self.json["nodes"]))]
        waiting = [(root, IDENTITY) for root in self.roots()]
        while waiting:
            index, parent = waiting.pop()
            node = nodes[index]
            extensions = node.get("extensions", {})
            if extensions.get("KHR_node_visibility", {}).get("visible") is False:
                continue
            world = times(parent, local(node))
            instances = extensions.get("EXT_mesh_gpu_instancing")
            matrices = [times(world, it) for it in self.instances(instances)] if instances else [world]
            found.append((index, matrices))
            waiting += [(child, world) for child in node.get("children", [])]
        return found

    def instances(self, extension: dict) -> list[Matrix]:
        parts = {name.lower(): list(zip(*self.floats(of))) for name, of in extension["attributes"].items() if not name.startswith("_")}
        count = len(next(iter(parts.values())))
        return [local({name: of[it] for name, of in parts.items()}) for it in range(count)]

    def mesh(self, index: int, node: dict) -> Mesh:
        positions, triangles = array("d"), array("I")
        weights = node.get("weights") or self.all("meshes")[index].get("weights") or []
        for primitive in self.all("meshes")[index]["primitives"]:
            if any(name.endswith("draco_mesh_compression") for name in primitive.get("extensions", {})):
                raise NotChecked("KHR_draco_mesh_compression: compressed")
            mode = primitive.get("mode", 4)
            if mode not in (4, 5, 6) or "POSITION" not in primitive["attributes"]:
                continue
            axes = self.floats(primitive["attributes"]["POSITION"])
            for weight, target in zip(weights, primitive.get("targets", [])):
                if weight and "POSITION" in target:
                    deltas = self.floats(target["POSITION"])
                    axes = [array("d", [a + weight * d for a, d in zip(*pair)]) for pair in zip(axes, deltas)]
            if "skin" in node:
                axes = self.posed(axes, primitive["attributes"], node["skin"])
            first, count = len(positions) // 3, len(axes[0])
            flat = array("d", bytes(24 * count))
            for axis, values in enumerate(axes):
                flat[axis::3] = values
            positions += flat
            order = self.accessor(primitive["indices"])[0] if "indices" in primitive else range(count)
            triangles += array("I", [first + it for it in corners(order, mode)])
        return Mesh(positions, triangles)

    def posed(self, axes: list[array], attributes: dict, skin: int) -> list[array]:
        """Vertices moved by their joints: inverse bind matrix, then the joint's world matrix."""
        worlds = {index: matrices[0] for index, matrices in self.everywhere()}
        skin = self.all("skins")[skin]
        inverse = [IDENTITY] * len(skin["joints"])
        if "inverseBindMatrices" in skin:
            stored = zip(*self.floats(skin["inverseBindMatrices"]))
            inverse = [tuple(tuple(it[row + 4 * column] for column in range(4)) for row in range(3)) for it in stored]
        joints = [times(worlds.get(joint, IDENTITY), bind) for joint, bind in zip(skin["joints"], inverse)]
        posed = [array("d", bytes(8 * len(axes[0]))) for _ in range(3)]
        shares: list[tuple] = []
        for number in range(8):
            if f"JOINTS_{number}" in attributes and f"WEIGHTS_{number}" in attributes:
                shares += zip(self.accessor(attributes[f"JOINTS_{number}"]), self.floats(attributes[f"WEIGHTS_{number}"]))
        for vertex, at in enumerate(zip(*axes)):
            mine = [(joint[vertex], weight[vertex]) for joint, weight in shares if weight[vertex]]
            total = sum(weight for _, weight in mine) or 1.0
            for axis in range(3):
                value = 0.0
                for joint, weight in mine:
                    a, b, c, d = joints[joint][axis]
                    value += weight / total * (a * at[0] + b * at[1] + c * at[2] + d)
                posed[axis][vertex] = value
        return posed

    def everywhere(self) -> list[tuple[int, list[Matrix]]]:
        """All nodes, also those that stand in no scene: joints may."""
        nodes = self.all("nodes")
        children = {child for node in nodes for child in node.get("children", [])}
        waiting = [(it, IDENTITY) for it in range(len(nodes)) if it not in children]
        found = []
        while waiting:
            index, parent = waiting.pop()
            world = times(parent, local(nodes[index]))
            found.append((index, [world]))
            waiting += [(child, world) for child in nodes[index].get("children", [])]
        return found

    def image(self, index: int) -> bytes:
        image = self.all("images")[index]
        if "bufferView" in image:
            return self.view(image["bufferView"])[1]
        return (self.path.parent / urllib.parse.unquote(image["uri"])).read_bytes()


def column(data: bytes, start: int, stride: int, code: str, count: int) -> array:
    size = struct.calcsize(code)
    values = array(code)
    if count == 0:
        return values
    if stride % size:
        return array(code, [struct.unpack_from("<" + code, data, start + stride * it)[0] for it in range(count)])
    values.frombytes(data[start : start + stride * (count - 1) + size])
    return values[:: stride // size]


def corners(order, mode: int):
    """Corners of the triangles of a list, a strip or a fan."""
    if mode == 4:
        return order[: len(order) // 3 * 3]
    found = []
    for it in range(len(order) - 2):
        if mode == 6:
            found += (order[it + 1], order[it + 2], order[0])
        else:
            found += (order[it], order[it + 1 + it % 2], order[it + 2 - it % 2])
    return found


def local(node: dict) -> Matrix:
    if "matrix" in node:
        stored = [float(it) for it in node["matrix"]]
        return tuple(tuple(stored[row + 4 * column] for column in range(4)) for row in range(3))
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    length = math.hypot(x, y, z, w)
    x, y, z, w = (it / length for it in (x, y, z, w)) if length else (0.0, 0.0, 0.0, 1.0)
    scale, move = node.get("scale", (1, 1, 1)), node.get("translation", (0, 0, 0))
    turn = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return tuple(tuple([*(a * b for a, b in zip(row, scale)), float(at)]) for row, at in zip(turn, move))
