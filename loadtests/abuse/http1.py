"""HTTP/1 that is wrong: heads, ranges and paths."""

import secrets

from talk import talk, tally, together

HEALTH = b"GET /healthz HTTP/1.1\r\n"
HOST = b"Host: a\r\n"
# Behind a request that is refused: an answer to it means that the server took part of one message for another.
SECOND = b"GET /healthz HTTP/1.1\r\nHost: a\r\n\r\n"
POST = b"POST /v1/pages HTTP/1.1\r\nHost: a\r\n"
CHUNKED = POST + b"Transfer-Encoding: chunked\r\n\r\n"


def get(*lines: bytes) -> bytes:
    return HEALTH + HOST + b"".join(line + b"\r\n" for line in lines) + b"\r\n"


def line(text: bytes) -> bytes:
    return text + b"\r\n" + HOST + b"\r\n"


def with_length(value: bytes) -> bytes:
    return POST + b"Content-Length: " + value + b"\r\n\r\n{}"


# What it is, bytes, what may come (RFC 9110 and 9112; `closed` where a server may give up before it answers).
HEADS = [
    ("101 headers", get(*(b"a%d: b" % n for n in range(101))), {431, 400}),
    ("10,000 headers", get(*(b"a%d: b" % n for n in range(10_000))), {431, 400, "closed"}),
    ("a header of 1 MiB", get(b"a: " + b"b" * (1 << 20)), {431, 400, "closed"}),
    ("a header's name of 1 MiB", get(b"a" * (1 << 20) + b": b"), {431, 400, "closed"}),
    ("a path of 70 KiB", line(b"GET /" + b"a" * 70 * 1024 + b" HTTP/1.1"), {414, 431}),
    ("a path of 1 MiB", line(b"GET /" + b"a" * (1 << 20) + b" HTTP/1.1"), {414, 431, "closed"}),
    ("a method of 1 MiB", line(b"A" * (1 << 20) + b" / HTTP/1.1"), {400, 414, 431, 501, "closed"}),
    ("no Host", HEALTH + b"\r\n", {400}),
    ("two Hosts", HEALTH + HOST + b"Host: b\r\n\r\n", {400}),
    ("two equal Hosts", HEALTH + HOST + HOST + b"\r\n", {400}),
    ("a Host with a space", HEALTH + b"Host: a b\r\n\r\n", {400}),
    ("a Host with a slash", HEALTH + b"Host: a/b\r\n\r\n", {400}),
    ("a Host with a user", HEALTH + b"Host: u@a\r\n\r\n", {400}),
    ("NUL in a value", get(b"a: b\0c"), {400}),
    ("NUL in a name", get(b"a\0: b"), {400}),
    ("CR in a value", get(b"a: b\rc"), {400}),
    ("a control byte in a value", get(b"a: b\x01c"), {400}),
    ("a space before the colon", get(b"a : b"), {400}),
    ("an empty name", get(b": b"), {400}),
    ("a name with a slash", get(b"a/b: c"), {400}),
    ("a line without a colon", get(b"ab"), {400}),
    ("a space before the first header", HEALTH + b" a: b\r\n" + HOST + b"\r\n", {400}),
    ("a folded header", get(b"a: b\r\n c"), {400}),
    ("a method with a space", line(b"GE T / HTTP/1.1"), {400}),
    ("a method with NUL", line(b"GE\0T / HTTP/1.1"), {400}),
    ("a method with @@", line(b"G(T / HTTP/1.1"), {400, 405, 501}),
    ("no method", line(b" / HTTP/1.1"), {400}),
    ("no path", line(b"GET  HTTP/1.1"), {400}),
    ("a path with a space", line(b"GET /a b HTTP/1.1"), {400}),
    ("a path with NUL", line(b"GET /\0 HTTP/1.1"), {400}),
    ("a path with a control byte", line(b"GET /\x01 HTTP/1.1"), {400}),
    ("version 9.9", line(b"GET /healthz HTTP/9.9"), {400, 505}),
    ("version 2.0", line(b"GET /healthz HTTP/2.0"), {400, 505}),
    ("version 1.1 in small letters", line(b"GET /healthz http/1.1"), {400}),
    ("no version", line(b"GET /healthz"), {400, "closed"}),
    ("TLS's first bytes", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(200) + b"\r\n\r\n", {400, "closed"}),
    ("random bytes", secrets.token_bytes(4096) + b"\r\n\r\n", {400, 431, "closed"}),
    ("two lengths", POST + b"Content-Length: 2\r\nContent-Length: 3\r\n\r\n{}", {400}),
    ("two lengths in a line", with_length(b"2, 3"), {400}),
    ("a negative length", with_length(b"-1"), {400}),
    ("a length with a sign", with_length(b"+2"), {400}),
    ("a length in hexadecimal", with_length(b"0x2"), {400}),
    ("a length with a space", with_length(b"2 2"), {400}),
    ("a length of 2^64", with_length(b"18446744073709551616"), {400}),
    ("a length of 1,000 digits", with_length(b"9" * 1000), {400}),
    ("no number for a length", with_length(b"two"), {400}),
    ("an empty length", with_length(b""), {400}),
    ("chunked, then something else", POST + b"Transfer-Encoding: chunked, identity\r\n\r\n2\r\n{}\r\n0\r\n\r\n", {400, 501}),
    ("an unknown coding", POST + b"Transfer-Encoding: xchunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n", {400, 501}),
    ("chunked in HTTP/1.0", b"POST /v1/pages HTTP/1.0\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n", {400, "closed"}),
    ("a chunk of 2^64", CHUNKED + b"10000000000000000\r\n{}", {400, 413, "closed"}),
    ("a chunk of 100 digits", CHUNKED + b"F" * 100 + b"\r\n{}", {400, 413, "closed"}),
    ("a negative chunk", CHUNKED + b"-2\r\n{}\r\n0\r\n\r\n", {400, 413, "closed"}),
    ("a chunk in 0x", CHUNKED + b"0x2\r\n{}\r\n0\r\n\r\n", {400, 413, "closed"}),
    ("a chunk without a size", CHUNKED + b"\r\n{}\r\n0\r\n\r\n", {400, 413, "closed"}),
    ("a chunk that is longer than said", CHUNKED + b"2\r\n{}{}\r\n0\r\n\r\n", {400, 413, "closed"}),
    ("an extension of 1 MiB", CHUNKED + b"2;" + b"a" * (1 << 20) + b"\r\n{}\r\n0\r\n\r\n", {400, 413, "closed"}),
    ("trailers of 1 MiB", CHUNKED + b"2\r\n{}\r\n0\r\na: " + b"b" * (1 << 20) + b"\r\n\r\n", {400, 413, 431, "closed"}),
    ("10,000 trailers", CHUNKED + b"2\r\n{}\r\n0\r\n" + b"a: b\r\n" * 10_000 + b"\r\n", {400, 413, 431, "closed"}),
]
# Right or let pass: as many answers as requests.
TOLERATED = [
    ("HTTP/1.0 without Host", b"GET /healthz HTTP/1.0\r\n\r\n", {200}),
    ("an unknown method", line(b"FOO /healthz HTTP/1.1"), {405, 501}),
    ("TRACE", line(b"TRACE /healthz HTTP/1.1"), {405, 501}),
    ("CONNECT", b"CONNECT a:1 HTTP/1.1\r\nHost: a:1\r\n\r\n", {400, 404, 405, 501}),
    ("OPTIONS *", line(b"OPTIONS * HTTP/1.1"), {200, 204, 400, 404, 405}),
    ("the whole URL", b"GET http://b/healthz HTTP/1.1\r\n" + HOST + b"\r\n", {200}),
    ("bare LF", b"GET /healthz HTTP/1.1\nHost: a\n\n", {200, 400}),
    ("version 1.2", line(b"GET /healthz HTTP/1.2"), {200, 400, 505}),
    ("an upgrade to h2c", get(b"Connection: Upgrade, HTTP2-Settings", b"Upgrade: h2c", b"HTTP2-Settings: AAMAAABkAAQAAP__"), {200}),
    ("a blank line before the request", b"\r\n" + SECOND, {200}),
    ("100,000 blank lines", b"\r\n" * 100_000 + SECOND, {200, 400, 431, "closed"}),
    ("100 headers", get(*(b"a%d: b" % n for n in range(90))), {200}),
    ("1 MiB in chunks of 1 byte", CHUNKED + b"1\r\n[\r\n" * (1 << 20) + b"0\r\n\r\n", {400, "closed"}),
]


