#!/usr/bin/env python3
"""kill -9 at random points of ingest, publishing and gc: `make kills`.

A library with one scene that never changes and one that is ingested anew in four versions by turns, with what no scene needs any more
collected in between. Each run is killed at a random time, half of them in its last third, where objects are stored and the name is
switched. After each kill every scene must be there, the changed one in the version before or the new one, and `verify` must find nothing.
The last gc sweeps every staged file that a kill left.

    kills.py SERVER_BINARY FOLDER [KILLS]
"""

import json
import math
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path


def surface(file: Path, phase: float) -> None:
    """A waved sheet of 8,192 triangles as .obj."""
    n = 64
    lines = []
    for row in range(n + 1):
        for column in range(n + 1):
            x, z = column / n, row / n
            lines.append(f"v {x} {0.05 * math.sin(9 * x + phase) * math.cos(7 * z)} {z}")
    for row in range(n):
        for column in range(n):
            at = row * (n + 1) + column + 1
            lines.append(f"f {at} {at + n + 1} {at + 1}")
            lines.append(f"f {at + 1} {at + n + 1} {at + n + 2}")
    file.write_text("\n".join(lines) + "\n")


class Library:
    def __init__(self, server: Path, folder: Path):
        self.server = server
        self.path = folder / "library"

    def command(self, name: str, *arguments: str) -> list:
        return [self.server, name, "--library", self.path, "-q", *arguments]

    def run(self, name: str, *arguments: str) -> subprocess.CompletedProcess:
        return subprocess.run(self.command(name, *arguments), capture_output=True, text=True)

    def must(self, name: str, *arguments: str) -> str:
        done = self.run(name, *arguments)
        if done.returncode != 0:
            sys.exit(f"{name} {' '.join(arguments)}: exit {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout

    def references(self) -> dict:
        scenes = self.path / "scenes"
        return {file.name: json.loads(file.read_text())["scene"] for file in scenes.iterdir() if not file.name.startswith(".")}


def main() -> None:
    server, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    wanted = int(sys.argv[3]) if len(sys.argv) > 3 else 500
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    library = Library(server, folder)
    files = [folder / f"{version}.obj" for version in range(4)]
    for version, file in enumerate(files):
        surface(file, 1.0 + version)
    surface(folder / "base.obj", 0.0)
    library.must("ingest", str(folder / "base.obj"), "--scene", "base")
    # What each version is called once it is whole, and how long each command takes undisturbed.
    whole, seconds = [], {}
    for file in files:
        start = time.monotonic()
        library.must("ingest", str(file), "--scene", "edited")
        seconds["ingest"] = time.monotonic() - start
        whole.append(library.references()["edited"])
    base = library.references()["base"]
    start = time.monotonic()
    library.must("gc", "--grace-secs", "0")
    seconds["gc"] = time.monotonic() - start
    generator = random.Random(1)
    kills, done, switched, version, most_staged = {"ingest": 0, "gc": 0}, 0, 0, 3, 0
    started = time.monotonic()
    while sum(kills.values()) < wanted:
        name = "gc" if generator.random() < 0.3 else "ingest"
        before = library.references()["edited"]
        if name == "ingest":
            version = (version + 1) % len(files)
            process = library.command(name, str(files[version]), "--scene", "edited")
        else:
            process = library.command(name, "--grace-secs", "0")
        late = generator.random() < 0.5
        share = generator.uniform(0.66, 1.1) if late else generator.uniform(0.0, 0.66)
        process = subprocess.Popen(process, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            _, said = process.communicate(timeout=share * seconds[name])
            done += 1
            if process.returncode != 0:
                sys.exit(f"{name} after {sum(kills.values())} kills: exit {process.returncode}\n{said}")
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            kills[name] += 1
        references = library.references()
        if references.get("base") != base:
            sys.exit(f"base is {references.get('base')} after {kills}")
        allowed = {before, whole[version]} if name == "ingest" else {before}
        if references.get("edited") not in allowed:
            sys.exit(f"edited is {references.get('edited')}, expected one of {allowed}, after {kills}")
        switched += references["edited"] != before
        most_staged = max(most_staged, len(list(library.path.rglob("*#*"))))
        verified = library.run("verify")
        if verified.returncode != 0:
            sys.exit(f"verify after {kills} ({name}):\n{verified.stdout}{verified.stderr}")
    # Killed writers leave staged files; gc sweeps them.
    staged = len(list(library.path.rglob("*#*")))
    left = library.run("gc", "--grace-secs", "0")
    unswept = [str(file) for file in library.path.rglob("*#*")]
    if unswept:
        sys.exit(f"staged files after gc: {unswept}")
    library.must("verify")
    notes = [file for name in ("builds", "plans") for file in (library.path / name).rglob("*") if file.is_file()]
    print(f"kills: {kills['ingest']} of ingest, {kills['gc']} of gc; {done} runs came to their end; {switched} switched the scene")
    print(f"scenes lost 0, half-visible 0, faults of verify 0 (after each), last gc exit {left.returncode}, notes left {len(notes)}")
    print(f"staged files: {most_staged} at most after a kill, {staged} before the last gc, 0 after it")
    print(f"{time.monotonic() - started:.0f} s; an undisturbed ingest takes {seconds['ingest']:.2f} s, a gc {seconds['gc']:.2f} s")
    if left.returncode != 0:
        sys.exit(left.stderr)


if __name__ == "__main__":
    main()
