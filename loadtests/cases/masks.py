"""Cover of masked foliage while the camera backs off, by the colour test of alpha.py."""

import math
import random
from array import array
from pathlib import Path

from files import gltf
from files.picture import Picture, count, png, read_png
from files.writer import Gltf, grid
from rig import Rig
from rows import Row, row

# Card sizes in pixels; the smallest is the goal of the README's table.
SIZES = (500.0, 200.0, 100.0, 50.0, 32.0, 19.0, 12.0, 8.0)
# The same card at offsets of an eighth of a pixel both ways: at 8 px one picture has seven leaf
# pixels.
OFFSETS = 8
SHARE = 0.05
# Texels of a side of the generated card.
SIDE = 256
FOV_DEGREES = 45.0


def cover(rig: Rig, file: Path) -> list[Row]:
    """Mean cover over 64 offsets, as a share of the card's area, within 5 % of the texture's."""
    name, document = file.name, gltf.Document(file)
    alphas = read_png(document.image(0)).planes[3]
    cutoff = 255 * document.all("materials")[0].get("alphaCutoff", 0.5)
    own = sum(it >= cutoff for it in alphas) / len(alphas)
    rows = []
    for card_px in SIZES:
        pictures = offsets(rig, file, card_px)
        found = sum(map(leaf_pixels, pictures)) / len(pictures) / card_px**2
        rows.append(row(f"{name} at {card_px:.0f} px", f"cover {own:.3f} within {SHARE:.0%}",
                        f"{found:.3f} ({found / own - 1:+.1%})", abs(found / own - 1) <= SHARE))  # fmt: skip
    return rows


def generated(rig: Rig) -> list[Row]:
    """Soft discs with another cutoff: a card like those of ../shared/cases."""
    gltf = Gltf()
    points, triangles = grid(4, 4, lambda x, y: (x / 4 - 0.5, 1 - y / 4, 0.0))
    uvs = gltf.accessor(array("f", [it for x, y, _ in points for it in (x + 0.5, 1 - y)]), "VEC2", 2, 5126)
    leaves = gltf.unlit(1, 1, 1, alphaMode="MASK", alphaCutoff=0.35, doubleSided=True)
    gltf.json["materials"][leaves]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    image = gltf.view(png(SIDE, SIDE, b"".join(bytes((40, 160, 40, it)) for it in discs()), 4))
    gltf.json |= {"textures": [{"source": 0}], "images": [{"bufferView": image, "mimeType": "image/png"}]}
    gltf.node(mesh=gltf.mesh(points, triangles, leaves, TEXCOORD_0=uvs))
    return cover(rig, gltf.write(rig.folder / "discs.glb"))


def discs() -> list[int]:
    """Alpha of sixty discs of many sizes that fade over six texels; the card's sides wrap."""
    chance = random.Random(13)
    alphas = [0.0] * SIDE * SIDE
    for _ in range(60):
        middle, radius = [chance.uniform(0, SIDE) for _ in range(2)], chance.uniform(3, 14)
        reach = math.ceil(radius + 4)
        for y in range(-reach, reach):
            for x in range(-reach, reach):
                away = math.hypot(x, y)
                at = (round(middle[1]) + y) % SIDE * SIDE + (round(middle[0]) + x) % SIDE
                alphas[at] = max(alphas[at], min(1.0, (radius + 3 - away) / 6))
    return [round(255 * it) for it in alphas]


def offsets(rig: Rig, file: Path, card_px: float) -> list[Picture]:
    """The card straight ahead, shifted by parts of a pixel. Large cards need few pictures."""
    steps = OFFSETS if card_px < 60 else 2
    side = 16 * math.ceil((card_px + 24) / 16)
    distance = side / (2 * card_px * math.tan(math.radians(FOV_DEGREES / 2)))
    keys = []
    for frame in range(steps * steps):
        x, y = ((it / steps - 0.5) / card_px for it in (frame % steps, frame // steps))
        keys.append({"frame": frame, "eye": [x, 0.5 + y, distance], "target": [x, 0.5 + y, 0.0], "up": [0, 1, 0], "fov_degrees": FOV_DEGREES})
    path = {"fps": 4, "frames": len(keys), "size": [side, side], "keys": keys}
    return rig.play(file, f"{card_px:.0f}px", path)


def leaf_pixels(shown: Picture) -> int:
    """Pixels whose green is larger than blue by more than 15: leaves, never the background."""
    green, blue = shown.planes[1], shown.planes[2]
    return count(int.from_bytes(bytes(int(a > b + 15) for a, b in zip(green, blue)), "big"))
