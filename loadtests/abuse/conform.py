"""What RFC 9113 says that a server must do with frames that are wrong, and with those that only look so. A case a rule; the numbers are the
RFC's sections."""

from frames import (
    ACK, CONTINUATION, DATA, END_HEADERS, END_STREAM, GOAWAY, HAS_PRIORITY, HEADERS, PADDED, PING, PREFACE, PRIORITY, PUSH_PROMISE, RST_STREAM,
    SETTINGS, WINDOW_UPDATE, Http2, field, fields, frame, request, rst, settings, update,
)
from talk import together

START = PREFACE + settings()
BOTH = END_HEADERS | END_STREAM
WAIT = None  # for the whole answer of stream 1


# What the HTTP/2 library lets pass and this server has no hand in.
LET_PASS = {
    "3.4 no SETTINGS behind the preface",
    "3.4 a request behind the preface",
    "8.2.1 a space before a value",
    "8.3.1 an authority with a user",
}


def connection(*codes: str) -> set:
    """A connection error. GOAWAY should come before the close, but need not (5.4.1)."""
    return {f"GOAWAY {code}" for code in codes} | {"closed"}


def stream(*codes: str) -> set:
    """A stream error, which may be taken for one of the connection (5.4.2)."""
    return {f"RST_STREAM {code}" for code in codes} | connection(*codes)


# A request that is no right message (8.1.1) may also be answered before its stream ends.
MALFORMED = stream("PROTOCOL") | {"400", "404"}
HPACK = connection("COMPRESSION")
OPEN = request(1, "/v1/pages", "POST", end=False)


def with_fields(*pairs: tuple, pseudo: bytes | None = None) -> bytes:
    block = (fields() if pseudo is None else pseudo) + b"".join(field(*pair) for pair in pairs)
    return frame(HEADERS, BOTH, 1, block)


def pseudo(**values: bytes) -> bytes:
    """Only these, in this order."""
    return b"".join(field(b":" + name.encode(), value) for name, value in values.items())


def block(suffix: bytes) -> bytes:
    return frame(HEADERS, BOTH, 1, fields() + suffix)


def posted(length: bytes, *bodies: bytes) -> bytes:
    """A post that says how long it is, and its bodies."""
    frames = [frame(DATA, END_STREAM if number == len(bodies) - 1 else 0, 1, body) for number, body in enumerate(bodies)]
    return request(1, "/v1/pages", "POST", end=False, more=((b"content-length", length),)) + b"".join(frames)


def trailers(flags: int, *pairs: tuple) -> bytes:
    return OPEN + frame(DATA, 0, 1, b"{}") + frame(HEADERS, flags, 1, b"".join(field(*pair) for pair in pairs))