def heads(rig) -> None:
    """The same on a route of the router's, and on that for pages, which the server may read by itself."""
    for path in ("/healthz", rig.target.good_path):
        wrong_heads(rig, path)
    with rig.attack("1,000 requests in one write") as row:
        row.attempts = 1000
        requests = [SECOND, on(rig.target.good_path, SECOND)] * (row.attempts // 2)
        found = talk(rig.port, b"".join(requests), 20, answers=row.attempts)
        bodies = {answer.body for answer in found.answers}
        row.check([answer.status for answer in found.answers] == [200] * row.attempts, "200 x 1,000", tally(statuses(found)))
        row.check(len(bodies) == 2 and all(answer.whole for answer in found.answers), "two bodies, whole, by turns", len(bodies))
        row.note(tally(statuses(found)))


def on(path: str, data: bytes) -> bytes:
    return data.replace(b"/healthz", path.encode())


def statuses(found) -> list:
    return [answer.status for answer in found.answers]


def wrong_heads(rig, path: str) -> None:
    with rig.attack(f"heads that are wrong, {'/'.join(path.split('/')[:3])}") as row:
        outcomes = together(lambda data: talk(rig.port, data), [(on(path, data + SECOND),) for _, data, _ in HEADS])
        for (name, _, allowed), found in zip(HEADS, outcomes):
            right = found.outcome in allowed and len(found.answers) <= 1
            row.check(right, f"{name}: {allowed}, no second answer", statuses(found) or found.outcome)
        tolerated = together(lambda data: talk(rig.port, data, 20), [(on(path, data),) for _, data, _ in TOLERATED])
        for (name, _, allowed), found in zip(TOLERATED, tolerated):
            row.check(found.outcome in allowed, f"{name}: {allowed}", found.outcome)
        # A length beside chunks (RFC 9112, 6.3): an error, or the chunks count and nothing follows on the connection.
        for lines in (b"Content-Length: 5\r\nTransfer-Encoding: chunked", b"Transfer-Encoding: chunked\r\nContent-Length: 5"):
            for begin in (POST, on(path, HEALTH + HOST)):
                found = talk(rig.port, begin + lines + b"\r\n\r\n0\r\n\r\n" + on(path, SECOND), linger=1)
                told = f"{statuses(found)}, {'closed' if found.closed else 'open'}"
                row.check(len(found.answers) == 1 and found.closed, "a length and chunks: one answer, closed", told)
        row.attempts = len(HEADS) + len(TOLERATED) + 4
        row.note(tally([found.outcome for found in outcomes + tolerated]))


def ranges(rig) -> None:
    whole, path = rig.target.hierarchy_bytes, rig.target.hierarchy
    end = len(whole)
    # The header, the status, what comes of the object. RFC 9110, 14.2: what is not understood is ignored, and several ranges may be.
    cases = [
        ("bytes=" + ",".join(f"{n}-" for n in range(1300)), 200, 0, end), ("bytes=" + ",".join(["0-0"] * 1300), 200, 0, end),
        ("bytes=0-0,-1", 200, 0, end), ("bytes=5-2", 200, 0, end), ("bytes=a-b", 200, 0, end), ("bytes=-", 200, 0, end),
        ("bytes=", 200, 0, end), ("bytes", 200, 0, end), ("lines=0-9", 200, 0, end), ("bytes=0x0-0x9", 200, 0, end),
        ("bytes=-1-2", 200, 0, end), ("bytes=1-2-3", 200, 0, end), ("bytes=+1-2", 200, 0, end), ("bytes=1.5-2", 200, 0, end),
        ("bytes=-0", 416, 0, 0), (f"bytes={end}-", 416, 0, 0), (f"bytes={end}-{end + 9}", 416, 0, 0), (f"bytes={2**63}-", 416, 0, 0),
        (f"bytes={2**64 - 1}-", 416, 0, 0), (f"bytes={2**64}-", 200, 0, end), (f"bytes={'9' * 1000}-", 200, 0, end),
        (f"bytes=0-{2**64 - 1}", 206, 0, end), (f"bytes=0-{2**63}", 206, 0, end), (f"bytes=-{2**64 - 1}", 206, 0, end),
        (f"bytes=-{end + 1}", 206, 0, end), ("bytes=0-0", 206, 0, 1), (f"bytes={end - 1}-", 206, end - 1, end),
        ("bytes=-1", 206, end - 1, end), ("bytes=7-99", 206, 7, 100),
    ]
    with rig.attack("ranges of an object") as row:
        row.attempts = len(cases)
        outcomes = []
        for header, status, first, last in cases:
            found = talk(rig.port, f"GET /v1/objects/{path} HTTP/1.1\r\nHost: a\r\nRange: {header}\r\n\r\n".encode()).answers
            outcomes.append(found[0].status if found else "closed")
            right = bool(found) and found[0].status == status and (status == 416 or found[0].body == whole[first:last])
            row.check(
                right, f"Range: {header[:40]}: {status} with bytes {first}..{last}", [(answer.status, len(answer.body)) for answer in found]
            )
        row.note(tally(outcomes))
