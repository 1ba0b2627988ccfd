#!/usr/bin/env python3
"""A store that fails in every way that stores do, under serve, ingest, verify, gc and copy: `make faults`.

A proxy between the server and a SeaweedFS of .ci/s3 breaks connections, bytes and answers. No answer may be wrong, every error must come
in time and say what it is, and all must be well again once the fault is over. Prints a row a fault and command; exits 1 on what is broken.

    faults.py [FAULT...]     only these faults, by their names in the table
    WORKERS=14 FAULT_SECS=5 MIDDLES=2
"""

import collections
import concurrent.futures
import json
import os
import random
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

# No __pycache__ beside the sources.
sys.dont_write_bytecode = True
from faults_proxy import Fault, Proxy  # noqa: E402
from faults_serve import Right, Serve, Server  # noqa: E402

ROOT = Path(__file__).absolute().parent.parent
BIN = ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release"
OUT = ROOT / "target/faults"
SERVER = BIN / "lodestream-server"
COMMANDS = ("ingest", "verify", "gc", "copy")
# Twice the longest request to the store, with all its retries, and some.
COMMAND_SECS = 150
# Runs of a command that a fault meets on their way.
MIDDLES = int(os.environ.get("MIDDLES", "2"))
# Slow ones first: they wait while others work.
FAULTS = [
    Fault("black hole", "hole", total=True),
    Fault("10 KB/s", "rate"),
    Fault("2 s to the first byte", "wait"),
    Fault("down from the start", "down", total=True),
    Fault("down, back after 2 s", "back"),
    Fault("closed in the body", "cut", total=True),
    Fault("30 % closed in the body", "cut", 0.3),
    Fault("short with its length", "short", total=True),
    Fault("flipped byte", "flip"),
    Fault("flipped byte on the way up", "flip up"),
    Fault("500", 500, total=True),
    Fault("30 % 500", 500, 0.3),
    Fault("503", 503, total=True),
    Fault("429", 429, total=True),
    Fault("404", 404),
    Fault("404 for names", "names 404"),
    Fault("garbage", "garbage", total=True),
]


def server(*arguments, environment=None, timeout=None):
    command = [SERVER, *map(str, arguments), "-q"]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=timeout)


def must(*arguments):
    done = server(*arguments)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def through(proxy):
    return {**os.environ, "AWS_ENDPOINT": f"http://127.0.0.1:{proxy.port}"}


def scenes(library):
    """What each name points at; nothing where the names cannot be read."""
    return dict(line.split("\t")[:2] for line in server("list", "--library", library).stdout.splitlines())


def row_of(kind, *arguments):
    try:
        return kind(*arguments)
    except (Exception, SystemExit) as error:
        return SimpleNamespace(counts=collections.Counter(), error_secs=0, recover_secs=0, broken=[repr(error)], said=list)


class Command:
    """A command over a fault from its start on, then from some of its `requests` on."""

    def __init__(self, fault, name, s3, new, requests):
        self.fault, self.name, self.s3, self.new, self.broken = fault, name, s3, new, []
        self.counts, self.lines = collections.Counter(), {}
        self.error_secs, self.recover_secs = 0.0, 0.0
        generator = random.Random(f"{fault.name} {name}")
        for at in (1, *sorted(generator.sample(range(2, requests), MIDDLES))) if requests else (1,):
            self.run(at)

    def said(self):
        """The error in the middle of things, where there is one."""
        return list(self.lines.values())[-1:]

    def arguments(self, library, target):
        return {
            "ingest": ("ingest", OUT / "new.glb", "--library", library, "--scene", "edited"),
            "verify": ("verify", "--library", library),
            "gc": ("gc", "--library", library, "--grace-secs", "0"),
            "copy": ("copy", f"{self.s3}/source", target, "--scene", "base", "--scene", "big"),
        }[self.name]

    def run(self, at):
        library = target = f"{self.s3}/{self.fault.slug}-{self.name}-{at}"
        if self.name != "copy":
            must("copy", OUT / "small", library)
        if self.name == "gc":
            # What it should take.
            must("ingest", OUT / "new.glb", "--library", library, "--scene", "edited")
            must("ingest", OUT / "old.glb", "--library", library, "--scene", "edited")
        before = scenes(library)
        proxy, start = Proxy(), time.monotonic()
        if at == 1:
            proxy.call(proxy.switch(self.fault))
        else:
            proxy.fault_at = (at, self.fault)
        arguments = self.arguments(library, target)
        try:
            done = server(*arguments, environment=through(proxy), timeout=COMMAND_SECS)
            status = done.returncode
        except subprocess.TimeoutExpired as hung:
            done, status = hung, "hung"
        secs = time.monotonic() - start
        proxy.call(proxy.close())
        self.counts["requests"] += proxy.requests
        self.counts["right" if status == 0 else f"exit {status}" if status != "hung" else status] += 1
        self.look(at, status, done, secs, library, before, arguments)

    def look(self, at, status, done, secs, library, before, arguments):
        broken = lambda text: self.broken.append(f"from request {at} on: {text}")
        if status == "hung":
            broken(f"no end after {secs:.0f} s")
        elif status != 0:
            self.error_secs = max(self.error_secs, secs)
            lines = done.stderr.splitlines()
            self.lines[at] = lines[-1] if lines else ""
            if status != 1 or not lines or not lines[-1].startswith("error: ") or (len(lines) > 1 and self.name != "verify"):
                broken(f"exit {status} with {len(lines)} lines: {done.stderr[:300]!r}")
        elif self.name == "verify" and at == 1 and (self.fault.total or self.fault.kind in ("flip", 404, "names 404")):
            broken("verify found nothing")
        start = time.monotonic()
        after = scenes(library)
        whole = server("verify", "--library", library)
        # A copy that failed before its first write made no library.
        is_none = self.name == "copy" and status != 0 and "expected a library" in whole.stderr and "found nothing" in whole.stderr
        if whole.returncode != 0 and not is_none:
            broken(f"the library is damaged: {whole.stderr[:300]!r}")
        allowed = {"ingest": (before.get("edited"), self.new), "copy": (None, before.get("edited"))}.get(self.name, (before.get("edited"),))
        if self.name != "copy" and (after.get("base") != before["base"] or after.get("edited") not in allowed):
            broken(f"scenes {before} became {after}")
        if status == 0 and self.name == "ingest" and after.get("edited") != self.new:
            broken("exit 0, and the new scene is not there")
        if status == 0 and self.name == "copy" and not {"base", "big"} <= set(after):
            broken(f"exit 0, and there are {sorted(after)}")
        again = server(*arguments)
        if again.returncode != 0 or server("verify", "--library", library).returncode != 0:
            broken(f"over the healthy store: {again.stderr[:300]!r}")
        elif self.name == "ingest" and scenes(library).get("edited") != self.new:
            broken("a second ingest did not publish")
        elif status != 0:
            self.recover_secs = max(self.recover_secs, time.monotonic() - start)


