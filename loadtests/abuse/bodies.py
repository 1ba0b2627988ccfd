"""Bodies of `POST /v1/pages` that are too large, nested, cut, or not JSON at all."""

import json
import secrets
import struct
import time
from concurrent.futures import ThreadPoolExecutor

from talk import talk, tally, together

HEAD = b"POST /v1/pages HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\n"
# The most that a post may have (MAX_POST_BYTES), and what may be on its way when the answer comes.
MOST_BYTES = 16 << 20
ON_ITS_WAY = 32 << 20


def post(body: bytes) -> bytes:
    return HEAD + b"Content-Length: %d\r\n\r\n" % len(body) + body


def wants(rig, count: int, first: object = 0, last: object = 0, priority: object = 1, viewer: object = 1) -> bytes:
    want = {"asset": rig.target.asset, "first": first, "last": last, "priority": priority}
    return json.dumps({"viewer": viewer, "sequence": 1, "wants": [want] * count}).encode()


def endless():
    yield HEAD + b"Transfer-Encoding: chunked\r\n\r\n"
    for _ in range(4096):
        yield b"10000\r\n" + b" " * 0x10000 + b"\r\n"


def bombs() -> list:
    """What other decoders would take for lengths of 2^60."""
    large = [
        struct.pack("<Q", 1 << 60),
        b"\xfd" + struct.pack("<Q", 1 << 60),
        b"\xff" * 16,
        b"\xdd\xff\xff\xff\xff",
        b"\x9b\x7f" + b"\xff" * 7,
    ]
    return [prefix * times for prefix in large for times in (1, 2, 64)]


