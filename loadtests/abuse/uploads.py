"""`PUT /v1/scenes/NAME` from those who may not, and models that are traps from one who may."""

import json
import re
import secrets
import struct
import time

from paths import ALONE, SECRET
from talk import connect, reset, talk, tally, together

TOKEN = "a-token-for-the-abuse"
MOST_BYTES = 1 << 20
AT_ONCE = 32
# Models that may as well be built.
HARMLESS = {"no scene", "30,000 instances", "a picture that is none"}
LEGAL = re.compile("[A-Za-z0-9][A-Za-z0-9._-]{0,199}")


def options(target) -> list:
    tokens, scratch = target.folder / "tokens", target.folder / "scratch"
    tokens.write_text(TOKEN + "\n")
    tokens.chmod(0o600)
    scratch.mkdir(exist_ok=True)
    return ["--upload-tokens", str(tokens), "--upload-bytes", str(MOST_BYTES), "--upload-secs", "10", "--upload-triangles", "1000000",
            "--upload-memory", "128MiB", "--upload-scratch", str(scratch)]


def put(name: str, body: bytes, authorization: bytes = b"Bearer " + TOKEN.encode(), length: int | None = None, query: str = "") -> bytes:
    head = f"PUT /v1/scenes/{name}{query} HTTP/1.1\r\nHost: a\r\nContent-Length: {len(body) if length is None else length}\r\n".encode()
    return head + (b"Authorization: " + authorization + b"\r\n" if authorization is not None else b"") + b"\r\n" + body


def glb(document: object, binary: bytes = b"", length: int | None = None) -> bytes:
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks) if length is None else length) + chunks


def triangle(count: int, view_bytes: int = 36, stride: int = 0, offset: int = 0, indices: dict | None = None, **more) -> dict:
    """A glTF whose one accessor says what it likes."""
    view = {"buffer": 0, "byteLength": view_bytes} | ({"byteStride": stride} if stride else {})
    accessor = {
        "bufferView": 0,
        "componentType": 5126,
        "count": count,
        "type": "VEC3",
        "byteOffset": offset,
        "min": [0, 0, 0],
        "max": [1, 1, 1],
    }
    primitive = {"attributes": {"POSITION": 0}} | ({"indices": 1} if indices else {})
    return {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": view_bytes}],
        "bufferViews": [view],
        "accessors": [accessor] + ([indices] if indices else []),
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    } | more


def traps() -> list:
    past = {"bufferView": 0, "componentType": 5125, "count": 9, "type": "SCALAR"}
    points = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    no_view = triangle(2**31 - 2)
    del no_view["accessors"][0]["bufferView"]
    sparse = triangle(3_000_000_000)
    sparse["accessors"][0]["sparse"] = {"count": 1, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}}
    loop = triangle(3, nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}])
    # Ten children each, ten deep: 10^10 instances of one triangle.
    tree = triangle(3, nodes=[{"children": [n + 1] * 10} for n in range(10)] + [{"mesh": 0}])
    many = triangle(3, nodes=[{"mesh": 0}] * 30_000, scenes=[{"nodes": list(range(30_000))}])
    picture = triangle(3, images=[{"uri": "data:image/png;base64," + "A" * 1000}], textures=[{"source": 0}])
    outside = triangle(3, buffers=[{"byteLength": 36, "uri": "../secret"}])
    passwd = triangle(3, buffers=[{"byteLength": 36, "uri": "file:///etc/passwd"}])
    return [
        ("random bytes", secrets.token_bytes(10_000)),
        ("zeroes", bytes(10_000)),
        ("glb's first bytes", b"glTF"),
        ("a length of 2^32 - 1", glb({}, length=2**32 - 1)),
        ("no scene", glb({"asset": {"version": "2.0"}})),
        ("nested lists", glb(b'{"asset":' + b"[" * 100_000)),
        ("version 1", glb({"asset": {"version": "1.0"}})),
        ("4 billion points", glb(triangle(2**32 - 1), points)),
        ("2^53 points", glb(triangle(2**53), points)),
        ("negative points", glb(triangle(-3), points)),
        ("2 billion points without bytes", glb(no_view)),
        ("3 billion sparse points", glb(sparse, points)),
        ("a view past the end", glb(triangle(3, view_bytes=10**9), points)),
        ("a stride of 2^31", glb(triangle(3, stride=2**31), points)),
        ("an offset of 2^60", glb(triangle(3, offset=2**60), points)),
        ("indices past the end", glb(triangle(3, indices=past), struct.pack("<9I", *[2**32 - 2] * 9))),
        ("a node in itself", glb(loop, points)),
        ("10^10 instances", glb(tree, points)),
        ("30,000 instances", glb(many, points)),
        ("a picture that is none", glb(picture, points)),
        ("NaN points", glb(triangle(3), struct.pack("<9f", *[float("nan")] * 9))),
        ("infinite points", glb(triangle(3), struct.pack("<9f", *[float("inf")] * 9))),
        ("a buffer beside it", glb(outside)),
        ("a buffer of the system", glb(passwd)),
    ]