def cases(rig) -> list:
    half = settings((4, 0)) + request(1, rig.target.good_path)
    split = frame(HEADERS, END_STREAM, 1, fields()[:10])
    late = frame(CONTINUATION, END_HEADERS, 1, fields())
    lengths = (b"content-length", b"1"), (b"content-length", b"2")
    to = (b":authority", b"a:1")
    rest = frame(CONTINUATION, END_HEADERS, 1, fields()[10:])
    priority = bytes(4) + b"\x10"
    scheme, method, path = (b":scheme", b"http"), (b":method", b"GET"), (b":path", b"/healthz")
    return [
        ("3.4 no SETTINGS behind the preface", [PREFACE + frame(PING, 0, 0, bytes(8))], connection("PROTOCOL")),
        ("3.4 a request behind the preface", [PREFACE + request(1)], connection("PROTOCOL")),
        ("4.1 an unknown frame is ignored", [frame(0xF0, 0xFF, 0, bytes(99)) + request(1)], {"200"}),
        ("4.1 unknown flags are ignored", [frame(PING, 0xFE, 0, bytes(8)) + frame(HEADERS, BOTH | 0x50, 1, fields())], {"200"}),
        ("4.1 the reserved bit is ignored", [frame(PING, 0, 1 << 31, bytes(8)) + frame(HEADERS, BOTH, 1 | 1 << 31, fields())], {"200"}),
        ("4.2 DATA of 16,385 bytes", [OPEN + frame(DATA, 0, 1, bytes(16_385))], stream("FRAME_SIZE")),
        ("4.2 HEADERS of 16,385 bytes", [frame(HEADERS, BOTH, 1, fields() + field(b"a", b"b" * 16_385))], connection("FRAME_SIZE")),
        ("4.2 SETTINGS of 16,386 bytes", [frame(SETTINGS, 0, 0, bytes([0, 99, 0, 0, 0, 0]) * 2731)], connection("FRAME_SIZE")),
        ("4.2 an unknown frame of 16 MiB", [frame(0xF0, 0, 0, bytes(1 << 20), length=(1 << 24) - 1)], connection("FRAME_SIZE")),
        ("4.3 index 0", [block(b"\x80")], HPACK),
        ("4.3 an index past the tables", [block(b"\xff\x80\x01")], HPACK),
        ("4.3 a name past the tables", [block(b"\x7f\x80\x01" + b"\x01a")], HPACK),
        ("4.3 an index of 2^40", [block(b"\xff" + b"\xff" * 5 + b"\x7f")], HPACK),
        ("4.3 a number without end", [block(b"\xff" * 64)], HPACK),
        ("4.3 a text past the block", [block(b"\x00\x01a\x7fb")], HPACK),
        ("4.3 a text of 2^32", [block(b"\x00\x7f\x80\xff\xff\xff\x0f")], HPACK),
        ("4.3 Huffman: the end's symbol", [block(b"\x00\x01a\x84\xff\xff\xff\xff")], HPACK),
        ("4.3 Huffman: padding of a byte", [block(b"\x00\x01a\x82\x1f\xff")], HPACK),
        ("4.3 Huffman: padding of zeroes", [block(b"\x00\x01a\x81\x18")], HPACK),
        ("4.3 a table larger than allowed", [frame(HEADERS, BOTH, 1, b"\x3f\xe2\x1f" + fields())], HPACK),
        ("4.3 a table's size behind a field", [block(b"\x20")], HPACK),
        ("4.3 a table's size is taken", [frame(HEADERS, BOTH, 1, b"\x20\x3f\xe1\x1f" + fields())], {"200"}),
        ("4.3 another frame within a block", [split + frame(PRIORITY, 0, 1, priority) + rest], connection("PROTOCOL")),
        ("4.3 another stream within a block", [split + request(3) + rest], connection("PROTOCOL")),
        ("4.3 DATA within a block", [frame(HEADERS, 0, 1, fields()) + frame(DATA, END_STREAM, 1)], connection("PROTOCOL")),
        ("4.3 a bad block in trailers", [OPEN + frame(HEADERS, BOTH, 1, b"\x80")], HPACK),
        ("5.1 idle: DATA", [frame(DATA, END_STREAM, 1, b"a")], connection("PROTOCOL", "STREAM_CLOSED")),
        ("5.1 idle: RST_STREAM", [rst(1)], connection("PROTOCOL")),
        ("5.1 idle: WINDOW_UPDATE", [update(1, 1)], connection("PROTOCOL")),
        ("5.1 idle: CONTINUATION", [frame(CONTINUATION, END_HEADERS, 1, fields())], connection("PROTOCOL")),
        ("5.1 idle: PRIORITY is fine", [frame(PRIORITY, 0, 1, priority) + request(1)], {"200"}),
        ("5.1 half-closed: DATA", [half + frame(DATA, END_STREAM, 1, b"a")], stream("STREAM_CLOSED")),
        ("5.1 half-closed: HEADERS", [half + frame(HEADERS, BOTH, 1, field(b"a", b"b"))], stream("STREAM_CLOSED")),
        ("5.1 half-closed: CONTINUATION", [half + frame(CONTINUATION, END_HEADERS, 1, field(b"a", b"b"))], connection("PROTOCOL")),
        ("5.1 half-closed: WINDOW_UPDATE", [half + update(1, 2**20), WAIT], {"200"}),
        ("5.1 closed: HEADERS", [request(1), WAIT, request(1)], connection("PROTOCOL", "STREAM_CLOSED")),
        ("5.1 closed: CONTINUATION", [request(1), WAIT, late], connection("PROTOCOL", "STREAM_CLOSED")),
        ("5.1 closed: PRIORITY is fine", [request(1), WAIT, frame(PRIORITY, 0, 1, priority) + request(3)], {"200"}),
        ("5.1.1 an even stream", [request(2)], connection("PROTOCOL")),
        ("5.1.1 a stream behind a later one", [request(5) + request(3)], connection("PROTOCOL", "STREAM_CLOSED")),
        ("5.5 an unknown frame within a block", [split + frame(0xF0, 0, 1) + rest], connection("PROTOCOL")),
        ("6.1 DATA on stream 0", [frame(DATA, 0, 0, b"a")], connection("PROTOCOL")),
        ("6.1 DATA: padding as long as it", [OPEN + frame(DATA, PADDED, 1, b"\x05aaaa")], connection("PROTOCOL")),
        ("6.1 DATA: padding of no length", [OPEN + frame(DATA, PADDED, 1)], connection("FRAME_SIZE", "PROTOCOL")),
        ("6.2 HEADERS on stream 0", [request(0)], connection("PROTOCOL")),
        ("6.2 HEADERS: padding longer than it", [frame(HEADERS, BOTH | PADDED, 1, b"\xff" + fields())], connection("PROTOCOL")),
        ("6.2 HEADERS: padding is fine", [frame(HEADERS, BOTH | PADDED, 1, b"\x05" + fields() + bytes(5))], {"200"}),
        ("6.2 HEADERS: a priority of 3 bytes", [frame(HEADERS, BOTH | HAS_PRIORITY, 1, bytes(3))], connection("FRAME_SIZE", "PROTOCOL")),
        ("6.2 HEADERS: a priority is fine", [frame(HEADERS, BOTH | HAS_PRIORITY, 1, priority + fields())], {"200"}),
        ("6.3 PRIORITY on stream 0", [frame(PRIORITY, 0, 0, priority)], connection("PROTOCOL")),
        ("6.3 PRIORITY of 4 bytes", [OPEN + frame(PRIORITY, 0, 1, bytes(4))], stream("FRAME_SIZE")),
        ("6.4 RST_STREAM on stream 0", [rst(0)], connection("PROTOCOL")),
        ("6.4 RST_STREAM of 3 bytes", [OPEN + frame(RST_STREAM, 0, 1, bytes(3))], connection("FRAME_SIZE")),
        ("6.4 RST_STREAM of an unknown code", [OPEN + rst(1, 0xFFFFFFFF) + request(3)], {"200"}),
        ("6.5 SETTINGS of 5 bytes", [frame(SETTINGS, 0, 0, bytes(5))], connection("FRAME_SIZE")),
        ("6.5 SETTINGS on a stream", [frame(SETTINGS, 0, 1)], connection("PROTOCOL")),
        ("6.5 an acknowledgement with bytes", [frame(SETTINGS, ACK, 0, bytes(6))], connection("FRAME_SIZE")),
        ("6.5.2 push of 2", [settings((2, 2))], connection("PROTOCOL")),
        ("6.5.2 a window of 2^31", [settings((4, 2**31))], connection("FLOW_CONTROL")),
        ("6.5.2 frames of 16,383", [settings((5, 16_383))], connection("PROTOCOL")),
        ("6.5.2 frames of 2^24", [settings((5, 1 << 24))], connection("PROTOCOL")),
        ("6.5.2 an unknown setting is ignored", [settings((0xFFFF, 2**32 - 1)) + request(1)], {"200"}),
        ("6.5.2 a table of 2^32 - 1", [settings((1, 2**32 - 1)) + request(1)], {"200"}),
        ("6.5.2 the largest of all", [settings((3, 2**32 - 1), (4, 2**31 - 1), (5, 2**24 - 1), (6, 2**32 - 1)) + request(1)], {"200"}),
        ("6.6 PUSH_PROMISE", [OPEN + frame(PUSH_PROMISE, END_HEADERS, 1, (2).to_bytes(4, "big") + fields())], connection("PROTOCOL")),
        ("6.7 PING on a stream", [frame(PING, 0, 1, bytes(8))], connection("PROTOCOL")),
        ("6.7 PING of 6 bytes", [frame(PING, 0, 0, bytes(6))], connection("FRAME_SIZE")),
        ("6.7 an unasked answer is ignored", [frame(PING, ACK, 0, b"lodestar") + request(1)], {"200"}),
        ("6.8 GOAWAY on a stream", [frame(GOAWAY, 0, 1, bytes(8))], connection("PROTOCOL")),
        ("6.8 GOAWAY of 4 bytes", [frame(GOAWAY, 0, 0, bytes(4))], connection("FRAME_SIZE", "PROTOCOL")),
        ("6.9 the connection's window by 0", [update(0, 0)], connection("PROTOCOL")),
        ("6.9 a stream's window by 0", [OPEN + update(1, 0)], stream("PROTOCOL")),
        ("6.9 WINDOW_UPDATE of 3 bytes", [frame(WINDOW_UPDATE, 0, 0, bytes(3))], connection("FRAME_SIZE")),
        ("6.9.1 the connection's window past 2^31", [update(0, 2**31 - 1) + update(0, 2**31 - 1)], connection("FLOW_CONTROL")),
        ("6.9.1 a stream's window past 2^31", [OPEN + update(1, 2**31 - 1) + update(1, 2**31 - 1)], stream("FLOW_CONTROL")),
        ("6.9.2 settings take it past 2^31", [half + update(1, 2**31 - 1) + settings((4, 2**31 - 1))], connection("FLOW_CONTROL")),
        ("6.9.2 a window below 0", [request(1, rig.target.good_path) + settings((4, 0)) + settings((4, 2**20)), WAIT], {"200"}),
        ("6.10 CONTINUATION on stream 0", [split + frame(CONTINUATION, END_HEADERS, 0)], connection("PROTOCOL")),
        ("6.10 CONTINUATION behind a whole block", [OPEN + frame(CONTINUATION, END_HEADERS, 1, field(b"a", b"b"))], connection("PROTOCOL")),
        ("6.10 CONTINUATION behind DATA", [OPEN + frame(DATA, 0, 1, b"a") + frame(CONTINUATION, END_HEADERS, 1)], connection("PROTOCOL")),
        ("6.10 a block in three frames", [split + frame(CONTINUATION, 0, 1) + rest], {"200"}),
        ("8.1 trailers that do not end it", [trailers(END_HEADERS, (b"a", b"b"))], MALFORMED),
        ("8.1 trailers with a pseudo field", [trailers(BOTH, (b":path", b"/"))], MALFORMED),
        ("8.1.1 longer than said", [posted(b"1", b"aaaa")], MALFORMED),
        ("8.1.1 shorter than said", [posted(b"9", b"aaaa")], MALFORMED),
        ("8.1.1 longer in two frames", [posted(b"5", b"aaaa", b"aaaa")], MALFORMED),
        ("8.1.1 none where some was said", [frame(HEADERS, BOTH, 1, fields("/v1/pages", "POST", (b"content-length", b"9")))], MALFORMED),
        ("8.1.1 a length that is none", [posted(b"-1", b"aaaa")], MALFORMED),
        ("8.1.1 two lengths", [frame(HEADERS, BOTH, 1, fields("/v1/pages", "POST", *lengths))], MALFORMED),
        ("8.2.1 a name in capitals", [with_fields((b"A", b"b"))], MALFORMED),
        ("8.2.1 a name with a space", [with_fields((b"a b", b"c"))], MALFORMED),
        ("8.2.1 a name with a colon", [with_fields((b"a:b", b"c"))], MALFORMED),
        ("8.2.1 a name with a control byte", [with_fields((b"a\x01", b"c"))], MALFORMED),
        ("8.2.1 no name", [with_fields((b"", b"c"))], MALFORMED),
        ("8.2.1 NUL in a value", [with_fields((b"a", b"b\0c"))], MALFORMED),
        ("8.2.1 LF in a value", [with_fields((b"a", b"b\nc"))], MALFORMED),
        ("8.2.1 CR in a value", [with_fields((b"a", b"b\rc"))], MALFORMED),
        ("8.2.1 a space before a value", [with_fields((b"a", b" b"))], MALFORMED),
        ("8.2.2 connection", [with_fields((b"connection", b"close"))], MALFORMED),
        ("8.2.2 keep-alive", [with_fields((b"keep-alive", b"timeout=5"))], MALFORMED),
        ("8.2.2 proxy-connection", [with_fields((b"proxy-connection", b"close"))], MALFORMED),
        ("8.2.2 transfer-encoding", [with_fields((b"transfer-encoding", b"chunked"))], MALFORMED),
        ("8.2.2 upgrade", [with_fields((b"upgrade", b"h2c"))], MALFORMED),
        ("8.2.2 te: gzip", [with_fields((b"te", b"gzip"))], MALFORMED),
        ("8.2.2 te: trailers is fine", [with_fields((b"te", b"trailers"))], {"200"}),
        ("8.3 an unknown pseudo field", [with_fields((b":lodestar", b"a"))], MALFORMED),
        ("8.3 a status in a request", [with_fields((b":status", b"200"))], MALFORMED),
        ("8.3 a pseudo field behind others", [with_fields(scheme, (b"a", b"b"), path, pseudo=pseudo(method=b"GET"))], MALFORMED),
        ("8.3.1 no method", [with_fields(scheme, path, pseudo=b"")], MALFORMED),
        ("8.3.1 no scheme", [with_fields(method, path, pseudo=b"")], MALFORMED),
        ("8.3.1 no path", [with_fields(method, scheme, pseudo=b"")], MALFORMED),
        ("8.3.1 an empty path", [with_fields(method, scheme, (b":path", b""), pseudo=b"")], MALFORMED),
        ("8.3.1 a path without a slash", [with_fields(method, scheme, (b":path", b"healthz"), pseudo=b"")], MALFORMED),
        ("8.3.1 two methods", [with_fields(method, pseudo=pseudo(method=b"GET", scheme=b"http", path=b"/healthz"))], MALFORMED),
        ("8.3.1 two schemes", [with_fields(scheme, pseudo=pseudo(method=b"GET", scheme=b"http", path=b"/healthz"))], MALFORMED),
        ("8.3.1 two paths", [with_fields(path, pseudo=pseudo(method=b"GET", scheme=b"http", path=b"/healthz"))], MALFORMED),
        ("8.3.1 an authority with a user", [with_fields(scheme, path, (b":authority", b"u@a"), pseudo=pseudo(method=b"GET"))], MALFORMED),
        ("8.3.1 OPTIONS *", [request(1, "*", "OPTIONS")], {"200", "204", "400", "404", "405"}),
        ("8.5 CONNECT with a path", [with_fields(to, scheme, path, pseudo=pseudo(method=b"CONNECT"))], MALFORMED | {"405"}),
        ("8.5 CONNECT", [with_fields(to, pseudo=pseudo(method=b"CONNECT"))], MALFORMED | {"405", "501"}),
    ]


