"""Clients that take their time, or never read what they asked for, and those that come and go."""

import os
import re
import selectors
import socket
import threading
import time
from pathlib import Path

from bodies import wants
from frames import ACK, GOAWAY, PING, PREFACE, Http2, frame, request, settings, update
from talk import connect, reset, talk, tally

STALLED = int(os.environ.get("STALLED", "1024"))
IDLE = int(os.environ.get("IDLE", "200"))
CHURN = int(os.environ.get("CHURN", "20000"))
# HEAD_TIMEOUT and BODY_TIMEOUT of the server, PING twice, STALL_TIMEOUT; with what a loaded machine adds.
HEAD_SECS, PINGS_SECS, STALL_SECS, LATE_SECS = 30, 40, 60, 10
# IDLE of the server.
IDLE_SECS = 60
# Descriptors of the server that is crowded, and how many come.
FILES, CROWD = 512, 1024
GONE_SECS = STALL_SECS + 2 * LATE_SECS
# How long the good client is watched while nothing is read, and how many attacks have come so far.
BURST, BURSTS, BURST_SECS = threading.Lock(), threading.Semaphore(0), 3
GET = b"GET /healthz HTTP/1.1\r\nHost: a\r\n"
POST = b"POST /v1/pages HTTP/1.1\r\nHost: a\r\n"


def swarm(port: int, heads: list, drips: list, secs: float, every: float = 3) -> list:
    """A connection a head, each sending one byte of its drip again and again. Gives (seconds until closed or None, first bytes read)."""
    endings, peers, born = [[None, b""] for _ in heads], [], []
    selector = selectors.DefaultSelector()
    started = time.monotonic()
    for number, head in enumerate(heads):
        peer = connect(port)
        peer.sendall(head)
        peer.setblocking(False)
        selector.register(peer, selectors.EVENT_READ, number)
        peers.append(peer)
        born.append(time.monotonic())
    open_ones, next_drip = len(heads), started + every
    while open_ones and time.monotonic() < started + secs:
        for key, _ in selector.select(0.2):
            number = key.data
            try:
                piece = key.fileobj.recv(65_536)
            except BlockingIOError:
                continue
            except OSError:
                piece = b""
            endings[number][1] = (endings[number][1] + piece)[:64]
            if not piece:
                endings[number][0] = time.monotonic() - born[number]
                selector.unregister(key.fileobj)
                open_ones -= 1
        if time.monotonic() >= next_drip:
            next_drip += every
            for peer, drip, ending in zip(peers, drips, endings):
                if drip and ending[0] is None:
                    try:
                        peer.send(drip)
                    except OSError:
                        # The selector tells that it is closed.
                        pass
    for peer in peers:
        peer.close()
    return endings


def closes(row, rig, heads: list, drips: list, after: float, within: float) -> list:
    """All must be closed between the two times, and the server must have let go of them."""
    row.attempts = len(heads)
    sockets = rig.server.sockets()
    endings = swarm(rig.port, heads, drips, within + 5)
    closed = sorted(secs for secs, _ in endings if secs is not None)
    row.check(len(closed) == len(heads), f"{len(heads)} closed within {within} s", f"{len(closed)} of them")
    if closed:
        row.check(after <= closed[0] and closed[-1] <= within, f"closed after {after} to {within} s", f"{closed[0]:.1f} to {closed[-1]:.1f}")
        row.note(f"{len(closed):,} closed after {closed[0]:.0f} to {closed[-1]:.0f} s")
    left = rig.server.sockets()
    row.check(left <= sockets + 8, f"about {sockets} sockets at the server", left)
    return endings


def slow_heads(rig) -> None:
    with rig.attack("slow loris") as row:
        # Some stop before it is known what they speak, others within the headers of one route or another.
        pages = b"GET " + rig.target.good_path.encode() + b" HTTP/1.1\r\nHost: a\r\na: "
        heads = [b"G"] * 250 + [GET + b"a: "] * 250 + [b"GET /v1/assets/"] * 250 + [pages] * 250
        closes(row, rig, heads, [b"E"] * 1000, HEAD_SECS - 2, HEAD_SECS + LATE_SECS)


def slow_bodies(rig) -> None:
    with rig.attack("slow bodies") as row:
        # In chunks: the line of a chunk's size that never ends, too.
        heads = [POST + b"Content-Length: 1000\r\n\r\n"] * 200 + [POST + b"Transfer-Encoding: chunked\r\n\r\nFFFF\r\n"] * 200
        heads += [POST + b"Transfer-Encoding: chunked\r\n\r\n"] * 100
        endings = closes(row, rig, heads, [b" "] * 400 + [b"0"] * 100, 0, HEAD_SECS + LATE_SECS)
        outcomes = [first[9:12].decode() or "closed" for _, first in endings]
        row.check(set(outcomes) <= {"408", "400", "413", "closed"}, "408", tally(outcomes))
        row.note(tally(outcomes))


