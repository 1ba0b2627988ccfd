"""Models of a few megabytes that ask for gigabytes: `PUT /v1/scenes/NAME` from one who may. The build keeps to its memory, whatever it is asked for."""

import base64
import json
import struct
import zlib

from talk import talk
from uploads import TOKEN, glb, put, triangle

MEMORY_MB = 512
MODEL_BYTES = 32 << 20
POINTS = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)


def options(target) -> list:
    tokens, scratch = target.folder / "bomb-tokens", target.folder / "bomb-scratch"
    tokens.write_text(TOKEN + "\n")
    tokens.chmod(0o600)
    scratch.mkdir(exist_ok=True)
    return ["--upload-tokens", str(tokens), "--upload-bytes", str(MODEL_BYTES), "--upload-secs", "60", "--upload-memory", f"{MEMORY_MB}MiB",
            "--upload-scratch", str(scratch)]


def many(key: str, item: str, count: int) -> bytes:
    """A triangle whose `key` has `count` items more."""
    document = triangle(3)
    head = json.dumps(document)[:-1]
    if key in document:
        head = json.dumps({name: value for name, value in document.items() if name != key})[:-1]
    return glb(f'{head},"{key}":[{",".join([item] * count)}]}}'.encode(), POINTS)


def png(width: int, height: int) -> bytes:
    """A picture that says so many pixels and has none."""
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")


def models() -> list:
    picture = base64.b64encode(png(60_000, 60_000)).decode()
    textured = triangle(3, images=[{"uri": f"data:image/png;base64,{picture}"}], textures=[{"source": 0}],
                        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}])
    textured["meshes"][0]["primitives"][0]["material"] = 0
    face = "f 1 2 3\n"
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    return [(key, "glb", many(key, item, count)) for key, item, count in [
        ("materials", "{}", 3_000_000), ("materials", "{}", 9_000_000), ("scenes", "{}", 9_000_000), ("nodes", "{}", 9_000_000),
        ("accessors", '{"componentType":5126,"count":1,"type":"SCALAR"}', 500_000), ("bufferViews", '{"buffer":0,"byteLength":1}', 900_000),
        ("meshes", '{"primitives":[]}', 1_500_000), ("images", "{}", 9_000_000), ("samplers", "{}", 9_000_000), ("textures", '{"source":0}', 2_000_000),
        ("animations", '{"channels":[],"samplers":[]}', 900_000), ("extensionsUsed", '"a"', 7_000_000), ("extras", "[]", 9_000_000),
        ("extras", '{"a":{"a":{}}}', 2_000_000)]
    ] + [
        ("nested extras", "glb", glb(b'{"asset":{"version":"2.0"},"extras":' + b"[" * 8_000_000 + b"]" * 8_000_000 + b"}")),
        ("a string of 30 MB", "glb", glb(b'{"asset":{"version":"2.0","generator":"' + b"a" * 30_000_000 + b'"}}')),
        ("a name of 30 MB", "glb", many("nodes", '{"name":"' + "a" * 30_000_000 + '"}', 1)),
        ("a picture of 60,000 x 60,000", "glb", glb(textured, POINTS)),
        ("200,000 mtllib", "obj", ("mtllib a.mtl\n" * 200_000 + corners + face).encode()),
        ("1,000,000 usemtl", "obj", (corners + "".join(f"usemtl {n}\n{face}" for n in range(1_000_000))).encode()),
        ("1,000,000 groups", "obj", (corners + "".join(f"g {n}\no {n}\n{face}" for n in range(1_000_000))).encode()),
        ("4,000,000 points", "obj", ("v 0 0 0\n" * 4_000_000 + face).encode()),
        ("a face of 7,000,000 corners", "obj", (corners + "f " + "1 2 3 " * 2_300_000 + "\n").encode()),
        ("a line of 30 MB", "obj", b"#" + b"a" * 30_000_000),
        ("10^9 vertices", "ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
        ("lists of 2^32 - 1", "ply", b"ply\nformat binary_little_endian 1.0\nelement face 9\nproperty list uint int vertex_indices\nend_header\n" + b"\xff" * 1000),
        ("2^32 - 1 facets", "stl", bytes(80) + b"\xff\xff\xff\xff" + bytes(5000)),
    ]


def bombs(rig) -> None:
    for name, kind, body in models():
        with rig.attack(f"{name}, {len(body) / 1e6:.1f} MB") as row:
            row.attempts = 1
            found = talk(rig.port, put("bomb", body, query=f"?kind={kind}"), 60)
            events = found.answers[0].body if found.answers else b""
            ended = "error" if b"event: error" in events else "done" if b"event: done" in events else found.outcome
            row.check(ended in {"error", "done", 413}, "an answer", f"{ended}: {events[-200:]}")
            row.check(b"backtrace" not in events, "no backtrace", events[-300:])
            row.check(len(events) < 65_536, "less than 64 KiB of events", len(events))
            row.check(row.child_mb < MEMORY_MB * 1.1, f"less than {MEMORY_MB} MB for the build", f"{row.child_mb:.0f}")
            row.note(str(ended))


bombs.options = options