def run(port: int, steps: list) -> str:
    with Http2(port, b"") as peer:
        if not steps[0].startswith(PREFACE):
            peer.send(START)
        for step in steps:
            peer.wait_answer() if step is WAIT else peer.send(step)
        seen = len(peer.frames)
        # An error may come behind an answer, so that one counts only once nothing else came.
        peer.read(1, lambda one: one.kind in (RST_STREAM, GOAWAY))
        if peer.end().startswith("GOAWAY"):
            peer.read(1)
            return peer.end() if peer.closed else f"{peer.end()}, still open"
        return peer.outcome(3 if any(one.stream == 3 for one in peer.frames[seen:]) else 1)


def conform(rig) -> None:
    with rig.attack("RFC 9113, rule by rule") as row:
        rules = cases(rig)
        row.attempts, other_code, passed = len(rules), 0, 0
        for (name, _, allowed), outcome in zip(rules, together(run, [(rig.port, steps) for _, steps, _ in rules], 16)):
            # The connection is gone as it must be, and only the reason is another: the library says PROTOCOL where there is a name for it.
            other = outcome == "GOAWAY PROTOCOL" and any(one.startswith("GOAWAY") for one in allowed)
            other_code += other and outcome not in allowed
            passed += name in LET_PASS and outcome not in allowed
            row.check(outcome in allowed or other or name in LET_PASS, f"{name}: {' or '.join(sorted(allowed))}", outcome)
        right = len(rules) - len(row.faults) - other_code - passed
        row.note(f"{right} as the RFC says, {other_code} cut with PROTOCOL for another code, {passed} let pass by the library")
    with rig.attack("prefaces that are none") as row:
        starts = [b"PRI * HTTP/2.0\r\n\r\nXX\r\n\r\n", PREFACE[:-1] + b"X" + settings(), PREFACE.lower() + settings(),
                  settings() + request(1), PREFACE + PREFACE, PREFACE + b"GET / HTTP/1.1\r\nHost: a\r\n\r\n", PREFACE + bytes(1000),
                  PREFACE + b"\xff" * 1000]
        for start in starts:
            with Http2(rig.port, start) as peer:
                peer.read(2)
                row.check(peer.closed, f"{start[:40]}: closed", "open")
        row.attempts = len(starts)
        row.note("closed each")