def bodies(rig) -> None:
    whole = wants(rig, 1)
    cases = [
        ("nothing", b"", {400}),
        ("lists in lists", b"[" * 1_000_000, {400}),
        ("objects in objects", b'{"a":' * 200_000, {400}),
        ("lists in an unknown field", b'{"viewer":1,"x":' + b"[" * 100_000 + b"]" * 100_000 + b',"sequence":1,"wants":[]}', {200, 400}),
        ("lists for wants", b'{"viewer":1,"sequence":1,"wants":' + b"[" * 1_000_000, {400}),
        ("a text of 15 MiB", b'{"viewer":"' + b"a" * (15 << 20), {400}),
        ("a text for a number", whole.replace(b'"viewer": 1', b'"viewer": "1"'), {400}),
        ("a negative viewer", wants(rig, 1, viewer=-1), {400}),
        ("a viewer of 2^64", wants(rig, 1, viewer=2**64), {400}),
        ("half a page", wants(rig, 1, first=0.5), {400}),
        ("page 2^32", wants(rig, 1, last=2**32), {400}),
        ("1e999", whole.replace(b'"priority": 1', b'"priority": 1e999'), {400}),
        ("1e39", whole.replace(b'"priority": 1', b'"priority": 1e39'), {400}),
        ("NaN", whole.replace(b'"priority": 1', b'"priority": NaN'), {400}),
        ("a number of 1 MiB", whole.replace(b'"priority": 1', b'"priority": ' + b"1" * (1 << 20)), {400}),
        ("a field twice", b'{"viewer":1,' + whole[1:], {400}),
        ("no wants", b'{"viewer":1,"sequence":1}', {400}),
        ("a hash of 63 digits", whole.replace(rig.target.asset.encode(), rig.target.asset[1:].encode()), {400}),
        ("a hash of another alphabet", whole.replace(rig.target.asset.encode(), b"z" * 64), {400}),
        ("half a surrogate", b'{"viewer":1,"sequence":1,"wants":[],"\\ud800":1}', {400}),
        ("no UTF-8", b'{"\xff\xfe":1}', {400}),
        ("UTF-16", whole.decode().encode("utf-16"), {400}),
        ("a byte order mark", b"\xef\xbb\xbf" + whole, {400}),
        ("two values", whole + whole, {400}),
        ("a cut value", whole[:-1], {400}),
        ("NUL behind the value", whole + b"\0", {400}),
        ("last before first", wants(rig, 1, first=2, last=1), {400}),
        ("all pages there could be", wants(rig, 1, last=2**32 - 1), {413}),
        ("65,537 pages", wants(rig, 1, last=65_536), {413}),
        ("65,537 ranges", wants(rig, 65_537), {413}),
        ("60,000 times all pages", wants(rig, 60_000, last=rig.target.last_page), {413}),
        ("a body of 17 MiB", b" " * (17 << 20), {413, "closed"}),
        ("65,536 equal ranges", wants(rig, 65_536), {200}),
        ("65,536 pages past the end", wants(rig, 1, first=10**6, last=10**6 + 65_535), {200}),
    ]
    cases += [("lengths of 2^60", bomb, {400}) for bomb in bombs()]
    cases += [("random bytes", secrets.token_bytes(size), {400}) for size in (1, 100, 10_000, 1_000_000)]
    with rig.attack("posts that are none") as row:
        row.attempts = len(cases)
        outcomes = [found.outcome for found in together(lambda body: talk(rig.port, post(body), 15), [(body,) for _, body, _ in cases])]
        for (name, _, allowed), outcome in zip(cases, outcomes):
            row.check(outcome in allowed, f"{name}: {allowed}", outcome)
        row.note(tally(outcomes))
    with rig.attack("posts without an end") as row:
        declared = HEAD + b"Content-Length: 10000000000\r\n\r\n"
        found = [
            ("10 GB declared, none sent", talk(rig.port, declared, 3)),
            ("10 GB declared, sent", talk(rig.port, [declared] + [b" " * 65_536] * 4096, 20, linger=2)),
            ("chunks without end", talk(rig.port, endless(), 20, linger=2)),
        ]
        row.attempts = len(found)
        for name, one in found[1:]:
            row.check(one.outcome in {413, "closed"}, f"{name}: 413", one.outcome)
            row.check(one.sent_bytes < MOST_BYTES + ON_ITS_WAY, f"{name}: cut after about 16 MiB", f"{one.sent_bytes >> 20} MiB taken")
        row.note(", ".join(f"{one.outcome} after {one.sent_bytes >> 20} MiB" for _, one in found))
    with rig.attack("20,000 viewers") as row:
        row.attempts = 20_000
        raw = [post(wants(rig, 0, viewer=viewer)) for viewer in range(row.attempts)]
        for first in range(0, row.attempts, 1000):
            found = talk(rig.port, b"".join(raw[first : first + 1000]), 20, answers=1000)
            row.check(
                [answer.status for answer in found.answers] == [200] * 1000, "200 x 1,000", tally([answer.status for answer in found.answers])
            )
        row.note("200 each")
    with rig.attack("64 posts of 15 MiB that stop") as row:
        # Each may be right so far: its bytes are kept until it is whole, or falls behind the pace.
        row.attempts = 64
        body = b" " * (15 << 20)
        announced = HEAD + b"Content-Length: %d\r\n\r\n" % MOST_BYTES + body
        chunked = HEAD + b"Transfer-Encoding: chunked\r\n\r\n%x\r\n" % len(body) + body
        cases = [(rig.port, raw, 90) for raw in (announced, chunked) * (row.attempts // 2)]
        with ThreadPoolExecutor(1) as aside:
            attack = aside.submit(together, talk, cases, row.attempts)
            small, slowest = [], 0.0
            while not attack.done():
                started = time.monotonic()
                small.append(talk(rig.port, post(wants(rig, 1)), 10).outcome)
                slowest = max(slowest, time.monotonic() - started)
                time.sleep(0.05)
            ended = [one.outcome for one in attack.result()]
        # 400 where the socket's own limit cut the body.
        row.check(set(ended) <= {400, 408, 503, "closed"}, "400, 408, 503 or closed", tally(ended))
        row.check(set(small) == {200}, "200 for small posts of the same client meanwhile", tally(small))
        row.note(f"{tally(ended)}; {len(small)} small posts meanwhile, the slowest in {slowest * 1e3:.0f} ms")
