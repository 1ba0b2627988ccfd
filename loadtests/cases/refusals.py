"""Files that must be refused or read: ../shared/models/bad, and foreign files named as models."""

import json

import boxes
import habits
from files.surface import NotChecked
from rig import BAD, Rig, Run
from rows import Row, row, short

# More memory than any of these small files may cost.
MOST_BYTES = 1 << 30
# Issue 16 has these drawn, with a warning, where the folder's list still refuses them.
DRAWN = {"node_two_parents.glb"}
# An error line says so much at most, and one line it is.
MOST_CHARS = 700


def bad(rig: Rig) -> list[Row]:
    """A row a file of bad/expected.json."""
    wanted = json.loads((BAD / "expected.json").read_text())
    return [judged(rig, name, **about) for name, about in sorted(wanted.items())]


def judged(rig: Rig, name: str, expect: str, about: str, triangles: int | None = None) -> Row:
    run, ingested = rig.try_ingest(BAD / name)
    faults = []
    if name in DRAWN:
        expect = "accept"
    elif triangles == 0:
        # Without a triangle nothing is published.
        expect = "reject"
    if run.peak_bytes > MOST_BYTES:
        faults.append(f"{run.peak_bytes >> 20} MiB")
    if ingested is None:
        faults += refusal_faults(run, name) + ([f"refused: {run.error()}"] if expect == "accept" else [])
        return row(f"bad/{name}", f"{expect} ({about})", short("; ".join(faults) or run.error()), not faults)
    if expect == "reject":
        faults.append(f"published {ingested.triangles} triangles")
        return row(f"bad/{name}", f"{expect} ({about})", short("; ".join(faults)), False)
    if triangles is not None and ingested.triangles != triangles:
        faults.append(f"{ingested.triangles} triangles")
    if name in DRAWN and not ingested.warnings:
        faults.append("no warning")
    if name not in DRAWN:
        faults += shape_faults(rig, name, expect)
    counted = "" if triangles is None else f" {triangles} triangles"
    return row(f"bad/{name}", f"{expect}{counted} ({about})", short("; ".join(faults) or f"{ingested.triangles} triangles"), not faults)


def shape_faults(rig: Rig, name: str, expect: str) -> list[str]:
    """The box of what was read; a file that bends the rules has none that everyone agrees on."""
    try:
        return boxes.box_faults(boxes.read(BAD / name), rig.export(BAD / name))
    except NotChecked:
        return []
    except (ArithmeticError, LookupError, ValueError) as error:
        return [] if expect == "either" else [f"no box: {error}"]


def refusal_faults(run: Run, name: str) -> list[str]:
    """Exit 1 with one line that names the file."""
    lines = run.err.strip().splitlines()
    if run.code != 1:
        return ["published" if run.code == 0 else f"exit {run.code}: {run.error()}"]
    faults = []
    if len(lines) != 1:
        faults.append(f"{len(lines)} error lines")
    elif name not in lines[0]:
        faults.append(f"error without the file's name: {lines[0]}")
    elif len(lines[0]) > MOST_CHARS:
        faults.append(f"an error line of {len(lines[0])} characters")
    return faults


FOREIGN = {
    "png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0:~\x9bU\0\0\0\nIDATx\x9cc`\0\0\0\x02\0\x01H\xaf\xa4q\0\0\0\0IEND\xaeB`\x82",
    "html": b"<!DOCTYPE html>\n<html><head><title>404 Not Found</title></head>\n<body>no such file</body></html>\n",
    "prose": b"Dear reader,\nthis is a letter, not a model.\nfor what it is worth: v is a letter too.\n",
    "json": b'{"v": [1, 2, 3], "f": [1, 2, 3]}\n',
    "python": b"#!/usr/bin/env python3\nfor v in range(3):\n    print(v)\n",
    "csv": b"name,x,y,z\na,1,2,3\nb,4,5,6\n",
    "lfs": b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"0" * 64 + b"\nsize 12345\n",
    "zip": b"PK\x03\x04\x14\0\0\0\x08\0" + bytes(range(256)) * 2,
    "noise": bytes((it * 7919 + it // 3) % 256 for it in range(5000)),
    "zeros": bytes(1000),
    "blank": b"\n\n  \n",
    "empty": b"",
    "comment": b"# only a comment\n",
    "material": b"newmtl red\nKd 1 0 0\n",
    "points": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
}
KINDS = ("obj", "stl", "ply", "glb", "gltf")


def foreign(rig: Rig) -> list[Row]:
    """A foreign file named as a model never replaces a good scene."""
    rows = []
    folder = rig.folder / "foreign"
    folder.mkdir()
    good = habits.model().write(folder / "good_scene.glb")
    for kind in KINDS:
        faults = []
        for name, data in FOREIGN.items():
            file = folder / f"{name}.{kind}"
            file.write_bytes(data)
            scene = f"foreign.{name}.{kind}"
            place = ("--library", rig.library, "--scene", scene)
            rig.run("server", "ingest", good, *place, "--quiet")
            before = rig.run("server", "show", scene, "--library", rig.library).out
            run = rig.run("server", "ingest", file, *place)
            after = rig.run("server", "show", scene, "--library", rig.library).out
            mine = refusal_faults(run, file.name) + ([] if before and before == after else ["scene replaced"])
            if mine:
                faults.append(f"{name}: {', '.join(mine)}")
        expected = f"{len(FOREIGN)} foreign files refused by name, the scene stays"
        rows.append(row(f"foreign .{kind}", expected, short("; ".join(faults)) or "refused", not faults))
    return rows


def empty(rig: Rig) -> list[Row]:
    """Only `--allow-empty` publishes a scene without a triangle."""
    file = habits.changed(nodes=[{}]).write(rig.folder / "empty.glb")
    run, ingested = rig.try_ingest(file, "--allow-empty")
    found = f"exit {run.code}: {run.error()}" if ingested is None else f"{ingested.triangles} triangles"
    return [row("--allow-empty", "exit 0, 0 triangles", short(found), ingested is not None and ingested.triangles == 0)]
