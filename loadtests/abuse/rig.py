"""A server under attack, and what is seen of it meanwhile: its memory, its sockets, and how a good client on other connections fares."""

import atexit
import contextlib
import json
import os
import re
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

# Most memory beside the page cache, and the longest that the good client may wait for an answer.
MEMORY_MB = int(os.environ.get("MEMORY_MB", "100"))
GOOD_MS = int(os.environ.get("GOOD_MS", "1000"))
# A server that takes more than this is killed, so that the machine outlives the attack.
CUT_MB = int(os.environ.get("CUT_MB", "1000"))
FAULTS = int(os.environ.get("FAULTS", "8"))
HEADER = f"{'attack':40} {'attempts':>8} {'MB before':>9} {'peak':>6} {'cache':>6} {'good':>6} {'worst ms':>8}  outcome"


class Target:
    """What is attacked: the library's names, and the bytes that a good client must get."""

    def __init__(self, binary: Path, folder: Path, library: Path):
        self.binary, self.folder, self.library = binary, folder, library
        objects = {file.name: file for file in (library / "objects").glob("*/*")}
        report = folder / "show.json"
        shown = [binary, "show", "rock", "--library", library, "--assets", "--report", report, "-q"]
        subprocess.run(shown, check=True, stdout=subprocess.DEVNULL)
        scene = json.loads(report.read_text())
        self.asset, self.last_page = scene["assets_table"][0]["asset"], scene["pages"] - 1
        by_size = sorted(objects.values(), key=lambda file: file.stat().st_size)
        # The largest object is the pack, the next one the hierarchy.
        self.pack, self.hierarchy = by_size[-1].name, by_size[-2].name
        self.pack_bytes, self.hierarchy_bytes = by_size[-1].read_bytes(), by_size[-2].read_bytes()
        self.good_path = f"/v1/assets/{self.asset}/pages/1-1"
        self.all_pages = f"/v1/assets/{self.asset}/pages/0-{self.last_page}"


