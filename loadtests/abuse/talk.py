"""Raw bytes to a server over TCP, and what came back."""

import contextlib
import dataclasses
import functools
import selectors
import socket
import struct
import time
from concurrent.futures import ThreadPoolExecutor


@dataclasses.dataclass
class Answer:
    status: int
    headers: dict
    body: bytes
    whole: bool


@dataclasses.dataclass
class Talk:
    raw: bytes
    closed: bool
    sent_bytes: int

    @functools.cached_property
    def answers(self) -> list:
        return parse(self.raw)

    @property
    def outcome(self) -> object:
        """The first answer's status; else `closed` or `silent`."""
        answers = self.answers
        return answers[0].status if answers else "closed" if self.closed else "silent"


def parse(raw: bytes) -> list:
    """All answers; the last one may be cut."""
    answers, at = [], 0
    while raw.startswith(b"HTTP/1.", at) and (end := raw.find(b"\r\n\r\n", at)) >= 0:
        lines = raw[at:end].split(b"\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(b":") for line in lines[1:])}
        at = end + 4
        if b"content-length" in headers:
            length = int(headers[b"content-length"])
            body, whole = raw[at : at + length], len(raw) >= at + length
            at += length
        elif headers.get(b"transfer-encoding") == b"chunked":
            body, at, whole = unchunk(raw, at)
        else:
            body, whole = b"", True
        answers.append(Answer(int(lines[0].split()[1]), headers, body, whole))
    return answers


def unchunk(raw: bytes, at: int) -> tuple:
    """The body, where it ends, and whether it came to its end."""
    body = bytearray()
    while (end := raw.find(b"\r\n", at)) >= 0:
        count = int(raw[at:end], 16)
        body += raw[end + 2 : end + 2 + count]
        at = end + 4 + count
        if at > len(raw):
            break
        if count == 0:
            return bytes(body), at, True
    return bytes(body), len(raw), False


def connect(port: int, receive_bytes: int = 0) -> socket.socket:
    """`receive_bytes`: as few as the system allows where that is small, so that the server's side fills at once."""
    peer = socket.socket()
    if receive_bytes:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    peer.settimeout(10)
    peer.connect(("127.0.0.1", port))
    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return peer


def reset(peer: socket.socket) -> None:
    """Closes with RST."""
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    peer.close()


def talk(port: int, data, secs: float = 5, answers: int = 1, half_close: bool = False, linger: float = 0.05) -> Talk:
    """Sends `data`, bytes or an iterable, while it reads. Ends when the server closes, after `secs`, or `linger` after so many answers."""
    pieces = iter([data]) if isinstance(data, bytes) else iter(data)
    raw, sent, left, closed, shut = bytearray(), 0, b"", False, False
    with connect(port) as peer, selectors.DefaultSelector() as selector:
        peer.setblocking(False)
        selector.register(peer, selectors.EVENT_READ | selectors.EVENT_WRITE)
        deadline = time.monotonic() + secs
        while not closed and time.monotonic() < deadline:
            for _, events in selector.select(min(0.05, linger)):
                try:
                    if events & selectors.EVENT_READ:
                        piece = peer.recv(1 << 18)
                        raw += piece
                        closed = not piece
                        # Counted before they are parsed: there may be a thousand.
                        if raw.count(b"HTTP/1.") >= answers <= sum(answer.whole for answer in parse(bytes(raw))):
                            deadline = min(deadline, time.monotonic() + linger)
                    if events & selectors.EVENT_WRITE:
                        left = left or next(pieces, b"")
                        if left:
                            count = peer.send(left)
                            sent, left = sent + count, left[count:]
                        else:
                            if half_close and not shut:
                                peer.shutdown(socket.SHUT_WR)
                            shut = True
                            selector.modify(peer, selectors.EVENT_READ)
                except BlockingIOError:
                    pass
                except OSError:
                    closed = True
                    # What came before the reset is still there to be read.
                    with contextlib.suppress(OSError):
                        while piece := peer.recv(1 << 18):
                            raw += piece
    return Talk(bytes(raw), closed, sent)


def together(function, cases: list, threads: int = 8) -> list:
    """Each case's result, some at a time: most of their time is waiting."""
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda case: function(*case), cases))


def tally(outcomes: list) -> str:
    """How often each came: `400 x 12, closed x 3`."""
    counts = {}
    for outcome in outcomes:
        counts[outcome] = counts.get(outcome, 0) + 1
    return ", ".join(f"{outcome} x {count:,}" for outcome, count in sorted(counts.items(), key=str))
