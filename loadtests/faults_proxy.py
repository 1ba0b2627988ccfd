"""A proxy before a store that speaks S3, which breaks connections, bytes and answers, for `faults.py`."""

import asyncio
import collections
import random
import re

# Ports below those that systems give to connections: one that is closed for a while stays free.
ports = iter(range(21000, 30000))


class Fault(collections.namedtuple("Fault", "name kind share total", defaults=(1.0, False))):
    """`share` of the requests meet it; with `total` nothing can succeed."""

    @property
    def slug(self):
        return re.sub(r"\W+", "-", self.name)


class Proxy:
    """Stands before the store; `fault` is what it does from now on, or from the request number `fault_at` on."""

    loop = asyncio.new_event_loop()
    store_port = 0

    def __init__(self):
        self.requests, self.fault, self.fault_at = 0, None, None
        self.random, self.writers, self.server = random.Random(1), set(), None
        while not self.server:
            self.port = next(ports)
            try:
                self.call(self.listen())
            except OSError:
                pass  # Somebody else's.

    def call(self, coroutine):
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result()

    async def listen(self):
        self.server = await asyncio.start_server(self.connection, "127.0.0.1", self.port, limit=1 << 20)

    async def close(self):
        if self.server:
            self.server.close()
            self.server = None
        for writer in list(self.writers):
            writer.transport.abort()

    async def switch(self, fault):
        was, self.fault = self.fault, fault
        if fault and fault.kind in ("down", "back"):
            await self.close()
            if fault.kind == "back":
                self.loop.call_later(2, lambda: self.loop.create_task(self.switch(None)))
        elif was and not self.server:
            await self.listen()

    async def connection(self, reader, writer):
        self.writers.add(writer)
        try:
            while await self.request(reader, writer):
                await writer.drain()
        except (OSError, EOFError, asyncio.LimitOverrunError):
            pass
        finally:
            self.writers.discard(writer)
            writer.transport.abort() if self.server is None else writer.close()

    async def request(self, reader, writer):
        """Answers one request; whether the connection stays."""
        head = await reader.readuntil(b"\r\n\r\n")
        method, path = head.split(b" ", 2)[:2]
        body = await reader.readexactly(int(header(head, b"content-length") or 0))
        self.requests += 1
        # The request that this comes upon still reaches a store that goes down: done, and nobody knows.
        if self.fault_at and self.requests == self.fault_at[0]:
            await self.switch(self.fault_at[1])
        kind = self.fault.kind if self.fault and self.random.random() < self.fault.share else None
        is_key = b"list-type=" not in path
        if kind == "names 404":
            kind = 404 if b"/scenes/" in path and is_key else None
        if kind == "hole":
            await asyncio.sleep(3600)
        if kind == "garbage":
            writer.write(b"SSH-2.0-OpenSSH_9.2p1\r\n" + self.random.randbytes(200))
            return False
        if isinstance(kind, int) and (kind != 404 or (is_key and method in (b"GET", b"HEAD"))):
            text = b"" if method == b"HEAD" else b"<Error><Code>%s</Code></Error>" % (b"NoSuchKey" if kind == 404 else b"InternalError")
            writer.write(b"HTTP/1.1 %d Fault\r\nRetry-After: 1\r\nContent-Length: %d\r\n\r\n%s" % (kind, len(text), text))
            return True
        if kind == "flip up" and method == b"PUT":
            body = self.flipped(body)
        head, body = await self.ask_store(method, head, body)
        length = len(body)
        if kind == "wait":
            await asyncio.sleep(2)
        # Names and lists have no hash that would tell: they are the reader's to protect, with TLS.
        if kind == "flip" and method == b"GET" and is_key and b"/scenes/" not in path:
            body = self.flipped(body)
        if kind in ("cut", "short") and method != b"HEAD":
            body = body[: length // 2]
            length = len(body) if kind == "short" else length
        if kind == "cut" and not length:
            return False
        if method != b"HEAD":
            head = re.sub(rb"(?i)\r\n(transfer-encoding|content-length):[^\r]*", b"", head)[:-2] + b"Content-Length: %d\r\n\r\n" % length
        writer.write(head)
        for at in range(0, len(body), 1000) if kind == "rate" else []:
            writer.write(body[at : at + 1000])
            await writer.drain()
            await asyncio.sleep(0.1)
        writer.write(b"" if kind == "rate" else body)
        return kind != "cut"

    async def ask_store(self, method, head, body):
        reader, writer = await asyncio.open_connection("127.0.0.1", self.store_port, limit=1 << 20)
        try:
            # Requests are signed over Host, so it goes on as it is.
            writer.write(head + body)
            answer = await reader.readuntil(b"\r\n\r\n")
            if method == b"HEAD" or answer.split(b" ", 2)[1] in (b"204", b"304"):
                return answer, b""
            if header(answer, b"transfer-encoding") is None:
                return answer, await reader.readexactly(int(header(answer, b"content-length")))
            got = b""
            while size := int((await reader.readuntil(b"\r\n")).strip(), 16):
                got += (await reader.readexactly(size + 2))[:-2]
            return answer, got
        finally:
            writer.close()

    def flipped(self, body):
        at = self.random.randrange(len(body)) if body else 0
        return body[:at] + bytes([body[at] ^ 1 << self.random.randrange(8)]) + body[at + 1 :] if body else body


def header(head, name):
    found = re.search(rb"(?i)\r\n%s: *([^\r]*)" % name, head)
    return found and found[1]