def prepare(s3):
    """Libraries, and what a server and a second ingest must answer."""
    sample = [BIN / "lodestream-loadtests", "sample", "-q"]
    for name, triangles in (("base", 20000), ("old", 6000), ("new", 6000), ("big", 800000)):
        seed = {"old": 2, "new": 3}.get(name, 1)
        subprocess.run([*sample, "rock", "--triangles", str(triangles), "--seed", str(seed), "--out", OUT / f"{name}.glb"], check=True)
    subprocess.run([*sample, "city", "--instances", "40", "--unique", "8", "--out", OUT / "city.glb"], check=True)
    for library, scene, file in (
        ("small", "base", "base"), ("small", "edited", "old"), ("new", "edited", "new"),
        ("large", "base", "base"), ("large", "big", "big"), ("large", "city", "city"),
    ):  # fmt: skip
        must("ingest", OUT / f"{file}.glb", "--library", OUT / library, "--scene", scene)
    must("copy", OUT / "large", f"{s3}/source")
    must("show", "city", "--library", OUT / "large", "--assets", "--report", OUT / "city.json")
    must("show", "big", "--library", OUT / "large", "--assets", "--report", OUT / "big.json")
    assets = [row["asset"] for name in ("big", "city") for row in json.loads((OUT / f"{name}.json").read_text())["assets_table"]]
    objects = {file.name: file.read_bytes() for file in (OUT / "large/objects").glob("*/*")}
    healthy = Server(SERVER, f"{s3}/source", OUT / "healthy.log")
    right = Right(healthy.port, ("base", "big", "city"), assets, objects)
    healthy.stop()
    return right, scenes(OUT / "new")["edited"]


def main():
    if "LODESTREAM_TEST_S3" not in os.environ:
        os.execv(ROOT / ".ci/s3", [".ci/s3", sys.executable, str(Path(__file__).absolute()), *sys.argv[1:]])
    began = time.monotonic()
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    s3 = os.environ["LODESTREAM_TEST_S3"] + "/faults"
    right, new = prepare(s3)
    Proxy.store_port = int(os.environ["AWS_ENDPOINT"].rsplit(":", 1)[1])
    threading.Thread(target=Proxy.loop.run_forever, daemon=True).start()
    faults = [fault for fault in FAULTS if not sys.argv[1:] or fault.name in sys.argv[1:]]
    undisturbed = {name: Command(Fault("none", None), name, s3, new, None) for name in COMMANDS}
    for name, row in undisturbed.items():
        if row.broken or not row.counts["right"]:
            sys.exit(f"{name} over the healthy store: {row.broken} {row.lines}")
    rows = {}
    with concurrent.futures.ThreadPoolExecutor(int(os.environ.get("WORKERS", "14"))) as pool:
        for fault in faults:
            if fault.kind != "flip up":
                rows[fault, "serve"] = pool.submit(row_of, Serve, fault, right, SERVER, f"{s3}/source", through, OUT)
            for name in COMMANDS:
                rows[fault, name] = pool.submit(row_of, Command, fault, name, s3, new, undisturbed[name].counts["requests"])
    rows = {key: row.result() for key, row in rows.items()}
    print(f"{'fault':28}{'command':9}{'requests':>9}{'right':>7}{'wrong':>7}{'s to error':>12}{'s to recover':>14}  errors")
    for (fault, name), row in rows.items():
        counts = row.counts
        errors = ", ".join(f"{counts[key]} {key}" for key in sorted(set(counts) - {"requests", "right", "wrong"}, key=str))
        columns = f"{counts['requests']:9}{counts['right']:7}{counts['wrong']:7}{row.error_secs:12.1f}{row.recover_secs:14.1f}"
        print(f"{fault.name:28}{name:9}{columns}  {errors}{'  BROKEN' if row.broken else ''}")
    print("\nwhat was said")
    for (fault, name), row in rows.items():
        for line in row.said():
            print(f"{fault.name}, {name}: {line}")
    broken = [f"{fault.name}, {name}: {text}" for (fault, name), row in rows.items() for text in row.broken]
    print(f"\n{len(broken)} broken invariants, {time.monotonic() - began:.0f} s", *broken, sep="\n")
    sys.exit(bool(broken))


if __name__ == "__main__":
    main()
