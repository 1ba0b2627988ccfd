"""HTTP/2 frame by frame, so that all that is wrong can be said. Nothing but the standard library: libraries refuse to say it."""

import collections
import select
import time

from talk import connect

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, PRIORITY, RST_STREAM, SETTINGS, PUSH_PROMISE, PING, GOAWAY, WINDOW_UPDATE, CONTINUATION = range(10)
END_STREAM, ACK, END_HEADERS, PADDED, HAS_PRIORITY = 1, 1, 4, 8, 32
CODES = [
    "NO_ERROR",
    "PROTOCOL",
    "INTERNAL",
    "FLOW_CONTROL",
    "SETTINGS_TIMEOUT",
    "STREAM_CLOSED",
    "FRAME_SIZE",
    "REFUSED",
    "CANCEL",
    "COMPRESSION",
    "CONNECT",
    "CALM",
]
Frame = collections.namedtuple("Frame", "kind flags stream payload")


def frame(kind: int, flags: int, stream: int, payload: bytes = b"", length: int | None = None) -> bytes:
    """`length`: what it claims to have, where that is not what it has."""
    claimed = len(payload) if length is None else length
    return claimed.to_bytes(3, "big") + bytes([kind, flags]) + stream.to_bytes(4, "big") + payload


def settings(*pairs: tuple) -> bytes:
    return frame(SETTINGS, 0, 0, b"".join(name.to_bytes(2, "big") + value.to_bytes(4, "big") for name, value in pairs))


def update(stream: int, increment: int) -> bytes:
    return frame(WINDOW_UPDATE, 0, stream, increment.to_bytes(4, "big"))


def rst(stream: int, code: int = 8) -> bytes:
    return frame(RST_STREAM, 0, stream, code.to_bytes(4, "big"))


def text(value: bytes) -> bytes:
    """A string as HPACK has it, not Huffman-coded."""
    length = len(value)
    if length < 127:
        return bytes([length]) + value
    head, length = b"\x7f", length - 127
    while length >= 128:
        head, length = head + bytes([length % 128 + 128]), length // 128
    return head + bytes([length]) + value


def field(name: bytes, value: bytes) -> bytes:
    """A literal that no table keeps."""
    return b"\0" + text(name) + text(value)


def fields(path: str = "/healthz", method: str = "GET", *more: tuple) -> bytes:
    pseudo = [(b":method", method.encode()), (b":scheme", b"http"), (b":authority", b"a"), (b":path", path.encode())]
    return b"".join(field(*pair) for pair in [*pseudo, *more])


def request(stream: int, path: str = "/healthz", method: str = "GET", end: bool = True, more: tuple = ()) -> bytes:
    return frame(HEADERS, END_HEADERS | (END_STREAM if end else 0), stream, fields(path, method, *more))


def status(block: bytes) -> int:
    """The status that a block begins with, as a server's first block on a connection has it; 0 where it is anything else."""
    known = {0x88: 200, 0x89: 204, 0x8A: 206, 0x8B: 304, 0x8C: 400, 0x8D: 404, 0x8E: 500}
    if block[0] in known:
        return known[block[0]]
    # A literal under the name of entry 8; three digits, as they are or Huffman-coded: 0, 1 and 2 in five bits, the others in six.
    if block[0] & 0x3F != 8 and block[0] & 0x0F != 8:
        return 0
    length, value = block[1] & 0x7F, block[2 : 2 + (block[1] & 0x7F)]
    if not block[1] & 0x80:
        return int(value)
    bits, digits = f"{int.from_bytes(value, 'big'):0{8 * length}b}", ""
    while len(digits) < 3:
        five, six = int(bits[:5], 2), int(bits[:6], 2)
        digits, bits = (digits + str(five), bits[5:]) if five < 3 else (digits + str(six - 0x16), bits[6:])
    return int(digits)


