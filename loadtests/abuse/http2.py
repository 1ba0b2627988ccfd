"""Floods over HTTP/2. Each must be cut, or be taken without memory growing or the good client waiting."""

import os
import time

from frames import (
    ACK,
    CONTINUATION,
    DATA,
    END_HEADERS,
    END_STREAM,
    HEADERS,
    PING,
    PREFACE,
    PRIORITY,
    RST_STREAM,
    SETTINGS,
    Http2,
    field,
    fields,
    frame,
    request,
    rst,
    settings,
    status,
    text,
    update,
)
from talk import tally

RESETS = int(os.environ.get("RESETS", "20000"))
# The most that a flood takes, and how much of it is handed to the socket at a time.
SECS, AT_ONCE = 8, 500
CUT = {"GOAWAY CALM", "GOAWAY PROTOCOL", "GOAWAY COMPRESSION", "GOAWAY FRAME_SIZE", "closed"}
POST = dict(path="/v1/pages", method="POST", end=False)


def flood(rig, name: str, start: bytes, piece: bytes, count: int, allowed: set, reads: bool = True) -> None:
    """The same frame over and over. `open` is fine where all of it was taken, or the socket held it back."""
    with rig.attack(name) as row, Http2(rig.port, PREFACE + settings() + start, 0 if reads else 4096) as connection:
        connection.send(b"", reads=reads)
        block, sent, began = piece * AT_ONCE, 0, time.monotonic()
        while sent < count * len(piece) and not connection.closed and time.monotonic() < began + SECS:
            taken = connection.send(block, 2, reads)
            sent += taken
            if taken < len(block):
                break
        connection.read(0.5, lambda one: False)
        row.attempts = sent // len(piece)
        row.check(connection.end() in allowed, " or ".join(sorted(allowed)), connection.end())
        row.note(f"{connection.end()} after {row.attempts:,} frames, {time.monotonic() - began:.1f} s")


def resets(rig, name: str, undo) -> None:
    """Requests that are taken back at once, the most expensive ones there are; on a new connection whenever one is cut."""
    with rig.attack(name) as row:
        ends, began = [], time.monotonic()
        while row.attempts < RESETS and time.monotonic() < began + 2 * SECS:
            with Http2(rig.port) as connection:
                for first in range(1, 2 * RESETS, 200):
                    streams = range(first, first + 200, 2)
                    block = b"".join(request(stream, "/v1/scenes/rock/open") + undo(stream) for stream in streams)
                    row.attempts += len(streams)
                    if connection.send(block, 2) < len(block) or row.attempts >= RESETS:
                        break
                connection.read(1, lambda one: False) if not connection.closed else None
                ends.append(connection.end())
        row.check(set(ends) <= CUT, "GOAWAY CALM", tally(ends))
        row.note(f"{tally(ends)}; {time.monotonic() - began:.1f} s")


def bomb(rig) -> None:
    """A header of 4,000 bytes goes into the table once, and each byte of the next blocks names it: 64 MB a block."""
    large = b"\x40" + text(b"a") + text(b"b" * 4000)
    with rig.attack("HPACK bomb") as row:
        ends = []
        for _ in range(10):
            with Http2(rig.port) as connection:
                connection.send(frame(HEADERS, END_HEADERS | END_STREAM, 1, fields() + large))
                for stream in range(3, 203, 2):
                    row.attempts += 1
                    connection.send(frame(HEADERS, END_HEADERS | END_STREAM, stream, fields() + b"\xbe" * 16_000))
                connection.read(1, lambda one: one.stream == 201)
                refused = [
                    one for one in connection.frames if one.kind == RST_STREAM or one.kind == HEADERS and status(one.payload) not in (200, 304)
                ]
                ends.append(connection.end() if connection.end() != "open" else f"refused {len(refused)} of 100")
        row.check(all(end in CUT or end == "refused 100 of 100" for end in ends), "all refused, or the connection cut", tally(ends))
        row.note(tally(ends))


def crowd(rig) -> None:
    """More streams at once than the server lets in (200)."""
    with rig.attack("1,000 streams at once") as row, Http2(rig.port) as connection:
        row.attempts = 1000
        connection.send(b"".join(request(stream, **POST) for stream in range(1, 2001, 2)))
        connection.read(1, lambda one: False)
        refused = {one.stream for one in connection.frames if one.kind == RST_STREAM}
        cut = connection.end() in CUT
        row.check(cut or len(refused) >= 800, "800 refused, or the connection cut", f"{len(refused)} refused, {connection.end()}")
        row.note(f"{len(refused)} refused, {connection.end()}")


def floods(rig) -> None:
    kept = CUT | {"open"}
    resets(rig, "rapid reset", rst)
    resets(rig, "resets made by the server", lambda stream: update(stream, 0))
    resets(rig, "DATA behind the end", lambda stream: frame(DATA, END_STREAM, stream, b"a"))
    for name, piece in [("SETTINGS", settings((3, 100), (4, 65_535))), ("PING", frame(PING, 0, 0, bytes(8)))]:
        flood(rig, f"{name} flood", b"", piece, 100_000, kept)
        flood(rig, f"{name} flood, never reading", b"", piece, 100_000, kept, reads=False)
    flood(rig, "settings acknowledged that nobody sent", b"", frame(SETTINGS, ACK, 0), 100_000, kept)
    flood(rig, "empty DATA", request(1, **POST), frame(DATA, 0, 1), 200_000, kept)
    # The answer waits for a window, and so does its stream.
    blocked = settings((4, 0)) + request(1, rig.target.all_pages, end=False)
    flood(rig, "empty DATA nobody waits for", blocked, frame(DATA, 0, 1), 200_000, kept)
    flood(rig, "DATA that is all padding", request(1, **POST), frame(DATA, 8, 1, b"\xff" + bytes(255)), 100_000, kept)
    flood(rig, "CONTINUATION flood", frame(HEADERS, END_STREAM, 1, fields()), frame(CONTINUATION, 0, 1, field(b"a", b"b" * 16_000)), 4096, CUT)
    flood(
        rig,
        "CONTINUATION flood, small headers",
        frame(HEADERS, END_STREAM, 1, fields()),
        frame(CONTINUATION, 0, 1, field(b"a", b"b")),
        200_000,
        CUT,
    )
    flood(rig, "CONTINUATION flood, empty", frame(HEADERS, END_STREAM, 1, fields()), frame(CONTINUATION, 0, 1), 200_000, CUT)
    bomb(rig)
    flood(rig, "table sizes up and down", b"", frame(HEADERS, END_HEADERS | END_STREAM, 1, b"\x20\x3f\xe1\x1f" * 4000), 1000, kept)
    flood(rig, "WINDOW_UPDATE flood", b"", update(0, 1), 500_000, kept)
    flood(rig, "PRIORITY flood", b"", b"".join(frame(PRIORITY, 0, 2 * n + 1, bytes(4) + b"\x10") for n in range(100)), 5000, kept)
    flood(rig, "frames of an unknown type", b"", frame(0xF0, 0, 0, bytes(16_000)), 10_000, kept)
    flood(rig, "pushes of a client", b"", frame(5, END_HEADERS, 1, bytes(4)), 1000, CUT)
    flood(rig, "frames of 16 MiB", b"", frame(DATA, 0, 1, bytes(1 << 20), length=(1 << 24) - 1), 64, CUT)
    crowd(rig)