class Server:
    def __init__(self, target: Target, name: str, *options: str, files: int = 0):
        """`files`: descriptors that it may have, where that is not all there are."""
        self.log = target.folder / f"{name}.log"
        with self.log.open("w") as log:
            command = ["prlimit", f"--nofile={files}"] if files else []
            command += [target.binary, "serve", "--library", target.library, "--listen", "127.0.0.1:0", *options]
            self.process = subprocess.Popen(command, stdout=log, stderr=log)
        atexit.register(self.process.kill)
        deadline = time.monotonic() + 10
        while not (found := re.search(r"listening on http://127\.0\.0\.1:(\d+)", self.log.read_text())):
            if self.process.poll() is not None or time.monotonic() > deadline:
                sys.exit(f"the server does not start:\n{self.log.read_text()}")
            time.sleep(0.02)
        self.port = int(found[1])

    def status(self, field: str) -> float:
        """A field of /proc/PID/status in MB; 0 once the server is gone."""
        return memory_mb(self.process.pid, field)

    def reset_peak(self) -> None:
        with contextlib.suppress(OSError):
            Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")

    def children_mb(self) -> float:
        """Memory of the ingests that it runs."""
        try:
            numbers = "".join(file.read_text() for file in Path(f"/proc/{self.process.pid}/task").glob("*/children"))
        except OSError:
            return 0.0
        return sum(memory_mb(int(number), "VmRSS") for number in numbers.split())

    def sockets(self) -> int:
        count = 0
        for file in Path(f"/proc/{self.process.pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                count += os.readlink(file).startswith("socket:")
        return count

    def cached_mb(self) -> float:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/metrics", timeout=10) as answer:
                return int(re.search(rb"lodestream_page_cache_bytes (\d+)", answer.read())[1]) / 1e6
        except OSError:
            return 0.0

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()


def memory_mb(process: int, field: str) -> float:
    try:
        text = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    found = re.search(rf"{field}:\s+(\d+) kB", text)
    return int(found[1]) * 1024 / 1e6 if found else 0.0


class Good:
    """The good client, in a process of its own: what it measures is the server, not the attacker."""

    def __init__(self, target: Target, port: int):
        page = urllib.request.urlopen(f"http://127.0.0.1:{port}{target.good_path}", timeout=10).read()
        if not page or page not in target.pack_bytes:
            sys.exit(f"{target.good_path}: expected bytes of the pack, found {len(page)} others")
        file = target.folder / "page"
        file.write_bytes(page)
        script = Path(__file__).with_name("good.py")
        command = [sys.executable, script, str(port), target.good_path, file]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.since()

    def since(self) -> dict:
        """What it saw since it was last asked."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()


class Row:
    """One attack: attempts, what happened, and what should not have."""

    def __init__(self):
        self.attempts, self.notes, self.faults = 0, [], []
        # What the server's ingests took at once, what it had when it was killed, what the good client saw where the row measured that itself.
        self.child_mb, self.cut_mb, self.good, self.broke = 0.0, 0.0, None, ""

    def note(self, text: str) -> None:
        self.notes.append(text)

    def check(self, holds: bool, expected: str, found: object) -> None:
        if not holds:
            self.faults.append(f"expected {expected}, found {found}")


class Rig:
    """A server, its good client, and the rows of their table."""

    rows: list = []
    printing = threading.Lock()

    def __init__(self, target: Target, name: str, *options: str, files: int = 0):
        self.target, self.name, self.options, self.files = target, name, options, files
        self.start()

    def start(self) -> None:
        self.server = Server(self.target, self.name, *self.options, files=self.files)
        self.good = Good(self.target, self.server.port)

    def stop(self) -> None:
        self.good.stop()
        self.server.stop()

    @property
    def port(self) -> int:
        return self.server.port

    @contextlib.contextmanager
    def attack(self, name: str):
        """A row of the table. Whatever goes wrong on the attacker's side is a fault of the row, not the end of the run."""
        row, done = Row(), threading.Event()
        self.server.reset_peak()
        before, said = self.server.status("VmRSS"), len(self.server.log.read_text())
        self.good.since()
        watcher = threading.Thread(target=self.watch, args=(row, done))
        watcher.start()
        try:
            yield row
        except Exception as error:
            row.broke = f"the attack broke off: {type(error).__name__}: {error}"
        finally:
            done.set()
            watcher.join()
        # What an attack leaves behind counts too.
        time.sleep(0.5)
        gone = self.server.process.poll()
        # On a server that was killed for its memory attacks fail in every way; that is told below.
        if row.broke and gone is None:
            row.faults.append(row.broke)
        rest = self.good.since()
        good = row.good or rest
        peak, cached = self.server.status("VmHWM"), self.server.cached_mb()
        if gone is not None:
            peak = row.cut_mb
            row.check(False, "a server that stays", f"exit {gone}" if not peak else f"{peak:.0f} MB, so that it was killed")
        else:
            row.check(peak - cached < MEMORY_MB, f"less than {MEMORY_MB} MB beside the cache", f"{peak - cached:.0f}")
            row.check(
                good["asked"] > 0 and not good["errors"] + rest["errors"],
                "right answers to the good client",
                (good["errors"] + rest["errors"])[:2],
            )
            row.check(good["worst_ms"] < GOOD_MS, f"less than {GOOD_MS} ms for the good client", f"{good['worst_ms']:.0f}")
        row.check("panicked" not in self.server.log.read_text()[said:], "no panic", self.server.log)
        if row.child_mb:
            row.note(f"ingests {row.child_mb:.0f} MB")
        line = f"{name:40} {row.attempts:8} {before:9.0f} {peak:6.0f} {cached:6.1f} {good['asked']:6} {good['worst_ms']:8.1f}"
        with Rig.printing:
            Rig.rows.append((name, row))
            print(f"{line}  {'FAILS' if row.faults else 'ok'}: {', '.join(row.notes)}", flush=True)
            for fault in row.faults[:FAULTS]:
                print(f"    {fault}", flush=True)
            if len(row.faults) > FAULTS:
                print(f"    and {len(row.faults) - FAULTS} more", flush=True)
        if gone is not None:
            self.stop()
            self.start()

    def watch(self, row: Row, done: threading.Event) -> None:
        while not done.wait(0.1):
            row.child_mb = max(row.child_mb, self.server.children_mb())
            now = self.server.status("VmRSS")
            if now > CUT_MB:
                row.cut_mb = now
                self.server.process.kill()
                self.server.process.wait()
                return
