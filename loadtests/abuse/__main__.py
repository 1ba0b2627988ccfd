#!/usr/bin/env python3
"""Bad clients against a running server, and a good one that must not notice: `make abuse`. A row an attack; it fails where an answer is wrong,
a connection stays, memory is not bounded, or the good client waits. `MB` are of the server's process; `peak` and `cache` of that row.

    MEMORY_MB=100 (beside the page cache) GOOD_MS=1000 CUT_MB=1000 (killed beyond) STALLED=1024 CHURN=20000 IDLE=200 RESETS=20000 FAULTS=8 (told a row)
    ROWS=slow_heads,floods (the functions' names)
"""

import os
import resource
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

# Nothing is left beside the sources.
sys.dont_write_bytecode = True
import bodies
import bombs
import conform
import http1
import http2
import paths
import rig
import slow
import uploads

ROOT = Path(__file__).resolve().parents[2]
# Connections of all attacks that wait at once.
FILES = 12_288


def target() -> rig.Target:
    binaries = (ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release").resolve()
    folder = ROOT / "target" / "abuse"
    library, model = folder / "library", folder / "rock.glb"
    folder.mkdir(parents=True, exist_ok=True)
    if not model.exists():
        # So large that its pack is sent in pieces, and fits no small cache.
        subprocess.run([binaries / "lodestream-loadtests", "sample", "rock", "--triangles", "900000", "--out", model, "-q"], check=True)
    shutil.rmtree(library, ignore_errors=True)
    subprocess.run([binaries / "lodestream-server", "ingest", model, "--library", library, "--scene", "rock", "-q"], check=True)
    (folder / "secret").write_text(paths.SECRET)
    (library / "secret").write_text(paths.SECRET)
    return rig.Target(binaries / "lodestream-server", folder, library)


def asked(attack) -> bool:
    wanted = os.environ.get("ROWS", "")
    return not wanted or attack.__name__ in wanted.split(",")


def alone(attacked: rig.Target, attack) -> None:
    """On a server of its own, so that memory is told apart."""
    options = attack.options(attacked) if hasattr(attack, "options") else []
    try:
        stand = rig.Rig(attacked, attack.__name__, *options, files=getattr(attack, "files", 0))
        try:
            attack(stand)
        finally:
            stand.stop()
    except (Exception, SystemExit) as error:
        row = rig.Row()
        row.faults.append(f"{type(error).__name__}: {error}")
        rig.Rig.rows.append((attack.__name__, row))
        print(f"{attack.__name__}: {row.faults[0]}", flush=True)


def begin(attacked: rig.Target, attacks: list) -> list:
    threads = [threading.Thread(target=alone, args=(attacked, attack)) for attack in attacks if asked(attack)]
    for thread in threads:
        thread.start()
    return threads


def main() -> None:
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if sys.platform != "linux" or most < FILES:
        sys.exit(f"needs Linux with {FILES} open files (ulimit -Hn), found {sys.platform} with {most}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    started = time.monotonic()
    attacked = target()
    print(rig.HEADER, flush=True)
    if asked(slow.nothing):
        alone(attacked, slow.nothing)
    # What waits for the server's timeouts does so at once.
    unread = begin(attacked, slow.UNREAD)
    for thread in unread:
        while thread.is_alive() and not slow.BURSTS.acquire(timeout=1):
            pass
    for thread in begin(attacked, slow.SLOW) + unread:
        thread.join()
    for attack in (http1.heads, http1.ranges, paths.paths, bodies.bodies, uploads.uploads, bombs.bombs, slow.churn, http2.floods, conform.conform):
        if asked(attack):
            alone(attacked, attack)
    failed = [name for name, row in rig.Rig.rows if row.faults]
    print(f"{len(rig.Rig.rows)} rows, {len(failed)} failed, {time.monotonic() - started:.0f} s", flush=True)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
