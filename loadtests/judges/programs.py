"""Runs the programs, each at low priority, into one library."""

import json
import os
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT.parent / "shared" / "models"


class Failed(Exception):
    """A command that had to work and did not: its error line."""


@dataclass
class Programs:
    server: Path
    client: Path
    loadtests: Path
    folder: Path

    def __post_init__(self):
        self.folder.mkdir(parents=True, exist_ok=True)
        self.library = self.folder / "library"

    def run(self, program: Path, *arguments) -> float:
        """Seconds that the command took."""
        started = time.monotonic()
        ended = subprocess.run([program, *map(str, arguments)], check=False, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        if ended.returncode:
            said = " ".join(ended.stderr.split()) or "nothing said"
            raise Failed(f"{program.name} {arguments[0]} exits {ended.returncode}: {said}")
        return time.monotonic() - started

    def reported(self, program: Path, *arguments) -> dict:
        report = self.folder / "report.json"
        report.unlink(missing_ok=True)
        self.run(program, *arguments, "--report", report, "--quiet")
        return json.loads(report.read_text())

    def ingest(self, file: Path, scene: str, *how) -> dict:
        return self.reported(self.server, "ingest", file, "--library", self.library, "--scene", scene, *how)

    def export(self, scene: str, *how) -> Path:
        out = self.folder / "export.ply"
        self.run(self.server, "export", scene, "--library", self.library, *how, "--out", out, "--quiet")
        return out


def from_environment(folder: Path) -> Programs:
    """SERVER, CLIENT and LOADTESTS, else the release build."""
    built = (ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release").resolve()
    paths = (Path(os.environ.get(name.upper(), built / f"lodestream-{name}")) for name in ("server", "client", "loadtests"))
    return Programs(*paths, folder)