def ready(peer, reads: bool, writes: bool, secs: float) -> tuple:
    """Whether it can be read and written, as `select` tells it; but that takes no numbers from 1024 on."""
    poll = select.poll()
    poll.register(peer, select.POLLIN * reads | select.POLLOUT * writes)
    events = dict(poll.poll(max(0, secs) * 1000)).get(peer.fileno(), 0)
    over = events & (select.POLLHUP | select.POLLERR)
    return bool(reads and events & (select.POLLIN | over)), bool(writes and events & (select.POLLOUT | over))


class Http2:
    """A connection. What it reads is in `frames`; settings are acknowledged, pings are not."""

    def __init__(self, port: int, start: bytes = PREFACE + settings(), receive_bytes: int = 0):
        self.peer = connect(port, receive_bytes)
        self.frames, self.closed, self.raw, self.unacknowledged = [], False, b"", 0
        self.send(start)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.peer.close()

    def send(self, data: bytes, secs: float = 5, reads: bool = True) -> int:
        """Sends while it reads, unless it never does; gives the bytes that were taken."""
        sent, deadline = 0, time.monotonic() + secs
        view = memoryview(data)
        self.peer.setblocking(False)
        while sent < len(data) and not self.closed and time.monotonic() < deadline:
            readable, writable = ready(self.peer, reads, True, 0.1)
            if readable:
                self.take()
            if writable and not self.closed:
                try:
                    sent += self.peer.send(view[sent : sent + (1 << 16)])
                except BlockingIOError:
                    pass
                except OSError:
                    # What it said before it left may still be there.
                    self.read(0.2)
                    self.closed = True
        # Not within a frame.
        if sent == len(data) and self.unacknowledged and not self.closed:
            count, self.unacknowledged = self.unacknowledged, 0
            return sent + self.send(frame(SETTINGS, ACK, 0) * count, 1, False) - 9 * count
        return sent

    def take(self) -> None:
        try:
            piece = self.peer.recv(1 << 18)
        except BlockingIOError:
            return
        except OSError:
            piece = b""
        self.closed = not piece
        self.raw += piece
        at = 0
        while len(self.raw) >= at + 9 and len(self.raw) >= at + 9 + (length := int.from_bytes(self.raw[at : at + 3], "big")):
            head = self.raw[at : at + 9]
            self.frames.append(Frame(head[3], head[4], int.from_bytes(head[5:9], "big"), self.raw[at + 9 : at + 9 + length]))
            at += 9 + length
            self.unacknowledged += (head[3], head[4] & ACK) == (SETTINGS, 0)
        self.raw = self.raw[at:]

    def read(self, secs: float, until=lambda one: False) -> None:
        """Until a frame that is waited for, the end, or the time is over."""
        deadline, seen = time.monotonic() + secs, 0
        while not any(until(one) for one in self.frames[seen:]) and not self.closed:
            seen, left = len(self.frames), deadline - time.monotonic()
            if left <= 0:
                return
            if ready(self.peer, True, False, left)[0]:
                self.take()
                self.send(b"", reads=False)

    def end(self) -> str:
        """How the connection ended: `GOAWAY CODE`, `closed` or `open`."""
        for one in self.frames:
            if one.kind == GOAWAY and (code := int.from_bytes(one.payload[4:8], "big")):
                return f"GOAWAY {CODES[code]}"
        return "closed" if self.closed else "open"

    def outcome(self, stream: int = 1) -> str:
        """How the connection, else the stream, ended: as `end`, `RST_STREAM CODE`, a status, or `nothing`."""
        for one in self.frames:
            if one.kind == RST_STREAM and one.stream == stream:
                code = CODES[int.from_bytes(one.payload, "big")]
                if self.end() == "open" and code != "NO_ERROR":
                    return f"RST_STREAM {code}"
        if self.end() != "open":
            return self.end()
        for one in self.frames:
            if one.kind == HEADERS and one.stream == stream:
                return str(status(one.payload))
        return "nothing"

    def wait_answer(self, stream: int = 1, secs: float = 2) -> None:
        """Until the stream's answer is whole."""
        self.read(secs, lambda one: one.stream == stream and one.kind in (DATA, HEADERS) and one.flags & END_STREAM)
