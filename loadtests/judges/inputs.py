"""Inputs that are made: crowns of leaves, and the rock of make_big.py."""

import json
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np

from programs import MODELS

# Seed of make_big.py: the same rock at every size.
ROCK_SEED = 2
# Triangles of the rocks, millions.
ROCK_MILLIONS = 1
LARGE_ROCK_MILLIONS = 100
# Crowns: name, leaves, columns and rows of quads a leaf.
CROWNS = {"crown_cards": (60_000, 1, 1), "crown_leaves": (15_000, 2, 2)}
LEAF_METRES = 0.12


def write_glb(path: Path, places: np.ndarray, uvs: np.ndarray, corners: np.ndarray, color: tuple) -> Path:
    """One mesh of one material, drawn from both sides."""
    parts = [places.astype("<f4"), uvs.astype("<f4"), corners.astype("<u4")]
    views, at = [], 0
    for part in parts:
        views.append({"buffer": 0, "byteOffset": at, "byteLength": part.nbytes})
        at += part.nbytes
    shown = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [*color, 1], "metallicFactor": 0}, "doubleSided": True}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(places), "type": "VEC3",
             "min": parts[0].min(0).tolist(), "max": parts[0].max(0).tolist()},
            {"bufferView": 1, "componentType": 5126, "count": len(places), "type": "VEC2"},
            {"bufferView": 2, "componentType": 5125, "count": corners.size, "type": "SCALAR"},
        ],
        "bufferViews": views, "buffers": [{"byteLength": at}],
    }  # fmt: skip
    text = json.dumps(shown).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(it.tobytes() for it in parts)
    heads = [struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary)), struct.pack("<I4s", len(text), b"JSON")]
    path.write_bytes(b"".join([*heads, text, struct.pack("<I4s", len(binary), b"BIN\0"), binary]))
    return path


def unit(random: np.random.Generator, count: int) -> np.ndarray:
    at = random.normal(size=(count, 3))
    return at / np.linalg.norm(at, axis=1, keepdims=True)


def crown(path: Path, leaves: int, columns: int, rows: int) -> Path:
    """Leaves that look anywhere, as dense as a tree, in a ball."""
    random = np.random.default_rng(17)
    radius_metres = 0.12 * leaves ** (1 / 3)
    middles = unit(random, leaves) * (radius_metres * random.random((leaves, 1)) ** (1 / 3))
    along, other = unit(random, leaves), unit(random, leaves)
    across = np.cross(along, other)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(along, across)
    t, s = (it.reshape(-1) for it in np.meshgrid(np.linspace(-1, 1, rows + 1), np.linspace(-1, 1, columns + 1), indexing="ij"))
    # Leaves of more than a card are folded along the middle and droop.
    bend = 0.2 * np.abs(s) - 0.15 * t * t if rows > 1 else 0 * s
    shape = along[:, None] * t[None, :, None] + across[:, None] * (s * 0.4)[None, :, None] + up[:, None] * bend[None, :, None]
    places = middles[:, None] + shape * (LEAF_METRES / 2)
    uvs = np.broadcast_to(np.stack([s, t], 1) / 2 + 0.5, (leaves, len(s), 2))
    row, column = (it.reshape(-1) for it in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    first = row * (columns + 1) + column
    above = first + columns + 1
    quads = np.concatenate([np.stack([first, first + 1, above], 1), np.stack([first + 1, above + 1, above], 1)])
    corners = quads[None] + (np.arange(leaves) * len(s))[:, None, None]
    return write_glb(path, places.reshape(-1, 3), uvs.reshape(-1, 2), corners.reshape(-1, 3), (0.2, 0.45, 0.1))


def crowns(folder: Path) -> list[Path]:
    return [crown(folder / f"{name}.glb", *of) for name, of in CROWNS.items()]


def rock(folder: Path, millions: float) -> Path:
    """Made once: it is the same whatever is measured."""
    path = folder / f"rock_{millions:g}M.glb"
    if not path.exists():
        partial = path.with_name("partial.glb")
        maker = MODELS / "make_big.py"
        if not maker.exists():
            raise FileNotFoundError(f"{maker}: expected the generator of the rock")
        subprocess.run([sys.executable, maker, "--million-tris", str(millions), "--seed", str(ROCK_SEED), partial], check=True, capture_output=True)
        partial.rename(path)
    return path
