"""Runs the programs: one library for all scenes, a name and a report a file."""

import json
import os
import shutil
import subprocess
import threading
from dataclasses import dataclass, field
from pathlib import Path

from files import gltf
from files.picture import Depths, Picture, read_pfm, read_png
from files.surface import Scene

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"
CASES = SHARED / "cases"
MODELS = SHARED / "models"
KHRONOS = MODELS / "khronos"
BAD = MODELS / "bad"
# Longest run of one command, seconds.
LONGEST_SECS = 300


class Failed(Exception):
    """A command that had to work and did not: its error line."""


@dataclass
class Run:
    code: int
    out: str
    err: str
    peak_bytes: int

    def error(self) -> str:
        return self.err.strip() or f"exit {self.code} without a word"


@dataclass
class Ingested:
    """A scene of the library, and what its ingest said."""

    scene: str
    report: dict

    @property
    def triangles(self) -> int:
        return self.report["input_triangles"]

    @property
    def warnings(self) -> list[str]:
        return self.report["warnings"]

    def warned(self, *parts: str) -> str:
        """The first warning that has all parts, whatever their case; empty where none has."""
        fits = (it for it in self.warnings if all(part.lower() in it.lower() for part in parts))
        return next(fits, "")


@dataclass
class Exported:
    """Source triangles as the library holds them, and the error that export states."""

    scene: Scene
    error_metres: float
    report: dict


@dataclass
class Rendered:
    png: Path
    pfm: Path
    report: dict
    peak_bytes: int

    def shown(self) -> Picture:
        return read_png(self.png)

    def depths(self) -> Depths:
        return read_pfm(self.pfm)


@dataclass
class Rig:
    binaries: Path
    folder: Path
    ingested: dict[str, Ingested] = field(default_factory=dict)
    exported: dict[str, Exported] = field(default_factory=dict)
    locks: dict[tuple, threading.Lock] = field(default_factory=dict)
    guard: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self):
        self.library = self.folder / "library"
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)

    def lock(self, *key: str) -> threading.Lock:
        with self.guard:
            return self.locks.setdefault(key, threading.Lock())

    def run(self, program: str, *arguments) -> Run:
        command = [self.binaries / f"lodestream-{program}", *map(str, arguments)]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        killer = threading.Timer(LONGEST_SECS, process.kill)
        killer.start()
        heard: list[bytes] = []
        listener = threading.Thread(target=lambda: heard.append(process.stderr.read()))
        listener.start()
        out = process.stdout.read()
        listener.join()
        _, status, usage = os.wait4(process.pid, 0)
        killer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        for pipe in (process.stdout, process.stderr):
            pipe.close()
        return Run(process.returncode, out.decode("utf-8", "replace"), heard[0].decode("utf-8", "replace"), usage.ru_maxrss * 1024)

    def name(self, file: Path) -> str:
        kept = "".join(it if it.isalnum() else "_" for it in file.name)
        return f"{file.parent.name.replace('-', '_')}.{kept}"

    def try_ingest(self, file: Path, *options: str) -> tuple[Run, Ingested | None]:
        scene = self.name(file)
        report = self.folder / f"{scene}.ingest.json"
        run = self.run("server", "ingest", file, "--library", self.library, "--scene", scene, "--report", report, *options)
        if run.code:
            return run, None
        return run, Ingested(scene, json.loads(report.read_text()))

    def ingest(self, file: Path) -> Ingested:
        with self.lock("ingest", str(file)):
            if str(file) not in self.ingested:
                run, ingested = self.try_ingest(file)
                if ingested is None:
                    raise Failed(f"ingest exits {run.code}: {run.error()}")
                self.ingested[str(file)] = ingested
            return self.ingested[str(file)]

    def export(self, file: Path) -> Exported:
        scene = self.ingest(file).scene
        with self.lock("export", str(file)):
            if str(file) not in self.exported:
                out, report = self.folder / f"{scene}.export.glb", self.folder / f"{scene}.export.json"
                run = self.run("server", "export", scene, "--library", self.library, "--source", "--out", out, "--report", report)
                if run.code:
                    raise Failed(f"export exits {run.code}: {run.error()}")
                said = json.loads(report.read_text())
                self.exported[str(file)] = Exported(gltf.read(out), said["error_metres"], said)
                out.unlink()
            return self.exported[str(file)]

    def render(self, file: Path, label: str, *options, size: str = "320x180") -> Rendered:
        scene = self.ingest(file).scene
        stem = self.folder / f"{scene}.{label}"
        png, pfm, report = (Path(f"{stem}.{kind}") for kind in ("png", "pfm", "draw.json"))
        run = self.run("client", "render", self.library, "--scene", scene, "--size", size, "--out", png, "--depth", pfm,
                       "--report", report, "--quiet", *options)  # fmt: skip
        if run.code:
            raise Failed(f"render exits {run.code}: {run.error()}")
        return Rendered(png, pfm, json.loads(report.read_text()), run.peak_bytes)

    def play(self, file: Path, label: str, path: dict) -> list[Picture]:
        """A picture a frame of a camera path."""
        scene = self.ingest(file).scene
        folder = self.folder / f"{scene}.{label}"
        folder.mkdir()
        (folder / "path.json").write_text(json.dumps(path))
        run = self.run("client", "play", self.library, "--scene", scene, "--path", folder / "path.json", "--frames", folder, "--quiet")
        if run.code:
            raise Failed(f"play exits {run.code}: {run.error()}")
        return [read_png(it) for it in sorted(folder.glob("*.png"))]


def look(eye, target, fov: float = 45.0, up=(0, 1, 0)) -> tuple[str, str]:
    """The options of a camera."""
    parts = [("eye", eye), ("target", target), ("up", up)]
    text = ";".join(f"{name}={','.join(repr(float(it)) for it in at)}" for name, at in parts)
    return "--camera", f"{text};fov={fov}"