def silent(rig) -> None:
    with rig.attack("silent connections") as row:
        closes(row, rig, [b""] * 1000, [b""] * 1000, HEAD_SECS - 2, HEAD_SECS + LATE_SECS)


def silent_http2(rig) -> None:
    with rig.attack("HTTP/2 that answers no ping") as row:
        start = PREFACE + settings()
        # Idle; in the middle of a head; with a body that does not come.
        heads = [start] * 200 + [start + frame(1, 1, 1, b"\x82")] * 200 + [start + request(1, "/v1/pages", method="POST", end=False)] * 100
        closes(row, rig, heads, [b""] * 500, 0, PINGS_SECS + LATE_SECS)


def idle_http2(rig) -> None:
    """Connections that answer every ping and ask for nothing; each must be told that it is over."""
    with rig.attack("HTTP/2 that only answers pings") as row:
        row.attempts = IDLE
        sockets, started = rig.server.sockets(), time.monotonic()
        connections, told = [Http2(rig.port) for _ in range(IDLE)], 0
        while connections and time.monotonic() < started + IDLE_SECS + PINGS_SECS:
            for connection in connections:
                connection.read(0.001)
                if any(one.kind == GOAWAY for one in connection.frames):
                    told += 1
                    connection.closed = True
                for ping in [one for one in connection.frames if one.kind == PING and not one.flags & ACK]:
                    connection.send(frame(PING, ACK, 0, ping.payload), reads=False)
                connection.frames.clear()
                if connection.closed:
                    connection.peer.close()
            connections = [one for one in connections if not one.closed]
            time.sleep(0.1)
        row.check(told == IDLE, f"{IDLE} told within {IDLE_SECS + PINGS_SECS} s", told)
        row.note(f"{told} told by {time.monotonic() - started:.0f} s")
        left = rig.server.sockets()
        row.check(left <= sockets + 8, f"about {sockets} sockets at the server", left)


def crowded(rig) -> None:
    """More idle connections than the server takes: those who come are served, and files are still opened."""
    with rig.attack("idle connections beyond all limits") as row:
        row.attempts = CROWD
        peers = []
        for _ in range(CROWD):
            peers.append(connect(rig.port))
            peers[-1].sendall(PREFACE + settings())
            # Slower than the good client asks, whose connection so is not the longest idle.
            time.sleep(0.002)
        found = [talk(rig.port, b"GET %s HTTP/1.1\r\nHost: a\r\n\r\n" % path).outcome for path in (b"/readyz", b"/v1/scenes/rock/open")]
        row.check(found == [200, 200], "answers of the store", tally(found))
        row.note(f"{rig.server.sockets()} sockets at the server")
        for peer in peers:
            peer.close()


