#!/usr/bin/env python3
"""The Khronos models beside the pictures that their makers expect, for `make report`.

    sheets.py FOLDER

Writes FOLDER/sheets-khronos.json: a row a model, the expected picture to the left and ours to the
right. Generated models have the camera of their manifest; the others are looked at from about the
side that the expected picture shows."""

import base64
import json
import math
import os
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

sys.dont_write_bytecode = True
import boxes
from files.picture import Picture, png, read_png
from rig import KHRONOS, ROOT, Failed, Rig, look

FOV_DEGREES = 45.0
# Widths of a thumbnail: generated models have one feature each.
WIDE_PX, NARROW_PX = 192, 128
# From the middle of the model to the eye, where the expected picture is no view along -z.
DIRECTIONS = {
    "BoxVertexColors": (-0.4, 0.5, 1.0),
    "CesiumMan": (0.9, 0.15, -0.45),
    "CesiumMilkTruck": (0.7, 0.25, -1.0),
    "DamagedHelmet": (0.7, 0.1, 0.7),
    "MultiUVTest": (0.5, 0.4, 1.0),
    "TwoSidedPlane": (0.3, 0.5, 1.0),
}
# Ours is drawn so many times as large and averaged.
FINER = 2


@dataclass
class Pair:
    model: Path
    expected: Path
    eye: list[float]
    target: list[float]
    width: int


def pairs() -> list[Pair]:
    found = []
    for expected in sorted(KHRONOS.glob("*/expected.png")):
        [model] = [it for it in expected.parent.iterdir() if it.suffix in (".glb", ".gltf")]
        box, shown = boxes.read(model).box(), read_png(expected)
        middle = box.middle()
        direction = DIRECTIONS.get(model.stem, (0.0, 0.0, 1.0))
        across, up, deep = box.size()
        if model.stem in DIRECTIONS:
            across = up = deep = box.diagonal() * 0.8
        # The tighter side fills nine tenths of the picture.
        half = max(up, across * shown.height / shown.width) / 2 / 0.9
        away = (half / math.tan(math.radians(FOV_DEGREES / 2)) + deep / 2) / math.hypot(*direction)
        eye = [a + away * b for a, b in zip(middle, direction)]
        found.append(Pair(model, expected, eye, middle, WIDE_PX))
    for manifest in sorted(KHRONOS.glob("*/*/Manifest.json")):
        for entry in json.loads(manifest.read_text())["models"]:
            expected = manifest.parent / "expected" / Path(entry["sampleImageName"]).name
            if expected.exists():
                eye = entry["camera"]["translation"]
                # The folder's README says along -z; the pictures taken from aside show the origin.
                found.append(Pair(manifest.parent / entry["fileName"], expected, eye, [0, 0, 0], NARROW_PX))
    return found


def scaled(shown: Picture, width: int, height: int) -> list[bytearray]:
    """Red, green and blue averaged over boxes, on white where the picture is clear."""
    planes = []
    for plane in shown.planes[:3]:
        small = bytearray(width * height)
        for y in range(height):
            rows = range(y * shown.height // height, max((y + 1) * shown.height // height, y * shown.height // height + 1))
            for x in range(width):
                left, right = x * shown.width // width, max((x + 1) * shown.width // width, x * shown.width // width + 1)
                spans = [slice(row * shown.width + left, row * shown.width + right) for row in rows]
                total = sum(sum(plane[it]) for it in spans)
                count = len(rows) * (right - left)
                if len(shown.planes) > 3:
                    alpha = sum(sum(shown.planes[3][it]) for it in spans) / count / 255
                    small[y * width + x] = int(total / count * alpha + 255 * (1 - alpha))
                else:
                    small[y * width + x] = total // count
        planes.append(small)
    return planes


def pair_row(rig: Rig, pair: Pair) -> dict:
    wanted = read_png(pair.expected)
    width, height = pair.width, round(pair.width * wanted.height / wanted.width)
    halves, note = [scaled(wanted, width, height)], ""
    try:
        camera = look(pair.eye, pair.target, FOV_DEGREES)
        shown = rig.render(pair.model, "sheet", *camera, size=f"{FINER * width}x{FINER * height}").shown()
        halves.append(scaled(shown, width, height))
    except Failed as error:
        note = str(error)
    picture = bytearray()
    for y in range(height):
        for half in halves:
            for pixel in zip(*(plane[y * width : (y + 1) * width] for plane in half)):
                picture += bytes(pixel)
    data = png(width * len(halves), height, bytes(picture))
    return {"model": pair.model.stem, "png": base64.b64encode(data).decode(), "note": note}


def main() -> None:
    out = Path(sys.argv[1])
    if not KHRONOS.is_dir():
        print(f"SKIPPED: contact sheets of {KHRONOS}, which is not there")
        return
    binaries = (ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release").resolve()
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(binaries, Path(folder) / "sheets")
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            rows = list(pool.map(lambda pair: pair_row(rig, pair), pairs()))
    (out / "sheets-khronos.json").write_text(json.dumps({"rows": rows}))
    failed = sum(bool(it["note"]) for it in rows)
    print(f"{len(rows)} models beside their expected pictures, {failed} not drawn")


if __name__ == "__main__":
    main()
