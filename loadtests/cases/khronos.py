"""The Khronos models: triangles, boxes, and the warnings of what is not drawn yet."""

from pathlib import Path

import boxes
from files import gltf
from rig import KHRONOS, Rig
from rows import Row, row


def files() -> list[Path]:
    return sorted(it for it in KHRONOS.rglob("*.gl*") if it.suffix in (".glb", ".gltf"))


def model(rig: Rig, file: Path) -> list[Row]:
    rows = boxes.model(rig, file)
    document = gltf.Document(file)
    if any(it.get("alphaMode") == "BLEND" for it in document.all("materials")):
        said = rig.ingest(file).warned("blend")
        rows.append(row(f"{file.stem} warning", "a warning that BLEND is approximated", said or "none", bool(said)))
    return rows
