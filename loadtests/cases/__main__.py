#!/usr/bin/env python3
"""Every input of ../shared/cases, ../shared/models, its khronos and its bad, and generated ones:
`make cases`. A row each: expected, found, ok or NOT; `later` where the picture comes with a later
issue and the warning that must be there until then is there. Exit 1 where a row is NOT.

    ROWS=cube5,khronos (parts of the groups' names)
    CLAIMS=FILE (the rows as the report's stability table reads them)
"""

import collections
import json
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

# Nothing is left beside the sources.
sys.dont_write_bytecode = True
import boxes
import habits
import khronos
import looks
import made
import masks
import refusals
import shapes
from rig import BAD, CASES, KHRONOS, MODELS, ROOT, Rig
from rows import NOT, Row

Group = tuple[str, partial]

# Inputs whose triangles and box are all that they must show, beside the rows below.
PLAIN = (
    "cyl24.obj", "utm_obj.obj", "local_obj.obj", "flip.stl", "x_glyph.obj", "l_shape.obj", "leaf13.glb", "leaf33.glb", "d1tr1.obj", "tr1.obj",
    "ke_map.obj", "wedge.ply", "strips.ply", "missing_tex.gltf", "backslash.gltf", "bom.obj", "utf8bom.stl", "c4d_n0.obj", "webp_req.glb",
    "basis_req.glb", "emissive_only.glb", "glass.glb", "tiles16.glb", "tiles_utm.glb", "tiles_ecef.glb",
)  # fmt: skip


def cases() -> list[Group]:
    """The rows of ../shared/cases/README.md."""
    groups = [(name, partial(shapes.instances, name=name)) for name in ("cube5.glb", "bricks.glb", "facade.glb")]
    groups += [(name, partial(shapes.neighbours, name=name)) for name in ("bricks.glb", "facade.glb")]
    groups += [
        ("bricks.glb", partial(looks.joined, name="bricks.glb", front=0.6, length=18.39, height=0.3)),
        ("facade.glb", partial(looks.joined, name="facade.glb", front=1.137, length=14.628, height=1.37)),
        ("cyl24.obj", partial(shapes.cylinder)),
        ("tiles16.glb", partial(looks.tiles)),
        ("tiles16.glb", partial(looks.planned)),
        ("tiles_utm.glb", partial(shapes.gaps, name="tiles_utm.glb")),
        ("tiles_ecef.glb", partial(shapes.gaps, name="tiles_ecef.glb")),
        ("utm_obj.obj", partial(shapes.far_and_near)),
        ("utm_obj.obj", partial(looks.same)),
        ("flip.stl", partial(looks.closed)),
        ("x_glyph.obj", partial(shapes.polygon, name="x_glyph.obj")),
        ("l_shape.obj", partial(shapes.polygon, name="l_shape.obj")),
        ("leaf13.glb", partial(masks.cover, file=CASES / "leaf13.glb")),
        ("leaf33.glb", partial(masks.cover, file=CASES / "leaf33.glb")),
        ("tr1.obj", partial(shapes.named, name="tr1.obj", parts=("Tr",))),
        ("ke_map.obj", partial(looks.textured, name="ke_map.obj")),
        ("wedge.ply", partial(looks.textured, name="wedge.ply")),
        ("missing_tex.gltf", partial(shapes.named, name="missing_tex.gltf", parts=("nothere.png",))),
        ("backslash.gltf", partial(shapes.named, name="backslash.gltf", parts=("pat tern.png",))),
        ("count0.stl", partial(shapes.facets)),
        ("webp_req.glb", partial(shapes.named, name="webp_req.glb", parts=("EXT_texture_webp",))),
        ("basis_req.glb", partial(shapes.named, name="basis_req.glb", parts=("KHR_texture_basisu",))),
        ("emissive_only.glb", partial(looks.emissive)),
        ("glass.glb", partial(looks.glass)),
    ]
    seen = ("d1tr1.obj", "tr1.obj", "strips.ply", "missing_tex.gltf", "backslash.gltf", "bom.obj", "c4d_n0.obj", "webp_req.glb", "basis_req.glb")
    groups += [(name, partial(looks.visible, name=name)) for name in seen]
    return groups + [(name, partial(boxes.model, file=CASES / name)) for name in PLAIN]


def generated() -> list[Group]:
    """Other inputs of the same kinds, made here."""
    groups = [("made borders", partial(made.borders, name=name)) for name in made.TERRAINS]
    for name in made.FAR:
        groups.append(("made far", partial(made.far_boxes, name=name)))
        groups += [("made far", partial(made.far_text, name=name, kind=kind)) for kind in ("obj", "ply", "stl")]
        groups.append(("made far", partial(made.exported_again, name=name)))
    groups += [("made concave", partial(made.stars, kind=kind)) for kind in ("obj", "ply")]
    groups += [("habits", partial(habits.habits, kind=kind)) for kind in ("texts", "gltf")]
    looked = (looks.materials, looks.sides, looks.cutoff, looks.outlier, masks.generated)
    groups += [(f"made looks {it.__name__}", partial(it)) for it in looked]
    return [*groups, ("foreign", partial(refusals.foreign)), ("empty", partial(refusals.empty))]


def shared() -> list[Group]:
    missing = [str(it) for it in (CASES, MODELS, KHRONOS, BAD) if not it.is_dir()]
    if missing:
        print(f"SKIPPED: rows of the shared inputs, for want of {', '.join(missing)}")
        return []
    # A child's peak memory counts from this process's own: rows that bound memory come first.
    groups = [("bomb60k", partial(shapes.bomb)), ("bad", partial(refusals.bad)), *cases()]
    groups += [(f"khronos {file.stem}", partial(khronos.model, file=file)) for file in khronos.files()]
    return groups + [(f"models {file.stem}", partial(boxes.large_model, file=file)) for file in sorted(MODELS.glob("*.glb"))]


def judged(rig: Rig, name: str, group: partial) -> list[Row]:
    """A failure is a row like another: those after it still count."""
    try:
        return group(rig)
    except Exception as error:
        return [Row(name, "a result", f"{type(error).__name__}: {' '.join(str(error).split())}", NOT)]


def main() -> None:
    started = time.monotonic()
    binaries = (ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release").resolve()
    rig = Rig(binaries, ROOT / "target" / "cases")
    wanted = [it for it in os.environ.get("ROWS", "").split(",") if it]
    groups = [it for it in shared() + generated() if not wanted or any(part in it[0] for part in wanted)]
    rows: list[Row] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(lambda it: judged(rig, *it), groups):
            rows += found
            for it in found:
                print(it, flush=True)
    (rig.folder / "rows.json").write_text(json.dumps({"rows": [it.json() for it in rows]}, indent=1))
    if claims := os.environ.get("CLAIMS"):
        Path(claims).write_text(made.claims(rows))
    states = collections.Counter(it.state for it in rows)
    counts = ", ".join(f"{count} {state}" for state, count in sorted(states.items()))
    print(f"{len(rows)} rows: {counts}; {time.monotonic() - started:.0f} s")
    if states[NOT] or not rows:
        sys.exit(f"{states[NOT]} rows do not hold")


if __name__ == "__main__":
    main()