def kernel_mb() -> float:
    """What the system holds for all TCP connections of this machine."""
    found = re.search(r"TCP:.* mem (\d+)", Path("/proc/net/sockstat").read_text())
    return int(found[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6 if found else 0.0


def unread(row, rig, requests: list) -> None:
    """Requests whose answers nobody reads; the server must let go of them some time, whatever it holds until then."""
    row.attempts = len(requests)
    sockets, peers = rig.server.sockets(), []
    try:
        # One such attack at a time, so that each good client meets its own; they only wait together.
        with BURST:
            kernel = kernel_mb()
            rig.good.since()
            for data in requests:
                peer = connect(rig.port, receive_bytes=4096)
                peers.append(peer)
                peer.sendall(data)
            time.sleep(BURST_SECS)
            row.good = rig.good.since()
            row.note(f"{rig.server.status('VmRSS'):.0f} MB held, {kernel_mb() - kernel:.0f} MB in the system's sockets")
    finally:
        BURSTS.release()
    started, left = time.monotonic(), rig.server.sockets()
    while left > sockets + 8 and time.monotonic() < started + GONE_SECS and rig.server.process.poll() is None:
        time.sleep(0.5)
        left = rig.server.sockets()
    row.note(f"{max(0, left - sockets)} still connected after {time.monotonic() - started:.0f} s")
    row.check(left <= sockets + 8, f"closed within {GONE_SECS} s", f"{left - sockets} still connected")
    for peer in peers:
        reset(peer)


def get_unread(rig) -> None:
    path = rig.target.all_pages.encode()
    with rig.attack("GET all pages, never read") as row:
        unread(row, rig, [b"GET " + path + b" HTTP/1.1\r\nHost: a\r\n\r\n"] * STALLED)


def get_pages_unread(rig) -> None:
    # Just below what is read before the status goes out.
    last, pages = rig.target.last_page, len(rig.target.pack_bytes)
    path = f"/v1/assets/{rig.target.asset}/pages/0-{last * 3_500_000 // pages}"
    with rig.attack("GET 3.5 MB of pages, never read") as row:
        unread(row, rig, [f"GET {path} HTTP/1.1\r\nHost: a\r\n\r\n".encode()] * STALLED)


def get_page_unread(rig) -> None:
    with rig.attack("GET a page, never read") as row:
        paths = [f"/v1/assets/{rig.target.asset}/pages/{page}-{page}" for page in range(rig.target.last_page + 1)]
        requests = [f"GET {paths[number % len(paths)]} HTTP/1.1\r\nHost: a\r\n\r\n".encode() * 20 for number in range(STALLED)]
        unread(row, rig, requests)


def object_unread(rig) -> None:
    lines = f"GET /v1/objects/{rig.target.pack} HTTP/1.1\r\nHost: a\r\nRange: bytes=0-4194303\r\n\r\n".encode()
    with rig.attack("GET 4 MiB of an object, never read") as row:
        unread(row, rig, [lines] * STALLED)


def open_unread(rig) -> None:
    with rig.attack("GET open, never read") as row:
        unread(row, rig, [b"GET /v1/scenes/rock/open HTTP/1.1\r\nHost: a\r\n\r\n"] * STALLED)


def post_unread(rig) -> None:
    with rig.attack("POST for all pages, never read") as row:
        bodies = [wants(rig, 1, last=rig.target.last_page, viewer=viewer) for viewer in range(STALLED)]
        unread(row, rig, [POST + b"Content-Length: %d\r\n\r\n" % len(body) + body for body in bodies])


def http2_unread(rig) -> None:
    with rig.attack("HTTP/2, 100 streams each, never read") as row:
        # The largest windows there are: nothing but the socket holds the server back.
        start = PREFACE + settings((4, 2**31 - 1)) + frame(8, 0, 0, (2**31 - 1 - 65_535).to_bytes(4, "big"))
        asked = b"".join(request(stream, rig.target.all_pages) for stream in range(1, 201, 2))
        unread(row, rig, [start + asked] * 50)


def http2_no_window(rig) -> None:
    with rig.attack("HTTP/2, 100 streams each, no window") as row:
        asked = b"".join(request(stream, rig.target.all_pages) for stream in range(1, 201, 2))
        unread(row, rig, [PREFACE + settings((4, 0)) + asked] * 50)


def http2_many_unread(rig, name: str, path: str, streams: int = 200, connections: int = 60) -> None:
    """As many streams as are taken, without a window and with one, by clients that take what is compressed."""
    for window, start in (("no window", settings((4, 0))), ("windows", settings((4, 2**31 - 1)) + update(0, 2**31 - 1 - 65_535))):
        with rig.attack(f"HTTP/2, {name}, {window}, never read") as row:
            coded = ((b"accept-encoding", b"gzip, zstd"),)
            asked = b"".join(request(stream, path, more=coded) for stream in range(1, 2 * streams, 2))
            row.attempts = connections * streams
            unread(row, rig, [PREFACE + start + asked] * connections)


def http2_open_unread(rig) -> None:
    http2_many_unread(rig, "open", "/v1/scenes/rock/open")


def http2_texts_unread(rig) -> None:
    http2_many_unread(rig, "a long text", "/v1/openapi.json")


def http2_object_unread(rig) -> None:
    http2_many_unread(rig, "an object", f"/v1/objects/{rig.target.pack}")


UNREAD = [get_unread, get_pages_unread, get_page_unread, object_unread, open_unread, post_unread, http2_unread, http2_no_window]
UNREAD += [http2_open_unread, http2_texts_unread, http2_object_unread]
# A cache that is smaller than the pack: what unread answers hold of it is theirs alone, as in a library that is larger than memory.
for attack in UNREAD:
    attack.options = lambda target: ["--cache-bytes", "2MiB"]
SLOW = [slow_heads, slow_bodies, silent, silent_http2, idle_http2, crowded]
# Few descriptors stand for many connections.
crowded.files = FILES


def nothing(rig) -> None:
    """What the machine adds by itself."""
    with rig.attack("no attack"):
        time.sleep(3)


def churn(rig) -> None:
    for name, leave in (("closed at once", socket.socket.close), ("reset at once", reset)):
        with rig.attack(f"connections that are {name}") as row:
            row.attempts = CHURN // 2
            sockets = rig.server.sockets()
            for _ in range(row.attempts):
                leave(connect(rig.port))
            time.sleep(1)
            left = rig.server.sockets()
            row.check(left <= sockets + 4, f"about {sockets} sockets at the server", left)
            row.note(f"{left - sockets} sockets left")
    with rig.attack("half-closed after the request") as row:
        paths = ["/healthz", rig.target.good_path, "/v1/scenes/rock/open", rig.target.all_pages] * 50
        row.attempts = len(paths)
        outcomes = []
        for path in paths:
            found = talk(rig.port, f"GET {path} HTTP/1.1\r\nHost: a\r\n\r\n".encode(), 5, half_close=True, linger=0.5)
            whole = bool(found.answers) and found.answers[0].whole
            outcomes.append(f"{found.outcome} whole" if whole else "cut" if found.answers else "closed")
            row.check(found.closed, f"{path}: closed behind the answer", "open")
            row.check(not whole or found.outcome == 200, f"{path}: 200 where there is an answer", found.outcome)
        row.note(tally(outcomes))