def uploads(rig) -> None:
    scratch, scenes = rig.target.folder / "scratch", rig.target.library / "scenes"
    model, token = b"solid a\nendsolid a\n", TOKEN.encode()
    with rig.attack("uploads without a token") as row:
        given = [None, b"", b"Bearer", b"Bearer ", b"Bearer  ", b"bearer " + token, b"Basic " + token, token, b"Bearer " + token[:-1],
                 b"Bearer " + token + b"a", b"Bearer " + token + b" b", b"Bearer " + token.upper(), b"Bearer \xff\xfe\xfd",
                 b"Bearer " + "ä\u2028".encode(), b"Bearer " + secrets.token_bytes(64).hex().encode(), b"Bearer " + b"a" * 60_000,
                 b"Bearer " + token * 1000, b"Bearer *", b"Bearer %s", b"Bearer a, Bearer " + token]
        requests = [put("abuse", model, one) for one in given] + [
            put("abuse", b"", b"Bearer wrong", length=10**10),
            put("abuse", b"a" * (4 << 20), b"Bearer wrong"),
        ]
        outcomes = [found.outcome for found in together(lambda data: talk(rig.port, data), [(data,) for data in requests])]
        row.attempts = len(requests)
        for data, outcome in zip(requests, outcomes):
            row.check(outcome in {401, 431} or outcome == "closed" and len(data) > MOST_BYTES, f"{data[60:140]}: 401", outcome)
        # NUL and a line's end are no token's fault but the head's.
        found = talk(rig.port, put("abuse", model, b"Bearer a\0"))
        row.check(found.outcome == 400, "a NUL: 400", found.outcome)
        row.note(tally(outcomes))
    with rig.attack("uploads under bad names") as row:
        names = [name for name in ALONE if not LEGAL.fullmatch(name)]
        found = together(lambda name: talk(rig.port, put(name, model, query="?kind=stl")), [(name,) for name in names])
        row.attempts = len(names)
        for name, one in zip(names, found):
            row.check(one.outcome in {400, 404, 405, 414, 431}, f"{name[:60]}: refused", one.outcome)
        kinds = [
            talk(rig.port, put("abuse", model, query=f"?kind={kind}")).outcome
            for kind in ("", "exe", "..%2fsecret", "gltf", "a" * 1000, "%00", "stl%00")
        ]
        row.check(set(kinds) <= {400, 415}, "unknown kinds: 415", kinds)
        row.note(tally([one.outcome for one in found] + kinds))
    with rig.attack("uploads that are too large or cut") as row:
        chunked = put("abuse", b"").replace(b"Content-Length: 0", b"Transfer-Encoding: chunked")
        found = [
            ("2 MiB declared", talk(rig.port, put("abuse", b"a" * (2 << 20)), 10), {413}),
            ("10 GB declared", talk(rig.port, [put("abuse", b"", length=10**10)] + [b"a" * 65_536] * 1024, 20, linger=1), {413}),
            ("2 MiB in chunks", talk(rig.port, chunked + (b"10000\r\n" + b"a" * 65_536 + b"\r\n") * 32 + b"0\r\n\r\n", 10), {413}),
            ("chunks without end", talk(rig.port, [chunked] + [b"10000\r\n" + b"a" * 65_536 + b"\r\n"] * 1024, 20, linger=1), {413}),
            ("a bad chunk", talk(rig.port, chunked + b"-1\r\n", 10), {400, "closed"}),
            ("nothing", talk(rig.port, put("abuse", b""), 10), {400}),
            ("half, then closed", talk(rig.port, put("abuse", b"a" * 1000, length=2000), 3, half_close=True), {400, "closed"}),
        ]
        for _ in range(50):
            peer = connect(rig.port)
            peer.sendall(put("abuse", b"a" * 500_000, length=MOST_BYTES))
            reset(peer)
        row.attempts = len(found) + 50
        for name, one, allowed in found:
            row.check(one.outcome in allowed, f"{name}: {allowed}", one.outcome)
        row.note(tally([one.outcome for _, one, _ in found]))
    with rig.attack(f"{AT_ONCE} uploads that stay") as row:
        row.attempts = AT_ONCE + 1
        peers = [connect(rig.port) for _ in range(AT_ONCE)]
        for peer in peers:
            peer.sendall(put("abuse", b"a", length=1000))
        time.sleep(0.5)
        # They send a byte each while the next one waits for a place: the slowest are given up after 15 s.
        late = talk(rig.port, put("abuse-late", model, query="?kind=stl"), 30)
        row.check(late.outcome == 200, "the next one gets a place: 200", late.outcome)
        for peer in peers:
            reset(peer)
        row.note(f"the next one {late.outcome}")
    with rig.attack("models that are traps") as row:
        cases = traps()
        row.attempts = len(cases)
        told = []
        for name, body in cases:
            found = talk(rig.port, put("abuse-trap", body), 30)
            events = found.answers[0].body if found.answers else b""
            told.append("error" if b"event: error" in events else "done" if b"event: done" in events else found.outcome)
            fine = {"error", "done"} if name in HARMLESS else {"error"}
            row.check(told[-1] in fine and found.outcome == 200, f"{name}: an error among the events", f"{told[-1]}: {events[-200:]}")
            row.check(
                SECRET.encode() not in found.raw and str(rig.target.folder).encode() not in found.raw,
                f"{name}: nothing of where things lie",
                events[-300:],
            )
        left = [file.name for folder in scratch.iterdir() for file in folder.iterdir()]
        row.check(not left, "nothing left in scratch", left)
        row.check("abuse" not in {file.name for file in scenes.iterdir()}, "no scene of a refused upload", "abuse")
        row.note(tally(told))


uploads.options = options
