"""What `servers.py` does not ask wrk for: pages streamed by POST /v1/pages against bare TCP with the same reader, and what idle viewers cost.

The readers are the same code for both: threads of two processes that receive into a buffer and count."""

import json
import multiprocessing
import os
import re
import resource
import socket
import statistics
import sys
import threading
import time

out, server_pid = sys.argv[1:]
STREAMS = int(os.environ.get("POST_STREAMS", "16"))
IDLE = int(os.environ.get("IDLE", "10000"))
ROUNDS = int(os.environ.get("ROUNDS", "3"))
SECS = int(os.environ.get("SECS", "3"))
OURS = ("127.0.0.1", 7979)
TICK_MICROSECONDS = 1e6 / os.sysconf("SC_CLK_TCK")
WRITE_BYTES = 256 * 1024


def processor_us(process):
    with open(f"/proc/{process}/stat") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) * TICK_MICROSECONDS


def resident_bytes(process):
    with open(f"/proc/{process}/status") as file:
        return int(re.search(r"RssAnon:\s+(\d+)", file.read())[1]) * 1024


def pages_of_scene():
    """The asset with the most pages, of those that `servers.py` wrote down for nginx: its hash, and how many."""
    assets = out + "/www/v1/assets"
    counts = {asset: len(os.listdir(f"{assets}/{asset}/pages")) for asset in os.listdir(assets)}
    return max(counts.items(), key=lambda asset: asset[1])


def request(viewer):
    """All pages of the asset."""
    wants = [{"asset": asset, "first": 0, "last": page_count - 1, "priority": 1}]
    body = json.dumps({"viewer": viewer, "sequence": 1, "wants": wants}).encode()
    return b"POST /v1/pages HTTP/1.1\r\nhost: x\r\ncontent-length: %d\r\n\r\n" % len(body) + body


def read_posts(number, until, counts):
    """Posts again whenever the answer has ended; the last chunk is empty."""
    buffer = memoryview(bytearray(1 << 20))
    with socket.create_connection(OURS) as stream:
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        total = 0
        while time.monotonic() < until:
            stream.sendall(request(number))
            tail = b""
            while tail[-5:] != b"0\r\n\r\n":
                got = stream.recv_into(buffer)
                if got == 0:
                    raise SystemExit("the server closed a connection in the middle of an answer")
                total += got
                tail = (tail + bytes(buffer[max(got - 5, 0) : got]))[-5:]
        counts.put(total)


def read_bare(port, until, counts):
    buffer = memoryview(bytearray(1 << 20))
    with socket.create_connection(("127.0.0.1", port)) as stream:
        total = 0
        while time.monotonic() < until:
            total += stream.recv_into(buffer)
        counts.put(total)


def write_bare(listener):
    """Writes the same pages for ever, from memory, a process a connection: no interpreter is shared."""
    folder = f"{out}/www/v1/assets/{asset}/pages"
    pages = bytearray()
    for page in range(page_count):
        with open(f"{folder}/{page}-{page}", "rb") as file:
            pages += file.read()
    pages = memoryview(pages)
    while True:
        stream = listener.accept()[0]
        if os.fork() == 0:
            try:
                while True:
                    for at in range(0, len(pages), WRITE_BYTES):
                        stream.sendall(pages[at : at + WRITE_BYTES])
            except OSError:
                os._exit(0)
        stream.close()


def readers(count, target, args):
    """Runs `count` readers in two processes; gives bytes a second."""
    until = time.monotonic() + SECS
    counts = multiprocessing.Queue()

    def half(first):
        threads = [threading.Thread(target=target, args=(*(args or (number,)), until, counts)) for number in range(first, count, 2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    halves = [multiprocessing.Process(target=half, args=(first,)) for first in (0, 1)]
    for process in halves:
        process.start()
    total = sum(counts.get() for _ in range(count))
    for process in halves:
        process.join()
    return total / SECS


def posts():
    """POST against bare TCP, rounds in turn."""
    listener = socket.create_server(("127.0.0.1", 0), backlog=128)
    writer = multiprocessing.Process(target=write_bare, args=(listener,), daemon=True)
    writer.start()
    rates = {"bare TCP": [], "POST /v1/pages": []}
    cost = []
    for _ in range(ROUNDS):
        rates["bare TCP"].append(readers(STREAMS, read_bare, (listener.getsockname()[1],)))
        before = processor_us(server_pid)
        rates["POST /v1/pages"].append(readers(STREAMS, read_posts, ()))
        cost.append((processor_us(server_pid) - before) / (rates["POST /v1/pages"][-1] * SECS / mean_bytes))
    writer.terminate()
    medians = {name: statistics.median(found) for name, found in rates.items()}
    part = medians["POST /v1/pages"] / medians["bare TCP"]
    print(f"{STREAMS} connections: bare TCP {medians['bare TCP'] / 1e9:.2f} GB/s, POST /v1/pages {medians['POST /v1/pages'] / 1e9:.2f} GB/s, {part:.2f} of it; {statistics.median(cost):.1f} us of processor a page")
    return {"connections": STREAMS, "bare_tcp_bytes_per_s": medians["bare TCP"], "post_bytes_per_s": medians["POST /v1/pages"], "of_bare_tcp": part, "cpu_us": statistics.median(cost)}


def idle():
    """Viewers that have had a page and stay connected."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    asked = b"GET /v1/assets/%s/pages/0-0 HTTP/1.1\r\nhost: x\r\n\r\n" % asset.encode()
    before = resident_bytes(server_pid)
    streams = []
    started = time.monotonic()
    for _ in range(IDLE):
        stream = socket.create_connection(OURS)
        stream.sendall(asked)
        streams.append(stream)
        left = mean_first
        while left > 0:
            left -= len(stream.recv(left))
    seconds = time.monotonic() - started
    bytes_each = (resident_bytes(server_pid) - before) / IDLE
    alive = sum(probe(stream, asked) for stream in streams[:: max(1, IDLE // 100)])
    of = len(streams[:: max(1, IDLE // 100)])
    print(f"{IDLE} idle viewers: {bytes_each / 1024:.1f} KiB each, connected and served in {seconds:.1f} s, {alive} of {of} asked again answer")
    for stream in streams:
        stream.close()
    return {"viewers": IDLE, "bytes_each": bytes_each, "alive": alive, "asked": of}


def probe(stream, asked):
    try:
        stream.sendall(asked)
        return stream.recv(12) == b"HTTP/1.1 200"
    except OSError:
        return False


def first_answer_bytes():
    with socket.create_connection(OURS) as stream:
        stream.sendall(b"GET /v1/assets/%s/pages/0-0 HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n" % asset.encode())
        whole = b""
        while got := stream.recv(1 << 20):
            whole += got
    return len(whole) - len(b"connection: close\r\n")


multiprocessing.set_start_method("fork")
asset, page_count = pages_of_scene()
with open(out + "/servers.json") as file:
    report = json.load(file)
mean_bytes = report["connections"][0]["mean_bytes"]
mean_first = first_answer_bytes()
report["post"] = posts()
get = next((row for row in report["connections"] if row["server"] == "lodestream"), None)
if get:
    print(f"a page by GET, {get['connections_or_streams']} connections: {get['cpu_us']:.1f} us of processor")
report["idle"] = idle()
with open(out + "/servers.json", "w") as file:
    json.dump(report, file, indent=1)
